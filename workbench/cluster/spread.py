"""Chunks of a study as Dask tasks: some at a time, repeated where a worker dies."""

from __future__ import annotations

import contextlib
import itertools
import logging
import pickle
import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

from workbench.cluster.task import OtherProgram, run_remote_chunk, versions
from workbench.effects.registry import files_behind
from workbench.errors import InputError, one_line
from workbench.study.execute.batch import Spread
from workbench.study.execute.store import Chunk
from workbench.study.scenario.load import Study

RETRIES = 3
# Tasks handed out for each worker thread: one in work, one waiting, so that nobody idles.
AHEAD = 2
CONNECT_S = 10.0
WITHOUT_WORKERS_S = 60.0  # after which a cluster that has lost its last worker is given up
LOOK_S = 5.0  # between two looks at who is left
CLOSE_S = 5.0
_CONNECTED = "connected"
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
WAIT_FOR_WORKERS_S = 60.0


@contextmanager
def spread_on(cluster: str) -> Iterator[Spread]:
    """A way to run chunks on `cluster`; see `client_on`."""
    with client_on(cluster) as client:
        yield lambda study, numbers: _while_it_lives(_chunks(client, cluster, study, numbers), cluster)


def each_on(
    client: Any, cluster: str, items: Sequence[str], task: Callable[[str], tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """Each item with its result, as they come; task: of an item, the function that a worker calls and its arguments."""
    waiting, of = iter(items), dict[Any, str]()
    try:
        while True:
            for item in itertools.islice(waiting, AHEAD * _threads(client) - len(of)):
                of[client.submit(*task(item), retries=RETRIES, pure=False)] = item
            if not of:
                return
            future = _next_done(client, cluster, of)
            yield of.pop(future), future.result()
            future.release()
    except _distributed().KilledWorker as error:
        raise InputError(f"a task took its workers down {RETRIES} times; what is done is kept", file=cluster) from error
    except (CancelledError, OSError) as error:
        raise InputError("the cluster is gone; what is done is kept", file=cluster) from error


@contextmanager
def client_on(cluster: str) -> Iterator[Any]:
    """Dask's client of `cluster`: `local:N` for N processes on this computer, or a scheduler's address.

    The processes of `local:N` live as long as the block; they listen on the loopback interface only.
    InputError for a text that is neither, without the extra `cluster`, and where nobody answers.
    """
    local = re.fullmatch(r"local:([1-9]\d{0,3})", cluster)
    if not local and not re.fullmatch(r"(tcp|tls|ucx|ws|wss)://\S+", cluster):
        raise InputError(f"'{cluster}' is no cluster; expected tcp://host:port, or local:N for N processes here")
    client = _local_client(int(local[1])) if local else _in_time(cluster)
    try:
        yield client
    finally:
        # Whatever goes wrong at the end is no news: what is finished is kept, and the answer is out.
        with contextlib.suppress(Exception):
            client.close(timeout=CLOSE_S)
        if local:
            with contextlib.suppress(Exception):
                client.cluster.close(timeout=CLOSE_S)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError("a cluster needs the extra 'cluster'; from a checkout: pip install '.[cluster]'") from error
    # What it says of lost workers is dealt with here, and ends in one sentence or in nothing.
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return distributed


def _local_client(processes: int) -> Any:
    distributed = _distributed()
    import dask

    # Nobody looks into it: no pages, no profile, every port on loopback. And Dask's own MALLOC_TRIM_THRESHOLD_ is left
    # out: it gives each freed array back to the system, which made a chunk take twice its time.
    chosen: dict[str, object] = {
        "distributed.scheduler.allowed-failures": RETRIES,
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
        "distributed.worker.profile.enabled": False,
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(_ONE_THREAD, 1),
    }
    with dask.config.set(chosen), _deaf_to_ctrl_c():
        try:
            made = distributed.LocalCluster(
                n_workers=processes,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            )
        except Exception as error:  # whatever a process died of at its start, Dask's configuration with it
            problem = f"its processes die at their start: {one_line(str(error), 300) or type(error).__name__}"
            raise InputError(problem, file=f"local:{processes}") from error
    client = distributed.Client(made)
    client.cluster = made
    try:
        client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
    except TimeoutError as error:
        made.close(timeout=CLOSE_S)
        raise InputError(f"no process came up in {WAIT_FOR_WORKERS_S:g} s", file=f"local:{processes}") from error
    return client


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Processes that are started meanwhile leave Ctrl-C to this one, which ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _in_time(address: str) -> Any:
    """A client of the scheduler at an address; InputError when what is there says nothing, or nothing that it should.

    In a thread: Dask itself waits for as long as a peer that accepts and then says nothing pleases.
    """
    _check_speech(address)
    answer: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def ask() -> None:
        try:
            answer.put(_client(address, lambda: answer.put(_CONNECTED)))
        except BaseException as error:
            answer.put(error)

    threading.Thread(target=ask, daemon=True).start()
    try:
        client = answer.get(timeout=CONNECT_S + 2.0)
        if client == _CONNECTED:
            client = answer.get(timeout=WAIT_FOR_WORKERS_S + CLOSE_S + 2.0)
    except queue.Empty:
        raise InputError(f"nobody there speaks as a Dask scheduler does, for {CONNECT_S:g} s", file=address) from None
    if isinstance(client, InputError):
        raise client
    if isinstance(client, MemoryError):  # it takes the first bytes for the length of what follows
        raise InputError("what answers there is no Dask scheduler", file=address) from client
    if isinstance(client, BaseException):
        first = one_line(str(client), 300) or type(client).__name__
        raise InputError(f"no Dask scheduler answers there: {first}", file=address) from client
    return client


def _check_speech(address: str) -> None:
    """InputError where Dask here cannot speak as the address asks, before anything is sent."""
    distributed = _distributed()
    from distributed.comm.registry import get_backend

    scheme = address.partition("://")[0]
    if scheme in ("tls", "wss") and not distributed.Security().get_connection_args("client").get("ssl_context"):
        problem = "needs certificates: name them in Dask's configuration, under distributed.comm.tls"
        raise InputError(problem, file=address)
    try:
        get_backend(scheme).get_connector()
    except (ImportError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"Dask cannot speak {scheme} here; expected tcp://", file=address) from error


def _client(address: str, connected: Callable[[], None]) -> Any:
    distributed = _distributed()
    client = distributed.Client(address, timeout=CONNECT_S)
    connected()
    try:
        client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
    except TimeoutError as error:
        client.close(timeout=CLOSE_S)
        problem = f"no worker came in {WAIT_FOR_WORKERS_S:g} s; start one with: dask worker {address}"
        raise InputError(problem, file=address) from error
    return client


def _while_it_lives(chunks: Iterator[tuple[int, Chunk]], cluster: str) -> Iterator[tuple[int, Chunk]]:
    try:
        yield from chunks
    except (CancelledError, OSError) as error:
        raise InputError("the cluster is gone; what is done is kept", file=cluster) from error


def _chunks(client: Any, cluster: str, study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    """The chunks as they come. As many are handed out as there are hands: the memory stays small everywhere."""
    from distributed import KilledWorker

    # With each task, since what is kept on one worker dies with it; some kilobytes.
    effects = files_behind(study.machine.effects, "hoist")
    ask = (pickle.dumps(study), study.fingerprint, versions(), effects)
    waiting = iter(numbers)
    of: dict[Any, int] = {}
    lost: list[int] = []

    def hand_out(how_many: int) -> None:
        for _, number in zip(range(how_many), waiting, strict=False):
            data, fingerprint, wanted, effects = ask
            future = client.submit(
                run_remote_chunk, data, number, fingerprint, wanted, effects, retries=RETRIES, pure=False,
                key=f"{study.scenario.name}-{fingerprint}-{number:06d}",
            )  # fmt: skip
            of[future] = number

    hand_out(AHEAD * _threads(client))
    while of:
        future = _next_done(client, cluster, of)
        number = of.pop(future)
        try:
            chunk = future.result()
        except KilledWorker:
            lost.append(number)
        else:
            if isinstance(chunk, OtherProgram):
                raise InputError(f"worker on {chunk.where} has {chunk.what}; the numbers would differ", file=cluster)
            yield number, chunk
        future.release()
        # A cluster may grow and shrink while it works.
        hand_out(max(1, AHEAD * _threads(client) - len(of)))
    if lost:
        raise InputError(
            f"chunks {', '.join(map(str, sorted(lost)))} took their workers down {RETRIES} times; out of memory there? "
            "All others are done and kept; the same command tries these again",
            file=cluster,
        )


def _next_done(client: Any, cluster: str, futures: Collection[Any]) -> Any:
    """One that is done. InputError when there has been no worker for too long: nobody would do the rest."""
    from distributed import wait

    alone_since: float | None = None
    while True:
        try:
            return next(iter(wait(list(futures), timeout=LOOK_S, return_when="FIRST_COMPLETED").done))
        except TimeoutError:
            now = time.monotonic()
            alone_since = None if client.nthreads() else alone_since or now
            if alone_since is not None and now - alone_since >= WITHOUT_WORKERS_S:
                problem = (
                    f"has had no worker for {WITHOUT_WORKERS_S:g} s; what is done is kept, the same command goes on"
                )
                raise InputError(problem, file=cluster) from None


def _threads(client: Any) -> int:
    return max(1, sum(client.nthreads().values()))
