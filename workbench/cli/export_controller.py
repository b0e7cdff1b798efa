"""`workbench export-controller`: the tuned controller as code for a PLC or as a drive's parameters."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="export-controller")
@click.argument("controller", type=click.Path(path_type=Path))
@click.option("--as", "form", type=click.Choice(["st", "c", "yaml"]), required=True,
              help="Format: structured text, C99, or a drive's parameters.")  # fmt: skip
@click.option("--drive", type=click.Choice(["siemens-s120", "abb-acs880", "generic"]), default="generic",
              show_default=True, help="Drive whose parameters are written, with --as yaml.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New folder for the files.")
@click.option("--machine", type=click.Path(path_type=Path), help="A machine.yaml. Default: the built-in machine.")
@click.option("--payload", type=float, default=0.0, show_default=True,
              help="Payload in the inertia feed-forward, in kg.")  # fmt: skip
def command(controller: Path, form: str, drive: str, out: Path, machine: Path | None, payload: float) -> None:
    """Write CONTROLLER, a file with a controller block such as the output of tune, for the machine's own controls.

    C99 and structured text include a self-test with recorded inputs and the expected torque. A drive's parameters
    include a list of what its controller does differently. If CONTROLLER is a scenario, its limits give the ramp.
    """
    from workbench.cli.show import print_text
    from workbench.control.settings import read_controller
    from workbench.core.errors import InputError
    from workbench.core.whole_folder import check_free, whole_folder
    from workbench.effects import check
    from workbench.export.controller_text import controller_files
    from workbench.export.drives import ramp_of
    from workbench.machines import STUDIED, default_hoist, load_machine, of_kind, studied

    check_free(out)
    settings, ramp = read_controller(controller), ramp_of(controller)
    hoist = default_hoist()
    if machine is not None:
        read = load_machine(machine, check_effects=check)
        if (hoist_read := studied(read)) is None:
            raise InputError(f"is {of_kind(read)}; a controller is exported for {STUDIED}", file=machine)
        hoist = hoist_read
    if not 0.0 <= payload < float("inf"):
        raise InputError(f"{payload:g} kg, expected 0 or more", place="payload_kg")
    files = controller_files(form, settings, hoist, payload, drive, ramp)  # type: ignore[arg-type]
    with whole_folder(out) as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
    if form == "yaml":
        click.echo(files["drive_parameters.yaml"])
    print_text([f"{hoist.name}, samples of {1e3 * settings.sample_time_s:g} ms: {', '.join(sorted(files))}."])
    click.echo(f"\nFolder: {out}")
