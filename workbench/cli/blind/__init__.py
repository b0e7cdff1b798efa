"""`workbench blind`: test the diagnosis on campaigns whose truth is sealed."""

from __future__ import annotations

import importlib

import click

from workbench.cli.options import placed_at_option
from workbench.core.errors import InputError, nearest

PARTS = {
    "make": "Make campaigns and seal what is in them.",
    "run": "Diagnose sealed campaigns; what is answered is kept.",
    "score": "Open the seal and print the score sheet.",
}


class _Parts(click.Group):
    """Imports the part that runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(PARTS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in PARTS:
            return None
        command: click.Command = importlib.import_module(f"workbench.cli.blind.{cmd_name}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in PARTS and not args[0].startswith("-"):
            ctx.fail(f"unknown command '{args[0]}'; {nearest(args[0], PARTS)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """An error of the library names its parameter; here it gets the name of the option."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            part = self.get_command(ctx, ctx.invoked_subcommand or "")
            raise placed_at_option(error, part.params if part else ()) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(PARTS.items()))


@click.group(name="blind", cls=_Parts)
def command() -> None:
    """Test the diagnosis on campaigns whose truth is sealed: make them, diagnose them, open the seal and score.

    With your own machine and runs the score is the power of your experiment. See docs/blind.md.
    """
