"""`workbench blind`: test the diagnosis on campaigns whose truth is sealed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import click

from workbench.blind.make import Asked, make
from workbench.blind.measures import by_kind
from workbench.blind.power import power_of_rig
from workbench.blind.run import run
from workbench.blind.score import open_all, sheet_of, with_next_runs, with_oracle
from workbench.cli.options import Cluster, MostEffects, NamedGroup, command
from workbench.cli.show import print_table, print_text
from workbench.core.whole_folder import check_free
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS
from workbench.view import blind as view

POWER = "The power of these runs"
Processes = Annotated[int, click.IntRange(1, 64), "Campaigns at a time."]
Count = click.IntRange(min=1)
Number = click.IntRange(min=0)


def tell(line: str) -> None:
    click.echo(line, err=True)


@click.group(name="blind", cls=NamedGroup)
def blind() -> None:
    """Test the diagnosis on campaigns whose truth is sealed: make them, diagnose them, open the seal and score.

    With your own machine and runs the score is the power of your experiment. See docs/blind.md.
    """


@command("make")
def make_(
    *,
    out: Path,
    machine: Path | None = None,
    runs: Annotated[Path | None, {"metavar": "PLAN|CAMPAIGN"}] = None,
    cases: Annotated[int, Count] = 60,
    seed: Annotated[int | None, Number] = None,
    source: tuple[str, ...] = ("simulator",),
    kind: Literal["hoist", "axis"] | None = None,
    family: tuple[str, ...] = (),
    effects: str | None = None,
    case: Literal["singles", "none", "pairs", "unknown"] | None = None,
    identified: Literal["no", "half", "yes"] = "no",
    key: Path | None = None,
    processes: Processes = 2,
) -> None:
    """Make campaigns as a rig would record them. Each lacks one effect, two, none, or one that is in no library.

    The truth is encrypted. manifest.json holds its hash and the hash of each file. The key is written beside the
    folder, so that the folder can be passed on without it.

    out: Folder to make.
    machine: Your machine.yaml, in place of drawn machines.
    runs: Your runs: a plan.yaml, or a campaign whose speeds, payloads, heights, rate and noise are taken.
    cases: Number of campaigns.
    seed: Seed of random numbers; it is sealed with the labels. Default: a random one.
    source: Source of the runs: simulator, multibody or plant, may be repeated; or recorded, of the campaign of
        --runs.
    kind: Machines of one kind only.
    family: Family of machines, see docs/blind.md; may be repeated.
    effects: Names of the effects that may be withheld, separated by commas. Default: all.
    case: Cases of one type only.
    identified: Identify machine.yaml on two runs without a fault first.
    key: File for the key. Default: beside the folder.
    """
    asked = Asked(machine, runs, cases, seed, source, kind, family, effects, case, identified)
    made = make(asked, out, key=key, processes=processes, tell=tell)
    click.echo(f"{made.cases} campaigns: {made.folder}")
    click.echo(f"Key: {made.key}")
    click.echo(f"Seal (SHA-256): {made.seal_sha256}")
    click.echo(f"Next: workbench blind run {made.folder}")


@command("run")
def run_(
    folder: Path,
    *,
    processes: Processes = 2,
    count: Annotated[int | None, Count] = None,
    max_effects: MostEffects = MOST_EFFECTS,
    cluster: Cluster = None,
) -> None:
    """Diagnose the campaigns of FOLDER, each in a process and a folder without label or seed.

    Campaigns that have an answer are skipped, so the same command continues after a stop. Ctrl-C discards the
    diagnoses that are running.

    count: Number of campaigns to diagnose, the first ones. Default: all.
    """
    ran = run(folder, processes=processes, count=count, most_effects=max_effects, tell=tell, cluster=cluster)
    click.echo(f"{ran.done} of {ran.cases} campaigns have an answer, {ran.done - ran.kept} of them new.")
    click.echo(f"Answers (SHA-256): {ran.head}")
    click.echo(f"Next: workbench blind score {folder}")


@command("score")
def score_(
    folders: Annotated[tuple[Path, ...], {"metavar": "FOLDER..."}],
    *,
    out: Path | None = None,
    key: Path | None = None,
    answers: Annotated[str | None, {"metavar": "HEAD|FILE"}] = None,
    misses: Annotated[int, Number] = 12,
    oracle: bool = False,
    next_runs: Annotated[int, Number] = 0,
    processes: Processes = 2,
) -> None:
    """Open the seal of each FOLDER and score the answers together.

    Every file is checked against its hash. Not all campaigns need an answer. opened.json records when the seal was
    opened and which answers existed then.

    out: Folder to make, for score.html, score.md and score.json.
    key: The key of the seal. Default: beside the folder.
    answers: What `workbench blind run` printed as Answers, or a copy of answers.jsonl. Default: that beside the
        folder.
    misses: Number of wrong answers to print.
    oracle: Also fit the true effect, as the measure of the residual.
    next_runs: Number of undecided cases of a folder to diagnose again with the run that would decide, which is
        simulated.
    """
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
                print_text(view.power_sentences(power))
            print_table(table)
    if missed := view.miss_lines(rows, misses):
        print_text(["", "Misses", *missed])
    if anew:
        print_text(["", view.settled_text(anew, rows)])
        print_table(view.next_runs_table(anew))
    if out is not None:
        view.write_score(sheet, out, power, anew)
        click.echo(f"\nReport: {out / 'score.html'}\nNumbers: {out / 'score.json'}")


for part in (make_, run_, score_):
    blind.add_command(part)
