"""`workbench report`, figures and what makes them legible, no button that uploads, windows of the gap."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support import axes, browser
from tests.support.scenario_text import GOOD
from tests.support.simulated_campaign import simulated_campaign
from workbench.analysis.loop import StepResponse
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_file
from workbench.diagnose.diagnose import diagnose
from workbench.logs import read_campaign
from workbench.machines import default_hoist, kind_of
from workbench.metrics import fixed_columns
from workbench.references.kind import by_name
from workbench.simulate.driven import InverseSimulation
from workbench.study.load import load_study
from workbench.study.run import StudyResult
from workbench.study.store import place_for, read_finished, run_batch
from workbench.view.diagnosis import where_sentence
from workbench.view.identify import correlation_matrix
from workbench.view.loop import load_for
from workbench.view.page import Section, save_page
from workbench.view.panels import PASSES, STRAIGHT, straightened, thin
from workbench.view.study import conclusions, figures_of, what_was_run, write_study_report
from workbench.view.study_figures import peak_torque_over_payload, plane
from workbench.view.style import GROUND, LINES, SPARE, line, on_dark

if TYPE_CHECKING:
    from playwright.sync_api import Page


SCENARIO = GOOD + "description: What is asked.\nsettle_s: 3.0\n"
SWEEP = """\
sweep:
  limits.acceleration_m_s2: [0.3, 0.5, 0.7]
  limits.jerk_m_s3: {from: 0.4, to: 6.4, steps: 5, scale: log}
outputs: {signals: none}
"""
GAINS = """\
sweep:
  controller.kp_nm_s_per_rad: [15, 31]
  controller.anti_windup: [back_calculation, conditional]
