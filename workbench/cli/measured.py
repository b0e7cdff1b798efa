"""`workbench replay` and `identify`: a campaign's runs on the model; the model fitted to them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from workbench.cli.campaign import load_campaign
from workbench.cli.options import Band, Campaign, OtherMachine, Runs, command
from workbench.cli.show import print_notes, print_table, print_text
from workbench.core.whole_folder import check_free
from workbench.identify.identify import Identification
from workbench.identify.identify import identify as fit
from workbench.simulate.replay import ReplayResult, replay_runs
from workbench.view import identify as identify_view
from workbench.view import replay as replay_view
from workbench.view.words import brief_notes


@command("replay", effects=True)
def replay(
    campaign: Campaign,
    *,
    out: Path | None = None,
    runs: Runs = None,
    machine: OtherMachine = None,
    band: Band = None,
) -> None:
    """Replay the runs of CAMPAIGN.

    The measured torque (force) drives the model. The simulated speed is compared with the measured speed, open
    loop and restarted every 2 s, and the measured torque with the torque that the measured motion requires.

    out: New folder for replay.json and replay.html.
    """

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)

    def run() -> ReplayResult:
        return replay_runs(read.machine, read.runs, band)

    result = run() if out is None else replay_view.write_replay(run, read, out)
    print_notes(brief_notes(read))
    print_table(replay_view.table(read.machine, result))
    print_text(["", *replay_view.sentences(read.machine, result)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'replay.html'}\nNumbers: {out / 'replay.json'}")


@command("identify", effects=True)
def identify(
    campaign: Campaign,
    *,
    out: Path | None = None,
    free: str | None = None,
    runs: Runs = None,
    machine: OtherMachine = None,
    band: Band = None,
    list_keys: Annotated[bool, "--list"] = False,
) -> None:
    """Fit the machine of CAMPAIGN to its runs; print values with standard errors.

    --out writes the identified machine.yaml, which every other command accepts, with figures and numbers.

    out: New folder for machine.yaml, numbers and figures.
    free: Keys of machine.yaml to fit, separated by commas. Default: see --list.
    list_keys: Print the keys that --free accepts, and exit.
    """

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    if list_keys:
        print_table(identify_view.keys_table(read))
        return
    keys = None if free is None else [key.strip() for key in free.split(",")]

    def run() -> Identification:
        return fit(read, free=keys, band_hz=band)

    found = run() if out is None else identify_view.write_identification(run, out)
    print_notes(brief_notes(read))
    print_table(identify_view.table(found.fit))
    click.echo()
    print_table(identify_view.measures_table(found), note=False)
    print_text(["", *identify_view.sentences(found)])
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nMachine: {out / 'machine.yaml'}\nFigures: {out / 'identify.html'}")
        click.echo(f"Numbers: {out / 'identify.json'}, {out / 'replay.json'}")
