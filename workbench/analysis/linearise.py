"""The hoist as a linear system around an operating point, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.analysis.even_motion import EvenMotion
from workbench.effects import joined, of
from workbench.machine import Hoist
from workbench.plants import HOIST, NO_EFFECTS, Effects
from workbench.run import Array
from workbench.trace.expr import Scalar

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

    The machine's own effects are at work, `effects` beside them. Time stands at the run's start, a
    run that begins the campaign; what an effect remembers has settled, and stays a state only
    where the motion moves it.

    Positions are taken relative to the carriage's height, so what is left beside it are stretches
    of the falls. The height itself is left out unless `height_free`: through the weight of the free
    wire it makes a mode of e-fold time about 40 s, which a speed loop neither holds nor has to.
    """
    own = of(machine)
    p = HOIST.values(machine, point.payload_kg)
    vars(p).update(own.values_of(0.0), **(effect_values or {}))
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    even = EvenMotion(HOIST, joined(own.effects, effects), p, OUTPUTS)
    at = even.settled(point.height_m, sign * EVEN_SPEED * machine.motor.nominal_speed_rad_s)
    J = even.slopes(at)
    n, N = len(HOIST.positions), even.states
    A = np.block([[np.eye(N)[n : 2 * n]], [J[: N - n, :N]]])
    B = np.concatenate([np.zeros(n), J[: N - n, N]])[:, None]
    C = J[N - n :, :N]
    # Coordinates: the other positions as seen from one that rises evenly with the carriage.
    T = np.eye(N)
    T[: n - 1, n - 1] = even.rise(at)[: n - 1]
    A, B, C = (np.asarray(M, dtype=np.float64) for M in (np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T))
    relative = (f"{name}_relative" for name in HOIST.positions[: n - 1])
    names = (*relative, HOIST.positions[n - 1], *HOIST.speeds, *(m.symbol for m in even.effects.memory))
    keep = [i for i in range(2 * n) if height_free or i != n - 1]
    keep += _moved(A, B, keep, range(2 * n, N))
    return LinearPlant(
        tuple(names[i] for i in keep),
        OUTPUTS,
        A[np.ix_(keep, keep)],
        B[keep],
        C[:, keep],
        (at[:n], at[n:N], float(at[N])),
    )


def _moved(A: Array, B: Array, kept: Sequence[int], memory: Sequence[int]) -> list[int]:
    """Of the effects' memory what the motion moves; the rest stays where it is and is no part of the loop."""
    reached: list[int] = []
    while more := [i for i in memory if i not in reached and (np.any(A[i, [*kept, *reached]]) or B[i, 0] != 0.0)]:
        reached += more
    return reached
