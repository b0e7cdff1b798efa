"""Tuning: loop shaping on the family of linear loops, then refinement on the nonlinear closed loop.

Deterministic: the candidates are a Sobol' sequence with a fixed seed around the shaped gains, then
smaller and smaller steps along each coordinate from the best of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.analysis.linearise import OperatingPoint
from workbench.analysis.margins import Member, family
from workbench.analysis.search import NEAR, Search, Shaped, best_rejection, for_bandwidth, kp_for, make_search
from workbench.control import Events, Notch, Settings
from workbench.control.settings import InputShaper, ScheduledGains
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.core.shown import Brief
from workbench.machines import NO_EFFECTS, AnyKind, Effects, Machine, kind_of
from workbench.metrics import set_of
from workbench.references import Limits, Plan, Step, plan_motion
from workbench.simulate.loop import NO_EVENTS, LoopCase, Outcome, simulate_loop


@dataclass(frozen=True, eq=False)
class Trial:
    """The moves that candidates are run through: every payload with every reference, the machine's effects at work.

    references: name -> speed of the driven coordinate (n,), rad/s or m/s, at the controller's samples; all of one
    length, a stop among the events already in them. positions: the same of an axis' position reference. events:
    what happens in every run. step_s: the plant's longest step.
    """

    machine: AnyKind
    payloads_kg: tuple[float, ...]
    start_position_m: float
    references: Mapping[str, Array]
    events: Events = NO_EVENTS
    step_s: float = 0.001
    positions: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """Of one candidate the worst over the trial's runs; all NaN where a run failed.

    tracking: rms speed error in % of nominal motor speed; of an axis rms position error in % of a second's way at
    its speed scale. peak: largest torque of the harder-worked motor, % of nominal; of an axis of its input scale.
    effort: rms torque over the run, % of the same.
    """

    tracking_percent: float
    peak_percent: float
    effort_percent: float

    @property
    def ok(self) -> bool:
        return bool(np.isfinite(self.tracking_percent))


def usual_trial(machine: Machine, payloads_kg: Sequence[float], sample_time_s: float) -> Trial:
    """There and back again at nine tenths of the top speed, as a trapezoid and jerk-limited.

    Of a hoist ramps of 1.2 s, jerk limited so that it takes 2 s; starting in the middle of the lower half of the rail.
    An axis starts at 0 with ramps that take 0.2 s, longer where half of its limit cannot; for a top speed that is
    nowhere stated its even motion's serves, twice.
    """
    loop = kind_of(machine).looped
    low, high = loop.rail(machine)
    speed = 0.9 * min(loop.top_speed(machine).speed, loop.speed_scale(machine) if loop.position_loop else math.inf)
    if loop.position_loop:
        ramp = max(0.2, 2.0 * speed * loop.total_inertia(machine, 0.0) / loop.input_limit(machine))
        start, way, rest, rounding = 0.0, 3.0 * speed * ramp, 2.0 * ramp, ramp / 1.5
    else:
        ramp, rest, rounding = 1.2, 1.0, 0.8
        start, way = low + 0.25 * (high - low), min(0.5 * (high - low), 5.0 * speed)
    limits = Limits(speed, speed / ramp, speed / ramp / rounding)
    steps = [Step(by_m=way), Step(dwell_s=rest), Step(by_m=-way)]
    kinds = ("trapezoid", "ruckig")
    ends = (0.5, 1.5) if not loop.position_loop else (0.5 * ramp, 3.0 * ramp)
    plans = {kind: plan_motion(kind, steps, start, limits, (low, high), *ends) for kind in kinds}
    length = max(plan.duration_s for plan in plans.values())
    speeds, positions = motions(machine, plans, sample_time_s, length)
    return Trial(machine, tuple(payloads_kg), start, speeds, positions=positions)


def motions(
    machine: Machine, plans: Mapping[str, Plan], sample_time_s: float, length_s: float
) -> tuple[dict[str, Array], dict[str, Array]]:
    """name -> the driven coordinate's speed at the controller's samples, all equally long; the same of its position,
    where the loop follows that."""
    loop = kind_of(machine).looped
    per_displacement = loop.per_displacement(machine)
    profiles = {name: plan.sample(sample_time_s, length_s) for name, plan in plans.items()}
    n = min(len(profile.speed_m_s) for profile in profiles.values())
    positions = {name: (profile.position_m * per_displacement)[:n] for name, profile in profiles.items()}
    speeds = {name: (profile.speed_m_s * per_displacement)[:n] for name, profile in profiles.items()}
    return speeds, positions if loop.position_loop else {}


def try_out(trial: Trial, candidates: Sequence[Settings]) -> list[Score]:
    """Run every candidate through the trial."""
    cases = [
        LoopCase(
            f"{i}", trial.machine, payload, trial.start_position_m, settings, speed, trial.events,
            position_reference=trial.positions.get(name),
        )
        for i, settings in enumerate(candidates)
        for payload in trial.payloads_kg
        for name, speed in trial.references.items()
    ]  # fmt: skip
    results = simulate_loop(cases, record_every=0, step_s=trial.step_s)
    kind = kind_of(trial.machine)
    judged, loop = set_of(kind.name), kind.looped
    speed, most = loop.speed_scale(trial.machine), loop.input_scale(trial.machine)
    # A hoist's motor is judged by its speed, an axis by its place, over the way that its top speed makes in a second.
    table = np.array(
        [
            [
                100.0 * r.metrics[judged.rms_error] / speed,
                100.0 * r.metrics[judged.peak] / most if loop.position_loop else r.metrics["peak_torque_percent"],
                100.0 * r.metrics[judged.rms] / most,
            ]
            if r.outcome is Outcome.COMPLETED
            else [np.nan] * 3
            for r in results
        ]
    )
    worst = table.reshape(len(candidates), -1, 3).max(axis=1)  # NaN where any run failed
    return [Score(*map(float, row)) for row in worst]


DRAWN, KEPT = 256, 64  # Sobol' points drawn, and those of them that are simulated
ROUNDS = 5
STEPS = ROUNDS + 4
# How far a candidate may leave what was asked for: bandwidth up to 5 % more, ki down to four fifths.
WIDER, GIVEN_AWAY = 1.05, 0.8
KP_ROOM, RATIO_ROOM = 0.6, 2.5  # of the logarithms of kp and of ki/kp
SEED = 1
NOTCH_DEPTHS = (0.1, 0.3)


@dataclass(frozen=True)
class Weights:
    """What counts how much; each part is relative to the shaped gains' own."""

    tracking: float = 1.0
    peak: float = 2.0
    effort: float = 1.0

    def cost(self, score: Score, base: Score) -> float:
        """1 for the shaped gains themselves; inf for a candidate that failed."""
        if not score.ok:
            return math.inf
        total = self.tracking + self.peak + self.effort
        return (
            self.tracking * score.tracking_percent / base.tracking_percent
            + self.peak * score.peak_percent / base.peak_percent
            + self.effort * score.effort_percent / base.effort_percent
        ) / total


