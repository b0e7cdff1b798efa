"""`workbench blind run`: diagnose sealed campaigns."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="run")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--processes", type=click.IntRange(1, 64), default=2, show_default=True, help="Diagnoses at a time.")
@click.option(
    "--count", type=click.IntRange(min=1), help="Number of campaigns to diagnose, the first ones. Default: all."
)
@click.option(
    "--max-effects",
    type=click.IntRange(1, 3),
    default=2,
    show_default=True,
    help="Largest number of effects that may be missing at once.",
)
@click.option("--cluster", metavar="ADDRESS", help="Run on Dask: tcp://host:port, or local:N for N local processes.")
def command(folder: Path, processes: int, count: int | None, max_effects: int, cluster: str | None) -> None:
    """Diagnose the campaigns of FOLDER, each in a process and a folder without label or seed.

    Campaigns that have an answer are skipped, so the same command continues after a stop. Ctrl-C discards the
    diagnoses that are running.
    """
    from workbench.blind.run import run

    def tell(line: str) -> None:
        click.echo(line, err=True)

    ran = run(folder, processes=processes, count=count, most_effects=max_effects, tell=tell, cluster=cluster)
    click.echo(f"{ran.done} of {ran.cases} campaigns have an answer, {ran.done - ran.kept} of them new.")
    click.echo(f"Answers (SHA-256): {ran.head}")
    click.echo(f"Next: workbench blind score {folder}")
