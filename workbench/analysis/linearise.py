"""The hoist as a linear system around an operating point, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.analysis.jacobian import jacobian, values
from workbench.engine.text import state_symbols
from workbench.machine import Hoist
from workbench.plants import HOIST, NO_EFFECTS, Effects
from workbench.run import Array
from workbench.trace.emit import evaluate
from workbench.trace.expr import Scalar, symbol

Motion = Literal["hoisting", "lowering", "at_rest"]
MOTIONS: tuple[Motion, ...] = ("hoisting", "lowering", "at_rest")
# Of nominal motor speed: friction is saturated there, and far from the limits.
EVEN_SPEED = 0.5
OUTPUTS = ("speed_motor_rad_s", "speed_carriage_m_s", "tension_drum_n")


def _by_length(s: Any, p: Any) -> Scalar:
    return -(s.x / (p.E * p.A))


# k = EA/(L - x): the free length of each fall instead of the whole one. The plant's own k is constant.
STIFFNESS_BY_LENGTH = Effects({"wire_compliance_m_per_n": [_by_length]})


@dataclass(frozen=True)
class OperatingPoint:
    """Where the machine is linearised.

    motion: moving evenly up or down, friction saturated, or at rest, on the friction's slope around
    standstill. `hoisting` is the default: at rest the guide's slope damps the wire many times as
    much, so margins at rest flatter a loop whose work is done moving.
    """

    payload_kg: float
    height_m: float
    motion: Motion = "hoisting"


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """x' = A x + B u, y = C x for small deviations; u: torque of all motors (N m), y as `outputs`.

    A: (n, n), B: (n, 1), C: (outputs, n). start: the operating point's positions, speeds and torque.
    """

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    A: Array
    B: Array
    C: Array
    start: tuple[Array, Array, float]

    def output(self, name: str) -> Array:
        """(1, n), one signal's row."""
        return self.C[[self.outputs.index(name)]]

    def system(self) -> Any:
        """As a `control.StateSpace`, torque to the outputs."""
        import control

        D = np.zeros((len(self.outputs), 1))
        return control.ss(
            self.A, self.B, self.C, D, inputs=["torque"], outputs=list(self.outputs), states=list(self.states)
        )


def linearise(
    machine: Hoist,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    height_free: bool = False,
) -> LinearPlant:
    """The plant from motor torque to motor speed, carriage speed and wire tension at a point.

    Positions are taken relative to the carriage's height, so what is left beside it are stretches
    of the falls. The height itself is left out unless `height_free`: through the weight of the free
    wire it makes a mode of e-fold time about 40 s, which a speed loop neither holds nor has to.
    """
    p = HOIST.values(machine, point.payload_kg)
    vars(p).update(effect_values or {})
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    q0, y0, u0 = HOIST.start_of(point.height_m, sign * EVEN_SPEED * machine.motor.nominal_speed_rad_s, p)
    q, y = state_symbols(HOIST)
    u = symbol("u")
    rates = HOIST.accelerations(0.0, q, y, u, p, effects)
    shown = HOIST.outputs(0.0, q, y, u, p, effects)
    start, torque = _even_motion(rates, (*q, *y), u, [*q0, *y0], u0)
    J = jacobian([*rates, *(shown[name] for name in OUTPUTS)], (*q, *y, u), [*start, torque])
    n = len(q)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [J[:n, : 2 * n]]])
    B = np.concatenate([np.zeros(n), J[:n, 2 * n]])[:, None]
    C = J[n:, : 2 * n]
    # Coordinates: the other positions as seen from one that rises evenly with the carriage.
    _, even, _ = HOIST.start_of(point.height_m, 1.0, p)
    T = np.eye(2 * n)
    T[: n - 1, n - 1] = np.array(even[: n - 1]) / even[n - 1]
    A, B, C = np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T
    names = (*(f"{name}_relative" for name in HOIST.positions[: n - 1]), HOIST.positions[n - 1], *HOIST.speeds)
    keep = [i for i in range(2 * n) if height_free or i != n - 1]
    at = np.asarray(start, dtype=np.float64)
    return LinearPlant(
        tuple(names[i] for i in keep),
        OUTPUTS,
        A[np.ix_(keep, keep)].astype(np.float64),
        B[keep],
        C[:, keep],
        (at[:n], at[n:], torque),
    )


def _even_motion(
    rates: Sequence[Scalar], states: Sequence[Any], u: Any, start: Sequence[float], torque: float
) -> tuple[list[float], float]:
    """Newton's steps to where nothing accelerates, at the given height and speeds."""
    n = len(rates)
    free = [*range(n - 1), len(states)]  # the other positions, and the torque
    at = np.array([*start, torque])
    for _ in range(8):
        wrong = np.array(evaluate(list(rates), values((*states, u), at)))
        J = jacobian(rates, (*states, u), at)
        change = np.linalg.solve(J[:, free], -wrong)
        at[free] += change
        if np.all(np.abs(change) <= 1e-10 * (1.0 + np.abs(at[free]))):
            break
    return [float(x) for x in at[:-1]], float(at[-1])