"""


class Written(HTMLParser):
    """The words outside scripts, the cells of each table, and whatever would be fetched from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self._inside = "", ""
        self.tables: list[list[list[str]]] = []
        self.foreign: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self._inside = tag
        self.foreign += [value for name, value in attrs if name in ("src", "href") and value]
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside in ("td", "th"):
            self.tables[-1][-1].append(data)
        if self._inside not in ("script", "style"):
            self.words += data


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of SCENARIO and more, run once."""
    base, known = tmp_path_factory.mktemp("results"), dict[str, Path]()

    def made(more: str = "") -> Path:
        if more not in known:
            file = base / f"{len(known)}.yaml"
            file.write_text(SCENARIO + more, encoding="utf-8")
            study = load_study(file)
            run_batch(study, place_for(study, base / f"{len(known)}"))
            known[more] = base / f"{len(known)}"
        return known[more]

    return made


@pytest.fixture
def copy(results, tmp_path: Path) -> Path:
    return Path(shutil.copytree(results(""), tmp_path / "copy"))


def titles(result: StudyResult) -> list[str]:
    return [figure.layout.title.text for figure, _ in figures_of(result)]


def what(result: StudyResult) -> dict[str, str]:
    return {line[0]: line[1] for line in what_was_run(result).rows}


def test_the_page_stands_in_the_results_and_needs_nothing_else(copy: Path, commands) -> None:
    done = commands("report", copy)
    assert done.status == 0
    page = Written((copy / "report.html").read_text(encoding="utf-8"))
    assert page.foreign == []
    # Two references at either payload, the criteria and their sum, what is used of machine and drive; then four runs:
    # each with a head.
    assert [len(lines) for lines in page.tables[:7]] == [3, 3, 13, 7, 5, 5, 5]
    assert "What is asked." in page.words
    assert "Take the trapezoid with acceleration" in page.words
    assert f"Report: {copy / 'report.html'}" in done.out
    assert "Take the trapezoid with acceleration" in done.out
    assert max(map(len, done.out.splitlines())) <= 100


def test_a_sweep_of_limits_has_its_fronts_with_the_knee_named_and_no_curves_without_signals(results) -> None:
    result = read_finished(results(SWEEP))
    assert titles(result) == [
        "Move time against torque peak per motor",
        "Move time against wire tension swing",
        "Over acceleration",
        "Over jerk",
    ]
    front = figures_of(result)[0][0]
    assert sum(1 for trace in front.data if trace.name == "knee") == 2  # a panel a payload
    assert sum("knee" in note.text for note in front.layout.annotations) == 2
    assert any("the knee of move time against torque peak per motor is" in text for text in conclusions(result))


def test_the_same_result_gives_the_same_bytes(results, tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        write_study_report(read_finished(results(GAINS)), tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_a_study_whose_runs_all_failed_has_a_page_that_says_why(results, tmp_path: Path) -> None:
    result = read_finished(results(""))
    lost = tuple(
        replace(row, status="failed", reason="ran away", metrics=dict.fromkeys(row.metrics)) for row in result.rows
    )
    write_study_report(replace(result, rows=lost, folder=tmp_path), tmp_path / "lost.html")
    words = Written((tmp_path / "lost.html").read_text(encoding="utf-8")).words
    assert "0kg_ruckig failed: ran away." in words and "1 more of 4 runs failed" in words


def test_a_result_of_an_older_version_without_the_newer_metrics_still_has_a_report(results, tmp_path: Path) -> None:
    result = read_finished(results(SWEEP))
    kept = {*fixed_columns(), "moves", "hold_torque_nm", "slack_events"}
    old = tuple(replace(row, metrics={k: v for k, v in row.metrics.items() if k in kept}) for row in result.rows)
    write_study_report(replace(result, rows=old), tmp_path / "old.html")
    assert "knee" in Written((tmp_path / "old.html").read_text(encoding="utf-8")).words


def test_the_names_of_the_limits_over_payload_stand_where_the_peaks_are_least():
    figure = peak_torque_over_payload(np.array([0.0, 9000.0]), {"trapezoid": np.array([340.0, 490.0])}, 480.0, 768.0)
    assert {(note.text, note.x, note.xanchor) for note in figure.layout.annotations} >= {
        ("nominal 480 N m", 0, "left"), ("limit 768 N m", 0, "left"),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: (f / "manifest.json").unlink(), "is no finished result of a study"),
        (lambda f: (f / "manifest.json").write_text('{"for'), "is no finished result of a study"),
        (lambda f: ((f / "manifest.json").unlink(), (f / "chunks").mkdir()), "is not finished"),
        (lambda f: (f / "index.parquet").unlink(), "index.parquet: no such file"),
        (lambda f: (f / "index.parquet").write_bytes(b"PAR1"), "index.parquet: is not what was written"),
        (lambda f: (f / "machine.yaml").unlink(), "machine.yaml"),
        (lambda f: (f / "scenario.yaml").unlink(), "scenario.yaml: no such file"),
        (lambda f: (f / "scenario.yaml").write_text("a: ["), "scenario.yaml: is not what was written"),
        (lambda f: shutil.rmtree(f), "no such folder, expected a folder that `workbench study` made"),
    ],
)
def test_a_result_that_is_not_whole_is_refused_in_one_line(copy: Path, commands, spoil, said: str) -> None:
    spoil(copy)
    done = commands("report", copy)
    assert done.status == 2
    assert said in done.err and str(copy) in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not (copy / "report.html").exists()


def test_a_manifest_that_counts_other_runs_is_refused(copy: Path) -> None:
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["runs"]["all"] = 5
    (copy / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"holds 4 runs, its manifest\.json says 5"):
        read_finished(copy)


def test_a_report_replaces_a_report_and_no_other_file(copy: Path, tmp_path: Path, commands) -> None:
    out = tmp_path / "mine.html"
    assert commands("report", copy, "--out", out).status == 0
    assert commands("report", copy, "--out", out).status == 0
    out.write_text("<html>notes</html>")
    done = commands("report", copy, "--out", out)
    assert done.status == 2 and "is there and is no report; nothing is overwritten" in done.err
    assert out.read_text() == "<html>notes</html>"
    done = commands("report", copy, "--out", tmp_path)
    assert done.status == 2 and "is a folder" in done.err


def test_sentences_are_plain_text_and_hold_no_marks_of_markdown():
    templates = sorted((Path(__file__).parents[2] / "workbench").rglob("*_words.j2"))
    assert len(templates) > 5
    for template in templates:
        said = re.sub(r"\{#.*?#\}", "", template.read_text(encoding="utf-8"), flags=re.DOTALL)
        assert "`" not in said, template.name


# Figures carry the data they are given, keep peaks and colours, and make one page that needs no network.


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


# What makes figures of small and of turning machines legible.


TURNING = axes.two_inertia()


def contrast(one: str, other: str) -> float:
    """WCAG 2.2: (L1 + 0.05)/(L2 + 0.05) of the relative luminances of two sRGB colours."""

    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted(luminance(colour) + 0.05 for colour in (one, other))
    return light / dark


@pytest.mark.parametrize("name", [*by_name(), *LINES, *(f"spare {k}" for k in range(len(SPARE)))])
def test_every_line_is_seen_on_both_grounds(name: str):
    number = int(name.split()[1]) if name.startswith("spare") else 0
    colour = line(name, number)["color"]
    assert contrast(colour, "#FFFFFF") >= 3.0 and contrast(on_dark(colour), GROUND) >= 3.0


@pytest.mark.parametrize(("fastest", "step"), [(0.5, 1.0), (270.0, 1e-3), (2.7e6, 1e-7)])
def test_a_load_step_leaves_an_axis_speed_below_one_unit(fastest: float, step: float):
    kind = kind_of(TURNING)
    answer = StepResponse(np.array([0.0, 1.0]), {kind.looped.speed: np.array([0.0, -fastest])})
    assert load_for(kind, [answer]) == pytest.approx(step) and fastest * step <= 1.0


# No figure can be sent to Plotly's cloud: the buttons of each kind of output, looked at in a browser.


# Where a figure would send itself.
SERVER = "() => document.querySelector('.js-plotly-plot')._context.plotlyServerURL"


def figure() -> Any:
    from plotly.graph_objects import Figure

    return Figure({"data": [{"y": [1.0, 2.0]}]})


def looked_at(page: Page, file: Path, empty: bool = True) -> None:
    page.goto(file.as_uri())
    page.wait_for_selector(".modebar-btn", state="attached")
    titles = page.evaluate(browser.BUTTONS)
    assert titles and not [title for title in titles if "hare" in title or "loud" in title], titles
    if empty:
        assert page.evaluate(SERVER) == ""


def test_a_figure_of_plain_plotly_has_the_button_that_is_looked_for(chromium, tmp_path: Path):
    page = chromium.new_page()
    figure().write_html(tmp_path / "plain.html", include_plotlyjs=True)
    page.goto((tmp_path / "plain.html").as_uri())
    page.wait_for_selector(".modebar-btn", state="attached")
    assert any("Share" in title for title in page.evaluate(browser.BUTTONS))
    page.close()


def test_reports_and_studies_have_no_button_that_uploads(chromium, tmp_path: Path):
    from workbench.study.load import load_study
    from workbench.study.run import run_study
    from workbench.view.study import save_study_page

    page = chromium.new_page()
    save_page([Section(figures=[(figure(), "")])], tmp_path / "report.html", "report")
    looked_at(page, tmp_path / "report.html")
    study = load_study(Path(__file__).resolve().parents[2] / "scenarios" / "jog.yaml")
    save_study_page(run_study(study), tmp_path / "study.html")
    looked_at(page, tmp_path / "study.html")
    page.close()


def test_a_notebooks_figure_has_no_button_that_uploads(chromium, tmp_path: Path):
    from plotly.io import renderers
    from plotly.offline import get_plotlyjs

    import workbench

    cell = renderers["notebook"].to_mimebundle(workbench.loop().plot().to_dict())["text/html"]
    # The library is what the notebook has loaded by itself.
    page_of = f"<!doctype html><head><script>{get_plotlyjs()}</script></head><body>{cell}</body>"
    (tmp_path / "cell.html").write_text(page_of, encoding="utf-8")
    page = chromium.new_page()
    looked_at(page, tmp_path / "cell.html", empty=False)
    page.close()


# What the report says of where a gap lies, held against the machine that the runs were simulated on.


TRUTHS = {
    "friction_viscous": {"viscous_n_s_per_m": 4210.0},
    "friction_position_dependent": {"peak_n": 5000.0, "centre_m": 9.8, "width_m": 0.3},
}


@pytest.mark.parametrize("effect", TRUTHS)
def test_the_windows_hold_the_stated_share_of_what_the_true_effect_takes(effect: str, tmp_path: Path):
    """The true effect's torque is that of two machines under the logged motion, with and without it: no fit."""
    machine = default_hoist()
    truth = machine.model_copy(update={"effects": {effect: TRUTHS[effect]}})
    campaign = read_campaign(simulated_campaign(tmp_path / "lifts", truth))
    d = diagnose(campaign, candidates=(effect, "gearbox_inertia"), most_effects=1, study=False)
    assert d.verdict.effects == (effect,) and d.where is not None
    ill, well = (InverseSimulation(m, campaign.runs, d.gap.band_hz).balances() for m in (truth, machine))
    inside = total = 0.0
    for run, one, other in zip(campaign.runs, ill, well, strict=True):
        energy = np.where(one.moving, (one.predicted - other.predicted) ** 2, 0.0)
        mine = [w for w in d.where.windows if w.run == run.name]
        marked = np.any([(run.time_s >= w.from_s) & (run.time_s <= w.to_s) for w in mine] or [run.time_s < 0.0], axis=0)
        inside, total = inside + float(energy[marked].sum()), total + float(energy.sum())
    low, high = d.where.interval
    assert low - 0.05 <= inside / total <= high + 0.05
    assert f"{100.0 * d.where.share:.0f} % of what the runs leave without it, all else equal" in where_sentence(d)
    assert abs(inside / total - d.where.share) < 0.1
