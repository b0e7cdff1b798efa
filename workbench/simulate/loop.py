"""Machines under their sampled loop, one case or many."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from workbench.control import (
    BRAKE,
    PI,
    Controller,
    Events,
    PiSettings,
    Settings,
    full_pi,
    lag_step,
    loop_values,
    losing_a_motor,
    weight_before,
)
from workbench.control.pi import NEVER
from workbench.core.run import Array, Run
from workbench.core.shown import Brief, Shown
from workbench.effects import joined, of
from workbench.engine import kernels
from workbench.machines import HOIST as HOIST_KIND
from workbench.machines import NO_EFFECTS, AnyKind, Drive, Effects, Hoist, kind_of
from workbench.metrics import set_of
from workbench.simulate import axis_loop
from workbench.simulate.outcome import BOUNDLESS, Outcome
from workbench.simulate.plant_model import PlantModel

NO_EVENTS = Events()
RAIL_PLAY = 0.01  # m, that a stop at the end of the rail may overshoot

RECORDED = HOIST_KIND.looped.recorded


@dataclass(frozen=True, repr=False)
class LoopCase(Brief):
    """One closed-loop run: a machine, a load, a controller and the motion it shall follow.

    speed_reference_rad_s: (n,) of the driven coordinate at the controller's samples; of a linear axis m/s.
    position_reference: (n,) of an axis, m or rad; None: the speed summed up from the start. start_position_m: of a
    rotary axis in rad. The drive and the effects are the machine's. start_time_s: when the run begins in its campaign.
    """

    name: str
    machine: AnyKind
    payload_kg: float
    start_position_m: float
    controller: Settings
    speed_reference_rad_s: Array
    events: Events = NO_EVENTS
    start_time_s: float = 0.0
    position_reference: Array | None = None


@dataclass(frozen=True, repr=False)
class LoopResult(Shown):
    """The run (signals at every `record_every`-th sample), its metrics, and how it ended.

    metrics are taken at every controller sample. end_position_m is the last place of what moves. hold_torque_nm: the
    input that holds the load at the start, of a linear axis in N.
    """

    case: LoopCase
    run: Run
    metrics: dict[str, float]
    outcome: Outcome
    at: str
    end_position_m: float
    hold_torque_nm: float


def simulate_loop(
    cases: Sequence[LoopCase], *, record_every: int = 10, step_s: float = 0.001, threads: int | None = None
) -> list[LoopResult]:
    """Simulate cases; each starts hanging still, held without a bump (by the brake where it is closed).

    Cases that need the same kernel (sample time, kind of loop, brake or not, lag or not)
    run together. The plant takes steps of at most `step_s` (s) between samples.
    record_every = 0 keeps no signals. A reference shorter than the longest of its group
    is simulated further at its last value, and its run and metrics end where it ends.
    """
    results: dict[int, LoopResult] = {}
    groups: dict[tuple[Any, ...], list[int]] = {}
    for j, case in enumerate(cases):
        groups.setdefault(_kernel_key(case), []).append(j)
    for members in groups.values():
        done = _simulate_alike([cases[j] for j in members], record_every, step_s, threads)
        results.update(zip(members, done, strict=True))
    return [results[j] for j in range(len(cases))]


@dataclass(frozen=True)
class Recipe:
    """What is a kind's own in a closed-loop run; each function takes the case first.

    recorded: signals that a run keeps. beside: effects that events bring. numbers(case, hold): by symbol. references:
    (references, n). more(case, time, input): further signals of a run. outcome(machine, time, signals, end, metrics).
    """

    recorded: Callable[[LoopCase], tuple[str, ...]]
    controller: Callable[[LoopCase], Controller]
    beside: Callable[[LoopCase], Effects]
    numbers: Callable[[LoopCase, float], dict[str, float]]
    references: Callable[[LoopCase], Array]
    more: Callable[[LoopCase, Array, Array], dict[str, Array]]
    outcome: Callable[..., tuple[Outcome, str]]


def hoist_controller(case: LoopCase) -> Controller:
    """The plain loop where nothing beside it is asked for, else the full one; of a motor that fails where one does."""
    assert isinstance(case.controller, PiSettings)
    drive, settings = case.machine.drive, case.controller
    plain = settings.plain and not (drive.encoder_counts_per_turn or drive.speed_filter_s or drive.speed_delay_s)
    loop = PI if plain else full_pi(drive.speed_delay_s > 0.0, settings.feed_forward.through_the_wire)
    return loop if case.events.motor_fails_s is None else losing_a_motor(loop)


def _hoist_numbers(case: LoopCase, hold: float) -> dict[str, float]:
    assert isinstance(case.controller, PiSettings)
    return {
        **loop_values(case.controller, case.machine.drive, hold),
        **case_limits(case),
        **case.events.values(),
    }


_HOIST = Recipe(
    recorded=lambda case: RECORDED,
    controller=hoist_controller,
    beside=lambda case: BRAKE if case.events.brakes else NO_EFFECTS,
    numbers=_hoist_numbers,
    references=lambda case: np.asarray(case.speed_reference_rad_s, dtype=float)[None, :],
    more=lambda case, time, torque: motor_torques(case, time, torque),
    outcome=lambda *ended: loop_outcome(*ended),
)
_AXIS = Recipe(
    recorded=lambda case: kind_of(case.machine).looped.recorded,
    controller=axis_loop.controller_of,
    beside=lambda case: NO_EFFECTS,
    numbers=axis_loop.numbers,
    references=axis_loop.references,
    more=lambda case, time, torque: {},
    outcome=axis_loop.outcome,
)


def _recipe(case: LoopCase) -> Recipe:
    """An axis' where the loop has a position loop, else the hoist's."""
    return _AXIS if kind_of(case.machine).looped.position_loop else _HOIST


def _kernel_key(case: LoopCase) -> tuple[Any, ...]:
    """The properties that all cases of one kernel call share, such as the length of the run."""
    recipe = _recipe(case)
    effects = joined(of(case.machine).effects, recipe.beside(case))
    lagged = case.machine.drive.torque_lag_s > 0.0
    controller, n = recipe.controller(case), len(case.speed_reference_rad_s)
    return kind_of(case.machine).name, case.controller.sample_time_s, controller, lagged, effects, n


def _simulate_alike(
    cases: Sequence[LoopCase], record_every: int, step_s: float, threads: int | None
) -> list[LoopResult]:
    _, sample_time, controller, lagged, effects, n = _kernel_key(cases[0])
    recipe, kind = _recipe(cases[0]), kind_of(cases[0].machine)
    plant, watcher = kind.plant, set_of(kind.name).observer
    recorded = recipe.recorded(cases[0]) if record_every else ()
    substeps = max(1, math.ceil(sample_time / step_s - 1e-9))
    at_work = [PlantModel(plant, of(case.machine)) for case in cases]
    plain = [w.values(c.machine, c.payload_kg, c.start_time_s) for w, c in zip(at_work, cases, strict=True)]
    start, holds = at_work[0].starts(
        [case.start_position_m for case in cases], [0.0] * len(cases), [0.0] * len(cases), plain
    )
    values, memory = [], []
    for case, p, angle, hold in zip(cases, plain, start[0], holds, strict=True):
        numbers = {**vars(p), **recipe.numbers(case, hold), **lag_values(case, sample_time / substeps)}
        values.append(numbers)
        memory.append(controller.start(SimpleNamespace(**numbers), hold, angle))
    names = kernels.loop_parameters(plant, effects, controller, watcher)
    every = record_every or n + 1
    out, sums, ends = kernels.loop(
        plant,
        controller,
        watcher,
        recorded,
        np.array([[v[name] for v in values] for name in names]),
        _references(cases, recipe),
        sample_time,
        start,
        np.array(memory).T,
        every=every,
        substeps=substeps,
        actual=holds if lagged else None,
        effects=effects,
        threads=threads,
    )
    time = np.arange(out.shape[0]) * (sample_time * every)
    return [
        _result(case, time, dict(zip(recorded, out[:, :, j].T.copy(), strict=True)), sums[:, j], ends[:, j], holds[j],
                values[j], n * sample_time)
        for j, case in enumerate(cases)
    ]  # fmt: skip


def _references(cases: Sequence[LoopCase], recipe: Recipe) -> list[Array]:
    """One (references, n) array a case; cases that share a reference share the array."""
    known: dict[tuple[int, int, float], Array] = {}
    arrays = []
    for case in cases:
        # An axis' speed is summed up from where it starts.
        start = case.start_position_m if recipe is _AXIS and case.position_reference is None else 0.0
        key = id(case.speed_reference_rad_s), id(case.position_reference), start
        if key not in known:
            known[key] = recipe.references(case)
            if not np.all(np.isfinite(known[key])):  # a limit would make a torque of it, and nobody would know
                raise ValueError(f"case {case.name}: the speed reference is not finite throughout")
        arrays.append(known[key])
    return arrays


def torque_limit_nm(machine: Hoist) -> float:
    """The largest torque of all motors together, at or below nominal speed."""
    return machine.motor.nominal_torque_nm * machine.drive.overload / shares(machine)[0]


def shares(machine: Hoist) -> tuple[float, float]:
    """The share of the torque that the more loaded motor gives: with all motors, and after one has failed."""
    n = machine.motor.count
    if n == 1:
        return 1.0, 1.0
    first = machine.drive.torque_share if n == 2 else 1.0 / n
    return max(first, 1.0 - first) if n == 2 else first, 1.0 / (n - 1)


def overload_numbers(drive: Drive) -> dict[str, float]:
    """By symbol: the mean square of the torque over the drive's duty cycle, in nominal torques (nominal torque but for
    one overload a period), and the heat of one overload above that mean, in seconds at nominal torque."""
    above = drive.overload**2 - 1.0
    mean_square = 1.0 + max(above, 0.0) * drive.overload_time_s / drive.overload_period_s
    return {
        "cycle_mean_square": mean_square,
        "overload_s": max((1.0 + above - mean_square) * drive.overload_time_s, 1e-9),
    }


def kept_by_others(machine: Hoist) -> float:
    """The share of the torque that a failing motor leaves, before the others take over; of two the first works on."""
    n = machine.motor.count
    return machine.drive.torque_share if n == 2 else 1.0 - 1.0 / n


def lag_values(case: LoopCase, step_s: float) -> dict[str, float]:
    """The torque's lag over one step of the plant, by symbol."""
    lag = lag_step(case.machine.drive.torque_lag_s, step_s)
    return {"lag_left": lag.left, "lag_start": lag.start, "lag_slope": lag.slope_per_s, "lag_mean": lag.mean}


