"""`workbench report`: a finished result becomes one page that needs nothing else; anything else is refused."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.support.scenario_text import GOOD
from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.load import load_study
from workbench.study.run import StudyResult
from workbench.study.store import place_for, read_finished, run_batch
from workbench.view.study import conclusions, figures_of, what_was_run, write_study_report

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


class Page(HTMLParser):
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
    page = Page((copy / "report.html").read_text(encoding="utf-8"))
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
    words = Page((tmp_path / "lost.html").read_text(encoding="utf-8")).words
    assert "0kg_ruckig failed: ran away." in words and "1 more of 4 runs failed" in words


def test_a_result_of_an_older_version_without_the_newer_metrics_still_has_a_report(results, tmp_path: Path) -> None:
    result = read_finished(results(SWEEP))
    kept = {*fixed_columns(), "moves", "hold_torque_nm", "slack_events"}
    old = tuple(replace(row, metrics={k: v for k, v in row.metrics.items() if k in kept}) for row in result.rows)
    write_study_report(replace(result, rows=old), tmp_path / "old.html")
    assert "knee" in Page((tmp_path / "old.html").read_text(encoding="utf-8")).words


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
