"""Several moves in a row, with dwells, planned once and sampled at a controller's times; and one that is cut short."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, integrated, stretches
from workbench.machines import Load
from workbench.references.kind import Move, PlannedKind, Ramp, planned_kind
from workbench.references.shape import LimitPair, Limits, Shape, Step


@dataclass(frozen=True)
class Profile:
    """A reference of the carriage at a controller's sample times.

    time_s, position_m, speed_m_s, acceleration_m_s2: (n,), up positive. move_windows: start and
    end of each move (s). move_limits: the limits used for each move.
    """

    kind: str
    time_s: Array
    position_m: Array
    speed_m_s: Array
    acceleration_m_s2: Array
    move_windows: tuple[tuple[float, float], ...]
    move_limits: tuple[Limits, ...]


class Sampling:
    """Of every plan: its profile at a controller's samples."""

    def times(self: Any, sample_time_s: float, duration_s: float | None = None) -> Array:
        """0, T, 2T, … up to the end of the plan, or to a longer `duration_s`."""
        if not (math.isfinite(sample_time_s) and sample_time_s > 0.0):
            raise InputError(f"{sample_time_s:g} s, expected a positive time", place="sample_time_s")
        # The small number keeps 49.76 s / 0.001 s from growing a sample by rounding.
        samples = math.ceil(max(self.duration_s, duration_s or 0.0) / sample_time_s - 1e-9) + 1
        return np.arange(samples, dtype=np.float64) * np.float64(sample_time_s)

    def sample(self: Any, sample_time_s: float, duration_s: float | None = None) -> Profile:
        """The profile at these times; held at rest after its end."""
        time_s = self.times(sample_time_s, duration_s)
        position, speed, acceleration = self.at(time_s)
        return Profile(self.kind, time_s, position, speed, acceleration, self.move_windows, self.move_limits)

    def speed_at(self: Any, time_s: Array) -> Array:
        """The speed of `at` alone."""
        return self.at(time_s)[1]


