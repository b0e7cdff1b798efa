"""`workbench diagnose`: where the sim-to-real gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.options import campaign_argument, effects_option

if TYPE_CHECKING:
    from workbench.diagnose.diagnose import Diagnosis


@click.command(name="diagnose")
@campaign_argument
@click.option(
    "--out", type=click.Path(path_type=Path), help="New folder for diagnosis.json, machine.yaml and the report."
)
@click.option(
    "--baseline",
    type=click.Choice(["tolerances", "nominal"]),
    default="tolerances",
    show_default=True,
    help="Base parameters: refitted within their tolerances, or held at their nominal values.",
)
@click.option("--candidates", help="Candidate effects, separated by commas; 'all' includes the unlisted ones.")
@click.option(
    "--max-effects",
    type=click.IntRange(1, 5),
    default=5,
    show_default=True,
    help="Largest number of effects that may be missing at once.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of random numbers; the same seed gives the same output.",
)
@click.option("--runs", help="Names of the runs to use, separated by commas. Default: all.")
@click.option("--machine", type=click.Path(path_type=Path), help="Another machine.yaml to start from.")
@click.option("--band", type=float, help="Band of the torque residual (-3 dB) in Hz. Default: from the machine.")
@click.option(
    "--study",
    "scenario",
    type=click.Path(path_type=Path),
    help="Scenario whose moves, limits, payloads and controller the consequences are computed with.",
)
@effects_option
def command(
    campaign: Path,
    out: Path | None,
    baseline: str,
    candidates: str | None,
    max_effects: int,
    seed: int,
    runs: str | None,
    machine: Path | None,
    band: float | None,
    scenario: Path | None,
) -> None:
    """Find the effect that the machine of CAMPAIGN lacks: size, location and cause of the gap, and what remains.

    --out writes a report, diagnosis.json, and a corrected machine.yaml that replay and study accept. The exit
    status is 0 for every verdict.
    """
    from workbench.cli.campaign import chosen_candidates, load_campaign
    from workbench.cli.progress import stages as shown
    from workbench.cli.show import print_notes, print_sections
    from workbench.core.whole_folder import check_free
    from workbench.view.diagnosis import brief_sections, write_diagnosis

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    print_notes(read.doubts)
    names = chosen_candidates(candidates, read.machine)
    planned = None
    if scenario is not None:
        from workbench.study.load import load_study

        planned = load_study(scenario)
    with shown(writes=out is not None) as stages:
        from workbench.diagnose.diagnose import diagnose

        def run() -> Diagnosis:
            return diagnose(
                read,
                baseline=baseline,
                candidates=names,
                most_effects=max_effects,
                seed=seed,
                band_hz=band,
                scenario=planned,
                tell=stages.tell,
            )

        if out is None:
            diagnosis = run()
        else:
            diagnosis = write_diagnosis(run, out, stages.writing)
    click.echo()
    print_sections(brief_sections(diagnosis))
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nReport: {out / 'diagnose.html'}\nMachine: {out / 'machine.yaml'}")
        click.echo(f"Numbers: {out / 'diagnosis.json'}")
