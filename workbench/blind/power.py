"""The power of an experiment: the smallest size of each effect that its runs would have named in nine of ten cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.blind import measures
from workbench.blind.make import validation
from workbench.blind.measures import Row, Share
from workbench.blind.score import Score
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects import find

ASKED = 0.9
LEAST = 3  # cases of an effect: fewer say nothing of it
SPREAD = 4.0  # of the effects' logits at one size: their thresholds differ by a factor of seven or so
SLOPE, SLOPE_STD = 2.0, 1.0  # of the logit over the logarithm of the size, and how well that is known beforehand
Z_95 = 1.96
LITTLE = 0.03  # of a size: one more run that buys less buys nothing


@dataclass(frozen=True)
class EffectPower:
    """share: of its cases that were named or said to be alike. parameter, amount: the effect's first amount, off its
    vanishing value, that is named in nine of ten; None where that is beyond the sizes tried. change: the same as the
    input's change, rms while moving. ratio: the size that shows with one more run over that without; one_more: amount,
    and change_one_more: change, with that run."""

    effect: str
    share: Share
    parameter: str
    amount: float | None
    interval: tuple[float, float] | None
    largest_tried: float
    change: float | None
    change_interval: tuple[float, float] | None
    largest_change_tried: float
    ratio: float | None = None
    one_more: float | None = None
    change_one_more: float | None = None


@dataclass(frozen=True)
class Power:
    """effects: those with enough cases; few: the others. unit: of the input. run: the one more that buys
    most, in words; "" where none was tried."""

    effects: tuple[EffectPower, ...]
    unit: str
    few: tuple[str, ...]
    run: str


def power_of_rig(scores: Sequence[Score]) -> Power | None:
    """The power of the runs of one machine, from all its folders, and what one more run would buy, in a checkout. None
    where machines were drawn, or are not the same in all folders."""
    first = scores[0]
    if not first.truth.rig or any(score.truth.rig != first.truth.rig for score in scores):
        return None
    rows = [row for score in scores for row in score.rows]
    try:
        one_more = validation("next_run").one_more_run(first)
    except InputError:
        one_more = None
    return power_of(first.with_rows(rows), *(one_more or ()))


def power_of(score: Score, one_more: Mapping[str, float] | None = None, run: str = "") -> Power | None:
    """None where the machines were drawn. one_more: effect -> size that shows with one more run over that without;
    run: which one."""
    if not score.truth.rig:
        return None
    rig = score.truth.rig
    plant = "hoist" if rig["kind"] == "hoist" else f"axis-{rig['machine']['motion']}"
    cases: dict[str, list[tuple[Row, float, str, float]]] = {}
    for row in score.rows:
        if measures.single(row) and row["noise"] and (amount := first_amount(row, plant)) is not None:
            cases.setdefault(row["label"]["effects"][0], []).append((row, *amount))
    cases = {name: members for name, members in sorted(cases.items()) if len(members) >= LEAST}
    sizes = [[float(c[0]["label"]["torque_change_rms_nm"]) for c in members] for members in cases.values()]
    passed = [[measures.right_or_alike(c[0]) for c in members] for members in cases.values()]
    threshold, std = thresholds(sizes, passed)
    effects = tuple(
        _effect(name, members, sizes[k], passed[k], float(threshold[k]), float(std[k]), (one_more or {}).get(name))
        for k, (name, members) in enumerate(cases.items())
    )
    few = sorted({r["label"]["effects"][0] for r in score.rows if measures.single(r)} - set(cases))
    return Power(effects, rig["unit"], tuple(few), run if one_more else "")


def _effect(
    name: str, cases: Sequence[tuple[Row, float, str, float]], sizes: Sequence[float], passed: Sequence[bool],
    threshold: float, std: float, ratio: float | None,
) -> EffectPower:  # fmt: skip
    per_change = float(np.median([amount / size for (_, amount, _, _), size in zip(cases, sizes, strict=True)]))
    largest = max(sizes)
    within = threshold <= math.log(largest)
    change = math.exp(threshold) if within else None
    low, high = (math.exp(threshold + sign * Z_95 * std) for sign in (-1.0, 1.0))
    return EffectPower(
        effect=name,
        share=Share(sum(passed), len(passed)),
        parameter=cases[0][2],
        amount=None if change is None else change * per_change,
        interval=None if change is None else (low * per_change, high * per_change),
        largest_tried=max(amount for _, amount, _, _ in cases),
        change=change,
        change_interval=None if change is None else (low, high),
        largest_change_tried=largest,
        ratio=ratio,
        one_more=None if change is None or ratio is None else change * per_change * ratio,
        change_one_more=None if change is None or ratio is None else change * ratio,
    )


def first_amount(row: Row, plant: str) -> tuple[float, str, float] | None:
    """Of the label's effect: its first amount off the vanishing value, the parameter's name, the value itself.

    plant: kind of plant that the effect is declared for."""
    if not row["label"].get("torque_change_rms_nm"):
        return None
    for effect, numbers in row["label"]["parameters"].items():
        for parameter in find(effect, plant).parameters:
            name = parameter.named(plant)
            if parameter.vanishes_at is not None and numbers.get(name) is not None:
                off = abs(float(numbers[name]) - parameter.vanishes_at)
                if off > 0.0:
                    return off, name, float(numbers[name])
    return None


def thresholds(sizes: Sequence[Sequence[float]], passed: Sequence[Sequence[bool]]) -> tuple[Array, Array]:
    """(effects,) ln size at which ASKED of the cases of each effect pass, and its standard error, by the most likely

        logit P = slope (ln size − middle_k),   middle_k ~ N(mean, SPREAD²/slope²),   ln slope ~ N(ln SLOPE, SLOPE_STD²)

    with standard errors from the curvature there (Laplace).
    """
    if not sizes:
        return np.zeros(0), np.zeros(0)
    from scipy.optimize import minimize

    x = np.concatenate([np.log(of_effect) for of_effect in sizes])
    y = np.concatenate([np.asarray(of_effect, dtype=float) for of_effect in passed])
    of = np.repeat(np.arange(len(sizes)), [len(of_effect) for of_effect in sizes])
    centre = float(np.mean(x))

    def loss(p: Array) -> float:
        """p: offsets of the effects' logits from their mean, that mean, ln slope."""
        offset, mean, slope = p[:-2], p[-2], math.exp(p[-1])
        logit = slope * (x - centre) + mean + offset[of]
        likelihood = float(np.sum(np.logaddexp(0.0, logit) - y * logit))
        prior = 0.5 * float(np.sum((offset / SPREAD) ** 2)) + 0.5 * ((p[-1] - math.log(SLOPE)) / SLOPE_STD) ** 2
        return likelihood + prior + 0.5 * (mean / 10.0) ** 2

    start = np.zeros(len(sizes) + 2)
    start[-1] = math.log(SLOPE)
    best = np.asarray(minimize(loss, start, method="BFGS").x)

    def threshold(p: Array) -> Array:
        asked = math.log(ASKED / (1.0 - ASKED))
        return np.asarray(centre + (asked - p[-2] - p[:-2]) / math.exp(p[-1]))

    covariance = np.linalg.pinv(_curvature(loss, best))
    steps = 1e-4 * np.eye(len(best))
    slopes = np.stack([(threshold(best + s) - threshold(best - s)) / 2e-4 for s in steps], axis=1)
    return threshold(best), np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))


def _curvature(loss: Callable[[Array], float], at: Array) -> Array:
    """Second differences."""
    n, f, step = len(at), loss, 1e-3
    out = np.zeros((n, n))
    e = step * np.eye(n)
    for i in range(n):
        for j in range(i + 1):
            a, b, c, d = f(at + e[i] + e[j]), f(at + e[i] - e[j]), f(at - e[i] + e[j]), f(at - e[i] - e[j])
            out[i, j] = out[j, i] = (a - b - c + d) / (4.0 * step**2)
    return out
