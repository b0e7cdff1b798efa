"""Words of the command line: sentences wrapped to the width, and numbers by key."""

from __future__ import annotations

import pytest

from workbench.cli.options import keyed_number
from workbench.cli.show import WIDTH, filled
from workbench.core.errors import InputError

UNITS = ("N m", "N m s/rad", "m/s³", "m/s²", "rad/s", "kN", "kg", "s", "%", "Hz")


@pytest.mark.parametrize("unit", UNITS)
def test_a_number_keeps_its_unit_wherever_the_line_ends(unit: str) -> None:
    for length in range(60, 110):
        text = f"{'x' * (length - 20)} goes from -297.5 {unit} to 317 {unit} with more to say"
        shown = filled(text)
        assert " ".join(shown.split("\n")) == text
        assert shown.count(f" -297.5 {unit}") + shown.count(f"\n-297.5 {unit}") == 1
        assert max(map(len, shown.splitlines())) <= WIDTH


def test_a_word_of_key_and_number_is_read_and_any_other_is_one_line():
    assert keyed_number(" guide.coulomb_hoisting_n = 9e3", "limits") == ("guide.coulomb_hoisting_n", 9000.0)
    assert keyed_number("heave.amplitude_m=-0.2", "effect", "NAME.PARAMETER=VALUE", parts=2)[1] == -0.2
    for word, parts in [("heavy", 1), ("=3", 1), ("a=nan", 1), ("a=3", 2), ("a.=3", 2), (".b=3", 2), ("a.b=x", 2)]:
        with pytest.raises(InputError, match=f"^limits: '{word}', expected KEY=VALUE$"):
            keyed_number(word, "limits", parts=parts)
