"""Whether the residual of a stretch comes back in the same state of the machine: then it is no event."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.location.survey import Survey, since_reversal

NEIGHBOURS = 5  # nearest states
RECURS = 0.4  # of a stretch's energy
FINE = 0.03  # of the range of places: as near they are one
NEAREST = 1e-4  # of that range: a reversal's own place


def states_of(survey: Survey) -> list[Array]:
    """Sets of state variables, (inputs, k) each and scaled to the order of one, with which a force may come back.
    Speed with acceleration; the way since the last reversal; the place: each with the direction."""
    parts: list[list[Array]] = [[], [], []]
    fastest = max(float(np.max(np.abs(c.speed))) for c in survey.runs)
    hardest = max(float(np.max(np.abs(c.acceleration))) for c in survey.runs)
    span = max(float(np.max(c.position)) for c in survey.runs) - min(float(np.min(c.position)) for c in survey.runs)
    for c in survey.runs:
        speed, hard, gone, place = (
            np.interp(c.at, c.time, x) for x in (c.speed, c.acceleration, since_reversal(c), c.position)
        )
        ahead = np.sign(speed)
        parts[0].append(np.stack([ahead, speed / fastest, hard / max(hardest, 1e-300)], axis=1))
        parts[1].append(np.stack([ahead, np.log(gone / span + NEAREST), speed / fastest], axis=1))
        parts[2].append(np.stack([ahead, place / max(span, 1e-300) / FINE], axis=1))
    return [np.concatenate(values) for values in parts]


def comes_back(left: Array, mine: np.ndarray, states: list[Array]) -> bool:
    """Whether the residual in a stretch, `mine`, comes back in the same state of the machine: the mean over the nearest
    states outside removes RECURS of its energy."""
    inside, outside = np.flatnonzero(mine), np.flatnonzero(~mine)
    if not len(inside) or len(outside) <= NEIGHBOURS:
        return False
    energy = float(left[inside] @ left[inside])
    for state in states:
        away = np.sum((state[inside][:, None] - state[outside]) ** 2, axis=2)
        nearest = np.argpartition(away, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
        rest = left[inside] - np.mean(left[outside][nearest], axis=1)
        if float(rest @ rest) < (1.0 - RECURS) * energy:
            return True
    return False
