"""Simulate one motion under the speed loop, and how the run is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.analysis.usual import usual_controller
from workbench.control import Events, PiSettings
from workbench.core.errors import InputError, nearest
from workbench.core.table import Column, Table, words
from workbench.face.logs import run_figure
from workbench.face.view import View
from workbench.figures.study import overview
from workbench.machines import Hoist, default_hoist, load_of
from workbench.references import (
    LimitPair,
    Limits,
    Step,
    allowed_carriage_speed_m_s,
    motor_speed_rad_s,
    plan_motion,
)  # fmt: skip
from workbench.simulate.loop import NO_EVENTS, LoopCase, LoopResult, simulate_loop
from workbench.simulate.multibody_loop import check_multibody, simulate_multibody_loop
from workbench.study.labels import metric_label
from workbench.study.run import motor_torque_limit_nm
from workbench.view.numbers import figures

LEAD_S, SETTLE_S = 0.5, 2.0
PLANTS = ("lumped", "multibody")


def simulate(
    moves: float | Sequence[Step],
    *,
    machine: Hoist | None = None,
    payload_kg: float = 0.0,
    start_position_m: float | None = None,
    limits: Limits | LimitPair | None = None,
    reference: str = "ruckig",
    controller: PiSettings | None = None,
    events: Events = NO_EVENTS,
    record_every: int = 10,
    plant: str = "lumped",
) -> LoopResult:
    """Move the carriage under the sampled speed loop, from rest to rest.

    moves: one distance in m (up positive), or a list of `Step`. Without them: the machine is the default hoist,
    the start a quarter up the rail, the controller `usual_controller`, the limits those of `usual_limits`.
    reference: trapezoid, ruckig or another kind. record_every: of the controller's samples one in so many is kept.
    plant: lumped or multibody; the second needs the extra 'multibody', takes seconds and gives forces of joints too.
    InputError for a motion that is not possible.
    """
    if plant not in PLANTS:
        raise InputError(f"unknown plant '{plant}'; {nearest(plant, PLANTS)}", place="plant")
    machine = default_hoist() if machine is None else machine
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    start = low + 0.25 * (high - low) if start_position_m is None else start_position_m
    controller = usual_controller(machine) if controller is None else controller
    steps = moves if isinstance(moves, Sequence) else [Step(by_m=float(moves))]
    chosen = usual_limits(machine) if limits is None else limits
    plan = plan_motion(reference, steps, start, chosen, (low, high), LEAD_S, SETTLE_S, load_of(machine, payload_kg))
    carriage = plan.sample(controller.sample_time_s).speed_m_s
    speed = motor_speed_rad_s(carriage, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    name = f"{payload_kg:g} kg, {reference}"
    case = LoopCase(name, machine, payload_kg, start, controller, speed, events)
    if plant == "multibody":
        check_multibody(machine)
        return simulate_multibody_loop(case, record_every=record_every)
    return simulate_loop([case], record_every=record_every)[0]


def usual_limits(machine: Hoist) -> Limits:
    """Nine tenths of the speed that the motors allow, reached in about 2 s: ramps of 1.2 s, jerk limited to 0.8 s."""
    ratio, drum = machine.gearbox.ratio, machine.winch.drum_diameter_m
    speed = 0.9 * allowed_carriage_speed_m_s(machine.motor.nominal_speed_rad_s, ratio, drum)
    return Limits(speed, speed / 1.2, speed / 1.2 / 0.8)


def _metrics(result: LoopResult) -> Table:
    rows = [
        [label.words, figures(value, 4), label.unit]
        for name, value in result.metrics.items()
        for label in [metric_label(name)]
    ]
    return Table(
        [words("metric"), Column("value"), words("unit")], rows, f"{result.case.name}: {result.outcome.value}."
    )


def _overview(result: LoopResult) -> Any:
    machine = result.case.machine
    runs = [(result.case.name, result.run)]
    return overview(runs, machine.motor.nominal_torque_nm, motor_torque_limit_nm(machine), result.case.name)


def _columns(result: LoopResult) -> Mapping[str, Sequence[Any]]:
    return {"time_s": result.run.time_s, **result.run.signals}  # type: ignore[dict-item]


VIEW = View(
    {"metrics": _metrics},
    {"overview": _overview, "signals": lambda r: run_figure(r.run)},
    _columns,
    index="time_s",
)
