"""Commands in, signals out: the client's latest torque, the watchdog, faults, and counts of all that happened."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from workbench.errors import InputError, nearest
from workbench.serve import points as tables
from workbench.serve.live import LiveMachine
from workbench.serve.pace import Pace

SAID_EVERY_S = 5.0  # a complaint of one kind is repeated after that time at the earliest
TOO_FAST = 1.2  # commands a step, over a second, that are worth a word

Say = Callable[[str], None]


class Session:
    """A plant in the hands of one client. Every method takes the lock: protocols may call from any thread.

    watchdog_s: without a command for so long, the torque is zero and the brake closes, as a drive does that lost its
    master; `watchdog_brake` False leaves the brake open. Time is passed in, in seconds of any steady clock.
    """

    def __init__(
        self,
        plant: LiveMachine,
        step_s: float,
        watchdog_s: float,
        *,
        watchdog_brake: bool = True,
        clock: Callable[[], float],
        say: Say = lambda line: None,
    ) -> None:
        self.plant: LiveMachine = plant
        self.step_s, self.watchdog_s = step_s, watchdog_s
        self._watchdog_brake, self._clock, self._say_line = watchdog_brake, clock, say
        self.lock = threading.RLock()
        self.pace = Pace(step_s)
        self.counts: Counter[str] = Counter()
        self._said: dict[str, float] = {}
        self.brake_late_s: float = 0.0
        self.inputs, self.outputs = tables.inputs(self), tables.outputs(plant)
        self._waits = True
        self._halted = ""
        self._start()

    def _start(self) -> None:
        self.asked = self.plant.hold
        self.brake_asked: bool = False
        self._opens_at: float | None = None  # time of the plant
        self._heard = self._clock()
        self._since, self._commands, self._steps = self._clock(), 0, 0
        self._silent = False

    # What a client asks for.

    @property
    def torque_nm(self) -> float:
        """What a hoist's client asked for last: torque of all motors, N m."""
        return self.asked

    def command(self, value: float, brake: bool | None = None) -> bool:
        """The input from the next step on, in its unit; brake None leaves it. False where it is no number."""
        with self.lock:
            if not math.isfinite(value):
                word = self.plant.kind.drive.quantity
                self.refused("not_finite", f"{word} {value}: expected a finite number; the last {word} stays")
                return False
            self.asked = value
            self.counts["commands"] += 1
            self._commands += 1
            self._heard = self._clock()
            if self._waits:  # time begins: what is counted over a second does, too
                self._waits = False
                self._since, self._commands, self._steps = self._heard, 1, 0
            if self._silent:
                self._silent = False
                self._say("the client is back")
            if brake is not None and brake != self.brake_asked:
                self.ask_brake(brake)
            return True

    def ask_brake(self, closed: bool) -> None:
        """Closes at once; opens after `brake_late_s`."""
        with self.lock:
            self.brake_asked = closed
            self._opens_at = None if closed else self.plant.time_s + self.brake_late_s

    def delay_brake(self, late_s: float) -> None:
        with self.lock:
            self.brake_late_s = late_s

    def lose_motor(self, lost: bool) -> None:
        with self.lock:
            self.plant.lose_motor(lost)

    def reset(self) -> None:
        """Back to the start; the counts go on."""
        with self.lock:
            self.plant.reset()
            self.brake_late_s = 0.0
            self._waits, self._halted = True, ""
            self._start()

    def set(self, name: str, value: object) -> None:
        """A point by name. InputError for a name or a value that cannot be."""
        with self.lock:
            tables.write(self, self.inputs, name, value)
            self.counts["orders"] += 1

    def order(self, order: object) -> dict[str, Any]:
        """A JSON order: {"set": {name: value}}, {"get": [names]}, {"status": true}, {"points": true}; the answer."""
        known = ("set", "get", "status", "points")
        if not isinstance(order, Mapping) or not order:
            raise InputError(f"expected an object with one of {', '.join(known)}")
        for key in order:
            if key not in known:
                raise InputError(f"unknown order '{key}'; {nearest(str(key), known)}")
        answer: dict[str, Any] = {}
        with self.lock:
            values = order.get("set", {})
            if not isinstance(values, Mapping):
                raise InputError("expected names with values", place="set")
            for name, value in values.items():  # all or none
                tables.point_of(self.inputs, str(name)).check(value)
            for name, value in values.items():
                self.set(str(name), value)
            if values:
                answer["set"] = sorted(map(str, values))
            if "get" in order:
                wanted = order["get"] if isinstance(order["get"], list) else [order["get"]]
                everything = (*self.outputs, *self.inputs)
                answer["get"] = {str(name): tables.point_of(everything, str(name)).read(self) for name in wanted}
            if order.get("status"):
                answer["status"] = self.status()
            if order.get("points"):
                answer["points"] = [point.name for point in (*self.inputs, *self.outputs)]
        return answer

    def refused(self, kind: str, line: str) -> None:
        """Counts what was not taken, and says it, not too often."""
        with self.lock:
            self.counts[f"refused_{kind}"] += 1
            now = self._clock()
            if now - self._said.get(kind, -math.inf) >= SAID_EVERY_S:
                self._said[kind] = now
                self._say(f"{line} ({self.counts[f'refused_{kind}']} so far)")

    # Time goes on.

    def step(self, *, live: bool = True) -> None:
        """One step of the plant. live: silence of the client counts; in lock step there is none."""
        with self.lock:
            if self._waits or self._halted:
                return
            now = self._clock()
            if live and not self._silent and now - self._heard > self.watchdog_s:
                self._silent = True
                self.counts["watchdog"] += 1
                brake = ", the brake closes" if self._watchdog_brake and self.plant.has_brake else ""
                word = self.plant.kind.drive.quantity
                self._say(f"the client is silent for {self.watchdog_s:g} s: {word} is zero{brake}")
            if self.brake_asked or (self._silent and self._watchdog_brake):
                self.plant.close_brake(True)
                if not self.brake_asked:
                    self._opens_at = self.plant.time_s + self.brake_late_s
            elif self.plant.brake_closed and (self._opens_at is None or self.plant.time_s >= self._opens_at - 1e-9):
                self.plant.close_brake(False)
            self.plant.step(0.0 if self._silent else self.asked)
            self.counts["steps"] += 1
            self._steps += 1
            self._judge()
            self._rate(now)

    def _judge(self) -> None:
        if not self.plant.bounded:
            self._halted = "diverged"
            self._say("the state grew without bound; the plant stands still until it is reset")
        elif self.plant.off_rail:
            self._halted = "off_rail"
            height = self.plant.signals["position_carriage_m"]
            self._say(f"the carriage left the rail at height {height:.2f} m; the plant stands still until it is reset")

    def _rate(self, now: float) -> None:
        """Whether the client sends more than is used, once a second."""
        if now - self._since < 1.0:
            return
        if self._commands > TOO_FAST * self._steps:
            self.counts["superseded"] += self._commands - self._steps
            rate = self._commands / (now - self._since)
            if now - self._said.get("fast", -math.inf) >= SAID_EVERY_S:
                self._said["fast"] = now
                self._say(
                    f"the client sends {rate:.0f} commands a second, the plant takes {1.0 / self.step_s:.0f}: "
                    "the last one before a step counts"
                )
        self._since, self._commands, self._steps = now, 0, 0

    # What is to be seen.

    @property
    def waits(self) -> bool:
        return self._waits

    @property
    def silent(self) -> bool:
        return self._silent

    @property
    def flags(self) -> int:
        """Bits in the order of `points.FLAGS`."""
        plant = self.plant
        told = (
            plant.brake_closed, plant.motor_lost, self._silent, plant.limited, plant.slack,
            self._halted == "off_rail", self._waits, self._halted == "diverged",
        )  # fmt: skip
        return sum(1 << bit for bit, told_so in enumerate(told) if told_so)

    def status(self) -> dict[str, Any]:
        """Everything at once, for JSON."""
        with self.lock:
            return {
                "machine": self.plant.machine.name,
                "values": {point.name: point.read(self) for point in self.outputs},
                "counts": dict(self.counts),
                "pace": self.pace.record(),
            }

    def _say(self, line: str) -> None:
        self._say_line(line)
