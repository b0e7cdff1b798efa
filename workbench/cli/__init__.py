"""The `workbench` command: a table of sub-commands, each imported only when it is called."""

from __future__ import annotations

import contextlib
import gc
import importlib
import logging
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from workbench import __version__
from workbench.cli.options import NamedGroup
from workbench.core.errors import InputError

# name -> (where the click command stands, its line in `workbench --help`), in the order of the work: study, loop, logs,
# plant. So the help imports no numpy or pydantic.
_COMMANDS = {
    "study": ("study:study", "Run scenarios in closed loop; tables and figures."),
    "compare": ("compare:compare", "Compare two results metric by metric; report regressions."),
    "report": ("study:report", "Write the report of a finished study: one HTML page."),
    "size": ("study:size", "Size a hoist's drive for a duty cycle; say what limits."),
    "loop": ("design:loop", "Compute the stability margins of the speed loop."),
    "tune": ("design:tune", "Find controller gains for a bandwidth or best rejection."),
    "replay": ("measured:replay", "Replay measured torque on the model; compare speeds."),
    "identify": ("measured:identify", "Fit friction and masses to a campaign."),
    "diagnose": ("diagnose:diagnose", "Find the missing effect behind a sim-to-real gap."),
    "compare-models": ("compare:compare_models", "Compare the lumped with the multi-body machine."),
    "blind": ("blind:blind", "Test the diagnosis on campaigns whose truth is sealed."),
    "import": ("measured:import_", "Make a campaign of logs as drives write them."),
    "watch": ("watch:watch", "Watch a machine by its logs; say when it has changed."),
    "serve": ("serve:serve", "Run a machine's plant in real time, for a PLC."),
    "export-fmu": ("export:export_fmu", "Write a machine as an FMU, for other simulators."),
    "export-controller": ("export:export_controller", "Write the speed controller for a PLC or a drive."),
    "schema": ("study:schema", "Print a JSON Schema, for completion in an editor."),
    "app": ("app:app", "Open the dashboard in a browser."),
}
COMMANDS = {name: (f"workbench.cli.{where}", line) for name, (where, line) in _COMMANDS.items()}

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
LEAST_ADDRESSES = 2_000_000_000  # bytes; replay of three short runs takes 1.9e9, of which it touches a tenth


class LazyGroup(NamedGroup):
    """A click group that knows its sub-commands by `COMMANDS` and imports the one that runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name][0].split(":")
        if module not in sys.modules:
            gc.disable()  # what modules hold stays: the collector need not go through it, now or later
            try:
                importlib.import_module(module)
            finally:
                gc.freeze()
                gc.enable()
        command = getattr(sys.modules[module], attribute)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name][1]) for name in self.list_commands(ctx)])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="workbench", message="%(prog)s %(version)s")
def cli() -> None:
    """Control-design and what-if studies for a winch-driven pipe-handling machine.

    Every command reads files, prints a table and writes its results to --out. Exit status:
    0 done, 1 the command's own answer is no, 2 bad input, 130 interrupted.
    """


class _Echo(logging.Handler):
    """Messages of the library while it works, such as compiling, as plain lines on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        click.echo(record.getMessage(), err=True)


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit; a command may return its exit status, None is 0.

    What the user can mend ends as one line on stderr and exit status 2; WORKBENCH_DEBUG=1 keeps
    its traceback. Any other exception is a defect of workbench and always shows where it arose.
    """
    words = list(sys.argv[1:] if args is None else args)
    # Matrices here are small, and runs are what is spread over the cores: threads of BLAS only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    log = logging.getLogger("workbench")
    if not any(isinstance(handler, _Echo) for handler in log.handlers):
        log.addHandler(_Echo())
        log.setLevel(logging.INFO)
    try:
        _check_address_space(words)
        status = cli.main(words, prog_name="workbench", standalone_mode=False)
        sys.stdout.flush()
        sys.exit(status if isinstance(status, int) else 0)
    except (click.Abort, KeyboardInterrupt):  # Abort is click's word for Ctrl-C
        click.echo("interrupted", err=True)
        sys.exit(EXIT_INTERRUPTED)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except BrokenPipeError:  # the reader, `head` say, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (InputError, OSError, MemoryError) as error:
        if os.environ.get("WORKBENCH_DEBUG") == "1":
            raise
        with contextlib.suppress(OSError):  # a full disk may hold what stderr is sent to
            click.echo(f"error: {_sentence(error, words)}", err=True)
        sys.exit(EXIT_BAD_INPUT)


def _check_address_space(words: Sequence[str]) -> None:
    """MemoryError where a limit on addresses leaves no room for the compiled libraries: they would abort or hang."""
    if sys.platform == "win32" or not words or words[0] not in COMMANDS or {"-h", "--help"} & {*words}:
        return
    import resource

    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if words[0] != "schema" and most != resource.RLIM_INFINITY and most < LEAST_ADDRESSES:
        raise MemoryError(
            f"the limit of {most / 1e6:.0f} MB of addresses (ulimit -v) is too small, "
            f"expected at least {LEAST_ADDRESSES / 1e6:.0f} MB"
        )


def _sentence(error: InputError | OSError | MemoryError, words: Sequence[str]) -> str:
    """The error in one line, with its path."""
    if isinstance(error, MemoryError):
        said = str(error)
        return said if "ulimit" in said else "not enough memory for this input; try fewer or shorter runs"
    if isinstance(error, InputError):
        return str(error)
    # A full disk is met by write(), which knows no path: then it is --out that cannot be filled.
    path = error.filename if error.filename is not None else _value_of("--out", words)
    reason = error.strerror or str(error).partition("\n")[0] or type(error).__name__
    return f"{path}: {reason}" if path else reason


def _value_of(option: str, words: Sequence[str]) -> str | None:
    for word, following in zip(words, [*words[1:], None], strict=True):
        if word == option:
            return following
        if word.startswith(f"{option}="):
            return word.partition("=")[2]
    return None