def torque_limits(machine: Hoist) -> dict[str, float]:
    """By symbol: the torque of all motors (N m), after one failed, and the speed (rad/s) above which it falls."""
    one = machine.motor.nominal_torque_nm * machine.drive.overload
    share, share_failed = shares(machine)
    return {
        "u_all": one / share,
        "u_one": one / share_failed if machine.motor.count > 1 else 0.0,
        "w_weak": machine.motor.nominal_speed_rad_s if machine.drive.field_weakening else NEVER,
    }


def case_limits(case: LoopCase) -> dict[str, float]:
    """Torque limits, shares and ends of the rail by symbol. The harder-worked motor limits them all."""
    machine = cast(Hoist, case.machine)
    share, share_failed = shares(machine)
    fails = case.events.motor_fails_s
    return {
        **torque_limits(machine),
        "t_fail": NEVER if fails is None else fails,
        "T_nominal": machine.motor.nominal_torque_nm,
        "share": share,
        "share_failed": share_failed,
        "kept": kept_by_others(machine),
        "before": weight_before(machine.drive.torque_lag_s, case.controller.sample_time_s),
        "w_nominal": machine.motor.nominal_speed_rad_s,
        **overload_numbers(machine.drive),
        "W_break": machine.wire.breaking_load_n or 0.0,
        "x_low": machine.rail.lowest_position_m,
        "x_high": machine.highest_position_m,
    }


