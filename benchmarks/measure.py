"""Timing several ways to the same answer in turns, so that what else the machine does hits all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).with_name("results.json")
ACCURACY = 1e-6  # of the largest motor speed, for replay, closed loop and batch
FIT_ACCURACY = 1e-4  # of each parameter: the right answer
SHORT_S = 0.05  # quick work is repeated within a turn for about this long


@dataclass(frozen=True)
class Work:
    """One way: `do` is timed, `error` judges what it returned (not timed). seconds are divided by `parts`.

    quick: takes so little time that one turn repeats it.
    """

    do: Callable[[], Any]
    error: Callable[[Any], float]
    parts: int = 1
    quick: bool = False


@dataclass(frozen=True)
class Measured:
    """Median seconds of one part on the processor and by the clock, and the error.

    The processor's are what is compared: on a busy machine long work waits for its turn
    more often than short work does, so ratios by the clock flatter the shorter one.
    """

    seconds: float
    clock_seconds: float
    error: float


@dataclass(frozen=True)
class Row:
    """Ours beside one peer's, with what the peer was set to and the ratio aimed at."""

    name: str
    ours: Measured
    peer: str
    theirs: Measured
    setting: str
    target: float | None

    @property
    def ratio(self) -> float:
        return self.theirs.seconds / self.ours.seconds

    def record(self) -> dict[str, float | str]:
        return {
            "name": self.name,
            "ours_s": self.ours.seconds,
            "peer": self.peer,
            "peer_s": self.theirs.seconds,
            "ratio": self.ratio,
            "error_ours": self.ours.error,
            "error_peer": self.theirs.error,
        }


def in_turns(ways: Mapping[str, Work], rounds: int) -> dict[str, Measured]:
    """Every way once a round, after one call that warms it up and is judged. All work is in one thread."""
    errors = {name: way.error(way.do()) for name, way in ways.items()}  # compiles, fills caches
    repeats = {name: max(1, round(SHORT_S / _timed(way.do)[1])) if way.quick else 1 for name, way in ways.items()}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            times[name] += [_timed(way.do) for _ in range(repeats[name])]
    return {
        name: Measured(
            statistics.median(cpu for cpu, _ in times[name]) / way.parts,
            statistics.median(clock for _, clock in times[name]) / way.parts,
            errors[name],
        )
        for name, way in ways.items()
    }


def _timed(do: Callable[[], Any]) -> tuple[float, float]:
    """Seconds of this process on the processor, and by the clock."""
    clock, cpu = time.perf_counter(), time.process_time()
    do()
    return time.process_time() - cpu, time.perf_counter() - clock
