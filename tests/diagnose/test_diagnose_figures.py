"""The figures of a diagnosis carry the data they are given, with units, and one colour for before and after."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.support.made_diagnosis import made_diagnosis
from workbench.diagnose.tables import Curve
from workbench.view.diagnosis_figures import (
    ALL,
    COLOURS,
    RunSeries,
    curves,
    inputs,
    isolability,
    profiles,
    ranking,
    residuals,
    shrink_bars,
    speeds,
    worth_a_panel,
)
from workbench.view.style import AFTER, BEFORE, LINES, REST, WINDOW

WAYS = ("hoisting", "lowering")
TIME = np.linspace(0.0, 10.0, 401)


def series(name: str = "half", after: bool = True, size: float = 5.0) -> RunSeries:
    measured = 300.0 + size * np.sin(TIME)
    moving = (TIME > 1.0) & (TIME < 9.0)
    return RunSeries(
        name, TIME, measured, measured - size * np.cos(TIME), measured - 0.1 if after else None,
        np.sin(TIME), 1.1 * np.sin(TIME), np.sin(TIME) if after else None, moving,
        ((2.0, 3.5),), ((0.0, 1.0), (9.0, 10.0)), "60 % of the gap's energy",
    )  # fmt: skip


def traces(figure: Any, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


def shaded(figure: Any, colour: str) -> list[tuple[float, float]]:
    return [(shape.x0, shape.x1) for shape in figure.layout.shapes if shape.fillcolor == colour]


def titles(figure: Any) -> list[str]:
    return [axis.title.text for axis in [*figure.select_xaxes(), *figure.select_yaxes()] if axis.title.text]


def test_the_residual_stands_before_and_after_with_noise_windows_and_rests():
    figure = residuals([series()], "N m", noise_rms=0.6)
    (before,), (after,) = traces(figure, "before"), traces(figure, "after")
    assert (before.line.color, after.line.color) == (BEFORE, AFTER)
    going = (before.x > 1.0) & (before.x < 9.0)
    np.testing.assert_allclose(before.y[going], 5.0 * np.cos(before.x[going]), atol=1e-4)
    assert np.isnan(before.y[~going]).all() and before.x[going][[0, -1]] == pytest.approx([1.0, 9.0], abs=0.06)
    np.testing.assert_allclose(after.y[(after.x > 1.0) & (after.x < 9.0)], 0.1, atol=1e-4)
    assert shaded(figure, WINDOW) == [(2.0, 3.5)]
    assert shaded(figure, REST) == [(0.0, 1.0), (9.0, 10.0)]
    assert [shape.y0 for shape in figure.layout.shapes if shape.type == "line"] == [1.2, -1.2]
    assert "torque residual (N m)" in titles(figure)


def test_a_residual_at_rest_does_not_set_the_scale():
    run = series()
    spiked = dataclasses.replace(run, before=np.where(run.moving, run.before, 1000.0))
    low, high = residuals([spiked], "N", noise_rms=0.6).layout.yaxis.range
    assert -10.0 < low < -5.0 < 5.0 < high < 12.0


def test_the_measured_input_is_black_and_the_window_shaded():
    figure = inputs([series()], "N")
    (measured,), (predicted,) = traces(figure, "measured"), traces(figure, "predicted before")
    assert measured.line.color == LINES["measured"][0]
    assert predicted.line.color == BEFORE
    assert shaded(figure, WINDOW) == [(2.0, 3.5)]
    assert any("60 % of the gap's energy" in note.text for note in figure.layout.annotations)
    assert "force (N)" in titles(figure)


def test_names_have_room_above_the_highest_value():
    figure = inputs([series("one"), series("two"), series("three", size=50.0)], "N m")
    for axis, size in (("yaxis", 5.0), ("yaxis3", 50.0)):
        low, high = figure.layout[axis].range
        assert high > 300.0 + size * 1.3
        assert low < 300.0 - size


def test_a_panel_above_an_empty_place_ends_its_column():
    figure = inputs([series(name) for name in "abc"], "N m")
    assert figure.layout.xaxis.showticklabels is False
    assert figure.layout.xaxis2.showticklabels and figure.layout.xaxis2.title.text == "time (s)"
    assert figure.layout.xaxis3.title.text == "time (s)"


def test_replayed_speeds_say_their_error_before_and_after():
    figure = speeds([series()], "nominal motor speed")
    expected = 0.1 * float(np.sqrt(np.mean(np.sin(TIME) ** 2)))
    (note,) = [note.text for note in figure.layout.annotations]
    assert note == f"<b>half</b>, RMSE {expected:.2f} % → 0.00 %<b></b>"
    assert "nominal motor speed" in figure.layout.title.text


def test_without_a_correction_nothing_is_drawn_as_after():
    for figure in (residuals([series(after=False)], "N m", 0.6), speeds([series(after=False)], "nominal")):
        assert [trace.line.color for trace in figure.data if trace.line.color == AFTER] == []


def test_profiles_have_a_panel_a_variable_on_one_scale():
    where = made_diagnosis("named").where
    assert where is not None
    figure = profiles(where.profiles, "N m", WAYS)
    forward, backward = traces(figure, WAYS[0]), traces(figure, WAYS[1])
    assert len(forward) == len(backward) == len(where.profiles) == 3
    first = where.profiles[0]
    known = np.isfinite(first.mean_forward)
    drawn = np.array([np.nan if value is None else value for value in forward[0].y])
    np.testing.assert_allclose(drawn[known], first.mean_forward[known])
    assert np.isnan(drawn[~known]).all()
    assert figure.layout.yaxis2.range == figure.layout.yaxis4.range == figure.layout.yaxis6.range
    assert [title for title in titles(figure) if title.endswith(")")] == [
        "speed (m/s)", "carriage height (m)", "time since the start (s)", "mean residual (N m)",
    ]  # fmt: skip
    assert sum(trace.showlegend for trace in forward) == 1


def test_a_profile_over_the_direction_names_the_two_ways():
    where = made_diagnosis("named").where
    assert where is not None
    nothing = np.array([np.nan, np.nan])
    direction = dataclasses.replace(
        where.profiles[0], variable="direction", label="direction", unit="1", edges=np.array([-1.5, 0.0, 1.5]),
        mean_forward=np.array([np.nan, 2.0]), mean_backward=np.array([-1.0, np.nan]), share=nothing,
    )  # fmt: skip
    figure = profiles([direction], "N", WAYS)
    assert list(figure.layout.xaxis.ticktext) == ["lowering", "hoisting"]
    assert list(figure.layout.xaxis.tickvals) == [-0.75, 0.75]
    assert figure.layout.xaxis.title.text == "direction"


def test_a_spectrum_fills_its_panel_with_the_share_of_the_energy():
    where = made_diagnosis("named").where
    assert where is not None
    nothing = np.full(3, np.nan)
    wave = dataclasses.replace(
        where.profiles[0], variable="frequency", label="frequency, best at 0.5 Hz", unit="Hz", explains=0.34,
        edges=np.array([0.1, 0.3, 0.9, 2.7]), mean_forward=nothing, mean_backward=nothing,
        share=np.array([0.2, 0.7, 0.1]),
    )  # fmt: skip
    figure = profiles([wave], "N m", WAYS)
    (steps,) = figure.data
    assert list(steps.x) == [0.1, 0.3, 0.9, 2.7]
    assert steps.yaxis == "y"  # the axis that has the panel's place; an axis over it has none without its lines
    assert list(steps.y) == pytest.approx([20.0, 70.0, 10.0, 10.0])
    assert (steps.line.shape, figure.layout.xaxis.type) == ("hv", "log")
    assert titles(figure) == ["frequency (Hz)", "one wave's share of the energy"]
    assert list(figure.layout.yaxis.range) == pytest.approx([0.0, 80.5])
    assert "best at 0.5 Hz, explains 34 %" in figure.layout.annotations[0].text


def test_a_wave_that_explains_nothing_has_no_panel():
    where = made_diagnosis("named").where
    assert where is not None
    mean, nothing = where.profiles[0], np.full(3, np.nan)
    wave = dataclasses.replace(mean, mean_forward=nothing, mean_backward=nothing, explains=0.004)
    assert not worth_a_panel(wave)
    assert worth_a_panel(dataclasses.replace(wave, explains=0.2))
    assert worth_a_panel(dataclasses.replace(mean, explains=0.0))


def test_curves_have_a_band_of_two_standard_errors():
    at = np.array([0.0, 1.0, 2.0])
    curve = Curve("payload_kg", "motor", at, at * 10.0, -at, np.full(3, 2.0), np.array([1.0, np.nan, 1.0]), 0.7)
    figure = curves([curve], WAYS, {"payload_kg": ("payload", "kg")}, ["N m"])
    bands = [trace for trace in figure.data if trace.fill == "toself"]
    assert list(bands[0].y) == [4.0, 14.0, 24.0, 16.0, 6.0, -4.0]
    assert list(bands[1].x) == [0.0, 2.0, 2.0, 0.0]  # what has no error has no band
    assert titles(figure) == ["payload (kg)", "torque at the motor (N m)"]
    assert "explains 70 %" in figure.layout.annotations[0].text


def test_the_ranking_has_a_bar_a_hypothesis_the_likeliest_on_top():
    rows = [
        ("named", "heave", 0.925),
        ("unknown", "unknown cause", 0.07),
        ("no_gap", "no gap", 0.00495),
        ("", "9 more", 5e-5),
    ]
    figure = ranking(rows)
    (bars,) = figure.data
    assert list(bars.x) == pytest.approx([92.5, 7.0, 0.495, 0.005])
    assert list(bars.text) == ["92 %", "7.0 %", "0.5 %", "< 0.1 %"]
    assert list(bars.marker.color) == [COLOURS[word] for word, *_ in rows]
    assert figure.layout.yaxis.autorange == "reversed"
    assert figure.layout.xaxis.title.text == "probability (%)"


def test_the_isolability_matrix_shows_each_pair_once():
    angle = np.array([[0.0, 12.0, 80.0], [12.0, 0.0, 45.0], [80.0, 45.0, 0.0]])
    (heat,) = isolability(["a", "b", "c"], angle, chosen=["b"]).data
    assert list(heat.x) == ["a", "<b>b</b>"]
    assert list(heat.y) == ["<b>b</b>", "c"]
    assert [list(row) for row in heat.z] == [[12.0, None], [80.0, 45.0]]
    assert [list(row) for row in heat.text] == [["12", ""], ["80", "45"]]
    assert (heat.zmin, heat.zmax) == (0.0, 90.0)


def test_an_angle_that_is_not_known_leaves_its_cell_empty():
    (heat,) = isolability(["a", "b"], np.array([[0.0, np.nan], [np.nan, 0.0]])).data
    assert [list(row) for row in heat.z] == [[None]]


def test_shrink_has_two_bars_a_run_and_the_noise_floor():
    figure = shrink_bars({"slow": (9.0, 0.8), "fast": (11.0, 0.7)}, (10.0, 0.75), 0.6, "N m")
    (before,), (after,) = traces(figure, "before"), traces(figure, "after")
    assert list(before.x) == ["slow", "fast", f"<b>{ALL}</b>"]
    assert list(before.y) == [9.0, 11.0, 10.0]
    assert list(after.y) == [0.8, 0.7, 0.75]
    assert (before.marker.color, after.marker.color) == (BEFORE, AFTER)
    (floor,) = figure.layout.shapes
    assert (floor.y0, floor.y1, floor.line.dash) == (0.6, 0.6, "5px,4px")
    assert figure.data[2].name == "noise floor, 0.6 N m"
    assert figure.layout.yaxis.range[1] > 11.0


def test_one_run_needs_no_bar_for_all_of_them():
    (before,) = traces(shrink_bars({"only": (9.0, 0.8)}, (9.0, 0.8), 0.6, "N"), "before")
    assert list(before.x) == ["only"]
