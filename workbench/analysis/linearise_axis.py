"""An axis as a linear system around an even motion, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np

from workbench.analysis.even_motion import ROUNDS, angle_read
from workbench.analysis.point import LinearPlant, OperatingPoint, moved_memory
from workbench.effects import joined, of
from workbench.engine.source import state_symbols
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis
from workbench.plants import NO_EFFECTS, Effects, Plant
from workbench.run import Array
from workbench.trace.derive import jacobian, values
from workbench.trace.emit import evaluate
from workbench.trace.expr import symbol

# What a place does to the axis' force passes under the moving machine, as a ripple does: it is no spring.
HELD = ("axis_force", ("angle", "x"))


def linearise_axis(
    machine: Axis,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    placed: bool = True,
) -> LinearPlant:
    """The plant from the drive's input to speed and position at the encoder.

    The machine's own effects are at work, `effects` beside them, time stands at the run's start. Positions beside the
    driven one are taken relative to it; that one is left out unless `placed`. InputError where the effects have no
    steady state.
    """
    kind, own = kind_of(machine), of(machine)
    plant, loop = kind.plant, kind.looped
    p = plant.values(machine)
    vars(p).update(own.values_of(0.0), **(effect_values or {}))
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    both = joined(own.effects, effects)
    at = _settled(plant, both, p, point.height_m, sign * loop.even_speed(machine))
    q, y = state_symbols(plant, both)
    u, shaft = symbol("u"), symbol("shaft")
    held = angle_read(both, shaft, *HELD)
    shown = plant.shown(0.0, q, y, u, p, held)
    outputs = (loop.speed, loop.position, *(s.name for s in plant.signals if "acceleration" not in s.name))
    outputs = tuple(dict.fromkeys(outputs))
    J = jacobian([*plant.rates(0.0, q, y, u, p, held), *(shown[name] for name in outputs)], [*q, *y, u, shaft], at)
    n, N = len(q), len(q) + len(y)
    A = np.block([[np.eye(N)[n : 2 * n]], [J[: N - n, :N]]])
    B = np.concatenate([np.zeros(n), J[: N - n, N]])[:, None]
    C = J[N - n :, :N]
    T = np.eye(N)  # the other positions as seen from the driven one
    T[1:n, 0] = 1.0
    A, B, C = (np.asarray(M, dtype=np.float64) for M in (np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T))
    names = (plant.positions[0], *(f"{name}_relative" for name in plant.positions[1:]), *plant.speeds)
    names = (*names, *(m.symbol for m in both.memory))
    keep = [i for i in range(2 * n) if placed or i != 0]
    keep += moved_memory(A, B, keep, range(2 * n, N))
    return LinearPlant(
        tuple(names[i] for i in keep), outputs, A[np.ix_(keep, keep)], B[keep], C[:, keep],
        (at[:n], at[n:N], float(at[N])),
    )  # fmt: skip


def _settled(plant: Plant, effects: Effects, p: SimpleNamespace, position: float, speed: float) -> Array:
    """Newton's steps to where nothing accelerates and no memory changes: positions, speeds, memory, input, shaft."""
    q, y = state_symbols(plant, effects)
    u, shaft = symbol("u"), symbol("shaft")
    by = [*q, *y, u, shaft]
    rates = plant.rates(0.0, q, y, u, p, angle_read(effects, shaft, *HELD))
    n, N = len(q), len(q) + len(y)
    start_q, start_y, hold = plant.start_of(position, speed, p)
    at = np.array([*start_q, *start_y, *(m.start(p) for m in effects.memory), hold, start_q[0]])
    for _ in range(ROUNDS):
        wrong = np.array(evaluate(list(rates), values(by, at)))
        J = jacobian(rates, by, at)
        # Memory of an effect that is off stays where it is, whatever the motion.
        live = [i for i in range(len(wrong)) if i < n or np.any(J[i])]
        free = [*range(1, n), *(n + i for i in live if i >= n), N]  # the other positions, the memory, the input
        try:
            change = np.linalg.solve(J[np.ix_(live, free)], -wrong[live])
        except np.linalg.LinAlgError as error:
            raise InputError("these effects have no steady state in an even motion", place="effects") from error
        at[free] += change
        if np.all(np.abs(change) <= 1e-10 * (1.0 + np.abs(at[free]))):
            break
    return at
