"""Tables and base parameters in the driven simulation, which includes the wire, the rests and a file's rounding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Setting, base_parameters, bounds_of, setting_of
from workbench.diagnose.hypotheses.held_out import HeldOut
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.unexplained.records import Curve
from workbench.diagnose.unexplained.table_fit import TableFit, TableFitter, telling_points
from workbench.diagnose.unexplained.tables import columns_of, gain_of, lever_of, points_of, rides_of
from workbench.machines import Axis, Hoist, Table, value_names, with_correction

ROUNDS = 4  # driven simulations with the table, at most
WORTH_ANOTHER = 0.97  # of the rms before: a round that gains less is the last
FINER = 3  # times as many points to choose from
WORTH_REFINING = 0.9  # of what is left: points of their own choice have to earn their place
LEVEL_DIGITS, POINT_DIGITS = 6, 8  # of the numbers in a file

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


@dataclass(frozen=True, eq=False)
class Tried:
    """A table over one variable, fitted linearly. lever: input over force."""

    variable: Table
    at: Array
    columns: Array
    lever: float
    fit: TableFit

    @property
    def left(self) -> float:
        """The sum of squares of its residual on the groups held out."""
        return float(self.fit.after.sum())

    def curve(self, levels: Array | None = None) -> Curve:
        levels = self.fit.levels if levels is None else levels
        m, std = len(self.at), self.fit.std
        return Curve(
            self.variable.over, self.variable.acts_on, self.at,
            levels[:m], levels[m:], std[:m], std[m:], self.fit.explains,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Driven:
    """A table in the driven simulation. last: the linear fit there; fitted: the base values fitted with the table."""

    tried: Tried
    last: TableFit
    fitted: Fitted
    rms: float

    @property
    def curve(self) -> Curve:
        return self.tried.curve(self.last.levels)


def with_table(machine: AnyMachine, curve: Curve) -> AnyMachine:
    """The machine with the curve as its measured correction, rounded as a file has it."""
    at = [_rounded(x, POINT_DIGITS) for x in curve.at]
    forward, backward = ([_rounded(x, LEVEL_DIGITS) for x in levels] for levels in (curve.forward, curve.backward))
    return with_correction(machine, curve.over, curve.acts_on, at, forward, backward)


class Tables:
    """One campaign's tables, from the nominal machine on; `base` is the base parameters' own fit."""

    def __init__(self, problem: Problem, base: Fitted) -> None:
        self.problem, self.base = problem, base
        self.keys = base_parameters(problem.machine, problem.runs)
        self.fitter = TableFitter(problem, base)
        nominal = setting_of(base.free, self.fitter.z)
        self.rides, self.gain = rides_of(problem, nominal), gain_of(problem, nominal)

    def linear(self, variable: Table, at: Array | None = None) -> Tried:
        at = points_of(self.problem, self.rides, variable) if at is None else at
        columns = columns_of(self.problem, self.rides, variable, at, self.gain)
        lever = self.gain * lever_of(self.problem.machine, variable.acts_on)
        return Tried(variable, at, columns, lever, self.fitter.fit(at, columns, variable.turn, lever))

    def refined(self, tried: Tried) -> Tried:
        """The table with its points moved: close together at a step, far apart on a line. Unchanged if not better."""
        if tried.variable.turn or tried.variable.over == "payload_kg":
            return tried
        fine = np.linspace(tried.at[0], tried.at[-1], FINER * (len(tried.at) - 1) + 1)
        again = self.linear(
            tried.variable, telling_points(fine, self.linear(tried.variable, fine).fit.levels, len(tried.at))
        )
        return again if again.left < WORTH_REFINING * tried.left else tried

    def driven(self, tried: Tried) -> Driven:
        """The table in the driven simulation, refitted while that leaves more than the stiff machine did."""
        problem, variable, at = self.problem, tried.variable, tried.at
        lowest, highest, _ = bounds_of(self.base.free)
        fitter = TableFitter(problem, self.base)
        fit, columns, best = tried.fit, tried.columns, None
        for _ in range(ROUNDS):
            fitted = replace(self.base, z=np.clip(fit.z, lowest, highest))
            rows = self._residual(fitted.setting, tried.curve(fit.levels))
            rms = float(np.sqrt(np.mean(rows[: problem.inputs] ** 2)))
            enough = best is not None and rms > WORTH_ANOTHER * best.rms
            if best is None or rms < best.rms:
                best = Driven(tried, fit, replace(fitted, residual=rows), rms)
            if enough:
                break
            fitter.move_to(fitted.z)
            setting = fitted.setting
            columns = columns_of(problem, rides_of(problem, setting), variable, at, gain_of(problem, setting))
            fit = fitter.fit(at, columns, variable.turn, tried.lever, fit.levels, fitted.z, rows, tried.fit.bend)
        assert best is not None
        return best

    def held_out(self, driven: Driven) -> tuple[HeldOut, tuple[Hoist | Axis, ...]]:
        """Each fold driven with table and base values fitted without it; and the machines, one for each fold."""
        problem, base = self.problem, len(self.base.z)
        lowest, highest, _ = bounds_of(self.base.free)
        residual, settings, machines = np.array(driven.fitted.residual), [], []
        for fold, other in enumerate(driven.last.others):
            fitted = replace(self.base, z=np.clip(other[:base], lowest, highest))
            curve = driven.tried.curve(other[base:])
            rows = self.fitter.groups == fold
            residual[rows] = self._residual(fitted.setting, curve)[rows]
            settings.append(fitted.setting)
            machines.append(with_table(refitted_machine(problem, self.keys, fitted), curve))
        return HeldOut(residual, self.fitter.groups, tuple(settings)), tuple(machines)

    def _residual(self, setting: Setting, curve: Curve) -> Array:
        """(samples,) measured minus predicted, of a machine as a file says it, beside what no file holds."""
        problem = self.problem
        machine = with_table(refitted_machine(problem, self.keys, setting), curve)
        with_it = Problem(machine, problem.runs, problem.band_hz)
        with_it.rows, with_it.noise = problem.rows, problem.noise  # the tension's rows are scaled by the noise
        return with_it.residuals([in_no_file(problem, setting)])[0]


def in_no_file(problem: Problem, setting: Setting) -> Setting:
    """The part of a setting that machine.yaml does not hold: traces and the values of the log itself."""
    known = set(value_names(problem.machine))
    keys = base_parameters(problem.machine, problem.runs)
    said = {parameter.symbol for key, parameter in keys.items() if key in known}
    return {symbol: value for symbol, value in setting.items() if symbol not in said}


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
