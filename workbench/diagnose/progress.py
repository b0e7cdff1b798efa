"""The progress of a diagnosis, as records. The words are in view/diagnosis.py."""

from __future__ import annotations

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


Tell = Callable[[Progress], None]
