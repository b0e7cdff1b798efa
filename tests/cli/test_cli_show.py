"""Sentences in the terminal: wrapped to its width, a number never parted from its unit."""

from __future__ import annotations

import re

import pytest

from workbench.cli.show import TIE, WIDTH, filled

UNITS = ("N m", "N m s/rad", "m/s³", "m/s²", "rad/s", "kN", "kg", "s", "%", "Hz")


@pytest.mark.parametrize("unit", UNITS)
def test_a_number_keeps_its_unit_wherever_the_line_ends(unit: str) -> None:
    for length in range(60, 110):
        text = f"{'x' * (length - 20)} goes from -297.5 {unit} to 317 {unit} with more to say"
        shown = filled(text)
        assert " ".join(shown.split("\n")) == text
        assert shown.count(f" -297.5 {unit}") + shown.count(f"\n-297.5 {unit}") == 1
        assert max(map(len, shown.splitlines())) <= WIDTH


def test_words_that_begin_like_a_unit_are_no_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """12 samples are not 12 s: the line may end between them."""
    monkeypatch.setenv("COLUMNS", "100")
    text = f"{'x' * 93} 12 samples"
    assert filled(text).splitlines() == [f"{'x' * 93} 12", "samples"]


def test_what_is_tied_stays_together_and_comes_out_with_plain_blanks() -> None:
    text = " ".join([f"run_{k}{TIE}1{TIE}→{TIE}2," for k in range(30)])
    shown = filled(text, "- ", "  ")
    assert TIE not in shown
    assert re.fullmatch(r"(?:[- ] (?:run_\d+ 1 → 2,[ ]?)+\n?)+", shown)
