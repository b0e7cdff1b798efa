"""`import workbench as wb`: the names are there, load late, and every result shows itself."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import workbench as wb
from tests.support.made_diagnosis import made_diagnosis
from workbench.core.shown import VIEWS, Shown, view_of
from workbench.core.table import Table
from workbench.study.size import size

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


def test_a_machine_is_a_record_or_the_path_of_its_file_in_every_call_and_anything_else_is_one_clear_error(
    tmp_path: Path,
):
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


def test_a_run_is_an_xarray_data_set_of_its_signals_over_time_and_without_xarray_one_clear_error(
    monkeypatch: pytest.MonkeyPatch,
):
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
