"""`workbench loop`: margins of the speed loop over payloads and heights."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import effects_option, numbers_or_none


@click.command(name="loop")
@click.option(
    "--machine",
    type=click.Path(path_type=Path),
    help="A machine.yaml. Default: the scenario's machine, or the built-in one.",
)
@click.option(
    "--scenario", type=click.Path(path_type=Path), help="Scenario that gives machine, controller and payloads."
)
@click.option(
    "--controller", type=click.Path(path_type=Path), help="A file with a controller block, such as the output of tune."
)
@click.option("--payloads", help="Payloads in kg, separated by commas.")
@click.option("--heights", help="Carriage heights in m, separated by commas. Default: bottom, middle, top.")
@click.option(
    "--motion",
    type=click.Choice(["hoisting", "lowering", "forward", "backward", "at_rest"]),
    default="hoisting",
    show_default=True,
    help="Operating point: in motion (saturated friction) or at rest (slope of the friction law). Of an axis forward, "
    "backward.",
)
@click.option("--free-length", is_flag=True, help="Wire stiffness in proportion to 1/free length.")
@click.option("--ms", type=float, default=1.4, show_default=True, help="Bound on Ms shown in the figures.")
@click.option("--out", type=click.Path(path_type=Path), help="New folder for loop.html and loop.json.")
@effects_option
def command(
    machine: Path | None,
    scenario: Path | None,
    controller: Path | None,
    payloads: str | None,
    heights: str | None,
    motion: str,
    free_length: bool,
    ms: float,
    out: Path | None,
) -> None:
    """Compute the stability margins of the sampled speed loop, including the drive's lag, filter and delay."""
    from workbench.analysis.family import family, operating_points
    from workbench.analysis.linearise import STIFFNESS_BY_LENGTH
    from workbench.analysis.tune import Goal
    from workbench.cli.show import print_table, print_text
    from workbench.core.whole_folder import check_free, whole_folder
    from workbench.machines import NO_EFFECTS
    from workbench.study.loop_design import load_case
    from workbench.view import loop as report

    if out is not None:
        check_free(out)
    goal = Goal(ms_limit=ms)
    payloads_kg, heights_m = numbers_or_none(payloads, "payloads"), numbers_or_none(heights, "heights")
    case = load_case(machine, scenario, controller, payloads_kg, heights_m)
    way = {"forward": "hoisting", "backward": "lowering"}.get(motion, motion)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m, way)  # type: ignore[arg-type]
    members = family(case.machine, case.settings, points, effects=STIFFNESS_BY_LENGTH if free_length else NO_EFFECTS)
    print_text([f"Controller {case.origin}: {report.gains_text(case)}.", ""])
    print_table(report.table(members))
    print_text(["", *report.sentences(case, members)])
    if out is not None:
        with whole_folder(out) as folder:
            report.write_loop(case, members, goal.ms_limit, folder)
        click.echo(f"\nFigures: {out / 'loop.html'}\nNumbers: {out / 'loop.json'}")
