"""`workbench blind score`: open the seal and print the score sheet."""

from __future__ import annotations

from pathlib import Path

import click

POWER = "The power of these runs"


@click.command(name="score")
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make, for score.html, score.md and score.json.")
@click.option("--key", type=click.Path(path_type=Path), help="The key of the seal. Default: beside the folder.")
@click.option(
    "--answers",
    metavar="HEAD|FILE",
    help="What `workbench blind run` printed as Answers, or a copy of answers.jsonl. Default: that beside the folder.",
)
@click.option(
    "--misses", type=click.IntRange(min=0), default=12, show_default=True, help="Number of wrong answers to print."
)
@click.option("--oracle", is_flag=True, help="Also fit the true effect, as the measure of the residual.")
@click.option(
    "--next-runs",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Number of undecided cases of a folder to diagnose again with the run that would decide, which is simulated.",
)
@click.option("--processes", type=click.IntRange(1, 64), default=2, show_default=True, help="Diagnoses at a time.")
def command(
    folders: tuple[Path, ...],
    out: Path | None,
    key: Path | None,
    answers: str | None,
    misses: int,
    oracle: bool,
    next_runs: int,
    processes: int,
) -> None:
    """Open the seal of each FOLDER, check that no file was changed since, and score the answers together.

    Not all campaigns need an answer. opened.json records when the seal was opened and which answers existed then.
    """
    from workbench.blind.later import power_of_rig, with_next_runs, with_oracle
    from workbench.blind.score import open_all, sheet_of
    from workbench.cli.show import print_table, print_text
    from workbench.core.whole_folder import check_free
    from workbench.reports.blind import tables
    from workbench.reports.blind.page import write_score
    from workbench.reports.blind.words import sentences

    def tell(line: str) -> None:
        click.echo(line, err=True)

    if out is not None:
        check_free(out)
    scores = open_all(folders, key, answers)
    if oracle:
        scores = [with_oracle(score, processes, tell) for score in scores]
    anew = with_next_runs(scores, next_runs, processes, tell) if next_runs else []
    sheet, power = sheet_of(scores), power_of_rig(scores)
    print_text(sentences(sheet))
    shown = [
        *(("", table) for table in tables.sheets(sheet.rows)),
        ("", tables.amounts(sheet.rows)),
        *tables.sizes_by_kind(sheet.rows),
    ]
    if power is not None:
        shown.append((POWER, tables.power(power)))
    for head, table in [*shown, *tables.methods_by_kind(sheet.rows)]:
        if table:
            click.echo(f"\n{head}" if head else "")
            if power is not None and head == POWER:
                print_text(power.sentences)
            print_table(table)
    if missed := tables.miss_lines(sheet.rows, misses):
        print_text(["", "Misses", *missed])
    if anew:
        print_text(["", tables.settled_text(anew, sheet.rows), *tables.next_run_lines(anew)])
    if out is not None:
        write_score(sheet, out, power, anew)
        click.echo(f"\nReport: {out / 'score.html'}\nNumbers: {out / 'score.json'}")
