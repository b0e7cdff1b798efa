"""A hypothesis linearised around its fit: on the campaign, and on planned runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.evidence import model_error_rms
from workbench.diagnose.hypotheses.fit import Fitted, is_timing
from workbench.diagnose.hypotheses.free_parameters import (
    LOAD_CELL_STD,
    LOG_TIMING,
    TENSION_GAIN,
    FreeParameter,
    PhaseOfEachRun,
    Scalar,
    Setting,
    inward,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import STEP, TENSION, Problem
from workbench.machines import kind_of
from workbench.simulate.model_error import BOUNDS

LEAST = 0.35  # of the noise, rms: no model is more exact than that


@dataclass(frozen=True)
class Line:
    """A hypothesis linearised in z around its fit, on the campaign or on one planned run.

    residual: (rows,) in standard deviations; jacobian: (rows, len(z)); own: (rows, k) the values that
    each run has of its own (a phase, a load cell's gain). own_hold: (k,) one over their standard deviations.
    channel: (rows,) the signal of each row. least: what is ignored of a difference, rms, in standard deviations.
    white: (rows, len(z) + k + 1) of a planned run, whitened as the evidence is: jacobian, own and residual.
    """

    residual: Array
    jacobian: Array
    own: Array
    own_hold: Array
    channel: np.ndarray
    share: float
    least: float
    white: Array = field(default_factory=lambda: np.zeros((0, 1)))


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


def ahead_of(problem: Problem, runs: Sequence[Run], fit: Fitted) -> Problem:
    """Planned runs as the campaign is weighed: with its noise and model error, at the input that a fit foretells. Near
    standstill, where a machine's own friction is by no law's word, with as much of it as a campaign may have."""
    ahead = Problem(problem.machine, runs, problem.band_hz)
    ahead.noise, ahead.row_noise = problem.noise, np.full(ahead.inputs, problem.noise)
    if problem.has_tension:
        ahead.tension_noise = problem.tension_noise
    required = ahead.bench.required(ahead.tables([_of_one_run(fit.setting)]))
    ahead.bench.measured = [every[:, 0, 0] for every in required]
    ahead.errors = ahead.errors_of_rows().sized((problem.errors.sizes[0], BOUNDS[1][1]))
    return ahead


def on_menu(problem: Problem, ahead: Problem, fit: Fitted, rough: Mapping[str, tuple[float, float]]) -> OnMenu:
    """A hypothesis on the planned runs, by the number of the run and its logged signals. What base parameters change,
    which is much the same in every fit, is kept with `ahead`, by their symbol. rough: of `rough_of`, each run's own."""
    anyway, steps = {s: v for s, (v, _) in rough.items()}, inward(fit.free, fit.z, np.full(len(fit.z), STEP))
    moved = [fit.z, *(fit.z + np.diag(steps))]
    settings: list[Setting] = [{**_of_one_run(setting_of(fit.free, z)), **anyway} for z in moved]
    own = {symbol: value + STEP * std for symbol, (value, std) in rough.items()}
    if TENSION_GAIN not in settings[0]:  # a load cell that the campaign did not have: its gain is not known
        own[TENSION_GAIN] = 1.0 + STEP * LOAD_CELL_STD
    settings += [{**settings[0], symbol: value} for symbol, value in own.items()]
    lasting = [_lasting(parameter) for parameter in fit.free for _ in range(parameter.size)] + [""] * len(own)
    anew = [k for k, one in enumerate(settings[1:]) if lasting[k] not in ahead.kept and one != settings[0]]
    change = np.zeros((len(settings) - 1, ahead.samples))
    base, change[anew] = ahead.differences(settings[0], [settings[1 + k] for k in anew])
    change[: len(steps)] *= np.sign(steps)[:, None]
    for k, symbol in enumerate(lasting):
        if symbol:
            change[k] = ahead.kept.setdefault(symbol, change[k])
    phases, least = _phases(fit.free), least_of(problem)
    white = ahead.errors.whiten(np.vstack([change / STEP, base]).T)
    hold = np.array([0.0] * len(phases) + [1.0] * len(own))

    def of_run(k: int, signals: tuple[str, ...]) -> Line:
        rows = np.flatnonzero(ahead.run_of_row == k)
        channel = np.where(rows < ahead.inputs, 0, 1)
        rows, channel = (rows, channel) if TENSION in signals else (rows[channel == 0], channel[channel == 0])

        def parts(slopes: Array) -> tuple[Array, Array]:
            jacobian, count = slopes[:, : len(fit.z)].copy(), len(fit.z)
            of_its_own = slopes[:, [*(first for first, _ in phases), *range(count, count + len(own))]]
            for first, many in phases:  # a new run has a phase of its own
                jacobian[:, first : first + many] = 0.0
            return jacobian, of_its_own

        whitened = np.column_stack([*parts(white[rows, :-1]), white[rows, -1]])
        slopes = parts(change[:, rows].T / (STEP * problem.noise))
        return Line(base[rows] / problem.noise, *slopes, hold, channel, ahead.share, least, whitened)

    return of_run


def rough_of(problem: Problem, fit: Fitted) -> dict[str, tuple[float, float]]:
    """Symbol -> value and standard deviation of what no straight line foretells: the log's timing, and nuisances that
    keep a state."""

    def rough(symbol: str) -> bool:
        name, _, of_effect = symbol.partition("__")
        return symbol == LOG_TIMING or bool(of_effect and name not in fit.effects and problem.effect(name).memory)

    scalars = [one for one in fit.free if isinstance(one, Scalar) and rough(one.symbol)]
    return {one.symbol: (float(np.mean(fit.setting[one.symbol])), one.scale * one.std) for one in scalars}


def _lasting(parameter: FreeParameter) -> str:
    """The symbol of a base parameter whose signature is much the same in every fit, "" of another parameter."""
    if not isinstance(parameter, Scalar) or parameter.logarithmic or is_timing(parameter):
        return ""
    return parameter.symbol if math.isfinite(parameter.std) else ""


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
