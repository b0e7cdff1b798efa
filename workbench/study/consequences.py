"""What a machine's unmodelled effects change in its control study.

The same moves, payloads and controller are run on four machines: as it was given, refitted without the effects,
corrected, and corrected with the effects taken out, all else equal. The effects' own consequence is the difference of
the last two.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.analysis.family import family, operating_points, weakest
from workbench.analysis.search import best_rejection, for_bandwidth, make_search
from workbench.analysis.tune import Goal
from workbench.analysis.usual import usual_controller, usual_settings
from workbench.control import Cascade, Settings
from workbench.core.errors import InputError
from workbench.core.json_records import plain
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.effects import effects_for, sizes_of
from workbench.machines import HOIST, LOOPED, AnyKind, Axis, Hoist, Kind, kind_of, looped, studied
from workbench.metrics import Metric, find, set_of
from workbench.references import LimitPair, Limits, Step, motion_time_s
from workbench.study.grid import RunSpec
from workbench.study.labels import NO_CHANGE, listed
from workbench.study.rows import Row
from workbench.study.run import run_specs

if TYPE_CHECKING:
    from workbench.study.load import Study
    from workbench.study.scenario import Scenario

REFERENCES = ("trapezoid", "ruckig")
MS_LIMIT = 1.4
PHASES = 4  # of a value that differs from run to run
SMALL = 100.0 * NO_CHANGE  # per cent
GAIN_MOVES = 3.0  # per cent of a gain: less is within what tuning by hand leaves
AT_LIMIT = 0.999  # of the limit
WINDOW_S = 0.25  # speeds and accelerations are means over it: a sample's noise is no motion
AXIS_REST_S = 1.0  # an axis settles soon
AXIS_WINDOW_S = 0.05  # the same of an axis, whose ramps are short
LEAST_SPEED = 0.01  # of nominal: slower runs say nothing of how the machine is moved
END_OF_RAIL = 0.02  # of the rail, left free at both ends: the carriage swings a little past its reference
LONGEST_S = 60.0  # one way
LEAD_S, DWELL_S, SETTLE_S = 1.0, 2.0, 2.0
CORRECTION = "measured_correction"
NOT_STUDIED = (
    f"What changes in the control study is not said for an {{}}: studies, loop and tune are for machines of {LOOPED}."
)


@dataclass(frozen=True)
class SmallStudy:
    """There and back again, every payload under every reference; or a user's scenario, which has its own moves.

    from_runs: limits and travel are a campaign's. Of a rotary axis positions and limits are in radians.
    """

    payloads_kg: tuple[float, ...]
    start_position_m: float
    travel_m: float
    limits: Limits
    controller: Settings
    from_runs: bool
    controller_given: bool
    kind: Kind = HOIST
    scenario: Scenario | None = None

    @property
    def heights_m(self) -> tuple[float, ...]:
        """The heights of the loop analysis: bottom, middle and top of the travel."""
        low, high = sorted((self.start_position_m, self.start_position_m + self.travel_m))
        return low, 0.5 * (low + high), high

    def specs(self, machine: Hoist | Axis) -> list[RunSpec]:
        """The runs on a machine, metrics only."""
        if self.scenario is not None:
            from workbench.study.load import changed, plan_study

            bare = changed(self.scenario, {"sweep": None, "sample": None, "outputs": {"signals": "none"}})
            return list(plan_study(bare, machine).specs)
        rest, settle = (DWELL_S, SETTLE_S) if self.kind.payload else (AXIS_REST_S, AXIS_REST_S)
        moves = (Step(by_m=self.travel_m), Step(dwell_s=rest), Step(by_m=-self.travel_m))
        pair = LimitPair.of(self.limits)
        length = motion_time_s(REFERENCES, moves, self.start_position_m, pair, self.kind.looped.rail(machine))
        return [
            RunSpec(
                run_id=f"{payload:g}kg_{reference}", scenario="consequences", machine=machine, payload_kg=payload,
                start_position_m=self.start_position_m, reference=reference, moves=moves, limits=pair, lead_s=LEAD_S,
                settle_s=settle, duration_s=LEAD_S + length + settle, controller=self.controller, record_every=0,
            )
            for payload in self.payloads_kg
            for reference in REFERENCES
        ]  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """An axis' keys have its units."""
        unit = self.kind.moved.unit
        placed = {
            f"start_position_{unit}": self.start_position_m,
            f"travel_{unit}": self.travel_m,
            f"speed_{unit}_s": self.limits.speed_m_s,
            f"acceleration_{unit}_s2": self.limits.acceleration_m_s2,
            f"jerk_{unit}_s3": self.limits.jerk_m_s3,
        }
        return ({"payloads_kg": list(self.payloads_kg)} if self.kind.payload else {}) | {
            "references": list(REFERENCES if self.scenario is None else self.scenario.kinds),
            **placed,
            "limits_from_runs": self.from_runs,
            "scenario": None if self.scenario is None else self.scenario.name,
            "controller": self.controller.model_dump(mode="json"),
            "controller_given": self.controller_given,
        }


