"""The verdict's numbers: all are listed with their reason, one is changed everywhere, answers are counted."""

from __future__ import annotations

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
    assert {"threshold", "temperature", "LAW", "HALF", "LOUD"} <= {number.name for number in listed}
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
