"""What is simulated and reckoned beside a study, metrics only: other payloads and limits, equal times, another damping,
the number that a scenario asks for, and the least peak that there is in the trapezoid's time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.control import Events
from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.run import Array
from workbench.machines import Hoist, Machine, kind_of, load_of, with_values
from workbench.metrics import set_of
from workbench.references import BASELINE, motion_time_s, move_shape, planned_kinds
from workbench.references.least_peak import least_peak, peak_force_n
from workbench.references.library.wire import ZVD, impulses
from workbench.references.shape import LimitPair, Limits, Shape, raised
from workbench.study.decide import Given, candidates, criteria_for, decisions
from workbench.study.front import fronts
from workbench.study.grid import RunSpec
from workbench.study.labels import field_label, said, swept_axes, words_of
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit, run_specs
from workbench.study.scenario import Scenario, key_in

_ONLY_METRICS: dict[str, Any] = {"outputs": {"signals": "none"}, "sweep": None, "sample": None}
_LOOKED_AT = 1024  # runs among which the heaviest payload is sought


def at_heaviest(study: Study) -> list[RunSpec]:
    """A run for each reference at the heaviest payload, without signals, on the lumped machine: of the scenario without
    its sweep and sample, or of their first point where the scenario needs them."""
    try:
        bare = changed(study.scenario, {"sweep": None, "sample": None})
        specs = plan_study(bare, study.machine, study.recordings).specs
    except InputError:
        specs = study.specs
    looked = [spec for spec in specs[:_LOOKED_AT] if not spec.problem] or specs[:1]
    heaviest = max(looked, key=lambda spec: spec.payload_kg)
    runs = [s for s in looked if s.payload_kg == heaviest.payload_kg and s.assigned == heaviest.assigned]
    return [replace(spec, record_every=0, plant="lumped") for spec in runs]


def over_payload(scenario: Scenario, machine: Hoist, payloads_kg: Sequence[float]) -> Study:
    """The scenario at these payloads, with its own among them."""
    payloads = tuple(sorted({*payloads_kg, *(scenario.payloads_kg or ())}))
    return plan_study(changed(scenario, {"payloads_kg": payloads, **_ONLY_METRICS}), machine)


def over_ramps(scenario: Scenario, machine: Machine, accelerations: Sequence[float], jerks: Sequence[float]) -> Study:
    """The scenario's references at its heaviest payload, each acceleration with each jerk, both ways alike.

    accelerations, jerks: in m/s² and m/s³, of a rotary axis in rad/s² and rad/s³.
    """
    kind = kind_of(machine)
    limits = {"acceleration_m_s2": accelerations, "jerk_m_s3": jerks}
    sweep = {f"limits.{key_in(kind.moved.unit, name)}": list(map(float, values)) for name, values in limits.items()}
    changes = {**_ONLY_METRICS, "sweep": sweep}
    if kind.payload:
        changes["payloads_kg"] = (max(scenario.payloads_kg or (0.0,)),)
    return plan_study(changed(scenario, changes), machine)


TIMES = (1.0, 1.02, 1.05, 1.1, 1.2)  # of the quickest: where the curves over move time have their points
JERKS = (1.0, 3.0, 9.0)  # times the limits' own ratio of jerk to acceleration, that the best is chosen from
FAMILIES = (BASELINE, "ruckig", "seventh_order", "zvd")
LEAST = (
    "optimal"  # a linear programme a move: only at the heaviest payload, in the times of the quickest and the slowest
)
GENTLEST = 1e-3  # of the acceleration that is given: slower is not sought
MOST_PAYLOADS = 3
MOST_SPECS = 4096  # of a sweep, among which the trapezoid's are sought
WIDER, ROUNDS = 3, 2  # points beyond the edge at which a knee lies, and how often
SAME_S = 5e-3


def beside(study: Study, rows: Sequence[Row]) -> list[Row]:
    """The runs that a study is compared with: every family at equal times; of a sweep of limits the trapezoid where it
    lacks it, and the limits beyond the edge at which its knee lies."""
    sweep = study.scenario.sweep
    swept = {} if sweep is None else sweep.grid | sweep.zip
    if not any(name.startswith("limits.") for name in swept) or study.scenario.sample:
        return at_equal_times(study)
    wider, every = list[Row](), list(rows)
    for _ in range(ROUNDS):
        wider += (found := beyond_the_edge(study, every))
        every += found
    if not any("jerk" in name for name in swept) or BASELINE in study.scenario.kinds:
        return wider
    specs: dict[tuple[object, ...], RunSpec] = {}
    for spec in study.specs[:MOST_SPECS]:
        rest = {name: value for name, value in spec.assigned.items() if "jerk" not in name}
        own = replace(spec, reference=BASELINE, assigned=rest, record_every=0, run_id=f"{spec.run_id}_{BASELINE}")
        if not spec.problem and spec.recording is None:
            specs.setdefault((spec.payload_kg, *rest.items()), own)
    return [*wider, *(row for row, _ in run_specs(list(specs.values())))]


def beyond_the_edge(study: Study, rows: Sequence[Row]) -> list[Row]:
    """The runs at further values of the axes at whose edge the knee of the heaviest payload lies; [] where it is inside
    or those values are not possible."""
    sweep, axes = study.scenario.sweep, swept_axes(rows)
    grid = {} if sweep is None else dict(sweep.grid)
    knees = [front.knee for front in fronts([row for row in rows if row.ok]) if front.knee is not None]
    further: dict[str, tuple[float, ...]] = {}
    for axis in axes if knees else ():
        name, at = axis.columns[0].removeprefix("sweep."), axis.at(knees[-1])
        if not name.startswith("limits.") or name not in grid or not axis.numeric:
            continue
        values = [float(point[0]) for point in axis.points]
        if axis.edge(knees[-1]):
            last, before = (values[-1], values[-2]) if at == axis.points[-1] else (values[0], values[1])
            further[name] = tuple(float(f"{last * (last / before) ** k:.4g}") for k in range(1, WIDER + 1))
        elif len(values) > 2:  # the knee's own value with its neighbours
            k = values.index(float(at[0]))
            grid[name] = tuple(values[k - 1 : k + 2])
    if not further:
        return []
    changes = {"sweep": {**grid, "zip": sweep.zip if sweep else {}, **further}, "outputs": {"signals": "none"}}
    try:
        specs = plan_study(changed(study.scenario, changes), study.machine, study.recordings).specs
    except InputError:
        return []
    return [row for row, _ in run_specs(specs[:MOST_SPECS]) if row.ok]


def at_equal_times(study: Study) -> list[Row]:
    """Each family of references slowed down to each other's times and to points beyond, speed limit kept.

    Those with a jerk limit take several ratios of jerk to acceleration. The limits stand in the rows as a sweep of them
    would. [] where sweep, sample, events or jogs leave no such comparison.
    """
    scenario, kinds = study.scenario, planned_kinds()
    jogs = any(step.speed_m_s is not None for step in study.specs[0].moves)
    if scenario.sweep or scenario.sample or scenario.events != Events() or scenario.plant != "lumped" or jogs:
        return []
    payloads = sorted({spec.payload_kg for spec in study.specs})
    if len(payloads) > MOST_PAYLOADS:
        payloads = [payloads[0], payloads[len(payloads) // 2], payloads[-1]]
    specs: list[RunSpec] = []
    for payload in payloads:
        own = {s.reference: s for s in study.specs if s.payload_kg == payload and not s.problem}
        own = {name: spec for name, spec in own.items() if name in kinds}
        if not own:
            continue
        first = next(iter(own.values()))
        load, jerk = load_of(first.machine, payload), first.bounds.hoisting.jerk_m_s3
        times = [_duration_s(spec, spec.bounds) for spec in own.values()]
        wanted = sorted({round(time, 3) for time in (*times, *(min(times) * factor for factor in TIMES))})
        for name in dict.fromkeys([*own, *FAMILIES, LEAST]):
            kind, spec = kinds[name], own.get(name, replace(first, reference=name))
            unknown = kind.needs_load and (load is None or (kind.needs_following and not (load.hangs or load.rigid)))
            shaper = kind.needs_load and not kind.same_time_as  # of a load that hardly swings it is the trapezoid
            if unknown or (shaper and (load is None or len(impulses(ZVD, load)) < 2)):
                continue
            if kind.same_time_as and (name != LEAST or payload != payloads[-1]):
                continue
            if kind.needs_jerk and math.isinf(jerk):
                continue
            for ratio in JERKS if kind.needs_jerk else (1.0,):
                specs += _slowed(
                    spec, sorted({min(times), max(times)}) if name == LEAST else wanted, ratio, own=name in own
                )
    return [row for row, _ in run_specs(specs) if row.ok]


def _slowed(spec: RunSpec, wanted: Sequence[float], ratio: float, own: bool) -> Iterator[RunSpec]:
    """The run with acceleration and jerk lowered until its moves take each of the times; quicker ones are left out, and
    of the study's own references what it has run itself."""
    from scipy.optimize import brentq

    given = spec.bounds
    unit = kind_of(spec.machine).moved.unit

    def scaled(f: float) -> LimitPair:
        """Accelerations times the factor, jerks times it and the ratio."""
        ways = (given.hoisting, given.lowering)
        return LimitPair(*(Limits(w.speed_m_s, f * w.acceleration_m_s2, f * ratio * w.jerk_m_s3) for w in ways))

    for time_s in wanted:

        def late(log_factor: float, time_s: float = time_s) -> float:
            return _duration_s(spec, scaled(math.exp(log_factor))) - time_s

        quickest = late(0.0)
        if (own and ratio == 1.0 and abs(quickest) < SAME_S) or quickest > SAME_S or late(math.log(GENTLEST)) < 0.0:
            continue
        limits = scaled(math.exp(brentq(late, math.log(GENTLEST), 0.0, xtol=1e-6)) if quickest < -SAME_S else 1.0)
        a, j = limits.hoisting.acceleration_m_s2, limits.hoisting.jerk_m_s3
        assigned = {f"sweep.limits.{key_in(unit, 'acceleration_m_s2')}": float(f"{a:.4g}")}
        if planned_kinds()[spec.reference].needs_jerk:
            assigned[f"sweep.limits.{key_in(unit, 'jerk_m_s3')}"] = float(f"{j:.4g}")
        yield replace(
            spec, run_id=f"{spec.run_id}_{time_s:g}s_{ratio:g}", limits=limits, assigned=assigned, record_every=0,
            duration_s=max(spec.duration_s, spec.lead_s + time_s + spec.settle_s),
        )  # fmt: skip