def _result(
    case: LoopCase,
    time: Array,
    signals: dict[str, Array],
    sums: Array,
    end: Array,
    hold: float,
    values: dict[str, Any],
    duration: float,
) -> LoopResult:
    recipe, kind = _recipe(case), kind_of(case.machine)
    if signals:
        signals |= recipe.more(case, time, signals[kind.plant.input])
    else:
        time = time[:0]
    run = Run(case.name, time, signals, case.payload_kg, case.start_position_m, case.start_time_s)
    metrics = set_of(kind.name).observer.finish(sums, SimpleNamespace(**values), duration)
    outcome, at = recipe.outcome(case.machine, time, signals, end, metrics)
    return LoopResult(case, run, metrics, outcome, at, float(end[kind.plant.placed]), hold)


def motor_torques(case: LoopCase, time: Array, torque: Array) -> dict[str, Array]:
    """The torque of the first and of the second motor (of equal ones: of each); after a failure the first works on."""
    machine = cast(Hoist, case.machine)
    n = machine.motor.count
    first = machine.drive.torque_share if n == 2 else 1.0 / n
    fails = case.events.motor_fails_s
    failed = np.zeros(len(time), bool) if fails is None else time >= fails
    left = 1.0 / max(n - 1, 1)
    return {
        "torque_motor1_nm": torque * np.where(failed, left, first),
        "torque_motor2_nm": torque * np.where(failed, 0.0 if n == 2 else left, 1.0 - first if n == 2 else first),
    }


def loop_outcome(
    machine: Hoist, time: Array, signals: dict[str, Array], end: Array, metrics: dict[str, float]
) -> tuple[Outcome, str]:
    """How the run ended, judged at every sample of the controller; when, as far as signals were kept."""
    if not np.all(np.abs(end) < BOUNDLESS):
        bad = ~(np.abs(signals["speed_motor_rad_s"]) < BOUNDLESS) if signals else np.zeros(0, bool)
        return Outcome.DIVERGED, f"by {time[np.argmax(bad)]:.2f} s" if bad.any() else ""
    if metrics["rail_margin_m"] >= -RAIL_PLAY:
        return Outcome.COMPLETED, ""
    heights = signals.get("position_carriage_m", np.zeros(0))
    out = (heights < machine.rail.lowest_position_m - RAIL_PLAY) | (heights > machine.highest_position_m + RAIL_PLAY)
    if out.any():
        k = int(np.argmax(out))
        return Outcome.LEFT_THE_RAIL, f"at {time[k]:.2f} s, at height {heights[k]:.2f} m"
    return Outcome.LEFT_THE_RAIL, f"by {-metrics['rail_margin_m']:.2f} m"
