"""A hypothesis linearised around its fit: on the campaign, and on planned runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import (
    LOAD_CELL_STD,
    TENSION_GAIN,
    FreeParameter,
    PhaseOfEachRun,
    Setting,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import GROUP, SENSOR_KEYS, STEP, TENSION, TENSION_TRUST, Problem
from workbench.machines import kind_of
from workbench.simulate.driven import changed

POSITION = "position_carriage_m"
POSITION_TRUST = 1e-4  # of the wire's length: a usual draw-wire encoder or laser


@dataclass(frozen=True)
class Line:
    """A hypothesis linearised in z around its fit, on the campaign or on one planned run.

    residual: (rows,) in standard deviations; jacobian: (rows, len(z)); own: (rows, k) the values that
    each run has of its own (a phase, a load cell's gain). own_hold: (k,) one over their standard deviations.
    channel: (rows,) the signal of each row.
    """

    residual: Array
    jacobian: Array
    own: Array
    own_hold: Array
    channel: np.ndarray
    share: float


def on_campaign(problem: Problem, fit: Fitted) -> Line:
    rows = len(fit.residual)
    channel = np.where(np.arange(rows) < problem.inputs, 0, 1)
    nothing = np.zeros((rows, 0))
    return Line(
        fit.residual / problem.noise, fit.jacobian / problem.noise, nothing, np.zeros(0), channel, problem.share
    )


def on_menu(problem: Problem, ahead: Problem, fit: Fitted) -> Callable[[int, tuple[str, ...]], Line]:
    """A hypothesis on the planned runs, by the number of the run and its logged signals."""
    steps = [fit.z, *(fit.z + STEP * row for row in np.eye(len(fit.z)))]
    settings: list[Setting] = [_of_one_run(setting_of(fit.free, z)) for z in steps]
    cell = TENSION_GAIN not in settings[0]
    if cell:  # a load cell that the campaign did not have: its gain is not known
        settings.append({**settings[0], TENSION_GAIN: 1.0 + STEP * LOAD_CELL_STD})
    base, change = ahead.differences(settings[0], settings[1:])
    heights: list[Array] = []
    phases = _phases(fit.free)

    def of_run(k: int, signals: tuple[str, ...]) -> Line:
        mine = np.flatnonzero(ahead.run_of_row == k)
        input_rows, tension_rows = mine[mine < ahead.inputs], mine[mine >= ahead.inputs]
        parts = [(base[input_rows], change[:, input_rows] / STEP, problem.noise)]
        if TENSION in signals:
            noise = problem.tension_noise if problem.has_tension else _tension_noise(ahead, k)
            # The menu's tension stands on the scale of its own torque and load cell.
            unit = noise * ahead.noise / ahead.tension_noise
            parts.append((base[tension_rows], change[:, tension_rows] / STEP, unit))
        if POSITION in signals:
            if not heights:
                heights.extend(_heights(ahead, settings))
            x = heights[k]
            length = kind_of(problem.machine).sizes(problem.machine, problem.runs).length
            parts.append((-x[0], -(x[1:] - x[0]) / STEP, POSITION_TRUST * length))
        residual = np.concatenate([r / unit for r, _, unit in parts])
        slopes = np.concatenate([j / unit for _, j, unit in parts], axis=1).T
        channel = np.repeat(np.arange(len(parts)), [len(r) for r, _, _ in parts])
        jacobian, own, hold = slopes[:, : len(fit.z)].copy(), [], []
        for first, many in phases:  # a new run has a phase of its own
            own.append(jacobian[:, first].copy())
            hold.append(0.0)
            jacobian[:, first : first + many] = 0.0
        if cell:
            own.append(slopes[:, -1])
            hold.append(1.0)
        extra = np.stack(own, axis=1) if own else np.zeros((len(residual), 0))
        return Line(residual, jacobian, extra, np.array(hold), channel, ahead.share)

    return of_run


def _tension_noise(ahead: Problem, k: int) -> float:
    return TENSION_TRUST * float(np.mean(ahead.tension[k]))


def _heights(ahead: Problem, settings: Sequence[Setting]) -> list[Array]:
    """For each run (settings, rows): the carriage's height above that at its start, m."""
    out: list[list[Array]] = [[] for _ in ahead.runs]
    base = _values(ahead, settings[0])
    for k in range(1, len(settings), GROUP - 1):
        lanes = [base, *(_values(ahead, setting) for setting in settings[k : k + GROUP - 1])]
        predicted = ahead.bench.predict(lanes)
        for j, rows in enumerate(ahead.rows):
            x = [states[j][1][:, 1] for states in predicted]
            # All lanes of a group take the same steps: their differences are free of step-size noise.
            shift = [(lane - lane[0] - (x[0] - x[0][0]))[rows] for lane in x[1:]]
            if k == 1:
                out[j].append((x[0] - x[0][0])[rows])
            out[j] += [out[j][0] + change for change in shift]
    return [np.stack(heights) for heights in out]


def _values(ahead: Problem, setting: Setting) -> list[SimpleNamespace]:
    plain = {s: float(v) for s, v in setting.items() if s not in SENSOR_KEYS and not isinstance(v, tuple)}
    return [changed(p, plain) for p in ahead.bench.base]


def _phases(free: Sequence[FreeParameter]) -> list[tuple[int, int]]:
    """For each value that every run has of its own: its first index in z, and the number of runs."""
    phases, at = [], 0
    for parameter in free:
        if isinstance(parameter, PhaseOfEachRun):
            phases.append((at, len(parameter.start)))
        at += len(parameter.lowest)
    return phases


def _of_one_run(setting: Setting) -> dict[str, float | tuple[float, ...]]:
    return {symbol: value[0] if isinstance(value, tuple) else value for symbol, value in setting.items()}
