"""What a worker does: one chunk of a study, on the same program as the one that asks.
Chunks of a study as Dask tasks: some at a time, repeated where a worker dies."""

from __future__ import annotations

import contextlib
import logging
import pickle
import platform
import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import count, islice
from typing import Any

from workbench.core.errors import InputError, one_line
from workbench.effects.loading import know
from workbench.effects.registry import UserFile, files_behind
from workbench.study.load import Study
from workbench.study.store import Chunk, Spread, library_versions, run_chunk

_knowing = threading.Lock()


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
    import pickle

    loaded = pickle.loads(study)
    assert isinstance(loaded, Study)
    # What was computed where it was asked for says nothing about this worker.
    loaded.__dict__.pop("fingerprint", None)
    return loaded


Say = Callable[[str], None]
RETRIES = 3
# Tasks handed out for each worker thread: one in work, one waiting, so that nobody idles.
AHEAD = 2
CONNECT_S = 10.0
WITHOUT_WORKERS_S = 60.0  # after which a cluster that has lost its last worker is given up
LOOK_S = 1.0  # between two looks at who is left
SILENT_S = 10.0  # without a heartbeat: it is said
GIVEN_UP_S = 30.0  # without a heartbeat: other workers take the work
FETCH_S = 60.0  # for the answer of a worker that is done
CLOSE_S = 5.0
_CONNECTED = "connected"
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
WAIT_FOR_WORKERS_S = 60.0


@contextmanager
def spread_on(cluster: str, say: Say = lambda text: None) -> Iterator[Spread]:
    """A way to run chunks on `cluster`: `local:N` for N processes on this computer, or a scheduler's address.

    The processes of `local:N` live as long as the block; they listen on the loopback interface only. say: gets a
    line when a worker falls silent, and when others take its work.
    InputError for a text that is neither, without the extra `cluster`, and where nobody answers.
    """
    with client_on(cluster) as client:
        yield lambda study, numbers: _while_it_lives(_chunks(client, cluster, study, numbers, say), cluster)


def each_on(
    client: Any, cluster: str, items: Sequence[str], task: Callable[[str], tuple[Any, ...]]
) -> Iterator[tuple[str, Any]]:
    """Each item with its result, as they come; task: of an item, the function that a worker calls and its arguments."""
    waiting, of = iter(items), dict[Any, str]()
    try:
        while True:
            for item in islice(waiting, max(0, AHEAD * max(1, sum(client.nthreads().values())) - len(of))):
                of[client.submit(*task(item), retries=RETRIES, pure=False)] = item
            if not of:
                return
            future = _next_done(of, (), client)
            if future is None:
                continue
            yield of.pop(future), future.result()
            future.release()
    except _distributed().KilledWorker as error:
        raise InputError(f"a task took its workers down {RETRIES} times; what is done is kept", file=cluster) from error
    except (CancelledError, OSError) as error:
        raise InputError("the cluster is gone; what is done is kept", file=cluster) from error


@contextmanager
def client_on(cluster: str) -> Iterator[Any]:
    """A client of `cluster`, closed with the block; InputError as `spread_on`."""
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


class _Workers:
    """The workers of a cluster, and for how long each has been silent by this computer's clock."""

    def __init__(self, client: Any, say: Say) -> None:
        self.client, self.say = client, say
        self.heard: dict[str, tuple[float, float]] = {}  # address -> its last heartbeat, when that was seen here
        self.told: set[str] = set()

    def silent(self) -> set[str]:
        """Those without a heartbeat for GIVEN_UP_S; of SILENT_S it is said, once."""
        now = time.monotonic()
        last = {address: worker["last_seen"] for address, worker in self.client.scheduler_info()["workers"].items()}
        self.heard = {
            address: (beat, now if self.heard.get(address, (None,))[0] != beat else self.heard[address][1])
            for address, beat in last.items()
        }
        quiet = {address: now - seen for address, (_, seen) in self.heard.items()}
        self.told &= {address for address, seconds in quiet.items() if seconds >= SILENT_S}
        for address, seconds in quiet.items():
            if seconds >= SILENT_S and address not in self.told:
                self.told.add(address)
                self.say(
                    f"worker {address} has been silent for {seconds:.0f} s; after {GIVEN_UP_S:g} s others take its work"
                )
        return {address for address, seconds in quiet.items() if seconds >= GIVEN_UP_S}

    def threads(self, silent: Collection[str] = ()) -> dict[str, int]:
        """Address -> threads of those that are not silent."""
        return {address: n for address, n in self.client.nthreads().items() if address not in silent}


