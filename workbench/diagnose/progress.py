"""How far a diagnosis is: records, worded where they are shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


class Stage(Enum):
    """The stages, in their order. WRITE is left to whoever writes the result down."""

    READ = 0
    SEARCH = 1
    JUDGE = 2
    LOCATE = 3
    SEPARATE = 4
    SHRINK = 5
    CONSEQUENCES = 6
    WRITE = 7


class Task(Enum):
    """What a stage is at."""

    WHOLE = "whole"
    BASE = "base"
    SIGNATURES = "signatures"
    SINGLE = "single"
    PAIRS = "pairs"


@dataclass(frozen=True)
class Progress:
    """stage: under way. task: of the search; step, steps: which of how many, from 1; effects: those it is about."""

    stage: Stage
    task: Task = Task.WHOLE
    step: int = 0
    steps: int = 0
    effects: tuple[str, ...] = ()


Tell = Callable[[Progress], None]
