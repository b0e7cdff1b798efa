"""Work on a Dask cluster: some tasks at a time, repeated where a worker dies; chunks of a study as such tasks."""

from __future__ import annotations

import contextlib
import gc
import logging
import pickle
import platform
import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import islice
from typing import Any, TypeVar

from workbench.core.errors import InputError, one_line
from workbench.effects.loading import know
from workbench.effects.registry import UserFile, files_behind
from workbench.study.load import Study
from workbench.study.store import Chunk, Spread, library_versions, run_chunk

RETRIES = 3
AHEAD = 2  # tasks handed out for each worker thread: one in work, one waiting, so that nobody idles
CONNECT_S = 10.0
WITHOUT_WORKERS_S = 60.0  # after which a cluster without a worker is given up
LOOK_S = 1.0  # between two looks at who is left
SILENT_S = 30.0  # without a heartbeat, of a process here: others take its work
CLOSE_S = 5.0
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_knowing = threading.Lock()
Item = TypeVar("Item")


@contextmanager
def spread_on(cluster: str) -> Iterator[Spread]:
    """A way to run chunks on `cluster`: `local:N` for N processes on this computer, or a scheduler's address.

    The processes of `local:N` live as long as the block; they listen on the loopback interface only.
    InputError for a text that is neither, without the extra `cluster`, and where nobody answers.
    """
    with client_on(cluster) as client:

        def spread(study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
            # With each task, since what is kept on one worker dies with it; some kilobytes.
            effects = files_behind(study.machine.effects, "hoist")
            pickled, asked = pickle.dumps(study), (study.fingerprint, versions(), effects)
            tasks = each_on(client, cluster, numbers, lambda number: (run_remote_chunk, pickled, number, *asked))
            for number, chunk in tasks:
                if isinstance(chunk, OtherProgram):
                    said = f"worker on {chunk.where} has {chunk.what}; the numbers would differ"
                    raise InputError(said, file=cluster)
                yield number, chunk

        yield spread


def each_on(
    client: Any, cluster: str, items: Iterable[Item], task: Callable[[Item], tuple[Any, ...]]
) -> Iterator[tuple[Item, Any]]:
    """Each item with its result, as they come; task: of an item, the function that a worker calls and its arguments.

    As many are handed out as there are hands: the memory stays small everywhere. Dask gives the work of a worker that
    dies, or is silent for the scheduler's `worker-ttl`, to others. InputError where the cluster is gone, has no worker
    for a minute, or an item takes its workers down; then all others are done first.
    """
    distributed = _distributed()
    waiting, lost, alone_since = iter(items), list[Item](), None
    of: dict[Any, Item] = {}
    try:
        while True:
            hands = sum(client.nthreads().values())
            for item in islice(waiting, max(0, AHEAD * max(1, hands) - len(of))):
                of[client.submit(*task(item), retries=RETRIES, pure=False)] = item
            if not of:
                break
            try:
                done = distributed.wait(list(of), LOOK_S, "FIRST_COMPLETED").done
            except TimeoutError:
                done = ()
            alone_since = None if hands or done else alone_since or time.monotonic()
            if alone_since is not None and time.monotonic() - alone_since >= WITHOUT_WORKERS_S:
                said = f"has had no worker for {WITHOUT_WORKERS_S:g} s; what is done is kept, the same command goes on"
                raise InputError(said, file=cluster)
            for future in done:
                item = of.pop(future)
                try:
                    result = future.result(timeout=WITHOUT_WORKERS_S)
                except distributed.KilledWorker:
                    lost.append(item)
                except TimeoutError:  # it has died with its worker, and is computed anew where another one comes
                    of[future] = item
                    continue
                else:
                    yield item, result
                future.release()
    except (CancelledError, OSError) as error:
        raise InputError("the cluster is gone; what is done is kept", file=cluster) from error
    if lost:
        raise InputError(
            f"{', '.join(map(str, lost))} took the workers down {RETRIES} times; out of memory there? All others are "
            "done and kept; the same command tries these again",
            file=cluster,
        )


@contextmanager
def client_on(cluster: str) -> Iterator[Any]:
    """A client of `cluster`, closed with the block; InputError as `spread_on`."""
    local = re.fullmatch(r"local:([1-9]\d{0,3})", cluster)
    if not local and not re.fullmatch(r"(tcp|tls|ucx|ws|wss)://\S+", cluster):
        raise InputError(f"'{cluster}' is no cluster; expected tcp://host:port, or local:N for N processes here")
    made = _local_cluster(int(local[1])) if local else None
    client = _distributed().Client(made) if made is not None else _connected(cluster)
    try:
        try:
            client.wait_for_workers(1, timeout=WITHOUT_WORKERS_S)
        except TimeoutError as error:
            start = "" if local else f"; start one with: dask worker {cluster}"
            raise InputError(f"no worker came in {WITHOUT_WORKERS_S:g} s{start}", file=cluster) from error
        yield client
    finally:
        # Whatever goes wrong at the end is no news: what is finished is kept, and the answer is out.
        with contextlib.suppress(Exception):
            client.close(timeout=CLOSE_S)
        if made is not None:
            with contextlib.suppress(Exception):
                made.close(timeout=CLOSE_S)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError("a cluster needs the extra 'cluster'; from a checkout: pip install '.[cluster]'") from error
    # A client that was given up takes the lock under which loops start when it is collected: not while one starts.
    gc.collect()
    # What it says of lost workers is dealt with here, and ends in one sentence or in nothing.
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return distributed


def _local_cluster(processes: int) -> Any:
    distributed = _distributed()
    import dask

    # Nobody looks into it: no pages, no profile, every port on loopback. And Dask's own MALLOC_TRIM_THRESHOLD_ is left
    # out: it gives each freed array back to the system, which made a chunk take twice its time.
    chosen: dict[str, object] = {
        "distributed.scheduler.allowed-failures": RETRIES,
        "distributed.scheduler.worker-ttl": f"{SILENT_S:g}s",
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
        "distributed.worker.profile.enabled": False,
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(_ONE_THREAD, 1),
    }
    with dask.config.set(chosen), _deaf_to_ctrl_c():
        try:
            return distributed.LocalCluster(
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


def _connected(address: str) -> Any:
    """A client of the scheduler at an address; InputError when what is there says nothing, or nothing that it should.

    In a thread: Dask itself waits for as long as a peer that accepts and then says nothing pleases.
    """
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
    answer: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def ask() -> None:
        try:
            try:
                client = distributed.Client(address, timeout=CONNECT_S)
            except AssertionError:  # its own loop has not started within ten seconds; a second one does
                client = distributed.Client(address, timeout=CONNECT_S)
            answer.put(client)
        except BaseException as error:
            answer.put(error)

    threading.Thread(target=ask, daemon=True).start()
    try:
        client = answer.get(timeout=CONNECT_S + 2.0)
    except queue.Empty:
        raise InputError(f"nobody there speaks as a Dask scheduler does, for {CONNECT_S:g} s", file=address) from None
    if isinstance(client, MemoryError):  # it takes the first bytes for the length of what follows
        raise InputError("what answers there is no Dask scheduler", file=address) from client
    if isinstance(client, BaseException):
        first = one_line(str(client), 300) or type(client).__name__
        raise InputError(f"no Dask scheduler answers there: {first}", file=address) from client
    return client


@dataclass(frozen=True)
class OtherProgram:
    """A worker that would give other numbers: what is different there."""

    where: str
    what: str


@cache
def versions() -> dict[str, str]:
    """What has to be the same on every worker, besides workbench itself."""
    return {"python": platform.python_version()} | library_versions()


def run_remote_chunk(
    study: bytes, number: int, fingerprint: str, wanted: dict[str, str], effects: tuple[UserFile, ...] = ()
) -> Chunk | OtherProgram:
    """A chunk of a pickled study; one thread, since a worker has one.

    fingerprint: the study's where it was asked for. A worker with another program computes another one.
    effects: the users' files that it needs, as they were read there.
    """
    here = versions()
    if different := [f"{name} {here.get(name)}, here {version}" for name, version in wanted.items()
                     if here.get(name) != version]:  # fmt: skip
        return OtherProgram(platform.node(), "; ".join(different))
    # Effects are known by name in a whole process: studies with other files of one name take turns.
    with _knowing if effects else nullcontext():
        for file in effects:
            know(file)
        try:
            loaded = _loaded(study, tuple(file.digest for file in effects))
            same = loaded.fingerprint == fingerprint
        except InputError as error:  # an effect of an entry point that is not installed there
            return OtherProgram(platform.node(), f"not the same effects ({error})")
        if not same:
            return OtherProgram(platform.node(), "another version of workbench")
        return run_chunk(loaded, number, threads=1)


@lru_cache(maxsize=2)
def _loaded(study: bytes, effects: tuple[str, ...]) -> Study:
    loaded = pickle.loads(study)
    assert isinstance(loaded, Study)
    # What was computed where it was asked for says nothing about this worker.
    loaded.__dict__.pop("fingerprint", None)
    return loaded
