"""What made a result: versions, hashes, platform, counts; written last, it says that the result is whole.
The results folder of a study: where it goes, whether it is there already, what it holds.

results/<study>/
  index.parquet         one row a run
  runs/<run_id>/signals.parquet
  scenario.yaml, machine.yaml   as run, complete; beside them the users' files of effects that they need
  manifest.json         what made it; the folder gets its name after that

A finished result, read back whole from its folder.
One writer at a time: a lock file that the operating system releases when its holder dies.
An unfinished result on disk: chunks of runs kept one by one, then made whole under the final name.

.<name>.<fingerprint>.part/     beside the folder that it becomes
  lock                          held by the process that writes
  chunks/000012.parquet         the rows of a finished chunk; that it is there says that its runs are done
  runs/<run_id>/signals.parquet
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.core.whole_folder import check_free, is_free, what_is_in, write_json, write_whole
from workbench.core.yaml_strict import dumps, load, validate
from workbench.effects.registry import files_behind
from workbench.machines import LOOPED, load_machine, looped, of_kind, save_machine
from workbench.study import rows as tables
from workbench.study.load import Study
from workbench.study.run import StudyResult, run_specs
from workbench.study.scenario import Scenario

_LIBRARIES = ("numpy", "llvmlite", "scipy", "ruckig", "pyarrow", "plotly")


def manifest(study: Study, rows: Sequence[tables.Row], folder: Path) -> dict[str, Any]:
    """The manifest of a study's finished result in `folder`; the commit where the program is a checkout."""
    failed = sum(not row.ok for row in rows)
    return {
        "format": 1,
        "study": study.scenario.name,
        "fingerprint": study.fingerprint,
        "scenario_hash": study.scenario_hash,
        "machine_hash": study.machine_hash,
        "machine": study.machine.name,
        "effects": study.effects_digests,
        "seed": getattr(study.scenario, "seed", None),
        "runs": {"all": len(rows), "ok": len(rows) - failed, "failed": failed},
        "versions": {"workbench": __version__, "python": platform.python_version()} | library_versions(),
        "files": tables.digests(folder),
        "platform": f"{platform.system()} {platform.machine()}",
        "commit": _commit(Path(__file__).resolve().parents[2]),
    }


def library_versions() -> dict[str, str]:
    """The installed versions of the libraries that numbers and files come from."""
    from importlib.metadata import version

    return {name: version(name) for name in _LIBRARIES}


def _commit(checkout: Path) -> str | None:
    """The commit that is checked out; None where the program is installed, or git is not."""
    if not (checkout / ".git").exists():
        return None
    try:
        words = ["git", "-C", str(checkout), "rev-parse", "HEAD"]
        return subprocess.run(words, capture_output=True, text=True, timeout=5.0).stdout.strip() or None
    except (OSError, subprocess.SubprocessError):
        return None


DEFAULT_FOLDER = Path("results")
SIGNALS = "signals.parquet"
MOST_SAMPLES = 40_000_000  # an hour at 0.1 ms


@dataclass(frozen=True)
class ResultFolder:
    """Where a study's results go, and where what is unfinished is kept.

    finished: they are there already. note: why not under the usual name.
    """

    folder: Path
    part: Path
    finished: bool
    note: str = ""


def place_for(study: Study, out: Path | None = None) -> ResultFolder:
    """Where this study's results belong.

    out: the wanted folder; InputError where it is a file or holds something else than this very study's
    finished result. Without it results/<name>, or the first of results/<name>-2, -3, … that is free or
    holds this very study.
    """
    if out is not None:
        finished = holds(out, study)
        if not finished:
            _check_free(out)
        return ResultFolder(out, _part(out, out.resolve().name, study), finished)
    first = DEFAULT_FOLDER / study.scenario.name
    folder, number = first, 1
    while not is_free(folder) and not holds(folder, study):
        number += 1
        folder = first.with_name(f"{first.name}-{number}")
    note = "" if number == 1 else f"{first} {_what_is_in(first)}, so this one is in {folder}."
    return ResultFolder(folder, _part(folder, first.name, study), holds(folder, study), note)


def holds(folder: Path, study: Study) -> bool:
    """Whether the finished result of this very study is there."""
    said = tables.read_manifest(folder)
    return said is not None and said.get("fingerprint") == study.fingerprint and (folder / tables.INDEX).is_file()


def _part(folder: Path, name: str, study: Study) -> Path:
    """Hidden beside the folder, under a name that only this very study has: what is found there belongs to it."""
    return folder.resolve().parent / f".{name}.{study.fingerprint}.part"


def _check_free(out: Path) -> None:
    if out.resolve() == Path.cwd():  # the result takes this name, and whoever stands in it would see the old one
        raise InputError("is the current folder; name one to be made", file=out)
    if (said := _what_is_in(out)).startswith("holds"):
        raise InputError(f"{said}; nothing is overwritten, choose another folder", file=out)
    check_free(out)


