"""An identification as tables, as sentences, and as identify.json."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from workbench.identify.fit import Fit
from workbench.identify.identify import Identification
from workbench.identify.iteration import Levels
from workbench.identify.parameters import Free, fittable, free_parameters
from workbench.kinds import kind_of
from workbench.logs import Campaign
from workbench.machine import Axis, Hoist, get_value
from workbench.reports.numbers import change_percent, figures, rounded, with_error
from workbench.reports.replay.report import EXPLAINED, noise_is_floor
from workbench.reports.words import direction_names, words_of
from workbench.simulate.replay import ReplayResult

FAR = 3.0  # tolerances: a value beyond them stands in for something else
HEAD = (" parameter", "nominal", "identified", "± std\nerror", "change\n%", " held")
CAPTION = (
    "held: the nominal value, within its tolerance, counts as one more measurement; else the runs alone decide. "
    "A name's end is its unit."
)


def as_campaign(found: Identification) -> Campaign:
    """The campaign with the identified machine in place of the nominal one."""
    return replace(found.campaign, machine=found.machine)


def table(fit: Fit) -> list[list[str]]:
    """A line a fitted parameter, under HEAD."""
    lines = []
    for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True):
        shown, spread = with_error(value, error)
        change = change_percent(free.nominal, value)
        lines.append([free.key, figures(free.nominal, 4), shown, spread, change, held(free.prior_std is not None)])
    return lines


def held(by_tolerance: bool) -> str:
    """Whether a tolerance holds the value in the fit."""
    return "yes" if by_tolerance else "no"


def keys_table(campaign: Campaign) -> list[list[str]]:
    """Every key that a fit may free, its value, and whether the usual fit frees it."""
    machine = campaign.machine
    usual = {free.key: free.prior_std is not None for free in free_parameters(machine, campaign.runs)}
    return [
        [key, figures(get_value(machine, key), 5), ("held" if usual[key] else "free") if key in usual else ""]
        for key in fittable(machine)
    ]


def measures_head(machine: Hoist | Axis) -> tuple[str, ...]:
    w = words_of(machine)
    return (
        " machine",
        "speed error\nopen loop\n%",
        "speed error\nrestarted\n%",
        f"{w.quantity}\nresidual\n{w.unit}",
        f"the same,\nmoving\n{w.unit}",
        f"sensor\nnoise\n{w.unit}",
    )


def measures_table(found: Identification) -> list[list[str]]:
    """The replay before and after."""
    return [_measures("nominal", found.before), _measures("identified", found.after)]


def _measures(name: str, result: ReplayResult) -> list[str]:
    return [
        name,
        f"{result.speed_rmse_percent:.2f}",
        f"{result.speed_rmse_percent_restarted_2s:.2f}",
        figures(result.residual_rms),
        figures(result.residual_rms_moving),
        figures(result.noise_rms),
    ]


REMEDY = "`workbench diagnose` names what"


def sentences(found: Identification, remedy: str = REMEDY) -> list[str]:
    """How far the residual fell, the paper's iteration, then what the data cannot tell, and the remedy."""
    w = words_of(found.machine)
    before, after = found.before.residual_percent, found.after.residual_percent
    fell = f"The {w.quantity} residual went from {before:.2f} to {after:.2f} % of the {w.quantity} itself."
    said = [fell, iteration(found.campaign.machine, found.levels), *found.fit.statements]
    return [*said, *_lacking(found, remedy)]


def _lacking(found: Identification, remedy: str) -> list[str]:
    """Where values alone do not explain the runs, the command that goes on from here."""
    off = max((tolerances_off(free, value) for free, value in zip(found.fit.free, found.fit.value, strict=True)))
    left, noise = found.after.residual_rms_moving, found.after.noise_rms
    signs = [f"a value is {off:.0f} tolerances off"] if off > FAR else []
    if left > EXPLAINED * noise > 0.0 and noise_is_floor(found.machine, found.after):
        signs.append(f"the residual while moving is {left / noise:.1f} times the noise")
    if not signs:
        return []
    text = " and ".join(signs)
    return [f"{text[0].upper()}{text[1:]}: the model may lack something; {remedy}."]


def tolerances_off(free: Free, value: float) -> float:
    """How many of its tolerances a fitted value is from its nominal one; 0 where it has none."""
    if free.prior_std is None or free.logarithmic:
        return 0.0
    return abs(value - free.nominal) / (free.scale * free.prior_std)


def iteration(machine: Hoist | Axis, levels: Levels) -> str:
    forward, backward = direction_names(machine)
    rounds = len(levels.forward) - 1
    ended = f"settled after {rounds} rounds" if levels.settled else f"had not settled after {rounds} rounds"
    unit = kind_of(machine).friction.unit
    return (
        "The paper's iteration, which leaves all other values nominal, puts friction at "
        f"{figures(levels.forward[-1], 4)} {unit} {forward} and {figures(levels.backward[-1], 4)} {unit} {backward}; "
        f"it {ended}."
    )


def to_json(found: Identification) -> dict[str, Any]:
    """identify.json: parameters with errors, correlations, the iteration's history, statements, replays."""
    machine, fit, levels = found.campaign.machine, found.fit, found.levels
    w = words_of(machine)
    forward, backward = direction_names(machine)
    return {
        "format": 1,
        "campaign": found.campaign.name,
        "runs": [run.name for run in found.campaign.runs],
        "parameters": {
            free.key: {
                "nominal": free.nominal,
                "value": rounded(value, 8),
                "std_error": rounded(error, 4),
                "held_by_tolerance": free.prior_std is not None,
            }
            for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True)
        },
        "correlation": {
            "keys": [free.key for free in fit.free],
            "matrix": [[rounded(float(c), 4) for c in row] for row in fit.correlation],
        },
        "paper_iteration": {
            forward: [rounded(level) for level in levels.forward],
            backward: [rounded(level) for level in levels.backward],
            "settled": levels.settled,
        },
        "statements": list(fit.statements),
        "fit": {
            f"residual_rms_before_{w.suffix}": rounded(fit.residual_rms_before),
            f"residual_rms_{w.suffix}": rounded(fit.residual_rms),
            f"noise_rms_{w.suffix}": rounded(fit.noise_rms),
            "samples": fit.samples,
            "evaluations": fit.evaluations,
        },
        "before": overall(found.campaign, found.before),
        "after": overall(as_campaign(found), found.after),
        "notes": list(found.campaign.all_notes),
    }


def overall(campaign: Campaign, result: ReplayResult) -> Any:
    from workbench.reports.replay.report import to_json as replay_json

    return replay_json(campaign, result)["overall"]
