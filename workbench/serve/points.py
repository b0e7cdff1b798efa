"""What a client may read and write: name, unit, range, meaning; every protocol's addresses are made from this table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from workbench.core.errors import InputError, nearest
from workbench.core.names import unit_of
from workbench.serve.plant import MOST_BRAKE_LATE_S

if TYPE_CHECKING:
    from workbench.effects import Effect
    from workbench.serve.plant import LiveMachine, LivePlant
    from workbench.serve.session import Session

TORQUE, BRAKE = "torque_motor_nm", "brake_closed"
RESET = "reset"
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
    unit: str
    meaning: str
    read: Callable[[Session], float]
    write: Callable[[Session, float], object] | None = None
    lowest: float = -math.inf
    highest: float = math.inf
    fits: Callable[[float], None] | None = None  # raises InputError for what is out of range in another way

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
    whole = "of all motors, hoisting positive" if drive.parts else "on the axis, forward positive"
    made = [
        Point(plant.plant.input, "number", drive.unit, f"{drive.quantity} {whole}", lambda s: s.asked,
              lambda s, value: s.command(value), -most, most)
    ]  # fmt: skip
    if plant.has_brake:
        made += _of_a_hoist(cast("LivePlant", plant))
    still = "hang still at the start again" if plant.has_brake else "stand still at the start again"
    made.append(
        Point(RESET, "switch", "", f"1: {still}, without faults", lambda s: 0.0,
              lambda s, value: s.reset() if value else None)
    )  # fmt: skip
    for effect in plant.effects.values():
        for parameter, (low, high) in plant.effect_parameters(effect.id).items():
            made.append(_of_an_effect(effect, parameter, plant.plant.kind, low, high))
    return tuple(made)


def _of_a_hoist(plant: LivePlant) -> list[Point]:
    """Payload and faults."""

    def of(session: Session) -> LivePlant:
        return cast("LivePlant", session.plant)

    return [
        Point("payload_kg", "number", "kg", "what the carriage holds", lambda s: s.plant.payload_kg,
              lambda s, value: of(s).carry(value), 0.0, plant.most_payload_kg()),
        Point("slack_m", "number", "m", "wire that came off the drum", lambda s: of(s).slack_m,
              lambda s, value: of(s).let_out(value), 0.0, plant.most_slack_m()),
        Point("brake_late_s", "number", "s", "how late the brake lets go", lambda s: s.brake_late_s,
              lambda s, value: s.delay_brake(value), 0.0, MOST_BRAKE_LATE_S),
        Point(BRAKE, "switch", "", "the brake is asked to hold", lambda s: float(s.brake_asked),
              lambda s, value: s.ask_brake(bool(value))),
        Point("motor_lost", "switch", "", "one motor gives no torque", lambda s: float(s.plant.motor_lost),
              lambda s, value: s.plant.lose_motor(bool(value))),
    ]  # fmt: skip


def _of_an_effect(effect: Effect, parameter: str, kind: str, lowest: float, highest: float) -> Point:
    return Point(
        f"effects.{effect.id}.{parameter}", "number", unit_of(parameter), effect.meaning,
        lambda s: s.plant.effect_value(effect.id, parameter),
        lambda s, value: s.plant.set_effect(effect.id, parameter, value), lowest, highest,
        lambda value: effect.check(parameter, value, kind),
    )  # fmt: skip


def outputs(plant: LiveMachine) -> tuple[Point, ...]:
    """What may be read, in the order of every protocol's addresses."""
    drive = plant.kind.drive
    at_work = f"{drive.quantity}_at_work_{drive.suffix}"
    signals = [Point(s.name, "number", unit_of(s.name), s.meaning, _signal(s.name)) for s in plant.plant.signals]
    payload = Point("payload_now_kg", "number", "kg", "what the carriage holds", lambda s: s.plant.payload_kg)
    return (
        Point("time_s", "number", "s", "time of the plant", lambda s: s.plant.time_s),
        Point(at_work, "number", drive.unit, f"{drive.quantity} behind limits and lag", lambda s: s.plant.at_work),
        *signals,
        *([payload] if plant.carries else []),
        Point("skipped_s", "number", "s", "time of the plant that was left out since the start", lambda s: s.skipped_s),
        *(
            Point(f"is_{name}", "switch", "", meaning, _flag(bit))
            for bit, (name, meaning) in enumerate(FLAGS)
            if plant.has_brake or name in OF_AXES
        ),
    )


def _signal(name: str) -> Callable[[Session], float]:
    return lambda session: session.plant.signal(name)


def _flag(bit: int) -> Callable[[Session], float]:
    return lambda session: float(session.flags >> bit & 1)


def point_of(points: tuple[Point, ...], name: str) -> Point:
    """InputError, with the nearest name, for one that there is not."""
    for point in points:
        if point.name == name:
            return point
    raise InputError(f"unknown point '{name}'; {nearest(name, [point.name for point in points])}")
