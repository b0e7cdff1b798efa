"""Sentences in the terminal: wrapped to its width, a number never parted from its unit."""

from __future__ import annotations

import pytest

from workbench.cli.show import WIDTH, filled

UNITS = ("N m", "N m s/rad", "m/s³", "m/s²", "rad/s", "kN", "kg", "s", "%", "Hz")


@pytest.mark.parametrize("unit", UNITS)
def test_a_number_keeps_its_unit_wherever_the_line_ends(unit: str) -> None:
    for length in range(60, 110):
        text = f"{'x' * (length - 20)} goes from -297.5 {unit} to 317 {unit} with more to say"
        shown = filled(text)
        assert " ".join(shown.split("\n")) == text
        assert shown.count(f" -297.5 {unit}") + shown.count(f"\n-297.5 {unit}") == 1
        assert max(map(len, shown.splitlines())) <= WIDTH
