"""The variables that the gap may depend on: speed, height, payload and others, at every residual of the input."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import kind_of
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass

TURN = 2.0 * math.pi
TURNS = 1.5  # passed at least: within one turn an angle is a height and no more
SPEED_EDGES = (0.0, 0.02, 0.05, 0.09, 0.14, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)  # of the fastest: finer where it creeps
START_EDGES = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0)  # periods of the band since the start of a motion


@dataclass(frozen=True)
class Variable:
    """at: (inputs,) its value at every residual of the input. edges: (k + 1,) of its bins.

    wraps: the last bin joins the first, a turn. straight: few values only, with straight lines between them.
    """

    name: str
    label: str
    unit: str
    regime: str
    at: Array
    edges: Array
    wraps: bool = False
    straight: bool = False


def variables(problem: Problem, gap: Array | None = None) -> list[Variable]:
    """All variables that these runs vary, the simplest explanation first.

    gap: (inputs,) measured less predicted input; with it the predicted one is among them.
    """
    candidates = [_direction(problem)]
    if kind_of(problem.machine).payload:
        candidates.append(_payload(problem))
    candidates += [_speed(problem), _acceleration(problem), _since_start(problem), *_turns(problem), _position(problem)]
    candidates += [_run_time(problem), _campaign_time(problem)]
    if gap is not None:
        candidates.append(_input(problem, gap))
    return [variable for variable in candidates if np.ptp(variable.at) > 0.0]


def forward(problem: Problem) -> np.ndarray:
    """(inputs,) bool: hoisting or forward."""
    return of_rows(problem, lambda b, j: _smooth_speed(b, j)) > 0.0


def of_rows(problem: Problem, of_run: Callable[[Bench, int], Array]) -> Array:
    """The series of all runs, (n,) each from of_run, at the residuals of the input: (inputs,)."""
    return np.concatenate([of_run(problem.bench, j)[rows] for j, rows in enumerate(problem.rows)])


def times(problem: Problem) -> Array:
    """(inputs,) s, on each run's own clock."""
    return of_rows(problem, lambda b, j: b.runs[j].time_s)


def spacing(problem: Problem) -> Array:
    """(inputs,) s: the time between a residual and the next."""
    steps = [float(np.median(np.diff(run.time_s))) for run in problem.runs]
    strides = [int(np.min(np.diff(rows))) if len(rows) > 1 else 1 for rows in problem.rows]
    return np.repeat(np.multiply(steps, strides), problem.run_lengths)


def _smooth_speed(bench: Bench, j: int) -> Array:
    return lowpass(bench.runs[j].time_s, bench.motions[j].speed, bench.band_hz)


def _direction(problem: Problem) -> Variable:
    at = np.where(forward(problem), 1.0, -1.0)
    return Variable("direction", "direction", "1", "all", at, np.array([-1.5, 0.0, 1.5]), straight=True)


def _payload(problem: Problem) -> Variable:
    at = of_rows(problem, lambda b, j: np.full(len(b.runs[j].time_s), b.runs[j].payload_kg))
    known = np.unique(at)
    between = 0.5 * (known[1:] + known[:-1])
    margin = 0.5 * float(np.max(np.diff(known))) if len(known) > 1 else 1.0
    edges = np.concatenate([[known[0] - margin], between, [known[-1] + margin]])
    return Variable("payload", "payload", "kg", "load", at, edges, straight=True)


def _speed(problem: Problem) -> Variable:
    kind = kind_of(problem.machine)
    at = np.abs(of_rows(problem, _smooth_speed)) * kind.lever_of(problem.machine)
    edges = float(np.max(at)) * np.array(SPEED_EDGES)
    return Variable("speed", f"speed of the {kind.moved.noun}", kind.moved.speed_unit, "speed", at, edges)


