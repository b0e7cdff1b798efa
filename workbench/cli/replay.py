"""`workbench replay`: measured torque in, simulated speed out, against the measured speed."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import effects_option


@click.command(name="replay")
@click.argument("campaign", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make, for replay.json and replay.html.")
@click.option("--runs", help="Names of the runs to take, with commas between; all without it.")
@click.option("--machine", type=click.Path(path_type=Path), help="Another machine.yaml, such as an identified one.")
@click.option("--band", type=float, help="Band of the torque residual, Hz (-3 dB); chosen by the machine without it.")
@effects_option
def command(campaign: Path, out: Path | None, runs: str | None, machine: Path | None, band: float | None) -> None:
    """Replay the runs of CAMPAIGN, a folder with machine.yaml, runs.yaml and logs.

    The measured torque (force) drives the model; its speed is compared with the measured one, open loop
    and restarted every 2 s. Beside it stands the torque that the measured motion should have taken.
    """
    from workbench.cli.campaign import load_campaign
    from workbench.cli.show import print_notes, print_table, print_text
    from workbench.reports.replay import report
    from workbench.reports.words import brief_notes
    from workbench.simulate.replay import replay_runs
    from workbench.whole_folder import check_free

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    if out is None:
        result = replay_runs(read.machine, read.runs, band)
    else:
        from workbench.reports.replay.page import write_replay

        result = write_replay(lambda: replay_runs(read.machine, read.runs, band), read, out)
    print_notes(brief_notes(read))
    print_table(report.table(read.machine, result))
    print_text(["", *report.sentences(read.machine, result)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'replay.html'}\nNumbers: {out / 'replay.json'}")