def study_of(study: Study) -> SmallStudy:
    """A user's scenario as the study that the machines are run through, without its sweep and sample."""
    specs = study.specs[: len(study.scenario.kinds) * len(study.scenario.payloads_kg or (0,))]
    first = specs[0]
    plan = first.plan()
    ends = [plan.at(np.array([t]))[0][0] for window in plan.move_windows for t in window]
    far = max(ends, key=lambda place: abs(place - first.start_position_m))
    limits = first.limits.hoisting if first.limits is not None else Limits(1e-9, plan.acceleration_m_s2)
    return SmallStudy(
        payloads_kg=tuple(sorted({spec.payload_kg for spec in specs})),
        start_position_m=first.start_position_m,
        travel_m=float(far) - first.start_position_m,
        limits=limits,
        controller=first.controller,
        from_runs=False,
        controller_given=True,
        kind=kind_of(study.machine),
        scenario=study.scenario,
    )


@dataclass(frozen=True)
class Change:
    """One payload under one reference: as given, refitted without the effects, corrected without (before) and with
    (after) them, all else equal. refitted: None where there is no such machine."""

    payload_kg: float
    reference: str
    given: Row
    refitted: Row | None
    before: Row
    after: Row

    @property
    def ok(self) -> bool:
        return self.before.ok and self.after.ok

    def words(self, kind: Kind) -> str:
        """`4500 kg with ruckig`; of an axis its reference."""
        return f"{self.payload_kg:g} kg with {self.reference}" if kind.payload else self.reference

    def percent(self, metric: str) -> float:
        """By how much the effects change a metric; NaN where a run failed."""
        return percent(self.before[metric], self.after[metric])


@dataclass(frozen=True)
class LoopFigures:
    """The least margins of a machine's loops over payloads and heights; none means anything of an unstable one.

    payload_kg, height_m: of the loop with the largest Ms, or of the unstable one. gain_margin_db: inf where no gain
    above loses it. ms: largest |S|.
    """

    payload_kg: float
    height_m: float
    stable: bool
    gain_margin_db: float
    phase_margin_deg: float
    ms: float
    crossover_hz: float
    bandwidth_hz: float


