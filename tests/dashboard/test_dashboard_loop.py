"""The page Loop: figures and margins follow the gains, tuning fills the sliders, bad input is one sentence."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.dashboard_app import errors, figures, page
from workbench.analysis.family import family, operating_points
from workbench.analysis.usual import usual_controller
from workbench.control import PiSettings
from workbench.dashboard.pages.loop import gain_steps, rule_settings
from workbench.machines import default_hoist, with_values

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
