"""How a closed-loop run ended."""

from __future__ import annotations

import enum

BOUNDLESS = 1e9  # a state beyond it, in m, rad or per second, belongs to no machine


class Outcome(enum.Enum):
    """How a simulation ended, as a sentence for the user."""

    COMPLETED = "completed"
    DIVERGED = "the state grew without bound: the loop is unstable or the load ran away"
    LEFT_THE_RAIL = "the carriage left the rail"
    NOT_SOLVED = "the multi-body model was not solved"
