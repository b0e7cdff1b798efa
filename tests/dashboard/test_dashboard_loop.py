"""The pages Loop and Sizing, both models on Validate, and the pages for an axis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.dashboard_app import downloads, ended, errors, figures, good, made_job, page, the_job, titles, words
from tests.support.log_campaign import hoist_columns, write_campaign
from workbench.analysis.margins import family, operating_points
from workbench.analysis.usual import usual_controller
from workbench.control import LinearCascade, PiSettings
from workbench.core.yaml_strict import dumps, loads
from workbench.dashboard import chosen as machines
from workbench.dashboard import jobs
from workbench.dashboard.desk import Desk, shipped_desk, usual_desk
from workbench.dashboard.pages import sizing, validate
from workbench.dashboard.pages.loop import gain_steps, rule_settings
from workbench.logs import read_campaign
from workbench.machines import Hoist, default_hoist, kind_of, machine_text, shipped, with_values
from workbench.machines.kinds.axis import LinearAxis, RotaryAxis
from workbench.simulate.models import compare_models
from workbench.study.load import plan_study
from workbench.study.run import run_study
from workbench.study.size import size
from workbench.view.size import sentences

KP, KI, WEIGHT = "loop kp", "loop ki", "loop weight"
KP_STEPS = gain_steps("kp", rule_settings(default_hoist()).kp)
OWN = {"torque_lag_s": "2", "speed_filter_s": "3", "speed_delay_s": "1"}  # the default drive's, in ms, in its keys


def number(app: Any, label: str) -> str:
    return next(metric.value for metric in app.metric if metric.label == label)


@pytest.fixture(scope="module")
def lagging() -> Any:
    """The page behind a drive with lag, filter and delay."""
    app = page("Loop").run()
    for name, value in (("torque_lag_s", 4.0), ("speed_filter_s", 3.0), ("speed_delay_s", 2.0)):
        app.number_input(key=f"loop {name} {OWN[name]}").set_value(value)
    return app.run()


def test_the_numbers_are_the_weakest_loops_own(lagging):
    drive = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
    machine = with_values(default_hoist(), drive)
    points = operating_points(machine, (0.0, 4500.0, 9000.0), (0.0, 11.25, 22.5))
    expected = max(member.margins.ms for member in family(machine, usual_controller(machine), points))
    assert number(lagging, "Largest Ms") == f"{expected:.2f}"
    assert "4 ms torque lag" in lagging.markdown[1].value.replace("\\", "")


def test_gains_that_lose_the_loop_are_called_unstable():
    app = page("Loop").run()
    app.number_input(key=f"loop speed_delay_s {OWN['speed_delay_s']}").set_value(50.0).run()
    app.select_slider(key=KP).set_value(KP_STEPS[-1]).run()
    assert errors(app) == ["Unstable with these gains: no margin means anything."]
    assert "unstable" in app.dataframe[0].value["gain dB"].tolist()
    names = [str(trace.get("name")) for figure in figures(app) for trace in figure["data"]]
    assert "Ms = 1.4, the limit" in names and not any("largest" in name for name in names)


def test_tune_fills_the_sliders_and_keeps_to_its_goal():
    app = page("Loop").run()
    for name, value in (("torque_lag_s", 4.0), ("speed_filter_s", 3.0), ("speed_delay_s", 2.0)):
        app.number_input(key=f"loop {name} {OWN[name]}").set_value(value)
    app.text_input(key="loop payloads").set_value("0,9000")
    app.text_input(key="loop heights").set_value("0")
    app.number_input(key="loop hertz").set_value(5.0)
    app.button(key="loop tune").click().run()
    assert not app.exception and errors(app) == []
    block = app.get("download_button")
    assert len(block) == 1
    assert float(number(app, "Largest Ms")) <= 1.4
    assert float(number(app, "Slowest bandwidth").split()[0]) >= 4.99
    tuned = PiSettings(
        kp_nm_s_per_rad=app.session_state[KP], ki_nm_per_rad=app.session_state[KI],
        set_point_weight=app.session_state[WEIGHT],
    )  # fmt: skip
    assert tuned.kp_nm_s_per_rad != usual_controller(default_hoist()).kp_nm_s_per_rad
    assert "winner" in app.dataframe[0].value["what"].tolist()
    assert app.select_slider(key=KP).value == tuned.kp_nm_s_per_rad


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("payloads", "0; 4500", "payloads: '0; 4500', expected numbers with commas between, such as 0,4500,9000"),
        ("heights", "nan", "heights: 'nan', expected finite numbers"),
        ("payloads", ",".join(map(str, range(60))), "60 payloads at 3 heights, expected at most 50 loops in all"),
    ],
)  # fmt: skip
def test_bad_payloads_and_heights_are_one_sentence(key, text, said):
    app = page("Loop").run()
    app.text_input(key=f"loop {key}").set_value(text).run()
    assert errors(app) == [said]
    assert not app.exception


# The page Sizing: the drive that `workbench size` takes for the file that the page offers.


CATALOGUE = "name,power_kw,speed_rpm,inertia_kg_m2\nsmall,22,1480,0.2\nlarge,90,1485,1.2\n"


def test_what_the_page_takes_is_what_the_command_takes_for_the_pages_file(server: Path):
    app = page("Sizing").run()
    assert not app.exception and errors(app) == []
    app.file_uploader(key="sizing catalogue").upload("my motors.csv", CATALOGUE.encode(), "text/csv")
    app.segmented_control(key="sizing ratios").set_value("the machine's")
    app.number_input(key="sizing share 9000").set_value(3.0)
    app.number_input(key=f"sizing {default_hoist().name} winch drum_diameter_m").set_value(0.65)
    app.number_input(key="sizing wire safety_factor").set_value(5.0).run()
    assert not app.exception and errors(app) == []
    app.button(key="sizing start").click().run()
    job = the_job(server, sizing.KIND)
    assert ended(job).state == "done", jobs.poll(job).sentence
    own: Any = loads((job.file("inputs") / sizing.SIZE).read_text(), "size.yaml").data
    assert own["wire"]["safety_factor"] == 5.0 and own["payloads"][-1]["share"] == 0.6
    found = size(job.file("inputs") / sizing.SIZE)
    machine: Any = found.study.machine
    assert machine.winch.drum_diameter_m == 0.65
    assert {candidate.motor.name for candidate in found.candidates} == {"small", "large"}
    app.run()
    assert all(sentence in words(app) for sentence in sentences(found))
    # a smaller bound is harder to keep: the page's answer follows its own file
    harder = job.file("inputs") / "harder.yaml"
    harder.write_text(dumps({**own, "wire": {**own["wire"], "breaking_load_n": 1000.0}}))
    assert size(harder).taken is None


# Both models on the page Validate: a comparison by a job, its report on the page, its errors.


@pytest.fixture
def lift(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offer) -> Path:
    """A campaign of one short run that the server offers. What a worker would do is done at once."""

    def at_once(
        kind: str, call: str, asked: dict[str, Any], workspace: Path, title: str, inputs: Mapping[str, Path]
    ) -> jobs.Job:
        return made_job(workspace, kind, title, call, asked)

    offer(tmp_path / "owner")
    monkeypatch.setattr(jobs, "start", at_once)
    return write_campaign(tmp_path / "owner" / "lift", hoist_columns())


def compared() -> Any:
    return page("Validate").run().button(key="validate models").click().run()


def test_both_models_are_compared_by_a_job_and_shown(server: Path, lift: Path):
    app = good(compared())
    campaign = read_campaign(lift)
    assert isinstance(campaign.machine, Hoist)
    expected = compare_models(campaign.machine, campaign.runs)
    line = app.dataframe[-1].value.iloc[0]
    assert float(line.iloc[3]) == pytest.approx(expected.runs[0].apart_percent, abs=2e-3)
    assert titles(app)[-3:] == [
        "Motor speed of both models", "Difference of both models", "Forces of rollers and cylinders",
    ]  # fmt: skip
    assert "The paper's models took 3.46 s and 91.53 s" in words(app)
    assert downloads(app)[-2:] == ["Report", "models.json"]
    job = the_job(server, "models")
    app.run()
    assert jobs.jobs_of(job.folder.parents[1], "models") == [job]
    job.file(jobs.VIEW).write_text('{"heading": 3}')
    assert errors(app.run()) == [f"{jobs.VIEW}: this result is damaged; compute it again"]


def test_what_cannot_be_compared_is_said_without_the_servers_folder(server: Path, lift: Path):
    machine = read_campaign(lift).machine.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}})
    asked = {"folder": str(lift), "name": "lift", "runs": ["lift"], "machine": machine_text(machine)}
    job = jobs.start(validate.MODELS, "workbench.dashboard.pages.validate:work", asked, server, "lift", {})
    assert jobs.poll(job).state == "failed" and not job.file("result").exists()


# The pages Study and Loop for an axis: its units, its controller, its uploads; pages for hoists say what they are.


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
