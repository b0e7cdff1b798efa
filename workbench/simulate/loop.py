"""Machines under their sampled loop, one case or many."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from workbench.control import Controller, Events, PiSettings, Settings, cascade, lag_step, loop_values
from workbench.control.events import BRAKE
from workbench.control.pi import NEVER, cascade_values, hoist_loop, losing_a_motor, weight_before
from workbench.core.run import Array, Run
from workbench.core.shown import Brief, Shown
from workbench.effects import of
from workbench.effects.active import Active, joined, longest_step_s
from workbench.engine import kernels
from workbench.engine.statics import hang_still, of_each
from workbench.machines import NO_EFFECTS, AnyKind, Drive, Effects, Hoist, Machine, Plant, kind_of, plant_of
from workbench.metrics import set_of
from workbench.metrics.axis import SETTLED
from workbench.references.library.wire import through_shaper

Values = Sequence[SimpleNamespace] | Array  # by symbol for each scenario, or their `PlantModel.table`


@dataclass(frozen=True, eq=False)
class PlantModel:
    """plant: without effects; active: the effects. Without effects the results are bit for bit the plant's own."""

    plant: Plant
    active: Active

    @property
    def effects(self) -> Effects:
        return self.active.effects

    @property
    def names(self) -> tuple[str, ...]:
        """The rows of the kernels' parameters."""
        return (*self.plant.parameters, *self.effects.parameters)

    def values(self, machine: Machine, payload_kg: float, start_time_s: float, run: str = "") -> SimpleNamespace:
        """One run's numbers by symbol: the plant's, the effects'. start_time_s: what the campaign's clock
        shows at the run's time 0; run: its name, for what is its own."""
        plain = self.plant.values(machine, payload_kg)
        return SimpleNamespace(**vars(plain), **self.active.values_of(start_time_s, run))

    def table(self, values: Values) -> Array:
        """(names, scenarios)"""
        if isinstance(values, np.ndarray):
            return values
        return np.array(list(map(attrgetter(*self.names), values)), dtype=float).T

    def starts(
        self, at: Sequence[float], speeds: Sequence[float], times: Sequence[float], values: Values
    ) -> tuple[Array, Array]:
        """(states, scenarios) of loads that hang at rest or move evenly, memory last; and the inputs that hold them.

        at: heights (or positions); speeds: of the driven coordinate; times: what the run's clock shows. values: by
        symbol for each scenario, or their `table`.
        """
        table = self.table(values)
        q, hold = hang_still(self.plant, self.effects, table, at, times)
        return np.concatenate([q, self._even(at, speeds, table, [m.start for m in self.effects.memory])]), hold

    def scales(self, speed: float, values: Values) -> Array:
        """(speeds and memory, scenarios): what the integration's tolerance is relative to; speed: the driven one's."""
        table = self.table(values)
        none = np.zeros(table.shape[1])
        return np.abs(self._even(none, none + speed, table, [m.scale for m in self.effects.memory]))

    def _even(
        self,
        at: Sequence[float] | Array,
        speeds: Sequence[float] | Array,
        table: Array,
        kept: Sequence[Callable[..., float]],
    ) -> Array:
        """(speeds and more, scenarios): the speeds of an even motion, and what functions of the parameters give."""
        plant, names = self.plant, self.names
        found = of_each(plant.start_of, names, table, at, speeds, traced=plant.guess is None)
        y = found[len(plant.positions) :][: len(plant.speeds)]
        return np.concatenate([y, *(of_each(one, names, table) for one in kept)])


def plant_model(machine: Machine, active: Active | None = None) -> PlantModel:
    """The machine's plant with its effects, or with `active` in place of them. InputError as `effects.of`."""
    return PlantModel(plant_of(machine), of(machine) if active is None else active)


NO_EVENTS = Events()
RAIL_PLAY = 0.01  # m, that a stop at the end of the rail may overshoot

BOUNDLESS = 1e9  # a state beyond it, in m, rad or per second, belongs to no machine


class Outcome(enum.Enum):
    """How a simulation ended, as a sentence for the user."""

    COMPLETED = "completed"
    DIVERGED = "the state grew without bound: the loop is unstable or the load ran away"
    LEFT_THE_RAIL = "the carriage left the rail"
    NOT_SOLVED = "the multi-body model was not solved"


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
    run together. The plant takes steps of at most `step_s` (s) between samples,
    shorter ones where the machine's friction or an effect's own state asks for them (`longest_step_s`).
    record_every = 0 keeps no signals. A reference shorter than the longest of its group
    is simulated further at its last value, and its run and metrics end where it ends.
    """
    results: dict[int, LoopResult] = {}
    groups: dict[tuple[Any, ...], list[int]] = {}
    for j, case in enumerate(cases):
        groups.setdefault((*_kernel_key(case), min(step_s, longest_step_s(case.machine))), []).append(j)
    for (*_, longest_s), members in groups.items():
        done = _simulate_alike([cases[j] for j in members], record_every, longest_s, threads)
        results.update(zip(members, done, strict=True))
    return [results[j] for j in range(len(cases))]


def _cascaded(case: LoopCase) -> bool:
    """Whether a position loop stands over the speed loop: an axis' cascade."""
    return kind_of(case.machine).looped.position_loop


