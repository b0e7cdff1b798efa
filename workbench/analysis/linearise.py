"""A machine as a linear system around an operating point, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from workbench.analysis.even_motion import EvenMotion
from workbench.analysis.linearise_axis import linearise_axis
from workbench.analysis.point import MOTIONS, LinearPlant, Motion, OperatingPoint, moved_memory
from workbench.effects import joined, of
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.plants import HOIST, NO_EFFECTS, Effects
from workbench.trace.expr import Scalar

# Of nominal motor speed: friction is saturated there, and far from the limits.
EVEN_SPEED = 0.5
__all__ = [
    "MOTIONS",
    "OUTPUTS",
    "STIFFNESS_BY_LENGTH",
    "LinearPlant",
    "Motion",
    "OperatingPoint",
    "linearise",
]
OUTPUTS = ("speed_motor_rad_s", "speed_carriage_m_s", "tension_drum_n")


def _by_length(s: Any, p: Any) -> Scalar:
    return -(s.x / (p.E * p.A))


# k = EA/(L - x): the free length of each fall instead of the whole one. The plant's own k is constant.
STIFFNESS_BY_LENGTH = Effects({"wire_compliance_m_per_n": [_by_length]})


def linearise(
    machine: Hoist | Axis,
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
    An axis' position is left out, too, unless `height_free`; see `linearise_axis`.
    """
    if kind_of(machine).looped.position_loop:
        return linearise_axis(
            cast(Axis, machine), point, effects=effects, effect_values=effect_values, placed=height_free
        )
    machine = cast(Hoist, machine)
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
    keep += moved_memory(A, B, keep, range(2 * n, N))
    return LinearPlant(
        tuple(names[i] for i in keep),
        OUTPUTS,
        A[np.ix_(keep, keep)],
        B[keep],
        C[:, keep],
        (at[:n], at[n:N], float(at[N])),
    )
