"""Doubts about runs that can be read and may still be wrong: against physics, and against the other runs.

Each run is compared with a rigid machine,

    input = hold + inertia · acceleration + friction · sign(speed) + slope · speed

fitted by least squares to the run for itself, all signals smoothed alike by a Gaussian of SMOOTH of the run's duration.
Effects that a machine has show in all of its runs; one run that stands alone among runs which agree is a doubt. What
two runs have in common with none of the others, and what all runs share, is left to the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from workbench.core.names import unit_of
from workbench.core.numbers import figures
from workbench.core.run import Array, Run
from workbench.logs.raw_run import seconds, smoothed
from workbench.machines import Kind, Machine, RigidBody, kind_of
from workbench.machines.declare import RESTS_BELOW

LEAST_RUNS = 4  # of which one may stand alone
SMOOTH = 0.003  # of a run's duration: one standard deviation
MOVING = 0.02  # of a run's largest speed
ONE_WAY = 0.1  # of the moving samples
LOOK_S, LOOK = 3.0, 0.1  # a delay is looked for up to so long, and so much of a run
LATE_S = 0.4  # more than a sensor or a bus
CLEARLY = 0.1  # of correlation
LIKE, UNLIKE = 0.85, 0.7  # correlation of the input with what the motion takes: in the other runs, in a doubtful one
LOADS_APART, MANY_LOADS_APART, MANY_RUNS = 0.05, 0.02, 5  # of the load that is held; with so many others
SCATTER = 4.0  # times what the others are off among themselves
LIKE_SPEED = 2.0  # factor: friction of an axis that moves much slower is another one
EXCESS_APART = 0.1  # of an axis' input, rms
RIGID = 0.95  # of an axis' input that a rigid machine explains; below it an axis tells nothing here
GAINS_APART, GAINS_ALIKE = 1.22, 1.15  # of one run, among the others
NOISES_APART = 3.0
STEPS_APART = 0.02
# Of one log over another's, as recorders have.
RATES = (1.0, 2.0, 2.5, 3.0, 4.0, 5.0, 8.0, 10.0, 16.0, 20.0, 50.0, 100.0)
BESIDE = 4  # samples either side of a break
BROKEN, SOUND = 7.0, 3.5  # times the noise of a break, and what other runs may have before it takes more
MOSTLY = 0.5  # of a channel's samples, or of its changes
ROWS = 10  # that are the same in two places: no noisy log repeats itself
OFF_START = 0.2  # m or rad between the stated and the logged start


@dataclass(frozen=True)
class Seen:
    """A run as a rigid machine shows it.

    excess: input that it holds beyond the nominal load; explained: share of the input's variance; top: the largest
    speed; both_ways: whether the run moves either way. columns, y: of the fit, at moving samples. motion: what the
    nominal inertia takes, the sign of the speed and the input at all samples, and their step, s.
    """

    run: Run
    body: RigidBody
    excess: float
    explained: float
    top: float
    friction: float
    both_ways: bool
    columns: Array
    y: Array
    motion: tuple[Array, Array, Array, float]


def doubts_of(machine: Machine, runs: Sequence[Run]) -> list[str]:
    """Notes, each with its reason and what to check; [] for runs that agree with each other and with physics."""
    kind = kind_of(machine)
    seen = [s for run in runs if (s := _seen(kind, kind.rigid(machine, run.payload_kg), run)) is not None]
    seen = [s for s in seen if s.top > RESTS_BELOW * max(other.top for other in seen)]
    if not kind.holds_load:
        top = float(np.median([s.top for s in seen])) if seen else 0.0
        seen = [s for s in seen if top / LIKE_SPEED < s.top < top * LIKE_SPEED]
    notes = [*_late(kind, seen), *(_loads(machine, kind, seen) if kind.holds_load else _gains(kind, seen))]
    for check in (_equal_channels, _copied_rows, _kept, _sampling, _noise, _jumps, _starts):
        notes += check(kind, runs)
    return notes


def _seen(kind: Kind, body: RigidBody, run: Run) -> Seen | None:
    """None for a run that hardly moves."""
    position, name = kind.plant.positions[0], kind.plant.speeds[0]
    raw = run[name] if name in run else np.gradient(run[position], run.time_s)
    width_s = SMOOTH * run.duration_s
    step_s = max(run.sample_time_s, width_s / 6.0)
    at_s = np.arange(run.time_s[0], run.time_s[-1], step_s)

    def smooth(values: Array) -> Array:
        return np.interp(at_s, run.time_s, smoothed(values, width_s / run.sample_time_s))

    y, speed = smooth(run[kind.plant.input]), smooth(raw)
    largest = float(np.percentile(np.abs(speed), 99.0))
    moving = np.abs(speed) > MOVING * largest
    if largest == 0.0 or np.count_nonzero(moving) < 20 or np.ptp(y[moving]) == 0.0:
        return None
    sign = smoothed(np.clip(speed / (MOVING * largest), -1.0, 1.0), width_s / step_s)
    columns = [np.ones_like(speed), body.inertia * np.gradient(speed, at_s), sign, speed / largest]
    if body.wave and position in run:
        angle = smooth(run[position])
        columns += [np.sin(angle), np.cos(angle)]
    x = np.stack(columns, axis=1)
    values = np.linalg.lstsq(x[moving], y[moving], rcond=1e-8)[0]
    left = float(np.var(y[moving] - x[moving] @ values)) / float(np.var(y[moving]))
    excess, friction = float(values[0]) - body.hold, float(values[2])
    up = float(np.mean(speed[moving] > 0.0))
    both_ways = ONE_WAY < up < 1.0 - ONE_WAY
    motion = (x[:, 1], sign, y, step_s)
    return Seen(run, body, excess, 1.0 - left, largest, friction, both_ways, x[moving], y[moving], motion)


def _lag(s: Seen, friction: float) -> tuple[float, float, float]:
    """(time by which the input comes later than the motion takes it, s, their correlation then, and as logged)."""
    accelerating, sign, y, step_s = s.motion
    expected = accelerating + friction * sign
    most = min(int(min(LOOK_S, LOOK * s.run.duration_s) / step_s), len(y) // 4)
    inner = expected[most : len(y) - most] - expected.mean()
    best, now = (-2.0, 0), 0.0
    for k in range(-most, most + 1):
        part = y[most + k : len(y) - most + k] - y.mean()
        size = float(np.sqrt((inner @ inner) * (part @ part)))
        alike = float(inner @ part) / size if size else 0.0
        best, now = max(best, (alike, k)), alike if k == 0 else now
    return best[1] * step_s, best[0], now


def _alone(values: Sequence[float], apart: Callable[[float, float], bool], least: int = LEAST_RUNS) -> int | None:
    """The index of the one value that stands apart from the median of the others, while they agree with theirs."""
    if len(values) < least:
        return None
    far = [i for i, v in enumerate(values) if apart(v, float(np.median([*values[:i], *values[i + 1 :]])))]
    return far[0] if len(far) == 1 else None


def _late(kind: Kind, seen: Sequence[Seen]) -> Iterator[str]:
    """The input against the motion: one comes later, or they do not belong together. Friction is the other runs'."""
    both = []
    for s in seen:
        usual_friction = float(np.median([o.friction for o in seen if o is not s] or [s.friction]))
        own = max(s.friction, 0.0)  # no friction drives: a run that fits better so is not of this motion
        both.append(max((_lag(s, friction) for friction in (own, usual_friction)), key=lambda lag: lag[1]))
    for k, (s, (late_s, alike, logged)) in enumerate(zip(seen, both, strict=True)):
        others = [*both[:k], *both[k + 1 :]]
        like = all(o > LIKE for _, o, _ in others) and (kind.holds_load or len(others) > 1)
        usual = float(np.median([o for o, _, _ in others])) if others else 0.0
        if like and alike > max(LIKE, logged + CLEARLY) and abs(late_s - usual) > LATE_S:
            word = "after" if late_s > usual else "before"
            yield (
                f"{s.run.name}: {kind.plant.input} comes {abs(late_s - usual):.2g} s {word} the motion that it makes; "
                "check the clocks of the two channels"
            )
        elif like and alike < UNLIKE:
            yield (
                f"{s.run.name}: {kind.plant.input} is not the one that this motion takes (correlation {alike:.2f}); "
                "check whether both are of the same run, and in the same order of time"
            )


