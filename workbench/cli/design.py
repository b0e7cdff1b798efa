"""`workbench loop` and `tune`: margins of the speed loop over payloads and heights; gains for a bandwidth."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from workbench.analysis.tune import Goal, Weights
from workbench.cli.options import Heights, MachineFile, Payloads, command, numbers_or_none
from workbench.cli.show import filled, print_table, print_text, tuning
from workbench.core.errors import InputError
from workbench.core.whole_folder import check_free, whole_folder
from workbench.study.loop_design import load_case
from workbench.view import loop as loop_view
from workbench.view import tune as tune_view

Motions = Literal["hoisting", "lowering", "forward", "backward", "at_rest"]
Also = Literal["notch", "shaper", "schedule"]


@command("loop", effects=True)
def loop(
    *,
    machine: MachineFile = None,
    scenario: Path | None = None,
    controller: Path | None = None,
    payloads: Payloads = None,
    heights: Heights = None,
    motion: Motions = "hoisting",
    free_length: bool = False,
    ms: float = 1.4,
    out: Path | None = None,
) -> None:
    """Compute the stability margins of the sampled speed loop, including the drive's lag, filter and delay.

    scenario: Scenario that gives machine, controller and payloads.
    controller: A file with a controller block, such as the output of tune.
    motion: Operating point: in motion (saturated friction) or at rest (slope of the friction law). Of an axis
        forward, backward.
    free_length: Wire stiffness in proportion to 1/free length.
    ms: Bound on Ms shown in the figures.
    out: New folder for loop.html and loop.json.
    """

    check_free(out)
    goal = Goal(ms_limit=ms)
    payloads_kg, heights_m = numbers_or_none(payloads, "payloads"), numbers_or_none(heights, "heights")
    case = load_case(machine, scenario, controller, payloads_kg, heights_m)
    way = {"forward": "hoisting", "backward": "lowering"}.get(motion, motion)
    members = case.members(way, free_length)  # type: ignore[arg-type]
    print_text([f"Controller {case.origin}: {loop_view.gains_text(case)}.", ""])
    print_table(loop_view.table(members))
    print_text(["", *loop_view.sentences(case, members)])
    if out is not None:
        with whole_folder(out) as folder:
            loop_view.write_loop(case, members, goal.ms_limit, folder)
        click.echo(f"\nFigures: {out / 'loop.html'}\nNumbers: {out / 'loop.json'}")


@command("tune", effects=True)
def tune(
    *,
    machine: MachineFile = None,
    scenario: Path | None = None,
    bandwidth: float | None = None,
    reject: bool = False,
    ms: float = 1.4,
    also: tuple[Also, ...] = (),
    payloads: Payloads = None,
    heights: Heights = None,
    weights: str = "1,2,1",
    out: Path | None = None,
) -> None:
    """Find kp, ki and the set-point weight by loop shaping and by simulation of the nonlinear closed loop.

    All other controller settings, such as filters and feed-forward, stay as in the scenario unless --also names them.

    scenario: Scenario that gives machine, drive, controller and moves.
    bandwidth: Closed-loop bandwidth of the slowest payload, in Hz.
    reject: Optimise the rejection of load steps instead (default without --bandwidth).
    ms: Upper bound on Ms of the worst payload.
    also: Also tune a notch, an input shaper, or gains for each payload (a gain schedule); may be repeated.
    weights: Weights of tracking error, torque peak and rms torque.
    out: New file for the controller block, to be used in scenarios.
    """

    if reject and bandwidth is not None:
        raise click.UsageError("--bandwidth and --reject are two goals; give one of them")
    goal, weighed = Goal(bandwidth, ms), _weights(weights)
    if out is not None:
        tune_view.check_new(out)
    payloads_kg, heights_m = numbers_or_none(payloads, "payloads"), numbers_or_none(heights, "heights")
    case = load_case(machine, scenario, None, payloads_kg, heights_m)
    with tuning() as tell:
        tuned = case.tuned(goal, weighed, also, tell)
    print_table(tune_view.table(tuned))
    print_text(["", *tune_view.sentences(case, tuned, weighed)])
    if (warning := tune_view.warning(case.machine)) is not None:
        click.echo()
        click.secho(filled(warning), bold=True)
    click.echo("\n" + tune_view.controller_text(tuned.winner.settings), nl=False)
    if out is not None:
        tune_view.write_controller(tuned, out, case.machine)
        click.echo(f"\nController: {out}")


def _weights(text: str) -> Weights:
    """`1,2,1` as weights of tracking, peak and effort."""

    try:
        weights = [float(part) for part in text.split(",")]
    except ValueError:
        weights = []
    if len(weights) != 3 or min(weights) < 0.0 or not 0.0 < sum(weights) < float("inf"):
        raise InputError(f"'{text}', expected three numbers from 0 up, not all 0, such as 1,2,1", place="weights")
    return Weights(*weights)
