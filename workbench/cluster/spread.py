"""Chunks of a study as Dask tasks: some at a time, repeated where a worker dies."""

from __future__ import annotations

import logging
import pickle
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

from workbench.cluster.task import OtherProgram, run_remote_chunk, versions
from workbench.effects.registry import files_behind
from workbench.errors import InputError
from workbench.study.execute.batch import Spread
from workbench.study.execute.store import Chunk
from workbench.study.scenario.load import Study

RETRIES = 3
# Tasks handed out for each worker thread: one in work, one waiting, so that nobody idles.
AHEAD = 2
CONNECT_S = 10
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
WAIT_FOR_WORKERS_S = 60


@contextmanager
def spread_on(cluster: str) -> Iterator[Spread]:
    """A way to run chunks on `cluster`: `local:N` for N processes on this computer, or a scheduler's address.

    The processes of `local:N` live as long as the block; they listen on the loopback interface only.
    InputError for a text that is neither, without the extra `cluster`, and where nobody answers.
    """
    local = re.fullmatch(r"local:([1-9]\d{0,3})", cluster)
    if not local and not re.fullmatch(r"(tcp|tls|ucx|ws|wss)://\S+", cluster):
        raise InputError(f"'{cluster}' is no cluster; expected tcp://host:port, or local:N for N processes here")
    client = _local_client(int(local[1])) if local else _client(cluster)
    try:
        yield lambda study, numbers: _while_it_lives(_chunks(client, cluster, study, numbers), cluster)
    finally:
        client.close()
        if local:
            client.cluster.close()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError("a cluster needs the extra 'cluster'; from a checkout: pip install '.[cluster]'") from error
    # What it says of lost workers is dealt with here, and ends in one sentence or in nothing.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
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
    with dask.config.set(chosen):
        made = distributed.LocalCluster(
            n_workers=processes,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        )
    client = distributed.Client(made)
    client.cluster = made
    return client


def _client(address: str) -> Any:
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
        client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
    except TimeoutError as error:
        said = f"no worker came in {WAIT_FOR_WORKERS_S} s; start one with: dask worker {address}"
        raise InputError(said, file=address) from error
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers there: {error}", file=address) from error
    return client


def _while_it_lives(chunks: Iterator[tuple[int, Chunk]], cluster: str) -> Iterator[tuple[int, Chunk]]:
    try:
        yield from chunks
    except (CancelledError, OSError) as error:
        raise InputError("the cluster is gone; what is done is kept", file=cluster) from error


def _chunks(client: Any, cluster: str, study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    """The chunks as they come. As many are handed out as there are hands: the memory stays small everywhere."""
    from distributed import KilledWorker, as_completed

    # With each task, since what is kept on one worker dies with it; some kilobytes.
    effects = files_behind(study.machine.effects, "hoist")
    ask = (pickle.dumps(study), study.fingerprint, versions(), effects)
    waiting = iter(numbers)
    of: dict[Any, int] = {}
    lost: list[int] = []
    coming = as_completed([])

    def hand_out(how_many: int) -> None:
        for _, number in zip(range(how_many), waiting, strict=False):
            data, fingerprint, wanted, effects = ask
            future = client.submit(
                run_remote_chunk, data, number, fingerprint, wanted, effects, retries=RETRIES, pure=False,
                key=f"{study.scenario.name}-{fingerprint}-{number:06d}",
            )  # fmt: skip
            of[future.key] = number
            coming.add(future)

    hand_out(AHEAD * _threads(client))
    for future in coming:
        number = of.pop(future.key)
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


def _threads(client: Any) -> int:
    return max(1, sum(client.nthreads().values()))
