"""The page Loop: figures and margins follow the gains, tuning fills the sliders, bad input is one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.dashboard_app import downloads, ended, errors, figures, good, made_job, page, the_job, titles, words
from tests.support.log_campaign import hoist_columns, write_campaign
from workbench.analysis.margins import family, operating_points
from workbench.analysis.usual import usual_controller
from workbench.control import PiSettings
from workbench.core.yaml_strict import dumps, loads
from workbench.dashboard import jobs
from workbench.dashboard.pages import sizing, validate
from workbench.dashboard.pages.loop import gain_steps, rule_settings
from workbench.logs import read_campaign
from workbench.machines import Hoist, default_hoist, with_values
from workbench.machines.files import machine_text
from workbench.simulate.models import compare_models
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
