"""`workbench compare-models`: the lumped and the multi-body machine on one torque record, or in one closed loop."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import effects_option


@click.command(name="compare-models")
@click.argument("source", metavar="CAMPAIGN|SCENARIO", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="New folder for models.json and models.html.")
@click.option("--runs", help="Names of the campaign's runs to use, separated by commas. Default: all.")
@click.option("--machine", type=click.Path(path_type=Path), help="Another machine.yaml, such as an identified one.")
@click.option("--step", type=float, default=0.004, show_default=True, help="Step of the multi-body model in s.")
@effects_option
def command(source: Path, out: Path | None, runs: str | None, machine: Path | None, step: float) -> None:
    """Compare the lumped with the multi-body machine on a campaign's torque, or on a scenario's closed loops.

    Prints the errors of both models against the measurement or the reference, the difference between the models,
    where it is largest, and the compute times. Needs the extra 'multibody'.
    """
    from workbench.cli.models_source import comparison_of
    from workbench.cli.show import print_table, print_text
    from workbench.core.errors import InputError
    from workbench.core.whole_folder import check_free
    from workbench.reports.models import report

    if not 1e-4 <= step <= 0.01:
        raise InputError(f"{step:g} s, expected 0.0001 to 0.01 s", place="--step")
    if out is not None:
        check_free(out)
    simulate = comparison_of(source, runs, machine, step)
    compared = simulate() if out is None else report.write_models(simulate, source.name, out)
    print_table(report.table(compared))
    print_text(["", *report.sentences(compared)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'models.html'}\nNumbers: {out / 'models.json'}")
