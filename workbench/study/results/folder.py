"""The results folder of a study: where it goes, whether it is there already, what it holds.

results/<study>/
  index.parquet         one row a run
  runs/<run_id>/signals.parquet
  scenario.yaml, machine.yaml   as run, complete; beside them the users' files of effects that they need
  manifest.json         what made it; the folder gets its name after that
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from workbench.errors import InputError
from workbench.input_file import readable_file
from workbench.run import Run
from workbench.study.results import arrow
from workbench.study.results.index import INDEX
from workbench.study.results.manifest import read_manifest
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study
from workbench.whole_folder import is_free, what_is_in

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
    said = read_manifest(folder)
    return said is not None and said.get("fingerprint") == study.fingerprint and (folder / INDEX).is_file()


def _part(folder: Path, name: str, study: Study) -> Path:
    """Hidden beside the folder, under a name that only this very study has: what is found there belongs to it."""
    return folder.resolve().parent / f".{name}.{study.fingerprint}.part"


def _check_free(out: Path) -> None:
    if out.resolve() == Path.cwd():  # the result takes this name, and whoever stands in it would see the old one
        raise InputError("is the current folder; name one to be made", file=out)
    try:
        free = is_free(out)
    except OSError as error:
        raise InputError(f"no results can be written there: {error.strerror or error}", file=out) from error
    if not free:
        raise InputError(f"{_what_is_in(out)}; nothing is overwritten, choose another folder", file=out)


def _what_is_in(folder: Path) -> str:
    said = read_manifest(folder)
    if said is None:
        return what_is_in(folder)
    return f"holds another result ('{said.get('study')}', of another scenario, machine or program version)"


class SavedRuns(Mapping[str, Run]):
    """The signals of a result by run_id, read when they are asked for; runs without signals are not in it."""

    def __init__(self, folder: Path, rows: Sequence[Row]) -> None:
        self._folder = folder / "runs"
        self._rows = {row.run_id: row for row in rows if (self._folder / row.run_id / SIGNALS).is_file()}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __getitem__(self, run_id: str) -> Run:
        import pyarrow.parquet as pq

        path = self._folder / self._rows[run_id].run_id / SIGNALS
        try:
            with pq.ParquetFile(readable_file(path, "table")) as file:
                if file.metadata.num_rows > MOST_SAMPLES:
                    raise InputError("holds more samples than a run has: the result is damaged", file=path)
                columns = arrow.columns(file.read(use_threads=False))
            sizes = {len(column) for column in columns.values()}
            if "time_s" not in columns or len(sizes) != 1 or sizes == {0}:
                raise InputError("holds no signals of a run: the result is damaged", file=path)
        except InputError:
            raise
        except Exception as error:  # whatever the parser makes of damaged bytes
            said = (str(error).splitlines() or [type(error).__name__])[0]
            raise InputError(f"is not readable, the result is damaged: {said[:200]}", file=path) from error
        start = float(columns["position_carriage_m"][0]) if "position_carriage_m" in columns else 0.0
        return Run(run_id, columns.pop("time_s"), columns, self._rows[run_id].payload_kg, start)
