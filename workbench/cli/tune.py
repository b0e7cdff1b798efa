"""`workbench tune`: gains for a bandwidth, or for the best rejection of load steps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.options import effects_option, numbers_or_none
from workbench.core.errors import InputError

if TYPE_CHECKING:
    from workbench.analysis.tune import Weights


@click.command(name="tune")
@click.option(
    "--machine",
    type=click.Path(path_type=Path),
    help="A machine.yaml. Default: the scenario's machine, or the built-in one.",
)
@click.option(
    "--scenario", type=click.Path(path_type=Path), help="Scenario that gives machine, drive, controller and moves."
)
@click.option("--bandwidth", type=float, help="Closed-loop bandwidth of the slowest payload, in Hz.")
@click.option(
    "--reject", is_flag=True, help="Optimise the rejection of load steps instead (default without --bandwidth)."
)
@click.option("--ms", type=float, default=1.4, show_default=True, help="Upper bound on Ms of the worst payload.")
@click.option(
    "--also",
    type=click.Choice(["notch", "shaper", "schedule"]),
    multiple=True,
    help="Also tune a notch, an input shaper, or gains for each payload (a gain schedule); may be repeated.",
)
@click.option("--payloads", help="Payloads in kg, separated by commas.")
@click.option("--heights", help="Carriage heights in m, separated by commas. Default: bottom, middle, top.")
@click.option(
    "--weights", default="1,2,1", show_default=True, help="Weights of tracking error, torque peak and rms torque."
)
@click.option(
    "--out", type=click.Path(path_type=Path), help="New file for the controller block, to be used in scenarios."
)
@effects_option
def command(
    machine: Path | None,
    scenario: Path | None,
    bandwidth: float | None,
    reject: bool,
    ms: float,
    also: tuple[str, ...],
    payloads: str | None,
    heights: str | None,
    weights: str,
    out: Path | None,
) -> None:
    """Find kp, ki and the set-point weight by loop shaping and by simulation of the nonlinear closed loop.

    All other controller settings, such as filters and feed-forward, stay as in the scenario unless --also names them.
    """
    from workbench.analysis.family import operating_points
    from workbench.analysis.tune import Goal, tune
    from workbench.cli.progress import tuning
    from workbench.cli.show import filled, print_table, print_text
    from workbench.study.loop_design import load_case
    from workbench.view import tune as report

    if reject and bandwidth is not None:
        raise click.UsageError("--bandwidth and --reject are two goals; give one of them")
    goal, weighed = Goal(bandwidth, ms), _weights(weights)
    if out is not None:
        report.check_new(out)
    payloads_kg, heights_m = numbers_or_none(payloads, "payloads"), numbers_or_none(heights, "heights")
    case = load_case(machine, scenario, None, payloads_kg, heights_m)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    with tuning() as tell:
        tuned = tune(case.machine, case.settings, points, case.trial(), goal, weighed, also=also, tell=tell)
    print_table(report.table(tuned))
    print_text(["", *report.sentences(case, tuned, weighed)])
    if (warning := report.warning(case.machine)) is not None:
        click.echo()
        click.secho(filled(warning), bold=True)
    click.echo("\n" + report.controller_text(tuned.winner.settings), nl=False)
    if out is not None:
        report.write_controller(tuned, out, case.machine)
        click.echo(f"\nController: {out}")


def _weights(text: str) -> Weights:
    """`1,2,1` as weights of tracking, peak and effort."""
    from workbench.analysis.tune import Weights

    try:
        weights = [float(part) for part in text.split(",")]
    except ValueError:
        weights = []
    if len(weights) != 3 or min(weights) < 0.0 or not 0.0 < sum(weights) < float("inf"):
        raise InputError(f"'{text}', expected three numbers from 0 up, not all 0, such as 1,2,1", place="weights")
    return Weights(*weights)
