"""The progress of a diagnosis, as records. The words are in view/diagnosis.py."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np


class Stage(Enum):
    """The stages, in order. WRITE is reported by the caller that writes the result."""

    READ = 0
    SEARCH = 1
    JUDGE = 2
    LOCATE = 3
    SEPARATE = 4
    SHRINK = 5
    CONSEQUENCES = 6
    WRITE = 7


class Task(Enum):
    """The current task of a stage."""

    WHOLE = "whole"
    BASE = "base"
    SIGNATURES = "signatures"
    SINGLE = "single"
    PAIRS = "pairs"


# Shares of a diagnosis' time, of campaigns of six runs; within the search, from and to.
USUALLY = dict(zip(Stage, (0.05, 0.65, 0.04, 0.08, 0.04, 0.05, 0.07, 0.02), strict=True))
WITHIN_SEARCH = {Task.BASE: (0.0, 0.1), Task.SIGNATURES: (0.1, 0.2), Task.SINGLE: (0.2, 0.6), Task.PAIRS: (0.6, 1.0)}


@dataclass(frozen=True)
class Progress:
    """stage: the current one. task: of the search. step of steps, from 1. effects: those that the task is about."""

    stage: Stage
    task: Task = Task.WHOLE
    step: int = 0
    steps: int = 0
    effects: tuple[str, ...] = ()

    @property
    def share_done(self) -> float:
        """The share of the work that is done, 0 to 1: by what each stage usually takes, and the search by its steps."""
        first, last = WITHIN_SEARCH.get(self.task, (0.0, 0.0)) if self.stage is Stage.SEARCH else (0.0, 0.0)
        within = first + (last - first) * ((self.step - 1) / self.steps if self.steps else 0.0)
        stages = list(Stage)
        return sum(USUALLY[stage] for stage in stages[: self.stage.value]) + USUALLY[self.stage] * within


# The rest of a diagnosis at the first message of each task, in times of base fit and signatures together: nine of ten
# practice hoists take no longer.
UPPER = {
    (Stage.SEARCH, Task.SINGLE): 12.0, (Stage.SEARCH, Task.PAIRS): 10.0, (Stage.JUDGE, Task.WHOLE): 6.0,
    (Stage.LOCATE, Task.WHOLE): 5.0, (Stage.SEPARATE, Task.WHOLE): 4.0, (Stage.SHRINK, Task.WHOLE): 4.0,
    (Stage.CONSEQUENCES, Task.WHOLE): 2.0, (Stage.WRITE, Task.WHOLE): 1.0,
}  # fmt: skip
SHORT = 0.1  # s: a unit that tells nothing


class Remaining:
    """An upper bound of the rest of a diagnosis, s, that never rises: nine of ten take no longer.

    The base fit and the signatures, a known amount of simulation, tell how fast this computer is with this campaign.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._begun, self._unit, self._until = clock, math.nan, math.nan, math.inf

    def __call__(self, progress: Progress) -> float | None:
        """At this message; None before it is known, 0 where it has passed."""
        now = self._clock()
        if (progress.stage, progress.task) in UPPER:
            if math.isnan(self._unit):
                self._unit = now - self._begun
            self._until = float(np.fmin(self._until, now + UPPER[progress.stage, progress.task] * self._unit))
        elif progress.task is Task.BASE and math.isnan(self._begun):
            self._begun = now
        return max(self._until - now, 0.0) if self._unit > SHORT and math.isfinite(self._until) else None


Tell = Callable[[Progress], None]
