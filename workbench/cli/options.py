"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def campaign_argument(command: Command) -> Command:
    """CAMPAIGN, and the sentence of the help that says what it is, with the log formats that are read."""
    from workbench.log_formats import listed

    folder = f"a folder with machine.yaml, runs.yaml and logs ({listed()})"
    command.__doc__ = f"{(command.__doc__ or '').rstrip()}\n\n    CAMPAIGN is {folder}.\n    "
    return click.argument("campaign", type=click.Path(path_type=Path))(command)


def effects_option(command: Command) -> Command:
    """`--effects FILE`: a user's effects are known by name before the command reads anything else.

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
