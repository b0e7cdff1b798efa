"""What a machine's unmodelled effects change in its control study.

The same moves, payloads and controller are run on four machines: as it was given, refitted without the effects,
corrected, and corrected with the effects taken out, all else equal. The effects' own consequence is the difference of
the last two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.analysis.margins import family, operating_points, weakest
from workbench.analysis.search import best_rejection, for_bandwidth, make_search
from workbench.analysis.tune import Goal
from workbench.analysis.usual import usual_settings
from workbench.control import Settings
from workbench.core.errors import InputError
from workbench.core.json_records import plain
from workbench.core.names import listed
from workbench.core.numbers import figures, signed
from workbench.core.run import Run, integrated
from workbench.core.table import Column, Table, words
from workbench.core.templates import Sentences
from workbench.core.yaml_strict import checked
from workbench.effects import Ranged, effects_for, ranges_of
from workbench.machines import LOOPED, AnyKind, Kind, Machine, kind_of, looped, studied
from workbench.metrics import Metric, find, set_of
from workbench.references import Limits
from workbench.study.grid import RunSpec
from workbench.study.labels import NO_CHANGE
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row
from workbench.study.run import run_specs
from workbench.study.scenario import Scenario, key_in

REFERENCES = ("trapezoid", "ruckig")
MACHINES = ("given", "refitted", "before", "after")
MS_LIMIT = 1.4
PHASES = 4  # of a value that differs from run to run
SMALL = 100.0 * NO_CHANGE  # per cent
GAIN_MOVES = 3.0  # per cent of a gain: less is within what tuning by hand leaves
AT_LIMIT = 0.999  # of the limit
LEAST_SPEED = 0.01  # of nominal: slower runs say nothing of how the machine is moved
END_OF_RAIL = 0.02  # of the rail, left free at both ends: the carriage swings a little past its reference
LONGEST_S = 60.0  # one way
CORRECTION = "measured_correction"
said = Sentences("study/consequences_words.j2", listed=listed, figures=figures, phases=PHASES)
NOT_STUDIED = (
    f"What changes in the control study is not said for an {{}}: studies, loop and tune are for machines of {LOOPED}."
)


@dataclass(frozen=True)
class SmallStudy:
    """The study that the machines are run through: a user's scenario, or there and back again, every payload under
    every reference. from_runs: limits and travel are a campaign's. Of a rotary axis places are in radians."""

    scenario: Scenario
    kind: Kind
    start_position_m: float
    travel_m: float
    limits: Limits
    payloads_kg: tuple[float, ...]
    from_runs: bool = False
    controller_given: bool = True
    own: bool = True  # the user's

    @property
    def controller(self) -> Settings:
        return self.scenario.controller

    @property
    def heights_m(self) -> tuple[float, ...]:
        """The heights of the loop analysis: bottom, middle and top of the travel."""
        low, high = sorted((self.start_position_m, self.start_position_m + self.travel_m))
        return low, 0.5 * (low + high), high

    def specs(self, machine: Machine) -> list[RunSpec]:
        """The runs on a machine, metrics only."""
        return list(plan_study(self.scenario, machine).specs)

    def as_json(self) -> dict[str, Any]:
        """An axis' keys have its units."""
        unit = self.kind.moved.unit
        return ({"payloads_kg": list(self.payloads_kg)} if self.kind.payload else {}) | {
            "references": list(self.scenario.kinds),
            f"start_position_{unit}": self.start_position_m,
            f"travel_{unit}": self.travel_m,
            **{key_in(unit, name): value for name, value in vars(self.limits).items()},
            "limits_from_runs": self.from_runs,
            "scenario": self.scenario.name if self.own else None,
            "controller": self.controller.model_dump(mode="json"),
            "controller_given": self.controller_given,
        }


