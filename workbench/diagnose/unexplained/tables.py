"""Tables of force over one variable, as columns of a linear fit: what each level of each way adds to the prediction.

A force (torque) against the motion at the place where it acts, a level for each way, linear between
the points, as `measured_correction` has it. The machine counts as stiff here; what the wire
makes of it is left to the driven simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.diagnose.hypotheses.knobs import GAIN, Setting
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machine import Axis, Hoist, LinearAxis
from workbench.plants.hoist import PIN_SPEED
from workbench.run import Array
from workbench.simulate.driven import changed, sensor
from workbench.simulate.lowpass import lowpass

TURN = 2.0 * math.pi
POINTS, POINTS_OF_A_TURN = 17, 16
SPREAD = 0.02  # of the largest payload: payloads nearer than that are one


@dataclass(frozen=True)
class Variable:
    """over, acts_on: as in `measured_correction`. motor: whether it is the motor's speed that gives the way."""

    over: str
    acts_on: str
    turn: bool = False


HOIST = (
    Variable("position_carriage_m", "guide"),
    Variable("speed_carriage_m_s", "guide"),
    Variable("speed_motor_rad_s", "motor"),
    Variable("angle_drum_rad", "motor", turn=True),
    Variable("angle_motor_rad", "motor", turn=True),
    Variable("payload_kg", "guide"),
    Variable("time_s", "guide"),
    Variable("campaign_time_s", "guide"),
)
LINEAR = tuple(Variable(over, "axis") for over in ("velocity_m_s", "position_m", "time_s", "campaign_time_s"))
ROTARY = (
    Variable("speed_rad_s", "axis"),
    Variable("angle_rad", "axis"),
    Variable("angle_in_turn_rad", "axis", turn=True),
    Variable("time_s", "axis"),
    Variable("campaign_time_s", "axis"),
)


@dataclass(frozen=True)
class Ride:
    """One run as it is driven: over -> (n,), and the way that guide and motor (or the axis) go, -1 to 1, (n,)."""

    at: Mapping[str, Array]
    way: Mapping[str, Array]


def variables_of(problem: Problem) -> tuple[Variable, ...]:
    """What a table can be over in this campaign."""
    machine = problem.machine
    every = HOIST if isinstance(machine, Hoist) else LINEAR if isinstance(machine, LinearAxis) else ROTARY
    starts = {run.start_time_s for run in problem.runs}
    payloads = [run.payload_kg for run in problem.runs]
    without = set()
    if len(starts) == 1:
        without.add("campaign_time_s")
    if max(payloads) - min(payloads) <= SPREAD * max(payloads):
        without.add("payload_kg")
    return tuple(each for each in every if each.over not in without)


def rides_of(problem: Problem, setting: Setting) -> list[Ride]:
    """All runs as a machine of these values goes through them."""
    bench = problem.bench
    chosen = [_of_run(bench.base[j], setting, j) for j in range(len(problem.runs))]
    states = [out for _, out in bench.predict([chosen])[0]]
    found = []
    for j, (run, motion) in enumerate(zip(problem.runs, bench.motions, strict=True)):
        clock = {"time_s": run.time_s, "campaign_time_s": run.time_s - run.time_s[0] + run.start_time_s}
        if isinstance(problem.machine, Axis):
            x, v = motion.position, motion.speed
            way = np.clip(v / chosen[j].v_s, -1.0, 1.0)
            at = {
                "velocity_m_s": np.abs(v), "position_m": x,
                "speed_rad_s": np.abs(v), "angle_rad": x, "angle_in_turn_rad": x % TURN,
            }  # fmt: skip
            found.append(Ride({**clock, **at}, {"axis": way}))
            continue
        p = chosen[j]
        height, v = states[j][:, 1], states[j][:, 3]
        first = bench.plant.start_of(run.start_position_m, float(motion.speed[0]), p)[0][0]
        angle = first + motion.position - motion.position[0]
        at = {
            "position_carriage_m": height,
            "speed_carriage_m_s": np.abs(v),
            "speed_motor_rad_s": np.abs(motion.speed),
            "angle_motor_rad": angle % TURN,
            "angle_drum_rad": (angle / p.ratio) % TURN,
            "payload_kg": np.full(len(v), run.payload_kg),
        }
        guide = np.arctan(p.slope * v) * (2.0 / math.pi)
        motor = np.clip(motion.speed / p.ratio / PIN_SPEED, -1.0, 1.0)
        found.append(Ride({**clock, **at}, {"guide": guide, "motor": motor}))
    return found


