"""`workbench study`: run scenario files, print the results and their folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.options import effects_option
from workbench.core.errors import InputError

if TYPE_CHECKING:
    from workbench.study.load import Study
    from workbench.study.store import Extra, ResultFolder, Spread, Tell

MOST_ON_PAGE = 60
MOST_IN_TABLE = 40


@click.command(name="study")
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FILE...")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="New folder for the results (with several FILEs: their parent folder). Default: results/<name of the study>.",
)
@click.option("--cluster", metavar="ADDRESS", help="Run on Dask: tcp://host:port, or local:N for N local processes.")
@effects_option
def command(files: tuple[Path, ...], out: Path | None, cluster: str | None) -> None:
    """Simulate every run of each scenario FILE in closed loop.

    Finished runs are stored. After Ctrl-C the same command continues where it stopped.
    """
    from workbench.cli.progress import shown
    from workbench.study.load import load_study
    from workbench.study.store import place_for

    studies = [load_study(file) for file in files]
    places = _out_folders(studies, files, out)
    done = []
    with shown([study.scenario.name for study in studies]) as tell, ExitStack() as started:
        spread = None
        for study, folder in zip(studies, places, strict=True):
            place = place_for(study, folder)
            if not place.finished:
                spread = spread or started.enter_context(_spread(cluster))
                _run(study, place, spread, tell)
            done.append(place)
    for study, place in zip(studies, done, strict=True):
        _report(study, place)


def _out_folders(studies: Sequence[Study], files: Sequence[Path], out: Path | None) -> list[Path | None]:
    """The folder of each study: `out` itself, or a folder in it if there are several."""
    if out is None or len(studies) == 1:
        return [out] * len(studies)
    names = [study.scenario.name for study in studies]
    for i, name in enumerate(names):
        if name in names[:i]:
            like = files[names.index(name)]
            raise InputError(f"is study '{name}', like {like}; run them with an --out each", file=files[i])
    return [out / name for name in names]


@contextmanager
def _spread(cluster: str | None) -> Iterator[Spread]:
    """Where chunks are run: on this computer, or on a cluster while the block runs."""
    if cluster is None:
        from workbench.study.store import on_this_computer

        yield on_this_computer
        return
    from workbench.study.cluster import spread_on

    with spread_on(cluster) as spread:
        yield spread


def _run(study: Study, place: ResultFolder, spread: Spread, tell: Tell) -> None:
    from workbench.study.conclude import ANSWER, write_answer
    from workbench.study.store import run_batch
    from workbench.view.study import save_study_page

    # Curves of more runs than this are a tangle, and a page of megabytes.
    fits = study.scenario.outputs.signals != "none" and len(study.specs) <= MOST_ON_PAGE
    extras: dict[str, Extra] = {ANSWER: write_answer}
    if fits:
        extras["study.html"] = save_study_page
    run_batch(study, place, spread=spread, tell=tell, extras=extras)


def _report(study: Study, place: ResultFolder) -> None:
    from workbench.cli.show import print_table, print_text
    from workbench.study.conclude import answer, read_answer
    from workbench.study.decide import decisions
    from workbench.study.labels import swept_axes
    from workbench.study.rows import read_rows
    from workbench.view.study import decision_table, extremes_table, quantile_table, run_table

    rows = read_rows(place.folder)
    if len(rows) <= MOST_IN_TABLE:
        print_table(run_table(rows))
    else:
        print_table(quantile_table(rows))
        click.echo()
        print_table(extremes_table(rows, swept_axes(rows)))
        click.echo(f"Each of the {len(rows)} runs has its line in the index.")
    # A study that is there already is shown as it is: nothing is run.
    kept = read_answer(place.folder)
    made = decisions(rows, study.machine, study.scenario.decide, kept.beside if kept is not None else ())
    if (decision := decision_table(made[-1])) is not None:
        click.echo()
        print_table(decision)
    print_text(["", *(answer(study, rows, simulate=False) if kept is None else kept.sentences), ""])
    if place.finished:
        click.echo(f"{place.folder} holds this very study already; nothing was run.")
    if place.note:
        click.echo(place.note)
    page = place.folder / "study.html"
    if page.is_file():
        click.echo(f"Figure: {page}")
    click.echo(f"Index:  {place.folder / 'index.parquet'}")
