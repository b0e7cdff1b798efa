"""Probabilities of the answers, from merits and from what speaks for an unknown cause."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from workbench.diagnose.hypotheses.records import Names
from workbench.diagnose.verdict.records import Hypothesis

CALIBRATION = Path(__file__).with_name("calibration.json")


@cache
def calibration() -> Mapping[str, float]:
    """threshold: merit that no gap has; temperature: of merits; unknown_*: the logistic's weights."""
    numbers: Mapping[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers


def rank(
    merits: Sequence[tuple[Names, float]],
    evidence: Mapping[str, float],
    numbers: Mapping[str, float],
    twins: Sequence[Sequence[Names]] = (),
) -> tuple[Hypothesis, ...]:
    """The ranking, the answer first, from merits and the evidence for an unknown cause.

    Named hypotheses share what no unknown cause takes with no gap, whose merit is the threshold;
    merits count divided by the temperature. A merit without names speaks for an unknown cause. The answer is the
    likeliest of the three words. twins: groups of hypotheses that differ in name only, the first one's name leading;
    each group is one row, with one probability.
    """
    x = numbers["unknown_bias"] + sum(numbers[f"unknown_{name}"] * value for name, value in evidence.items())
    unknown = 1.0 / (1.0 + math.exp(-max(min(x, 50.0), -50.0)))
    exponents = np.array([numbers["threshold"], *(m for _, m in merits)]) / (2.0 * numbers["temperature"])
    # Of many causes weighed one looks good by chance.
    exponents[1:] -= numbers["elsewhere"] * math.log(max(len(merits), 1))
    shares = np.exp(exponents - np.max(exponents))
    shares *= (1.0 - unknown) / np.sum(shares)
    unknown += sum(float(p) for (names, _), p in zip(merits, shares[1:], strict=True) if not names)
    rows = [Hypothesis("no_gap", (), float(shares[0])), Hypothesis("unknown", (), unknown)]
    rows += _named([(names, float(p)) for (names, _), p in zip(merits, shares[1:], strict=True) if names], twins)
    total = {row.verdict: 0.0 for row in rows}
    for row in rows:
        total[row.verdict] += row.probability
    word = max(total, key=lambda each: total[each])
    rows.sort(key=lambda row: (row.verdict != word, -row.probability))
    first, rest = rows[0], sorted(rows[1:], key=lambda row: -row.probability)
    return (first, *rest)


def _named(shares: Sequence[tuple[Names, float]], twins: Sequence[Sequence[Names]]) -> list[Hypothesis]:
    """A row for each hypothesis, and one for each group of twins."""
    leader = {names: group[0] for group in twins for names in group}
    together: dict[Names, float] = {}
    for names, share in shares:
        first = leader.get(names, names)
        together[first] = together.get(first, 0.0) + share
    others = {group[0]: tuple(group[1:]) for group in twins}
    return [Hypothesis("named", names, share, others.get(names, ())) for names, share in together.items()]