@dataclass(frozen=True)
class Goal:
    """bandwidth_hz: of the slowest member; None asks for the best rejection of load steps instead."""

    bandwidth_hz: float | None = None
    ms_limit: float = 1.4

    def __post_init__(self) -> None:
        if not (math.isfinite(self.ms_limit) and self.ms_limit > 1.0):
            raise InputError(f"{self.ms_limit:g}, expected a number greater than 1, such as 1.4", place="ms")
        if self.bandwidth_hz is not None and not (math.isfinite(self.bandwidth_hz) and self.bandwidth_hz > 0.0):
            raise InputError(f"{self.bandwidth_hz:g} Hz, expected a number greater than 0", place="bandwidth")


@dataclass(frozen=True)
class TuneProgress:
    """How far a tuning is. doing: what comes now; step: of STEPS, from 0; tried: candidates so far, cost: the least."""

    doing: str
    step: int
    tried: int = 0
    cost: float = math.nan


@dataclass(frozen=True)
class Candidate:
    """One set of gains: what the linear family says of it and what the nonlinear runs say."""

    settings: Settings
    ms: float
    bandwidth_hz: float
    score: Score
    cost: float


@dataclass(frozen=True)
class Alternative:
    """A notch with the largest ki that it allows, or a shaper with the cost of the winner behind it; None: without."""

    term: str
    value: Notch | InputShaper | None
    result: float


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Brief):
    """The outcome: the winner, the shaped gains it began from, all that was tried, the winner's family, and the
    alternatives of what was also tuned."""

    goal: Goal
    shaped: Candidate
    winner: Candidate
    tried: Sequence[Candidate]
    attainable_hz: float
    members: Sequence[Member] = field(default_factory=list)
    compared: Sequence[Alternative] = field(default_factory=list)

    def front(self) -> list[Candidate]:
        """Those that no other beats in tracking error, torque peak and Ms at once, best tracking first."""
        good = [c for c in self.tried if c.score.ok]
        table = np.array([[c.score.tracking_percent, c.score.peak_percent, c.ms] for c in good]).reshape(-1, 3)
        no_worse = np.all(table[:, None, :] <= table[None, :, :], axis=-1)
        better = np.any(table[:, None, :] < table[None, :, :], axis=-1)
        beaten = np.any(no_worse & better, axis=0)
        return sorted((c for c, b in zip(good, beaten, strict=True) if not b), key=lambda c: c.score.tracking_percent)


