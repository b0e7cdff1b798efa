"""`workbench report`: a finished result as one page that can be sent and printed."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="report")
@click.argument("results", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="The page to write. Default: report.html in RESULTS.")
def command(results: Path, out: Path | None) -> None:
    """Write the report of RESULTS, a folder written by `workbench study`: one HTML file that needs no network."""
    from workbench.cli.show import print_text
    from workbench.study.store import read_finished
    from workbench.view.study import conclusions, write_study_report

    result = read_finished(results)
    path = out or results / "report.html"
    write_study_report(result, path)
    print_text([*conclusions(result), ""])
    click.echo(f"Report: {path}")
