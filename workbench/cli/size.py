"""`workbench size`: the smallest drive for a duty cycle, and what limits each that does not pass."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="size")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write all drives and checks to this file.")
def command(file: Path, json_file: Path | None) -> int:
    """Size motor, gear ratio, inverter, brake, resistor and wire for the duty cycle in FILE.

    Every drive runs the scenario's moves in the closed loop of `workbench study`. Exit status 1: none passes.
    """
    from workbench.cli.show import print_table, print_text
    from workbench.core.whole_folder import check_replaceable, replace_json
    from workbench.study.size import size
    from workbench.view.size import as_json, candidates_table, checks_table, s1_table, sentences

    if json_file is not None:
        check_replaceable(json_file, "size")
    sizing = size(file)
    print_table(candidates_table(sizing))
    click.echo()
    if sizing.taken is not None:
        print_table(checks_table(sizing.taken))
        click.echo()
        print_table(s1_table(sizing))
        click.echo()
    print_text(sentences(sizing))
    if json_file is not None:
        replace_json(json_file, as_json(sizing), "size")
    return 0 if sizing.taken is not None else 1
