"""Words of the command line: numbers by key, and errors of the library that name the option typed."""

from __future__ import annotations

import click
import pytest

from workbench.cli.options import keyed_number, placed_at_option
from workbench.core.errors import InputError

OPTIONS = [click.Option(["--band"]), click.Option(["--max-regression", "limits"]), click.Argument(["campaign"])]


def place(error: InputError) -> str | None:
    return placed_at_option(error, OPTIONS).place


def test_a_parameter_becomes_the_option_behind_it_whatever_its_unit() -> None:
    assert place(InputError("too low", place="band_hz")) == "--band"
    assert place(InputError("no limit", place="limits")) == "--max-regression"


def test_what_no_option_holds_keeps_its_place() -> None:
    assert place(InputError("too low", place="speed_hz")) == "speed_hz"
    assert place(InputError("is an argument", place="campaign")) == "campaign"
    assert place(InputError("no place")) is None


def test_a_place_in_a_file_is_no_option() -> None:
    error = InputError("too low", file="scenario.yaml", line=3, place="limits")
    assert placed_at_option(error, OPTIONS) is error


def test_a_word_of_key_and_number_is_read_and_any_other_is_one_line():
    assert keyed_number(" guide.coulomb_hoisting_n = 9e3", "limits") == ("guide.coulomb_hoisting_n", 9000.0)
    assert keyed_number("heave.amplitude_m=-0.2", "effect", "NAME.PARAMETER=VALUE", parts=2)[1] == -0.2
    for word, parts in [("heavy", 1), ("=3", 1), ("a=nan", 1), ("a=3", 2), ("a.=3", 2), (".b=3", 2), ("a.b=x", 2)]:
        with pytest.raises(InputError, match=f"^limits: '{word}', expected KEY=VALUE$"):
            keyed_number(word, "limits", parts=parts)
