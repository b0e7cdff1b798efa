"""What a client may read and write: name, unit, range, meaning; every protocol's addresses are made from this table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from workbench.core.errors import InputError
from workbench.core.names import unit_of

if TYPE_CHECKING:
    from workbench.serve.plant import LivePlant
    from workbench.serve.session import Session

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
        hoist = cast("LivePlant", plant)
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
