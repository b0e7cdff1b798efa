"""`workbench import`: logs as drives write them, made a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from workbench.cli.options import command
from workbench.cli.show import print_table, print_text
from workbench.core.whole_folder import check_free
from workbench.effects import check
from workbench.logs.importing import (
    Imported,
    for_all,
    in_si,
    propose,
    read_channels,
    runs_yaml,
    with_table,
    write_campaign,
)
from workbench.machines import load_machine
from workbench.view.logs import mapping_table, write_page


@command("import", effects=True)
def import_(
    files: Annotated[tuple[Path, ...], {"metavar": "FILE..."}],
    *,
    machine: Path,
    out: Path,
    payload: tuple[float, ...] = (),
    start_position: tuple[float, ...] = (),
    mapped: Annotated[tuple[str, ...], "--map", {"metavar": "SIGNAL=COLUMN[:UNIT]"}] = (),
    scales: Annotated[tuple[str, ...], "--scale", {"metavar": "SIGNAL=FACTOR"}] = (),
    runs_csv: Annotated[Path | None, "--runs"] = None,
    yes: bool = False,
) -> int:
    """Make a campaign of logs: MDF4, TDMS, MAT 7.3, TwinCAT Scope and other CSV with header lines or decimal commas.

    The command proposes a mapping of columns to signals, draws it, and asks for confirmation unless --yes is given.
    Channels of different rates are resampled to the fastest one. MDF4, TDMS and MAT 7.3 need the extra 'import'.

    machine: The machine.yaml of the campaign.
    out: New folder for the campaign.
    payload: Payload in kg: one value for all files, or one for each.
    start_position: Height at the first sample, in m: one value for all files, or one for each.
    mapped: Column to use for a signal, and its unit (rpm, mm, kNm, %nominal …); may be repeated.
    scales: Signal in SI = factor times column; may be repeated.
    runs_csv: CSV with one row per file: file, and any of payload_kg, start_position_m, start_time_s.
    yes: Accept the proposed mapping without asking.
    """
    check_free(out)
    read = load_machine(machine, check_effects=check)
    loads, starts = for_all(payload, len(files), "payload"), for_all(start_position, len(files), "start_position")
    logs = [
        Imported(file, tuple(read_channels(file)), load, start)
        for file, load, start in zip(files, loads, starts, strict=True)
    ]
    if runs_csv is not None:
        logs = with_table(logs, runs_csv)
    proposed = propose(read, logs[0].channels, mapped, scales)
    page = out.with_name(f"{out.name}.import.html")
    write_page([(p.signal, p.column, *in_si(p, logs[0])) for p in proposed.proposals], proposed, logs[0].name, page)
    print_table(mapping_table(proposed))
    print_text([f"Columns that are no signal: {', '.join(proposed.unused) or 'none'}.", f"Drawn: {page}"])
    if not yes:
        click.echo(f"\nruns.yaml will be:\n\n{runs_yaml(logs, proposed)}")
        click.confirm("Take it?", abort=True)
    campaign = write_campaign(machine, logs, proposed, out)
    print_text([f"{len(campaign.runs)} runs.", *campaign.all_notes])
    click.echo(f"\nCampaign: {out}")
    return 0