def _what_is_in(folder: Path) -> str:
    said = tables.read_manifest(folder)
    if said is None:
        return what_is_in(folder)
    return f"holds another result ('{said.get('study')}', of another scenario, machine or program version)"


class SavedRuns(Mapping[str, Run]):
    """The signals of a result by run_id, read when they are asked for; runs without signals are not in it."""

    def __init__(self, folder: Path, rows: Sequence[tables.Row]) -> None:
        self._folder = folder / "runs"
        self._rows = {row.run_id: row for row in rows if (self._folder / row.run_id / SIGNALS).is_file()}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __getitem__(self, run_id: str) -> Run:
        path = self._folder / self._rows[run_id].run_id / SIGNALS
        with tables.parquet_of(path, "is not readable, the result is damaged") as file:
            if file.metadata.num_rows > MOST_SAMPLES:
                raise InputError("holds more samples than a run has: the result is damaged", file=path)
            columns = tables.columns_of(file.read(use_threads=False))
            sizes = {len(column) for column in columns.values()}
            if "time_s" not in columns or len(sizes) != 1 or sizes == {0}:
                raise InputError("holds no signals of a run: the result is damaged", file=path)
        start = float(columns["position_carriage_m"][0]) if "position_carriage_m" in columns else 0.0
        return Run(run_id, columns.pop("time_s"), columns, self._rows[run_id].payload_kg, start)


def read_finished(folder: Path) -> StudyResult:
    """The result in `folder`. InputError where it is none, is not whole, or is damaged."""
    tables.check_folder(folder)
    manifest = tables.read_manifest(folder)
    if manifest is None or folder.name.endswith(".part"):
        if (folder / "chunks").is_dir() or folder.name.endswith(".part"):
            raise InputError("is not finished; call `workbench study` for its scenario again, it goes on", file=folder)
        raise InputError(f"is no finished result of a study: it has no readable {tables.MANIFEST}", file=folder)
    for name in ("scenario.yaml", "machine.yaml"):
        tables.check_whole(folder, name)
    rows = tables.read_rows(folder)
    expected = (manifest.get("runs") or {}).get("all")
    if not rows or expected not in (None, len(rows)):
        raise InputError(f"holds {len(rows)} runs, its {tables.MANIFEST} says {expected}: the result is damaged",
                         file=folder / tables.INDEX)  # fmt: skip
    read = load_machine(folder / "machine.yaml")
    machine = looped(read)
    if machine is None:
        raise InputError(f"is {of_kind(read)}; a study's is of {LOOPED}", file=folder / "machine.yaml")
    study = Study(validate(Scenario, load(folder / "scenario.yaml")), machine)
    return StudyResult(study, tuple(rows), SavedRuns(folder, rows), folder, manifest)