def loop_controller(case: LoopCase) -> Controller:
    """An axis' cascade. Of a hoist the plain loop where nothing beside it is asked for, else the full one; of a motor
    that fails where one does."""
    if _cascaded(case):
        return cascade(kind_of(case.machine).looped, case.machine.drive.speed_delay_s > 0.0)
    loop = hoist_loop(cast(PiSettings, case.controller), case.machine.drive)
    return loop if case.events.motor_fails_s is None else losing_a_motor(loop)


def loop_numbers(case: LoopCase, hold: float, step_s: float) -> dict[str, float]:
    """Numbers of loop, drive, events and metrics by symbol; hold: the input that holds the load at the start."""
    lag = lag_step(case.machine.drive.torque_lag_s, step_s)
    of_drive = {"lag_left": lag.left, "lag_start": lag.start, "lag_slope": lag.slope_per_s, "lag_mean": lag.mean}
    if not _cascaded(case):
        settings = cast(PiSettings, case.controller)
        return {
            **loop_values(settings, case.machine.drive, hold, case.payload_kg),
            **case_limits(case),
            **case.events.values(),
            **of_drive,
        }
    machine, drive = case.machine, case.machine.drive
    return {
        **cascade_values(case.controller, drive, case.start_position_m),
        "hold": hold,
        "before": weight_before(drive.torque_lag_s, case.controller.sample_time_s),
        "settled": SETTLED * float(np.ptp(_position_reference(case))),
        "v_scale": kind_of(machine).looped.speed_scale(machine),
        "u_nominal": NEVER if drive.nominal is None else drive.nominal,
        **of_drive,
    }


def _position_reference(case: LoopCase) -> Array:
    """(n,): as the case has it or, for a speed loop alone, its speed summed up from the start."""
    if case.position_reference is not None:
        return np.asarray(case.position_reference, dtype=float)
    speed = np.asarray(case.speed_reference_rad_s, dtype=float)
    steps = 0.5 * (speed[1:] + speed[:-1]) * case.controller.sample_time_s
    return np.asarray(case.start_position_m + np.concatenate([[0.0], np.cumsum(steps)]))


def _references(cases: Sequence[LoopCase]) -> list[Array]:
    """One (references, n) array a case; cases that share a reference share the array."""
    known: dict[tuple[Any, ...], Array] = {}
    arrays = []
    for case in cases:
        # An axis' speed is summed up from where it starts.
        start = case.start_position_m if _cascaded(case) and case.position_reference is None else 0.0
        shaper = case.controller.input_shaper
        key = id(case.speed_reference_rad_s), id(case.position_reference), start, shaper
        if key not in known:
            speed = np.asarray(case.speed_reference_rad_s, dtype=float)
            rows = np.stack([_position_reference(case), speed] if _cascaded(case) else [speed])
            known[key] = through_shaper(shaper, rows, case.controller.sample_time_s)
            if not np.all(np.isfinite(known[key])):  # a limit would make a torque of it, and nobody would know
                raise ValueError(f"case {case.name}: the speed reference is not finite throughout")
        arrays.append(known[key])
    return arrays


def _kernel_key(case: LoopCase) -> tuple[Any, ...]:
    """The properties that all cases of one kernel call share, such as the length of the run."""
    effects = joined(of(case.machine).effects, BRAKE if case.events.brakes else NO_EFFECTS)
    lagged, n = case.machine.drive.torque_lag_s > 0.0, len(case.speed_reference_rad_s)
    return kind_of(case.machine).name, case.controller.sample_time_s, loop_controller(case), lagged, effects, n


def _simulate_alike(cases: list[LoopCase], record_every: int, step_s: float, threads: int | None) -> list[LoopResult]:
    _, sample_time, controller, lagged, effects, n = _kernel_key(cases[0])
    kind = kind_of(cases[0].machine)
    plant, watcher = kind.plant, set_of(kind.name).observer
    recorded = kind.looped.recorded if record_every else ()
    substeps = max(1, math.ceil(sample_time / step_s - 1e-9))
    at_work = [PlantModel(plant, of(case.machine)) for case in cases]
    plain = [w.values(c.machine, c.payload_kg, c.start_time_s) for w, c in zip(at_work, cases, strict=True)]
    start, holds = at_work[0].starts(
        [case.start_position_m for case in cases], [0.0] * len(cases), [0.0] * len(cases), plain
    )
    values, memory = [], []
    for case, p, angle, hold in zip(cases, plain, start[0], holds, strict=True):
        numbers = SimpleNamespace(**{**vars(p), **loop_numbers(case, hold, sample_time / substeps)})
        values.append(numbers)
        memory.append(controller.start(numbers, hold, angle))
    names = kernels.loop_parameters(plant, effects, controller, watcher)
    every = record_every or n + 1
    out, accumulators, ends = kernels.loop(
        plant,
        controller,
        watcher,
        recorded,
        np.array([[getattr(v, name) for v in values] for name in names]),
        _references(cases),
        sample_time,
        start,
        np.array(memory).T,
        every=every,
        substeps=substeps,
        actual=holds if lagged else None,
        effects=effects,
        threads=threads,
    )
    time = np.arange(out.shape[0]) * (sample_time * every) if record_every else np.zeros(0)
    results = []
    for j, case in enumerate(cases):
        signals = dict(zip(recorded, out[:, :, j].T.copy(), strict=True))
        metrics = watcher.finish(accumulators[:, j], values[j], n * sample_time)
        results.append(loop_result(case, time, signals, metrics, ends[:, j], holds[j]))
    return results