def _loads(machine: Machine, kind: Kind, seen: Sequence[Seen]) -> Iterator[str]:
    """The load that each run holds, beyond the nominal one, lies on a line over the payload in all runs but one."""
    left = [s for s in seen if s.both_ways]  # else friction counts as load
    found: list[tuple[Seen, float]] = []
    while len(left) >= LEAST_RUNS:
        offs = [(_off_the_line(s, left), s) for s in left]
        off, worst = max(offs, key=lambda one: abs(one[0]) / one[1].body.hold)
        others = [s for s in left if s is not worst]
        scatter = max(abs(_off_the_line(s, others)) for s in others)
        least = LOADS_APART if len(others) < MANY_RUNS else MANY_LOADS_APART
        if abs(off) < max(least * worst.body.hold, SCATTER * scatter):
            break
        found.append((worst, off))
        left.remove(worst)
    else:
        return  # no run stands alone: the diagnosis says what they have in common
    per_kg = kind.rigid(machine, 1.0).hold - kind.rigid(machine, 0.0).hold
    for s, off in found:
        ratio = (s.body.hold + s.excess) / (s.body.hold + s.excess - off)
        text = f"{s.run.name}: {kind.plant.input} holds {figures(abs(off))} {kind.drive.unit} "
        text += f"{'more' if off > 0.0 else 'less'} than the other runs let expect, {ratio:.2f} times as much; "
        text += "check the torque's scale and offset"
        if per_kg > 0.0 and (fits := s.run.payload_kg + off / per_kg) >= 0.0:
            text += f", and payload_kg: {fits:.0f} kg would fit"
        yield text


