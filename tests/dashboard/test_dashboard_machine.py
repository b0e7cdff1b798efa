"""The page Machine: the drawing follows the run, its parts stand where they should, its sources and errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("streamlit")

from tests.support.dashboard_app import errors, page
from tests.support.log_campaign import AXIS, axis_columns, write_campaign
from tests.support.simulated_campaign import simulated_campaign
from workbench.dashboard import campaigns
from workbench.dashboard.pages.compare import kept
from workbench.dashboard.pages.machine.scene import scene_of
from workbench.figures import arm_parts
from workbench.figures.arm import MOST_FRAMES, Scene, moving_arm
from workbench.figures.arm_style import VIRIDIS, colour_at
from workbench.logs import read_campaign
from workbench.machine import default_hoist, with_values
from workbench.reports.loop.case import usual_controller
from workbench.run import Run
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.study.execute.run import run_study
from workbench.study.scenario.load import plan_study
from workbench.study.scenario.record import Scenario


@pytest.fixture(scope="module")
def lift() -> Run:
    """Two seconds at rest, then up, and to a stop."""
    time = np.arange(8000) * 0.001
    speed = 100.0 * np.interp(time, [2.0, 3.0, 6.0, 7.0], [0.0, 1.0, 1.0, 0.0])
    machine = default_hoist()
    case = LoopCase("lift", machine, 4500.0, 6.0, usual_controller(machine), speed)
    return simulate_loop([case])[0].run


def scene(lift: Run, **changes: Any) -> Scene:
    made = scene_of(default_hoist(), lift)
    return Scene(**{**vars(made), **changes})


def moment(figure: Any, k: int) -> list[Any]:
    """All traces as the browser shows them in frame k: the figure's, changed by the frame's."""
    frame = figure.frames[k]
    traces = [trace.to_plotly_json() for trace in figure.data]
    for number, change in zip(frame.traces, frame.data, strict=True):
        traces[number] = {**traces[number], **change.to_plotly_json()}
    return traces


def at_frame(shown: Scene, k: int) -> float:
    """The time that frame k shows."""
    return float(np.linspace(shown.time_s[0], shown.time_s[-1], MOST_FRAMES)[k])


def middle(trace: Any) -> float:
    values = np.array([np.nan if v is None else v for v in trace["y"]], dtype=float)
    return float(np.nanmean(values))


def filled(traces: list[Any], colour: str) -> list[Any]:
    return [trace for trace in traces if trace.get("fillcolor") == colour]


@pytest.mark.parametrize("dark", [False, True])
def test_plotly_accepts_the_drawing_as_it_is_built(lift, dark):
    figure = moving_arm(default_hoist(), scene(lift), dark, most_frames=3, validate=True)
    assert len(figure.frames) == 3


def test_a_long_run_is_thinned_to_its_frames_and_stays_small(lift):
    figure = moving_arm(default_hoist(), scene(lift))
    assert len(figure.frames) == MOST_FRAMES
    assert len(figure.to_json()) < 800_000
    assert [list(step.args[0]) for step in figure.layout.sliders[0].steps] == [[frame.name] for frame in figure.frames]


def test_carriage_and_pipe_rise_by_just_what_the_run_rises(lift):
    shown = scene(lift)
    figure = moving_arm(default_hoist(), shown)
    first, last = moment(figure, 0), moment(figure, MOST_FRAMES - 1)
    rise = shown.height_m[-1] - shown.height_m[0]
    assert rise > 1.5
    for colour in ("#BFD5EA", "#CDBB92"):  # carriage and gripper, the pipe
        for before, after in zip(filled(first, colour), filled(last, colour), strict=True):
            assert middle(after) - middle(before) == pytest.approx(rise, abs=2e-3)


def test_wire_leaves_the_drum_at_the_height_of_the_anchor_and_ends_at_the_carriage(lift):
    shown = scene(lift)
    machine = default_hoist()
    figure = moving_arm(machine, shown)
    s = arm_parts.sizes(machine)
    for k in (0, 75, 149):
        falls = [t for t in moment(figure, k) if t.get("line", {}).get("width") == 4.5]
        height = float(np.interp(at_frame(shown, k), shown.time_s, shown.height_m))
        right = falls[2]
        assert right["x"] == pytest.approx([s.r, s.r], abs=1e-3)
        assert right["y"] == pytest.approx([height, machine.wire.segment_length_m], abs=2e-3)


def test_drum_and_sheave_turn_as_the_drawn_wire_runs(lift):
    shown = scene(lift)
    machine = default_hoist()
    s = arm_parts.sizes(machine)
    figure = moving_arm(machine, shown)

    def angles(k: int) -> tuple[float, float]:
        drum, sheave = [t for t in moment(figure, k) if t.get("line", {}).get("width") in (4.0, 3.4)]
        of_drum, of_sheave = (np.arctan2(t["y"][1] - t["y"][0], t["x"][1] - t["x"][0]) for t in (drum, sheave))
        return of_drum, of_sheave

    k, later = 60, 80
    wound = [float(np.interp(at_frame(shown, number), shown.time_s, shown.wound_m)) for number in (k, later)]
    taken = wound[1] - wound[0]
    assert taken > 0.0
    (drum, sheave), (drum_after, sheave_after) = angles(k), angles(later)
    turned = np.angle(np.exp(1j * (drum_after - drum))), np.angle(np.exp(1j * (sheave_after - sheave)))
    assert turned[0] == pytest.approx(taken / s.R, rel=0.01)  # hoisting turns the drum counter-clockwise
    assert turned[1] == pytest.approx(-taken / (2.0 * s.r), rel=0.01)  # and the sheave backward


def test_wire_is_coloured_by_its_tension_and_dashed_where_it_is_slack(lift):
    slack = np.zeros(len(lift.time_s), dtype=bool)
    at = int(np.searchsorted(lift.time_s, 5.0))
    slack[at] = True  # one sample only, between two frames
    tension = np.linspace(0.0, 50e3, len(slack))
    shown = scene(lift, slack=slack, tension_drum_n=tension, tension_dead_line_n=tension)
    figure = moving_arm(default_hoist(), shown)
    marked = [k for k in range(MOST_FRAMES) if "SLACK" in str([t.get("text") for t in moment(figure, k)])]
    assert len(marked) == 1 and abs(at_frame(shown, marked[0]) - 5.0) < 0.1
    line = next(t for t in moment(figure, marked[0]) if t.get("line", {}).get("width") == 4.5)["line"]
    assert line["dash"] != "solid"
    first, last = (next(t for t in moment(figure, k) if t.get("line", {}).get("width") == 4.5) for k in (0, 149))
    assert first["line"]["color"] == colour_at(0.0, 50e3) and last["line"]["color"] == colour_at(50e3, 50e3)
    shades = [shape for shape in figure.layout.shapes if shape.yref == "y8 domain"]
    assert len(shades) == 1 and shades[0].x0 == pytest.approx(5.0, abs=0.02)


def test_colours_go_from_one_end_of_the_bar_to_the_other():
    assert colour_at(-1.0, 10.0) == "rgb({},{},{})".format(*VIRIDIS[0])
    assert colour_at(99.0, 10.0) == "rgb({},{},{})".format(*VIRIDIS[-1])
    lightness = [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in VIRIDIS]
    assert lightness == sorted(lightness)  # read in black and white too


def test_the_torque_bars_and_their_limits_are_the_machines(lift):
    machine = with_values(default_hoist(), {"drive.overload": 2.0})
    shown = scene_of(machine, lift)
    figure = moving_arm(machine, shown)
    bars = [t for t in moment(figure, 70) if t.get("xaxis") == "x4" and t["mode"] == "lines"]
    expected = [float(np.interp(at_frame(shown, 70), lift.time_s, lift[f"torque_motor{m}_nm"])) for m in (1, 2)]
    assert [bar["y"][1] for bar in bars] == pytest.approx(expected)
    limits = {shape.y0 for shape in figure.layout.shapes if shape.yref == "y4"}
    assert {480.0, 960.0} <= limits


def test_an_empty_gripper_holds_nothing_and_a_heavier_pipe_is_thicker(lift):
    s = arm_parts.sizes(default_hoist())
    widths = [arm_parts.half_pipe(s, payload, 8000.0) for payload in (0.0, 1000.0, 4500.0, 9000.0)]
    assert widths[0] == 0.0 and widths == sorted(set(widths))
    texts = [str(t.get("text")) for t in moment(moving_arm(default_hoist(), scene(lift, payload_kg=0.0)), 0)]
    assert any("empty" in text for text in texts)


def test_a_measured_run_gets_the_tensions_and_heights_of_the_model(lift, tmp_path):
    folder = simulated_campaign(tmp_path / "spring", truth=default_hoist())
    campaign = read_campaign(folder)
    run = campaign.run("half")
    assert "position_carriage_m" not in run and "tension_drum_n" not in run
    shown = scene_of(default_hoist(), run)
    # At rest both falls carry half of carriage and pipe; half of the bare wire's weight is added at the top.
    held = 0.5 * (8000.0 + 4500.0) * 9.81
    assert shown.tension_drum_n[:50].mean() == pytest.approx(held, rel=0.03)
    assert shown.height_m[0] == pytest.approx(9.0, abs=0.01)
    assert np.ptp(shown.height_m) == pytest.approx(2.0, abs=0.05)
    assert "measured motor speed" in shown.tension_of
    assert not shown.slack.any()
    moving_arm(default_hoist(), shown, validate=True, most_frames=2)


def test_logged_heights_and_tensions_are_shown_as_they_were_measured(lift):
    names = ("torque_motor_nm", "speed_motor_rad_s", "position_carriage_m", "tension_dead_line_n")
    logged = {name: lift[name] + (0.25 if name == "position_carriage_m" else 0.0) for name in names}
    shown = scene_of(default_hoist(), Run("log", lift.time_s, logged, 4500.0, 6.25))
    assert (shown.height_m == logged["position_carriage_m"]).all() and shown.height_of == "measured"
    assert (shown.tension_dead_line_n == logged["tension_dead_line_n"]).all()
    assert len(shown.torques_nm) == 1  # the sum is logged: half of it is each motor's
    assert (shown.torques_nm[0] == lift["torque_motor_nm"] / 2.0).all()


def test_the_simulated_and_the_measured_way_agree_on_a_run(lift):
    log = Run("log", lift.time_s, {name: lift[name] for name in ("torque_motor_nm", "speed_motor_rad_s")}, 4500.0, 6.0)
    one, other = scene_of(default_hoist(), lift), scene_of(default_hoist(), log)
    assert other.height_m == pytest.approx(one.height_m, abs=2e-3)
    assert other.tension_drum_n == pytest.approx(one.tension_drum_n, rel=0.03)


def drawing(app: Any) -> dict[str, Any]:
    (chart,) = app.get("plotly_chart")
    spec: dict[str, Any] = json.loads(chart.proto.spec)
    return spec


def test_the_page_moves_a_quick_run_in_the_browser():
    app = page("Machine").run()
    assert not app.exception and errors(app) == []
    spec = drawing(app)
    assert 2 < len(spec["frames"]) <= MOST_FRAMES
    plays = [button["label"] for button in spec["layout"]["updatemenus"][0]["buttons"]]
    assert plays == ["▶ play", "▶▶ 4×", "❚❚ pause"]
    assert all(not step["args"][1]["frame"]["redraw"] for step in spec["layout"]["sliders"][0]["steps"])


def test_another_payload_is_another_run():
    app = page("Machine").run()
    assert "4500 kg" in app.markdown[0].value
    app.slider(key="machine payload").set_value(9000).run()
    assert "9000 kg" in app.markdown[0].value


def test_a_payload_that_the_motors_cannot_hold_is_shown_or_told():
    app = page("Machine").run()
    app.slider(key="machine payload").set_value(12000).run()
    app.slider(key="machine ramp").set_value(0.3).run()
    assert not app.exception


def test_a_study_run_kept_in_the_session_can_be_shown():
    scenario = Scenario.model_validate(
        {
            "name": "short",
            "payloads_kg": [0.0, 4500.0],
            "start_position_m": 4.0,
            "moves": [{"by_m": 2.0}],
            "limits": {"speed_m_s": 0.5, "acceleration_m_s2": 0.5, "jerk_m_s3": 1.0},
            "references": ["trapezoid", "ruckig"],
            "controller": {"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0},
        }
    )
    result = run_study(plan_study(scenario, default_hoist()))
    app = page("Machine")
    app.session_state["runs kept"] = {"short": kept.Kept("short", scenario, default_hoist(), result)}
    app.run()
    app.radio(key="machine source").set_value("a run kept from Study").run()
    assert app.selectbox(key="machine study run").options[:2] == ["trapezoid, 0 kg", "ruckig, 0 kg"]
    app.selectbox(key="machine study run").set_value("ruckig, 4500 kg").run()
    assert not app.exception and errors(app) == []
    assert "short, ruckig, 4500 kg" in app.markdown[0].value


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The state of a session whose Validate page shows a campaign."""

    def at(folder: Path) -> Any:
        monkeypatch.setattr(campaigns, "SHIPPED", ())
        monkeypatch.setenv(campaigns.VARIABLE, str(folder))
        validate = page("Validate").run()
        app = page("Machine")
        for key in ("campaign chosen", "campaigns read"):
            app.session_state[key] = validate.session_state[key]
        app.run()
        return app.radio(key="machine source").set_value("a run of the campaign").run()

    return at


def test_a_measured_run_of_the_validated_campaign_can_be_shown(chosen, tmp_path):
    app = chosen(simulated_campaign(tmp_path / "spring"))
    app.selectbox(key="machine measured").set_value("full").run()
    assert not app.exception and errors(app) == []
    assert "spring, full" in app.markdown[0].value
    assert "of the model under the measured motor speed" in app.caption[0].value


def test_an_axis_has_no_drawing_and_says_so(chosen, tmp_path):
    runs = "runs:\n- {name: lift, file: runs/lift.csv}\n"
    app = chosen(write_campaign(tmp_path / "axis", axis_columns(), runs=runs, machine=AXIS))
    assert errors(app) == ["machine.yaml: kind: is a machine of kind 'axis'; this drawing is of kind 'hoist'"]


def test_the_drawing_can_be_made_large():
    app = page("Machine").run()
    assert drawing(app)["layout"]["height"] == 600
    app.toggle(key="machine large").set_value(True).run()
    assert drawing(app)["layout"]["height"] == 880