@dataclass(frozen=True, eq=False)
class MotionPlan(Sampling):
    """Moves at their start times: exact, not yet sampled."""

    kind: str
    start_position_m: float
    moves: tuple[tuple[float, Shape], ...]
    duration_s: float

    @property
    def end_position_m(self) -> float:
        return self.start_position_m + sum(shape.distance_m for _, shape in self.moves)

    @property
    def move_windows(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each move (s). Jogs that go on into one another are one move."""
        windows: list[tuple[float, float]] = []
        going_on = False
        for start, shape in self.moves:
            first = windows.pop()[0] if going_on else start
            windows.append((first, start + shape.duration_s))
            going_on = shape.end_speed_m_s != 0.0
        return tuple(windows)

    @property
    def move_limits(self) -> tuple[Limits, ...]:
        return tuple(shape.limits for _, shape in self.moves)

    @property
    def acceleration_m_s2(self) -> float:
        """The largest acceleration limit that a move was planned with."""
        return max(shape.limits.acceleration_m_s2 for _, shape in self.moves)

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Height (m), speed (m/s) and acceleration (m/s²) at rising times (s)."""
        position = np.full(time_s.shape, self.start_position_m)
        speed, acceleration = np.zeros_like(time_s), np.zeros_like(time_s)
        for start_s, shape in self.moves:
            shape.add_to(time_s - start_s, position, speed, acceleration)
        return position, speed, acceleration

    def speed_at(self, time_s: Array) -> Array:
        """The speed of `at` alone, quicker."""
        speed = np.zeros_like(time_s)
        for start_s, shape in self.moves:
            shape.add_alone(1, time_s - start_s, speed)
        return speed


def plan_motion(
    kind: str,
    steps: Sequence[Step],
    start_position_m: float,
    limits: Limits | LimitPair,
    rail_m: tuple[float, float],
    lead_s: float = 0.0,
    settle_s: float = 0.0,
    load: Load | None = None,
) -> MotionPlan:
    """Plan the steps one after the other, at rest for `lead_s` before and `settle_s` after.

    kind: the name of a planned kind. limits: the same both ways, or a pair. rail_m: lowest and highest carriage
    height. load: what a kind that knows its machine is planned for. Raises InputError for an unknown kind, a list
    without a move, a move of 0 m, a start or a move that leaves the rail, a jog that its limits or its time do not
    allow; `place` names the step.
    """
    declared, pair = planned_kind(kind), LimitPair.of(limits)
    moves: list[tuple[float, Shape]] = []
    now, here, speed = lead_s, start_position_m, 0.0
    for number, step, distance in _walk(steps, start_position_m, rail_m):
        place = f"moves[{number}]"
        if step.dwell_s is not None:
            now += step.dwell_s
        elif distance is not None:
            moves.append((now, move_shape(declared, distance, pair.towards(distance), load)))
            now += moves[-1][1].duration_s
            here += distance
        else:
            shape = _jog(declared, speed, step, pair, place, load)
            moves.append((now, shape))
            _stays_on_rail(shape, here, rail_m, place)
            now += step.for_s or 0.0
            here, speed = here + shape.distance_m, shape.end_speed_m_s
    return MotionPlan(kind, start_position_m, tuple(moves), now + settle_s)


def motion_time_s(
    kinds: Sequence[str], steps: Sequence[Step], start_position_m: float, limits: Limits | LimitPair,
    rail_m: tuple[float, float], load: Load | None = None,
) -> float:  # fmt: skip
    """What the steps take with the slowest of the kinds, without the shapes.

    Raises InputError as `plan_motion` does; of jogs only their times are looked at.
    """
    pair, now = LimitPair.of(limits), 0.0
    declared = [planned_kind(kind) for kind in kinds]
    for _, step, distance in _walk(steps, start_position_m, rail_m):
        now += step.dwell_s or step.for_s or 0.0
        if distance is not None:
            now += max(move_time_s(kind, distance, pair.towards(distance), load) for kind in declared)
    return now


def _walk(
    steps: Sequence[Step], start_position_m: float, rail_m: tuple[float, float]
) -> Iterator[tuple[int, Step, float | None]]:
    """Each step with its number and, for a move from rest to rest, its distance (m), checked against the rail.

    After a jog the height depends on the limits; `to_m` there is an error, `by_m` is checked by its length only.
    """
    low, high = rail_m
    if not low <= start_position_m <= high:
        said = f"{start_position_m:g} m is off the rail, which reaches from {low:g} m to {high:g} m"
        raise InputError(said, place="start_position_m")
    here: float | None = start_position_m
    speed, moved = 0.0, False
    for number, step in enumerate(steps):
        place = f"moves[{number}]"
        distance = None
        if step.speed_m_s is not None:
            if speed == step.speed_m_s == 0.0:
                raise InputError("a jog at 0 m/s from rest; dwell_s says that", place=place)
            speed, here, moved = step.speed_m_s, None, True
        elif speed != 0.0:
            said = f"comes while the carriage goes at {speed:g} m/s; a jog ends with {{speed_m_s: 0, for_s: …}}"
            raise InputError(said, place=place)
        elif step.dwell_s is None:
            distance, here = _distance(step, here, rail_m, place)
            moved = True
        yield number, step, distance
    if not moved:
        raise InputError("no move in the list, expected at least one by_m, to_m or speed_m_s", place="moves")
    if speed != 0.0:
        said = f"end at {speed:g} m/s; expected a last jog {{speed_m_s: 0, for_s: …}} to come to rest"
        raise InputError(said, place="moves")


def _distance(step: Step, here: float | None, rail_m: tuple[float, float], place: str) -> tuple[float, float | None]:
    low, high = rail_m
    if here is None:  # after a jog
        if step.by_m is None:
            raise InputError("to_m after a jog, whose end is known only when it is planned; go by_m", place=place)
        distance, target = step.by_m, None
        if abs(distance) > high - low:
            raise InputError(f"goes {distance:g} m on a rail of {high - low:g} m", place=place)
    else:
        target = step.to_m if step.to_m is not None else here + (step.by_m or 0.0)
        distance = target - here
        # Sums of decimal distances may end a rounding error above the rail's end.
        if not low - 1e-9 <= target <= high + 1e-9:
            raise InputError(
                f"goes from {here:g} m to {target:g} m and leaves the rail, which reaches from {low:g} m to {high:g} m",
                place=place,
            )
    if abs(distance) < 1e-9:
        raise InputError("a move of 0 m; leave it out or dwell", place=place)
    return distance, target


def move_shape(kind: PlannedKind, distance_m: float, limits: Limits, load: Load | None = None) -> Shape:
    """The shape of a move from rest to rest. InputError for limits that do not allow it."""
    kind.check(limits, load)
    time_s = math.nan
    if kind.same_time_as:
        time_s = move_shape(planned_kind(kind.same_time_as), distance_m, limits).duration_s
    return kind.move(Move(distance_m, limits, time_s, load))


def move_time_s(kind: PlannedKind, distance_m: float, limits: Limits, load: Load | None = None) -> float:
    """What a move takes, without its shape where the kind knows that. InputError as for the shape."""
    kind.check(limits, load)
    if kind.duration is not None:
        return kind.duration(Move(distance_m, limits, load=load))
    if kind.same_time_as:
        return move_time_s(planned_kind(kind.same_time_as), distance_m, limits)
    return move_shape(kind, distance_m, limits, load).duration_s


def ramp_shape(
    kind: PlannedKind, speed_m_s: float, next_speed_m_s: float, limits: Limits, load: Load | None = None
) -> Shape:
    """The shape of a change of speed. InputError for limits that do not allow it."""
    kind.check(limits, load)
    time_s = math.nan
    if kind.same_time_as:
        time_s = ramp_shape(planned_kind(kind.same_time_as), speed_m_s, next_speed_m_s, limits).duration_s
    return kind.ramp(Ramp(speed_m_s, next_speed_m_s, limits, time_s, load))


def _jog(kind: PlannedKind, speed: float, step: Step, pair: LimitPair, place: str, load: Load | None) -> Shape:
    """From one speed over to the next, then on at it until `for_s` is over; over to rest, it ends with its ramp."""
    assert step.speed_m_s is not None and step.for_s is not None
    most = pair.towards(step.speed_m_s).speed_m_s
    if abs(step.speed_m_s) > most * (1.0 + 1e-9):
        raise InputError(f"{step.speed_m_s:g} m/s, the limit is {most:g} m/s that way", place=place)
    try:
        ramp = ramp_shape(kind, speed, step.speed_m_s, pair.between(speed, step.speed_m_s), load)
        if ramp.duration_s > step.for_s * (1.0 + 1e-9):
            raise InputError(
                f"from {speed:g} m/s to {step.speed_m_s:g} m/s takes {ramp.duration_s:.3g} s within the limits, "
                f"for_s gives {step.for_s:g} s"
            )
    except InputError as error:
        raise InputError(error.problem, place=error.place or place) from error
    return ramp.held(step.for_s)


def _stays_on_rail(shape: Shape, here: float, rail_m: tuple[float, float], place: str) -> None:
    """A jog may turn round on its way, so its whole path counts."""
    path = here + shape.at(np.linspace(0.0, shape.duration_s, 201))[0]
    low, high = float(path.min()), float(path.max())
    if low < rail_m[0] - 1e-9 or high > rail_m[1] + 1e-9:
        raise InputError(
            f"goes from {here:g} m to {low if low < rail_m[0] else high:.4g} m and leaves the rail, which reaches "
            f"from {rail_m[0]:g} m to {rail_m[1]:g} m",
            place=place,
        )


@dataclass(frozen=True, eq=False)
class StoppedPlan(Sampling):
    """A plan up to `stop_s`; from then on its speed falls by `deceleration_m_s2` (positive) to rest, and stays there.

    The jerk of a stop is not limited. After `stop_s` the plan's own motion does not count.
    """

    plan: Plan
    stop_s: float
    deceleration_m_s2: float

    @property
    def kind(self) -> str:
        return self.plan.kind

    @property
    def start_position_m(self) -> float:
        return self.plan.start_position_m

    @cached_property
    def _at_stop(self) -> tuple[float, float]:
        """Height (m) and speed (m/s) at which the stop begins."""
        position, speed, _ = self.plan.at(np.array([self.stop_s]))
        return float(position[0]), float(speed[0])

    @property
    def rest_s(self) -> float:
        """When the carriage is asked to be at rest."""
        return self.stop_s + abs(self._at_stop[1]) / self.deceleration_m_s2

    @property
    def end_position_m(self) -> float:
        position, speed = self._at_stop
        return position + speed * abs(speed) / (2.0 * self.deceleration_m_s2)

    @property
    def duration_s(self) -> float:
        return max(self.plan.duration_s, self.rest_s)

    @property
    def move_windows(self) -> tuple[tuple[float, float], ...]:
        """Those of the plan, as far as the stop lets them go."""
        begun = [(start, end) for start, end in self.plan.move_windows if start < self.stop_s]
        return tuple((start, end if end <= self.stop_s else self.rest_s) for start, end in begun)

    @property
    def move_limits(self) -> tuple[Limits, ...]:
        return self.plan.move_limits

    @property
    def acceleration_m_s2(self) -> float:
        return max(self.plan.acceleration_m_s2, self.deceleration_m_s2)

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Height (m), speed (m/s) and acceleration (m/s²) at rising times (s)."""
        before = self.plan.at(time_s)
        position, speed = self._at_stop
        since = np.clip(time_s - self.stop_s, 0.0, self.rest_s - self.stop_s)
        braking = -np.sign(speed) * self.deceleration_m_s2
        stopping = (
            position + since * (speed + 0.5 * braking * since),
            np.where(time_s < self.rest_s, speed + braking * since, 0.0),
            np.where(time_s < self.rest_s, braking, 0.0),
        )
        late = time_s >= self.stop_s
        p, v, a = (np.where(late, after, old) for after, old in zip(stopping, before, strict=True))
        return p, v, a


# References that were recorded: a campaign's set-point as it was, or smoothed to an S-curve.


# Below this part of its largest speed a set-point is at rest.
AT_REST = 0.01
# A run that begins or ends faster than this part of its largest speed was cut out of a motion.
CUT = 0.05
# A shorter average (s) is the difference of two almost equal numbers, and smooths nothing.
SHORTEST = 0.001


@dataclass(frozen=True, eq=False)
class RecordedPlan(Sampling):
    """A recorded speed of the carriage, followed again.

    time_s, speed_recorded_m_s: (n,), up positive, any sampling; linear in between, at rest before and
    after. start_position_m: the height it starts from. lead_s, settle_s: at rest before and after.

    smoothing_s: 0 follows the set-point as it is. Above 0 it is a moving average over that
    time T, of the samples up to now:

        v(t) = 1/T · ∫ v_recorded(τ) dτ   over t − T … t

    A ramp of acceleration a becomes an S-curve of jerk a/T; nothing overshoots, the distance is the
    recorded one to the last millimetre, and the motion is T longer and on average T/2 late.

    Raises InputError for a record that is cut out of a motion, stands still throughout or leaves the rail.
    """

    kind: str
    time_s: Array
    speed_recorded_m_s: Array
    start_position_m: float
    rail_m: tuple[float, float]
    lead_s: float = 0.0
    settle_s: float = 0.0
    smoothing_s: float = 0.0
    move_limits: tuple[Limits, ...] = ()

    def __post_init__(self) -> None:
        speed, low, high = self.speed_recorded_m_s, *self.rail_m
        if not (self.smoothing_s == 0.0 or SHORTEST <= self.smoothing_s < math.inf):
            raise InputError(f"{self.smoothing_s:g} s, expected 0 or at least {SHORTEST:g} s", place="smoothing_s")
        top = float(np.abs(speed).max())
        if not (math.isfinite(top) and top > 0.0):
            raise InputError("the recorded reference stands still throughout or holds no numbers", place="references")
        for end, value in (("begins", float(speed[0])), ("ends", float(speed[-1]))):
            if abs(value) > CUT * top:
                said = f"the recorded reference {end} at {value:.3g} m/s; expected a run that begins and ends at rest"
                raise InputError(said, place="references")
        path = self.start_position_m + self._distance_m
        if path.min() < low - 1e-6 or path.max() > high + 1e-6:
            raise InputError(
                f"the recorded reference goes from {self.start_position_m:g} m to between {path.min():.4g} and "
                f"{path.max():.4g} m and leaves the rail, which reaches from {low:g} m to {high:g} m",
                place="references",
            )

    @cached_property
    def _distance_m(self) -> Array:
        """Travel since the start at each recorded time: the trapezoidal rule is exact for linear pieces."""
        return integrated(self.speed_recorded_m_s, self.time_s)

    def _travel(self, t: Array) -> tuple[Array, Array]:
        """Travel at times t since the record's start, and its integral: polynomials between the recorded times."""
        time, v, way = self.time_s - self.time_s[0], self.speed_recorded_m_s, self._distance_m
        h = np.diff(time)
        slope = np.diff(v) / h
        sums = np.concatenate(([0.0], np.cumsum(h * (way[:-1] + h * (v[:-1] / 2.0 + slope * h / 6.0)))))
        inside = np.clip(t, 0.0, time[-1])
        k = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(h) - 1)
        rest = inside - time[k]
        twice = sums[k] + rest * (way[k] + rest * (v[k] / 2.0 + slope[k] * rest / 6.0))
        return way[k] + rest * (v[k] + 0.5 * slope[k] * rest), twice + np.maximum(t - time[-1], 0.0) * way[-1]

    @property
    def end_position_m(self) -> float:
        return self.start_position_m + float(self._distance_m[-1])

    @property
    def duration_s(self) -> float:
        return self.lead_s + float(self.time_s[-1] - self.time_s[0]) + self.smoothing_s + self.settle_s

    @cached_property
    def move_windows(self) -> tuple[tuple[float, float], ...]:
        """Stretches in motion: from where the set-point leaves 1 % of its largest speed to where it is back."""
        time = self.lead_s + self.time_s - self.time_s[0]
        going = np.abs(self.speed_recorded_m_s) > AT_REST * float(np.abs(self.speed_recorded_m_s).max())
        edges, last = zip(*stretches(going), strict=True), len(time) - 1
        return tuple((float(time[max(a - 1, 0)]), float(time[min(b, last)]) + self.smoothing_s) for a, b in edges)

    @cached_property
    def acceleration_m_s2(self) -> float:
        """The steepest slope of the set-point, as smoothed."""
        step = float(np.median(np.diff(self.time_s)))
        return float(np.abs(self.sample(step).acceleration_m_s2).max())

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Height (m), speed (m/s) and acceleration (m/s², by differences of the times) at rising times (s)."""
        t, width = time_s - self.lead_s, self.smoothing_s
        travel, twice = self._travel(t)
        speed = np.interp(t, self.time_s - self.time_s[0], self.speed_recorded_m_s, left=0.0, right=0.0)
        if width > 0.0:
            travel_then, twice_then = self._travel(t - width)
            travel, speed = (twice - twice_then) / width, (travel - travel_then) / width
        acceleration = np.gradient(speed, time_s) if len(time_s) > 1 else np.zeros_like(speed)
        return self.start_position_m + travel, speed, acceleration


# A motion of what moves that is exact and not yet sampled.
Plan: TypeAlias = MotionPlan | StoppedPlan | RecordedPlan
