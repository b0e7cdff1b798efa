"""`workbench study`: run a scenario file, print what came out, say where it lies."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from workbench.study.results import Place
    from workbench.study.run import Row


@click.command(name="study")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make; without it results/<name of the study>.")
def command(file: Path, out: Path | None) -> None:
    """Run the scenario FILE: every payload with every reference, in closed loop."""
    from workbench.figures.study_page import save_study_page
    from workbench.study.load import load_study
    from workbench.study.results import place_for, read_rows, write_results
    from workbench.study.run import motor_torque_limit_nm, run_study

    study = load_study(file)
    place = place_for(study, out)
    if not place.finished:
        write_results(lambda: run_study(study), place.folder, {"study.html": save_study_page})
    _report(read_rows(place.folder), motor_torque_limit_nm(study.machine), place)


def _report(rows: Sequence[Row], torque_limit_nm: float, place: Place) -> None:
    from workbench.cli.show import print_table
    from workbench.study.summary import CAPTION, HEAD, sentences, table

    print_table(HEAD, table(rows))
    click.secho(textwrap.fill(CAPTION, 98), dim=True)
    click.echo("\n" + "\n".join(sentences(rows, torque_limit_nm)) + "\n")
    if place.finished:
        click.echo(f"{place.folder} holds this very study already; nothing was run.")
    if place.note:
        click.echo(place.note)
    click.echo(f"Figure: {place.folder / 'study.html'}\nIndex:  {place.folder / 'index.parquet'}")
