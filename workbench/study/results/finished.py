"""A finished result, read back whole from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.kinds import LOOPED, looped, of_kind
from workbench.machine import AnyKind, load_machine
from workbench.run import Run
from workbench.study.results.digests import check_whole
from workbench.study.results.folder import SavedRuns
from workbench.study.results.index import INDEX, read_rows
from workbench.study.results.manifest import MANIFEST, read_manifest
from workbench.study.results.row import Row
from workbench.study.scenario.record import Scenario
from workbench.yaml_strict import load, validate


@dataclass(frozen=True)
class Finished:
    """scenario: as run, as it stands in the file. runs: the signals by run_id, of the runs that have kept them."""

    folder: Path
    rows: tuple[Row, ...]
    runs: Mapping[str, Run]
    machine: AnyKind
    scenario: Mapping[str, Any]
    manifest: Mapping[str, Any]

    @property
    def name(self) -> str:
        return str(self.manifest.get("study", self.folder.name))


def read_finished(folder: Path) -> Finished:
    """The result in `folder`. InputError where it is none, is not whole, or is damaged."""
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise InputError(f"{what}, expected a folder that `workbench study` made", file=folder)
    manifest = read_manifest(folder)
    if manifest is None or folder.name.endswith(".part"):
        if (folder / "chunks").is_dir() or folder.name.endswith(".part"):
            raise InputError("is not finished; call `workbench study` for its scenario again, it goes on", file=folder)
        raise InputError(f"is no finished result of a study: it has no readable {MANIFEST}", file=folder)
    for name in ("scenario.yaml", "machine.yaml"):
        check_whole(folder, name)
    rows = read_rows(folder)
    expected = (manifest.get("runs") or {}).get("all")
    if not rows or expected not in (None, len(rows)):
        raise InputError(f"holds {len(rows)} runs, its {MANIFEST} says {expected}: the result is damaged",
                         file=folder / INDEX)  # fmt: skip
    read = load_machine(folder / "machine.yaml")
    machine = looped(read)
    if machine is None:
        raise InputError(f"is {of_kind(read)}; a study's is of {LOOPED}", file=folder / "machine.yaml")
    return Finished(folder, tuple(rows), SavedRuns(folder, rows), machine, _scenario(folder), manifest)


def _scenario(folder: Path) -> Mapping[str, Any]:
    file = folder / "scenario.yaml"
    document = load(file)
    validate(Scenario, document)
    assert isinstance(document.data, dict)
    return document.data