def loop_result(
    case: LoopCase, time: Array, signals: dict[str, Array], metrics: dict[str, float], end: Array, hold: float
) -> LoopResult:
    """What came of a run; signals: as far as they were kept. end: the states at its end, positions first."""
    plant = kind_of(case.machine).plant
    if signals:
        signals = {**signals, **_motor_torques(case, time, signals[plant.input])}
    run = Run(case.name, time, signals, case.payload_kg, case.start_position_m, case.start_time_s)
    outcome, at = _outcome(case.machine, time, signals, end, metrics)
    return LoopResult(case, run, metrics, outcome, at, float(end[plant.placed]), hold)


def _motor_torques(case: LoopCase, time: Array, torque: Array) -> dict[str, Array]:
    """The torque of the first and of the second motor (of equal ones: of each); after a failure the first works on."""
    names = kind_of(case.machine).drive.parts
    if not names:
        return {}
    n = case.machine.motor.count
    first = case.machine.drive.torque_share if n == 2 else 1.0 / n
    fails = case.events.motor_fails_s
    failed = np.zeros(len(time), bool) if fails is None else time >= fails
    left = 1.0 / max(n - 1, 1)
    shares = (
        np.where(failed, left, first),
        np.where(failed, 0.0 if n == 2 else left, 1.0 - first if n == 2 else first),
    )
    return {name: torque * share for name, share in zip(names, shares, strict=True)}


def _outcome(
    machine: Any, time: Array, signals: dict[str, Array], end: Array, metrics: dict[str, float]
) -> tuple[Outcome, str]:
    """How the run ended, judged at every sample of the controller; when, as far as signals were kept."""
    if not np.all(np.abs(end) < BOUNDLESS):
        bad = ~(np.abs(signals.get(kind_of(machine).looped.speed, np.zeros(0))) < BOUNDLESS)
        return Outcome.DIVERGED, f"by {time[np.argmax(bad)]:.2f} s" if bad.any() else ""
    if metrics.get("rail_margin_m", 0.0) >= -RAIL_PLAY:
        return Outcome.COMPLETED, ""
    heights, (low, high) = signals.get("position_carriage_m", np.zeros(0)), kind_of(machine).looped.rail(machine)
    out = (heights < low - RAIL_PLAY) | (heights > high + RAIL_PLAY)
    if out.any():
        k = int(np.argmax(out))
        return Outcome.LEFT_THE_RAIL, f"at {time[k]:.2f} s, at height {heights[k]:.2f} m"
    return Outcome.LEFT_THE_RAIL, f"by {-metrics['rail_margin_m']:.2f} m"


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


def torque_limits(machine: Hoist) -> dict[str, float]:
    """By symbol: the torque of all motors (N m), after one failed, and the speed (rad/s) above which it falls."""
    one = machine.motor.nominal_torque_nm * machine.drive.overload
    return {
        "u_all": one / machine.torque_share,
        "u_one": one * (machine.motor.count - 1),
        "w_weak": machine.motor.nominal_speed_rad_s if machine.drive.field_weakening else NEVER,
    }


def case_limits(case: LoopCase) -> dict[str, float]:
    """Torque limits, shares and ends of the rail by symbol. The harder-worked motor limits them all."""
    machine = cast(Hoist, case.machine)
    fails = case.events.motor_fails_s
    return {
        **torque_limits(machine),
        "t_fail": NEVER if fails is None else fails,
        "T_nominal": machine.motor.nominal_torque_nm,
        "share": machine.torque_share,
        "share_failed": 1.0 / max(machine.motor.count - 1, 1),
        "kept": kept_by_others(machine),
        "before": weight_before(machine.drive.torque_lag_s, case.controller.sample_time_s),
        "w_nominal": machine.motor.nominal_speed_rad_s,
        **overload_numbers(machine.drive),
        "W_break": machine.wire.breaking_load_n or 0.0,
        "x_low": machine.rail.lowest_position_m,
        "x_high": machine.highest_position_m,
    }