def _of_run(base: SimpleNamespace, setting: Setting, j: int) -> SimpleNamespace:
    """Run j's parameters; what belongs to the sensors stays out."""
    known = {key: value for key, value in setting.items() if hasattr(base, key)}
    return changed(base, {key: value[j] if isinstance(value, tuple) else value for key, value in known.items()})


def points_of(problem: Problem, rides: Sequence[Ride], variable: Variable) -> Array:
    """Where the levels of a table stand: evenly over what the runs have passed; at the payloads there were."""
    if variable.turn:
        return np.linspace(0.0, TURN, POINTS_OF_A_TURN, endpoint=False, dtype=np.float64)
    if variable.over == "payload_kg":
        payloads = sorted({run.payload_kg for run in problem.runs})
        apart = [payloads[0]]
        apart += [b for b in payloads[1:] if b - apart[-1] > SPREAD * payloads[-1]]
        return np.array(apart if len(apart) > 2 else [apart[0], 0.5 * (apart[0] + apart[-1]), apart[-1]])[:POINTS]
    visited = [ride.at[variable.over][rows] for ride, rows in zip(rides, problem.rows, strict=True)]
    every = np.concatenate(visited)
    low, high = float(np.min(every)), float(np.max(every))
    return np.linspace(low, high, POINTS, dtype=np.float64)


def columns_of(problem: Problem, rides: Sequence[Ride], variable: Variable, at: Array, gain: float) -> Array:
    """(samples, 2 points) what a level of one, first all forward, then all backward ones, adds to the prediction."""
    input_gain = gain * lever_of(problem.machine, variable.acts_on)
    torque, tension = [], []
    for run, ride, rows in zip(problem.runs, rides, problem.rows, strict=True):
        way = ride.way[variable.acts_on]
        hats = hats_of(ride.at[variable.over], at, variable.turn)
        levels = np.hstack([hats * np.maximum(way, 0.0)[:, None], hats * np.minimum(way, 0.0)[:, None]])
        smooth = lowpass(run.time_s, levels, problem.band_hz)[rows]
        torque.append(input_gain * smooth)
        if problem.has_tension:
            # Two falls carry a force on the carriage, and nothing of a torque at the motor.
            share = 0.5 if variable.acts_on == "guide" else 0.0
            tension.append(share * problem.noise / problem.tension_noise * smooth)
    return np.concatenate([*torque, *tension])


def hats_of(x: Array, at: Array, turn: bool) -> Array:
    """(n, points) how much each point counts at x: linear between points, the end ones beyond them."""
    if turn:
        closed = np.append(at, at[0] + TURN)
        x = at[0] + (x - at[0]) % TURN
    else:
        closed, x = at, np.clip(x, at[0], at[-1])
    k = np.clip(np.searchsorted(closed, x, side="right") - 1, 0, len(closed) - 2)
    share = (x - closed[k]) / (closed[k + 1] - closed[k])
    found = np.zeros((len(x), len(at)))
    rows = np.arange(len(x))
    found[rows, k] = 1.0 - share
    found[rows, (k + 1) % len(at)] += share
    return found


def gain_of(problem: Problem, setting: Setting) -> float:
    """The logged input over the true one."""
    value = setting.get(GAIN, sensor(problem.machine)[0])
    return value if isinstance(value, float) else float(np.mean(value))


def lever_of(machine: Hoist | Axis, acts_on: str) -> float:
    """Input that a force (torque) at a place takes on a stiff machine: m/rad, or 1."""
    return machine.lift_m_per_rad if isinstance(machine, Hoist) and acts_on == "guide" else 1.0
