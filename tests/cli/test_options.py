"""A library's error names its parameter; whoever typed an option reads the option's name."""

from __future__ import annotations

import click

from workbench.cli.options import placed_at_option
from workbench.errors import InputError

OPTIONS = [
    click.Option(["--band"]),
    click.Option(["--max-regression", "limits"]),
    click.Argument(["campaign"]),
]


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
