"""The campaign that a command works on: chosen runs, and another machine where one is given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from workbench.effects import check
from workbench.errors import InputError
from workbench.logs import Campaign, read_campaign
from workbench.machine import load_machine
from workbench.simulate.band import check_band


def load_campaign(
    path: Path, runs: str | None = None, machine_file: Path | None = None, band_hz: float | None = None
) -> Campaign:
    """The campaign in `path`; runs: names separated by commas. InputError for what does not fit together."""
    machine = None if machine_file is None else load_machine(machine_file, check_effects=check)
    campaign = read_campaign(path, select=runs, check_effects=check)
    if band_hz is not None:
        check_band(band_hz, campaign.runs)
    if machine is None:
        return campaign
    if type(machine) is not type(campaign.machine):
        raise InputError(
            f"is another kind of machine than the campaign's ({_kind(machine)}, expected {_kind(campaign.machine)})",
            file=machine_file,
        )
    return replace(campaign, machine=machine)


def _kind(machine: object) -> str:
    return " ".join(str(getattr(machine, key)) for key in ("motion", "kind") if hasattr(machine, key))
