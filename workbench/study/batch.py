"""A study run in chunks: each kept as soon as it is done, resumed where it stopped, bounded in memory.

A chunk is a fixed stretch of the study's runs, whatever runs it, so every way of running gives the same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from workbench.core.yaml_strict import dumps
from workbench.effects.registry import files_behind
from workbench.machines import save_machine
from workbench.study.load import Study
from workbench.study.rows import index_table, rows_of
from workbench.study.run import StudyResult, run_specs
from workbench.study.store import Chunk, Part, ResultFolder, SavedRuns, arrow, holds, manifest, open_part

# Eight and two groups of SIMD lanes: some tenths of a second of work, some tens of megabytes.
CHUNK = 128
CHUNK_WITH_SIGNALS = 32

Work = Callable[[int], Chunk]
# Runs the chunks of these numbers, gives them back in any order.
Spread = Callable[[Study, Sequence[int]], Iterator[tuple[int, Chunk]]]


@dataclass(frozen=True)
class Progress:
    """How far a study is: runs in all, done (kept ones of an earlier call included), kept, failed."""

    name: str
    runs: int
    done: int
    kept: int
    failed: int


Tell = Callable[[Progress], None]
Extra = Callable[[StudyResult, Path], None]


def chunk_size(study: Study) -> int:
    return CHUNK if study.scenario.outputs.signals == "none" else CHUNK_WITH_SIGNALS


def chunk_sizes(study: Study) -> list[int]:
    """The number of runs in each chunk of a study."""
    runs, size = len(study.specs), chunk_size(study)
    return [min(size, runs - start) for start in range(0, runs, size)]


def run_chunk(study: Study, number: int, threads: int = 1) -> Chunk:
    """Simulate a chunk of a study; a run that fails is a row with its reason."""
    size = chunk_size(study)
    specs = study.specs[number * size : (number + 1) * size]
    done = run_specs(specs, threads=threads)
    rows = [row for row, _ in done]
    signals = {}
    for row, run in done:
        if run is not None and len(run.time_s):
            columns = {"time_s": run.time_s} | dict(run.signals)
            table = arrow.table({name: arrow.numbers(values) for name, values in columns.items()})
            signals[row.run_id] = arrow.parquet_bytes(table, compression="zstd", use_dictionary=False)
    return Chunk(len(rows), sum(not row.ok for row in rows), arrow.parquet_bytes(index_table(rows)), signals)


def on_this_computer(study: Study, numbers: Sequence[int], cores: int | None = None) -> Iterator[tuple[int, Chunk]]:
    """Run chunks on all cores: as many chunks at a time as there are cores; with fewer chunks, more threads each."""
    cores = cores or os.cpu_count() or 1
    at_once = min(cores, len(numbers))
    if at_once <= 1:
        for number in numbers:
            yield number, run_chunk(study, number, threads=cores)
        return
    yield from _windowed(partial(run_chunk, study, threads=cores // at_once), numbers, at_once)


def _windowed(work: Work, numbers: Iterable[int], at_once: int) -> Iterator[tuple[int, Chunk]]:
    """At most `at_once` chunks begun and not handed over, which bounds the memory."""
    waiting = iter(numbers)
    running: dict[Future[Chunk], int] = {}
    pool = ThreadPoolExecutor(at_once, thread_name_prefix="chunk")
    try:
        while True:
            for number in waiting:
                running[pool.submit(work, number)] = number
                if len(running) >= at_once:
                    break
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_batch(
    study: Study,
    place: ResultFolder,
    *,
    spread: Spread = on_this_computer,
    tell: Tell = lambda progress: None,
    extras: Mapping[str, Extra] | None = None,
) -> None:
    """Run what an earlier call left over and make the result whole in `place`, which is free.

    Every finished chunk is kept, so a stop at any moment loses no more than the chunks in work.
    extras: name -> how to write one more file from the result. InputError where the place cannot be
    written, and while another process runs this very study.
    """
    with open_part(place.part, chunk_sizes(study), place.folder) as part:
        if holds(place.folder, study):  # another process has finished it since
            return
        if not part.whole:
            _run_the_rest(study, part, spread, tell)
            _make_whole(study, part, extras or {})
        part.finish(place.folder)


def _run_the_rest(study: Study, part: Part, spread: Spread, tell: Tell) -> None:
    kept = part.done()
    runs_kept = sum(part.sizes[number] for number in kept)

    def said() -> Progress:
        done = sum(part.sizes[number] for number in finished)
        return Progress(study.scenario.name, sum(part.sizes), done, runs_kept, sum(finished.values()))

    finished = dict(kept)
    tell(said())
    missing = [number for number in range(len(part.sizes)) if number not in kept]
    try:
        for number, chunk in spread(study, missing):
            part.commit(number, chunk)
            finished[number] = chunk.failed
            tell(said())
    except KeyboardInterrupt:
        finished = part.done()  # it may have come between the keeping of a chunk and its counting
        tell(said())
        raise


def _make_whole(study: Study, part: Part, extras: Mapping[str, Extra]) -> None:
    table = part.assemble()
    rows = rows_of(table)
    save_machine(study.machine, part.folder / "machine.yaml")
    part.add("scenario.yaml", dumps(_as_run(study)))
    for number, file in enumerate(files_behind(study.machine.effects, "hoist")):
        name = Path(file.path).name
        part.add(f"{number}_{name}" if (part.folder / name).exists() else name, file.text)
    result = StudyResult(study, rows, SavedRuns(part.folder, rows))
    for name, write in extras.items():
        write(result, part.folder / name)
    part.mark(manifest(study, rows, part.folder))


def _as_run(study: Study) -> dict[str, Any]:
    """The scenario, complete, beside the machine that it was run on."""
    scenario = study.scenario.model_dump(mode="json", exclude={"extends"}) | {"machine": "machine.yaml"}
    scenario["moves"] = [{k: v for k, v in move.items() if v is not None} for move in scenario["moves"]]
    return scenario