def _off_the_line(s: Seen, among: Sequence[Seen]) -> float:
    others = [o for o in among if o is not s]
    payload, excess = np.array([o.run.payload_kg for o in others]), np.array([o.excess for o in others])
    if np.ptp(payload) == 0.0:
        return s.excess - float(np.median(excess))
    slope, start = np.polyfit(payload, excess, 1)
    return s.excess - float(start + slope * s.run.payload_kg)


def _gains(kind: Kind, seen: Sequence[Seen]) -> Iterator[str]:
    """An axis' input over what the other runs' parameters predict for its motion, and its mean beside theirs."""
    least = LEAST_RUNS - 1  # a scale shows beside two
    if len(seen) < least or min(s.explained for s in seen) < RIGID:
        return
    gains = [_gain(s, [o for o in seen if o is not s]) for s in seen]
    k = int(np.argmax(np.abs(np.log(gains))))
    others = [o for o in seen if o is not seen[k]]
    alike = all(1.0 / GAINS_ALIKE < _gain(o, [p for p in others if p is not o]) < GAINS_ALIKE for o in others)
    if alike and not 1.0 / GAINS_APART < gains[k] < GAINS_APART:
        yield (
            f"{seen[k].run.name}: {kind.plant.input} is {gains[k]:.2f} times what the other runs' machine takes for "
            "this motion; check the scales of input and motion, and the time's"
        )
        return
    size = float(np.median([np.sqrt(np.mean(s.y**2)) for s in seen]))
    odd = _alone([s.excess for s in seen], lambda v, usual: abs(v - usual) > EXCESS_APART * size, least)
    if odd is not None:
        yield (
            f"{seen[odd].run.name}: {kind.plant.input} is {_off(seen[odd].excess)} {kind.drive.unit} off what its "
            f"motion takes on average, in the other runs {_off(float(np.median([s.excess for s in seen])))}; "
            "check the sensor's offset"
        )


def _off(value: float) -> str:
    return f"{'-' if value < 0.0 else '+'}{figures(abs(value))}" if value else "0"


def _gain(s: Seen, others: Sequence[Seen]) -> float:
    """The input's size over that of the input which the others' parameters predict for its motion."""
    x, y = np.concatenate([o.columns for o in others]), np.concatenate([o.y for o in others])
    predicted = s.columns @ np.linalg.lstsq(x, y, rcond=1e-8)[0]
    return float(np.std(s.y)) / max(float(np.std(predicted)), 1e-300)


