"""Small numbers in a text, as people write them."""

from __future__ import annotations

import pytest

from workbench.core.names import powers


@pytest.mark.parametrize(
    ("python", "people"),
    [
        ("8.2e-05 N m", "82·10⁻⁶ N m"),
        ("82.0e-6 and 1.2e-6", "82.0·10⁻⁶ and 1.2·10⁻⁶"),
        ("from 0.0012 to 8e-05.", "from 0.0012 to 80·10⁻⁶."),
        ("-5.03e-08", "-50.3·10⁻⁹"),
        ("2.5e+05 of 89.0e9", "250000 of 89.0·10⁹"),
        ("1.5e-4", "0.00015"),
    ],
)
def test_a_number_in_powers_of_ten_keeps_value_and_digits(python: str, people: str):
    assert powers(python) == people


def test_names_are_left_alone():
    assert powers("run_2e3, a2e5, 2e5b and 1.2.3e4") == "run_2e3, a2e5, 2e5b and 1.2.3e4"
