"""`workbench tune`: gains for a bandwidth, or for the best rejection of load steps."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import effects_option


@click.command(name="tune")
@click.option("--machine", type=click.Path(path_type=Path), help="A machine.yaml; the scenario's or the default one.")
@click.option(
    "--scenario", type=click.Path(path_type=Path), help="Take machine, drive, controller and moves from here."
)
@click.option("--bandwidth", type=float, help="Wanted closed-loop bandwidth in Hz, of the slowest payload.")
@click.option("--reject", is_flag=True, help="Best rejection of load steps instead; so without --bandwidth too.")
@click.option("--ms", type=float, default=1.4, show_default=True, help="Largest Ms of the worst payload.")
@click.option("--payloads", help="Payloads in kg, with commas between.")
@click.option("--heights", help="Carriage heights in m, with commas between; bottom, middle and top without it.")
@click.option("--weights", default="1,2,1", show_default=True, help="Of tracking error, torque peak and effort.")
@click.option("--out", type=click.Path(path_type=Path), help="File to make, with a controller block for scenarios.")
@effects_option
def command(
    machine: Path | None,
    scenario: Path | None,
    bandwidth: float | None,
    reject: bool,
    ms: float,
    payloads: str | None,
    heights: str | None,
    weights: str,
    out: Path | None,
) -> None:
    """Find kp, ki and the set-point weight: loop shaping first, then runs of the nonlinear closed loop.

    Everything else of the controller, filters and feed-forward say, stays as the scenario has it.
    """
    from workbench.analysis.family import operating_points
    from workbench.analysis.tune import Goal, tune
    from workbench.cli.show import filled, print_table, print_text
    from workbench.reports.loop import tuning as report
    from workbench.reports.loop.case import load_case

    if reject and bandwidth is not None:
        raise click.UsageError("--bandwidth and --reject are two goals; give one of them")
    goal, weighed = Goal(bandwidth, ms), report.weights_of(weights)
    if out is not None:
        report.check_new(out)
    case = load_case(machine, scenario, None, payloads, heights)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    tuned = tune(case.machine, case.settings, points, case.trial(), goal, weighed)
    print_table(report.table(tuned))
    print_text(["", *report.sentences(case, tuned, weighed)])
    if (said := report.warning(case.machine)) is not None:
        click.echo()
        click.secho(filled(said), bold=True)
    click.echo("\n" + report.controller_text(tuned.winner.settings), nl=False)
    if out is not None:
        report.write_controller(tuned, out, case.machine)
        click.echo(f"\nController: {out}")
