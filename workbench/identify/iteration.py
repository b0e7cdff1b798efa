"""The paper's own identification: friction levels from the balance of forces, iterated until they converge."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.machines import Kind, kind_of
from workbench.simulate.driven import Balance, Bench, changed, sensor
from workbench.simulate.lowpass import lowpass

MOST_ROUNDS = 30
SETTLED = 1e-4  # of the level


@dataclass(frozen=True)
class Levels:
    """The two levels' history and the profile they come from.

    forward, backward: (rounds + 1,) N (N m), the start first; hoisting is forward.
    speed, force: the friction profile of the last round at moving samples, carriage or axis side.
    """

    forward: tuple[float, ...]
    backward: tuple[float, ...]
    settled: bool
    speed: Array
    force: Array


def friction_levels(bench: Bench) -> Levels:
    """Solve Eq. 16 for the friction force under the measured torque, then Eq. 17 for both levels; iterate.

    In each round the carriage moves as the measured speed and the levels so far make it
    move; the balance of torque, carried over to the carriage, corrects the friction
    profile; each level is the median ratio of the profile to its switching function over
    the moving samples of its direction.
    """
    forward_symbol, backward_symbol = kind_of(bench.machine).friction.levels
    values = list(bench.base)
    forward = [float(getattr(values[0], forward_symbol))]
    backward = [float(getattr(values[0], backward_symbol))]
    settled = False
    speed = force = np.zeros(0)
    for _ in range(MOST_ROUNDS):
        speed, force, switch = _profile(bench, bench.balances(values), values)
        up, down = speed > 0.0, speed < 0.0
        forward.append(_level(force[up], switch[up], forward[-1]))
        backward.append(_level(force[down], switch[down], backward[-1]))
        values = [changed(p, {forward_symbol: forward[-1], backward_symbol: backward[-1]}) for p in values]
        settled = all(abs(x[-1] - x[-2]) <= SETTLED * max(abs(x[-1]), 1e-9) for x in (forward, backward))
        if settled:
            break
    return Levels(tuple(forward), tuple(backward), settled, speed, force)


def _level(force: Array, switch: Array, before: float) -> float:
    return max(float(np.median(force / switch)), 0.0) if len(force) else before


def _profile(bench: Bench, balances: list[Balance], values: list[SimpleNamespace]) -> tuple[Array, Array, Array]:
    """Speed, Coulomb friction force and switching function at the moving samples of all runs."""
    gain, _ = sensor(bench.machine)
    kind = kind_of(bench.machine)
    parts = []
    for b, p in zip(balances, values, strict=True):
        speed, switch, coulomb = _friction(kind, b, p)
        smooth = lowpass(b.run.time_s, np.column_stack([speed, switch, coulomb]), b.band_hz)[b.moving]
        force = smooth[:, 2] + b.residual[b.moving] / gain / kind.lever_of(bench.machine)
        keep = np.abs(smooth[:, 1]) > 0.5
        parts.append(np.column_stack([smooth[:, 0], force, smooth[:, 1]])[keep])
    table = np.concatenate(parts)
    return table[:, 0], table[:, 1], table[:, 2]


def _friction(kind: Kind, b: Balance, p: SimpleNamespace) -> tuple[Array, Array, Array]:
    """Speed at the friction, its switching function and its Coulomb force, as simulated."""
    law, v = kind.friction, friction_speed(kind, b)
    unit = changed(p, {**dict.fromkeys(law.levels, 1.0), **law.off})
    return v, law.law(v, unit), law.law(v, changed(p, law.off))


def friction_speed(kind: Kind, b: Balance) -> Array:
    """Speed at which friction acts, (n,): measured if it is the driven speed, else simulated."""
    others = (*kind.plant.positions[1:], *kind.plant.speeds[1:])
    if kind.friction.speed in others:
        return b.states[:, others.index(kind.friction.speed)]
    return b.motion.speed
