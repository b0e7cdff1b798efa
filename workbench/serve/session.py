"""A plant in the hands of one client: what may be read and written (name, unit, range, meaning; every protocol's
addresses are made from that table), who controls, the latest torque, watchdog, faults, counts, and how late steps are.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

from workbench.core.errors import InputError, check_known, one_line
from workbench.core.names import unit_of
from workbench.serve.plant import LiveMachine, LivePlant

TORQUE, BRAKE, RESET = "torque_motor_nm", "brake_closed", "reset"
MOST_BRAKE_LATE_S = 10.0
OF_AXES = ("watchdog", "waiting", "diverged", "skipped")  # flags that an axis may have
FLAGS: tuple[tuple[str, str], ...] = (
    ("brake_closed", "the brake holds the motor shaft"),
    ("motor_lost", "one motor gives no torque"),
    ("watchdog", "the client is silent: torque is zero"),
    ("limited", "the torque asked for is more than the drive gives"),
    ("slack", "a fall of wire carries nothing"),
    ("off_rail", "the carriage left the rail; the plant stands until reset"),
    ("waiting", "no command yet: time stands still"),
    ("diverged", "the state grew without bound; the plant stands until reset"),
    ("skipped", "the computer was too late: time of the plant was left out since the start; see skipped_s"),
    ("overload", "a fall of wire carried more than its breaking load since the start"),
)


@dataclass(frozen=True)
class Point:
    """One value. kind: number or switch (0 or 1). lowest, highest: what the machine can bear of it, physically."""

    name: str
    kind: Literal["number", "switch"]
    meaning: str
    read: Callable[[Session], float]
    write: Callable[[Session, float], object] | None = None
    lowest: float = -math.inf
    highest: float = math.inf
    fits: Callable[[float], None] | None = None  # raises InputError for what is out of range in another way

    @property
    def unit(self) -> str:
        return unit_of(self.name) if self.kind == "number" else ""

    def check(self, value: object) -> float:
        """The value as a number. InputError where it is none, or out of range."""
        try:
            number = float(value) if isinstance(value, bool | int | float) else math.nan
        except OverflowError:  # a whole number of more than 308 digits
            number = math.inf
        if not math.isfinite(number):
            raise InputError(f"{str(value)[:40]!r}, expected a finite number", place=self.name)
        if self.kind == "switch" and number not in (0.0, 1.0):
            raise InputError(f"{number:g}, expected 0 or 1", place=self.name)
        if not self.lowest <= number <= self.highest:
            raise InputError(f"{number:g}, expected {self.lowest:.6g} to {self.highest:.6g}", place=self.name)
        if self.fits is not None:
            self.fits(number)
        return number


def inputs(session: Session) -> tuple[Point, ...]:
    """What may be written, in the order of every protocol's addresses; those of effects come last."""
    plant = session.plant
    drive, most = plant.kind.drive, plant.most_input()
    asked = f"{drive.quantity} {'of all motors, hoisting' if drive.parts else 'on the axis, forward'} positive"
    still = f"1: {'hang' if plant.has_brake else 'stand'} still at the start again, without faults"
    made = [Point(plant.plant.input, "number", asked, lambda s: s.asked, lambda s, x: s.command(x), -most, most)]
    if plant.has_brake:
        hoist = cast(LivePlant, plant)
        made += [
            _number("payload_kg", "what the carriage holds", "m_p", 0.0, hoist.most_payload_kg),
            _number("slack_m", "wire that came off the drum", "slack_m", 0.0, hoist.most_slack_m),
            Point("brake_late_s", "number", "how late the brake lets go", lambda s: s.brake_late_s,
                  lambda s, x: setattr(s, "brake_late_s", x), 0.0, MOST_BRAKE_LATE_S),
            Point(BRAKE, "switch", "the brake is asked to hold", lambda s: float(s.brake_asked),
                  lambda s, x: s.ask_brake(bool(x))),
            Point("motor_lost", "switch", "one motor gives no torque", lambda s: float(s.plant.motor_lost),
                  lambda s, x: s.plant.lose_motor(bool(x))),
        ]  # fmt: skip
    made.append(Point(RESET, "switch", still, lambda s: 0.0, lambda s, x: s.reset() if x else None))
    for effect in plant.effects.values():
        for name, (symbol, low, high) in plant.effect_parameters(effect.id).items():

            def fits(value: float, effect: Any = effect, name: str = name) -> None:
                effect.check(name, value, plant.plant.kind)

            made.append(_number(f"effects.{effect.id}.{name}", effect.meaning, symbol, low, high, fits))
    return tuple(made)