def _duration_s(spec: RunSpec, limits: LimitPair) -> float:
    rail, load = kind_of(spec.machine).looped.rail(spec.machine), load_of(spec.machine, spec.payload_kg)
    return motion_time_s((spec.reference,), spec.moves, spec.start_position_m, limits, rail, load)


RINGING = 0.02  # damping ratio assumed for a wire or coupling that rings; a wire's range: the machine `lightly_damped`
PAPER_S = 0.1  # c/k of the paper's wire
# Damping ratio of a jaw coupling with an elastomer spider: relative damping 0.8 of DIN 740-2, as makers of the usual
# spiders of 92 and 98 Shore A state it, over 4 pi.
ELASTOMER = 0.064
HARDLY = 2.0  # per cent that a figure may move and still depend little on the damping


def damping_sentence(scenario: Scenario, machine: Machine) -> str | None:
    """What another wire or coupling makes of the answer; None where a run fails."""
    return on_another_damping(plan_study(scenario, machine))


def on_another_damping(study: Study) -> str | None:
    """The heaviest load on its wire or coupling and on one that rings; on a well damped one where its own rings. Of
    the multi-body machine the lumped one says it. None where all runs fail.

    Figures of the trapezoid and of the one to take, or of another one; then which of all is to be taken on either.
    """
    runs = at_heaviest(study)
    own = [spec for spec in runs if spec.reference in planned_kinds()] or runs[:1]
    load = load_of(own[0].machine, own[0].payload_kg)
    if load is None or load.rigid:
        return said.stiff()
    rings = load.damping <= 1.5 * RINGING
    if load.hangs:
        path, swing, scale = "wire.damping_time_s", "wire_tension_swing_n", 1.0
        damped_s, damped = PAPER_S, f"the paper's assumption of c/k = {PAPER_S:g} s"
    else:
        path, swing = "coupling.damping_nm_s_per_rad", "settling_time_s"
        scale, damped_s = load.stiffness_n_per_m, 2.0 * ELASTOMER / load.angular_frequency_rad_s
        damped = "a coupling with an elastomer spider"
    time_s = damped_s if rings else 2.0 * RINGING / load.angular_frequency_rad_s
    other = [replace(spec, machine=with_values(spec.machine, {path: scale * time_s})) for spec in own]
    rows = [row for row, _ in run_specs([*own, *other])]
    before, after = rows[: len(own)], rows[len(own) :]
    known = {a.reference: (a, b) for a, b in zip(before, after, strict=True) if a.ok and b.ok}
    if not known:
        return None
    first, then = (decisions(some, own[0].machine, study.scenario.decide)[-1].taken for some in (before, after))
    told = dict.fromkeys((BASELINE, first.reference if first else "", *known))
    judged, pairs = metrics_of(before), [known[reference] for reference in told if reference in known][:2]
    metrics = [judged.by_name[judged.peak], judged.by_name[swing]]
    moved = max(abs(b[m.name] / a[m.name] - 1.0) for a, b in pairs for m in metrics if a[m.name])
    varied = study.scenario.sweep or study.scenario.sample
    swept = ", ".join(field_label(column).of(value) for column, value in own[0].assigned.items())
    swept = swept or ("the file's own values" if varied else "")
    where = " and ".join(part for part in (f"{own[0].payload_kg:g} kg" if load.hangs else "", swept) if part)
    ratio = replace(load, damping_time_s=time_s).damping
    figures = [(words_of(a.reference), [(m, m.text(b[m.name]), m.text(a[m.name])) for m in metrics]) for a, b in pairs]
    chosen = first and len(own) > 1 and not varied
    return said.damping(
        load, ratio, 100.0 * moved < HARDLY, study.scenario.plant == "lumped", damped if rings else "", where, figures,
        first.words if first and chosen else "", then.words if then else "none",
    )  # fmt: skip


