"""Probabilities of the answers, from merits and from what speaks for an unknown cause."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.records import Names
from workbench.diagnose.verdict.records import Hypothesis

CALIBRATION = Path(__file__).with_name("calibration.json")


LOST_PERCENT = 10.0  # of the input's rms: a cause that leaves more is of a law that does not hold on this machine


@cache
def calibration() -> Mapping[str, float]:
    """What decides: threshold: merit that no gap has; temperature: of merits; unknown_*: the logistic's weights.

    What is stated of the decision (`_stated`): surer, and misses: of no gap, of an unknown cause, and of one where
    a cause that is named leaves more than LOST_PERCENT.
    """
    numbers: Mapping[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers


def rank(
    merits: Sequence[tuple[Names, float]],
    evidence: Mapping[str, float],
    numbers: Mapping[str, float],
    twins: Sequence[Sequence[Names]] = (),
    left_percent: float = 0.0,
) -> tuple[Hypothesis, ...]:
    """The ranking, the answer first, from merits and the evidence for an unknown cause.

    Named hypotheses share what no unknown cause takes with no gap, whose merit is the threshold;
    merits count divided by the temperature. A merit without names speaks for an unknown cause. The answer is the
    likeliest of the three words. twins: groups of hypotheses that differ in name only, the first one's name leading;
    each group is one row, with one probability. left_percent: what the best hypothesis leaves, of the input's rms.
    """
    x = logistic_argument(evidence, numbers)
    answer = _rows(merits, _shares(merits, x, numbers), twins)[0]
    if x < 0.0:
        x *= numbers["surer"]
    lost = is_lost(merits, numbers["threshold"], left_percent)
    rows = _rows(merits, _with_misses(merits, _shares(merits, x, numbers), numbers, lost), twins)
    first = next(row for row in rows if (row.verdict, row.effects) == (answer.verdict, answer.effects))
    return (first, *sorted((row for row in rows if row is not first), key=lambda row: -row.probability))


def shared(ranking: Sequence[Hypothesis], alike: Names, most: float = 0.5) -> tuple[Hypothesis, ...]:
    """The ranking where the runs cannot tell the answer from others: its probability is `most` at the most. What it
    gives up goes to the hypotheses with effects of `alike`; where none is ranked, to all others, in proportion."""
    first, *rest = ranking
    surplus = first.probability - most
    if surplus <= 0.0 or not rest:
        return tuple(ranking)
    heirs = [k for k, row in enumerate(rest) if set(row.effects) & set(alike)] or list(range(len(rest)))
    total = sum(rest[k].probability for k in heirs)
    for k in heirs:
        share = rest[k].probability / total if total > 0.0 else 1.0 / len(heirs)
        rest[k] = replace(rest[k], probability=rest[k].probability + surplus * share)
    rest.sort(key=lambda row: -row.probability)
    return (replace(first, probability=most), *rest)


def logistic_argument(evidence: Mapping[str, float], numbers: Mapping[str, float]) -> float:
    """Of an unknown cause: below 0 it is the less likely."""
    return numbers["unknown_bias"] + sum(numbers[f"unknown_{name}"] * value for name, value in evidence.items())


def is_lost(merits: Sequence[tuple[Names, float]], threshold: float, left_percent: float) -> bool:
    """A cause of the library is better than none, and yet leaves more than LOST_PERCENT of the input."""
    best = max(merits, key=lambda one: one[1], default=((), 0.0))
    return bool(best[0]) and best[1] > threshold and left_percent > LOST_PERCENT


@dataclass(frozen=True)
class _Shares:
    """Probabilities; named: (len(merits),), 0 for merits without names."""

    no_gap: float
    unknown: float
    named: Array


def _shares(merits: Sequence[tuple[Names, float]], x: float, numbers: Mapping[str, float]) -> _Shares:
    """x: the logistic's argument, of an unknown cause."""
    unknown = 1.0 / (1.0 + math.exp(-max(min(x, 50.0), -50.0)))
    exponents = np.array([numbers["threshold"], *(m for _, m in merits)]) / (2.0 * numbers["temperature"])
    # Of many causes weighed one looks good by chance.
    exponents[1:] -= numbers["elsewhere"] * math.log(max(len(merits), 1))
    shares = np.exp(exponents - np.max(exponents))
    shares *= (1.0 - unknown) / np.sum(shares)
    listed = np.array([bool(names) for names, _ in merits], dtype=bool)
    rivals = float(np.sum(shares[1:][~listed]))
    return _Shares(float(shares[0]), unknown + rivals, np.where(listed, shares[1:], 0.0))


def _with_misses(
    merits: Sequence[tuple[Names, float]], shares: _Shares, numbers: Mapping[str, float], lost: bool
) -> _Shares:
    """What is stated: of no gap and of an unknown cause less, for so many of them are a listed cause that the fits have
    missed.

    What they lose goes to the hypotheses in proportion; where the fits are lost, and say nothing of it, to all single
    effects alike.
    """
    listed = np.array([bool(names) for names, _ in merits], dtype=bool)
    if not np.any(listed):
        return shares
    missed = numbers["missed_lost"] if lost else numbers["missed_unknown"]
    more = numbers["missed_no_gap"] * shares.no_gap + missed * shares.unknown
    single = np.array([len(names) == 1 for names, _ in merits], dtype=bool)
    total = float(np.sum(shares.named))
    spread = shares.named / total if total > 0.0 else listed / np.sum(listed)
    if lost and np.any(single):
        spread = single / np.sum(single)
    no_gap, unknown = shares.no_gap * (1.0 - numbers["missed_no_gap"]), shares.unknown * (1.0 - missed)
    return _Shares(no_gap, unknown, shares.named + more * spread)


def _rows(
    merits: Sequence[tuple[Names, float]], shares: _Shares, twins: Sequence[Sequence[Names]]
) -> tuple[Hypothesis, ...]:
    """A row for each hypothesis, one for each group of twins: the likeliest of the likeliest word, then the others."""
    leader = {names: group[0] for group in twins for names in group}
    others = {group[0]: tuple(group[1:]) for group in twins}
    together: dict[Names, float] = {}
    for (names, _), share in zip(merits, shares.named, strict=True):
        if names:
            first = leader.get(names, names)
            together[first] = together.get(first, 0.0) + float(share)
    rows = [Hypothesis("no_gap", (), shares.no_gap), Hypothesis("unknown", (), shares.unknown)]
    rows += [Hypothesis("named", names, share, others.get(names, ())) for names, share in together.items()]
    total = {"no_gap": shares.no_gap, "unknown": shares.unknown, "named": sum(together.values())}
    word = max(total, key=lambda verdict: total[verdict])
    rows.sort(key=lambda row: (row.verdict != word, -row.probability))
    return (rows[0], *sorted(rows[1:], key=lambda row: -row.probability))
