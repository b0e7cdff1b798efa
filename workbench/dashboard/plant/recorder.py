"""What a served plant did lately: its signals at an even rate, and what happened to it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from workbench.dashboard.plant.line import Line
from workbench.errors import InputError

EVERY_S, KEPT_S = 0.04, 60.0
MOST_EVENTS = 100
# Flags whose beginning is an event, in words.
BEGINS = {
    "is_watchdog": "watchdog", "is_slack": "slack wire", "is_off_rail": "off the rail", "is_diverged": "diverged",
}  # fmt: skip


class Recorder:
    """Rows of a plant's numbers, taken in a thread of its own from `start()` to `stop()`.

    beside(): further columns, name -> value, at the same instants. Rows have a running number, so that a page asks
    for those that it has not seen. A plant whose time stands adds no rows; one that was reset begins anew.
    """

    def __init__(self, line: Line, beside: Callable[[], Mapping[str, float]]) -> None:
        self._line, self._beside = line, beside
        self._lock = threading.Lock()
        self._rows: deque[list[float]] = deque(maxlen=round(KEPT_S / EVERY_S))
        self._count = self._generation = 0
        self._columns: list[str] = []
        self._now: dict[str, float] = {}
        self._events: deque[tuple[float, str]] = deque(maxlen=MOST_EVENTS)
        self.problem = ""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def note(self, words: str) -> None:
        """An event of now."""
        with self._lock:
            self._events.append((self._now.get("time_s", 0.0), words))

    def since(self, generation: int, number: int) -> dict[str, Any]:
        """For JSON: the rows from `number` on, or all of them where the plant was reset since `generation`."""
        with self._lock:
            first = self._count - len(self._rows)
            skip = max(0, number - first) if generation == self._generation else 0
            return {
                "generation": self._generation,
                "next": self._count,
                "columns": self._columns,
                "rows": list(self._rows)[skip:],
                "now": self._now,
                "events": list(self._events),
                "problem": self.problem,
            }

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            try:
                self.take(self._line.numbers())
                self.problem = ""
            except InputError as error:
                self.problem = str(error)

    def take(self, read: Mapping[str, float]) -> None:
        """One row, from what `Line.numbers` says."""
        now = {**read, **self._beside()}
        with self._lock:
            before, self._now = self._now, now
            if before and now["time_s"] < before["time_s"]:
                self._rows.clear()
                self._events.clear()
                self._generation, self._count = self._generation + 1, 0
            self._events.extend(
                (now["time_s"], words) for name, words in BEGINS.items() if now[name] > before.get(name, 0.0)
            )
            if not before or now["time_s"] != before["time_s"]:
                self._columns = list(now)
                self._rows.append([round(value, 6) for value in now.values()])
                self._count += 1