def tune(
    machine: Machine,
    base: Settings,
    points: Sequence[OperatingPoint],
    trial: Trial,
    goal: Goal,
    weights: Weights = Weights(),
    *,
    effects: Effects = NO_EFFECTS,
    also: Collection[str] = (),
    tell: Callable[[TuneProgress], object] = lambda progress: None,
) -> Tuned:
    """Gains for a goal; `base` gives all settings but the gains, the set-point weight and what is `also` tuned.

    points: the family whose margins count. The machine's own effects are at work in the family and
    in the trial's runs, `effects` beside them in the family only; the trial's events in its runs. also: notch, shaper
    or schedule. A notch is chosen for the largest ki, a shaper for the least cost, a schedule has a tuning a payload.
    tell: hears each step before it is taken; what it raises ends the tuning. InputError where the goal cannot be met.
    """
    if "schedule" in also or getattr(base, "gain_schedule", None):
        return _scheduled(machine, base, points, trial, goal, weights, effects, set(also) - {"schedule"}, tell)
    tell(TuneProgress("shaping the loop", 0))
    search = make_search(machine, base, points, effects=effects)
    compared: list[Alternative] = []
    if "notch" in also:
        base, search, compared = _with_notch(search, base, goal)
    shaped = shape_loop(search, goal)
    start = _with(base, np.array([shaped.kp, shaped.ki, base.set_point_weight]))
    tell(TuneProgress("simulating the shaped gains", 1))
    (first,) = try_out(trial, [start])
    if not first.ok:
        raise InputError(
            "the trial's moves fail under the shaped gains: a load too heavy for the drive, or moves beyond its "
            "limits; try lighter payloads or a scenario with slower moves",
            place="payloads",
        )
    begun = Candidate(start, shaped.ms, shaped.bandwidth_hz, first, 1.0)
    tried = [begun]

    def add(points_: Array) -> None:
        gains = _gains(points_, search, goal, shaped)
        settings = [_with(base, x) for x in gains[_allowed(gains, search, goal, shaped)][:KEPT]]
        known = {c.settings for c in tried}
        settings = [s for s in dict.fromkeys(settings) if s not in known]
        if not settings:
            return
        judged = search.judge(np.array([s.kp for s in settings]), np.array([s.ki for s in settings]))
        for s, ms, hz, score in zip(settings, judged.ms, judged.bandwidth_hz, try_out(trial, settings), strict=True):
            tried.append(Candidate(s, float(ms), float(hz), score, weights.cost(score, first)))
            places[s] = _place(s, float(hz), goal, shaped)

    places = {start: _place(start, shaped.bandwidth_hz, goal, shaped)}
    tell(TuneProgress("simulating candidates", 2, 1))
    from scipy.stats import qmc

    add(np.asarray(qmc.Sobol(3, seed=SEED).random(DRAWN)))
    size = 0.2
    for round_ in range(ROUNDS):
        tell(TuneProgress("simulating candidates near the best", 3 + round_, len(tried), min(c.cost for c in tried)))
        at = places[min(tried, key=lambda c: c.cost).settings]
        steps = size * np.kron(np.eye(3), np.array([[-1.0], [-0.5], [0.5], [1.0]]))
        add(np.clip(at + steps, 0.0, 1.0))
        size *= 0.5
    tell(TuneProgress("checking the winner's margins", 3 + ROUNDS, len(tried), min(c.cost for c in tried)))
    for winner in sorted(tried, key=lambda c: c.cost):
        members = family(machine, winner.settings, points, effects=effects)
        # The search saw Ms on its grid only; the winner keeps to the bound by its exact margins.
        if all(m.margins.stable and m.margins.ms <= goal.ms_limit for m in members):
            if "shaper" in also:
                winner, shapers = _with_shaper(search, winner, trial, weights, first)
                compared += shapers
            return Tuned(goal, begun, winner, tried, shaped.attainable_hz, members, compared)
    raise InputError(f"{goal.ms_limit:g}: no candidate keeps to it; try a number further above 1", place="ms")


