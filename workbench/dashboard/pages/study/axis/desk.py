"""The values of the Study page's controls for an axis, to and from a scenario. No streamlit here."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.analysis.usual import usual_cascade
from workbench.control import Cascade
from workbench.errors import InputError
from workbench.kinds import kind_of, of_kind
from workbench.machine import Axis
from workbench.references import BASELINE
from workbench.study.load import changed
from workbench.study.scenario import MoveBlock, Scenario, key_in

FED = ("speed", "inertia", "load", "friction")
LIMITS = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
REFERENCES = ("ruckig", "ruckig_equal_time")
ALIKE = 1.5  # times the inertia: another axis to which the same motion and gains still apply


@dataclass(frozen=True)
class AxisDesk:
    """One value for each control, in the axis' units, and the scenario under them that carries what no control shows.

    limits: of speed, acceleration, jerk. own_moves: the scenario's moves, which are not one way and the same back.
    feed_forward: in the order of FED. kind: the machine's, by name; inertia: kg or kg m^2 of the one it was set for.
    """

    kind: str
    inertia: float
    base: Scenario
    references: tuple[str, ...]
    start: float
    way: float
    dwell_s: float
    own_moves: bool
    limits: tuple[float, float, float]
    controller: Cascade

    @property
    def feed_forward(self) -> tuple[float, ...]:
        ahead = self.controller.feed_forward
        return tuple(float(getattr(ahead, name)) for name in FED)

    def suits(self, machine: Axis) -> bool:
        """Whether what is set for one axis is a sensible beginning for this one."""
        kind = kind_of(machine)
        ratio = kind.looped.total_inertia(machine, 0.0) / self.inertia
        return kind.name == self.kind and 1.0 / ALIKE < ratio < ALIKE


def usual_desk(machine: Axis) -> AxisDesk:
    """There and back at six tenths of the top speed, a third of the drive's limit for the ramps, the controller by
    rule.

    For a top speed that is nowhere stated a fifth of a metre or two radians a second serve.
    """
    kind, controller = kind_of(machine), usual_cascade(machine)
    loop = kind.looped
    inertia = loop.total_inertia(machine, 0.0)
    speed = 0.6 * loop.speed_scale(machine)
    ramp = max(0.2, 3.0 * speed * inertia / loop.input_limit(machine))
    limits = (_round(speed), _round(speed / ramp), _round(1.5 * speed / ramp**2))
    way = _round(3.0 * speed * ramp)
    unit = kind.moved.unit
    base = Scenario.model_validate(
        {
            "name": "what-if",
            key_in(unit, "start_position_m"): 0.0,
            "moves": _there_and_back(unit, way, 0.5),
            "limits": {key_in(unit, name): value for name, value in zip(LIMITS, limits, strict=True)},
            "references": (BASELINE, *REFERENCES),
            "controller": controller.model_dump(),
            "lead_s": 0.2,
            "settle_s": 0.8,
            "outputs": {"signals": "thinned", "every_s": 0.002},
        }
    )
    return AxisDesk(kind.name, inertia, base, REFERENCES, 0.0, way, 0.5, False, limits, controller)


def _round(value: float) -> float:
    return float(f"{value:.2g}")


def _there_and_back(unit: str, way: float, dwell_s: float) -> tuple[dict[str, float], ...]:
    by = key_in(unit, "by_m")
    return {by: way}, {"dwell_s": dwell_s}, {by: -way}


def axis_desk_of(scenario: Scenario, machine: Axis) -> AxisDesk:
    """The controls set as a scenario says. InputError for one that this page cannot show: a sweep, a sample."""
    for key in ("sweep", "sample"):
        if getattr(scenario, key) is not None:
            raise InputError("is a batch of runs; run it on the page Batches, or take it out", place=key)
    kind, usual = kind_of(machine), usual_desk(machine)
    if not isinstance(scenario.controller, Cascade):
        raise InputError(f"is a hoist's; {of_kind(machine)} takes kind: cascade", place="controller")
    if scenario.start is None or not scenario.moves:
        raise InputError(f"expected {key_in(kind.moved.unit, 'start_position_m')} and moves")
    given = scenario.limits.given()
    for name in LIMITS[:2]:
        if name not in given:
            raise InputError("is missing; expected a positive number", place=f"limits.{key_in(kind.moved.unit, name)}")
    there = there_and_back(scenario.moves)
    return AxisDesk(
        kind=kind.name,
        inertia=usual.inertia,
        base=scenario,
        references=tuple(name for name in scenario.kinds if name != BASELINE),
        start=scenario.start,
        way=there[0] if there else usual.way,
        dwell_s=there[1] if there else usual.dwell_s,
        own_moves=there is None,
        limits=(given[LIMITS[0]], given[LIMITS[1]], given.get(LIMITS[2], usual.limits[2])),
        controller=scenario.controller,
    )


def there_and_back(moves: Sequence[MoveBlock]) -> tuple[float, float] | None:
    """Way (m or rad) and dwell (s) of moves that go one way, wait and come back; None for any others."""
    if len(moves) != 3:
        return None
    there, rest, back = (block.step() for block in moves)
    if there.by_m is None or rest.dwell_s is None or back.by_m is None or there.by_m != -back.by_m:
        return None
    return there.by_m, rest.dwell_s


def with_cascade(desk: AxisDesk, controller: Cascade) -> AxisDesk:
    return replace(desk, controller=controller)


def axis_scenario(desk: AxisDesk, machine: Axis) -> Scenario:
    """The scenario that the controls ask for. InputError names what does not fit."""
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", desk.base.name) is None:
        raise InputError(f"'{desk.base.name}', expected up to 64 letters, digits, '.', '_' or '-'", place="name")
    unit = kind_of(machine).moved.unit
    changes: dict[str, Any] = {
        "references": (BASELINE, *desk.references),
        key_in(unit, "start_position_m"): desk.start,
        "limits": {key_in(unit, name): value for name, value in zip(LIMITS, desk.limits, strict=True)},
        "controller": desk.controller.model_dump(),
    }
    if desk.base.outputs.signals == "none":
        changes["outputs"] = {"signals": "thinned", "every_s": 0.002}
    if not desk.own_moves:
        changes["moves"] = _there_and_back(unit, desk.way, desk.dwell_s)
    return changed(desk.base, changes)


def with_gains(controller: Cascade, values: dict[str, Any]) -> Cascade:
    """The cascade with other values, checked like a file. InputError names the value."""
    from pydantic import ValidationError

    try:
        return type(controller).model_validate(controller.model_dump() | values)
    except ValidationError as error:
        said = error.errors()[0]
        place = ".".join(str(part) for part in said["loc"]) or "controller"
        raise InputError(str(said["msg"]).removeprefix("Value error, "), place=place) from error
