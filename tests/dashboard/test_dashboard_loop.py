"""The page Loop: figures and margins follow the gains, tuning fills the sliders, bad input is one sentence."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.dashboard_app import errors, figures, page
from workbench.analysis.family import family, operating_points
from workbench.analysis.loop import INPUTS, SHOWN, step_response
from workbench.analysis.tune import Goal, Weights
from workbench.analysis.usual import usual_controller
from workbench.control import PiSettings
from workbench.core.errors import InputError
from workbench.dashboard.desk import edited, usual_desk
from workbench.dashboard.pages import loop
from workbench.dashboard.pages.loop import gain_steps, rule_settings
from workbench.machines import default_hoist, with_values
from workbench.view.loop import HZ, RAD_S, bode, gang_of_four

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


def test_the_page_draws_bode_nyquist_steps_and_the_gang_of_four():
    app = page("Loop").run()
    assert not app.exception and errors(app) == []
    titles = [figure["layout"]["title"]["text"] for figure in figures(app)]
    assert titles == ["Open loop L", "Nyquist", "Step responses of the linear loop", "Gang of four"]
    app.selectbox(key="loop unit").set_value("rad/s").run()
    assert figures(app)[0]["layout"]["xaxis2"]["title"]["text"] == "frequency (rad/s)"


def test_the_table_holds_every_payload_at_every_height():
    app = page("Loop").run()
    app.text_input(key="loop payloads").set_value("0, 3000").run()
    app.text_input(key="loop heights").set_value("2, 9, 20").run()
    table = app.dataframe[0].value
    assert list(zip(table["load kg"], table["height m"], strict=True)) == [
        (load, height) for load in ("0", "3000") for height in ("2", "9", "20")
    ]


def test_the_numbers_are_the_weakest_loops_own(lagging):
    drive = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
    machine = with_values(default_hoist(), drive)
    points = operating_points(machine, (0.0, 4500.0, 9000.0), (0.0, 11.25, 22.5))
    expected = max(member.margins.ms for member in family(machine, usual_controller(machine), points))
    assert number(lagging, "Largest Ms") == f"{expected:.2f}"
    assert "4 ms torque lag" in lagging.markdown[1].value.replace("\\", "")


def test_a_larger_gain_costs_margin_and_the_delta_says_so():
    app = page("Loop").run()
    app.number_input(key=f"loop speed_delay_s {OWN['speed_delay_s']}").set_value(5.0).run()
    before = number(app, "Largest Ms")
    app.select_slider(key=KP).set_value(KP_STEPS[110]).run()
    assert float(number(app, "Largest Ms")) > float(before)
    assert next(metric for metric in app.metric if metric.label == "Largest Ms").delta.startswith("+")


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


def test_weights_and_what_is_tuned_too_reach_the_tuning(monkeypatch: pytest.MonkeyPatch):
    asked: dict[str, Any] = {}

    def tune(machine: Any, settings: Any, points: Any, trial: Any, goal: Any, weights: Any, **more: Any) -> None:
        asked.update(more, goal=goal, weights=weights)
        raise InputError("enough")

    monkeypatch.setattr(loop, "tune", tune)
    app = page("Loop").run()
    app.pills(key="loop also").set_value(["notch", "schedule"])
    app.number_input(key="loop peak").set_value(5.0)
    app.radio(key="loop goal").set_value(loop.REJECTION)
    app.button(key="loop tune").click().run()
    assert errors(app) == ["enough"] and not app.exception
    assert (asked["also"], asked["weights"], asked["goal"]) == (
        ("notch", "schedule"), Weights(1.0, 5.0, 1.0), Goal(None, 1.4),
    )  # fmt: skip
    for what in ("tracking error", "peak", "rms"):
        app.number_input(key=f"loop {what}").set_value(0.0)
    assert errors(app.run()) == ["Weights: 0, 0 and 0, expected at least one above 0"]


def test_a_bandwidth_out_of_reach_says_what_the_drive_allows(lagging):
    lagging.number_input(key="loop hertz").set_value(40.0)
    lagging.button(key="loop tune").click().run()
    (said,) = errors(lagging)
    assert said.startswith("bandwidth: 40 Hz is out of reach: this machine and drive allow at most 12.4 Hz at Ms 1.4")


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("payloads", "0; 4500", "payloads: '0; 4500', expected numbers with commas between, such as 0,4500,9000"),
        ("payloads", "-5", "payloads: -5 kg, expected 0 to 1000000 kg"),
        ("heights", "2, 40", "heights: 40 m is off the rail, which reaches from 0 m to 25 m"),
        ("heights", "nan", "heights: 'nan', expected finite numbers"),
        ("payloads", ",".join(map(str, range(60))), "60 payloads at 3 heights, expected at most 50 loops in all"),
    ],
)  # fmt: skip
def test_bad_payloads_and_heights_are_one_sentence(key, text, said):
    app = page("Loop").run()
    app.text_input(key=f"loop {key}").set_value(text).run()
    assert errors(app) == [said]
    assert not app.exception


def test_bode_in_radians_shows_the_same_loop_at_two_pi_times_the_frequency():
    machine = default_hoist()
    members = family(machine, usual_controller(machine), operating_points(machine, (4500.0,), (9.0,)))
    for make in (lambda unit: bode(members, unit=unit), lambda unit: gang_of_four(members, 1.4, unit=unit)):
        hertz, radians = make(HZ), make(RAD_S)
        for one, other in zip(hertz.data, radians.data, strict=True):
            assert other.x == pytest.approx(2.0 * math.pi * one.x)
            assert (other.y == one.y).all()
    crossover = members[0].margins.crossover_hz
    words = [note.text for note in bode(members, unit=RAD_S).layout.annotations]
    assert f"crossover {2.0 * math.pi * crossover:.3g} rad/s" in words
    assert f"crossover {crossover:.3g} Hz" in [note.text for note in bode(members).layout.annotations]


def test_the_step_response_is_that_of_the_loop_taken_sample_by_sample():
    drive = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
    machine = with_values(default_hoist(), drive)
    (member,) = family(machine, usual_controller(machine), operating_points(machine, (4500.0,), (9.0,)))
    for column, name in enumerate(INPUTS):
        response = step_response(member.loop, name, 1.5)
        inputs = np.zeros((len(response.time_s), len(INPUTS)))
        inputs[:, column] = 1.0
        slowly = member.loop.closed.run(inputs)
        for signal, values in zip(SHOWN, slowly.T, strict=True):
            assert response.signals[signal] == pytest.approx(values, abs=1e-9 * np.max(np.abs(values)))


def test_the_page_says_that_its_loop_is_the_lumped_machines_where_study_runs_on_the_multibody_one():
    said = "Study runs on the multi-body machine; this loop is that of the lumped one, which is linearised."
    desk, key = usual_desk(default_hoist()), "desk hoist"
    app = page("Loop")
    app.session_state[key] = replace(desk, scenario=edited(desk.scenario, default_hoist(), {"plant": "multibody"}))
    assert said in [caption.value for caption in app.run().caption]
    app.session_state[key] = desk
    assert said not in [caption.value for caption in app.run().caption]
