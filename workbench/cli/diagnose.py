"""`workbench diagnose`: where the sim-to-real gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from workbench.cli.options import campaigns_argument, effects_option
from workbench.core.errors import InputError

if TYPE_CHECKING:
    from workbench.diagnose.diagnose import Diagnosis


@click.command(name="diagnose")
@campaigns_argument
@click.option(
    "--out", type=click.Path(path_type=Path), help="New folder for diagnosis.json, machine.yaml and the report."
)
@click.option(
    "--baseline",
    type=click.Choice(["tolerances", "nominal"]),
    default="tolerances",
    show_default=True,
    help="Base parameters: refitted within their tolerances, or held at their nominal values.",
)
@click.option("--candidates", help="Candidate effects, separated by commas; 'all' includes the unlisted ones.")
@click.option(
    "--max-effects",
    type=click.IntRange(1, 5),
    default=5,
    show_default=True,
    help="Largest number of effects that may be missing at once.",
)
@click.option("--quick", is_flag=True, help="Single effects, no control study: a result within seconds.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of random numbers; the same seed gives the same output.",
)
@click.option("--runs", help="Names of the runs to use, separated by commas. Default: all.")
@click.option("--validate", help="Names of runs to keep for the end, separated by commas; nothing is fitted to them.")
@click.option("--machine", type=click.Path(path_type=Path), help="Another machine.yaml to start from.")
@click.option("--band", type=float, help="Band of the torque residual (-3 dB) in Hz. Default: from the machine.")
@click.option(
    "--study",
    "scenario",
    type=click.Path(path_type=Path),
    help="Scenario that gives moves, limits, payloads and controller of the control study.",
)
@click.option(
    "--cluster", metavar="ADDRESS", help="Several campaigns on Dask: tcp://host:port, or local:N for N processes."
)
@effects_option
def command(
    campaigns: tuple[Path, ...],
    out: Path | None,
    runs: str | None,
    machine: Path | None,
    band: float | None,
    candidates: str | None,
    scenario: Path | None,
    cluster: str | None,
    **chosen: Any,
) -> None:
    """Find the effect that the machine of CAMPAIGN lacks: size, location and cause of the gap, and what remains.

    --out writes a report, diagnosis.json, and a corrected machine.yaml that replay and study accept. The exit
    status is 0 for every verdict. Several campaigns give one table, and with --out a folder of each; the exit status
    is 1 where one of them could not be diagnosed.
    """
    from workbench.cli.campaign import chosen_candidates, load_campaign
    from workbench.core.whole_folder import check_free

    if out is not None:
        check_free(out)
    kept = [name.strip() for name in (chosen["validate"] or "").split(",") if name.strip()]
    options: dict[str, Any] = {
        "baseline": chosen["baseline"], "most_effects": chosen["max_effects"], "seed": chosen["seed"],
        "quick": chosen["quick"], "validate": kept, "band_hz": band, "scenario": None,
    }  # fmt: skip
    if scenario is not None:
        from workbench.study.load import load_study

        options["scenario"] = load_study(scenario)
    if len(campaigns) > 1 or cluster is not None:
        if candidates is not None:
            options["candidates"] = chosen_candidates(candidates, load_campaign(campaigns[0], runs, machine).machine)
        _several(campaigns, lambda path: load_campaign(path, runs, machine, band), options, out, cluster)
        return
    read = load_campaign(campaigns[0], runs, machine, band)
    options["candidates"] = chosen_candidates(candidates, read.machine)
    _one(read, options, out)


def _one(read: Any, options: dict[str, Any], out: Path | None) -> None:
    from workbench.cli.progress import stages as shown
    from workbench.cli.show import print_notes, print_sections
    from workbench.view.diagnosis import brief_sections, write_diagnosis

    print_notes(read.doubts)
    with shown(writes=out is not None) as stages:
        from workbench.diagnose.diagnose import diagnose

        def run() -> Diagnosis:
            return diagnose(read, **options, tell=stages.tell)

        diagnosis = run() if out is None else write_diagnosis(run, out, stages.writing)
    click.echo()
    print_sections(brief_sections(diagnosis))
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nReport: {out / 'diagnose.html'}\nMachine: {out / 'machine.yaml'}")
        click.echo(f"Numbers: {out / 'diagnosis.json'}")


def _several(
    paths: tuple[Path, ...], load: Any, options: dict[str, Any], out: Path | None, cluster: str | None
) -> None:
    from workbench.cli.diagnose_many import diagnose_each, summary_table
    from workbench.cli.show import filled, print_table
    from workbench.effects.registry import user_files

    names = [path.resolve().name for path in paths]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two campaigns are called '{repeated[0]}'; their results would share a folder")
    readers = {name: lambda path=path: load(path) for name, path in zip(names, paths, strict=True)}
    rows = diagnose_each(
        readers, options, out, cluster, user_files(), lambda line: click.echo(line, err=True)
    )  # fmt: skip
    click.echo()
    print_table(summary_table(rows))
    for row in rows:
        if row.trouble:
            click.echo(filled(f"{row.name}: {row.trouble}", "- ", "  "))
    if out is not None:
        click.echo(f"\nReports: {', '.join(str(out / row.name) for row in rows if not row.trouble) or 'none'}")
    if any(row.trouble for row in rows):
        sys.exit(1)
