"""`workbench study`, `report`, `size` and `schema`: scenario files run, their results as pages, a drive sized."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import click

from workbench.cli.options import Cluster, command
from workbench.cli.show import print_table, print_text, shown
from workbench.core.errors import InputError
from workbench.core.whole_folder import check_replaceable, replace_json
from workbench.study.cluster import spread_on
from workbench.study.conclude import ANSWER, answer, read_answer, write_answer
from workbench.study.decide import decisions
from workbench.study.labels import swept_axes
from workbench.study.load import Study, load_study
from workbench.study.rows import read_rows
from workbench.study.scenario import json_schema
from workbench.study.size import size as size_drive
from workbench.study.store import Extra, ResultFolder, Spread, on_this_computer, place_for, read_finished, run_batch
from workbench.view import size as size_view
from workbench.view import study as view

MOST_ON_PAGE = 60  # curves of more runs are a tangle, and a page of megabytes
MOST_IN_TABLE = 40


@command("study", effects=True)
def study(
    files: Annotated[tuple[Path, ...], {"metavar": "FILE..."}], *, out: Path | None = None, cluster: Cluster = None
) -> None:
    """Simulate every run of each scenario FILE in closed loop.

    Finished runs are stored. After Ctrl-C the same command continues where it stopped.

    out: New folder for the results (with several FILEs: their parent folder). Default: results/<name of the study>.
    """
    studies = [load_study(file) for file in files]
    places = _out_folders(studies, files, out)
    done = []
    with shown([study.scenario.name for study in studies]) as tell, ExitStack() as started:
        spread: Spread | None = on_this_computer if cluster is None else None
        for study, folder in zip(studies, places, strict=True):
            place = place_for(study, folder)
            if not place.finished:
                spread = spread or started.enter_context(spread_on(str(cluster)))
                extras: dict[str, Extra] = {ANSWER: write_answer}
                if study.scenario.outputs.signals != "none" and len(study.specs) <= MOST_ON_PAGE:
                    extras["study.html"] = view.save_study_page
                run_batch(study, place, spread=spread, tell=tell, extras=extras)
            done.append(place)
    for study, place in zip(studies, done, strict=True):
        _print(study, place)


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


def _print(study: Study, place: ResultFolder) -> None:
    rows = read_rows(place.folder)
    if len(rows) <= MOST_IN_TABLE:
        print_table(view.run_table(rows))
    else:
        print_table(view.quantile_table(rows))
        click.echo()
        print_table(view.extremes_table(rows, swept_axes(rows)))
        click.echo(f"Each of the {len(rows)} runs has its line in the index.")
    # A study that is there already is shown as it is: nothing is run.
    kept = read_answer(place.folder)
    made = decisions(rows, study.machine, study.scenario.decide, kept.beside if kept is not None else ())
    if (decision := view.decision_table(made[-1])) is not None:
        click.echo()
        print_table(decision)
    print_text(["", *(answer(study, rows, simulate=False) if kept is None else kept.sentences), ""])
    if place.finished:
        click.echo(f"{place.folder} holds this very study already; nothing was run.")
    if place.note:
        click.echo(place.note)
    if (page := place.folder / "study.html").is_file():
        click.echo(f"Figure: {page}")
    click.echo(f"Index:  {place.folder / 'index.parquet'}")


@command("report")
def report(results: Path, *, out: Path | None = None) -> None:
    """Write the report of RESULTS, a folder written by `workbench study`: one HTML file that needs no network.

    out: The page to write. Default: report.html in RESULTS.
    """
    result, path = read_finished(results), out or results / "report.html"
    view.write_study_report(result, path)
    print_text([*view.conclusions(result), ""])
    click.echo(f"Report: {path}")


@command("size")
def size(file: Path, *, json_file: Annotated[Path | None, "--json"] = None) -> int:
    """Size motor, gear ratio, inverter, brake, resistor and wire for the duty cycle in FILE.

    Every drive runs the scenario's moves in the closed loop of `workbench study`. Exit status 1: none passes.

    json_file: Write all drives and checks to this file.
    """
    if json_file is not None:
        check_replaceable(json_file, "size")
    sizing = size_drive(file)
    tables = [size_view.candidates_table(sizing)]
    if sizing.taken is not None:
        tables += [size_view.checks_table(sizing.taken), size_view.s1_table(sizing)]
    for table in tables:
        print_table(table)
        click.echo()
    print_text(size_view.sentences(sizing))
    if json_file is not None:
        replace_json(json_file, size_view.as_json(sizing), "size")
    return 0 if sizing.taken is not None else 1


@command("schema")
def schema(kind: Literal["scenario", "machine", "runs"] = "scenario") -> None:
    """Print the JSON Schema of a scenario file (or of machine.yaml, or of a campaign's runs.yaml).

    Editors with a YAML language server take it from the file's first line:

    \b
        workbench schema scenario > scenario.schema.json
        # yaml-language-server: $schema=scenario.schema.json
    """
    click.echo(json.dumps(json_schema(kind), indent=1, ensure_ascii=False))
