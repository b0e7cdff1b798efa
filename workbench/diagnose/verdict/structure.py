"""What is left in a residual: structure that some variable explains, or nothing but the machine's own floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.diagnose.hypotheses.base import base_knobs
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import best_of, explain
from workbench.diagnose.location.variables import variables
from workbench.diagnose.location.where import free_of
from workbench.machine import Axis
from workbench.run import Array

RIPPLE = 0.01  # of the largest input: cogging and the like, which every axis has and which is nobody's gap
OWN = 0.02  # of the largest input: more is a gap, whatever it hangs on; the EMPS axis leaves 0.008 to 0.016
WINDOW = 5.0  # correlation times


@dataclass(frozen=True)
class Reducible:
    """share: of the residual's energy, that a function of one variable takes away on runs it was not fitted to.

    along: whether the variable is the place along the way, or an angle.
    """

    share: float
    along: bool


def reducible(problem: Problem, fit: Fitted, seed: int) -> Reducible:
    """What the best variable explains of what `fit` leaves."""
    residual = fit.residual[: problem.inputs]
    count = len(base_knobs(problem.machine, problem.runs))
    base = replace(fit, knobs=fit.knobs[:count], z=fit.z[:count], jacobian=fit.jacobian[:, :count])
    free = free_of(problem, base)
    best = best_of([explain(problem, residual, each, free, seed) for each in variables(problem)])
    return Reducible(min(max(float(best.share), 0.0), 1.0), best.variable.regime in ("position", "periodic"))


def floor_of(problem: Problem, fit: Fitted, left: Reducible) -> float:
    """What a machine without a gap leaves, rms, in the input's unit.

    A hoist's is its sensors' noise: below its band the lumped plant is exact enough. A stiff axis is
    compared up to frequencies where every real one has ripple and resonances that no lumped law
    holds: there it is also what no hypothesis and no function of one variable explains, up to OWN of the largest
    input; and RIPPLE of that, though the place along the way explain it.
    """
    if not isinstance(problem.machine, Axis):
        return problem.noise
    largest = max(float(np.max(np.abs(run[problem.machine.input_signal]))) for run in problem.runs)
    rms = fit.rms(problem.inputs)
    unexplained = min(rms * math.sqrt(1.0 - left.share), OWN * largest)
    cogging = min(rms, RIPPLE * largest) if left.along else 0.0
    return max(problem.sensor_noise, cogging, unexplained)


def weigh_against(problem: Problem, fit: Fitted, left: Reducible, least: Fitted) -> None:
    """Henceforth the data count against the floor of `fit`, and for as many values as are independent in `least`.

    What a hoist leaves is noise, of which one band holds so many independent values a second. What an axis leaves
    itself hangs together far longer, and says the less about a parameter: taken for noise it would drag the base
    parameters off by many tolerances for a thousandth of the residual. left: what a variable explains of `fit`.
    least: the fit that leaves least, for what a good hypothesis leaves to a second one is not the machine's own colour.
    """
    problem.noise = floor_of(problem, fit, left)
    problem.share = min(problem.band_share, independent_share(problem, least))


def independent_share(problem: Problem, fit: Fitted) -> float:
    """How many independent values one sample of what `fit` leaves stands for: 1/tau, of all runs.

    tau = 1 + 2 sum rho_k, the autocorrelation summed until WINDOW tau (A. Sokal, Monte Carlo Methods in
    Statistical Mechanics, 1996).
    """
    residual, run = fit.residual[: problem.inputs], problem.run_of_row[: problem.inputs]
    count = independent = 0.0
    for number in range(len(problem.runs)):
        values = residual[run == number]
        if len(values) > 1 and np.any(values):
            count += len(values)
            independent += len(values) / correlation_time(values)
    return min(independent / count, 1.0) if count else 1.0


def correlation_time(values: Array) -> float:
    """The integrated autocorrelation time of (n,) values about zero, in samples; at least 1."""
    n = len(values)
    spectrum = np.fft.rfft(values, 2 * n)
    together = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    tau = 1.0 + 2.0 * np.cumsum(together[1:]) / together[0]
    far = np.flatnonzero(np.arange(1, n) >= WINDOW * tau)
    return max(float(tau[far[0]] if len(far) else tau[-1]), 1.0)
