"""The verdict: a named cause, no gap, or a cause that no library entry explains; with probabilities.

Everything weighed is given a merit (see `score`). A named hypothesis has to beat no gap by
the threshold that machines without a gap set, and to leave no structure that known causes do
not leave. The numbers of CALIBRATION were fitted on simulated campaigns, see docs/diagnosis.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.score import SECOND, Scale, merit, scale_of
from workbench.diagnose.hypotheses.search import Found
from workbench.diagnose.records import Hypothesis, Names, VerdictWord
from workbench.diagnose.verdict.against import against
from workbench.diagnose.verdict.misfit import Misfit, misfit_of
from workbench.diagnose.verdict.stretch import stretch
from workbench.diagnose.verdict.structure import Reducible, floor_of, reducible
from workbench.effects import find
from workbench.machine import Axis

MUCH = 0.5  # of the gap's energy
# Standard deviations by which tolerances are stretched by chance: more without a cause that explains anything than with
# one, for of all causes weighed one would have relieved them.
BY_CHANCE = {False: 2.0, True: 1.0}
UNDONE = 0.15  # logarithm of energies: as far two effects undo each other by chance
STRETCHED = 9.0  # of chi^2 of the tolerances, three in one place: it tells two effects apart
CALIBRATION = Path(__file__).with_name("calibration.json")


@cache
def calibration() -> Mapping[str, float]:
    """threshold: merit that no gap has; temperature: of merits; unknown_*: the logistic's weights."""
    numbers: Mapping[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with what speaks for it. earned: of a pair, what the second effect earns beside the better one.

    rival: an effect that no answer may name unasked; what speaks for it speaks for an unknown cause.
    """

    names: Names
    fit: Fitted
    gain: float
    merit: float
    earned: float
    rival: bool = False


@dataclass(frozen=True)
class Judged:
    """word, names: the answer. best: the best named hypothesis, also where it is not the answer.

    held: the fit that what is left was judged on. reducible: what a variable explains of that.
    """

    word: VerdictWord
    names: Names
    ranking: tuple[Hypothesis, ...]
    weighed: tuple[Weighed, ...]
    best: Weighed | None
    held: Fitted
    reducible: Reducible
    misfit: Misfit
    evidence: Mapping[str, float]
    floor: float
    unknown_probability: float
    reasons: tuple[str, ...]


def weigh(found: Found) -> tuple[Weighed, ...]:
    """All fitted hypotheses, the worthiest first. A pair is worth its better single and what the other adds."""
    base, problem = found.base, found.problem
    floor = min([base.chi2, *(fit.chi2 for fit in found.fits.values())])
    scale = scale_of(problem, max(1.0, floor / max(problem.share * problem.samples, 1.0)))
    singles: dict[Names, float] = {}
    weighed = []
    for names, fit in found.fits.items():
        if len(names) == 1:
            singles[names] = _merit(found, base, fit, scale)
            worth = singles[names]
            weighed.append(Weighed(names, fit, found.gain(names), worth, worth, names[0] in found.rivals))
    weighed = _freer(found, _rivals(found, weighed, scale), scale)
    singles = {each.names: each.merit for each in weighed}
    for names, fit in found.fits.items():
        if len(names) != 2:
            continue
        parts = [((name,), singles.get((name,), -math.inf)) for name in names]
        parts.sort(key=lambda each: -each[1])
        first, worth = parts[0]
        if not math.isfinite(worth):
            continue
        explained = max(base.chi2 - found.fits[first].chi2, 0.0)
        added = _merit(found, found.fits[first], fit, scale, explained)
        weighed.append(Weighed(names, fit, found.gain(names), worth + added - calibration()["pair"], added))
    return tuple(sorted(weighed, key=lambda each: -each.merit))


def _rivals(found: Found, singles: list[Weighed], scale: Scale) -> list[Weighed]:
    """A rival counts by what it explains beyond the best effect that may be named: some hold that within them."""
    own = max((each for each in singles if not each.rival), key=lambda each: each.merit, default=None)
    kept = []
    for each in singles:
        if each.rival and own is not None:
            explained = max(found.base.chi2 - own.fit.chi2, 0.0)
            data = own.fit.chi2 - each.fit.chi2
            more = merit(data, own.fit.prior - each.fit.prior, len(each.fit.z) - len(found.base.z), scale, explained)
            each = replace(each, merit=min(each.merit, own.merit + more), earned=more)
        kept.append(each)
    return kept


def _freer(found: Found, singles: list[Weighed], scale: Scale) -> list[Weighed]:
    """A law of more freedom counts by what it explains beyond the simpler law of the same place and regime."""
    kind = found.problem.active.kind
    kept = []
    for each in singles:
        for simpler in singles:
            if not each.rival and not simpler.rival and same_but_freer(each.names[0], simpler.names[0], kind):
                explained = max(found.base.chi2 - simpler.fit.chi2, 0.0)
                more = _merit(found, simpler.fit, each.fit, scale, explained)
                each = replace(each, merit=min(each.merit, simpler.merit + more))
        kept.append(each)
    return kept


def _merit(found: Found, before: Fitted, after: Fitted, scale: Scale, explained: float = 0.0) -> float:
    more = len(after.z) - len(before.z)
    kind = found.problem.active.kind
    added = set(after.effects) - set(before.effects)
    creeping = bool(added) and all(find(name, kind).regime == "low_speed" for name in added)
    data, prior = before.chi2 - after.chi2, before.prior - after.prior
    return merit(data, prior, more, scale, explained, creeping)


def judge(found: Found, seed: int = 0) -> Judged:
    """The answer, and the ranking of every hypothesis weighed; probabilities sum to 1."""
    weighed = weigh(found)
    best = next((each for each in weighed if not each.rival), None)
    held = best.fit if best is not None and best.merit > calibration()["threshold"] else found.near
    by_variable = reducible(found.problem, held, seed)
    floor = floor_of(found.problem, held, by_variable)
    left = misfit_of(found.problem, held, floor)
    evidence = evidence_of(found, held, left, by_variable.share, floor)
    rows = rank([(() if each.rival else each.names, each.merit) for each in weighed], evidence, calibration())
    unknown = next(row.probability for row in rows if row.verdict == "unknown")
    reasons = _reasons(left, evidence, weighed)
    answer = rows[0]
    return Judged(
        answer.verdict, answer.effects, rows, weighed, best, held, by_variable, left, evidence, floor, unknown, reasons
    )


def rank(
    merits: Sequence[tuple[Names, float]], evidence: Mapping[str, float], numbers: Mapping[str, float]
) -> tuple[Hypothesis, ...]:
    """The ranking, the answer first, from merits and the evidence for an unknown cause.

    Named hypotheses share what no unknown cause takes with no gap, whose merit is the threshold;
    merits count divided by the temperature. A merit without names speaks for an unknown cause. The answer is the
    likeliest of the three words.
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
    rows += [Hypothesis("named", names, float(p)) for (names, _), p in zip(merits, shares[1:], strict=True) if names]
    total = {row.verdict: 0.0 for row in rows}
    for row in rows:
        total[row.verdict] += row.probability
    word = max(total, key=lambda each: total[each])
    rows.sort(key=lambda row: (row.verdict != word, -row.probability))
    first, rest = rows[0], sorted(rows[1:], key=lambda row: -row.probability)
    return (first, *rest)


def evidence_of(found: Found, held: Fitted, left: Misfit, share: float, floor: float) -> dict[str, float]:
    """What speaks for a cause that no hypothesis holds, each 0 where nothing does.

    clear, slow: logarithms of the misfit, in full where much of the gap is left or a variable
    explains what is left, less where neither is so: no model of a large effect is exact.
    prior: how far beyond chance the base parameters are off their tolerances, in standard
    deviations (see `stretch`) above BY_CHANCE, and more than an inexact effect bends them.
    bound: an effect's value at its limit. against: how far two effects undo each other, above UNDONE.
    """
    own = len(found.base.z)
    inexact = SECOND**2 * max(found.base.chi2 - held.chi2, 0.0) if held.effects else 0.0
    inputs = found.problem.inputs
    gap = found.near.rms(inputs) ** 2 - floor**2
    # An axis' floor is structured as it is: without a gap nothing there is left open but what a variable explains.
    small = 0.0 if isinstance(found.problem.machine, Axis) else 1.0
    open_share = (held.rms(inputs) ** 2 - floor**2) / gap if gap > floor**2 else small
    weight = min(max(share, open_share / MUCH, 0.0), 1.0)
    return {
        "clear": weight * math.log(max(left.clear, 1.0)),
        "slow": weight * math.log(max(left.slow, 1.0)),
        "prior": max(stretch(found.problem, held, inexact) - BY_CHANCE[bool(held.effects)], 0.0),
        "bound": float(_on_bound(held, own)),
        "against": max(against(found.problem, held, own) - UNDONE, 0.0),
    }


def _reasons(left: Misfit, evidence: Mapping[str, float], weighed: Sequence[Weighed]) -> tuple[str, ...]:
    reasons = []
    if weighed and weighed[0].rival:
        name = weighed[0].names[0]
        reasons.append(f"an unlisted effect explains more: weigh it with `--candidates {name}`")
    if left.clear > 1.3:
        reasons.append(f"the best hypothesis leaves {left.clear:.1f} times the noise away from standstill")
    if left.slow > 1.5:
        reasons.append(f"what it leaves hangs together over seconds ({left.slow:.1f} times what noise would)")
    if evidence["prior"] > 1.5:
        reasons.append("it needs base parameters further off than their tolerances allow together")
    if evidence["bound"]:
        reasons.append("it sits on the bound of one of its parameters")
    if evidence["against"] > 0.0:
        reasons.append("its two effects largely undo each other, as two do that stand in for a third")
    return tuple(reasons)


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


def alike(judged: Judged, kind: str, kept: float = 0.85, within: float = 30.0) -> tuple[str, ...]:
    """Single effects of another place or regime that explain nearly as much as the answer does, with base parameters
    about as near their nominal values."""
    if judged.word != "named" or judged.best is None or len(judged.names) != 1:
        return ()
    best = judged.best
    return tuple(
        each.names[0]
        for each in judged.weighed
        if len(each.names) == 1
        and not each.rival
        and each.names != best.names
        and each.merit > calibration()["threshold"]
        and (each.gain > kept * best.gain and best.gain - each.gain < within)
        and each.fit.prior - best.fit.prior < STRETCHED
        and not same_but_freer(each.names[0], best.names[0], kind)
    )


def same_but_freer(freer: str, simpler: str, kind: str) -> bool:
    """Whether an effect is of the same place and regime as another, with more freedom: no other cause."""
    a, b = find(freer, kind), find(simpler, kind)
    return len(a.parameters) > len(b.parameters) and (a.subsystem(kind), a.regime) == (b.subsystem(kind), b.regime)
