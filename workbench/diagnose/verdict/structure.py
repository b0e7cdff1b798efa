"""What is left in a residual: structure that some variable explains, or nothing but the machine's own floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.diagnose.hypotheses.base import base_knobs
from workbench.diagnose.hypotheses.fits import Fitted, fit_knobs
from workbench.diagnose.hypotheses.knobs import Knob
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import best_of, explain
from workbench.diagnose.location.variables import variables
from workbench.diagnose.location.where import free_of
from workbench.machine import Axis


def reducible(problem: Problem, fit: Fitted, seed: int) -> float:
    """The share of the residual's energy that a function of one variable takes away on runs it was not fitted to."""
    residual = fit.residual[: problem.inputs]
    count = len(base_knobs(problem.machine, problem.runs))
    base = replace(fit, knobs=fit.knobs[:count], z=fit.z[:count], jacobian=fit.jacobian[:, :count])
    free = free_of(problem, base)
    shares = best_of([explain(problem, residual, each, free, seed) for each in variables(problem)]).share
    return min(max(float(shares), 0.0), 1.0)


def floor_of(problem: Problem, fit: Fitted, share: float) -> float:
    """What a machine without a gap leaves, rms, in the input's unit.

    A hoist's is its sensors' noise: below its band the lumped plant is exact enough. A stiff axis is
    compared up to frequencies where every real one has ripple and resonances that no lumped law
    holds: there it is also what no hypothesis and no function of one variable explains.
    """
    if not isinstance(problem.machine, Axis):
        return problem.noise
    return max(problem.noise, fit.rms(problem.inputs) * math.sqrt(1.0 - share))


def floor_before(problem: Problem, base: Sequence[Knob], seed: int) -> float:
    """The same before any effect was weighed: what base parameters and a function of one variable leave."""
    fit = fit_knobs(problem, (), base, np.zeros(len(base)), problem.noise)
    return floor_of(problem, fit, reducible(problem, fit, seed))
