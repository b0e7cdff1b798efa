"""The figures of a diagnosis carry the data they are given, with units, and one colour for before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.support.made_diagnosis import made_diagnosis
from workbench.view.diagnosis_figures import ALL, RunSeries, isolability, profiles, residuals, shrink_bars
from workbench.view.style import AFTER, BEFORE, REST, WINDOW

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


def test_the_isolability_matrix_shows_each_pair_once():
    angle = np.array([[0.0, 12.0, 80.0], [12.0, 0.0, 45.0], [80.0, 45.0, 0.0]])
    (heat,) = isolability(["a", "b", "c"], angle, chosen=["b"]).data
    assert list(heat.x) == ["a", "<b>b</b>"]
    assert list(heat.y) == ["<b>b</b>", "c"]
    assert [list(row) for row in heat.z] == [[12.0, None], [80.0, 45.0]]
    assert [list(row) for row in heat.text] == [["12", ""], ["80", "45"]]
    assert (heat.zmin, heat.zmax) == (0.0, 90.0)


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
