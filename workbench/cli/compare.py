"""`workbench compare` and `compare-models`: two results of a study; the lumped and the multi-body machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import click

from workbench.cli.measured import load_campaign
from workbench.cli.options import OtherMachine, command
from workbench.cli.show import filled, print_table, print_text
from workbench.core.errors import InputError
from workbench.core.whole_folder import check_free, check_replaceable, replace_json
from workbench.machines import of_kind, studied
from workbench.simulate.models import ModelsCompared, check_multibody, compare_loops
from workbench.simulate.models import compare_models as replay_on_both
from workbench.study.compare import compare as compare_rows
from workbench.study.compare import judged, parse_limits, regressions, why_unmatched
from workbench.study.load import load_study
from workbench.study.rows import read_rows
from workbench.study.run import case_of
from workbench.view import models
from workbench.view.compare import MOST_LINES, as_json, changes_table, paragraphs, regression_lines

MOST_LOOPS = 12


@command("compare")
def compare(
    a: Path,
    b: Path,
    *,
    limits: Annotated[tuple[str, ...], "--max-regression", {"metavar": "METRIC=LIMIT"}] = (),
    json_file: Annotated[Path | None, "--json"] = None,
) -> int:
    """Compare result folder B with result folder A, both written by `workbench study`.

    Runs are matched by id, or by payload, reference and swept values. Exit status 1: with --max-regression, a
    metric got worse than its limit or a run fails in B only. Exit status 2: no run is in both results.

    limits: How much worse a metric may get in any run: peak_torque=5% or peak_torque=20 (its unit); may be
        repeated.
    json_file: Write all figures to this file too.
    """
    if json_file is not None:
        check_replaceable(json_file, "newly_failed")
    rows_a, rows_b = read_rows(a), read_rows(b)
    allowed = parse_limits(limits, dict.fromkeys([*judged(), *rows_a[0].metrics]))
    comparison = compare_rows(rows_a, rows_b)
    if not comparison.pairs:
        raise InputError(f"no run is in both A ({a}) and B ({b}): {why_unmatched(rows_a, rows_b)}")
    worse = regressions(comparison, allowed)
    changes = changes_table(comparison)
    if changes.rows:
        print_table(changes, note=False)
        click.echo()
    for title, lines, most in paragraphs(comparison):
        _print_some(title, lines, most)
    if json_file is not None:
        replace_json(json_file, as_json(comparison, allowed, worse), "newly_failed")
    if not allowed:
        return 0
    broken = regression_lines(comparison, worse)
    _print_some("Too much worse:", broken, MOST_LINES)
    if not broken:
        click.echo(f"Within {', '.join(map(str, allowed))} in all {len(comparison.pairs)} runs.")
    return 1 if broken else 0


def _print_some(title: str, lines: Sequence[str], most: int) -> None:
    if lines:
        margins = ("  ", "    ") if title else ("", "")
        click.echo("\n".join([title, *(filled(line, *margins) for line in lines[:most])]))
    if len(lines) > most:
        click.echo(f"  … and {len(lines) - most} more")


@command("compare-models", effects=True)
def compare_models(
    source: Annotated[Path, {"metavar": "CAMPAIGN|SCENARIO"}],
    *,
    out: Path | None = None,
    runs: str | None = None,
    machine: OtherMachine = None,
    step: float = 0.004,
) -> None:
    """Compare the lumped with the multi-body machine on a campaign's torque, or on a scenario's closed loops.

    Prints the errors of both models against the measurement or the reference, the difference between the models,
    where it is largest, and the compute times. Needs the extra 'multibody'.

    out: New folder for models.json and models.html.
    runs: Names of the campaign's runs to use, separated by commas. Default: all.
    step: Step of the multi-body model in s.
    """
    if not 1e-4 <= step <= 0.01:
        raise InputError(f"{step:g} s, expected 0.0001 to 0.01 s", place="--step")
    check_free(out)
    simulate = _comparison(source, runs, machine, step)
    compared = simulate() if out is None else models.write_models(simulate, source.name, out)
    print_table(models.table(compared))
    print_text(["", *models.sentences(compared)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'models.html'}\nNumbers: {out / 'models.json'}")


def _comparison(source: Path, runs: str | None, machine: Path | None, step_s: float) -> Callable[[], ModelsCompared]:
    """The comparison, to be run when called; all of the input is checked before. InputError as of its readers."""
    if source.is_file():
        if runs is not None or machine is not None:
            place = "--runs" if runs else "--machine"
            raise InputError("belongs to a campaign; a scenario names both itself", place=place)
        study = load_study(source)
        check_multibody(study.machine)
        if (many := len(study.specs)) > MOST_LOOPS:
            raise InputError(f"makes {many} runs, expected at most {MOST_LOOPS} to compare one by one", file=source)
        cases = [case_of(spec) for spec in study.specs]
        return lambda: compare_loops(cases, step_s=step_s)
    campaign = load_campaign(source, runs, machine, None)
    hoist = studied(campaign.machine)
    if hoist is None:
        kind = of_kind(campaign.machine)
        raise InputError(f"{kind}; the multi-body machine is a hoist", file=source / "machine.yaml")
    check_multibody(hoist)
    return lambda: replay_on_both(hoist, campaign.runs, step_s=step_s)