def _acceleration(problem: Problem) -> Variable:
    kind = kind_of(problem.machine)
    lift, unit = kind.lever_of(problem.machine), f"{kind.moved.unit}/s²"

    def smooth(b: Bench, j: int) -> Array:
        return lowpass(b.runs[j].time_s, b.motions[j].acceleration, b.band_hz) * lift

    at = of_rows(problem, smooth)
    top = float(np.max(np.abs(at)))
    edges = top * np.array([-1.0, -0.6, -0.35, -0.18, -0.06, 0.06, 0.18, 0.35, 0.6, 1.0])
    return Variable("acceleration", f"acceleration of the {kind.moved.noun}", unit, "acceleration", at, edges)


def _since_start(problem: Problem) -> Variable:
    """Time since the machine last started from rest, or since the run's beginning."""

    def since(b: Bench, j: int) -> Array:
        t, going = b.runs[j].time_s, b.moving[j]
        begins = np.flatnonzero(np.diff(np.concatenate([[False], going]).astype(int)) == 1)
        if not len(begins):
            return np.zeros(len(t))
        which = np.clip(np.searchsorted(begins, np.arange(len(t)), side="right") - 1, 0, None)
        return np.maximum(t - t[begins][which], 0.0)

    at = of_rows(problem, since)
    longest = float(np.max(at))
    edges = [e / problem.band_hz for e in START_EDGES if e / problem.band_hz < longest]
    return Variable("since_start", "time since the start of the motion", "s", "start", at, np.array([*edges, longest]))


def way(problem: Problem) -> Array:
    """(inputs,) height of the carriage or position of the axis, m or rad."""
    return of_rows(problem, place)


def _position(problem: Problem) -> Variable:
    at = way(problem)
    moved = kind_of(problem.machine).moved
    return Variable("position", moved.position, moved.unit, "position", at, _even(at, 24))


def place(bench: Bench, j: int) -> Array:
    """(n,) position of the carriage (on an inextensible wire) or of the axis, m or rad."""
    kind = kind_of(bench.machine)
    return kind.place_of(bench.machine, bench.runs[j].start_position_m, bench.motions[j].position)


def _turns(problem: Problem) -> list[Variable]:
    """Angles folded to one turn, of the parts that turned often enough."""
    kind, turns = kind_of(problem.machine), []
    for part in kind.turning:
        if part.folded is not None:
            name, label = part.folded
            angle = TURN * part.turns_per_way(problem.machine) * way(problem)
            turns += _folded(name, label, angle)
    return turns


def _folded(name: str, label: str, angle: Array) -> list[Variable]:
    if np.ptp(angle) < TURNS * TURN:
        return []
    edges = np.linspace(0.0, TURN, 13)
    return [Variable(name, label, "rad", "periodic", angle % TURN, edges, wraps=True)]


def _input(problem: Problem, gap: Array) -> Variable:
    """The predicted input of the motion; the measured one contains the gap itself."""
    drive = kind_of(problem.machine).drive
    at = of_rows(problem, lambda b, j: b.measured[j]) - gap
    return Variable("input", f"{drive.quantity} that the motion takes", drive.unit, "load", at, _even(at, 10))


def _run_time(problem: Problem) -> Variable:
    at = of_rows(problem, lambda b, j: b.runs[j].time_s - b.runs[j].time_s[0])
    return Variable("run_time", "time since the run's start", "s", "time", at, _even(at, 16))


def _campaign_time(problem: Problem) -> Variable:
    begins = {run.start_time_s for run in problem.runs}
    at = of_rows(problem, lambda b, j: b.runs[j].start_time_s + b.runs[j].time_s - b.runs[j].time_s[0])
    at = at if len(begins) > 1 else np.zeros(len(at))  # else it is the run's time
    return Variable("campaign_time", "time since the campaign began", "s", "time", at, _even(at, 6))


def _even(at: Array, bins: int) -> Array:
    return np.linspace(float(np.min(at)), float(np.max(at)), bins + 1)
