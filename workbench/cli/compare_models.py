"""`workbench compare-models`: the lumped and the multi-body machine on one torque record, or in one closed loop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.options import effects_option

if TYPE_CHECKING:
    from workbench.simulate.models import ModelsCompared

MOST_LOOPS = 12


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
    from workbench.cli.show import print_table, print_text
    from workbench.core.errors import InputError
    from workbench.core.whole_folder import check_free
    from workbench.view import models

    if not 1e-4 <= step <= 0.01:
        raise InputError(f"{step:g} s, expected 0.0001 to 0.01 s", place="--step")
    if out is not None:
        check_free(out)
    simulate = comparison_of(source, runs, machine, step)
    compared = simulate() if out is None else models.write_models(simulate, source.name, out)
    print_table(models.table(compared))
    print_text(["", *models.sentences(compared)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'models.html'}\nNumbers: {out / 'models.json'}")


def comparison_of(source: Path, runs: str | None, machine: Path | None, step_s: float) -> Callable[[], ModelsCompared]:
    """The comparison, to be run when called; all of the input is checked before. InputError as of its readers."""
    from workbench.cli.campaign import load_campaign
    from workbench.core.errors import InputError
    from workbench.machines import of_kind, studied
    from workbench.simulate.models import compare_loops, compare_models
    from workbench.simulate.multibody_loop import check_multibody
    from workbench.study.load import load_study
    from workbench.study.run import case_of

    if source.is_file():
        if runs is not None or machine is not None:
            place = "--runs" if runs else "--machine"
            raise InputError("belongs to a campaign; a scenario names both itself", place=place)
        study = load_study(source)
        check_multibody(study.machine)
        if (many := len(study.specs)) > MOST_LOOPS:
            raise InputError(f"makes {many} runs, expected at most {MOST_LOOPS} to compare one by one", file=source)
        cases = [case_of(spec) for spec in study.specs]
        return lambda: compare_loops(cases, step_s=step_s)
    campaign = load_campaign(source, runs, machine, None)
    hoist = studied(campaign.machine)
    if hoist is None:
        kind = of_kind(campaign.machine)
        raise InputError(f"{kind}; the multi-body machine is a hoist", file=source / "machine.yaml")
    check_multibody(hoist)
    return lambda: compare_models(hoist, campaign.runs, step_s=step_s)
