"""A command of the command line, made from a function's signature; the parameters that several commands share.

    @command("loop", effects=True)
    def loop(*, machine: MachineFile = None, ms: float = 1.4) -> None:
        '''Compute the margins.

        ms: Bound on Ms shown in the figures.
        '''

A parameter before the `*` is an argument, one behind it an option: its help is the docstring's line that begins with
its name. `Annotated` holds beside the type: the option's name where it is not the parameter's (it begins with --), its
help where several commands share it, a type of click's such as a range, further settings of click's as a dict.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import click

from workbench.core.errors import InputError, nearest
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS

UNITS = ("_hz", "_kg", "_m", "_s")  # what a library's parameter is called beyond its option

Measured = Annotated[Path, {"metavar": "CAMPAIGN"}]
MachineFile = Annotated[Path | None, "A machine.yaml. Default: the scenario's machine, or the built-in one."]
OtherMachine = Annotated[Path | None, "Another machine.yaml, such as an identified one."]
Cluster = Annotated[
    str | None, "Run on Dask: tcp://host:port, or local:N for N local processes.", {"metavar": "ADDRESS"}
]
MostEffects = Annotated[int, click.IntRange(1, MOST_EFFECTS), "Largest number of effects that may be missing at once."]
Runs = Annotated[str | None, "Names of the runs to use, separated by commas. Default: all."]
Band = Annotated[float | None, "Band of the torque residual (-3 dB) in Hz. Default: from the machine."]
Payloads = Annotated[str | None, "Payloads in kg, separated by commas."]
Heights = Annotated[str | None, "Carriage heights in m, separated by commas. Default: bottom, middle, top."]


def command(name: str, *, effects: bool = False) -> Callable[[Callable[..., Any]], click.Command]:
    """The function as a command. effects: also takes `--effects FILE`, loaded before anything else is read."""

    def made(function: Callable[..., Any]) -> click.Command:
        hints = get_type_hints(function, include_extras=True)
        parameters = inspect.signature(function).parameters
        text, helps = inspect.getdoc(function) or "", dict[str, str]()
        for found in re.finditer(r"^(\w+): (.+(?:\n +.+)*)\n?", text, re.MULTILINE):
            if found[1] in parameters:
                helps[found[1]] = " ".join(found[2].split())
                text = text.replace(found[0], "")
        text = text.rstrip()
        params = [_param(p, hints[p.name], helps.get(p.name, "")) for p in parameters.values()]
        if any(param.metavar and param.metavar.rstrip(".") == "CAMPAIGN" for param in params):
            from workbench.logs.formats.opening import listed

            text += f"\n\nCAMPAIGN is a folder with machine.yaml, runs.yaml and logs ({listed()})."
        if effects:
            params.append(
                click.Option(
                    ["--effects", "effects_files"],
                    multiple=True, type=click.Path(path_type=Path), metavar="FILE", callback=_load, expose_value=False,
                    is_eager=True, help="Python file with your own effects, see docs/effects.md; may be repeated.",
                )
            )  # fmt: skip
        return click.Command(name, callback=function, params=params, help=text)

    return made


def _param(parameter: inspect.Parameter, hint: Any, said_of: str) -> click.Parameter:
    hint, *said = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    words = [word for word in said if isinstance(word, str)]
    more: dict[str, Any] = next((setting for setting in said if isinstance(setting, dict)), {})
    several = get_origin(hint) is tuple
    (kind, *_) = [part for part in get_args(hint) if part is not NoneType] or [hint]
    if get_origin(hint) is Literal:
        kind = hint
    given = next((setting for setting in said if isinstance(setting, click.ParamType)), None)
    kind = given or (click.Choice(get_args(kind)) if get_origin(kind) is Literal else kind)
    kind = click.Path(path_type=Path) if kind is Path else kind
    needed = parameter.default is inspect.Parameter.empty
    default = None if needed else parameter.default
    more |= {"required": True} if needed else {"default": default}  # a default of None is one, and nothing were missing
    if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
        return click.Argument([parameter.name], type=kind, nargs=-1 if several else 1, **more)
    name = next((word for word in words if word.startswith("--")), f"--{parameter.name.replace('_', '-')}")
    text = said_of or next(word for word in words if not word.startswith("--"))
    if kind is bool:
        return click.Option([name, parameter.name], is_flag=True, help=text)
    shown = default not in (None, (), "")
    return click.Option([name, parameter.name], type=kind, multiple=several, show_default=shown, help=text, **more)


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


def names_in(text: str | None) -> list[str]:
    """The names in a text with commas between."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


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
