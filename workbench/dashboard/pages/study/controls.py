"""The values of the Study page's controls as a record, to and from a scenario. No streamlit here."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from workbench.control import PiSettings
from workbench.control.rigid import bandwidth_and_damping, rigid_gains, shaft_inertia_kg_m2
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.references import BASELINE
from workbench.study.load import changed
from workbench.study.scenario import LimitsBlock, MoveBlock, Scenario

BANDWIDTH, GAINS = "bandwidth", "gains"
LIMITS = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
FED = ("inertia", "weight", "friction", "wire")  # what is fed forward, and how far it knows the wire

# The page's first question, that of scenarios/payloads.yaml.
START = Scenario(
    name="what-if",
    payloads_kg=(0.0, 4500.0, 9000.0),
    start_position_m=4.0,
    moves=(MoveBlock(by_m=12.0), MoveBlock(dwell_s=3.0), MoveBlock(by_m=-12.0)),
    limits=LimitsBlock(speed_m_s=0.7, acceleration_m_s2=0.6, jerk_m_s3=0.8),
    references=("trapezoid", "ruckig", "ruckig_equal_time", "optimal"),
    controller=PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    settle_s=3.0,
)


@dataclass(frozen=True)
class Controls:
    """One value for each control. lowering: limits of its own, or the same as hoisting.

    own_moves: the moves are the loaded scenario's, which are not one way up and the same way down.
    """

    name: str = START.name
    payloads_kg: tuple[float, ...] = (0.0, 4500.0, 9000.0)
    references: tuple[str, ...] = ("ruckig", "ruckig_equal_time", "optimal")
    start_position_m: float = 4.0
    height_m: float = 12.0
    dwell_s: float = 3.0
    own_moves: bool = False
    hoisting: Three = (0.7, 0.6, 0.8)
    split: bool = False
    lowering: Three = (0.7, 0.6, 0.8)
    by: str = BANDWIDTH
    bandwidth_hz: float = 2.5
    damping: float = 1.0
    kp_nm_s_per_rad: float = 31.0
    ki_nm_per_rad: float = 122.0
    set_point_weight: float = 1.0
    feed_forward: Four = (0.0, 0.0, 0.0, 0.0)
    plant: str = "lumped"


@dataclass(frozen=True)
class Desk:
    """The controls, and the scenario under them that carries what no control shows (events, effects, drive, …)."""

    controls: Controls = field(default_factory=Controls)
    base: Scenario = START


def up_and_down(moves: Sequence[MoveBlock]) -> tuple[float, float] | None:
    """Height (m) and dwell (s) of moves that go up, wait and come down again; None for any others."""
    if len(moves) != 3 or moves[0].by_m is None or moves[1].dwell_s is None or moves[2].by_m is None:
        return None
    return (moves[0].by_m, moves[1].dwell_s) if moves[0].by_m == -moves[2].by_m > 0.0 else None


def desk_of(scenario: Scenario, machine: Hoist) -> Desk:
    """The controls set as a scenario says. InputError for one that this page cannot show: a sweep, a sample."""
    for key in ("sweep", "sample"):
        if getattr(scenario, key) is not None:
            raise InputError("is a batch of runs; run it on the page Batches, or take it out", place=key)
    if scenario.payloads_kg is None or scenario.start_position_m is None or not scenario.moves:
        raise InputError("expected payloads_kg, start_position_m and moves")
    up = _limits(scenario.limits, "hoisting")
    down = _limits(scenario.limits, "lowering")
    shape = up_and_down(scenario.moves)
    first = Controls()
    controls = Controls(
        name=scenario.name,
        payloads_kg=tuple(scenario.payloads_kg),
        references=tuple(kind for kind in scenario.kinds if kind != BASELINE),
        start_position_m=scenario.start_position_m,
        height_m=shape[0] if shape else first.height_m,
        dwell_s=shape[1] if shape else first.dwell_s,
        own_moves=shape is None,
        hoisting=up,
        split=up != down,
        lowering=down,
        plant=scenario.plant,
    )
    return with_controller(Desk(controls, scenario), scenario.controller, machine)


def with_controller(desk: Desk, settings: PiSettings, machine: Hoist) -> Desk:
    """The desk with another speed controller, set by its gains."""
    kp, ki, ff = settings.kp_nm_s_per_rad, settings.ki_nm_per_rad, settings.feed_forward
    bandwidth, damping = bandwidth_and_damping(shaft_inertia_kg_m2(machine), kp, ki)
    controls = replace(
        desk.controls,
        by=GAINS,
        bandwidth_hz=round(bandwidth, 2),
        damping=round(damping, 2) if math.isfinite(damping) else Controls().damping,
        kp_nm_s_per_rad=kp,
        ki_nm_per_rad=ki,
        set_point_weight=settings.set_point_weight,
        feed_forward=(ff.inertia, ff.weight, ff.friction, ff.wire),
    )
    return Desk(controls, desk.base.model_copy(update={"controller": settings}))


def _limits(block: LimitsBlock, way: str) -> Three:
    own = getattr(block, way)
    chosen = [value if (value := getattr(own, name)) is not None else getattr(block, name) for name in LIMITS]
    for name, value in zip(LIMITS, chosen, strict=True):
        if value is None and name != "jerk_m_s3":
            raise InputError("is missing; expected a positive number", place=f"limits.{name}")
    # A scenario of trapezoids needs no jerk limit.
    speed, acceleration, jerk = chosen
    return speed, acceleration, Controls().hoisting[2] if jerk is None else jerk


def gains(controls: Controls, machine: Hoist) -> tuple[float, float]:
    """kp and ki, as set or from bandwidth and damping with the empty carriage."""
    if controls.by == GAINS:
        return controls.kp_nm_s_per_rad, controls.ki_nm_per_rad
    return rigid_gains(shaft_inertia_kg_m2(machine), controls.bandwidth_hz, controls.damping)


def scenario_of(desk: Desk, machine: Hoist) -> Scenario:
    """The scenario that the controls ask for. InputError names what does not fit."""
    c = desk.controls
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", c.name) is None:
        raise InputError(f"'{c.name}', expected up to 64 letters, digits, '.', '_' or '-'", place="name")
    if not c.payloads_kg:
        raise InputError("choose at least one payload", place="payloads_kg")
    kp, ki = gains(c, machine)
    changes: dict[str, Any] = {
        "name": c.name,
        "payloads_kg": tuple(sorted(c.payloads_kg)),
        "references": (BASELINE, *c.references),
        "start_position_m": c.start_position_m,
        "plant": c.plant,
        "outputs": desk.base.outputs if desk.base.outputs.signals != "none" else START.outputs,
        "limits": dict(zip(LIMITS, c.hoisting, strict=True)),
        "controller": desk.base.controller.model_dump()
        | {"kp_nm_s_per_rad": kp, "ki_nm_per_rad": ki, "set_point_weight": c.set_point_weight}
        | {"feed_forward": dict(zip(FED, c.feed_forward, strict=True))},
    }
    if c.split:
        changes["limits"]["lowering"] = dict(zip(LIMITS, c.lowering, strict=True))
    if not c.own_moves:
        changes["moves"] = ({"by_m": c.height_m}, {"dwell_s": c.dwell_s}, {"by_m": -c.height_m})
    return changed(desk.base, changes)


def highest_move_m(machine: Hoist, start_position_m: float) -> float:
    """How far up a move may go from there."""
    return machine.highest_position_m - start_position_m


def within(controls: Controls, machine: Hoist, fastest_m_s: float) -> Controls:
    """The controls moved inside what this machine allows, where another machine allowed more."""
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    start = min(max(controls.start_position_m, low), high - 1.0)
    height = min(controls.height_m, highest_move_m(machine, start))
    up, down = controls.hoisting, controls.lowering
    return replace(
        controls,
        start_position_m=start,
        height_m=height,
        hoisting=(min(up[0], fastest_m_s), up[1], up[2]),
        lowering=(min(down[0], fastest_m_s), down[1], down[2]),
    )
