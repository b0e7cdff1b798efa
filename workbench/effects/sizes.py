"""The sizes of a machine, so that bounds and scales of effects fit a machine of any size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.machine import Axis, Hoist
from workbench.plants import plant_of
from workbench.run import Run


@dataclass(frozen=True)
class Sizes:
    """What is large on one machine, SI; sizes["force/speed"] is a quotient of two.

    force: a hoist's weight of the empty carriage, an axis' largest input. torque: of all motors
    together, nominal; an axis' input. speed: of the carriage at nominal motor speed; an axis'
    largest. motor_speed: nominal. length: of the wire's fall; an axis' travel. radius,
    drum_angle: of the drum, and how far it turns for the whole length. mass: of the carriage.
    inertia: of drive and drum at the motor; of an axis.
    """

    kind: str
    force: float
    torque: float
    speed: float
    motor_speed: float
    length: float
    radius: float
    drum_angle: float
    mass: float
    inertia: float

    def __getitem__(self, size: str) -> float:
        numerator, _, denominator = size.partition("/")
        value = 1.0
        for word in numerator.split("*"):
            value *= self._one(word)
        for word in denominator.split("*") if denominator else ():
            value /= self._one(word)
        return value

    def _one(self, word: str) -> float:
        return 1.0 if word == "1" else float(getattr(self, word))

    @staticmethod
    def check(size: str) -> None:
        """KeyError for a quotient that names no size."""
        for word in size.replace("/", "*").split("*"):
            if word != "1" and (word == "kind" or word not in Sizes.__dataclass_fields__):
                known = ", ".join(name for name in Sizes.__dataclass_fields__ if name != "kind")
                raise KeyError(f"no size '{word}'; sizes: 1, {known}")


def sizes_of(machine: Hoist | Axis, runs: Sequence[Run] = ()) -> Sizes:
    """A machine's sizes; an axis says little about its own, so its runs are asked where there are any."""
    return _hoist(machine) if isinstance(machine, Hoist) else _axis(machine, runs)


def _hoist(m: Hoist) -> Sizes:
    radius, length = m.winch.drum_diameter_m / 2.0, m.wire.segment_length_m
    return Sizes(
        kind="hoist",
        force=m.carriage.mass_kg * m.gravity_m_s2,
        torque=m.motor.count * m.motor.nominal_torque_nm,
        speed=m.motor.nominal_speed_rad_s * m.lift_m_per_rad,
        motor_speed=m.motor.nominal_speed_rad_s,
        length=length,
        radius=radius,
        drum_angle=2.0 * length / radius,
        mass=m.carriage.mass_kg,
        inertia=m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / m.gearbox.ratio**2,
    )


def _axis(m: Axis, runs: Sequence[Run]) -> Sizes:
    inertia = m.role("inertia")
    force = max([float(np.max(np.abs(run[m.input_signal]))) for run in runs], default=0.0)
    friction = 0.5 * (m.role("coulomb_forward") + m.role("coulomb_backward"))
    said = friction + abs(m.role("gravity_sine")) + abs(m.role("gravity_constant"))
    length = max([_travel(m, run) for run in runs], default=0.0) or (1.0 if m.input_signal == "force_n" else math.pi)
    speed = max([_fastest(m, run) for run in runs], default=0.0) or length  # once through it in a second
    force = force or said or inertia * length
    return Sizes(
        kind=plant_of(m).kind,
        force=force,
        torque=force,
        speed=speed,
        motor_speed=speed,
        length=length,
        radius=length,
        drum_angle=length,
        mass=inertia,
        inertia=inertia,
    )


def _travel(m: Axis, run: Run) -> float:
    if m.position_signal in run:
        return float(np.ptp(run[m.position_signal]))
    return float(np.ptp(np.cumsum(run[m.speed_signal]) * run.sample_time_s))


def _fastest(m: Axis, run: Run) -> float:
    if m.speed_signal in run:
        return float(np.max(np.abs(run[m.speed_signal])))
    # The mean over a hundredth of the run: one sample's step of a noisy encoder is no speed.
    window = max(1, len(run.time_s) // 100)
    position, time = run[m.position_signal], run.time_s
    return float(np.max(np.abs((position[window:] - position[:-window]) / (time[window:] - time[:-window]))))
