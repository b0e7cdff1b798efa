"""`workbench blind make`: campaigns whose truth is sealed."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="make")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to make.")
@click.option("--machine", type=click.Path(path_type=Path), help="Your machine.yaml, in place of drawn machines.")
@click.option(
    "--runs",
    type=click.Path(path_type=Path),
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
@click.option("--key", type=click.Path(path_type=Path), help="File for the key. Default: beside the folder.")
@click.option("--processes", type=click.IntRange(1, 64), default=2, show_default=True, help="Campaigns at a time.")
def command(
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

    def tell(line: str) -> None:
        click.echo(line, err=True)

    made = make(asked, out, key=key, processes=processes, tell=tell)
    click.echo(f"{made.cases} campaigns: {made.folder}")
    click.echo(f"Key: {made.key}")
    click.echo(f"Seal (SHA-256): {made.seal_sha256}")
    click.echo(f"Next: workbench blind run {made.folder}")