LOCK = "lock"
PATIENCE_S = 0.2  # a holder that has just finished removes the file: then the lock is tried again


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder` if need be and hold it for this process; the lock file is removed when the block ends.

    The file names its holder. A process that was killed leaves the file but not the lock, and the next
    holder overwrites the name. InputError while another process holds the folder.
    """
    from filelock import FileLock, Timeout

    path = folder / LOCK
    lock, held = FileLock(path, timeout=PATIENCE_S), False
    while not held:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire()
            held = True
        except FileNotFoundError:
            continue  # the holder of the folder has just given it its final name
        except Timeout as error:
            holder = ""
            with contextlib.suppress(OSError):
                holder = path.read_text(encoding="utf-8", errors="replace")
            said = f"is being written by {holder or 'another process'}; let it finish, or stop it and call again"
            raise InputError(said, file=folder) from error
    try:
        path.write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
        yield
    finally:
        # Removed while it is held, so that nobody waits for a file that is no longer there. The
        # folder may have got its final name meanwhile; then the file went with it and is gone already.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


@dataclass(frozen=True)
class Chunk:
    """What a chunk of runs came to, as the bytes of its files: the same wherever it was computed."""

    rows: int
    failed: int
    index: bytes
    signals: Mapping[str, bytes] = field(default_factory=dict)


class Part:
    """The unfinished result in `folder`, of a batch of `sizes[i]` runs in chunk i. Use `open_part`."""

    def __init__(self, folder: Path, sizes: list[int]) -> None:
        self.folder = folder
        self.sizes = sizes

    @property
    def whole(self) -> bool:
        """Whether all is written and only the final name is missing."""
        return (self.folder / tables.MANIFEST).is_file()

    def done(self) -> dict[int, int]:
        """The chunks that are kept, and how many runs of each have failed; what cannot be read is removed."""
        kept = {}
        for number, size in enumerate(self.sizes):
            file = self._file(number)
            if not file.is_file():
                continue
            try:
                table = tables.read_table(file)
            except InputError:
                table = None
            if table is None or table.num_rows != size:
                file.unlink()  # a disk's fault: the chunk is run again
            else:
                kept[number] = table["status"].to_pylist().count("failed")
        return kept

    def commit(self, number: int, chunk: Chunk) -> None:
        """Keep a chunk: signals first, then, at one stroke, the rows that say that they are there."""
        for run_id, data in chunk.signals.items():
            place = self.folder / "runs" / run_id
            place.mkdir(parents=True, exist_ok=True)
            (place / SIGNALS).write_bytes(data)
        file = self._file(number)
        file.parent.mkdir(exist_ok=True)
        temporary = file.with_suffix(".tmp")
        write_whole(temporary, chunk.index)
        temporary.rename(file)

    def assemble(self) -> Any:
        """Write the index from all chunks; returns it."""
        table = tables.joined([tables.read_table(self._file(number)) for number in range(len(self.sizes))])
        write_whole(self.folder / tables.INDEX, tables.parquet_bytes(table))
        return table

    def add(self, name: str, text: str | bytes) -> None:
        """One more file of the result."""
        write_whole(self.folder / name, text.encode() if isinstance(text, str) else text)

    def mark(self, manifest: Mapping[str, Any]) -> None:
        """Say that the result is whole."""
        temporary = self.folder / f"{tables.MANIFEST}.tmp"
        write_json(temporary, manifest)
        temporary.rename(self.folder / tables.MANIFEST)

    def finish(self, target: Path) -> None:
        """Give a whole result its name. `target` is free."""
        shutil.rmtree(self.folder / "chunks", ignore_errors=True)
        (self.folder / LOCK).unlink(missing_ok=True)
        try:
            self.folder.rename(target)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
            said = f"is taken by now; this result is whole in {self.folder}: ask for another folder, or move it"
            raise InputError(said, file=target) from error

    def _file(self, number: int) -> Path:
        return self.folder / "chunks" / f"{number:06d}.parquet"


@contextmanager
def open_part(folder: Path, sizes: list[int], target: Path) -> Iterator[Part]:
    """The unfinished result in `folder`, new or of an earlier call, held for this process; `target` to be.

    InputError where it cannot be written, and while another process writes it.
    """
    try:
        with locked(folder):
            yield Part(folder, sizes)
    except (FileExistsError, NotADirectoryError) as error:
        said = "no results can be written there: a file stands where a folder must be"
        raise InputError(said, file=target) from error
    except OSError as error:
        raise InputError(f"no results written: {error.strerror or error}", file=target) from error
    finally:
        # Nothing done, nothing left behind.
        with contextlib.suppress(OSError):
            folder.rmdir()


# Eight and two groups of SIMD lanes: some tenths of a second of work, some tens of megabytes.
CHUNK = 128
CHUNK_WITH_SIGNALS = 32

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
            table = tables.arrow_table({name: tables.numbers(values) for name, values in columns.items()})
            signals[row.run_id] = tables.parquet_bytes(table, compression="zstd", use_dictionary=False)
    return Chunk(len(rows), sum(not row.ok for row in rows), tables.parquet_bytes(tables.index_table(rows)), signals)


def on_this_computer(study: Study, chunks: Sequence[int], cores: int | None = None) -> Iterator[tuple[int, Chunk]]:
    """Run chunks on all cores: as many chunks at a time as there are cores; with fewer chunks, more threads each.

    No more chunks are begun than are handed over, which bounds the memory.
    """
    cores = cores or os.cpu_count() or 1
    at_once, waiting = max(1, min(cores, len(chunks))), iter(chunks)
    with ThreadPoolExecutor(at_once) as pool:

        def begin(number: int) -> Future[Chunk]:
            return pool.submit(run_chunk, study, number, cores // at_once)

        running = {begin(number): number for number in islice(waiting, at_once)}
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(future)
                running |= {begin(another): another for another in islice(waiting, 1)}
                yield number, future.result()


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
    finished = part.done()
    runs_kept = sum(part.sizes[number] for number in finished)

    def say() -> None:
        done = sum(part.sizes[number] for number in finished)
        tell(Progress(study.scenario.name, sum(part.sizes), done, runs_kept, sum(finished.values())))

    say()
    try:
        for number, chunk in spread(study, [n for n in range(len(part.sizes)) if n not in finished]):
            part.commit(number, chunk)
            finished[number] = chunk.failed
            say()
    except KeyboardInterrupt:
        finished = part.done()  # it may have come between the keeping of a chunk and its counting
        say()
        raise


def _make_whole(study: Study, part: Part, extras: Mapping[str, Extra]) -> None:
    rows = tables.rows_of(part.assemble())
    save_machine(study.machine, part.folder / "machine.yaml")
    scenario = study.scenario.model_dump(mode="json", exclude={"extends"}) | {"machine": "machine.yaml"}
    scenario["moves"] = [{k: v for k, v in move.items() if v is not None} for move in scenario["moves"]]
    part.add("scenario.yaml", dumps(scenario))
    for number, file in enumerate(files_behind(study.machine.effects, "hoist")):
        name = Path(file.path).name
        part.add(f"{number}_{name}" if (part.folder / name).exists() else name, file.text)
    result = StudyResult(study, rows, SavedRuns(part.folder, rows), part.folder)
    for name, write in extras.items():
        write(result, part.folder / name)
    part.mark(manifest(study, rows, part.folder))
