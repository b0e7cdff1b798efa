"""`workbench blind score`: open the seal and print the score sheet."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="score")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make, for score.json and score.html.")
@click.option("--key", type=click.Path(path_type=Path), help="The key of the seal. Default: beside the folder.")
@click.option(
    "--misses", type=click.IntRange(min=0), default=12, show_default=True, help="Number of wrong answers to print."
)
@click.option("--oracle", is_flag=True, help="Also fit the true effect, as the measure of the residual.")
@click.option(
    "--next-runs",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Number of undecided cases to diagnose again with the recommended run, which is simulated.",
)
@click.option("--processes", type=click.IntRange(1, 64), default=2, show_default=True, help="Diagnoses at a time.")
def command(
    folder: Path, out: Path | None, key: Path | None, misses: int, oracle: bool, next_runs: int, processes: int
) -> None:
    """Open the seal of FOLDER, check that no file was changed since, and score the answers.

    Not all campaigns need an answer. opened.json records when the seal was opened and which answers existed then.
    """
    from workbench.blind.later import one_more_run, with_next_runs, with_oracle
    from workbench.blind.power import power_of
    from workbench.blind.score import open_and_score
    from workbench.blind.seal import key_of
    from workbench.cli.show import print_table, print_text
    from workbench.reports.blind import tables
    from workbench.reports.blind.page import write_score
    from workbench.reports.blind.words import sentences
    from workbench.whole_folder import check_free

    def tell(line: str) -> None:
        click.echo(line, err=True)

    if out is not None:
        check_free(out)
    score = open_and_score(folder, key or key_of(folder))
    if oracle:
        score = with_oracle(score, processes, tell)
    settled = with_next_runs(score, next_runs, processes, tell) if next_runs else None
    power = power_of(score, *(one_more_run(score) or ()))
    print_text(sentences(score))
    shown = [
        *(("", table) for table in tables.sheets(score.rows)),
        ("", tables.amounts(score.rows)),
        ("By the size of the gap", tables.sizes(score.rows)),
    ]
    if power is not None:
        shown.append(("The power of these runs", tables.power(power)))
    shown.append(("Beside other methods", tables.methods(score.rows)))
    for head, table in shown:
        if table:
            click.echo(f"\n{head}" if head else "")
            print_table(table)
    if missed := tables.miss_lines(score.rows, misses):
        print_text(["", "Misses", *missed])
    if settled is not None:
        print_text(["", tables.settled(settled)])
    if out is not None:
        write_score(score, out, power, settled)
        click.echo(f"\nReport: {out / 'score.html'}\nNumbers: {out / 'score.json'}")