POINTS = 8  # values a round: the lanes that run side by side
CLOSE = 2e-3  # relative: how well the boundary is known
MOST_ASKED, MOST_REFERENCES, MOST_LIMITS = 64, 2, 3


def _deceleration(spec: RunSpec) -> float:
    stop = spec.events.emergency_deceleration_m_s2
    if spec.events.emergency_stop_s is not None and stop is not None:
        return stop
    return spec.bounds.hoisting.acceleration_m_s2


def _decelerating(spec: RunSpec, value: float) -> RunSpec:
    """The emergency stop's deceleration; without one the acceleration limit of the motion, both ways."""
    if spec.events.emergency_stop_s is not None:
        return replace(spec, events=spec.events.model_copy(update={"emergency_deceleration_m_s2": value}))
    ways = (replace(way, acceleration_m_s2=value) for way in (spec.bounds.hoisting, spec.bounds.lowering))
    return replace(spec, limits=LimitPair(*ways))


@dataclass(frozen=True)
class Question:
    """unit: of what is sought. most: the largest value, else the smallest. first: where the search begins."""

    unit: str
    most: bool
    first: Callable[[RunSpec], float]
    at: Callable[[RunSpec, float], RunSpec]


QUESTIONS = {
    "largest payload": Question(
        "kg", True, lambda s: s.machine.carriage.mass_kg, lambda s, x: replace(s, payload_kg=x)
    ),
    "highest deceleration": Question("m/s²", True, _deceleration, _decelerating),
    "smallest motor": Question(
        "N m nominal torque per motor", False, lambda s: s.machine.motor.nominal_torque_nm,
        lambda s, x: replace(s, machine=with_values(s.machine, {"motor.nominal_torque_nm": x})),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Asked:
    """value: the last one at which all limits are kept, None where there is none in reach; broken: what is, beyond."""

    reference: str
    value: float | None
    beyond: float
    broken: tuple[str, ...]


def answers(study: Study) -> list[Asked]:
    """Of the first references: the value under all limits, then without those that bind it, one after the other."""
    if study.scenario.ask is None:
        return []
    question, found = QUESTIONS[study.scenario.ask], []
    for reference in study.scenario.kinds[:MOST_REFERENCES]:
        own: dict[str, RunSpec] = {}  # without what only the sought field tells apart
        for spec in study.specs[: MOST_ASKED * len(study.scenario.kinds)]:
            if spec.reference == reference and not spec.problem:
                alike = question.at(spec, question.first(study.specs[0]))
                key = repr((alike.payload_kg, alike.machine, alike.events, alike.limits, alike.moves, alike.controller))
                own.setdefault(key, replace(spec, record_every=0))
        if not own:
            raise InputError(f"no run with {reference} can be made", place="ask")
        search = _Search(question, list(own.values()), study.scenario.decide, frozenset())
        for _ in range(MOST_LIMITS):
            asked, binding = search.boundary(reference)
            found.append(asked)
            if asked.value is None or not binding:
                break
            search = replace(search, left_out=search.left_out | binding)
    return found


@dataclass(frozen=True)
class _Search:
    """left_out: criteria whose limits do not count."""

    question: Question
    specs: Sequence[RunSpec]
    given: Given
    left_out: frozenset[str]

    def boundary(self, reference: str) -> tuple[Asked, frozenset[str]]:
        """Between the last value that keeps the limits and the first that does not, and the criteria that bind.

        Bracketed by runs side by side and narrowed down until it is known to CLOSE.
        """
        step = 2.0 if self.question.most else 0.5
        values: Array = self.question.first(self.specs[0]) * step ** np.arange(-3.0, 5.0)
        good: float | None = None
        broken: tuple[str, ...] = ()
        bad, names = float(values[-1]), frozenset[str]()
        while True:
            beyond = None
            for value, verdict in zip(values, self._judged(values), strict=True):
                if verdict[0]:
                    bad, (broken, names), beyond = float(value), verdict, value
                    break
                good = float(value)
            if good is None or (beyond is None and not broken):
                return Asked(reference, good, bad, broken), frozenset()
            if abs(bad - good) <= CLOSE * good:
                return Asked(reference, good, bad, broken), names
            values = np.linspace(good, bad, POINTS + 2)[1:-1]

    def _judged(self, values: Array) -> list[tuple[tuple[str, ...], frozenset[str]]]:
        """Of each value what is broken, in words, and the criteria that are."""
        runs = [replace(self.question.at(spec, float(value)), assigned={}) for value in values for spec in self.specs]
        rows = [row for row, _ in run_specs(runs)]
        verdicts, size = [], len(self.specs)
        for k in range(0, len(rows), size):
            broken: dict[str, None] = {}
            names: set[str] = set()
            for spec, row in zip(runs[k : k + size], rows[k : k + size], strict=True):
                judged = set_of(kind_of(spec.machine).name)
                criteria = criteria_for(judged, spec.machine, spec.payload_kg, self.given)
                known = [c for c in criteria if c.name not in self.left_out and row.metrics.get(c.name) is not None]
                (candidate,) = candidates([row], known)
                over = [c for c in known if c.broken(row[c.name])]
                names |= {c.name for c in over}
                other = candidate.broken[: len(candidate.broken) - len(over)]  # what is no criterion stands first
                said = [reason.replace("it ", "the run ").replace("its loop", "the loop") for reason in other]
                broken |= dict.fromkeys([*said, *(c.broken_words for c in over)])
            verdicts.append((tuple(broken), frozenset(names)))
        return verdicts


def asked_sentences(study: Study, found: Sequence[Asked]) -> list[str]:
    """The number that was asked for, what limits it, and how far it goes without that limit."""
    name, of = study.scenario.ask or "", dict[str, list[Asked]]()
    for one in found:
        of.setdefault(one.reference, []).append(one)
    return [said.asked(name, QUESTIONS[name], reference, own) for reference, own in of.items()]


EQUAL = "ruckig_equal_time"
Moves = Sequence[Shape]


def from_the_bound(study: Study) -> list[str]:
    """At the heaviest payload the least peak in the trapezoid's time, from below and from above, how far the
    study's planned references are from it. [] without a trapezoid, with jogs or a stop on the way, and where the load
    is not known or goes with its angle."""
    specs = {spec.reference: spec for spec in at_heaviest(study)}
    own = specs.get(BASELINE)
    load = None if own is None else load_of(own.machine, own.payload_kg)
    if own is None or own.limits is None or load is None or own.events.emergency_stop_s is not None:
        return []
    distances = _distances(own)
    if not distances:
        return []
    limits, judged = own.limits, set_of(kind_of(own.machine).name)
    limit, of_load = peak_limit(own.machine), load.force_limit_n
    scale = limit / of_load if math.isfinite(of_load) else 1.0  # of a force at the load: one motor's torque

    def moves_of(name: str) -> Moves:
        return [move_shape(planned_kinds()[name], d, limits.towards(d), load) for d in distances]

    def peak(moves: Moves) -> float:
        return scale * max(peak_force_n(shape, load) for shape in moves)

    moves = {name: moves_of(name) for name in specs if name in planned_kinds()}
    trapezoid_s = sum(shape.duration_s for shape in moves[BASELINE])
    where = f"at {own.payload_kg:g} kg" if judged.payload else ""
    try:
        still, any_end = (
            [
                least_peak(d, limits.towards(d).speed_m_s, shape.duration_s, load, still)
                for d, shape in zip(distances, moves[BASELINE], strict=True)
            ]
            for still in (True, False)
        )
    except InputError:
        return [said.no_bound(where, judged)]
    least, found, least_of_all = (
        scale * max(forces)
        for forces in ([b.dual_n for b in still], [b.primal_n for b in still], [b.dual_n for b in any_end])
    )

    def faster(shape: Shape, distance: float) -> bool:
        return shape.limits.speed_m_s > 1.001 * limits.towards(distance).speed_m_s

    sides: dict[str, list[str]] = {"Above": [], "Below": []}
    for name, own_moves in moves.items():
        away, late = 100.0 * (peak(own_moves) / least - 1.0), sum(s.duration_s for s in own_moves) - trapezoid_s
        longer = f" ({abs(late):.2g} s {'longer' if late > 0.0 else 'shorter'})" if abs(late) > 1e-3 else ""
        beyond = " (beyond the speed limit)" * any(map(faster, own_moves, distances))
        sides["Above" if away >= 0.0 else "Below"].append(f"{words_of(name)} by {abs(away):.0f} %{longer}{beyond}")
    return [said.bound(where, judged, _down(least_of_all), _down(least), -_down(-found), sides)]


def beyond_its_limits(study: Study) -> list[str]:
    """Which limits the jerk-limited move in the trapezoid's time exceeds to keep that time, at the heaviest payload and
    the scenario's base values. [] where there is none."""
    own = next((spec for spec in at_heaviest(study) if spec.reference == EQUAL), None)
    load = None if own is None else load_of(own.machine, own.payload_kg)
    if own is None or own.limits is None or load is None:
        return []
    ways = dict[str, None]()
    for distance in _distances(own):
        given = own.limits.towards(distance)
        used = move_shape(planned_kinds()[EQUAL], distance, given, load).limits
        if exceeded := raised(given, used, kind_of(own.machine).moved.unit):
            share = 100.0 * used.speed_m_s / load.top_speed_m_s if used.speed_m_s > given.speed_m_s else 0.0
            ways[exceeded + (f" ({share:.3g} % of the drive's top speed)" if share else "")] = None
    where = f"at {own.payload_kg:g} kg " if kind_of(own.machine).payload else ""
    text = f"{where}{words_of(EQUAL)} goes beyond the limits to keep that time: {listed([*ways])}."
    return [text[0].upper() + text[1:]] if ways else []


def _down(value: float) -> float:
    """To four digits, never up: a bound stays one."""
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return round(math.floor(value / unit) * unit, 12)


def _distances(spec: RunSpec) -> list[float]:
    """Of the moves from rest to rest; [] where there is a jog."""
    here, distances = spec.start_position_m, []
    for step in spec.moves:
        if step.speed_m_s is not None:
            return []
        if step.dwell_s is None:
            target = here + step.by_m if step.by_m is not None else step.to_m
            assert target is not None
            distances.append(target - here)
            here = target
    return list(dict.fromkeys(distances))
