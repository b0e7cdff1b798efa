"""On which side of the wire a gap lies, where the dead line's tension is logged."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import kind_of

DRIVE, CARRIAGE = 0.4, 0.6  # of the pull that a force on the carriage would make in the dead line


def side_of(problem: Problem, gap: Array) -> str:
    """drive or carriage, by whether the dead line's tension shows the gap of the torque; else unsaid.

    A force on the carriage shows as half of itself in each fall: T = i R W.
    """
    line = kind_of(problem.machine).dead_line
    if not problem.has_tension or line is None:
        return "unsaid"
    torque = gap[: problem.inputs]
    energy = float(torque @ torque) - problem.noise**2 * problem.inputs  # the noise is in the torque only
    newtons = line.pull_per_input(problem.machine)
    felt = gap[problem.inputs :] * problem.tension_noise / problem.noise
    if energy <= 0.0:
        return "unsaid"
    part = float(torque @ felt) / (newtons * energy)
    error = problem.tension_noise * np.sqrt(float(torque @ torque) / problem.share) / (newtons * energy)
    if part - error > CARRIAGE:
        return "carriage"
    return "drive" if part + error < DRIVE else "unsaid"
