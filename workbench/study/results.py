"""The results folder of a study: written whole or not at all, found again, never overwritten.

results/<study>/
  index.parquet         one row a run
  runs/<run_id>/signals.parquet
  scenario.yaml, machine.yaml   as run, complete
  manifest.json         what made it; written last
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.errors import InputError
from workbench.machine import save_machine
from workbench.study import arrow
from workbench.study.load import Study
from workbench.study.run import Row, StudyResult
from workbench.whole_folder import is_free, what_is_in, whole_folder, write_json
from workbench.yaml_strict import dumps

MANIFEST = "manifest.json"
INDEX = "index.parquet"
DEFAULT_FOLDER = Path("results")
_OWN = ("run_id", "scenario", "status", "reason", "payload_kg", "reference")
_LIBRARIES = ("numpy", "numba", "scipy", "ruckig", "pyarrow", "plotly")


@dataclass(frozen=True)
class Place:
    """Where a study's results go. `finished`: they are there already. `note`: why not under the usual name."""

    folder: Path
    finished: bool
    note: str = ""


def place_for(study: Study, out: Path | None = None) -> Place:
    """Where this study's results belong.

    out: the wanted folder; InputError where it is a file or holds something else than this very study's
    finished result. Without it results/<name>, or the first of results/<name>-2, -3, … that is free or
    holds this very study.
    """
    if out is not None:
        if _holds(out, study):
            return Place(out, finished=True)
        if not is_free(out):
            raise InputError(f"{_what_is_in(out)}; nothing is overwritten, choose another --out", file=out)
        return Place(out, finished=False)
    first = DEFAULT_FOLDER / study.scenario.name
    folder, number = first, 1
    while not is_free(folder) and not _holds(folder, study):
        number += 1
        folder = first.with_name(f"{first.name}-{number}")
    note = "" if number == 1 else f"{first} {_what_is_in(first)}, so this one is in {folder}."
    return Place(folder, finished=_holds(folder, study), note=note)


def write_results(
    run: Callable[[], StudyResult], folder: Path, extras: Mapping[str, Callable[[StudyResult, Path], None]]
) -> StudyResult:
    """Run a study and write it to `folder`, which is free; extras: name -> how to write one more file.

    All or nothing, see `whole_folder`. InputError where a file cannot be written.
    """
    with whole_folder(folder) as hidden:
        result = run()
        _fill(hidden, result)
        for name, write in extras.items():
            write(result, hidden / name)
        write_json(hidden / MANIFEST, manifest(result.study))
    return result


def _fill(folder: Path, result: StudyResult) -> None:
    import pyarrow.parquet as pq

    pq.write_table(index_table(result.rows), folder / INDEX)
    for run_id, run in result.runs.items():
        place = folder / "runs" / run_id
        place.mkdir(parents=True)
        columns = {"time_s": run.time_s} | dict(run.signals)
        signals = arrow.table({name: arrow.numbers(values) for name, values in columns.items()})
        pq.write_table(signals, place / "signals.parquet", compression="zstd", use_dictionary=False)
    save_machine(result.study.machine, folder / "machine.yaml")
    scenario = result.study.scenario.model_dump(mode="json") | {"machine": "machine.yaml"}
    scenario["moves"] = [{k: v for k, v in move.items() if v is not None} for move in scenario["moves"]]
    (folder / "scenario.yaml").write_text(dumps(scenario), encoding="utf-8")


def index_table(rows: Sequence[Row]) -> Any:
    """The index as an Arrow table: the same rows give the same bytes."""
    columns: dict[str, Any] = {}
    for name in _OWN:
        values = [getattr(row, name) for row in rows]
        columns[name] = arrow.numbers(values) if name == "payload_kg" else arrow.texts(values)
    for name in rows[0].metrics:
        columns[name] = arrow.numbers([row.metrics[name] for row in rows])
    return arrow.table(columns)


def read_rows(folder: Path) -> list[Row]:
    """The rows of a finished result. InputError where the index is not there or not readable."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # ParquetFile, since read_table imports pandas and the datasets.
        with pq.ParquetFile(folder / INDEX) as index:
            records = index.read().to_pylist()
        return [_row(record) for record in records]
    except (OSError, KeyError, pa.ArrowInvalid) as error:
        raise InputError(f"is no readable index of a study: {error}", file=folder / INDEX) from error


def _row(record: dict[str, Any]) -> Row:
    return Row(
        **{name: record[name] for name in _OWN},
        metrics={name: value for name, value in record.items() if name not in _OWN},
    )


def manifest(study: Study) -> dict[str, Any]:
    """What made a result: versions, hashes, platform, and the commit where the program is a checkout."""
    from importlib.metadata import version

    return {
        "format": 1,
        "study": study.scenario.name,
        "fingerprint": study.fingerprint,
        "scenario_hash": study.scenario_hash,
        "machine_hash": study.machine_hash,
        "machine": study.machine.name,
        "versions": {"workbench": __version__, "python": platform.python_version()}
        | {name: version(name) for name in _LIBRARIES},
        "platform": f"{platform.system()} {platform.machine()}",
        "commit": _commit(Path(__file__).resolve().parents[2]),
    }


def _commit(checkout: Path) -> str | None:
    """The commit that is checked out, read from .git itself: git may not be installed."""
    try:
        git = checkout / ".git"
        head = (git / "HEAD").read_text().strip()
        if not head.startswith("ref: "):
            return head
        name = head.removeprefix("ref: ")
        if (git / name).is_file():
            return (git / name).read_text().strip()
        packed = (git / "packed-refs").read_text().splitlines()
        return next((line.split()[0] for line in packed if line.endswith(f" {name}")), None)
    except OSError:
        return None


def _holds(folder: Path, study: Study) -> bool:
    """Whether the finished result of this very study is there."""
    said = _read_manifest(folder)
    return said is not None and said.get("fingerprint") == study.fingerprint and (folder / INDEX).is_file()


def _read_manifest(folder: Path) -> dict[str, Any] | None:
    try:
        said = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) else None


def _what_is_in(folder: Path) -> str:
    said = _read_manifest(folder)
    if said is None:
        return what_is_in(folder)
    return f"holds another result ('{said.get('study')}', of another scenario, machine or program version)"