def shape_loop(search: Search, goal: Goal) -> Shaped:
    """The gains of the goal with the largest ki. InputError where there are none."""
    if goal.bandwidth_hz is None:
        return best_rejection(search, goal.ms_limit)
    return for_bandwidth(search, goal.bandwidth_hz, goal.ms_limit)


def _with_notch(search: Search, base: Settings, goal: Goal) -> tuple[Settings, Search, list[Alternative]]:
    """Settings and search with the notch, of those at the load's swings and the loop's own one, that allows the largest
    ki; none where none helps."""
    swings: list[float] = []
    for hz in sorted([*search.resonances_hz, *(zero.frequency_hz for zeros in search.zeros for zero in zeros)]):
        if not swings or hz > 1.05 * swings[-1]:
            swings.append(hz)
    fit = [hz for hz in swings if hz < 0.4 / base.sample_time_s]
    notches = [Notch(frequency_hz=float(f"{hz:.3g}"), depth=depth) for hz in fit for depth in NOTCH_DEPTHS]
    found: list[tuple[float, Settings, Search]] = []
    compared: list[Alternative] = []
    for notch in dict.fromkeys([None, base.notch, *notches]):
        settings, own = base.model_copy(update={"notch": notch}), search.with_notch(base.notch, notch)
        try:
            ki = shape_loop(own, goal).ki
        except InputError:  # this notch leaves no gains for the goal
            continue
        found.append((ki, settings, own))
        compared.append(Alternative("notch", notch, ki))
    if not found:
        shape_loop(search, goal)  # says why
    _, settings, own = max(found, key=lambda one: one[0])
    return settings, own, compared


def _with_shaper(
    search: Search, winner: Candidate, trial: Trial, weights: Weights, first: Score
) -> tuple[Candidate, list[Alternative]]:
    """The winner with the shaper, of three at the swings under a held drive, that costs least; none where none does."""
    swings = {float(f"{z.frequency_hz:.3g}"): z for zeros in search.zeros for z in zeros}
    shapers = [
        InputShaper(kind=kind, frequency_hz=hz, damping=float(f"{zero.damping:.3g}"))
        for hz, zero in swings.items()
        for kind in ("zv", "zvd", "ei")
    ]
    options = [None, *shapers]
    settings = [winner.settings.model_copy(update={"input_shaper": shaper}) for shaper in options]
    scores = try_out(trial, settings)
    costs = [weights.cost(score, first) for score in scores]
    k = int(np.argmin(costs))
    compared = [Alternative("shaper", shaper, cost) for shaper, cost in zip(options, costs, strict=True)]
    return replace(winner, settings=settings[k], score=scores[k], cost=costs[k]), compared


