"""The diagnosis of an alarm's cycles against the healthy baseline, as the store keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.hypotheses.estimates import estimates
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.machines import machine_of, with_effects
from workbench.diagnose.records import Diagnosis
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.logs import Campaign
from workbench.machine import Axis, Hoist, get_value, with_values
from workbench.names import unit_of, words_of
from workbench.run import Run
from workbench.watch.change import Baseline
from workbench.watch.judge import Cycle
from workbench.watch.told_apart import Cause, groups_of, likelihoods, posterior

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


Row = tuple[list[str], str, float]  # effects of a hypothesis, its verdict and its probability
UNLIKELY = 0.005  # a cause less probable in the diagnosis stays so


def diagnosed(campaign: Campaign, baseline: Baseline, cycles: Sequence[Cycle]) -> dict[str, Any]:
    """Verdict, effects and their probabilities, and the sentence. InputError where it cannot be diagnosed.

    campaign: the runs to diagnose; cycles: all that count since the change. What the runs cannot tell apart, the cycles
    may, see `told_apart`.
    """
    machine = campaign.machine
    made = diagnose(replace(campaign, machine=healthy(machine, baseline)), most_effects=1, study=False)
    effects, sentence = list(made.verdict.effects), made.verdict.sentence
    rows: list[Row] = [(list(row.effects), row.verdict, row.probability) for row in made.verdict.ranking]
    if made.verdict.word == "named":
        rows, apart = _told_apart(made, machine, rows, campaign.runs, cycles, baseline)
        if apart:
            effects = rows[0][0]
            sentence = f"{apart} {sentence}"
    ranking = sorted(rows, key=lambda row: -row[2])[:5]
    return {
        "verdict": made.verdict.word,
        "effects": effects,
        "sentence": sentence,
        "ranking": [{"effects": e, "verdict": word, "probability": p} for e, word, p in ranking],
        "runs": [run.name for run in campaign.runs],
    }


def _told_apart(
    made: Diagnosis, machine: Hoist | Axis, rows: Sequence[Row], runs: Sequence[Run], cycles: Sequence[Cycle],
    baseline: Baseline,
) -> tuple[list[Row], str]:  # fmt: skip
    """The ranking with the cycles' say, the likeliest cause first, and a sentence; as it was where there is nothing to
    tell apart."""
    before = {effects[0]: p for effects, word, p in rows if word == "named" and len(effects) == 1 and p > UNLIKELY}
    fits = {name: made.search.fits[(name,)] for name in before if (name,) in made.search.fits}
    groups = groups_of(cycles, runs, baseline)
    if len(fits) < 2 or not groups:
        return list(rows), ""
    causes = {name: _cause(made, name, fit) for name, fit in fits.items()}
    logs = likelihoods(machine, causes, groups, baseline)
    after = posterior({name: before[name] for name in causes}, logs)
    named: list[Row] = [([name], "named", p) for name, p in after.items()]
    others = [row for row in rows if not (row[1] == "named" and len(row[0]) == 1 and row[0][0] in after)]
    first, second, *_ = after.items()
    count = sum(group.count for group in groups)
    by = f"by {count} cycle{'s' if count > 1 else ''} beside the healthy ones"
    told = f"The change comes from {first[0]} (probability {first[1]:.2f}; {_amounts(made, first[0], fits[first[0]])})"
    return named + others, f"{told}, {by}; next {second[0]} ({second[1]:.2f}). The last runs alone:"


def _amounts(made: Diagnosis, name: str, fit: Fitted) -> str:
    """The cause's parameters as the diagnosis fitted them, in words."""
    rows = estimates(made.search.problem, fit, 1.0)[name]
    sizes = ((row.name, _plain(_first(row.value), 3), _plain(_first(row.std_error), 2)) for row in rows)
    return ", ".join(f"{words_of(key)} {value} ± {error} {unit_of(key)}".strip() for key, value, error in sizes)


def _plain(value: float, digits: int) -> str:
    """A number of so many digits, without an exponent where it can be."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _first(value: float | tuple[float, ...]) -> float:
    return value[0] if isinstance(value, tuple) else value


def _cause(made: Diagnosis, name: str, fit: Fitted) -> Cause:
    """The machine with a cause as it was fitted, and with each of its parameters a standard error off."""
    problem = made.search.problem
    fitted = machine_of(problem, {}, (name,), fit.setting)
    others = []
    for estimate in estimates(problem, fit, 1.0, exact=True)[name]:
        value, error = fitted.effects[name][estimate.name], _first(estimate.std_error)
        try:
            others.append(
                with_effects(fitted, {**fitted.effects, name: {**fitted.effects[name], estimate.name: value + error}})
            )
        except InputError:  # beyond what the effect can be
            continue
    return Cause(fitted, tuple(others))


def healthy(machine: AnyMachine, baseline: Baseline) -> AnyMachine:
    """The machine with tolerances as narrow as its healthy cycles scatter: what a new machine may be off by says
    nothing of how far this one may move. No tolerance becomes wider than it was."""
    kind = kind_of(machine)
    narrow: dict[str, float] = {}
    for key, spread in zip(baseline.keys, np.sqrt(np.diag(baseline.covariance)), strict=True):
        value = kind.base_value(key)
        if value is None or not value.tolerance:
            continue
        name = f"tolerances.{value.tolerance}"
        size = float(spread) if value.spread == "absolute" else float(spread) / abs(get_value(machine, key))
        narrow[name] = max(size, narrow.get(name, 0.0))
    return with_values(machine, {name: min(size, get_value(machine, name)) for name, size in narrow.items()})