def _number(
    name: str, meaning: str, symbol: str, low: float, high: float, fits: Callable[[float], None] | None = None
) -> Point:
    """A number of the plant's equations."""
    read, write = lambda s: s.plant.value(symbol), lambda s, x: s.plant.put(symbol, x)
    return Point(name, "number", meaning, read, write, low, high, fits)


def _signal(name: str) -> Callable[[Session], float]:
    return lambda s: s.plant.signal(name)


def _flag(bit: int) -> Callable[[Session], float]:
    return lambda s: float(s.flags >> bit & 1)


def outputs(session: Session) -> tuple[Point, ...]:
    """What may be read, in the order of every protocol's addresses."""
    plant = session.plant
    drive = plant.kind.drive
    behind, left_out = f"{drive.quantity} behind limits and lag", "time of the plant that was left out since the start"
    rows: list[tuple[str, str, Callable[[Session], float]]] = [
        ("time_s", "time of the plant", lambda s: s.plant.time_s),
        (f"{drive.quantity}_at_work_{drive.suffix}", behind, lambda s: s.plant.at_work),
        *((signal.name, signal.meaning, _signal(signal.name)) for signal in plant.plant.signals),
        *([("payload_now_kg", "what the carriage holds", lambda s: s.plant.value("m_p"))] if plant.carries else []),
        ("skipped_s", left_out, lambda s: s.skipped_s),
    ]
    flags = [
        Point(f"is_{name}", "switch", meaning, _flag(bit))
        for bit, (name, meaning) in enumerate(FLAGS) if plant.has_brake or name in OF_AXES
    ]  # fmt: skip
    return (*(Point(name, "number", meaning, read) for name, meaning, read in rows), *flags)


SAID_EVERY_S = 5.0  # a complaint of one kind is repeated after that time at the earliest
LATE_US = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0)  # upper edges; beyond: the last
MOST_BEHIND_S = 0.2  # what is caught up; of a longer pause the rest is left out of the plant's time

Say = Callable[[str], None]


class Pace:
    """Times of steps. A step is on time where it ended before the next one was due.

    Steps that are late are made up, one after the other; a pause of more than MOST_BEHIND_S (the computer slept) is
    not: the plant's time stands still for the rest of it, which is counted as `skipped_s`.
    """

    def __init__(self, step_s: float) -> None:
        self.step_s = step_s
        self.late = [0] * (len(LATE_US) + 1)
        self.steps = self.overruns = self.pauses = 0
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
        self.worst_s = max(self.worst_s, late)
        self.late[bisect_right(LATE_US, 1e6 * late)] += 1

    def end(self, now: float) -> None:
        """The step has ended."""
        self.steps += 1
        self._due += 1
        self.overruns += now > self.due_s

    def record(self) -> dict[str, Any]:
        """For JSON: counts, the share on time, the histogram of how late steps began."""
        names = [f"<{edge:g} us" for edge in LATE_US] + [f">={LATE_US[-1]:g} us"]
        return {
            "rate_hz": 1.0 / self.step_s, "steps": self.steps, "on_time": (on_time := self.steps - self.overruns),
            "on_time_percent": 100.0 * on_time / self.steps if self.steps else 100.0, "overruns": self.overruns,
            "pauses": self.pauses, "skipped_s": self.skipped_s, "latest_start_ms": 1e3 * self.worst_s,
            "jitter": dict(zip(names, self.late, strict=True)),
        }  # fmt: skip


def run_at_pace(
    pace: Pace, step: Callable[[], None], until: Callable[[float], bool], wait: Callable[[float], None] = time.sleep
) -> None:
    """Steps when they are due until `until(now)`; wait(seconds) may do other work, and returns when they are over or
    before."""
    clock = time.monotonic
    pace.begin(clock())
    while not until(now := clock()):
        if (left := pace.due_s - now) > 0.0:
            wait(left)
            continue
        pace.start(now)
        step()
        pace.end(clock())


