"""The input of a command: the campaign with the chosen runs and machine, and the candidate effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from workbench.cli.options import names_in
from workbench.core.errors import InputError, nearest
from workbench.effects import check, effects_for
from workbench.logs import Campaign, read_campaign
from workbench.logs.campaign import RunsError
from workbench.logs.doubts import doubts_of
from workbench.machines import Axis, Hoist, load_machine, plant_of
from workbench.simulate.lowpass import check_band

ALL = "all"


def load_campaign(
    path: Path, runs: str | None = None, machine_file: Path | None = None, band_hz: float | None = None
) -> Campaign:
    """The campaign in `path`, with what is doubtful in it; runs: names separated by commas.

    InputError if they do not fit together.
    """
    machine = None if machine_file is None else load_machine(machine_file, check_effects=check)
    try:
        campaign = read_campaign(path, select=runs, check_effects=check)
    except RunsError as error:
        remedy = f"; leave it out: --runs {','.join(error.sound)}" if error.sound else ""
        raise InputError(error.problem + remedy, file=error.file, line=error.line, place=error.place) from error
    campaign = replace(campaign, doubts=tuple(doubts_of(campaign.machine, campaign.runs)))
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


def chosen_candidates(text: str | None, machine: Hoist | Axis) -> tuple[str, ...] | None:
    """Names separated by commas; `all`: every effect of the machine's kind, also the unlisted ones. None stays None.

    InputError for an unknown or a repeated name, with the nearest valid one.
    """
    if text is None:
        return None
    known = effects_for(plant_of(machine).kind)
    if text.strip() == ALL:
        return tuple(known)
    names = names_in(text)
    if not names:
        raise InputError(f"no effect is named, expected names with commas between, or '{ALL}'", place="candidates")
    for name in names:
        if name not in known:
            raise InputError(f"unknown effect '{name}'; {nearest(name, known)}", place="candidates")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"'{repeated[0]}' is named twice, expected each effect once", place="candidates")
    return tuple(names)


def _kind(machine: object) -> str:
    return " ".join(str(getattr(machine, key)) for key in ("motion", "kind") if hasattr(machine, key))