def study_of(study: Study) -> SmallStudy:
    """A user's scenario as the study that the machines are run through, without its sweep and sample."""
    specs = study.specs[: len(study.scenario.kinds) * len(study.scenario.payloads_kg or (0,))]
    first, plan = specs[0], specs[0].plan()
    ways = [plan.at(np.array([t]))[0][0] - first.start_position_m for window in plan.move_windows for t in window]
    return SmallStudy(
        changed(study.scenario, {"sweep": None, "sample": None, "outputs": {"signals": "none"}}),
        kind_of(study.machine),
        first.start_position_m,
        float(max(ways, key=abs)),
        first.limits.hoisting if first.limits is not None else Limits(1e-9, plan.acceleration_m_s2),
        tuple(sorted({spec.payload_kg for spec in specs})),
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

    effects: the new ones by name, `measured_correction` among them where there is a new table. nominal: one motor's
    nominal torque, None of an axis. gains_goal: (bandwidth in Hz, or None for best rejection of load steps; bound on Ms
    and Mt) that the recommended gains are for. old_gains_bandwidth_hz: what the gains for the machine without the
    effects give the one with them, NaN where that is unstable or there are none. sentences: what a reader should know,
    in order.
    """

    effects: tuple[str, ...]
    study: SmallStudy
    nominal: float | None
    rows: tuple[Change, ...]
    loop_before: LoopFigures
    loop_after: LoopFigures
    gains_goal: tuple[float | None, float]
    gains_before: Gains
    gains_after: Gains
    old_gains_bandwidth_hz: float
    choices: tuple[Choice, ...]
    sentences: tuple[str, ...] = ()


def percent(before: float, after: float) -> float:
    """Change in per cent; NaN where there is nothing to compare with."""
    return 100.0 * (after - before) / abs(before) if before else (0.0 if after == before else math.nan)


def metrics_for(kind: Kind) -> tuple[str, ...]:
    """What a run is told by."""
    judged = set_of(kind.name)
    if kind.payload:
        return judged.peak, "peak_torque_percent", judged.error, judged.rms_error, "min_wire_tension_n", "move_time_s"
    energy = ("settling_time_s", "energy_motoring_j", "move_time_s")
    return judged.peak, judged.rms, judged.error, judged.rms_error, *energy


def consequences_of(
    nominal: Machine,
    corrected: Machine,
    *,
    refitted: Machine | None = None,
    runs: Sequence[Run] = (),
    payloads_kg: Sequence[float] | None = None,
    controller: Settings | None = None,
    scenario: Study | None = None,
) -> tuple[Consequences | None, str]:
    """(what the corrected machine's effects change, "") or, of a kind that no study is for, (None, why not).

    nominal: the machine as given. refitted: its base parameters fitted without the effects, where that was done. The
    effects' own consequence is `corrected` against itself without the effects that `nominal` lacks; where it has
    none, against `nominal`. runs: the campaign's, for payloads, limits and travel; see `small_study`. scenario: a
    user's study, whose moves, limits, payloads and controller stand in their place. Gains are recommended for the
    bandwidth that the controller gives the machine without the effects, with Ms and Mt at most 1.4. A run that fails is
    a row with its reason. InputError for effects that are unknown and for a payload or a controller that cannot be.
    """
    given, now = looped(nominal), looped(corrected)
    if given is None or now is None:
        return None, NOT_STUDIED.format(kind_of(nominal).noun)
    study = study_of(scenario) if scenario else small_study(given, runs, payloads_kg=payloads_kg, controller=controller)
    effects = tuple(name for name, values in now.effects.items() if given.effects.get(name) != values)
    if now.measured_correction not in (None, given.measured_correction):
        effects = (*effects, CORRECTION)
    was = without(now, given, effects) if effects else given
    done: list[tuple[Machine, list[Row]]] = []
    columns: list[Sequence[Row | None]] = []
    for machine in (given, looped(refitted) if refitted else None, was, now):  # equal machines are run once
        rows = next((rows for other, rows in done if other == machine), None)
        if rows is None and machine is not None:
            rows = worst_runs(study, machine, runs)
            done.append((machine, rows))
        columns.append(rows or [None] * len(done[0][1]))
    cases = [(spec.payload_kg, spec.reference) for spec in study.specs(given)]
    changes = tuple(Change(*case, *of) for case, *of in zip(cases, *columns, strict=True))
    loops = [_weakest_loop(machine, study) for machine in (was, now)]
    usable = loops[0].stable and math.isfinite(loops[0].bandwidth_hz)
    wanted = Goal(float(f"{loops[0].bandwidth_hz:.2g}") if usable else None, MS_LIMIT)
    rated = studied(now)
    made = Consequences(
        effects, study, rated.motor.nominal_torque_nm if rated else None, changes, loops[0], loops[1],
        (wanted.bandwidth_hz, wanted.ms_limit), *_gains(study, was, now, wanted), _choices(changes, study.kind),
    )  # fmt: skip
    return replace(made, sentences=tuple(_sentences(made, now, runs))), ""


def without(corrected: Machine, nominal: Machine, effects: Sequence[str]) -> Machine:
    """The corrected machine with these effects as the nominal one has them, all else equal."""
    kept = {name: values for name, values in corrected.effects.items() if name not in effects}
    kept |= {name: nominal.effects[name] for name in effects if name in nominal.effects}
    table = nominal.measured_correction if CORRECTION in effects else corrected.measured_correction
    own = corrected.log.of_runs.items()  # what is each run's own goes with its effect
    gone = corrected.effects.keys() - kept.keys()
    of_runs = {run: {name: its for name, its in values.items() if name not in gone} for run, values in own}
    log = corrected.log.model_copy(update={"of_runs": of_runs})
    return corrected.model_copy(update={"effects": kept, "measured_correction": table, "log": log})


def worst_runs(study: SmallStudy, machine: Machine, runs: Sequence[Run] = ()) -> list[Row]:
    """The runs of a machine; if it has values that differ from run to run, such as a phase, the worst of several. runs:
    the campaign's; where all of them log where they are, such a phase may be one that holds for any run.

    A failed run has no figure but its move time.
    """
    # Machine by machine: as many runs at a time, so that one compiled kernel serves all.
    by_phase = [[row for row, _ in run_specs(study.specs(at_phase))] for at_phase in _at_phases(machine, runs)]
    names, rows = metrics_for(study.kind), []
    for alike in zip(*by_phase, strict=True):
        row = next((row for row in alike if not row.ok), alike[0])
        worst = {name: find(name).worst([row[name] for row in alike]) if row.ok else None for name in names}
        rows.append(replace(row, metrics=worst | {"move_time_s": alike[0]["move_time_s"]}))
    return rows


def _per_run(machine: Machine, runs: Sequence[Run]) -> dict[str, list[Ranged]]:
    """The effects of the machine with values that differ from run to run, and these."""
    known = effects_for(kind_of(machine).name)
    own = {name: [r for r in ranges_of(known[name], machine, runs) if r.per_run] for name in machine.effects}
    return {name: ranges for name, ranges in own.items() if ranges}


def _at_phases(machine: Machine, runs: Sequence[Run]) -> list[Machine]:
    """The machine itself or, if an effect has a value for each run, four machines evenly over its range."""
    own, machines = _per_run(machine, runs), []
    for k in range(PHASES if own else 0):
        effects = {name: dict(values) for name, values in machine.effects.items()}
        for name, ranges in own.items():
            effects[name] |= {p.name: p.lowest + (p.highest - p.lowest) * k / PHASES for p in ranges}
        machines.append(machine.model_copy(update={"effects": effects}))
    return machines or [machine]


def _weakest_loop(machine: Machine, study: SmallStudy) -> LoopFigures:
    worst = weakest(family(machine, study.controller, operating_points(machine, study.payloads_kg, study.heights_m)))
    m, up = worst.margins, worst.margins.gain_up
    gain_db = 20.0 * math.log10(up) if math.isfinite(up) else math.inf
    return LoopFigures(worst.point.payload_kg, worst.point.height_m, m.stable, gain_db, m.phase_deg, m.ms,
                       m.crossover_hz, m.bandwidth_hz)  # fmt: skip


def _gains(study: SmallStudy, was: Machine, now: Machine, goal: Goal) -> tuple[Gains, Gains, float]:
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
        worst = {name: max(run[metric] for reference, run in here if reference == name) for name in references}
        first, second = sorted(worst.values())[:2]
        return "alike" if percent(first, second) < SMALL else min(references, key=lambda name: worst[name])

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
    kind = kind_of(machine)
    loop, hoist = kind.looped, kind.payload
    top = loop.top_speed(machine).speed
    moved = [motion for run in runs if (motion := _motion(machine, run)) and motion[0] > LEAST_SPEED * top * hoist]
    loads: tuple[float, ...] = (0.0,)
    if moved:
        fastest, steepest, lowest, highest = (tuple(column) for column in zip(*moved, strict=True))
        speed = min(max(fastest), 0.99 * top)
        acceleration = min(max(steepest), speed / (0.2 if hoist else 0.02))
        start, end = min(lowest), max(highest)
    else:
        speed = 0.9 * (top if hoist else min(top, loop.speed_scale(machine)))
        acceleration = speed / (1.2 if hoist else 0.2)
        start, end = 0.0, 0.6 * speed
    if hoist:
        low, high = machine.rail.lowest_position_m, machine.highest_position_m
        bottom, ceiling = low + END_OF_RAIL * (high - low), high - END_OF_RAIL * (high - low)
        quarter = low + 0.25 * (high - low)
        usual = quarter, quarter + min(0.5 * (high - low), 5.0 * speed)
        start, end = (max(start, bottom), min(end, ceiling)) if moved else usual
        if end - start < 0.02 * (ceiling - bottom):  # as far as nothing, or a height that is not this rail's
            start, end = bottom, 0.5 * (bottom + ceiling)
        known = sorted({run.payload_kg for run in runs}) or [x * machine.carriage.mass_kg for x in (0.0, 0.5, 1.0)]
        middle = min(known, key=lambda load: abs(load - 0.5 * (known[0] + known[-1])))
        loads = tuple(sorted({known[0], middle, known[-1]} if payloads_kg is None else set(payloads_kg)))
    else:
        steady = max(machine.role("coulomb_forward"), machine.role("coulomb_backward"))
        steady += machine.role("viscous") * speed
        steady += abs(machine.role("gravity_constant")) + abs(machine.role("gravity_sine"))
        room = 0.5 * (loop.input_limit(machine) - steady)
        if 0.0 < room < math.inf:
            acceleration = min(acceleration, room / loop.total_inertia(machine, 0.0))
    speed, acceleration, start = _digits(speed), _digits(acceleration), _digits(start)
    travel = _digits(min(max(end - start, 1e-6), LONGEST_S * speed))
    limits = Limits(speed, acceleration, _digits(1.5 * acceleration**2 / speed))
    unit, rest = kind.moved.unit, 2.0 if hoist else 1.0  # s; an axis settles soon
    scenario = checked(
        Scenario,
        {
            "name": "consequences",
            "payloads_kg": loads if hoist else None,
            f"start_position_{unit}": start,
            "moves": [{f"by_{unit}": travel}, {"dwell_s": rest}, {f"by_{unit}": -travel}],
            "limits": {key_in(unit, name): value for name, value in vars(limits).items()},
            "references": REFERENCES,
            "controller": usual_settings(machine)[0] if controller is None else controller,
            "settle_s": rest,
            "outputs": {"signals": "none"},
        },
    )
    return SmallStudy(scenario, kind, start, travel, limits, loads, bool(moved), controller is not None, own=False)


def _motion(machine: AnyKind, run: Run) -> tuple[float, float, float, float] | None:
    """(fastest speed, largest acceleration, lowest and highest place) of a run, m or rad and seconds; the first two as
    means over a window: a sample's noise is no motion. None of a run that is too short or has no speed."""
    hoist = kind_of(machine).payload
    if hoist:
        speed, place, per, window = "speed_motor_rad_s", "position_carriage_m", machine.lift_m_per_rad, 0.25
    else:
        speed, place, per, window = machine.speed_signal, machine.position_signal, 1.0, 0.05
    t, window, logged = run.time_s, max(window, 4.0 * run.sample_time_s), not hoist and place in run
    if len(t) < 3 or run.duration_s < 3.0 * window or not (logged or speed in run):
        return None
    way = run[place] if logged else integrated(run[speed] * per, t)
    here = run.signals.get(place, run.start_position_m + way) if hoist else way
    at = np.arange(t[0], t[-1] - 2.0 * window, 0.2 * window)
    speeds = np.diff([np.interp(at + k * window, t, way) for k in range(3)], axis=0) / window
    steepest = np.abs(speeds[1] - speeds[0]).max() / window
    return float(np.abs(speeds).max()), float(steepest), float(np.min(here)), float(np.max(here))


def _digits(value: float) -> float:
    """Rounded to three digits, so that the value in the text is the value of the run."""
    return float(f"{value:.3g}")


def _sentences(c: Consequences, corrected: Machine, runs: Sequence[Run] = ()) -> list[str]:
    """In order: what was run, failures, torque, tracking, wire, better reference, loop, gains, caveats."""
    kind, judged, good = c.study.kind, set_of(c.study.kind.name), [row for row in c.rows if row.ok]
    reasons = [(row, row.after.reason or row.before.reason) for row in c.rows if not row.ok]
    most = AT_LIMIT * kind.looped.peak_limit(corrected)
    reached = [row.words(kind) for row in good if row.after[judged.peak] >= most > row.before[judged.peak]]
    better = {
        by: _better([one for one in c.choices if one.metric == metric and one.payload_kg is not None], kind)
        for metric, by in (
            (judged.peak, f"{judged.input_words} peak at equal limits"),
            (judged.error, "tracking error at equal limits"),
        )
    }
    takes = dict[str, float]()  # s: at equal limits a smoother reference is a slower one
    for row in good:
        takes[row.reference] = max(takes.get(row.reference, 0.0), row.after["move_time_s"])
    alike = percent(min(takes.values(), default=0.0), max(takes.values(), default=0.0)) < SMALL
    at_most = "at most " if kind.payload else ""
    times = [] if alike else [f"{name} takes {at_most}{figures(seconds)} s" for name, seconds in takes.items()]
    moved = [abs(percent(getattr(c.gains_before, k), getattr(c.gains_after, k))) for k in ("kp", "ki")]
    of_kind, own, drive = effects_for(kind.name), [*_per_run(corrected, runs)], corrected.drive
    return said.each(
        "changes", c, listed([f"{load:g}" for load in c.study.payloads_kg]),
        [(row, reason.rpartition("; ")[2]) for row, reason in reasons],  # how far a load fell says nothing
        judged.input_words, reached, [_figure(good, metric, kind) for metric in figures_told(kind) if good], better,
        times, _margins(c.loop_before, c.loop_after), max(moved) < GAIN_MOVES, own,
        [name for name in corrected.effects if of_kind[name].regime == "time" and name not in own],
        [name for name in corrected.effects if of_kind[name].on_sensor],
        not (drive.torque_lag_s or drive.speed_filter_s or drive.speed_delay_s),
    )  # fmt: skip


def _better(choices: Sequence[Choice], kind: Kind) -> list[str]:
    """In words, at each payload; once where they are the same at every one."""
    if len(choices) > 1 and len({(one.before, one.after) for one in choices}) == 1:
        choices = [replace(choices[0], payload_kg=None)]
    return [said.better(one, kind) for one in choices]


def figures_told(kind: Kind) -> tuple[Metric, ...]:
    """The metrics that sentences tell."""
    judged = set_of(kind.name)
    names = (judged.error, "min_wire_tension_n") if kind.payload else (judged.rms, judged.error, "settling_time_s")
    return tuple(judged.by_name[name] for name in (judged.peak, *names))


def _figure(good: Sequence[Change], metric: Metric, kind: Kind) -> tuple[Any, ...]:
    """(metric, where the wire goes slack, per cent from end to end or None, the run of the largest, its values)."""
    name = metric.name
    slack = [row.words(kind) for row in good if name == "min_wire_tension_n" and row.after[name] <= 0.0]
    moved = [math.inf if math.isnan(row.percent(name)) else abs(row.percent(name)) for row in good]
    most = good[moved.index(max(moved))]
    values = [metric.scale * run[name] for run in (most.before, most.after)]
    if math.isnan(most.percent(name)):  # nothing before: no percentage of it
        return metric, slack, None, most.words(kind), *values
    changes = [row.percent(name) for row in good]
    span = dict.fromkeys(signed(change, 1) for change in (min(changes), max(changes)))
    return metric, slack, [] if max(map(abs, changes)) < SMALL else [*span], most.words(kind), *values


def _margins(a: LoopFigures, b: LoopFigures) -> tuple[bool, list[str]]:
    """Whether a margin moves, and all of them in words."""
    said, moves = [], False
    for what, least, form, x, y in (
        ("the least gain margin", 0.5, "{:.1f} dB", a.gain_margin_db, b.gain_margin_db),
        ("the least phase margin", 1.0, "{:.0f}°", a.phase_margin_deg, b.phase_margin_deg),
        ("the largest Ms", 0.01, "{:.2f}", a.ms, b.ms),
    ):
        was, now = (form.format(value) if math.isfinite(value) else "without bound" for value in (x, y))
        still = x == y or abs(y - x) < least
        moves |= not still
        said.append(f"{what} is {now}" if still else f"{what} goes from {was} to {now}")
    return moves, said


def consequences_table(c: Consequences) -> Table:
    """One row for each payload and reference: the machine as given, refitted, corrected, and the effects' own share."""
    payload, told = c.study.kind.payload, figures_told(c.study.kind)[:3]
    machines = {"given": "given", "refitted": "refitted", "after": "corrected"}
    if c.rows[0].refitted is None:
        del machines["refitted"]
    columns = [*([Column("payload", "kg")] if payload else []), words("reference")]
    for metric in told:
        head = (metric.head or metric.label).replace("\n", " ")
        columns += [Column(f"{head}\n{machine}", metric.shown_unit) for machine in machines.values()]
        columns.append(Column(f"{head}\neffects", "%"))
    lines = []
    for row in c.rows:
        line = [*([f"{row.payload_kg:g}"] if payload else []), row.reference]
        for metric in told:
            change = row.percent(metric.name)
            line += [metric.text(getattr(row, machine)[metric.name]) for machine in machines]
            line.append(signed(change, 1))
        lines.append([*line, f"{row.after['move_time_s']:.2f}"])
    return Table([*columns, Column("moves", "s")], lines, said.table())


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

    said: dict[str, Any] = plain(
        {
            "effects": c.effects,
            "study": c.study.as_json(),
            "rows": [
                placed(row, **{when: run(getattr(row, when)) for when in MACHINES})
                | {"change_percent": {name: row.percent(name) for name in metrics_for(kind)}}
                for row in c.rows
            ],
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