def _equal_channels(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """Two motors' torques that are one channel, in a log with noise."""
    for run in runs:
        parts = [run[name] for name in kind.drive.parts if name in run]
        noisy = [p for p in parts if np.count_nonzero(np.diff(p)) > 0.5 * len(p) and _turns(p) > 0.3]
        if len(noisy) > 1 and np.mean(noisy[0] == noisy[1]) > 0.9:
            yield (
                f"{run.name}: {' and '.join(kind.drive.parts)} are the same numbers, noise and all; check whether both "
                "come from one motor: then log their sum, or each for itself"
            )


def _turns(column: Array) -> float:
    steps = np.diff(column)
    return float(np.mean(steps[1:] * steps[:-1] < 0.0)) if len(steps) > 1 else 0.0


def _copied_rows(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """Stretches of noisy rows that are the same, bit for bit, in two places."""
    windows = [_windows(run) for run in runs]
    hashes = np.concatenate([h for h, _ in windows]) if windows else np.empty(0)
    owners = np.concatenate([np.full(len(h), k) for k, (h, _) in enumerate(windows)]) if windows else np.empty(0)
    places = np.concatenate([p for _, p in windows]) if windows else np.empty(0)
    order = np.argsort(hashes, kind="stable")  # of equal ones, the first in the campaign comes first
    again = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
    told: dict[tuple[int, int], tuple[int, int]] = {}  # (run, other run) -> first row, and its double's
    for first, second in zip(order[again], order[again + 1], strict=True):
        pair = int(owners[second]), int(owners[first])
        told[pair] = min(told.get(pair, (len(hashes), 0)), (int(places[second]), int(places[first])))
    for (k, other), (place, at) in sorted(told.items()):
        if k != other and place == at and len(runs[k].time_s) == len(runs[other].time_s):
            continue  # the whole run: `campaign.py` says so
        whose = "its own rows" if other == k else f"the rows of {runs[other].name}"
        yield (
            f"{runs[k].name}: its rows from {seconds(runs[k].time_s[place])} are {whose} from "
            f"{seconds(runs[other].time_s[at])}, noise and all; check how the log was put together"
        )


def _windows(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(hash of ROWS rows, index of the first) of all stretches in which noisy signals go on changing."""
    names = [name for name in sorted(run.signals) if "reference" not in name and _turns(run[name]) > 0.3]
    count = len(run.time_s) - ROWS + 1
    if len(names) < 2 or count < 1:
        return np.empty(0, dtype=np.uint64), np.empty(0, dtype=np.int64)
    rows = np.zeros(len(run.time_s), dtype=np.uint64)
    chance = np.random.default_rng(0)
    with np.errstate(over="ignore"):
        for name in names:
            bits = np.ascontiguousarray(run[name], dtype=np.float64).view(np.uint64)
            bits = (bits ^ (bits >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
            rows = rows * np.uint64(0x9E3779B97F4A7C15) + (bits ^ (bits >> np.uint64(32)))
        hashes = np.zeros(count, dtype=np.uint64)
        changes = np.zeros(count, dtype=np.int64)
        for k in range(ROWS):
            hashes += rows[k : k + count] * np.uint64(chance.integers(1, 2**62) * 2 + 1)
            if k:
                changes += rows[k : k + count] != rows[k - 1 : k - 1 + count]
    lively = np.flatnonzero(changes >= ROWS - 2)
    return hashes[lively], lively


def dead_band(column: Array) -> float:
    """By how much a value must change before its log takes it anew; 0 of a log that takes every sample.

    Such a log repeats most samples and changes by little more than its dead band, or by more, yet not in steps of it as
    a coarse converter does; one that samples seldom changes by anything.
    """
    changes = np.abs(np.diff(column))
    taken = changes[changes > 0.0]
    if len(taken) < ROWS or len(taken) > MOSTLY * len(changes):
        return 0.0
    band = float(np.min(taken))
    steps = taken / band
    coarse = np.mean(np.abs(steps - np.round(steps)) < STEPS_APART) > MOSTLY
    return 0.0 if coarse or band < MOSTLY * float(np.median(taken)) else band


def _kept(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """A log by exception: what a process historian keeps. Of motors that are told of, not of their sum again."""
    told: set[str] = set()
    for name in (*kind.inputs, kind.plant.speeds[0]):
        bands = {run.name: band for run in runs if name in run and (band := dead_band(run[name])) > 0.0}
        if name == kind.plant.input:
            bands = {run: band for run, band in bands.items() if run not in told}
        told |= bands.keys()
        if bands:
            yield (
                f"{', '.join(bands)}: {name} keeps its value until it has changed by more than "
                f"{figures(max(bands.values()))} {unit_of(name)}; such a log by exception hides what is smaller: "
                "log every sample"
            )


def _sampling(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """One run's clock: its sampling step is none that a recorder would have beside the others'."""
    steps = [run.sample_time_s for run in runs]
    k = _alone(steps, lambda v, usual: abs(v / usual - 1.0) > STEPS_APART)
    if k is None:
        return
    usual = float(np.median([*steps[:k], *steps[k + 1 :]]))
    ratio = max(steps[k] / usual, usual / steps[k])
    if min(abs(ratio / rate - 1.0) for rate in RATES) > STEPS_APART:
        yield (
            f"{runs[k].name}: its step is {steps[k]:.4g} s, the other runs' {usual:.4g} s, "
            f"{steps[k] / usual:.4g} times as long; check the time's unit and scale"
        )


def _noise(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """Noise of a channel, from second differences: one run's is not that of the others, and not for its speed: what
    goes slower is quieter, for a ripple and counts go with the way."""
    speed = kind.plant.speeds[0]
    for name in (*kind.inputs, speed):
        having = [run for run in runs if name in run and len(run.time_s) > 50]
        tops = [float(np.max(np.abs(run[speed]))) if speed in run else 0.0 for run in having]
        if name == speed:  # at rest a speed has the noise of its counts alone
            goes = [top > RESTS_BELOW * max(tops) for top in tops]
            having, tops = list(compress(having, goes)), list(compress(tops, goes))
        sizes = [float(np.sqrt(np.mean(np.diff(run[name], 2) ** 2) / 6.0)) for run in having]
        k = _alone(sizes, lambda v, usual: not usual / NOISES_APART <= v <= usual * NOISES_APART)
        if k is None:
            continue
        usual, usual_top = (float(np.median([*of[:k], *of[k + 1 :]])) for of in (sizes, tops))
        if tops[k] > LIKE_SPEED * usual_top if sizes[k] > usual else tops[k] < usual_top / LIKE_SPEED:
            continue
        many = f"{sizes[k] / usual:.2g} times" if usual else "unlike"
        yield f"{having[k].name}: {name} is {many} as noisy as in the other runs; check its sensor, cable and filter"


def _jumps(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """A break in the motion that no machine of this inertia makes: lines through a few samples before and after it do
    not meet. In units of what they miss each other by elsewhere in the run, which is its noise.
    """
    name = kind.plant.speeds[0]
    having = [run for run in runs if name in run and len(run.time_s) > 8 * BESIDE]
    breaks = [_breaks(run[name]) for run in having]
    sizes = [float(size.max()) for size in breaks]
    for k, run in enumerate(having):
        if sizes[k] > BROKEN * max(1.0, max([*sizes[:k], *sizes[k + 1 :]], default=0.0) / SOUND):
            at = int(np.argmax(breaks[k])) + BESIDE
            yield (
                f"{run.name}: {name} breaks at {seconds(run.time_s[at])}, {figures(sizes[k], 2)} times its noise "
                "between lines through the samples before and after; check whether rows are missing, replaced or out "
                "of order there"
            )


def _breaks(column: Array) -> Array:
    """(n - 2 BESIDE + 1,) between samples i + BESIDE - 1 and i + BESIDE, half a step from either."""
    t = np.arange(BESIDE) - 0.5 * (BESIDE - 1)
    mean = np.convolve(column, np.full(BESIDE, 1.0 / BESIDE), mode="valid")
    way = np.convolve(column, t[::-1] / (t @ t), mode="valid") * 0.5 * BESIDE
    apart = np.abs((mean - way)[BESIDE:] - (mean + way)[:-BESIDE])
    moved = apart[apart > 1e-9 * np.max(apart)]  # a machine that stands for most of a run has no noise there
    return np.asarray(apart / (1.4826 * float(np.median(moved))) if len(moved) else apart)


def _starts(kind: Kind, runs: Sequence[Run]) -> Iterator[str]:
    """The stated start against the logged position: runs differ by one offset of the sensor at most."""
    name = kind.plant.positions[kind.plant.placed]
    having = [run for run in runs if name in run]
    offs = [float(run[name][0]) - run.start_position_m for run in having]
    k = _alone(offs, lambda v, usual: abs(v - usual) > OFF_START) if kind.start is not None else None
    if k is not None:
        yield (
            f"{having[k].name}: {name} begins at {having[k][name][0]:.4g} m, runs.yaml says "
            f"{having[k].start_position_m:g} m; check start_position_m"
        )
