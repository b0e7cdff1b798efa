"""`import workbench as wb`, metrics asserted in a team's own tests, damaged results."""

from __future__ import annotations

import ast
import errno
import importlib
import inspect
import json
import math
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import workbench as wb
from benchmarks.attack.mangle import finished_result
from tests.support.made_diagnosis import made_diagnosis
from workbench.core.errors import InputError
from workbench.core.shown import VIEWS, Shown, view_of
from workbench.core.table import Table
from workbench.core.whole_folder import replace_json
from workbench.machines import default_hoist
from workbench.metrics import fixed_columns
from workbench.study.conclude import alarm, sentences, utilisation
from workbench.study.rows import INDEX, Row, check_whole, read_manifest, read_rows
from workbench.study.size import size
from workbench.testing import StudyRows, assert_metric
from workbench.testing import study_rows as study_rows

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "scenarios" / "demo_campaign"
SMALL = {
    "payloads_kg": [0.0, 9000.0],
    "start_position_m": 4.0,
    "moves": [{"by_m": 1.5}],
    "limits": {"speed_m_s": 0.7, "acceleration_m_s2": 0.6, "jerk_m_s3": 0.8},
    "references": ["trapezoid", "ruckig"],
    "controller": {"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0},
}


@cache
def result(kind: str) -> Any:
    """One result of each class that shows itself."""
    made = {
        "Campaign": lambda: wb.read_campaign(DEMO, runs="empty_fast,half_fast"),
        "Comparison": lambda: wb.compare(result("StudyResult"), wb.study(SMALL, controller=stiffer())),
        "Diagnosis": lambda: made_diagnosis("named"),
        "Identification": lambda: wb.identify(result("Campaign")),
        "LoopAnalysis": lambda: wb.loop(payloads_kg=[0.0, 9000.0], heights_m=[4.0]),
        "LoopResult": lambda: wb.simulate(1.5, payload_kg=4500.0),
        "ReplayResult": lambda: wb.replay(result("Campaign")),
        "Run": lambda: result("Campaign").runs[0],
        "Sizing": lambda: size(ROOT / "scenarios" / "size" / "racker.yaml"),
        "StudyResult": lambda: wb.study(SMALL),
        "Tuning": lambda: wb.tune(bandwidth_hz=1.5, payloads_kg=[0.0, 9000.0], heights_m=[4.0]),
    }
    return made[kind]()


def stiffer() -> dict[str, float]:
    return {"kp_nm_s_per_rad": 45.0, "ki_nm_per_rad": 122.0}


_WHERE, _VERBS = vars(wb)["_WHERE"], vars(wb)["_VERBS"]
each_result = pytest.mark.parametrize("kind", sorted(VIEWS))


def test_every_name_of_the_face_is_what_its_stub_says_it_is():
    stub = ast.parse((ROOT / "workbench" / "__init__.pyi").read_text(encoding="utf-8"))
    said = {
        alias.name: f"{node.module}" for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted(said) == sorted([*_WHERE, *_VERBS])
    assert {name: f"workbench.{module}" for name, module in _WHERE.items()} == {
        name: module for name, module in said.items() if name not in _VERBS
    }
    for name, module in said.items():
        thing = getattr(importlib.import_module(module), name)
        assert thing is getattr(wb, name) or inspect.unwrap(getattr(wb, name)) is thing
        assert (thing.__doc__ or "").strip(), name
        assert (inspect.getdoc(getattr(wb, name)) or "").startswith(inspect.getdoc(thing) or "?"), name
        if name in _VERBS:  # `help` of a package shows no signature of its own
            assert all(option in getattr(wb, name).__doc__ for option in inspect.signature(thing).parameters), name


def test_the_face_loads_nothing_until_a_name_is_used():
    code = (
        "import sys, workbench as wb\n"
        "assert not [m for m in ('numpy', 'numba', 'pydantic', 'plotly') if m in sys.modules]\n"
        "wb.Limits\n"
        "assert 'numba' not in sys.modules and 'plotly' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_only_what_shows_a_result_imports_by_name():
    """What the layer test cannot see: an import by a text."""
    calling = [
        file for file in (ROOT / "workbench").rglob("*.py")
        if "workbench.core.verb import attribute" in file.read_text(encoding="utf-8")
    ]  # fmt: skip
    found = sorted(file.relative_to(ROOT / "workbench").as_posix() for file in calling)
    assert found == ["core/shown.py", "diagnose/diagnose.py"]


@each_result
def test_every_result_has_a_table_figures_and_columns(kind: str):
    shown = result(kind)
    assert isinstance(shown, Shown)
    view = view_of(shown)
    for name in ("", *view.tables):
        table = shown.table(name)
        assert isinstance(table, Table)
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert len(str(table).splitlines()) >= 1 + len(table.rows)
        assert table._repr_html_().count("<tr>") == 1 + len(table.rows)
    for name in ("", *view.figures) if view.figures else ():
        try:
            figure = shown.plot(name)
        except wb.InputError as error:  # such as a diagnosis of one effect, which none can be told apart from
            if "nothing to draw" not in str(error):
                raise
            continue
        assert type(figure).__module__.startswith("plotly.") and len(figure.data) >= 1, name


def test_a_wrong_table_figure_metric_or_signal_suggests_the_nearest():
    study, run = result("StudyResult"), result("Run")
    with pytest.raises(wb.InputError, match="no figure 'peak'; did you mean 'peaks'"):
        study.plot("peak")
    with pytest.raises(wb.InputError, match="no table 'run'; did you mean 'runs'"):
        study.table("run")
    with pytest.raises(wb.InputError, match="no metric 'peak_torque'; did you mean 'peak_torque_"):
        study.rows[0]["peak_torque"]
    with pytest.raises(wb.InputError, match="no signal 'speed_motor'; did you mean 'speed_motor_rad_s'"):
        run["speed_motor"]


def test_a_study_takes_a_file_a_dict_another_machine_and_other_values():
    from_file = wb.study(ROOT / "scenarios" / "payloads.yaml", payloads_kg=[0.0])
    assert {row.payload_kg for row in from_file.rows} == {0.0}
    heavy = wb.with_values(wb.default_hoist(), {"carriage.mass_kg": 9000.0})
    assert wb.study(SMALL, machine=heavy).rows[0]["hold_torque_nm"] > result("StudyResult").rows[0]["hold_torque_nm"]
    with pytest.raises(wb.InputError, match="did you mean 'settle_s'"):
        wb.study({**SMALL, "setle_s": 1.0})


def test_a_machine_is_a_record_or_the_path_of_its_file_in_every_call_and_anything_else_is_one_clear_error(tmp_path):
    heavy = wb.with_values(wb.default_hoist(), {"carriage.mass_kg": 9000.0})
    file = tmp_path / "machine.yaml"
    wb.save_machine(heavy, file)
    assert wb.study(SMALL, machine=str(file)).rows[0] == wb.study(SMALL, machine=heavy).rows[0]
    assert wb.simulate(0.5, machine=file).metrics == wb.simulate(0.5, machine=heavy).metrics
    assert wb.loop(file, heights_m=[4.0]).case.machine == heavy
    assert wb.replay(DEMO, machine=file).machine == heavy
    for call in (
        lambda m: wb.study(SMALL, machine=m),
        lambda m: wb.simulate(0.5, machine=m),
        wb.loop,
        wb.tune,
        *(lambda m, verb=verb: verb(result("Campaign"), machine=m) for verb in (wb.replay, wb.identify, wb.diagnose)),
    ):
        with pytest.raises(wb.InputError, match=r"no-such\.yaml"):
            call(tmp_path / "no-such.yaml")
        with pytest.raises(wb.InputError, match=r"is a int, expected a machine or the path of its machine\.yaml"):
            call(3)


def test_a_simulation_is_the_study_s_run_of_the_same_case():
    row = next(row for row in result("StudyResult").rows if row.payload_kg == 9000.0 and row.reference == "ruckig")
    alone = wb.simulate(
        1.5,
        payload_kg=9000.0,
        start_position_m=4.0,
        limits=wb.Limits(0.7, 0.6, 0.8),
        controller=wb.PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    )
    for metric in ("peak_torque_motor_nm", "speed_error_max_rad_s", "min_wire_tension_n"):
        assert alone.metrics[metric] == pytest.approx(row[metric], rel=1e-6)


def test_a_run_is_an_xarray_data_set_of_its_signals_over_time_and_without_xarray_one_clear_error(monkeypatch):
    run = wb.Run("a", np.arange(3.0), {"torque_motor_nm": np.array([1.0, 2.0, 3.0])}, 4500.0, notes=("repaired",))
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(wb.InputError, match="needs xarray, which is optional"):
        run.to_xarray()
    # xarray is no part of the environment: what its Dataset is given, as xarray 2024 took it when it was tried.
    monkeypatch.setitem(sys.modules, "xarray", cast(Any, SimpleNamespace(Dataset=lambda *given: given)))
    signals, coordinates, values = cast(Any, run.to_xarray())
    over, torque = signals["torque_motor_nm"]
    assert (over, list(torque), list(coordinates["time_s"])) == ("time_s", [1.0, 2.0, 3.0], [0.0, 1.0, 2.0])
    assert (values["payload_kg"], values["name"], values["notes"]) == (4500.0, "a", ["repaired"])


def test_a_motion_is_simulated_on_the_plant_that_is_named():
    pytest.importorskip("exudyn", reason="the extra multibody is not installed")
    slow = wb.PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.004)
    lumped, multibody = (wb.simulate(0.5, controller=slow, plant=plant) for plant in ("lumped", "multibody"))
    assert "force_cylinder_n" in multibody.run and "force_cylinder_n" not in lumped.run
    name = "peak_torque_motor_nm"
    assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=5e-3)
    with pytest.raises(wb.InputError, match="did you mean 'multibody'"):
        wb.simulate(0.5, plant="multi_body")


# How a team asserts closed-loop metrics in its own tests, and what it reads when one is missed.
# The first two tests are the example. Where workbench is installed, pytest knows `study_rows` without its import.


pytest_plugins = ["pytester"]


def test_the_drive_has_room_left_at_full_load(study_rows: StudyRows) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    assert_metric(rows, "peak_torque_percent", below=150, where={"payload_kg": 9000})
    assert_metric(rows, "peak_torque_percent", below=120, where={"payload_kg": 9000, "reference": "ruckig"})


def test_the_wire_never_goes_slack(study_rows: StudyRows) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    assert_metric(rows, "min_wire_tension", above=20e3)
    assert_metric(rows, "slack_time", below=1e-9)


def test_a_scenario_is_run_once_in_a_session(study_rows: StudyRows, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    monkeypatch.setattr("workbench.testing.run_scenario", None)
    assert study_rows("scenarios/../scenarios/payloads.yaml") is rows


MEASURED = dict.fromkeys(fixed_columns(), 1.0)
ROWS = [
    Row("light", "s", "ok", "", 0.0, "ruckig", MEASURED | {"peak_torque_percent": 71.0}),
    Row("heavy", "s", "ok", "", 9000.0, "ruckig", MEASURED | {"peak_torque_percent": 137.25}),
    Row("lost", "s", "failed", "the carriage left the rail", 6e4, "ruckig", dict.fromkeys(fixed_columns())),
]


def test_a_missed_limit_says_which_run_and_by_which_value() -> None:
    with pytest.raises(AssertionError) as told:
        assert_metric(ROWS, "peak_torque", below=120, above=10)
    assert str(told.value).splitlines() == [
        "peak_torque_percent is not below 120 and above 10 in 2 of 3 runs:",
        "  heavy: 137.25",
        "  lost: failed: the carriage left the rail",
    ]


def test_a_choice_of_nothing_passes_no_test() -> None:
    with pytest.raises(AssertionError, match=r"no run has payload_kg 4500; there are: 0\.0, 60000\.0, 9000\.0"):
        assert_metric(ROWS, "peak_torque_percent", below=80, where={"payload_kg": 4500})
    with pytest.raises(AssertionError, match="there are no runs"):
        assert_metric([], "peak_torque_percent", below=80)


def test_a_misspelt_metric_or_column_gets_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown metric 'peak_torqe'; did you mean 'peak_torque'\?"):
        assert_metric(ROWS, "peak_torqe", below=80)
    with pytest.raises(InputError, match=r"where: unknown column 'payload'; did you mean 'payload_kg'\?"):
        assert_metric(ROWS, "peak_torque", below=80, where={"payload": 0})
    with pytest.raises(TypeError, match="below, above or both"):
        assert_metric(ROWS, "peak_torque")


def test_pytest_finds_the_fixture_in_a_project_of_its_own(pytester, monkeypatch):
    root = Path(__file__).resolve().parents[1]
    monkeypatch.setenv("PYTHONPATH", str(root))
    (pytester.path / "mine.yaml").write_bytes((root / "scenarios" / "payloads.yaml").read_bytes())
    pytester.makepyfile(
        """
        from workbench.testing import assert_metric

        def test_mine(study_rows):
            assert_metric(study_rows("mine.yaml"), "peak_torque_percent", below=100)
        """
    )
    # What the entry point does in an environment that workbench is installed in.
    done = pytester.runpytest_subprocess("-p", "workbench.testing")
    done.assert_outcomes(failed=1)
    done.stdout.fnmatch_lines(
        ["*peak_torque_percent is not below 100 in 3 of 9 runs:", "*9000kg_ruckig_equal_time: 107*"]
    )


# Damaged results, files that must not be overwritten, links that lead nowhere: one sentence each.


def test_a_result_knows_its_own_bytes(tmp_path):
    whole = finished_result()
    manifest = read_manifest(whole)
    assert manifest is not None
    assert set(manifest["files"]) == {"index.parquet", "scenario.yaml", "machine.yaml"}
    for name in (INDEX, "manifest.json"):
        (tmp_path / name).write_bytes((whole / name).read_bytes())
    assert [row.status for row in read_rows(tmp_path)] == ["ok"] * len(read_rows(whole))
    (tmp_path / INDEX).write_bytes((whole / INDEX).read_bytes() + b"x")
    with pytest.raises(InputError, match=r"index\.parquet: is not what was written, as manifest\.json says"):
        check_whole(tmp_path, INDEX)


@pytest.mark.parametrize("content", ["name: my scenario\n", '{"other": 1}', "[1]", '"newly_failed"'])
def test_json_replaces_nothing_that_it_did_not_write(tmp_path, content):
    path = tmp_path / "precious.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match="was not written by this command; nothing is overwritten"):
        replace_json(path, {"newly_failed": []}, "newly_failed")
    assert path.read_text() == content


def test_json_is_written_whole_or_not_at_all_and_knows_no_nan(tmp_path, monkeypatch):
    path = tmp_path / "compared.json"
    replace_json(path, {"newly_failed": [], "x": math.nan, "inner": {"y": [math.inf, 1.0]}}, "newly_failed")
    said: dict[str, Any] = {"newly_failed": [], "x": None, "inner": {"y": [None, 1.0]}}
    assert json.loads(path.read_text()) == said

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        replace_json(path, {"newly_failed": [1]}, "newly_failed")
    assert json.loads(path.read_text()) == said
    assert [file.name for file in tmp_path.iterdir()] == ["compared.json"]


def at_the_limit(rms_nm: float) -> Row:
    metrics = {"peak_torque_motor_nm": 800.0, "peak_torque_percent": 160.0, "rms_torque_motor_nm": rms_nm}
    metrics |= {"slack_time_s": 0.0, "slack_events": 0.0, "position_error_end_m": 0.0}
    return Row("a", "s", "ok", "", 4500.0, "trapezoid", metrics)


def hunting(swings: float) -> Row:
    row = at_the_limit(400.0)
    return replace(
        row, metrics={**row.metrics, "torque_swings": swings, "move_time_s": 7.0, "peak_speed_percent": 50.0}
    )


def test_a_loop_that_hunts_below_its_limits_is_pointed_out_where_runs_are_judged():
    assert any(
        "The loop hunts" in said and "50 times a second of motion" in said
        for said in sentences([hunting(350.0)], 1000.0)
    )
    assert not any("hunts" in said for said in sentences([hunting(14.0)], 1000.0))
    lights = {use.what: use.light for use in utilisation([hunting(350.0)], default_hoist())}
    assert lights["torque swings"] == "red"
    assert "torque swings 25 times 2 a second" in str(alarm(utilisation([hunting(350.0)], default_hoist())))
    assert "torque swings" not in {use.what for use in utilisation([hunting(14.0)], default_hoist())}