def _chunks(client: Any, cluster: str, study: Study, numbers: Sequence[int], say: Say) -> Iterator[tuple[int, Chunk]]:
    """The chunks as they come. As many are handed out as there are hands: the memory stays small everywhere.

    A chunk whose worker is silent for GIVEN_UP_S is handed to another one too; the first answer counts, all are alike.
    """
    from distributed import KilledWorker

    # With each task, since what is kept on one worker dies with it; some kilobytes.
    effects = files_behind(study.machine.effects, "hoist")
    ask = (pickle.dumps(study), study.fingerprint, versions(), effects)
    waiting, tries = iter(numbers), count()
    of: dict[Any, int] = {}
    lost: list[int] = []
    workers, silent = _Workers(client, say), set[str]()

    def hand_out(numbers: Iterable[int]) -> None:
        only = {"workers": list(workers.threads(silent))} if silent else {}
        for number in numbers:
            future = client.submit(
                run_remote_chunk, *ask[:1], number, *ask[1:], retries=RETRIES, pure=False, **only,
                key=f"{study.scenario.name}-{study.fingerprint}-{number:06d}-{next(tries)}",
            )  # fmt: skip
            of[future] = number

    alone_since, looked = None, time.monotonic()
    hand_out(islice(waiting, AHEAD * max(1, sum(workers.threads().values()))))
    while of:
        future = _next_done(of, silent, client)
        now = time.monotonic()
        if future is None or now - looked >= LOOK_S:
            looked, silent = now, workers.silent()
            alone_since = None if workers.threads(silent) else alone_since or now
            if alone_since is not None and now - alone_since >= WITHOUT_WORKERS_S:
                problem = (
                    f"has had no worker for {WITHOUT_WORKERS_S:g} s; what is done is kept, the same command goes on"
                )
                raise InputError(problem, file=cluster)
            if silent and alone_since is None:
                stuck = _on(silent, of, client)
                elsewhere = {number for future, number in of.items() if future not in stuck}
                if again := sorted({of[future] for future in stuck} - elsewhere):
                    hand_out(again)
                    say(f"chunks {', '.join(map(str, again))} go to other workers")
        if future is None:
            continue
        number = of[future]
        try:
            chunk = future.result(timeout=FETCH_S)
        except TimeoutError:
            continue  # it lies on a worker that does not answer; the next look sees to that
        except KilledWorker:
            lost.append(number)
            chunk = None
        for other in [other for other, of_it in of.items() if of_it == number]:
            del of[other]
            other.release()
        if isinstance(chunk, OtherProgram):
            raise InputError(f"worker on {chunk.where} has {chunk.what}; the numbers would differ", file=cluster)
        if chunk is not None:
            yield number, chunk
        # A cluster may grow and shrink while it works.
        hand_out(islice(waiting, max(1, AHEAD * sum(workers.threads(silent).values()) - len(of))))
    if lost:
        raise InputError(
            f"chunks {', '.join(map(str, sorted(lost)))} took their workers down {RETRIES} times; out of memory there? "
            "All others are done and kept; the same command tries these again",
            file=cluster,
        )


def _next_done(of: Collection[Any], silent: Collection[str], client: Any) -> Any:
    """One that is done and can be had; None where there is none within LOOK_S."""
    from distributed import wait

    out_of_reach = _on(silent, of, client) if silent else set()
    try:
        return next(iter(wait([f for f in of if f not in out_of_reach], LOOK_S, "FIRST_COMPLETED").done))
    except (TimeoutError, ValueError):  # ValueError: nothing to wait for
        if len(out_of_reach) == len(of):
            time.sleep(LOOK_S)
        return None


def _on(silent: Collection[str], of: Collection[Any], client: Any) -> set[Any]:
    """Those that only silent workers have, in work or done."""
    keys = {key for address, own in client.processing().items() if address in silent for key in own}
    keys |= {key for key, holders in client.who_has(list(of)).items() if holders and set(holders) <= set(silent)}
    return {future for future in of if future.key in keys}
