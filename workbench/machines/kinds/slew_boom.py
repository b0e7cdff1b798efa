"""`kind: slew_boom`: a crane's boom on its slewing ring, with a payload held at a radius; it does not swing.

    T = (J + m r²) φ̈ + F S(φ̇) + B φ̇ + G sin φ + C

T torque of the drive at the ring, N m; J boom about the ring's axis, m payload at radius r; F Coulomb friction of the
ring, a level for each way, B viscous. G: the wind that blows on the boom, or the slope that the crane stands on, whose
torque goes with the sine of the angle from where it vanishes; C constant, positive against forward motion. A gear's
ratio is taken into the values. Source: Newton's law about the ring's axis; slewing resistance as FEM 1.001, booklet 2,
sums it up: inertia, friction, wind and slope.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np

from workbench.core import record
from workbench.core.record import Record
from workbench.core.run import Array
from workbench.machines.declare import Value
from workbench.machines.kinds import axis
from workbench.symbolic.expr import Scalar


class Boom(Record):
    """About the slewing ring's axis, without payload."""

    inertia_kg_m2: record.Inertia


class HeldPayload(Record):
    """What hangs at the boom; its radius counts from the slewing ring's axis."""

    mass_kg: record.Payload = 0.0
    radius_m: record.Length


class SlewBoomTolerances(axis.RotaryTolerances):
    payload: record.Tolerance = 0.02


class SlewBoom(axis.Rotary):
    """`kind: slew_boom`: kg m², kg, m, N m, rad."""

    kind: Literal["slew_boom"] = "slew_boom"
    name: str = "slewing boom"
    boom: Boom
    payload: HeldPayload
    friction: axis.RotaryFriction
    gravity: axis.RotaryGravity = axis.RotaryGravity()
    tolerances: SlewBoomTolerances = SlewBoomTolerances()

    value_of: ClassVar[dict[str, str]] = {**axis.Rotary.value_of, "inertia": "boom.inertia_kg_m2"}

    def role(self, name: str) -> float:
        """As an axis'; its inertia is the boom's with the payload."""
        with_payload = self.payload.mass_kg * self.payload.radius_m**2 if name == "inertia" else 0.0
        return super().role(name) + with_payload


# Runs at one radius show the sum of both inertias only: the payload is weighed, the boom's is fitted.
VALUES = (
    *axis.axis_values(SlewBoom),
    Value("payload.mass_kg", "m", "payload"),
    Value("payload.radius_m", "r", exact="it is measured, and shows as the payload's mass does"),
)


def inertia(p: Any) -> Scalar:
    """Boom and payload about the ring's axis, kg m²."""
    return p.M + p.m * (p.r * p.r)


def _transmitted(p: Any, s: Any, u: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    return np.asarray(p.G * np.sin(s.x) + p.C), float(inertia(p))


_OWN = axis.axis_kind(
    SlewBoom,
    axis.axis_plant("slew_boom", SlewBoom, VALUES, inertia),
    VALUES,
    {
        "boom": {"inertia_kg_m2": 2.4e5},
        "payload": {"mass_kg": 3000.0, "radius_m": 12.0},
        "friction": {"coulomb_forward_nm": 9e3, "coulomb_backward_nm": 8.5e3, "viscous_nm_s_per_rad": 3e4},
        "gravity": {"sine_nm": 6e3},
        # The encoder sits at the motor: its counts are those of a turn times the gear's ratio.
        "drive": {
            "torque_limit_nm": 1.2e5,
            "nominal_torque_nm": 6e4,
            "top_speed_rad_s": 0.2,
            "encoder_counts_per_turn": 50_000_000,
        },
    },
    noun="boom",
)
KIND = replace(
    _OWN, transmitted=_transmitted, closed_loop=replace(_OWN.looped, start="the boom's angle", inertia=inertia)
)
