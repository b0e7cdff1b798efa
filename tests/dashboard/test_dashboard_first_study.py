"""The first page's study on disk: what comes back is what was kept, and only for the same sources, study and user."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType

import pytest

pytest.importorskip("streamlit")

from workbench.dashboard import first_study, warm
from workbench.dashboard.ahead import OF_STREAMLIT, streamlit_scripts
from workbench.dashboard.pages.study.controls import Controls, Desk, scenario_of
from workbench.dashboard.pages.study.runs import RUNS, results
from workbench.machine import default_hoist, shipped_hoist
from workbench.study.run import StudyResult

MACHINE = default_hoist()
SCENARIO = scenario_of(Desk(Controls(references=("ruckig",), payloads_kg=(0.0,))), MACHINE)


@pytest.fixture(autouse=True)
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A server that loads ahead, its files in a folder of the test's."""
    monkeypatch.setattr(first_study, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(warm, "_threads", [None])
    restart(monkeypatch)
    yield
    restart(monkeypatch)


def restart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_study, "_kept", None)
    first_study.kept_file.cache_clear()


def test_a_study_comes_back_with_its_numbers_and_signals(monkeypatch: pytest.MonkeyPatch):
    ran = results(SCENARIO, MACHINE)
    first_study.keep({first_study.key(RUNS, SCENARIO, MACHINE): ran})
    restart(monkeypatch)
    again = first_study.found(RUNS, SCENARIO, MACHINE)
    assert isinstance(again, StudyResult) and again is not ran and results(SCENARIO, MACHINE) is again
    assert [(row.run_id, row.metrics) for row in again.rows] == [(row.run_id, row.metrics) for row in ran.rows]
    for name, run in ran.runs.items():
        assert all((run[signal] == again.runs[name][signal]).all() for signal in run.signals)


def test_another_study_another_machine_and_another_source_find_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    first_study.keep({first_study.key(RUNS, SCENARIO, MACHINE): MappingProxyType({"a": 1.0})})
    restart(monkeypatch)
    assert first_study.found(RUNS, SCENARIO, MACHINE) == {"a": 1.0}
    other = SCENARIO.model_copy(update={"payloads_kg": (1.0,)})
    assert first_study.found(RUNS, other, MACHINE) is None
    assert first_study.found(RUNS, SCENARIO, shipped_hoist("lightly_damped")) is None
    restart(monkeypatch)
    monkeypatch.setattr(first_study, "version", lambda name: "another")
    assert first_study.found(RUNS, SCENARIO, MACHINE) is None


def test_a_damaged_file_and_one_that_others_can_write_to_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    first_study.keep({first_study.key(RUNS, SCENARIO, MACHINE): 1.0})
    (file,) = tmp_path.glob("*.study")
    whole = file.read_bytes()
    file.write_bytes(whole[:-1] + b"?")
    restart(monkeypatch)
    assert first_study.found(RUNS, SCENARIO, MACHINE) is None
    file.write_bytes(whole)
    if hasattr(os, "getuid"):
        file.chmod(0o666)
        restart(monkeypatch)
        assert first_study.found(RUNS, SCENARIO, MACHINE) is None
        file.chmod(0o600)
    restart(monkeypatch)
    assert first_study.found(RUNS, SCENARIO, MACHINE) == 1.0


def test_only_the_newest_files_stay(tmp_path: Path):
    for age in range(7):
        old = tmp_path / f"{age}.study"
        old.write_bytes(b"")
        os.utime(old, (age, age))
    first_study.keep({})
    assert len(list(tmp_path.glob("*.study"))) == first_study.NEWEST
    assert first_study.kept_file().is_file() and not list(tmp_path.glob("*.tmp"))


def test_a_process_that_is_no_server_looks_for_nothing(monkeypatch: pytest.MonkeyPatch):
    first_study.keep({first_study.key(RUNS, SCENARIO, MACHINE): 1.0})
    restart(monkeypatch)
    monkeypatch.setattr(warm, "_threads", [])
    assert first_study.found(RUNS, SCENARIO, MACHINE) is None


def test_the_page_names_the_scripts_of_its_elements_with_all_that_they_import():
    named = streamlit_scripts()
    assert len(named) == len(set(named))
    assert {name.partition(".")[0] for name in named} > set(OF_STREAMLIT)
    assert any(name.startswith("styled-components.") for name in named)  # which every one of them imports
