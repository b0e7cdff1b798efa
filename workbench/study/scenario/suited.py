"""Whether a scenario suits its kind of machine: units of the motion, payloads, controller, events."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.control import SETTINGS, Events
from workbench.errors import InputError
from workbench.kinds import Kind, kind_of, of_kind
from workbench.machine import Axis, Hoist
from workbench.study.scenario.record import IN_METRES, Scenario, key_in, unit_of


def check_kind(scenario: Scenario, machine: Hoist | Axis, varied: set[str]) -> None:
    """InputError, with its place, for what this kind of machine does not have. varied: swept and drawn fields."""
    kind = kind_of(machine)
    for place in (*_keys(scenario), *sorted(varied)):
        key = place.rpartition(".")[2]
        if unit_of(key) not in ("", kind.moved.unit) and not place.startswith(("machine.", "drive.")):
            expected = key_in(kind.moved.unit, IN_METRES.get(key, key))
            raise InputError(f"{of_kind(machine)} moves in {kind.moved.unit}; expected {expected}", place=place)
    _controller(scenario, kind, machine)
    if kind.payload:
        return
    if scenario.payloads_kg is not None:
        raise InputError(
            f"{of_kind(machine)} carries no payload; leave it out, and sweep machine.{kind.free[0]} for other loads",
            place="payloads_kg",
        )
    if scenario.events != Events():
        raise InputError(f"{of_kind(machine)} has no events; they are of a hoist's motors and brake", place="events")
    if scenario.plant != "lumped":
        raise InputError(f"'{scenario.plant}', expected 'lumped' for {of_kind(machine)}", place="plant")
    for way in ("hoisting", "lowering"):
        if getattr(scenario.limits, way).given():
            raise InputError(f"{of_kind(machine)} has the same limits both ways", place=f"limits.{way}")


def _keys(scenario: Scenario) -> Iterator[str]:
    """Places of the motion's keys that are given."""
    for number, move in enumerate(scenario.moves):
        yield from (f"moves[{number}].{key}" for key in sorted(move.model_fields_set) if getattr(move, key) is not None)
    blocks = [("limits", scenario.limits)]
    blocks += [(f"limits.{way}", getattr(scenario.limits, way)) for way in ("hoisting", "lowering")]
    for name, block in blocks:
        values = block.model_dump()
        yield from (f"{name}.{key}" for key in IN_METRES | {v: v for v in IN_METRES.values()} if values.get(key))
    if scenario.start_position_m is not None:
        yield "start_position_m"
    if scenario.start_position_rad is not None:
        yield "start_position_rad"


def _controller(scenario: Scenario, kind: Kind, machine: Hoist | Axis) -> None:
    expected = SETTINGS[kind.name]
    if isinstance(scenario.controller, expected):
        return
    name = expected.model_fields["kind"].default
    raise InputError(
        f"is of {scenario.controller.kind!r} with {' and '.join(scenario.controller.GAINS)}; {of_kind(machine)} takes "
        f"kind: {name} with {' and '.join(expected.GAINS)}",
        place="controller",
    )