class Session:
    """A plant in the hands of one client. Every method takes the lock: protocols may call from any thread.

    who: the client, None for this process itself, which may always. The first one that commands or sets is the
    controller until it is silent; the others may read. watchdog_s: without a command for so long, the torque is zero
    and the brake closes, as a drive does that lost its master; `watchdog_brake` False leaves the brake open. Time is
    passed in, in seconds of any steady clock.
    """

    def __init__(
        self, plant: LiveMachine, step_s: float, watchdog_s: float, *, watchdog_brake: bool = True,
        clock: Callable[[], float], say: Say = lambda line: None,
    ) -> None:  # fmt: skip
        self.plant, self.step_s, self.watchdog_s, self.clock = plant, step_s, watchdog_s, clock
        self._watchdog_brake, self._say_line = watchdog_brake, say
        self.lock = threading.RLock()
        self.pace = Pace(step_s)
        self.counts: Counter[str] = Counter()
        self._said: dict[str, float] = {}
        self.controller: str | None = None
        self.inputs, self.outputs = inputs(self), outputs(self)
        self._start()

    def _start(self) -> None:
        self.asked = self.plant.hold
        self.brake_asked: bool = False
        self.brake_late_s: float = 0.0
        self._opens_at: float | None = None  # time of the plant
        self.waits, self.silent, self._halted = True, False, ""
        self.heard_s, self._skipped_before_s = self.clock(), self.pace.skipped_s

    # What a client asks for.

    def take(self, who: str | None) -> None:
        """`who` controls from now on. InputError where another client does."""
        with self.lock:
            if who is not None and self.controller not in (None, who) and not (self.silent or self.waits):
                raise InputError(
                    f"read only: {self.controller} controls the plant until it is silent for {self.watchdog_s:g} s",
                    place=who,
                )
            self.controller = who or self.controller

    def command(self, value: float, brake: bool | None = None, who: str | None = None) -> bool:
        """The input from the next step on, in its unit; brake None leaves it. False, and the last input stays, where it
        is no number that the machine can bear. InputError where another client controls."""
        with self.lock:
            self.take(who)
            drive, most = self.plant.kind.drive, self.plant.most_input()
            if not abs(value) <= most:
                expected = f"expected a finite number, at most {most:.6g} {drive.unit} either way"
                self.refused("not_finite", f"{drive.quantity} {value:g}: {expected}; the last {drive.quantity} stays")
                return False
            self.asked = value
            if self.waits:
                self.waits, self._skipped_before_s = False, self.pace.skipped_s
            self.counts["commands"] += 1
            self.heard_s = self.clock()
            if self.silent:
                self.silent = False
                self.say("the client is back")
            if brake is not None and brake != self.brake_asked:
                self.ask_brake(brake)
            return True

    def ask_brake(self, closed: bool) -> None:
        """Closes at once; opens after `brake_late_s`."""
        with self.lock:
            self.brake_asked = closed
            self._opens_at = None if closed else self.plant.time_s + self.brake_late_s

    def reset(self) -> None:
        """Back to the start; the counts go on."""
        with self.lock:
            self.plant.reset()
            self._start()

    def set(self, values: Mapping[str, object], who: str | None = None) -> None:
        """Points by name, all or none. InputError for a name or a value that cannot be, and where another client
        controls."""
        with self.lock:
            checked = []
            for name, value in values.items():
                point = self.point(str(name))
                if point.write is None:
                    raise InputError(f"'{name}' is read only", place=str(name))
                checked.append((point.write, point.check(value)))
            if checked:
                self.take(who)
            for write, number in checked:
                write(self, number)
                self.counts["orders"] += 1

    def point(self, name: str) -> Point:
        """InputError, with the nearest name, for one that there is not."""
        points = {point.name: point for point in (*self.inputs, *self.outputs)}
        check_known("unknown point", name, points)
        return points[name]

    def order(self, order: object, who: str | None = None) -> dict[str, Any]:
        """A JSON order: {"set": {name: value}}, {"get": [names]}, {"status": true}, {"points": true}; the answer."""
        known = ("set", "get", "status", "points")
        if not isinstance(order, Mapping) or not order:
            raise InputError(f"expected an object with one of {', '.join(known)}")
        for key in order:
            check_known("unknown order", key, known)
        answer: dict[str, Any] = {}
        with self.lock:
            values, wanted = order.get("set", {}), order.get("get", [])
            if not isinstance(values, Mapping):
                raise InputError("expected names with values", place="set")
            asked = [self.point(str(x)) for x in (wanted if isinstance(wanted, list) else [wanted])]
            self.set(values, who)
            if values:
                answer["set"] = sorted(map(str, values))
            if "get" in order:
                answer["get"] = {point.name: point.read(self) for point in asked}
            if order.get("status"):
                answer["status"] = self.status()
            if order.get("points"):
                answer["points"] = [point.name for point in (*self.inputs, *self.outputs)]
        return answer

    # What is said.

    def refused(self, kind: str, line: str) -> None:
        """Counts what was not taken, and says it, at most every SAID_EVERY_S for one kind."""
        with self.lock:
            self.counts[f"refused_{kind}"] += 1
            self._say_rarely(kind, f"{line} ({self.counts[f'refused_{kind}']} so far)")

    def say(self, line: str) -> None:
        """A line for whoever runs the server; one that cannot be written does not end the plant."""
        with contextlib.suppress(OSError, ValueError):
            self._say_line(one_line(line))

    def _say_rarely(self, kind: str, line: str) -> None:
        now = self.clock()
        if now - self._said.get(kind, -math.inf) >= SAID_EVERY_S:
            self._said[kind] = now
            self.say(line)

    # Time goes on.

    def step(self, *, live: bool = True) -> None:
        """One step of the plant. live: silence of the client counts; in lock step there is none."""
        with self.lock:
            if self.waits or self._halted:
                return
            now, plant = self.clock(), self.plant
            if live and not self.silent and now - self.heard_s > self.watchdog_s:
                self.silent = True
                self.counts["watchdog"] += 1
                brake = ", the brake closes" if self._watchdog_brake and plant.has_brake else ""
                self.say(f"the client is silent for {self.watchdog_s:g} s: {plant.kind.drive.quantity} is zero{brake}")
            if self.brake_asked or (self.silent and self._watchdog_brake):
                plant.put("brake_closed", 1.0)
                if not self.brake_asked:
                    self._opens_at = plant.time_s + self.brake_late_s
            elif plant.value("brake_closed") and plant.time_s >= (self._opens_at or 0.0) - 1e-9:
                plant.put("brake_closed", 0.0)
            self._move()
            self.counts["steps"] += 1
            if self.skipped_s > 0.0:
                left_out = f"{self.skipped_s:.3f} s of the plant's time were left out so far"
                self._say_rarely("skipped", f"this computer was too late: {left_out}")

    def _move(self) -> None:
        """The plant's own step; whatever becomes of it, the session goes on."""
        plant, overloaded = self.plant, self.plant.overloaded
        try:
            plant.step(0.0 if self.silent else self.asked)
        except ArithmeticError:
            plant.bounded = False
        stands = "; the plant stands still until it is reset"
        if not plant.bounded:
            self._halted = "diverged"
            self.say(f"the state grew without bound{stands}")
        elif plant.off_rail:
            self._halted = "off_rail"
            self.say(f"the carriage left the rail at height {plant.signal('position_carriage_m'):.2f} m{stands}")
        if plant.overloaded and not overloaded:
            self.say(f"a fall of wire carried more than its breaking load, at {plant.time_s:.3f} s of the plant")

    # What is to be seen.

    @property
    def skipped_s(self) -> float:
        """Time of the plant that was left out since the first command."""
        return 0.0 if self.waits else self.pace.skipped_s - self._skipped_before_s

    @property
    def flags(self) -> int:
        """Bits in the order of `points.FLAGS`."""
        plant = self.plant
        told = (
            plant.value("brake_closed") > 0.5, plant.motor_lost, self.silent, plant.limited, plant.slack,
            self._halted == "off_rail", self.waits, self._halted == "diverged", self.skipped_s > 0.0, plant.overloaded,
        )  # fmt: skip
        return sum(1 << bit for bit, told_so in enumerate(told) if told_so)

    def status(self) -> dict[str, Any]:
        """Everything at once, for JSON."""
        with self.lock:
            return {
                "machine": self.plant.machine.name, "controller": self.controller,
                "values": {point.name: point.read(self) for point in self.outputs},
                "counts": dict(self.counts), "pace": self.pace.record(),
            }  # fmt: skip
