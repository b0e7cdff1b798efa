"""`workbench identify`: from measured runs to a machine with error bars."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import campaign_argument, effects_option, of_a_campaign


@click.command(name="identify")
@campaign_argument
@click.option("--out", type=click.Path(path_type=Path), help="New folder for machine.yaml, numbers and figures.")
@click.option("--free", help="Keys of machine.yaml to fit, separated by commas. Default: see --list.")
@of_a_campaign
@click.option("--list", "list_keys", is_flag=True, help="Print the keys that --free accepts, and exit.")
@effects_option
def command(
    campaign: Path,
    out: Path | None,
    free: str | None,
    runs: str | None,
    machine: Path | None,
    band: float | None,
    list_keys: bool,
) -> None:
    """Fit the machine of CAMPAIGN to its runs; print values with standard errors.

    --out writes the identified machine.yaml, which every other command accepts, with figures and numbers.
    """
    from workbench.cli.campaign import load_campaign
    from workbench.cli.show import print_notes, print_table, print_text
    from workbench.core.whole_folder import check_free
    from workbench.view import identify as view
    from workbench.view.words import brief_notes

    if out is not None:
        check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    if list_keys:
        print_table(view.keys_table(read))
        return
    from workbench.identify.identify import identify

    keys = None if free is None else [key.strip() for key in free.split(",")]

    def run() -> view.Identification:
        return identify(read, free=keys, band_hz=band)

    if out is None:
        identification = run()
    else:
        from workbench.view.identify import write_identification

        identification = write_identification(run, out)
    print_notes(brief_notes(read))
    print_table(view.table(identification.fit))
    click.echo()
    print_table(view.measures_table(identification), note=False)
    print_text(["", *view.sentences(identification)])
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nMachine: {out / 'machine.yaml'}\nFigures: {out / 'identify.html'}")
        click.echo(f"Numbers: {out / 'identify.json'}, {out / 'replay.json'}")
