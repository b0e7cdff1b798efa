"""Tables of force over one variable as columns of a linear fit, one column for each level of each direction.

A force (torque) against the motion at the place where it acts, a level for each way, linear between
the points, as `measured_correction` has it. The machine is taken as stiff here; the driven simulation adds the effect
of the wire.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.free_parameters import GAIN, Setting
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import Axis, Hoist, Table, kind_of
from workbench.simulate.driven import changed, sensor
from workbench.simulate.lowpass import lowpass

TURN = 2.0 * math.pi
POINTS, POINTS_OF_A_TURN = 17, 16
SPREAD = 0.02  # of the largest payload: payloads nearer than that are one


@dataclass(frozen=True)
class Ride:
    """One run. at: variable -> (n,). way: part -> direction of motion of guide and motor (or axis), -1 to 1, (n,)."""

    at: Mapping[str, Array]
    way: Mapping[str, Array]


def variables_of(problem: Problem) -> tuple[Table, ...]:
    """The variables that a table can be over in this campaign."""
    starts = {run.start_time_s for run in problem.runs}
    payloads = [run.payload_kg for run in problem.runs]
    without = set()
    if len(starts) == 1:
        without.add("campaign_time_s")
    if max(payloads) - min(payloads) <= SPREAD * max(payloads):
        without.add("payload_kg")
    return tuple(variable for variable in kind_of(problem.machine).tables if variable.over not in without)


def rides_of(problem: Problem, setting: Setting) -> list[Ride]:
    """All runs, simulated with the machine of these values."""
    bench = problem.bench
    chosen = [_of_run(bench.base[j], setting, j) for j in range(len(problem.runs))]
    predicted = bench.predict([chosen])[0]
    kind, rides = kind_of(problem.machine), []
    for run, motion, (force, others), p in zip(problem.runs, bench.motions, predicted, chosen, strict=True):
        frame = kind.frame(run, motion.position, motion.speed, others, p)
        frame.load, _ = kind.transmitted(p, frame, force, motion.acceleration, run.payload_kg)
        here = changed(p, {"start_time_s": run.start_time_s - run.time_s[0]})
        at = {table.over: np.broadcast_to(table.of(frame, here), run.time_s.shape) for table in kind.tables}
        turned = {table.over: at[table.over] % TURN for table in kind.tables if table.turn}
        way = {acts_on: port.way(frame, here) for acts_on, port in kind.ports.items()}
        rides.append(Ride({**at, **turned}, way))
    return rides


def _of_run(base: SimpleNamespace, setting: Setting, j: int) -> SimpleNamespace:
    """Run j's parameters; what belongs to the sensors stays out."""
    known = {key: value for key, value in setting.items() if hasattr(base, key)}
    return changed(base, {key: value[j] if isinstance(value, tuple) else value for key, value in known.items()})


def points_of(problem: Problem, rides: Sequence[Ride], variable: Table) -> Array:
    """The points of a table: evenly over the range of the runs; for the payload, the payloads of the runs."""
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


def columns_of(problem: Problem, rides: Sequence[Ride], variable: Table, at: Array, gain: float) -> Array:
    """(samples, 2 points) the change of the prediction by a level of one: first all forward, then all backward."""
    input_gain = gain * lever_of(problem.machine, variable.acts_on)
    torque, tension = [], []
    for run, ride, rows in zip(problem.runs, rides, problem.rows, strict=True):
        way = ride.way[variable.acts_on]
        hats = hats_of(ride.at[variable.over], at, variable.turn)
        levels = np.hstack([hats * np.maximum(way, 0.0)[:, None], hats * np.minimum(way, 0.0)[:, None]])
        smooth = lowpass(run.time_s, levels, problem.band_hz)[rows]
        torque.append(input_gain * smooth)
        if problem.has_tension:
            share = kind_of(problem.machine).ports[variable.acts_on].share
            tension.append(share * problem.noise / problem.tension_noise * smooth)
    return np.concatenate([*torque, *tension])


def hats_of(x: Array, at: Array, turn: bool) -> Array:
    """(n, points) the weight of each point at x: linear between points, constant beyond the ends."""
    if turn:
        closed = np.append(at, at[0] + TURN)
        x = at[0] + (x - at[0]) % TURN
    else:
        closed, x = at, np.clip(x, at[0], at[-1])
    k = np.clip(np.searchsorted(closed, x, side="right") - 1, 0, len(closed) - 2)
    share = (x - closed[k]) / (closed[k + 1] - closed[k])
    hats = np.zeros((len(x), len(at)))
    rows = np.arange(len(x))
    hats[rows, k] = 1.0 - share
    hats[rows, (k + 1) % len(at)] += share
    return hats


def gain_of(problem: Problem, setting: Setting) -> float:
    """The logged input over the true one."""
    value = setting.get(GAIN, sensor(problem.machine)[0])
    return value if isinstance(value, float) else float(np.mean(value))


def lever_of(machine: Hoist | Axis, acts_on: str) -> float:
    """Input that a force (torque) at a place takes on a stiff machine: m/rad, or 1."""
    kind = kind_of(machine)
    return kind.transmission_of(machine) if kind.ports[acts_on].on_moved else 1.0
