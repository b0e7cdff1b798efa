"""The axis: one inertia, linear or rotary, driven directly.

    input = M a + B v + F S(v) + G sin(position) + C

M inertia (kg, kg m^2), B viscous, F Coulomb with a level for each way, G sine load
(rotary only), C constant load, positive against forward motion. Source: the axis'
equation of docs/formats.md; real logs of such an axis: A. Janot, M. Gautier,
M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System Identification
Benchmarks, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.plants.base import NO_EFFECTS, Effects, Output, Plant
from workbench.trace.expr import Scalar, clip, cos, sin, where

PLACES = {
    "axis_force": "force (torque) on an axis, forward positive",
    "axis_inertia": "inertia of an axis",
    "axis_switch": "what dry friction follows beyond the sign of the speed, -1 to 1",
}


def switch(v: Scalar, p: Any) -> Scalar:
    """The sign of a speed, linear within the standstill speed."""
    return clip(v / p.v_s, -1.0, 1.0)


def switch_at(t: Scalar, v: Scalar, p: Any, effects: Effects) -> Scalar:
    """What all dry friction of the axis follows, -1 to 1: the sign of the speed, or what an effect makes of it."""
    sign = switch(v, p)
    return sign + effects.at("axis_switch", p, t=t, v=v, switch=sign)


def level(sign: Scalar, p: Any) -> Scalar:
    """The Coulomb level of the way that `sign` says, a speed or a switch; N or N m."""
    return where(sign > 0.0, p.F_f, p.F_b)


def friction(v: Scalar, p: Any, sign: Scalar | None = None) -> Scalar:
    """Coulomb and viscous friction along v; N or N m. sign: what the dry part follows, else the sign of v."""
    s = switch(v, p) if sign is None else sign
    return level(s, p) * s + p.B * v


def accelerations(
    t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any, effects: Effects = NO_EFFECTS
) -> list[Scalar]:
    """Acceleration of the axis under the input u (N or N m)."""
    (x,), (v,) = q, y
    M = p.M + effects.at("axis_inertia", p, t=t, x=x)
    load = p.G * sin(x) + p.C
    sign = switch_at(t, v, p, effects)
    own = friction(v, p, sign)
    extra = effects.at("axis_force", p, t=t, v=v, x=x, angle=x, switch=sign, load=load, friction=own)
    return [(u - own - load + extra) / M]


def equilibrium(position: float, p: Any) -> tuple[list[float], float]:
    """Standing still at a position, and the input that holds it without friction's help."""
    return [position], p.G * sin(position) + p.C


def start_of(position: float, speed: float, p: Any) -> tuple[list[float], list[float], float]:
    q, hold = equilibrium(position, p)
    return q, [speed], hold


def band_hz(p: Any) -> float:
    """90 Hz: beyond, the noise of a twice differentiated encoder outweighs what drives and friction do."""
    return 90.0


def energy(q: Sequence[Scalar], y: Sequence[Scalar], p: Any) -> Scalar:
    """Kinetic and load energy, J, the sine load's zero at angle 0."""
    return p.M * (y[0] * y[0]) / 2.0 + p.G * (1.0 - cos(q[0])) + p.C * q[0]


def dissipation(t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any) -> Scalar:
    """Power lost in friction, W; never negative."""
    return friction(y[0], p) * y[0]


def _plant(kind: str, position: str, speed: str, drive: str, parameters: Mapping[str, str | float]) -> Plant:
    acceleration = "acceleration_m_s2" if kind == "axis-linear" else "acceleration_rad_s2"

    def outputs(
        t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any, effects: Effects = NO_EFFECTS
    ) -> Mapping[str, Scalar]:
        (a,) = accelerations(t, q, y, u, p, effects)
        return {position: q[0], speed: y[0], acceleration: a}

    return Plant(
        kind=kind,
        positions=(position,),
        speeds=(speed,),
        input=drive,
        parameters=parameters,
        places=PLACES,
        signals=(Output(position, "position"), Output(speed, "speed"), Output(acceleration, "acceleration")),
        accelerations=accelerations,
        outputs=outputs,
        equilibrium=equilibrium,
        energy=energy,
        dissipation=dissipation,
        start_of=start_of,
        band_hz=band_hz,
    )


AXIS_LINEAR = _plant(
    "axis-linear",
    "position_m",
    "velocity_m_s",
    "force_n",
    {
        "M": "mass_kg",
        "B": "friction.viscous_n_s_per_m",
        "F_f": "friction.coulomb_forward_n",
        "F_b": "friction.coulomb_backward_n",
        "v_s": "friction.standstill_speed_m_s",
        "G": 0.0,
        "C": "gravity.constant_n",
    },
)
AXIS_ROTARY = _plant(
    "axis-rotary",
    "angle_rad",
    "speed_rad_s",
    "torque_nm",
    {
        "M": "inertia_kg_m2",
        "B": "friction.viscous_nm_s_per_rad",
        "F_f": "friction.coulomb_forward_nm",
        "F_b": "friction.coulomb_backward_nm",
        "v_s": "friction.standstill_speed_rad_s",
        "G": "gravity.sine_nm",
        "C": "gravity.constant_nm",
    },
)
