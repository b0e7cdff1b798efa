"""`workbench export-controller` and `export-fmu`: controller and plant for use without this program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import click

from workbench.cli.options import command, keyed_number, names_in
from workbench.cli.show import print_text
from workbench.control.settings import read_controller
from workbench.core.errors import InputError
from workbench.core.whole_folder import check_free, whole_folder
from workbench.effects import check
from workbench.export.controller_program import controller_files, ramp_of
from workbench.export.fmu import write_fmu
from workbench.export.model import Start, model_of
from workbench.machines import STUDIED, default_hoist, load_machine, of_kind, studied

Form = Literal["st", "c", "yaml"]
Drive = Literal["siemens-s120", "abb-acs880", "generic"]


@command("export-controller")
def export_controller(
    controller: Path,
    *,
    form: Annotated[Form, "--as"],
    drive: Drive = "generic",
    out: Path,
    machine: Path | None = None,
    payload: float = 0.0,
) -> None:
    """Write CONTROLLER, a file with a controller block such as the output of tune, for the machine's own controls.

    C99 and structured text include a self-test with recorded inputs and the expected torque. A drive's parameters
    include a list of what its controller does differently. If CONTROLLER is a scenario, its limits give the ramp.

    form: Format: structured text, C99, or a drive's parameters.
    drive: Drive whose parameters are written, with --as yaml.
    out: New folder for the files.
    machine: A machine.yaml. Default: the built-in machine.
    payload: Payload in the inertia feed-forward, in kg.
    """

    check_free(out)
    settings, ramp = read_controller(controller), ramp_of(controller)
    read = default_hoist() if machine is None else load_machine(machine, check_effects=check)
    if (hoist := studied(read)) is None:
        raise InputError(f"is {of_kind(read)}; a controller is exported for {STUDIED}", file=machine)
    if not 0.0 <= payload < float("inf"):
        raise InputError(f"{payload:g} kg, expected 0 or more", place="payload_kg")
    files = controller_files(form, settings, hoist, payload, drive, ramp)
    with whole_folder(out) as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
    if form == "yaml":
        click.echo(files["drive_parameters.yaml"])
    print_text([f"{hoist.name}, samples of {1e3 * settings.sample_time_s:g} ms: {', '.join(sorted(files))}."])
    click.echo(f"\nFolder: {out}")


@command("export-fmu", effects=True)
def export_fmu(
    machine: Path,
    *,
    out: Path,
    payload: float = 0.0,
    start_position: float | None = None,
    effect: Annotated[tuple[str, ...], {"metavar": "NAME.PARAMETER=VALUE"}] = (),
    with_controller: Path | None = None,
    fmi: Literal["3.0", "2.0"] = "3.0",
    platforms: Annotated[str | None, {"metavar": "NAMES"}] = None,
    step: float | None = None,
) -> None:
    """Write MACHINE, a machine.yaml or `default` for the built-in hoist, as an FMU for co-simulation.

    The input is the motor torque (force), or the speed reference with --with-controller; the outputs are all signals.
    The FMU contains its C sources and binaries: for Linux, Windows and macOS if the extra 'fmu' is installed, otherwise
    for this computer, compiled by its own C compiler.

    out: New file, such as hoist.fmu.
    payload: Payload at the start, in kg.
    start_position: Height (position) at the start, in m (rad). Default: mid rail; 0 for an axis.
    effect: Effect to add to those of MACHINE, or to change; may be repeated.
    with_controller: A file with a controller block, such as the output of tune: the sampled speed loop goes into
        the FMU.
    fmi: FMI version.
    platforms: Platforms of the binaries, separated by commas, or 'none'. Default: all that can be compiled here.
    step: Largest internal step in s. Default: 0.001 for a hoist, 0.0002 for an axis.
    """

    settings = None if with_controller is None else read_controller(with_controller)
    built_in = str(machine) == "default" and not machine.exists()
    read = default_hoist() if built_in else load_machine(machine, check_effects=check)
    effects: dict[str, dict[str, float]] = {}
    for word in effect:
        key, number = keyed_number(word, "effect", "NAME.PARAMETER=VALUE", parts=2)
        name, _, parameter = key.partition(".")
        effects.setdefault(name, {})[parameter] = number
    wanted = None if platforms is None else tuple(names_in(platforms))
    if wanted == ():
        raise InputError(f"'{platforms}', expected names with commas between, or 'none'", place="platforms")
    model = model_of(read, Start(payload, start_position), effects, settings, step)
    wanted = () if wanted == ("none",) else wanted
    made = write_fmu(model, out, fmi, wanted, lambda line: click.echo(line, err=True))
    binaries = f"binaries for {', '.join(made)}" if made else "no binaries"
    said = f"{model.name}: {model.description}, FMI {fmi}, {len(model.variables)} variables, {binaries}."
    print_text([said, *model.notes])
    click.echo(f"\nFMU: {out}")
