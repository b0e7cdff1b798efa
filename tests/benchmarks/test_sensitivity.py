"""The verdict's numbers: all are listed with their reason, one is changed everywhere, answers are counted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks import sensitivity
from benchmarks.sensitivity import Number, changed, numbers
from workbench.diagnose.hypotheses import evidence, settings
from workbench.diagnose.verdict import judge

PAGE = sensitivity.ROOT / "benchmarks" / "verdict_numbers.md"


def the(name: str, place: str = "settings") -> Number:
    (one,) = (number for number in numbers() if number.name == name and number.place.endswith(place))
    return one


def test_every_number_of_the_verdict_has_a_reason_and_a_line_on_the_page():
    listed = numbers()
    assert {"threshold", "temperature", "UNDONE", "SECOND", "BINS"} <= {number.name for number in listed}
    assert [number.key for number in listed if not number.reason] == []
    page = PAGE.read_text(encoding="utf-8")
    command = "python -m benchmarks.sensitivity FOLDERS --out ANSWERS --page benchmarks/verdict_numbers.md"
    assert [number.key for number in listed if f"| {number.name} |" not in page] == [], f"make it anew: {command}"


def test_a_changed_number_is_another_one_wherever_the_diagnosis_reads_it_and_comes_back():
    kept = settings.LAW
    with changed(the("LAW"), 0.5):
        assert evidence.settings.LAW == judge.settings.LAW == pytest.approx(0.5 * kept)
    assert evidence.settings.LAW == judge.settings.LAW == kept
    threshold = settings.calibration()["threshold"]
    with changed(the("threshold", "json"), 2.0):
        assert settings.calibration()["threshold"] == 2.0 * threshold
    assert settings.calibration()["threshold"] == threshold


def test_whole_numbers_stay_whole():
    assert the("BINS", "unknown_cause").times(0.7) == 17
    assert Number("", "N", 1, "").times(0.3) == 1


def test_the_table_counts_what_other_numbers_would_have_answered(tmp_path: Path):
    rows = [
        {"folder": f"set/00{k}", "label": {"effects": ["heave"], "where": []}, "word": "x", "names": [], "alike": []}
        for k in range(3)
    ]

    def said(word: str, names: list[str], probability: float, alike: list[str]) -> dict[str, Any]:
        return {"word": word, "names": names, "alike": alike, "ranking": [[word, names, probability]], "twins": []}

    good, bad = said("named", ["heave"], 0.9, []), said("no_gap", [], 0.8, [])
    alike = said("named", ["torque_scale"], 0.9, ["heave"])
    number = Number("workbench.diagnose.verdict.judge", "UNDONE", 0.15, "why")
    answers = {
        "set_000": {"as it is": [good], number.key: [bad, good]},
        "set_001": {"as it is": [good], number.key: [bad, alike]},
        "set_002": {},  # was refused
    }
    made = sensitivity.table(rows, answers, [number])
    assert made.rows[0] == ["UNDONE", "verdict.judge", "0.15", "why", "0, 0 of 2; 0.800", "1, 2 of 2; 0.400", "2 of 2"]
    assert "2, 2 of 2; 0.100" in made.note
    page = tmp_path / "page.md"
    page.write_text(f"# Numbers\n\n{sensitivity.BEGIN}\nold\n")
    sensitivity.write(page, made)
    assert page.read_text().startswith(f"# Numbers\n\n{sensitivity.BEGIN}\n\n| number |")
    assert "old" not in page.read_text() and "| UNDONE |" in page.read_text()
