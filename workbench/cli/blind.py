"""`workbench blind`: test the diagnosis on campaigns whose truth is sealed."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import NamedGroup

POWER = "The power of these runs"
FOLDER = click.Path(path_type=Path)
processes_option = click.option(
    "--processes", type=click.IntRange(1, 64), default=2, show_default=True, help="Campaigns at a time."
)


def tell(line: str) -> None:
    click.echo(line, err=True)


@click.group(name="blind", cls=NamedGroup)
def command() -> None:
    """Test the diagnosis on campaigns whose truth is sealed: make them, diagnose them, open the seal and score.

    With your own machine and runs the score is the power of your experiment. See docs/blind.md.
    """


@command.command(name="make")
@click.option("--out", type=FOLDER, required=True, help="Folder to make.")
@click.option("--machine", type=FOLDER, help="Your machine.yaml, in place of drawn machines.")
@click.option(
    "--runs",
    type=FOLDER,
    metavar="PLAN|CAMPAIGN",
    help="Your runs: a plan.yaml, or a campaign whose speeds, payloads, heights, rate and noise are taken.",
)
@click.option("--cases", type=click.IntRange(min=1), default=60, show_default=True, help="Number of campaigns.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed of random numbers; it is sealed with the labels. Default: a random one.",
)
@click.option(
    "--source",
    multiple=True,
    default=["simulator"],
    show_default=True,
    help="Source of the runs: simulator, multibody or plant, may be repeated; or recorded, of the campaign of --runs.",
)
@click.option("--kind", type=click.Choice(["hoist", "axis"]), help="Machines of one kind only.")
@click.option("--family", multiple=True, help="Family of machines, see docs/blind.md; may be repeated.")
@click.option("--effects", help="Names of the effects that may be withheld, separated by commas. Default: all.")
@click.option("--case", type=click.Choice(["singles", "none", "pairs", "unknown"]), help="Cases of one type only.")
@click.option(
    "--identified",
    type=click.Choice(["no", "half", "yes"]),
    default="no",
    show_default=True,
    help="Identify machine.yaml on two runs without a fault first.",
)
@click.option("--key", type=FOLDER, help="File for the key. Default: beside the folder.")
@processes_option
def make_(
    out: Path,
    machine: Path | None,
    runs: Path | None,
    cases: int,
    seed: int | None,
    source: tuple[str, ...],
    kind: str | None,
    family: tuple[str, ...],
    effects: str | None,
    case: str | None,
    identified: str,
    key: Path | None,
    processes: int,
) -> None:
    """Make campaigns as a rig would record them. Each lacks one effect, two, none, or one that is in no library.

    The truth is encrypted. manifest.json holds its hash and the hash of each file. The key is written beside the
    folder, so that the folder can be passed on without it.
    """
    from workbench.blind.make import Asked, make

    asked = Asked(machine, runs, cases, seed, source, kind, family, effects, case, identified)

    made = make(asked, out, key=key, processes=processes, tell=tell)
    click.echo(f"{made.cases} campaigns: {made.folder}")
    click.echo(f"Key: {made.key}")
    click.echo(f"Seal (SHA-256): {made.seal_sha256}")
    click.echo(f"Next: workbench blind run {made.folder}")


@command.command(name="run")
@click.argument("folder", type=FOLDER)
@processes_option
@click.option(
    "--count", type=click.IntRange(min=1), help="Number of campaigns to diagnose, the first ones. Default: all."
)
@click.option(
    "--max-effects",
    type=click.IntRange(1, 5),
    default=5,
    show_default=True,
    help="Largest number of effects that may be missing at once.",
)
@click.option("--cluster", metavar="ADDRESS", help="Run on Dask: tcp://host:port, or local:N for N local processes.")
def run_(folder: Path, processes: int, count: int | None, max_effects: int, cluster: str | None) -> None:
    """Diagnose the campaigns of FOLDER, each in a process and a folder without label or seed.

    Campaigns that have an answer are skipped, so the same command continues after a stop. Ctrl-C discards the
    diagnoses that are running.
    """
    from workbench.blind.run import run

    ran = run(folder, processes=processes, count=count, most_effects=max_effects, tell=tell, cluster=cluster)
    click.echo(f"{ran.done} of {ran.cases} campaigns have an answer, {ran.done - ran.kept} of them new.")
    click.echo(f"Answers (SHA-256): {ran.head}")
    click.echo(f"Next: workbench blind score {folder}")


@command.command(name="score")
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=FOLDER)
@click.option("--out", type=FOLDER, help="Folder to make, for score.html, score.md and score.json.")
@click.option("--key", type=FOLDER, help="The key of the seal. Default: beside the folder.")
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
@processes_option
def score_(
    folders: tuple[Path, ...],
    out: Path | None,
    key: Path | None,
    answers: str | None,
    misses: int,
    oracle: bool,
    next_runs: int,
    processes: int,
) -> None:
    """Open the seal of each FOLDER and score the answers together.

    Every file is checked against its hash. Not all campaigns need an answer. opened.json records when the seal was
    opened and which answers existed then.
    """
    from workbench.blind.measures import by_kind
    from workbench.blind.power import power_of_rig
    from workbench.blind.score import open_all, sheet_of, with_next_runs, with_oracle
    from workbench.cli.show import print_table, print_text
    from workbench.core.whole_folder import check_free
    from workbench.view import blind as view

    if out is not None:
        check_free(out)
    scores = open_all(folders, key, answers)
    if oracle:
        scores = [with_oracle(score, processes, tell) for score in scores]
    anew = with_next_runs(scores, next_runs, processes, tell) if next_runs else []
    sheet, power = sheet_of(scores), power_of_rig(scores)
    print_text(view.sentences(sheet))
    rows = sheet.rows
    shown = [("", view.sheet_table(of_kind)) for of_kind in by_kind(rows).values()]
    shown += [("", view.amounts(rows)), *view.by_kind("By the size of the gap", view.sizes, rows)]
    if power is not None:
        shown.append((POWER, view.power_table(power)))
    for head, table in [*shown, *view.by_kind("Beside other methods", view.methods, rows)]:
        if table:
            click.echo(f"\n{head}" if head else "")
            if power is not None and head == POWER:
                print_text(power.sentences)
            print_table(table)
    if missed := view.miss_lines(rows, misses):
        print_text(["", "Misses", *missed])
    if anew:
        print_text(["", view.settled_text(anew, rows)])
        print_table(view.next_runs_table(anew))
    if out is not None:
        view.write_score(sheet, out, power, anew)
        click.echo(f"\nReport: {out / 'score.html'}\nNumbers: {out / 'score.json'}")
