"""`workbench replay`: measured torque in, simulated speed out, against the measured speed."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import campaign_argument, effects_option, of_a_campaign


@click.command(name="replay")
@campaign_argument
@click.option("--out", type=click.Path(path_type=Path), help="New folder for replay.json and replay.html.")
@of_a_campaign
@effects_option
def command(campaign: Path, out: Path | None, runs: str | None, machine: Path | None, band: float | None) -> None:
    """Replay the runs of CAMPAIGN.

    The measured torque (force) drives the model. The simulated speed is compared with the measured speed, open
    loop and restarted every 2 s, and the measured torque with the torque that the measured motion requires.
    """
    from workbench.cli.campaign import load_campaign
    from workbench.cli.show import print_notes, print_table, print_text
    from workbench.core.whole_folder import check_free
    from workbench.simulate.replay import replay_runs
    from workbench.view import replay as view
    from workbench.view.words import brief_notes

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    if out is None:
        result = replay_runs(read.machine, read.runs, band)
    else:
        from workbench.view.replay import write_replay

        result = write_replay(lambda: replay_runs(read.machine, read.runs, band), read, out)
    print_notes(brief_notes(read))
    print_table(view.table(read.machine, result))
    print_text(["", *view.sentences(read.machine, result)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'replay.html'}\nNumbers: {out / 'replay.json'}")
