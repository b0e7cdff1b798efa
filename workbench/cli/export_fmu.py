"""`workbench export-fmu`: a machine as a functional mock-up unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from workbench.cli.options import effects_option, keyed_number
from workbench.core.errors import InputError


@click.command(name="export-fmu")
@click.argument("machine", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New file, such as hoist.fmu.")
@click.option("--payload", type=float, default=0.0, show_default=True, help="Payload at the start, in kg.")
@click.option("--start-position", type=float,
              help="Height (position) at the start, in m (rad). Default: mid rail; 0 for an axis.")  # fmt: skip
@click.option("--effect", "effects", multiple=True, metavar="NAME.PARAMETER=VALUE",
              help="Effect to add to those of MACHINE, or to change; may be repeated.")  # fmt: skip
@click.option("--with-controller", "controller", type=click.Path(path_type=Path), help="A file with a controller "
              "block, such as the output of tune: the sampled speed loop goes into the FMU.")  # fmt: skip
@click.option("--fmi", type=click.Choice(["3.0", "2.0"]), default="3.0", show_default=True, help="FMI version.")
@click.option("--platforms", metavar="NAMES", help="Platforms of the binaries, separated by commas, or 'none'. "
              "Default: all that can be compiled here.")  # fmt: skip
@click.option("--step", type=float, help="Largest internal step in s. Default: 0.001 for a hoist, 0.0002 for an axis.")
@effects_option
def command(machine: Path, out: Path, controller: Path | None, fmi: Any, **given: Any) -> None:
    """Write MACHINE, a machine.yaml or `default` for the built-in hoist, as an FMU for co-simulation.

    The input is the motor torque (force), or the speed reference with --with-controller; the outputs are all signals.
    The FMU contains its C sources and binaries: for Linux, Windows and macOS if the extra 'fmu' is installed, otherwise
    for this computer, compiled by its own C compiler.
    """
    from workbench.cli.show import print_text
    from workbench.control.settings import read_controller
    from workbench.effects import check
    from workbench.export.fmu import write_fmu
    from workbench.export.model import Start, model_of
    from workbench.machines import default_hoist, load_machine

    settings = None if controller is None else read_controller(controller)
    built_in = str(machine) == "default" and not machine.exists()
    read = default_hoist() if built_in else load_machine(machine, check_effects=check)
    effects: dict[str, dict[str, float]] = {}
    for word in given["effects"]:
        key, number = keyed_number(word, "effect", "NAME.PARAMETER=VALUE", parts=2)
        effect, _, parameter = key.partition(".")
        effects.setdefault(effect, {})[parameter] = number
    start = Start(given["payload"], given["start_position"])
    model = model_of(read, start, effects, settings, given["step"])
    made = write_fmu(model, out, fmi, _platforms(given["platforms"]), lambda line: click.echo(line, err=True))
    binaries = f"binaries for {', '.join(made)}" if made else "no binaries"
    said = f"{model.name}: {model.description}, FMI {fmi}, {len(model.variables)} variables, {binaries}."
    print_text([said, *model.notes])
    click.echo(f"\nFMU: {out}")


def _platforms(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between; `none`: no binaries; None stays None: all that can be compiled."""
    if text is None or text.strip() == "none":
        return None if text is None else ()
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise InputError(f"'{text}', expected names with commas between, or 'none'", place="platforms")
    return names
