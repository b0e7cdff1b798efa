"""Causes that one diagnosis cannot tell apart, told apart by many cycles beside the healthy ones.

A diagnosis allows for what a lumped model of any machine may miss, so that an offset of the torque sensor, a heavier
carriage and a heavier wire stay alike however many cycles it is given. The machine's own healthy cycles miss the same:
the difference between them and the cycles since a change holds the sensors' and the machine's scatter only. With the
mean deviations w of n cycles at one payload, whitened by the baseline's covariance, and the shift s of the estimates
under a cause as the diagnosis fitted it,

    w ~ N(s, K),    K = scale (1/n + 1/N) I + s s' + S S'

S: what one standard error of each of the cause's parameters adds; s s' lets its size be another, for a change may grow;
N: cycles of the baseline; scale: the largest of 1 and the reduced chi² of the best cause, for what no cause explains
widens the errors. Gaussian evidence: D. J. C. MacKay, Neural Computation 4, 1992. Payloads stand below each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.machine import Axis, Hoist
from workbench.run import Array, Run
from workbench.watch.change import Baseline
from workbench.watch.estimate import shift
from workbench.watch.judge import SAME_PAYLOAD_KG, Cycle


@dataclass(frozen=True)
class Group:
    """Cycles of one payload since the change. deviation: (r,), their whitened mean; run: one of them."""

    payload_kg: float
    count: int
    deviation: Array
    run: Run


def groups_of(cycles: Sequence[Cycle], runs: Sequence[Run], baseline: Baseline) -> list[Group]:
    """The cycles by payload, of those payloads that a run stands for."""
    made: list[Group] = []
    for run in runs:
        alike = [c for c in cycles if abs(c.payload_kg - run.payload_kg) <= SAME_PAYLOAD_KG]
        if not alike or any(abs(run.payload_kg - group.payload_kg) <= SAME_PAYLOAD_KG for group in made):
            continue
        z = [baseline.z(baseline.deviation(c.estimate.values, c.payload_kg), c.payload_kg) for c in alike]
        made.append(Group(run.payload_kg, len(alike), np.asarray(np.mean(z, axis=0)), run))
    return made


@dataclass(frozen=True)
class Cause:
    """fitted: the machine with a cause as the diagnosis fitted it; others: with one parameter a standard error off."""

    fitted: Hoist | Axis
    others: tuple[Hoist | Axis, ...] = ()


def likelihoods(
    machine: Hoist | Axis, causes: Mapping[str, Cause], groups: Sequence[Group], baseline: Baseline
) -> dict[str, float]:
    """Logarithm of the likelihood of each cause, 0 for the best. machine: as its logs were estimated with."""
    deviation = np.concatenate([group.deviation for group in groups])
    noise = np.concatenate([np.full(len(g.deviation), 1.0 / g.count + 1.0 / baseline.count) for g in groups])

    def shifts(other: Hoist | Axis) -> Array:
        moved = [baseline.z(shift(machine, g.run, other, baseline.keys), g.payload_kg) for g in groups]
        return np.concatenate(moved)

    columns = {}
    for name, cause in causes.items():
        own = shifts(cause.fitted)
        columns[name] = np.column_stack([own, *(shifts(other) - own for other in cause.others)])
    left = {name: _normal(deviation, column, noise)[1] for name, column in columns.items()}
    scale = max(1.0, min(left.values()) / len(deviation))
    logs = {name: _normal(deviation, column, scale * noise)[0] for name, column in columns.items()}
    best = max(logs.values())
    return {name: log - best for name, log in logs.items()}


def _normal(deviation: Array, columns: Array, noise: Array) -> tuple[float, float]:
    """Logarithm of the density of N(first column, columns columns' + noise), but for a constant; and chi²."""
    covariance = columns @ columns.T + np.diag(noise)
    off = deviation - columns[:, 0]
    chi2 = float(off @ np.linalg.solve(covariance, off))
    return -0.5 * (chi2 + float(np.linalg.slogdet(covariance)[1])), chi2


def posterior(before: Mapping[str, float], logs: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of causes: what they were together, shared anew by their likelihoods."""
    weights = {name: probability * float(np.exp(logs[name])) for name, probability in before.items()}
    share = sum(before.values()) / sum(weights.values())
    return {name: weight * share for name, weight in sorted(weights.items(), key=lambda pair: -pair[1])}
