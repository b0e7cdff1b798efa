"""Steps at a fixed rate: when the next one is due, catching up, overruns, and how late steps began."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from typing import Any

LATE_US = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0)  # upper edges; beyond: the last
MOST_BEHIND_S = 0.2  # what is caught up; of a longer pause the rest is left out of the plant's time


class Pace:
    """Times of steps. A step is on time where it ended before the next one was due.

    Steps that are late are made up, one after the other; a pause of more than MOST_BEHIND_S (the computer slept) is
    not: the plant's time stands still for the rest of it, which is counted as `skipped_s`.
    """

    def __init__(self, step_s: float) -> None:
        self.step_s = step_s
        self.late = [0] * (len(LATE_US) + 1)
        self.steps = self.on_time = self.overruns = self.pauses = 0
        self.worst_s = self.skipped_s = 0.0
        self._began = math.nan
        self._due = 0

    def begin(self, now: float) -> None:
        self._began, self._due = now, 0

    @property
    def due_s(self) -> float:
        """When the next step is due, on the caller's clock."""
        return self._began + self._due * self.step_s

    def start(self, now: float) -> None:
        """A step begins; `now` is at or after `due_s`."""
        late = now - self.due_s
        if late > MOST_BEHIND_S:
            self.pauses += 1
            self.skipped_s += late - MOST_BEHIND_S
            self._began += late - MOST_BEHIND_S
            late = MOST_BEHIND_S
        self._late = late
        self.worst_s = max(self.worst_s, late)
        micro = 1e6 * late
        self.late[next((i for i, edge in enumerate(LATE_US) if micro < edge), len(LATE_US))] += 1

    def end(self, now: float) -> None:
        """The step has ended."""
        self.steps += 1
        self._due += 1
        if now <= self.due_s:
            self.on_time += 1
        else:
            self.overruns += 1

    def record(self) -> dict[str, Any]:
        """For JSON: counts, the share on time, the histogram of how late steps began."""
        names = [f"<{edge:g} us" for edge in LATE_US] + [f">={LATE_US[-1]:g} us"]
        return {
            "rate_hz": 1.0 / self.step_s,
            "steps": self.steps,
            "on_time": self.on_time,
            "on_time_percent": 100.0 * self.on_time / self.steps if self.steps else 100.0,
            "overruns": self.overruns,
            "pauses": self.pauses,
            "skipped_s": self.skipped_s,
            "latest_start_ms": 1e3 * self.worst_s,
            "jitter": dict(zip(names, self.late, strict=True)),
        }


def lines(record: dict[str, Any]) -> list[str]:
    """The record in words, with the histogram."""
    steps = max(record["steps"], 1)
    head = (
        f"{record['steps']} steps at {record['rate_hz']:g} Hz, {record['on_time_percent']:.3f} % on time, "
        f"{record['overruns']} overruns, {record['skipped_s']:.3f} s skipped, "
        f"latest start {record['latest_start_ms']:.2f} ms"
    )
    width = max(map(len, record["jitter"]))
    rows = [
        f"  {name:>{width}}  {count:>8}  {100.0 * count / steps:7.3f} %  {'#' * round(40.0 * count / steps)}"
        for name, count in record["jitter"].items()
    ]
    return [head, "How late steps began:", *rows]


def ask_priority() -> str:
    """Asks the system to run this thread before others; what came of it, in words."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(10))
    except (AttributeError, OSError):  # not this system, or not this user
        return (
            "at ordinary priority, for the system gives this user no other (it takes root, or rtprio in limits.conf): "
            "on a busy computer steps will be late"
        )
    return "at real-time priority"


def run_at_pace(
    pace: Pace, step: Callable[[], None], until: Callable[[float], bool], wait: Callable[[float], None] | None = None
) -> None:
    """Steps when they are due until `until(now)`; wait(seconds) may do other work, and returns when they are over or
    before."""
    rest = wait or time.sleep
    clock = time.monotonic
    pace.begin(clock())
    while True:
        now = clock()
        if until(now):
            return
        left = pace.due_s - now
        if left > 0.0:
            rest(left)
            continue
        pace.start(now)
        step()
        pace.end(clock())


def stepping(pace: Pace, step: Callable[[], None], until: Callable[[float], bool]) -> threading.Thread:
    """`run_at_pace` in a thread of its own, begun; for protocols that have a loop of their own."""
    thread = threading.Thread(target=run_at_pace, args=(pace, step, until), name="plant", daemon=True)
    thread.start()
    return thread
