"""A hypothesis linearised around its fit: on the campaign, and on planned runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.evidence import model_error_rms
from workbench.diagnose.hypotheses.fit import Fitted, is_timing
from workbench.diagnose.hypotheses.free_parameters import (
    LOAD_CELL_STD,
    TENSION_GAIN,
    FreeParameter,
    PhaseOfEachRun,
    Scalar,
    Setting,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import STEP, TENSION, TENSION_TRUST, Problem
from workbench.machines import kind_of

POSITION = "position_carriage_m"
LEAST = 0.35  # of the noise, rms: no model is more exact than that
POSITION_TRUST = 1e-4  # of the wire's length: a usual draw-wire encoder or laser


@dataclass(frozen=True)
class Line:
    """A hypothesis linearised in z around its fit, on the campaign or on one planned run.

    residual: (rows,) in standard deviations; jacobian: (rows, len(z)); own: (rows, k) the values that
    each run has of its own (a phase, a load cell's gain). own_hold: (k,) one over their standard deviations.
    channel: (rows,) the signal of each row. least: what is ignored of a difference, rms, in standard deviations.
    """

    residual: Array
    jacobian: Array
    own: Array
    own_hold: Array
    channel: np.ndarray
    share: float
    least: float


OnMenu = Callable[[int, tuple[str, ...]], Line]  # the number of the planned run, what is logged


def least_of(problem: Problem) -> float:
    """Of the noise, rms: no model is more exact. An axis leaves laws of its own, as much as the verdict allows for."""
    own = kind_of(problem.machine).floor == "own"
    return max(LEAST, model_error_rms(problem.with_model_error((1.0, 1.0))) / problem.noise) if own else LEAST


def on_campaign(problem: Problem, fit: Fitted) -> Line:
    rows = len(fit.residual)
    channel = np.where(np.arange(rows) < problem.inputs, 0, 1)
    nothing = np.zeros((rows, 0))
    return Line(
        fit.residual / problem.noise, fit.jacobian / problem.noise, nothing, np.zeros(0), channel, problem.share,
        least_of(problem),
    )  # fmt: skip


class Ahead(Problem):
    """Planned runs. Behind the dead line's tension stands the carriage's height below that at its start, in m: the
    simulation has it anyway. known: symbol -> what one STEP of a base parameter changes, (samples,), which is much the
    same in every fit."""

    def __init__(self, machine: Any, runs: Sequence[Run], band_hz: float) -> None:
        super().__init__(machine, runs, band_hz)
        self.run_of_row = np.tile(self.run_of_row[: self.inputs], 3 if self.has_tension else 1)
        self._below: list[Array] = []
        self.known: dict[str, Array] = {}

    def _tension(self, time_s: Array, states: Array, p: SimpleNamespace) -> Array:
        self._below.append(states[0, 1] - states[:, 1])
        return super()._tension(time_s, states, p)

    def _simulated(self, settings: Sequence[Setting], thin: bool) -> Array:
        self._below = []
        found, below, sets = super()._simulated(settings, thin), self._below, len(settings)
        of_runs = [np.stack(below[j * sets : (j + 1) * sets])[:, rows] for j, rows in enumerate(self.rows) if below]
        return np.hstack([found, *of_runs])


def on_menu(problem: Problem, ahead: Ahead, fit: Fitted) -> OnMenu:
    """A hypothesis on the planned runs, by the number of the run and its logged signals."""
    steps = [fit.z, *(fit.z + STEP * row for row in np.eye(len(fit.z)))]
    settings: list[Setting] = [_of_one_run(setting_of(fit.free, z)) for z in steps]
    cell = TENSION_GAIN not in settings[0]
    if cell:  # a load cell that the campaign did not have: its gain is not known
        settings.append({**settings[0], TENSION_GAIN: 1.0 + STEP * LOAD_CELL_STD})
    lasting = [_lasting(parameter) for parameter in fit.free for _ in range(parameter.size)] + [""] * cell
    anew = [k for k, moved in enumerate(settings[1:]) if lasting[k] not in ahead.known and moved != settings[0]]
    change = np.zeros((len(settings) - 1, ahead.samples))
    base, change[anew] = ahead.differences(settings[0], [settings[1 + k] for k in anew])
    for k, symbol in enumerate(lasting):
        if symbol:
            change[k] = ahead.known.setdefault(symbol, change[k])
    phases, least = _phases(fit.free), least_of(problem)

    def of_run(k: int, signals: tuple[str, ...]) -> Line:
        input_rows, *beside = np.flatnonzero(ahead.run_of_row == k).reshape(ahead.samples // ahead.inputs, -1)
        parts = [(input_rows, problem.noise)]
        if TENSION in signals:
            noise = problem.tension_noise if problem.has_tension else _tension_noise(ahead, k)
            # The menu's tension stands on the scale of its own torque and load cell.
            parts.append((beside[0], noise * ahead.noise / ahead.tension_noise))
        if POSITION in signals:
            length = kind_of(problem.machine).sizes(problem.machine, problem.runs).length
            parts.append((beside[1], POSITION_TRUST * length))
        residual = np.concatenate([base[rows] / unit for rows, unit in parts])
        slopes = np.concatenate([change[:, rows] / (STEP * unit) for rows, unit in parts], axis=1).T
        channel = np.repeat(np.arange(len(parts)), [len(rows) for rows, _ in parts])
        jacobian, own, hold = slopes[:, : len(fit.z)].copy(), [], []
        for first, many in phases:  # a new run has a phase of its own
            own.append(jacobian[:, first].copy())
            hold.append(0.0)
            jacobian[:, first : first + many] = 0.0
        if cell:
            own.append(slopes[:, -1])
            hold.append(1.0)
        extra = np.stack(own, axis=1) if own else np.zeros((len(residual), 0))
        return Line(residual, jacobian, extra, np.array(hold), channel, ahead.share, least)

    return of_run


def _lasting(parameter: FreeParameter) -> str:
    """The symbol of a base parameter whose signature is much the same in every fit, "" of another parameter."""
    if not isinstance(parameter, Scalar) or parameter.logarithmic or is_timing(parameter):
        return ""
    return parameter.symbol if math.isfinite(parameter.std) else ""


def _tension_noise(ahead: Problem, k: int) -> float:
    return TENSION_TRUST * float(np.mean(ahead.tension[k]))


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
