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
        """The share of the work that is done, 0 to 1: by stages, and within the search by its steps."""
        within = (self.step - 1) / self.steps if self.steps else 0.0
        return (self.stage.value + within) / len(Stage)


Tell = Callable[[Progress], None]
