"""The pages Study and Loop for an axis: its units, its controller, its uploads; pages for hoists say what they are."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.dashboard_app import errors, figures, page
from workbench.control import LinearCascade
from workbench.dashboard import chosen as machines
from workbench.dashboard.desk import Desk, shipped_desk, usual_desk
from workbench.machines import default_hoist, kind_of, shipped
from workbench.machines.files import machine_text
from workbench.machines.kinds.axis import LinearAxis, RotaryAxis
from workbench.study.load import plan_study
from workbench.study.run import run_study


def emps() -> LinearAxis:
    machine = shipped("emps_axis")
    assert isinstance(machine, LinearAxis)
    return machine


EMPS = emps()
KEY = f"desk {kind_of(EMPS).name}"
ROTARY = RotaryAxis.model_validate(
    {
        "name": "turning arm",
        "inertia_kg_m2": 0.4,
        "gravity": {"sine_nm": 2.0},
        "friction": {"coulomb_forward_nm": 0.5, "coulomb_backward_nm": 0.5, "viscous_nm_s_per_rad": 0.05},
        "drive": {"torque_limit_nm": 30.0, "nominal_torque_nm": 10.0, "top_speed_rad_s": 4.0},
    }
)


def shipped_axis_desk() -> Desk:
    desk, machine = shipped_desk("axis", default_hoist())
    assert machine == EMPS
    return desk


def labels(app: Any) -> set[str]:
    return {field.label for field in (*app.slider, *app.select_slider, *app.number_input, *app.text_input)}


@pytest.fixture(scope="module")
def study() -> Any:
    """The page with the scenario of an axis that ships, chosen on the axis."""
    app = page("Study")
    app.session_state["machine chosen"] = machines.AXIS
    app.session_state[KEY] = shipped_axis_desk()
    return app.run()


def test_an_axis_is_studied_in_its_own_units(study):
    assert not study.exception and errors(study) == []
    assert {"Limit speed (m/s)", "kv (1/s)", "kp (N s/m)", "ki (N/m)", "Start position (m)"} <= labels(study)
    assert not any("ayload" in name or "height" in name for name in labels(study))
    assert [metric.label for metric in study.metric] == ["Force peak", "Largest tracking error", "Move time"]
    assert len(figures(study)) == 2


def test_an_uploaded_rotary_axis_is_studied_in_radians():
    app = page("Study")
    app.session_state["machine chosen"] = machines.AXIS
    app.run()
    app.selectbox(key="study machine").set_value(machines.UPLOADED).run()
    app.file_uploader(key="study machine file").upload("m.yaml", machine_text(ROTARY).encode(), "application/yaml")
    app.run()
    assert not app.exception and errors(app) == []
    assert app.selectbox(key="study machine").value == "turning arm"
    assert {"Limit speed (rad/s)", "kp (N m s/rad)", "Start position (rad)"} <= labels(app)
    assert app.metric[0].label == "Torque peak"


def test_an_axis_gains_go_from_loop_to_study_and_leave_the_hoists_alone():
    loop = page("Loop")
    loop.session_state["machine chosen"] = machines.AXIS
    loop.run()
    assert not loop.exception and errors(loop) == []
    assert {"kv (1/s)", "kp (N s/m)", "Positions (m)"} <= labels(loop)
    assert "Payloads (kg)" not in labels(loop)
    loop.number_input(key="loop kp typed").set_value(5000.0).run()
    settings = loop.session_state[KEY].scenario.controller
    assert isinstance(settings, LinearCascade) and settings.kp_n_s_per_m == 5000.0
    assert "desk hoist" not in loop.session_state
    study = page("Study")
    study.session_state["machine chosen"] = machines.AXIS
    study.session_state[KEY] = loop.session_state[KEY]
    study.run()
    assert study.slider(key="study.kp").value == 5000.0 and not study.exception


def test_a_page_for_hoists_says_so_and_leaves_the_axis_chosen():
    app = page("Machine")
    app.session_state["machine chosen"] = machines.AXIS
    app.run()
    assert not app.exception and app.selectbox(key="machine machine").value == machines.DEFAULT
    assert app.info[0].value.startswith("This page is for hoists only; ball-screw axis stays")
    assert app.session_state["machine chosen"] == machines.AXIS


def test_the_usual_study_of_any_axis_runs_within_its_drive():
    for machine in (EMPS, ROTARY):
        rows = run_study(plan_study(usual_desk(machine).scenario, machine)).rows
        assert rows and all(row.ok for row in rows)
        name = "peak_force_n" if machine is EMPS else "peak_torque_nm"
        peaks = [row.metrics[name] for row in rows]
        assert all(peak is not None and 0.0 < peak < machine.drive.limit for peak in peaks)
