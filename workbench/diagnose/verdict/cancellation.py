"""The cancellation between two effects: a pair in the place of one other cause is a difference of two large shares.

Two real causes are independent: their shares of the residual are mostly orthogonal, and add as often as they cancel.
Two effects that together imitate a third explain the same part of it and cancel in the rest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.contributions import parts_of
from workbench.diagnose.hypotheses.fits import Fitted, Projection
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import find


def cancellation(problem: Problem, fit: Fitted, base: int) -> float:
    """The logarithm of the energy of both effects' shares over that of their sum; 0 where they add, and for one effect.

    base: how many of the fit's first z are the base parameters'. What these could explain of a share is taken out.
    """
    if len(fit.effects) != 2:
        return 0.0
    parts = parts_of(problem, fit, [find(name, problem.active.kind) for name in fit.effects])
    knobs = _knobs_of(fit, base)
    plain = replace(fit, knobs=fit.knobs[:knobs], z=fit.z[:base], jacobian=fit.jacobian[:, :base])
    shares = Projection.of(problem, plain).clean(np.stack([part.rows for part in parts], axis=1))
    return cancelled(shares)


def _knobs_of(fit: Fitted, z: int) -> int:
    """How many knobs the first z are of."""
    ends = np.cumsum([len(knob.lowest) for knob in fit.knobs])
    return int(np.searchsorted(ends, z)) + 1


def cancelled(shares: Array) -> float:
    """The cancellation of two shares, (rows, 2)."""
    apart, together = float(np.sum(shares**2)), float(np.sum(np.sum(shares, axis=1) ** 2))
    return max(math.log(max(apart, 1e-300) / max(together, 1e-12 * apart, 1e-300)), 0.0)
