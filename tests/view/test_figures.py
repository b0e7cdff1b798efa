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
from workbench.view.identify import correlation_matrix
from workbench.view.page import Section, save_page
from workbench.view.panels import PASSES, STRAIGHT, straightened, thin
from workbench.view.study_figures import plane


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


def test_the_plane_keeps_the_corners_of_a_long_path() -> None:
    time = np.linspace(0.0, 40.0, 40_001)
    torque = np.where(np.abs(time - 20.0) < 0.0006, 900.0, 400.0 + 50.0 * np.sin(time))
    signals = {"speed_motor_rad_s": 145.0 * np.sin(time / 5.0), "torque_motor_nm": 2.0 * torque}
    figure = plane([("ruckig", Run("x", time, signals, 0.0))], default_hoist())
    path = next(t for t in figure.data if t.name == "ruckig, same limits")
    assert len(path.x) < 2000
    assert path.y.max() == pytest.approx(900.0)
    assert path.x.max() == pytest.approx(145.0, rel=1e-4)


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
