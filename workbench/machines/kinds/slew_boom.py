"""`kind: slew_boom`: a crane's boom on its slewing ring, with a payload held at a radius; it does not swing.

    T = (J + m r²) φ̈ + F S(φ̇) + B φ̇ + G sin φ + C

T torque of the drive at the ring, N m; J boom about the ring's axis, m payload at radius r; F Coulomb friction of the
ring, a level for each way, B viscous. G: the wind that blows on the boom, or the slope that the crane stands on, whose
torque goes with the sine of the angle from where it vanishes; C constant, positive against forward motion. A gear's
ratio is taken into the values. Source: Newton's law about the ring's axis; slewing resistance as FEM 1.001, booklet 2,
sums it up: inertia, friction, wind and slope.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from workbench.core.record import Inertia, Length, Payload, Record, Tolerance, by_name
from workbench.core.run import Array
from workbench.machines.correction import MeasuredCorrection
from workbench.machines.kind import BaseValue, Input, Kind, Moved, Turning
from workbench.machines.kinds.axis import (
    ROTARY_DRIVES,
    Axis,
    RotaryAxis,
    RotaryCorrection,
    RotaryDrive,
    RotaryFriction,
    RotaryGravity,
    RotarySensors,
    RotaryTolerances,
    axis_kind,
    axis_plant,
)
from workbench.symbolic.expr import Scalar


class Boom(Record):
    """About the slewing ring's axis, without payload."""

    inertia_kg_m2: Inertia


class HeldPayload(Record):
    """What hangs at the boom; its radius counts from the slewing ring's axis."""

    mass_kg: Payload = 0.0
    radius_m: Length


class SlewBoomTolerances(RotaryTolerances):
    payload: Tolerance = 0.02


class SlewBoom(Axis):
    """`kind: slew_boom`: kg m², kg, m, N m, rad."""

    kind: Literal["slew_boom"] = "slew_boom"
    name: str = "slewing boom"
    boom: Boom
    payload: HeldPayload
    friction: RotaryFriction
    gravity: RotaryGravity = RotaryGravity()
    drive: Annotated[RotaryDrive, *by_name(ROTARY_DRIVES)] = RotaryDrive()
    sensors: RotarySensors = RotarySensors()
    tolerances: SlewBoomTolerances = SlewBoomTolerances()
    measured_correction: RotaryCorrection | None = None

    value_of: ClassVar[dict[str, str]] = {**RotaryAxis.value_of, "inertia": "boom.inertia_kg_m2"}
    input_signal: ClassVar[str] = RotaryAxis.input_signal
    position_signal: ClassVar[str] = RotaryAxis.position_signal
    speed_signal: ClassVar[str] = RotaryAxis.speed_signal
    reference_signal: ClassVar[str] = RotaryAxis.reference_signal
    CORRECTION: ClassVar[type[MeasuredCorrection]] = RotaryCorrection

    def role(self, name: str) -> float:
        """As an axis'; its inertia is the boom's with the payload."""
        with_payload = self.payload.mass_kg * self.payload.radius_m**2 if name == "inertia" else 0.0
        return super().role(name) + with_payload


def inertia(p: Any) -> Scalar:
    """Boom and payload about the ring's axis, kg m²."""
    return p.M + p.m * (p.r * p.r)


PLANT = axis_plant(
    "slew_boom",
    "angle_rad",
    "speed_rad_s",
    "torque_nm",
    {
        "M": "boom.inertia_kg_m2",
        "m": "payload.mass_kg",
        "r": "payload.radius_m",
        "B": "friction.viscous_nm_s_per_rad",
        "F_f": "friction.coulomb_forward_nm",
        "F_b": "friction.coulomb_backward_nm",
        "v_s": "friction.standstill_speed_rad_s",
        "G": "gravity.sine_nm",
        "C": "gravity.constant_nm",
    },
    inertia,
)


def _transmitted(p: Any, s: Any, u: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    return np.asarray(p.G * np.sin(s.x) + p.C), float(inertia(p))


def _kind() -> Kind:
    own = axis_kind(
        SlewBoom,
        PLANT,
        example={
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
        family=("slew_boom", "axis-rotary", "axis"),
        drive=Input("torque", "N m", "nm"),
        moved=Moved("boom", "rad", "angle of the boom", placed_by_log=True),
        standstill="friction.standstill_speed_rad_s",
        turning=(Turning("axis", lambda m: 1.0 / (2.0 * math.pi), ("angle", "angle within a turn")),),
    )
    return replace(
        own,
        # Runs at one radius show the sum of both inertias only: the payload is weighed, the boom's is fitted.
        base=(*own.base, BaseValue("payload.mass_kg", "payload")),
        held=("payload.radius_m",),
        transmitted=_transmitted,
        closed_loop=replace(
            own.looped, drawn=(*own.looped.drawn, "payload.mass_kg"), start="the boom's angle", inertia=inertia
        ),
    )


KIND = _kind()
