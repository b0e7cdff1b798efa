"""The diagnosis of an alarm's cycles against the healthy baseline, as the store keeps it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from workbench.diagnose.diagnose import diagnose
from workbench.kinds import kind_of
from workbench.logs import Campaign
from workbench.machine import Axis, Hoist, get_value, with_values
from workbench.watch.change import Baseline

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


def diagnosed(campaign: Campaign, baseline: Baseline) -> dict[str, Any]:
    """Verdict, effects and their probabilities, and the sentence. InputError where it cannot be diagnosed."""
    made = diagnose(replace(campaign, machine=healthy(campaign.machine, baseline)), most_effects=1, study=False)
    ranking = sorted(made.verdict.ranking, key=lambda row: -row.probability)[:5]
    return {
        "verdict": made.verdict.word,
        "effects": list(made.verdict.effects),
        "sentence": made.verdict.sentence,
        "ranking": [
            {"effects": list(row.effects), "verdict": row.verdict, "probability": row.probability} for row in ranking
        ],
        "runs": [run.name for run in campaign.runs],
    }


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
