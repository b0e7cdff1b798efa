"""The verdict: a named cause, no gap, or a cause that no library entry explains; with probabilities.

Everything weighed is given a merit (see `score`). A named hypothesis has to beat no gap by
the threshold that machines without a gap set, and to leave no structure that known causes do
not leave. The numbers of CALIBRATION were fitted on simulated campaigns, see docs/diagnosis.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from workbench.diagnose.fits import Fitted
from workbench.diagnose.misfit import Misfit, misfit_of
from workbench.diagnose.records import Hypothesis, Names, VerdictWord
from workbench.diagnose.score import Scale, merit
from workbench.diagnose.search import Found

CALIBRATION = Path(__file__).with_name("calibration.json")


@cache
def calibration() -> Mapping[str, float]:
    """threshold: merit that no gap has; temperature: of merits; unknown_*: the logistic's weights."""
    numbers: Mapping[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with what speaks for it. earned: of a pair, what the weaker effect earns beside the other."""

    names: Names
    fit: Fitted
    gain: float
    merit: float
    earned: float


@dataclass(frozen=True)
class Judged:
    """word, names: the answer. best: the best named hypothesis, also where it is not the answer."""

    word: VerdictWord
    names: Names
    ranking: tuple[Hypothesis, ...]
    weighed: tuple[Weighed, ...]
    best: Weighed | None
    misfit: Misfit
    unknown_probability: float
    reasons: tuple[str, ...]


def weigh(found: Found) -> tuple[Weighed, ...]:
    """All fitted hypotheses, the worthiest first. A pair is worth its better single and what the other adds."""
    base, problem = found.base, found.problem
    floor = min([base.chi2, *(fit.chi2 for fit in found.fits.values())])
    n = problem.share * problem.inputs
    scale = Scale(n, max(1.0, floor / max(problem.share * problem.samples, 1.0)))
    singles: dict[Names, float] = {}
    weighed = []
    for names, fit in found.fits.items():
        if len(names) == 1:
            singles[names] = _merit(base, fit, scale)
            weighed.append(Weighed(names, fit, found.gain(names), singles[names], singles[names]))
    for names, fit in found.fits.items():
        if len(names) != 2:
            continue
        parts = [((name,), singles.get((name,), -math.inf)) for name in names]
        parts.sort(key=lambda each: -each[1])
        first, worth = parts[0]
        if not math.isfinite(worth):
            continue
        explained = max(base.chi2 - found.fits[first].chi2, 0.0)
        added = _merit(found.fits[first], fit, scale, explained)
        weighed.append(Weighed(names, fit, found.gain(names), worth + added, added))
    return tuple(sorted(weighed, key=lambda each: -each.merit))


def _merit(before: Fitted, after: Fitted, scale: Scale, explained: float = 0.0) -> float:
    more = len(after.z) - len(before.z)
    return merit(before.chi2 - after.chi2, before.prior - after.prior, more, scale, explained)


def judge(found: Found) -> Judged:
    """The answer, and the ranking of every hypothesis weighed; probabilities sum to 1."""
    numbers = calibration()
    weighed = [each for each in weigh(found) if len(each.names) == 1 or each.earned > numbers["second"]]
    best = weighed[0] if weighed else None
    significant = best is not None and best.merit > numbers["threshold"]
    held = best.fit if best is not None and significant else found.near
    left = misfit_of(found.problem, held, found.problem.noise)
    unknown, reasons = _unknown(found, held, left, numbers)
    threshold, temperature = numbers["threshold"], numbers["temperature"]
    exponents = np.array([threshold, *(each.merit for each in weighed)]) / (2.0 * temperature)
    shares = np.exp(exponents - np.max(exponents))
    shares *= (1.0 - unknown) / np.sum(shares)
    rows = [Hypothesis("no_gap", (), float(shares[0])), Hypothesis("unknown", (), unknown)]
    rows += [Hypothesis("named", w.names, float(p)) for w, p in zip(weighed, shares[1:], strict=True)]
    named = float(np.sum(shares[1:]))
    word: VerdictWord = max(("named", named), ("no_gap", float(shares[0])), ("unknown", unknown), key=lambda q: q[1])[0]  # type: ignore[assignment]
    names = best.names if word == "named" and best is not None else ()
    first = {"named": names}.get(word, ())
    rows.sort(key=lambda row: (not (row.verdict == word and row.effects == first), -row.probability))
    return Judged(word, names, tuple(rows), tuple(weighed), best, left, unknown, tuple(reasons))


def _unknown(found: Found, held: Fitted, left: Misfit, numbers: Mapping[str, float]) -> tuple[float, list[str]]:
    """The probability that what is left comes from a cause no hypothesis holds, and why."""
    x = (
        numbers["unknown_bias"]
        + numbers["unknown_clear"] * math.log(max(left.clear, 0.5))
        + numbers["unknown_slow"] * math.log(max(left.slow, 0.5))
    )
    reasons = []
    if left.clear > 1.3:
        reasons.append(f"the best hypothesis leaves {left.clear:.1f} times the noise away from standstill")
    on_bound = _on_bound(held, len(found.base.z))
    if on_bound:
        reasons.append("it sits on the bound of one of its parameters")
        x += numbers["unknown_bound"]
    return 1.0 / (1.0 + math.exp(-max(min(x, 50.0), -50.0))), reasons


def _on_bound(fit: Fitted, base: int) -> bool:
    """An effect's value at its upper bound, or at a lower one that is not where it vanishes."""
    at = base
    for knob in fit.knobs[base:]:
        for low, high in zip(knob.lowest, knob.highest, strict=True):
            z = float(fit.z[at])
            at += 1
            if z >= high - 1e-9 or (z <= low + 1e-9 and z != 0.0):
                return True
    return False


def alike(judged: Judged, kept: float = 0.85, within: float = 30.0) -> tuple[str, ...]:
    """Single effects of another place or regime that explain nearly as much as the answer does."""
    if judged.word != "named" or judged.best is None or len(judged.names) != 1:
        return ()
    best = judged.best
    return tuple(
        each.names[0]
        for each in judged.weighed
        if len(each.names) == 1
        and each.names != best.names
        and each.merit > calibration()["threshold"]
        and (each.gain > kept * best.gain and best.gain - each.gain < within)
    )


def names_of(rows: Sequence[Hypothesis]) -> tuple[Names, ...]:
    return tuple(row.effects for row in rows)
