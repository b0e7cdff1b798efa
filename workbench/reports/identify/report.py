"""An identification as tables, as sentences, and as identify.json."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from workbench.core.json_records import rounded
from workbench.core.table import Column, Table, words
from workbench.identify.fit import Fit
from workbench.identify.identify import Identification
from workbench.identify.iteration import Levels
from workbench.identify.parameters import Free, fittable, free_parameters
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, get_value, kind_of
from workbench.reports.replay import report as replay_report
from workbench.reports.replay.report import EXPLAINED, noise_is_floor
from workbench.simulate.replay import ReplayResult
from workbench.view.numbers import change_percent, figures, with_error
from workbench.view.words import direction_names, words_of

FAR = 3.0  # tolerances: a value beyond them stands in for something else
COLUMNS = (words("parameter"), Column("nominal"), Column("identified"), Column("± std\nerror"), Column("change", "%"),
           words("held"))  # fmt: skip
CAPTION = (
    "held: the nominal value, within its tolerance, counts as one more measurement; else the runs alone decide. "
    "A name's end is its unit."
)


def as_campaign(identification: Identification) -> Campaign:
    """The campaign with the identified machine in place of the nominal one."""
    return replace(identification.campaign, machine=identification.machine)


def table(fit: Fit) -> Table:
    """One row for each fitted parameter."""
    lines = []
    for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True):
        shown, spread = with_error(value, error)
        change = change_percent(free.nominal, value)
        lines.append([free.key, figures(free.nominal, 4), shown, spread, change, held(free.prior_std is not None)])
    return Table(COLUMNS, lines, CAPTION)


def held(by_tolerance: bool) -> str:
    """Whether a tolerance holds the value in the fit."""
    return "yes" if by_tolerance else "no"


def keys_table(campaign: Campaign) -> Table:
    """Every key that can be fitted, its value, and whether the default fit includes it."""
    machine = campaign.machine
    usual = {free.key: free.prior_std is not None for free in free_parameters(machine, campaign.runs)}
    rows = [
        [key, figures(get_value(machine, key), 5), ("held" if usual[key] else "free") if key in usual else ""]
        for key in fittable(machine)
    ]
    return Table([words("key"), Column("value"), words("usual fit")], rows)


def measures_table(identification: Identification) -> Table:
    """The replay before and after."""
    machine, before, after = identification.machine, identification.before, identification.after
    rows = [
        replay_report.measures("nominal", before, before.noise_rms),
        replay_report.measures("identified", after, after.noise_rms),
    ]
    return Table(replay_report.columns(machine, "machine"), rows, replay_report.note(machine, after))


REMEDY = "`workbench diagnose` names what"


def sentences(identification: Identification, remedy: str = REMEDY) -> list[str]:
    """The reduction of the residual, the paper's iteration, undetermined values, and the remedy."""
    w = words_of(identification.machine)
    before, after = identification.before.residual_percent, identification.after.residual_percent
    fell = f"The {w.quantity} residual went from {before:.2f} to {after:.2f} % of the {w.quantity} itself."
    known = [fell, iteration(identification.campaign.machine, identification.levels), *identification.fit.statements]
    return [*known, *_lacking(identification, remedy)]


def _lacking(identification: Identification, remedy: str) -> list[str]:
    """The next command if no values of the machine explain the runs."""
    fit = identification.fit
    off = max(tolerances_off(free, value) for free, value in zip(fit.free, fit.value, strict=True))
    left, noise = identification.after.residual_rms_moving, identification.after.noise_rms
    signs = [f"a value is {off:.0f} tolerances off"] if off > FAR else []
    if left > EXPLAINED * noise > 0.0 and noise_is_floor(identification.machine, identification.after):
        signs.append(f"the residual while moving is {left / noise:.1f} times the noise")
    if not signs:
        return []
    text = " and ".join(signs)
    return [f"{text[0].upper()}{text[1:]}: the model may lack something; {remedy}."]


def tolerances_off(free: Free, value: float) -> float:
    """The distance of a fitted value from its nominal one in tolerances; 0 if it has none."""
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


def to_json(identification: Identification) -> dict[str, Any]:
    """identify.json: parameters with errors, correlations, the iteration's history, statements, replays."""
    machine, fit, levels = identification.campaign.machine, identification.fit, identification.levels
    w = words_of(machine)
    forward, backward = direction_names(machine)
    return {
        "format": 1,
        "campaign": identification.campaign.name,
        "runs": [run.name for run in identification.campaign.runs],
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
        "before": overall(identification.campaign, identification.before),
        "after": overall(as_campaign(identification), identification.after),
        "notes": list(identification.campaign.all_notes),
    }


def overall(campaign: Campaign, result: ReplayResult) -> Any:
    return replay_report.to_json(campaign, result)["overall"]
