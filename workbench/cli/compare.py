"""`workbench compare`: two results of a study, metric by metric; exit status 1 for a regression."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.show import TIE, filled, print_table
from workbench.core.errors import InputError
from workbench.core.table import Column, Table, words

if TYPE_CHECKING:
    from workbench.study.compare import Change, Comparison, Pair, Regression

MOST_LINES = 10


@click.command(name="compare")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option(
    "--max-regression",
    "limits",
    multiple=True,
    metavar="METRIC=LIMIT",
    help="How much worse a metric may get in any run: peak_torque=5% or peak_torque=20 (its unit); may be repeated.",
)
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write all figures to this file too.")
def command(a: Path, b: Path, limits: tuple[str, ...], json_file: Path | None) -> int:
    """Compare result folder B with result folder A, both written by `workbench study`.

    Runs are matched by id, or by payload, reference and swept values. Exit status 1: with --max-regression, a
    metric got worse than its limit or a run fails in B only. Exit status 2: no run is in both results.
    """
    from workbench.core.whole_folder import check_replaceable, replace_json
    from workbench.study.compare import as_json, compare, judged, parse_limits, regressions, why_unmatched
    from workbench.study.rows import read_rows

    if json_file is not None:
        check_replaceable(json_file, "newly_failed")
    rows_a, rows_b = read_rows(a), read_rows(b)
    allowed = parse_limits(limits, dict.fromkeys([*judged(), *rows_a[0].metrics]))
    comparison = compare(rows_a, rows_b)
    if not comparison.pairs:
        raise InputError(f"no run is in both A ({a}) and B ({b}): {why_unmatched(rows_a, rows_b)}")
    worse = regressions(comparison, allowed)
    _show(comparison)
    if json_file is not None:
        replace_json(json_file, as_json(comparison, allowed, worse), "newly_failed")
    if not allowed:
        return 0
    broken = [_regression_line(regression) for regression in worse]
    broken += [f"{pair.name} failed: {pair.b.reason}" for pair in comparison.newly_failed]
    _print_some("Too much worse:", broken)
    if not broken:
        click.echo(f"Within {', '.join(map(str, allowed))} in all {len(comparison.pairs)} runs.")
    return 1 if broken else 0


def _show(comparison: Comparison) -> None:
    moved = [change for change in comparison.changes if change.noticeable]
    if moved:
        columns = [words("metric"), *map(Column, ("mean A", "mean B", "mean Δ", "%", "median Δ", "largest Δ"))]
        print_table(Table(columns, [_line(change) for change in moved]))
        _print_some("\nMoved most:", [_moved_most(change) for change in moved], len(moved))
    click.echo()
    click.echo(filled(f"{len(comparison.pairs)} runs compared; {_unmoved(comparison)}."))
    _print_some("Only in A:", comparison.only_a)
    _print_some("Only in B:", comparison.only_b)
    _print_some("Failed in B only:", [f"{pair.name}: {pair.b.reason}" for pair in comparison.newly_failed])
    _print_some("Failed in A only:", [f"{pair.name}: {pair.a.reason}" for pair in comparison.newly_ok])


def _unmoved(comparison: Comparison) -> str:
    """The number of equal metrics, and those that changed by less than the least visible difference."""
    if not comparison.changes:
        return "none of them ran to its end in both"
    same = [change for change in comparison.changes if not change.worst]
    hardly = [change.metric for change in comparison.changes if change.worst and not change.noticeable]
    text = f"{len(same)} of {len(comparison.changes)} metrics are the same in all"
    return f"{text}, and these change by next to nothing: {', '.join(hardly)}" if hardly else text


def _line(change: Change) -> list[str]:
    from workbench.study.compare import plain, plain_percent

    numbers = change.mean_a, change.mean_b
    mean, *deltas = (
        plain(change.metric, delta, sign=True, digits=3)
        for delta in (change.mean_delta, change.median_delta, change.max_delta)
    )
    return [
        change.metric,
        *(plain(change.metric, number) for number in numbers),
        mean,
        plain_percent(change.mean_percent),
        *deltas,
    ]


def _moved_most(change: Change) -> str:
    return f"{change.metric}: " + ", ".join(_values(change.metric, pair) for pair in change.worst)


def _values(metric: str, pair: Pair) -> str:
    from workbench.study.compare import plain

    before, after = (plain(metric, row[metric]) for row in (pair.a, pair.b))
    return f"{pair.name}{TIE}{before}{TIE}→{TIE}{after}"


def _regression_line(regression: Regression) -> str:
    by = (
        "from nothing"
        if math.isinf(regression.worse)
        else f"by {regression.worse:.3g}{' %' if regression.limit.relative else ''}"
    )
    return f"{_values(regression.limit.metric, regression.pair)}: worse {by}, allowed {regression.limit}"


def _print_some(title: str, lines: list[str] | tuple[str, ...], most: int = MOST_LINES) -> None:
    if lines:
        click.echo("\n".join([title, *(filled(line, "  ", "    ") for line in lines[:most])]))
    if len(lines) > most:
        click.echo(f"  … and {len(lines) - most} more")
