"""What speaks for a hypothesis: how far it lowers the objective, less what that must cost.

Three things are taken off. Each parameter pays ln(n) (G. Schwarz, Annals of Statistics 6,
1978), n independent samples. What an effect explains in the data has to be worth more than
LEAST of the noise, rms: no model is exact, and more data make a small misfit significant, not
important. And a second effect has to earn more than a share of what the first explains, for the
first is no exact image of the machine either. Tolerances need no such discount.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.diagnose.hypotheses.problem import Problem
from workbench.machine import Axis

LEAST = 0.35  # of the noise: the smallest effect worth a name
LEAST_OF_FLOOR = 0.8  # the same where the floor is what the machine itself leaves, which has structure too
SECOND = 0.06  # of what the first effect explains, rms: the smallest second one

STANDSTILL = 0.75  # of the noise, of what acts at low speed only: no law of friction near standstill is exact
MOST = 500.0  # independent samples that a parameter pays for: what many more would say, the discount is for


@dataclass(frozen=True)
class Scale:
    """n: independent samples of the input's residual. inflation: chi^2 in independent values over its expectation,
    for a machine whose floor lies above its sensor's noise. least: the smallest effect, of the noise, rms."""

    n: float
    inflation: float = 1.0
    least: float = LEAST


def scale_of(problem: Problem, inflation: float = 1.0) -> Scale:
    least = LEAST_OF_FLOOR if isinstance(problem.machine, Axis) else LEAST
    return Scale(problem.share * problem.inputs, inflation, least)


def merit(
    data: float, prior: float, parameters: int, scale: Scale, explained: float = 0.0, creeping: bool = False
) -> float:
    """What one effect is worth. data, prior: by how much chi^2 and the base parameters' tolerances fall.

    explained: by how much chi^2 fell through the effects before it. creeping: it acts at low speed only.
    """
    data /= scale.inflation
    size = max(scale.least, STANDSTILL) if creeping else scale.least
    least = max(size**2 * scale.n, SECOND**2 * explained / scale.inflation)
    net = data - least if data > least else min(data, 0.0)
    return net + prior - parameters * math.log(min(max(scale.n, 2.0), MOST))