@dataclass(frozen=True)
class Gains:
    """What loop shaping recommends for one machine; NaN where it finds nothing, and `reason` says why.

    names: of the two in a controller block, with their units.
    """

    kp: float
    ki: float
    names: tuple[str, str]
    reason: str = ""

    @property
    def ok(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Choice:
    """The better reference by a metric at a payload (None: the worst of all payloads), before and after.

    A name of a reference, "alike" where they differ by less than 0.5 %, "" where a run failed.
    """

    metric: str
    payload_kg: float | None
    before: str
    after: str

    @property
    def changed(self) -> bool:
        return bool(self.before and self.after) and self.before != self.after


@dataclass(frozen=True)
class Consequences:
    """What changes in the control study once the effects are known.

    effects: the new ones by name, `measured_correction` among them where there is a new table.
    gains_goal: (bandwidth in Hz, or None for best rejection of load steps; bound on Ms and Mt) that the
    recommended gains are for. old_gains_bandwidth_hz: what the gains for the machine without the effects give the one
    with them, NaN where that is unstable or there are none. sentences: what a reader should know, in order.
    """

    effects: tuple[str, ...]
    study: SmallStudy
    rows: tuple[Change, ...]
    loop_before: LoopFigures
    loop_after: LoopFigures
    gains_goal: tuple[float | None, float]
    gains_before: Gains
    gains_after: Gains
    old_gains_bandwidth_hz: float
    choices: tuple[Choice, ...]
    sentences: tuple[str, ...]

    @property
    def nominal(self) -> float | None:
        """One motor's nominal torque, as a run's two figures of its peak have it; None of an axis."""
        ok = (run for row in self.rows for run in (row.before, row.after) if run.ok)
        peaks = ((run["peak_torque_motor_nm"], run["peak_torque_percent"]) for run in ok if self.study.kind.payload)
        return next((100.0 * peak / percent for peak, percent in peaks if percent > 0.0), None)

    @property
    def better_reference_changes(self) -> bool:
        """By torque peak or tracking error, over all payloads or at one of them."""
        return any(choice.changed for choice in self.choices)


def percent(before: float, after: float) -> float:
    """Change in per cent; NaN where there is nothing to compare with."""
    return 100.0 * (after - before) / abs(before) if before else (0.0 if after == before else math.nan)


def metrics_for(kind: Kind) -> tuple[str, ...]:
    """What a run is told by."""
    if kind.payload:
        return (
            "peak_torque_motor_nm", "peak_torque_percent", "speed_error_max_rad_s", "speed_error_rms_rad_s",
            "min_wire_tension_n", "move_time_s",
        )  # fmt: skip
    judged = set_of(kind.name)
    return (
        judged.peak, judged.rms, judged.error, judged.rms_error, "settling_time_s", "energy_motoring_j", "move_time_s"
    )  # fmt: skip


def consequences_of(
    nominal: Hoist | Axis,
    corrected: Hoist | Axis,
    *,
    refitted: Hoist | Axis | None = None,
    runs: Sequence[Run] = (),
    payloads_kg: Sequence[float] | None = None,
    controller: Settings | None = None,
    goal: Goal | None = None,
    scenario: Study | None = None,
) -> tuple[Consequences | None, str]:
    """(what the corrected machine's effects change, "") or, of a kind that no study is for, (None, why not).

    nominal: the machine as given. refitted: its base parameters fitted without the effects, where that was done. The
    effects' own consequence is `corrected` against itself without the effects that `nominal` lacks; where it has
    none, against `nominal`. runs: the campaign's, for payloads, limits and travel; see `small_study`. scenario: a
    user's study, whose moves, limits, payloads and controller stand in their place. goal: what gains are recommended
    for; without it the bandwidth that the controller gives the machine without the effects, with Ms and Mt at most 1.4.
    A run that fails is a row with its reason. InputError for effects that are unknown and for a payload or
    a controller that cannot be.
    """
    given, now = looped(nominal), looped(corrected)
    if given is None or now is None:
        return None, NOT_STUDIED.format(kind_of(nominal).noun)
    study = study_of(scenario) if scenario else small_study(given, runs, payloads_kg=payloads_kg, controller=controller)
    effects = tuple(name for name, values in now.effects.items() if given.effects.get(name) != values)
    if now.measured_correction not in (None, given.measured_correction):
        effects = (*effects, CORRECTION)
    was = without(now, given, effects) if effects else given

    machines = {"given": given, "refitted": looped(refitted) if refitted else None, "before": was, "after": now}
    done: dict[str, Sequence[Row | None]] = {}
    for when, machine in machines.items():  # equal machines are run once
        same = next((other for other in done if machines[other] == machine), None)
        done[when] = done[same] if same else worst_runs(study, machine) if machine else [None] * len(done["given"])
    cases = [(spec.payload_kg, spec.reference) for spec in study.specs(given)]
    rows = tuple(Change(*case, *of) for case, *of in zip(cases, *done.values(), strict=True))

    loops = [_weakest_loop(machine, study) for machine in (was, now)]
    usable = loops[0].stable and math.isfinite(loops[0].bandwidth_hz)
    wanted = goal or Goal(float(f"{loops[0].bandwidth_hz:.2g}") if usable else None, MS_LIMIT)
    before, after, old = _gains(study, was, now, wanted)
    made = Consequences(
        effects, study, rows, loops[0], loops[1], (wanted.bandwidth_hz, wanted.ms_limit), before, after, old,
        _choices(rows, study.kind), (),
    )  # fmt: skip
    return replace(made, sentences=tuple(_sentences(made, now))), ""


def without(corrected: Hoist | Axis, nominal: Hoist | Axis, effects: Sequence[str]) -> Hoist | Axis:
    """The corrected machine with these effects as the nominal one has them, all else equal."""
    kept = {name: values for name, values in corrected.effects.items() if name not in effects}
    kept |= {name: nominal.effects[name] for name in effects if name in nominal.effects}
    table = nominal.measured_correction if CORRECTION in effects else corrected.measured_correction
    own = corrected.log.of_runs.items()  # what is each run's own goes with its effect
    gone = corrected.effects.keys() - kept.keys()
    of_runs = {run: {name: its for name, its in values.items() if name not in gone} for run, values in own}
    log = corrected.log.model_copy(update={"of_runs": of_runs})
    return corrected.model_copy(update={"effects": kept, "measured_correction": table, "log": log})


def worst_runs(study: SmallStudy, machine: Hoist | Axis) -> list[Row]:
    """The runs of a machine; if it has values that differ from run to run, such as a phase, the worst of several.

    A failed run has no figure but its move time.
    """
    # Machine by machine: as many runs at a time, so that one compiled kernel serves all.
    by_phase = [[row for row, _ in run_specs(study.specs(at_phase))] for at_phase in _at_phases(machine)]
    names, rows = metrics_for(study.kind), []
    for alike in zip(*by_phase, strict=True):
        row = next((row for row in alike if not row.ok), alike[0])
        worst = {name: find(name).worst([row[name] for row in alike]) if row.ok else None for name in names}
        rows.append(replace(row, metrics=worst | {"move_time_s": alike[0]["move_time_s"]}))
    return rows


def _per_run(machine: Hoist | Axis) -> list[str]:
    """The effects of the machine with a value that differs from run to run."""
    known = effects_for(kind_of(machine).name)
    return [name for name in machine.effects if any(parameter.per_run for parameter in known[name].parameters)]


def _at_phases(machine: Hoist | Axis) -> list[Hoist | Axis]:
    """The machine itself or, if an effect has a value for each run, four machines evenly over its range."""
    known, sizes, own = effects_for(kind_of(machine).name), sizes_of(machine), _per_run(machine)

    def at(share: float) -> Hoist | Axis:
        effects = {name: dict(values) for name, values in machine.effects.items()}
        for name in own:
            ranges = [p for p in known[name].ranges(sizes) if p.per_run]
            effects[name] |= {p.name: p.lowest + (p.highest - p.lowest) * share for p in ranges}
        return machine.model_copy(update={"effects": effects})

    return [at(k / PHASES) for k in range(PHASES)] if own else [machine]


def _weakest_loop(machine: Hoist | Axis, study: SmallStudy) -> LoopFigures:
    worst = weakest(family(machine, study.controller, operating_points(machine, study.payloads_kg, study.heights_m)))
    m, up = worst.margins, worst.margins.gain_up
    gain_db = 20.0 * math.log10(up) if math.isfinite(up) else math.inf
    return LoopFigures(worst.point.payload_kg, worst.point.height_m, m.stable, gain_db, m.phase_deg, m.ms,
                       m.crossover_hz, m.bandwidth_hz)  # fmt: skip


def _gains(study: SmallStudy, was: Hoist | Axis, now: Hoist | Axis, goal: Goal) -> tuple[Gains, Gains, float]:
    """Recommended for each machine, and the bandwidth (Hz) that the first ones give the second machine."""
    ends = tuple(dict.fromkeys((study.payloads_kg[0], study.payloads_kg[-1])))
    heights, names = (study.heights_m[0], study.heights_m[-1]), study.controller.GAINS
    found = []
    for machine in (was, now):
        search = make_search(machine, study.controller, operating_points(machine, ends, heights))
        try:
            if goal.bandwidth_hz is None:
                shaped = best_rejection(search, goal.ms_limit)
            else:
                shaped = for_bandwidth(search, goal.bandwidth_hz, goal.ms_limit)
            found.append(Gains(float(f"{shaped.kp:.4g}"), float(f"{shaped.ki:.4g}"), names))
        except InputError as error:
            found.append(Gains(math.nan, math.nan, names, error.problem))
    before, after = found
    if not before.ok:
        return before, after, math.nan
    judged = search.judge(np.array([before.kp]), np.array([before.ki]))
    return before, after, float(judged.bandwidth_hz[0]) if judged.stable[0] else math.nan


def _choices(rows: Sequence[Change], kind: Kind) -> tuple[Choice, ...]:
    """By each judged metric: over all payloads, then at each one; of a study with two references."""
    references, judged = list(dict.fromkeys(row.reference for row in rows)), set_of(kind.name)
    if len(references) < 2:
        return ()

    def better(metric: str, payload_kg: float | None, when: str) -> str:
        """The reference whose worst run is the better one."""
        here = [(row.reference, getattr(row, when)) for row in rows if payload_kg in (None, row.payload_kg)]
        if not all(run.ok for _, run in here):
            return ""
        worst = {kind: max(run[metric] for reference, run in here if reference == kind) for kind in references}
        first, second = sorted(worst.values())[:2]
        return "alike" if percent(first, second) < SMALL else min(references, key=lambda kind: worst[kind])

    return tuple(
        Choice(metric, payload, better(metric, payload, "before"), better(metric, payload, "after"))
        for metric in (judged.peak, judged.error, judged.rms_error)
        for payload in (None, *dict.fromkeys(row.payload_kg for row in rows))
    )


def small_study(
    machine: AnyKind,
    runs: Sequence[Run] = (),
    *,
    payloads_kg: Sequence[float] | None = None,
    controller: Settings | None = None,
) -> SmallStudy:
    """From a campaign's runs: payloads (lightest, middle, heaviest), fastest speed and acceleration, travel.

    Speed and acceleration are the largest means over a quarter of a second (of an axis 50 ms); the jerk limit builds
    the acceleration up in two thirds of a ramp. Without runs that move: nine tenths of nominal speed and ramps of 1.2 s
    (0.2 s), five seconds' way from the lower part of the rail (three ramps' way from 0), payloads of none, half and one
    carriage mass. An axis' ramps keep to half of its force limit beside friction and load. The controller is the rule's
    where none is given.
    """
    kind, hoist = kind_of(machine), studied(machine) is not None
    loop, axis = kind.looped, kind.looped.position_loop
    top = loop.top_speed(machine).speed
    motions = [motion for run in runs if (motion := _motion(machine, run)) is not None]
    motions = [motion for motion in motions if motion[0] > (0.0 if axis else LEAST_SPEED * top)]
    shortest, usual = (0.02, 0.2) if axis else (0.2, 1.2)  # s of a ramp
    if motions:
        fastest, steepest, lowest, highest = zip(*motions, strict=True)
        speed = min(max(fastest), 0.99 * top)
        acceleration = min(max(steepest), speed / shortest)
        start, end = min(lowest), max(highest)
    else:
        speed = 0.9 * (min(top, loop.speed_scale(machine)) if axis else top)
        acceleration = speed / usual
        start, end = 0.0, 0.6 * speed
    if hoist:
        low, high = machine.rail.lowest_position_m, machine.highest_position_m
        bottom, ceiling = low + END_OF_RAIL * (high - low), high - END_OF_RAIL * (high - low)
        if motions:
            start, end = max(start, bottom), min(end, ceiling)
        else:
            start = low + 0.25 * (high - low)
            end = start + min(0.5 * (high - low), 5.0 * speed)
        if end - start < 0.02 * (ceiling - bottom):  # as far as nothing, or a height that is not this rail's
            start, end = bottom, 0.5 * (bottom + ceiling)
        known = sorted({run.payload_kg for run in runs}) or [x * machine.carriage.mass_kg for x in (0.0, 0.5, 1.0)]
        middle = min(known, key=lambda load: abs(load - 0.5 * (known[0] + known[-1])))
        loads, by_rule = tuple(sorted({known[0], middle, known[-1]})), usual_controller(machine)
    else:
        steady = max(machine.role("coulomb_forward"), machine.role("coulomb_backward"))
        steady += machine.role("viscous") * speed
        steady += abs(machine.role("gravity_constant")) + abs(machine.role("gravity_sine"))
        room = 0.5 * (loop.input_limit(machine) - steady)
        if 0.0 < room < math.inf:
            acceleration = min(acceleration, room / loop.total_inertia(machine, 0.0))
        loads, by_rule = (0.0,), usual_settings(machine)[0]
    speed, acceleration = _digits(speed), _digits(acceleration)
    return SmallStudy(
        payloads_kg=loads if payloads_kg is None or axis else tuple(sorted(set(payloads_kg))),
        start_position_m=_digits(start),
        travel_m=_digits(min(max(end - start, 1e-6), LONGEST_S * speed)),
        limits=Limits(speed, acceleration, _digits(1.5 * acceleration**2 / speed)),
        controller=by_rule if controller is None else controller,
        from_runs=bool(motions),
        controller_given=controller is not None,
        kind=kind,
    )


def _motion(machine: AnyKind, run: Run) -> tuple[float, float, float, float] | None:
    """(fastest speed, largest acceleration, lowest and highest place) of a run, m or rad and seconds; the first two as
    means over a window. None of a run that is too short or has no speed."""
    hoist = studied(machine) is not None
    if hoist:
        speed, place, per, window = "speed_motor_rad_s", "position_carriage_m", machine.lift_m_per_rad, WINDOW_S
    else:
        speed, place, per, window = machine.speed_signal, machine.position_signal, 1.0, AXIS_WINDOW_S
    t, window = run.time_s, max(window, 4.0 * run.sample_time_s)
    logged = not hoist and place in run
    if len(t) < 3 or run.duration_s < 3.0 * window or not (logged or speed in run):
        return None
    if logged:
        way = run[place]
    else:
        v = run[speed] * per
        way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    here = run.signals.get(place, run.start_position_m + way) if hoist else way
    at = np.arange(t[0], t[-1] - 2.0 * window, 0.2 * window)
    marks = [np.interp(at + k * window, t, way) for k in range(3)]
    speeds = np.diff(marks, axis=0) / window
    steepest = np.abs(speeds[1] - speeds[0]).max() / window
    return float(np.abs(speeds).max()), float(steepest), float(np.min(here)), float(np.max(here))


def _digits(value: float) -> float:
    """Rounded to three digits, so that the value in the text is the value of the run."""
    return float(f"{value:.3g}")


def _sentences(c: Consequences, corrected: Hoist | Axis) -> Iterator[str]:
    """In order: what was run, failures, torque, tracking, wire, time, better reference, loop, gains, caveats."""
    kind, judged = c.study.kind, set_of(c.study.kind.name)
    yield _what(c)
    yield from _failures(c.rows, kind)
    most, good = AT_LIMIT * kind.looped.peak_limit(corrected), [row for row in c.rows if row.ok]
    if new := [row for row in good if row.after[judged.peak] >= most > row.before[judged.peak]]:
        who = "motors now reach their torque" if kind.payload else f"drive now reaches its {kind.drive.quantity}"
        yield f"The {who} limit at {listed([row.words(kind) for row in new])}."
    if good:
        yield from (_figure(good, metric, kind) for metric in figures_told(kind))
    by = {(row.payload_kg, row.reference): row.before["move_time_s"] for row in c.rows}
    longer = by.get((c.rows[0].payload_kg, "ruckig"), math.nan) - by.get((c.rows[0].payload_kg, "trapezoid"), math.nan)
    if math.isfinite(longer):
        yield (
            f"Move times do not change, for they follow from the limits: ruckig takes {longer:.2g} s longer than the "
            "trapezoid."
        )
    if c.choices:
        yield _better(c.choices, judged.peak, f"{judged.input_words} peak at equal limits", kind)
        yield _better(c.choices, judged.error, "tracking error", kind)
    yield _loop(c)
    yield _gain_words(c)
    known = effects_for(kind.name)
    if own := _per_run(corrected):
        yield (
            f"In each run {listed(own)} has a phase of its own: every run was made at {PHASES} phases, and each figure "
            "is the worst of them."
        )
    if cold := [name for name in corrected.effects if known[name].regime == "time" and name not in own]:
        yield f"Time counts from the start of the campaign, so {listed(cold)} is as on the cold machine."
    if outside := [name for name in corrected.effects if known[name].on_sensor]:
        yield f"On the log alone, so that neither runs nor loop know of it: {listed(outside)}."
    drive = corrected.drive
    if not (drive.torque_lag_s or drive.speed_filter_s or drive.speed_delay_s):
        yield "The machine's drive has no lag, filter or delay, so its margins are those of sampling alone."


def _what(consequences: Consequences) -> str:
    s, effects = consequences.study, consequences.effects
    who = f"without and with {listed(effects)}, all else equal" if effects else "before and after its correction"
    c, unit = s.controller, s.kind.moved.unit
    loads = f" {listed([f'{load:g}' for load in s.payloads_kg])} kg;" if s.kind.payload else ""
    kv = f"kv {c.kv_per_s:g} 1/s, " if isinstance(c, Cascade) else ""
    by_rule = "" if s.controller_given else ", by rule"
    gains = f"one controller ({kv}kp {c.kp:g} {c.UNITS[0]}, ki {c.ki:g} {c.UNITS[1]}{by_rule})"
    if s.scenario is not None:
        return f"The machine {who}, in the scenario {s.scenario.name}:{loads} {gains}."
    source = "as the campaign's runs do at most" if s.from_runs else "by default"
    way, back = ("up", "down") if s.kind.payload else ("forward", "back")
    return (
        f"The machine {who}: {way} by {s.travel_m:g} {unit} from {s.start_position_m:g} {unit} and {back} again, "
        f"{s.limits.speed_m_s:g} {unit}/s and {s.limits.acceleration_m_s2:g} {unit}/s² {source}, jerk "
        f"{s.limits.jerk_m_s3:g} {unit}/s³;{loads} {gains}."
    )


def _failures(rows: Sequence[Change], kind: Kind) -> Iterator[str]:
    groups: dict[tuple[float, bool, bool, str], list[str]] = {}
    for row in rows:
        if not row.ok:
            # Where the motors cannot hold the load, how far it fell says nothing.
            reason = (row.after.reason or row.before.reason).rpartition("; ")[2]
            groups.setdefault((row.payload_kg, row.before.ok, row.after.ok, reason), []).append(row.reference)
    for (payload, was_ok, is_ok, reason), alike in groups.items():
        which = "with either reference" if len(alike) == 2 else f"with the {alike[0]} reference"
        start = f"At {payload:g} kg {which}" if kind.payload else f"{which[0].upper()}{which[1:]}"
        now = f"{'neither before nor after' if not is_ok else 'now; before'}: {reason}"
        yield f"{start} the move is no longer possible: {reason}." if was_ok else f"{start} the move is possible {now}."


def figures_told(kind: Kind) -> tuple[Metric, ...]:
    """The metrics that sentences tell."""
    judged = set_of(kind.name)
    names = (judged.error, "min_wire_tension_n") if kind.payload else (judged.rms, judged.error, "settling_time_s")
    return tuple(judged.by_name[name] for name in (judged.peak, *names))


def _figure(good: Sequence[Change], metric: Metric, kind: Kind) -> str:
    name = metric.name
    if name == "min_wire_tension_n" and (slack := [row for row in good if row.after[name] <= 0.0]):
        was = ", as before" if all(row.before[name] <= 0.0 for row in slack) else ""
        return f"The wire goes slack at {listed([row.words(kind) for row in slack])}{was}."
    changes = [row.percent(name) for row in good]
    if max(map(abs, changes)) < SMALL:
        return f"The {metric.label} does not change."
    most = max(good, key=lambda row: abs(row.percent(name)))
    before, after = (metric.scale * run[name] for run in (most.before, most.after))
    low, high = f"{min(changes):+.1f}", f"{max(changes):+.1f}"
    span = f"{high} %" if low == high else f"{low} to {high} %"
    where = f"most {'at' if kind.payload else 'with'} {most.words(kind)}"
    return f"The {metric.label} changes by {span}, {where}: {before:.3g} to {after:.3g} {metric.shown_unit}."


def _better(choices: Sequence[Choice], metric: str, by: str, kind: Kind) -> str:
    mine = [choice for choice in choices if choice.metric == metric and choice.payload_kg is not None]
    known = [choice for choice in mine if choice.before and choice.after]

    def name(reference: str) -> str:
        return "neither" if reference == "alike" else reference

    def at(choice: Choice) -> str:
        return f" at {choice.payload_kg:g} kg" if kind.payload else ""

    if moved := [choice for choice in known if choice.changed]:
        cases = [f"{at(c)} {name(c.after)} instead of {name(c.before)}".strip() for c in moved]
        return f"By {by} the better reference is another one now: {listed(cases)}."
    if not known:
        return f"By {by} the references cannot be compared, for runs failed."
    names = list(dict.fromkeys(choice.after for choice in known))
    if len(names) > 1:
        return f"By {by} the better reference stays the same: {listed([f'{name(c.after)}{at(c)}' for c in known])}."
    if names == ["alike"]:
        return f"By {by} both references stay alike."
    where = at(known[0]) if len(known) == 1 else " at every payload"
    some = " that both move" if 1 < len(known) < len(mine) else ""
    return f"By {by} {names[0]} stays the better reference{where}{some}."


def _loop(c: Consequences) -> str:
    a, b, kind = c.loop_before, c.loop_after, c.study.kind
    name = "speed loop" if kind.payload else "loop"
    if not b.stable:
        load = f"{b.payload_kg:g} kg and " if kind.payload else ""
        return f"The {name} is unstable at {load}{b.height_m:g} {kind.moved.unit}{'' if a.stable else ', as before'}."
    if not a.stable:
        where = f"{a.payload_kg:g} kg" if kind.payload else "some places"
        return f"The {name}, unstable before at {where}, is stable: Ms {b.ms:.2f}."
    moved, still = [], []
    for what, least, form, x, y in (
        ("the least gain margin", 0.5, "{:.1f} dB", a.gain_margin_db, b.gain_margin_db),
        ("the least phase margin", 1.0, "{:.0f}°", a.phase_margin_deg, b.phase_margin_deg),
        ("the largest Ms", 0.01, "{:.2f}", a.ms, b.ms),
    ):
        was, now = (form.format(value) if math.isfinite(value) else "without bound" for value in (x, y))
        if x == y or abs(y - x) < least:
            still.append(f"{what} is {now}")
        else:
            moved.append(f"{what} goes from {was} to {now}")
    if not moved:
        return f"The loop's margins do not change: {listed(still)}."
    over = "Over loads and heights" if kind.payload else "Over its positions"
    return f"{over}, {listed(moved)}{f'; {listed(still)} as before' if still else ''}."


def _gain_words(c: Consequences) -> str:
    (bandwidth, ms), before, after = c.gains_goal, c.gains_before, c.gains_after
    goal = "the best rejection of load steps" if bandwidth is None else f"a bandwidth of {bandwidth:g} Hz"
    start = f"For {goal} with Ms {'' if bandwidth is None else 'and Mt '}at most {ms:g}"
    if not after.ok:
        return f"{start} loop shaping finds no gains{'' if before.ok else ', nor before'}: {after.reason}."
    units = c.study.controller.UNITS
    now = f"kp {after.kp:.3g} {units[0]}, ki {after.ki:.3g} {units[1]}"
    if not before.ok:
        return f"{start} loop shaping now finds {now}; before: {before.reason}."
    kp, ki = percent(before.kp, after.kp), percent(before.ki, after.ki)
    if max(abs(kp), abs(ki)) < GAIN_MOVES:
        return f"{start} the recommended gains stay: {now}."
    old = c.old_gains_bandwidth_hz
    left = "make the loop unstable" if math.isnan(old) else f"give {old:.3g} Hz"
    return (
        f"{start} the recommended gains are others now: {now} instead of kp {before.kp:.3g}, ki {before.ki:.3g} "
        f"({kp:+.0f} %, {ki:+.0f} %); the old ones {left}."
    )


def consequences_table(c: Consequences) -> Table:
    """One row for each payload and reference: the machine as given, refitted, corrected, and the effects' own share."""
    kind, told = c.study.kind, figures_told(c.study.kind)[:3]
    machines = ["given", *(["refitted"] if any(row.refitted is not None for row in c.rows) else []), "corrected"]
    columns = [*([Column("payload", "kg")] if kind.payload else []), words("reference")]
    for metric in told:
        head = (metric.head or metric.label).replace("\n", " ")
        columns += [Column(f"{head}\n{machine}", metric.shown_unit) for machine in machines]
        columns.append(Column(f"{head}\neffects", "%"))
    lines = []
    for row in c.rows:
        line = [*([f"{row.payload_kg:g}"] if kind.payload else []), row.reference]
        for metric in told:
            runs = [row.given, *([row.refitted] if "refitted" in machines else []), row.after]
            line += [metric.text(run[metric.name]) if run is not None else "–" for run in runs]
            change = row.percent(metric.name)
            line.append(f"{change:+.1f}" if math.isfinite(change) else "–")
        lines.append([*line, f"{row.after['move_time_s']:.2f}"])
    note = (
        "Given: the machine as its file has it; refitted: its own values fitted without the effects; corrected: with "
        "them. Effects: corrected against the same machine without the effects, all else equal. A dash: the run failed."
    )
    return Table([*columns, Column("moves", "s")], lines, note)


def as_json(c: Consequences) -> dict[str, Any]:
    """Plain mappings and lists, six significant digits; null for what is no finite number."""
    kind = c.study.kind

    def placed(record: object, **more: Any) -> dict[str, Any]:
        """Without the payload where the kind carries none, the height as its place."""
        said = vars(record) | more
        if not kind.payload:
            del said["payload_kg"]
            if "height_m" in said:
                said[f"position_{kind.moved.unit}"] = said.pop("height_m")
        return said

    def run(row: Row | None) -> dict[str, Any] | None:
        return None if row is None else {"reason": row.reason, **{name: row.get(name) for name in metrics_for(kind)}}

    def gains(own: Gains) -> dict[str, Any]:
        return {own.names[0]: own.kp, own.names[1]: own.ki, "reason": own.reason}

    rows = [
        placed(row, **{when: run(getattr(row, when)) for when in ("given", "refitted", "before", "after")})
        | {"change_percent": {name: row.percent(name) for name in metrics_for(kind)}}
        for row in c.rows
    ]
    said: dict[str, Any] = plain(
        {
            "effects": c.effects,
            "study": c.study.as_json(),
            "rows": rows,
            "loop": {"before": placed(c.loop_before), "after": placed(c.loop_after)},
            "gains": {
                "goal": {"bandwidth_hz": c.gains_goal[0], "ms": c.gains_goal[1]},
                "before": gains(c.gains_before),
                "after": gains(c.gains_after),
                "old_gains_bandwidth_hz": c.old_gains_bandwidth_hz,
            },
            "better_reference": [placed(choice, changed=choice.changed) for choice in c.choices],
            "sentences": c.sentences,
        }
    )
    return said
