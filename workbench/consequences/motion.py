"""The small study that both machines are run through: its payloads, its moves and limits, its controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from workbench.analysis.usual import usual_controller, usual_settings
from workbench.control import Settings
from workbench.kinds import HOIST, Kind, kind_of
from workbench.machine import Axis, Hoist
from workbench.references import LimitPair, Limits, Step, allowed_carriage_speed_m_s
from workbench.run import Array, Run

REFERENCES = ("trapezoid", "ruckig")
_PLACED = ("start_position_m", "travel_m", "speed_m_s", "acceleration_m_s2", "jerk_m_s3")
WINDOW_S = 0.25  # speeds and accelerations are means over it: a sample's noise is no motion
AXIS_REST_S = 1.0  # an axis settles soon
AXIS_WINDOW_S = 0.05  # the same of an axis, whose ramps are short
LEAST_SPEED = 0.01  # of nominal: slower runs say nothing of how the machine is moved
END_OF_RAIL = 0.02  # of the rail, left free at both ends: the carriage swings a little past its reference
LONGEST_S = 60.0  # one way
LEAD_S, DWELL_S, SETTLE_S = 1.0, 2.0, 2.0


@dataclass(frozen=True)
class SmallStudy:
    """There and back again, every payload under every reference. from_runs: limits and travel are a campaign's.

    Of a rotary axis positions and limits are in radians.
    """

    payloads_kg: tuple[float, ...]
    start_position_m: float
    travel_m: float
    limits: Limits
    controller: Settings
    from_runs: bool
    controller_given: bool
    kind: Kind = HOIST

    @property
    def moves(self) -> tuple[Step, ...]:
        return (Step(by_m=self.travel_m), Step(dwell_s=self.dwell_s), Step(by_m=-self.travel_m))

    @property
    def dwell_s(self) -> float:
        """At rest between the moves, and of an axis after them: it settles soon."""
        return DWELL_S if self.kind.payload else AXIS_REST_S

    @property
    def settle_s(self) -> float:
        """At rest after the moves."""
        return SETTLE_S if self.kind.payload else self.dwell_s

    @property
    def limit_pair(self) -> LimitPair:
        return LimitPair.of(self.limits)

    @property
    def heights_m(self) -> tuple[float, ...]:
        """The heights of the loop analysis: bottom, middle and top of the travel."""
        low, high = self.start_position_m, self.start_position_m + self.travel_m
        return low, 0.5 * (low + high), high

    def as_json(self) -> dict[str, Any]:
        """An axis' keys have its units."""
        keys = {name: name.replace("_m", "_rad") if self.kind.moved.unit == "rad" else name for name in _PLACED}
        payloads = {"payloads_kg": list(self.payloads_kg)} if self.kind.payload else {}
        return payloads | {
            "references": list(REFERENCES),
            keys["start_position_m"]: self.start_position_m,
            keys["travel_m"]: self.travel_m,
            keys["speed_m_s"]: self.limits.speed_m_s,
            keys["acceleration_m_s2"]: self.limits.acceleration_m_s2,
            keys["jerk_m_s3"]: self.limits.jerk_m_s3,
            "limits_from_runs": self.from_runs,
            "controller": self.controller.model_dump(mode="json"),
            "controller_given": self.controller_given,
        }


def small_study(
    machine: Hoist | Axis,
    runs: Sequence[Run] = (),
    *,
    payloads_kg: Sequence[float] | None = None,
    controller: Settings | None = None,
) -> SmallStudy:
    """From a campaign's runs: payloads (lightest, middle, heaviest), fastest speed and acceleration, travel.

    Speed and acceleration of the carriage are the largest means over a quarter of a second; the jerk limit
    builds the acceleration up in two thirds of a ramp. Without runs that move: nine tenths of nominal speed,
    ramps of 1.2 s, five seconds' way from the lower part of the rail, payloads of none, half and one carriage
    mass. The controller is the rule's for 2.5 Hz where none is given. Of an axis see `_axis_study`.
    """
    if kind_of(machine).looped.position_loop:
        return _axis_study(cast(Axis, machine), runs, controller)
    machine = cast(Hoist, machine)
    nominal = allowed_carriage_speed_m_s(
        machine.motor.nominal_speed_rad_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
    )
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    bottom, top = low + END_OF_RAIL * (high - low), high - END_OF_RAIL * (high - low)
    motions = [motion for run in runs if (motion := _motion(machine, run)) and motion[0] > LEAST_SPEED * nominal]
    if motions:
        speed = min(max(motion[0] for motion in motions), 0.99 * nominal)
        acceleration = min(max(motion[1] for motion in motions), speed / 0.2)
        start = max(min(motion[2] for motion in motions), bottom)
        end = min(max(motion[3] for motion in motions), top)
    else:
        speed, acceleration = 0.9 * nominal, 0.9 * nominal / 1.2
        start = low + 0.25 * (high - low)
        end = start + min(0.5 * (high - low), 5.0 * speed)
    if end - start < 0.02 * (top - bottom):  # as far as nothing, or a height that is not this rail's
        start, end = bottom, 0.5 * (bottom + top)
    speed, acceleration = _digits(speed), _digits(acceleration)
    return SmallStudy(
        payloads_kg=_payloads(machine, runs) if payloads_kg is None else tuple(sorted(set(payloads_kg))),
        start_position_m=_digits(start),
        travel_m=_digits(min(end - start, LONGEST_S * speed)),
        limits=Limits(speed, acceleration, _digits(1.5 * acceleration**2 / speed)),
        controller=usual_controller(machine) if controller is None else controller,
        from_runs=bool(motions),
        controller_given=controller is not None,
    )


