"""Which study a batch shall run: a scenario that ships or an uploaded one, on its own machine or another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.machines import chosen_machine
from workbench.errors import InputError
from workbench.machine import save_machine
from workbench.study.load import Study, load_study, read_standalone
from workbench.yaml_strict import Document, dumps, load

UPLOAD = "upload a scenario"
MOST_BYTES = 1 * session.MB
MOST_RUNS = 100_000
MOST_RUNS_WITH_SIGNALS = 1_000  # some hundred kilobytes each
SCENARIO, MACHINE, ON_MACHINE = "scenario.yaml", "machine.yaml", "on_machine.yaml"


@dataclass(frozen=True)
class Choice:
    """A study that can be run. file: its scenario as the page sees it; inputs: files that the worker gets copies of.

    file is one of the inputs, or a file that ships.
    """

    study: Study
    file: Path
    inputs: Mapping[str, Path] = field(default_factory=dict)


def shipped() -> dict[str, Path]:
    """The scenarios that come with the program, or lie in the folder where it was started, by name."""
    for folder in (Path(__file__).resolve().parents[4] / "scenarios", Path.cwd() / "scenarios"):
        if files := {file.stem: file for file in sorted(folder.glob("*.yaml"))}:
            return files
    return {}


def chosen() -> Choice | None:
    """The study that the page's controls name; None as long as a file is to be uploaded. InputError for a bad one."""
    ships = shipped()
    name = st.selectbox("Scenario", [*ships, UPLOAD], index=_usual(list(ships)), key="batches scenario")
    inputs: dict[str, Path] = {}
    if name != UPLOAD:
        file = ships[name]
    else:
        upload = st.file_uploader("scenario.yaml", type=["yaml", "yml"], key="batches upload", max_upload_size=1)
        if upload is None:
            return None
        file = inputs[SCENARIO] = session.stored(upload, SCENARIO, MOST_BYTES)
    own = st.toggle("On another machine", key="batches other machine", help="Than the one that the scenario names.")
    machine = chosen_machine("batches machine") if own else None
    if name == UPLOAD:
        document, known = load(file), {batch.name: batch for batch in ships.values()}
        read_standalone(document, machine, known)  # what other files it names are not sought among the server's
        inputs |= extended(document, known)
    if machine is not None:
        save_machine(machine, inputs.setdefault(MACHINE, session.file_in_workspace(MACHINE)))
        over = session.file_in_workspace(ON_MACHINE)
        # Beside its copy where the scenario is uploaded, in its own place where it ships.
        base = SCENARIO if name == UPLOAD else str(file)
        over.write_text(dumps({"extends": base, "machine": MACHINE}), encoding="utf-8")
        file = inputs[ON_MACHINE] = over
    study = _loaded(file, inputs)
    check_size(study)
    return Choice(study, file, inputs)


def extended(document: Document, known: Mapping[str, Path]) -> dict[str, Path]:
    """Copies in the session's folder, beside the upload, of the scenarios that ship and that a document extends."""
    copies: dict[str, Path] = {}
    while isinstance(document.data, dict) and (name := str(document.data.get("extends", "")).rpartition("/")[2]):
        copies[name] = session.file_in_workspace(name)
        copies[name].write_bytes(known[name].read_bytes())
        document = load(copies[name])
    return copies


def check_size(study: Study) -> None:
    """InputError for a study too large for the page."""
    runs, signals = len(study.specs), study.scenario.outputs.signals
    if runs > MOST_RUNS:
        raise InputError(f"{runs} runs, expected at most {MOST_RUNS} here; `workbench study` takes more", place="sweep")
    if signals != "none" and runs > MOST_RUNS_WITH_SIGNALS:
        raise InputError(
            f"{runs} runs that keep their signals, expected at most {MOST_RUNS_WITH_SIGNALS} here; "
            "write `outputs: {signals: none}`",
            place="outputs",
        )


def _usual(names: list[str]) -> int:
    return names.index("payloads") if "payloads" in names else 0


def _loaded(file: Path, inputs: Mapping[str, Path]) -> Study:
    """The study, read anew only when a file has changed: a large one takes a second to be checked."""
    state = [(str(path), path.read_bytes()) for path in (file, *inputs.values())]
    last = session.get("batches study", tuple, ())
    if not last or last[0] != state:
        last = (state, load_study(file))
        session.put("batches study", last)
    study: Study = last[1]
    return study
