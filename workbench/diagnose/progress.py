"""The progress of a diagnosis, as records. The words are in view/diagnosis.py."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


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


# The rest of a diagnosis at a message of each task, in times of what has passed since the base fit began: nine of ten
# messages of 34 practice hoists and axes were followed by no more.
UPPER = {
    (Stage.SEARCH, Task.SINGLE): 6.5, (Stage.SEARCH, Task.PAIRS): 8.0, (Stage.JUDGE, Task.WHOLE): 1.3,
    (Stage.LOCATE, Task.WHOLE): 1.0, (Stage.SEPARATE, Task.WHOLE): 0.65, (Stage.SHRINK, Task.WHOLE): 0.65,
    (Stage.CONSEQUENCES, Task.WHOLE): 0.45, (Stage.WRITE, Task.WHOLE): 0.12,
}  # fmt: skip
SHORT = 0.1  # s: so little has passed that it tells nothing


class Remaining:
    """An upper bound of the rest of a diagnosis, s; nine of ten take no longer. It rises where a search goes on longer
    than most: who has searched long has long to go."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._begun = clock, math.nan

    def __call__(self, progress: Progress) -> float | None:
        """At this message; None where nothing tells of it."""
        now = self._clock()
        if progress.task is Task.BASE and math.isnan(self._begun):
            self._begun = now
        passed, upper = now - self._begun, UPPER.get((progress.stage, progress.task))
        return upper * passed if upper is not None and passed > SHORT else None


Tell = Callable[[Progress], None]
