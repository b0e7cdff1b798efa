"""Figures carry the data they are given, keep peaks and colours, and make one page that needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_file
from workbench.machines import default_hoist
from workbench.references import planned_kinds
from workbench.simulate.replay import replay_runs
from workbench.view.identify import correlation_matrix
from workbench.view.page import Section, save_page
from workbench.view.panels import PASSES, STRAIGHT, straightened, thin
from workbench.view.replay import inputs, speeds
from workbench.view.study_figures import over_time, peak_torque_over_payload, slack_stretches
from workbench.view.style import LINES

TIME = np.linspace(0.0, 40.0, 4001)
HOIST = default_hoist()


def loop_run(payload_kg: float, peak_nm: float = 500.0, slack: tuple[float, float] | None = None) -> Run:
    torque = 400.0 + (peak_nm - 400.0) * np.exp(-((TIME - 20.0) ** 2))
    tension = np.full_like(TIME, 60000.0)
    if slack is not None:
        start, end = slack
        tension[(start <= TIME) & (end >= TIME)] = 0.0
    signals = {
        "torque_motor_nm": 2 * torque,
        "torque_motor1_nm": torque,
        "torque_motor2_nm": torque,
        "speed_motor_rad_s": 100.0 * np.sin(TIME),
        "speed_reference_rad_s": 100.0 * np.sin(TIME + 0.01),
        "tension_drum_n": tension + 500.0,
        "tension_min_n": tension,
    }
    return Run(f"{payload_kg:g}", TIME, signals, payload_kg)


def traces(figure: Any, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


@given(st.integers(1, 9000), st.integers(20, 1500), st.integers(0, 2**32 - 1))
def test_thinning_keeps_extremes_ends_and_order(n: int, most: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=n)
    time = np.arange(n, dtype=float)
    kept_time, kept = thin(time, values, most)
    assert len(kept) <= max(n if n <= most else most + 2, 1)
    assert kept.max() == values.max()
    assert kept.min() == values.min()
    assert kept_time[0] == time[0]
    assert kept_time[-1] == time[-1]
    assert np.all(np.diff(kept_time) > 0)
    np.testing.assert_array_equal(kept, values[kept_time.astype(int)])


@given(n=st.integers(0, 400), seed=st.integers(0, 99), noise=st.sampled_from([0.0, 1e-5, 1e-2]))
def test_a_straightened_line_runs_within_its_tolerance_of_every_point(n: int, seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.linspace(0.0, 40.0, n), 300.0 * np.tanh(3.0 * np.sin(np.linspace(0.0, 9.0, n)))
    y = y + 300.0 * noise * rng.normal(size=n)
    kept_x, kept_y = straightened(x, y)
    assert len(kept_x) <= n and np.all(np.diff(kept_x) > 0.0)
    if n:
        assert (kept_x[0], kept_x[-1], kept_y[0], kept_y[-1]) == (x[0], x[-1], y[0], y[-1])
    if n > 1:
        scale = np.array([np.ptp(x), np.ptp(y) or 1.0])
        corners, points = (np.stack(xy, axis=1) / scale for xy in ((kept_x, kept_y), (x, y)))
        start, along = corners[:-1], np.diff(corners, axis=0)
        share = np.sum((points[:, None] - start) * along, axis=2) / np.sum(along**2, axis=1)
        foot = start + np.clip(share, 0.0, 1.0)[:, :, None] * along
        off = np.min(np.linalg.norm(points[:, None] - foot, axis=2), axis=1)  # of each point from the nearest stretch
        assert np.max(off) < PASSES * STRAIGHT + 1e-12


def test_a_reference_keeps_its_colour_in_every_figure() -> None:
    shown = over_time([(kind, loop_run(0.0)) for kind in reversed(list(planned_kinds()))], HOIST)
    peaks = peak_torque_over_payload(
        np.array([0.0, 1.0]), {k: np.array([1.0, 2.0]) for k in planned_kinds()}, 480.0, 768.0
    )
    for figure in (shown, peaks):
        assert {t.line.color for t in traces(figure, "trapezoid")} == {planned_kinds()["trapezoid"].colour}
        assert {t.line.color for t in traces(figure, "ruckig, same limits")} == {planned_kinds()["ruckig"].colour}
    looks = list(LINES.values())
    assert len(set(looks)) == len(looks)


def test_slack_is_shaded_from_its_start_to_its_end() -> None:
    run = loop_run(0.0, slack=(12.0, 13.5))
    np.testing.assert_allclose(slack_stretches(run), [(12.0, 13.5)])
    figure = over_time([("ruckig", run)], HOIST)
    (shade,) = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    assert (shade.x0, shade.x1) == (pytest.approx(12.0), pytest.approx(13.5))
    assert shade.line.width > 0.0  # a moment of a few samples is seen too
    assert [note.text for note in figure.layout.annotations].count("slack") == 1


def test_a_replays_figures_are_in_parts_of_nominal_torque_and_in_per_cent_of_nominal_speed() -> None:
    machine = default_hoist()
    run = Run("run a", TIME, {"torque_motor_nm": np.full_like(TIME, 1440.0), "speed_motor_rad_s": 0.0 * TIME}, 0.0, 5.0)
    result = replay_runs(machine, [run])
    torque = inputs(machine, result).data[0]
    assert torque.name == "mean of both motors"
    assert torque.y.max() == pytest.approx(1440.0 / 2.0 / machine.motor.nominal_torque_nm)
    figure, simulated = speeds(machine, result), result.runs[0].simulated["speed_motor_rad_s"]
    assert traces(figure, "measured")[0].y.max() == 0.0
    expected = 100.0 / machine.motor.nominal_speed_rad_s * float(np.max(simulated))
    assert traces(figure, "simulated")[0].y.max() == pytest.approx(expected)
    assert figure.layout.annotations[0].text == f"<b>run a</b>, RMSE {result.runs[0].speed_rmse_percent:.2f} %<b></b>"


def test_page_needs_no_network_and_has_the_same_bytes_each_time(tmp_path: Path) -> None:
    figure = correlation_matrix(["a", "b"], np.eye(2))
    table = Table([Column("n", "kg"), words("word")], [["1", "<one>"]], "All & each.")
    section = Section("", ["x & y of `<z>`"], ["a > b"], [table], [(figure, "<note>"), (figure, "")])
    for name in ("a.html", "b.html"):
        save_page([section], tmp_path / name, "A <title>", answer="yes <no>")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page == (tmp_path / "b.html").read_text(encoding="utf-8")
    assert "<script src=" not in page
    assert "A &lt;title&gt;" in page
    assert "x &amp; y of <code>&lt;z&gt;</code>" in page
    for text in ("yes &lt;no&gt;", "<li>a &gt; b</li>", "&lt;one&gt;", "All &amp; each.", "&lt;note&gt;"):
        assert text in page
    assert page.count('class="plotly-graph-div"') == 2


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError("no space left")])
def test_a_file_is_whole_or_the_one_before_it(stop: Any, tmp_path: Path) -> None:
    (tmp_path / "page").write_text("before")

    def interrupted() -> None:
        with whole_file(tmp_path / "page") as part:
            part.write_text("half")
            raise stop

    with pytest.raises((KeyboardInterrupt, InputError)):
        interrupted()
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("page", "before")]
