"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from workbench.core.errors import InputError, nearest

UNITS = ("_hz", "_kg", "_m", "_s")  # what a library's parameter is called beyond its option

Command = TypeVar("Command", bound=Callable[..., Any])


def campaign_argument(command: Command, name: str = "campaign", many: bool = False) -> Command:
    """CAMPAIGN, and the sentence of the help that says what it is, with the log formats that are read."""
    from workbench.logs.formats.known import listed

    folder = f"a folder with machine.yaml, runs.yaml and logs ({listed()})"
    command.__doc__ = f"{(command.__doc__ or '').rstrip()}\n\n    CAMPAIGN is {folder}.\n    "
    where = click.Path(path_type=Path)
    return click.argument(name, type=where, nargs=-1 if many else 1, required=True, metavar="CAMPAIGN" + "..." * many)(
        command
    )


def campaigns_argument(command: Command) -> Command:
    """One CAMPAIGN or several, as `campaigns`."""
    return campaign_argument(command, "campaigns", many=True)


def options(*chosen: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Several options as one decorator, in the order in which the help lists them."""

    def decorated(command: Command) -> Command:
        for option in reversed(chosen):
            command = option(command)
        return command

    return decorated


# What replay, identify and diagnose ask of a campaign alike.
of_a_campaign = options(
    click.option("--runs", help="Names of the runs to use, separated by commas. Default: all."),
    click.option("--machine", type=click.Path(path_type=Path), help="Another machine.yaml, such as an identified one."),
    click.option("--band", type=float, help="Band of the torque residual (-3 dB) in Hz. Default: from the machine."),
)


def effects_option(command: Command) -> Command:
    """`--effects FILE`: loads a user's effects before the command reads anything else.

    The command itself takes no argument for it. InputError as `workbench.effects.load_effects`.
    """
    return click.option(
        "--effects",
        "effects_files",
        multiple=True,
        type=click.Path(path_type=Path),
        metavar="FILE",
        callback=_load,
        expose_value=False,
        is_eager=True,
        help="Python file with your own effects, see docs/effects.md; may be repeated.",
    )(command)


def _load(context: click.Context, option: click.Parameter, files: tuple[Path, ...]) -> None:
    if not files or context.resilient_parsing:
        return
    from workbench.effects import load_effects

    for file in files:
        load_effects(file)


def numbers_or_none(text: str | None, parameter: str) -> tuple[float, ...] | None:
    """The numbers of an option such as `0,4500,9000`; None where it is not given."""
    from workbench.study.loop_design import numbers

    return None if text is None else numbers(text, parameter)


def keyed_number(word: str, place: str, form: str = "KEY=VALUE", parts: int = 1) -> tuple[str, float]:
    """Key and number of a word such as `a.b=4.2`. parts: of the key, with points between. InputError otherwise."""
    key, _, value = word.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    names = key.strip().split(".", parts - 1)
    if not (len(names) == parts and all(names) and math.isfinite(number)):
        raise InputError(f"'{word}', expected {form}", place=place)
    return key.strip(), number


def placed_at_option(error: InputError, options: Sequence[click.Parameter]) -> InputError:
    """The error with the option's name as its place, where the library named the parameter behind it.

    `free` is `--free`, `band_hz` is `--band`; what stands in a file keeps its own place.
    """
    if error.file is not None or error.place is None:
        return error
    parameter = next((error.place.removesuffix(unit) for unit in UNITS if error.place.endswith(unit)), error.place)
    for option in options:
        if option.param_type_name == "option" and option.name in (error.place, parameter):
            return InputError(error.problem, place=option.opts[0])
    return error


class NamedGroup(click.Group):
    """A group whose errors name the nearest command, and the option behind a parameter that the library names."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        known = self.list_commands(ctx)
        if args[0] not in known and not args[0].startswith("-"):
            ctx.fail(f"unknown command '{args[0]}'; {nearest(args[0], known)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except InputError as error:
            command = self.get_command(ctx, ctx.invoked_subcommand or "")
            raise placed_at_option(error, command.params if command else ()) from error