def _axis_study(machine: Axis, runs: Sequence[Run], controller: Settings | None) -> SmallStudy:
    """From a campaign's runs: fastest speed and acceleration as means over AXIS_WINDOW_S, from lowest to highest place.

    Without runs that move: nine tenths of the speed scale, ramps of 0.2 s, three ramps' way from 0. Limits keep
    to the drive's top speed, and ramps to half of its force limit beside friction and load.
    """
    kind = kind_of(machine)
    loop = kind.looped
    scale = min(loop.top_speed(machine).speed, loop.speed_scale(machine))
    motions = [motion for run in runs if (motion := _axis_motion(machine, run)) and motion[0] > 0.0]
    if motions:
        speed = min(max(motion[0] for motion in motions), 0.99 * loop.top_speed(machine).speed)
        acceleration = min(max(motion[1] for motion in motions), speed / 0.02)
        start, end = min(motion[2] for motion in motions), max(motion[3] for motion in motions)
    else:
        speed, acceleration = 0.9 * scale, 0.9 * scale / 0.2
        start, end = 0.0, 0.6 * speed
    steady = max(machine.role("coulomb_forward"), machine.role("coulomb_backward")) + machine.role("viscous") * speed
    steady += abs(machine.role("gravity_constant")) + abs(machine.role("gravity_sine"))
    room = 0.5 * (loop.input_limit(machine) - steady)
    if 0.0 < room < math.inf:
        acceleration = min(acceleration, room / loop.total_inertia(machine, 0.0))
    speed, acceleration = _digits(speed), _digits(acceleration)
    return SmallStudy(
        payloads_kg=(0.0,),
        start_position_m=_digits(start),
        travel_m=_digits(min(max(end - start, 1e-6), LONGEST_S * speed)),
        limits=Limits(speed, acceleration, _digits(1.5 * acceleration**2 / speed)),
        controller=usual_settings(machine)[0] if controller is None else controller,
        from_runs=bool(motions),
        controller_given=controller is not None,
        kind=kind,
    )


def _axis_motion(machine: Axis, run: Run) -> tuple[float, float, float, float] | None:
    """(fastest speed, largest acceleration, lowest and highest place) of an axis' run, m or rad and seconds."""
    t = run.time_s
    if len(t) < 3:
        return None
    if machine.position_signal in run:
        place = run[machine.position_signal]
    else:
        v = run[machine.speed_signal]
        place = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    return _fastest(run, place, AXIS_WINDOW_S)


def _fastest(run: Run, way: Array, window_s: float) -> tuple[float, float, float, float] | None:
    """Speed and acceleration as means over a window; the lowest and the highest place. None of too short a run."""
    t = run.time_s
    window = max(window_s, 4.0 * run.sample_time_s)
    if run.duration_s < 3.0 * window:
        return None
    at = np.arange(t[0], t[-1] - 2.0 * window, 0.2 * window)
    marks = [np.interp(at + k * window, t, way) for k in range(3)]
    first, second = ((marks[k + 1] - marks[k]) / window for k in range(2))
    fastest = max(_largest(first), _largest(second))
    return fastest, _largest((second - first) / window), float(np.min(way)), float(np.max(way))


def _motion(machine: Hoist, run: Run) -> tuple[float, float, float, float] | None:
    """(fastest speed m/s, largest acceleration m/s², lowest and highest carriage height m) of a run."""
    if "speed_motor_rad_s" not in run or len(run.time_s) < 3:
        return None
    t, v = run.time_s, run["speed_motor_rad_s"] * machine.lift_m_per_rad
    way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    motion = _fastest(run, way, WINDOW_S)
    if motion is None:
        return None
    height = run.signals.get("position_carriage_m", run.start_position_m + way)
    return motion[0], motion[1], float(np.min(height)), float(np.max(height))


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))


def _payloads(machine: Hoist, runs: Sequence[Run]) -> tuple[float, ...]:
    """The lightest, the one nearest to the middle, and the heaviest."""
    known = sorted({run.payload_kg for run in runs}) or [share * machine.carriage.mass_kg for share in (0.0, 0.5, 1.0)]
    middle = min(known, key=lambda load: abs(load - 0.5 * (known[0] + known[-1])))
    return tuple(sorted({known[0], middle, known[-1]}))


def _digits(value: float) -> float:
    """Rounded to three digits, so that the value in the text is the value of the run."""
    return float(f"{value:.3g}")
