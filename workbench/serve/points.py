"""What a client may read and write: name, unit, meaning; every protocol's addresses are made from this table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from workbench.errors import InputError, nearest
from workbench.names import unit_of

if TYPE_CHECKING:
    from workbench.effects import Effect
    from workbench.serve.live import LiveMachine
    from workbench.serve.plant import LivePlant
    from workbench.serve.session import Session

TORQUE, BRAKE = "torque_motor_nm", "brake_closed"
RESET = "reset"
OF_AXES = ("watchdog", "waiting", "diverged")  # flags that an axis may have
FLAGS: tuple[tuple[str, str], ...] = (
    ("brake_closed", "the brake holds the motor shaft"),
    ("motor_lost", "one motor gives no torque"),
    ("watchdog", "the client is silent: torque is zero"),
    ("limited", "the torque asked for is more than the drive gives"),
    ("slack", "a fall of wire carries nothing"),
    ("off_rail", "the carriage left the rail; the plant stands until reset"),
    ("waiting", "no command yet: time stands still"),
    ("diverged", "the state grew without bound; the plant stands until reset"),
)


@dataclass(frozen=True)
class Point:
    """One value. kind: number or switch (0 or 1). least: the smallest number that it takes."""

    name: str
    kind: Literal["number", "switch"]
    unit: str
    meaning: str
    read: Callable[[Session], float]
    write: Callable[[Session, float], object] | None = None
    least: float = -math.inf
    fits: Callable[[float], None] | None = None  # raises InputError for what is out of range in another way

    def check(self, value: object) -> float:
        """The value as a number. InputError where it is none, or out of range."""
        if isinstance(value, bool):
            value = float(value)
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{value!r}, expected a finite number", place=self.name)
        if self.kind == "switch" and value not in (0, 1):
            raise InputError(f"{value:g}, expected 0 or 1", place=self.name)
        if value < self.least:
            raise InputError(f"{value:g}, expected at least {self.least:g}", place=self.name)
        if self.fits is not None:
            self.fits(value)
        return float(value)


def _signal(name: str) -> Callable[[Session], float]:
    return lambda session: session.plant.signals[name]


def inputs(session: Session) -> tuple[Point, ...]:
    """What may be written, in the order of every protocol's addresses; those of effects come last."""
    plant = session.plant
    made = [_input(plant)]
    if plant.carries:
        made.append(
            Point("payload_kg", "number", "kg", "what the carriage holds", lambda s: s.plant.payload_kg,
                  lambda s, value: _hoist(s).carry(value), 0.0)
        )  # fmt: skip
    if plant.has_brake:
        made += _HOIST
    still = "hang still at the start again" if plant.has_brake else "stand still at the start again"
    made.append(
        Point(RESET, "switch", "", f"1: {still}, without faults", lambda s: 0.0,
              lambda s, value: s.reset() if value else None)
    )  # fmt: skip
    for effect in session.plant.effects.values():
        for parameter in session.plant.effect_parameters(effect.id):
            name = f"effects.{effect.id}.{parameter}"
            made.append(_effect_point(name, effect, parameter, plant.plant.kind))
    return tuple(made)


def _hoist(session: Session) -> LivePlant:
    """The plant of a session that has the points of a hoist."""
    return cast("LivePlant", session.plant)


_HOIST = (
    Point("slack_m", "number", "m", "wire that came off the drum", lambda s: _hoist(s).slack_m,
          lambda s, value: _hoist(s).let_out(value), 0.0),
    Point("brake_late_s", "number", "s", "how late the brake lets go", lambda s: s.brake_late_s,
          lambda s, value: s.delay_brake(value), 0.0),
    Point(BRAKE, "switch", "", "the brake is asked to hold", lambda s: float(s.brake_asked),
          lambda s, value: s.ask_brake(bool(value))),
    Point("motor_lost", "switch", "", "one motor gives no torque", lambda s: float(s.plant.motor_lost),
          lambda s, value: s.lose_motor(bool(value))),
)  # fmt: skip


def _input(plant: LiveMachine) -> Point:
    """The input that a client commands."""
    drive, name = plant.kind.drive, plant.plant.input
    whole = "of all motors, hoisting positive" if drive.parts else "on the axis, forward positive"
    return Point(name, "number", drive.unit, f"{drive.quantity} {whole}", lambda s: s.asked,
                 lambda s, value: s.command(value))  # fmt: skip


def at_work(plant: LiveMachine) -> str:
    """The name of the output that is the input behind limits and lag."""
    return f"{plant.kind.drive.quantity}_at_work_{plant.kind.drive.suffix}"


def _effect_point(name: str, effect: Effect, parameter: str, kind: str) -> Point:
    return Point(
        name,
        "number",
        unit_of(parameter),
        effect.meaning,
        lambda s: s.plant.effect_value(effect.id, parameter),
        lambda s, value: s.plant.set_effect(effect.id, parameter, value),
        fits=lambda value: effect.check(parameter, value, kind),
    )


def outputs(plant: LiveMachine) -> tuple[Point, ...]:
    """What may be read, in the order of every protocol's addresses."""
    drive = plant.kind.drive
    signals = [Point(s.name, "number", unit_of(s.name), s.meaning, _signal(s.name)) for s in plant.plant.signals]
    payload = Point("payload_now_kg", "number", "kg", "what the carriage holds", lambda s: s.plant.payload_kg)
    behind = f"{drive.quantity} behind limits and lag"
    return (
        Point("time_s", "number", "s", "time of the plant", lambda s: s.plant.time_s),
        Point(at_work(plant), "number", drive.unit, behind, lambda s: s.plant.at_work),
        *signals,
        *([payload] if plant.carries else []),
        *(
            Point(f"is_{name}", "switch", "", meaning, lambda s, bit=bit: float(s.flags >> bit & 1))  # type: ignore[misc]
            for bit, (name, meaning) in enumerate(FLAGS)
            if plant.has_brake or name in OF_AXES
        ),
    )


def point_of(points: tuple[Point, ...], name: str) -> Point:
    """InputError, with the nearest name, for one that there is not."""
    for point in points:
        if point.name == name:
            return point
    raise InputError(f"unknown point '{name}'; {nearest(name, [point.name for point in points])}")


def write(session: Session, points: tuple[Point, ...], name: str, value: object) -> None:
    """Sets a point by name. InputError for a name or a value that cannot be."""
    point = point_of(points, name)
    if point.write is None:
        raise InputError(f"'{name}' is read only", place=name)
    point.write(session, point.check(value))
