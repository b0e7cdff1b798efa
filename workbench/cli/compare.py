"""`workbench compare`: two results of a study, metric by metric; exit status 1 for a regression."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from workbench.cli.show import filled, print_table
from workbench.core.errors import InputError


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
    from workbench.study.compare import compare, judged, parse_limits, regressions, why_unmatched
    from workbench.study.rows import read_rows
    from workbench.view.compare import MOST_LINES, as_json, changes_table, paragraphs, regression_lines

    if json_file is not None:
        check_replaceable(json_file, "newly_failed")
    rows_a, rows_b = read_rows(a), read_rows(b)
    allowed = parse_limits(limits, dict.fromkeys([*judged(), *rows_a[0].metrics]))
    comparison = compare(rows_a, rows_b)
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