def _scheduled(
    machine: Machine, base: Settings, points: Sequence[OperatingPoint], trial: Trial, goal: Goal, weights: Weights,
    effects: Effects, also: Collection[str], tell: Callable[[TuneProgress], object],
) -> Tuned:  # fmt: skip
    """A tuning for each payload; then, of their set-point weights, the one of the least cost over all."""
    if not kind_of(machine).payload:
        raise InputError("this machine carries no payload to schedule the gains over", place="also")
    if also:
        raise InputError(f"a schedule is tuned without {' and '.join(sorted(also))}; give one of them", place="also")
    plain = base.model_copy(update={"gain_schedule": None})
    parts: list[Tuned] = []
    loads = sorted({point.payload_kg for point in points})
    for load in loads:
        own, runs = [point for point in points if point.payload_kg == load], replace(trial, payloads_kg=(load,))
        parts.append(tune(machine, plain, own, runs, goal, weights, effects=effects, tell=tell))

    def scheduled(gains: Sequence[Settings], weight: float) -> Settings:
        rows = [
            ScheduledGains(payload_kg=load, kp_nm_s_per_rad=s.kp, ki_nm_per_rad=s.ki)
            for load, s in zip(loads, gains, strict=True)
        ]
        return gains[0].model_copy(update={"set_point_weight": weight, "gain_schedule": tuple(rows)})

    shaped = scheduled([part.shaped.settings for part in parts], base.set_point_weight)
    best = [part.winner.settings for part in parts]
    settings = [shaped, *(scheduled(best, weight) for weight in sorted({s.set_point_weight for s in best}))]
    scores, tried = try_out(trial, settings), []
    for k, (s, score) in enumerate(zip(settings, scores, strict=True)):
        of = [part.winner if k else part.shaped for part in parts]
        ms, hz = max(c.ms for c in of), min(c.bandwidth_hz for c in of)
        tried.append(Candidate(s, ms, hz, score, weights.cost(score, scores[0])))
    winner = min(tried[1:], key=lambda candidate: candidate.cost)
    members = family(machine, winner.settings, points, effects=effects)
    return Tuned(goal, tried[0], winner, tried, min(part.attainable_hz for part in parts), members)


def _with(base: Settings, x: Array) -> Settings:
    """The settings with (kp, ki, set-point weight), to five digits: what is written is what was judged."""
    kp, ki, b = (float(f"{value:.5g}") for value in x)
    return base.model_copy(update={base.GAINS[0]: kp, base.GAINS[1]: ki, "set_point_weight": b})


def _gains(unit: Array, search: Search, goal: Goal, shaped: Shaped) -> Array:
    """Points of the unit cube as (kp, ki, set-point weight), so that each coordinate keeps to what was asked for.

    With a bandwidth: the bandwidth within its room, ki/kp below the shaped one, which is the largest.
    For rejection: ki within its room, kp around the shaped one.
    """
    if goal.bandwidth_hz is None:
        ki = shaped.ki * (GIVEN_AWAY + (1.0 - GIVEN_AWAY) * unit[:, 0])
        kp = shaped.kp * np.exp(KP_ROOM * (2.0 * unit[:, 1] - 1.0))
    else:
        ratio = shaped.ki / shaped.kp * np.exp(-RATIO_ROOM * (1.0 - unit[:, 1]))
        kp = kp_for(search, goal.bandwidth_hz * WIDER ** unit[:, 0], ratio)
        ki = kp * ratio
    return np.column_stack([kp, ki, unit[:, 2]])


def _place(settings: Settings, bandwidth_hz: float, goal: Goal, shaped: Shaped) -> Array:
    """Where in the unit cube gains stand; the inverse of `_gains`."""
    kp, ki, b = settings.kp, settings.ki, settings.set_point_weight
    if goal.bandwidth_hz is None:
        at = [(ki / shaped.ki - GIVEN_AWAY) / (1.0 - GIVEN_AWAY), 0.5 + 0.5 * math.log(kp / shaped.kp) / KP_ROOM, b]
    else:
        part = math.log(bandwidth_hz / goal.bandwidth_hz) / math.log(WIDER)
        at = [part, 1.0 + math.log(ki / kp * shaped.kp / shaped.ki) / RATIO_ROOM, b]
    return np.clip(np.array(at), 0.0, 1.0)


def _allowed(gains: Array, search: Search, goal: Goal, shaped: Shaped) -> np.ndarray:
    """Those that keep to the bound on Ms and to what was asked for."""
    judged = search.judge(gains[:, 0], gains[:, 1])
    good = judged.stable & (judged.ms <= goal.ms_limit * NEAR)
    if goal.bandwidth_hz is not None:
        rounding = 1.001
        good &= (judged.bandwidth_hz >= goal.bandwidth_hz / rounding) & (judged.mt <= NEAR * goal.ms_limit)
        good &= judged.bandwidth_hz <= goal.bandwidth_hz * WIDER * rounding
    return np.asarray(good)
