"""Checks of samples by themselves: time, missing and infinite ones, spikes, dead and clipped channels; and dropouts:
stretches in which a channel is exactly constant although the measured quantity is not.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run, stretches
from workbench.logs.plausible import MOVING, check_plausible, drop_wrong_scale
from workbench.logs.raw_run import RawRun, is_constant, seconds
from workbench.machines import TIME

MIN_SAMPLES = 10
MIN_DURATION_S = 0.2
MAX_STEP_S = 0.5  # the median step; machines of this kind swing at some hertz
MIN_STEP_S = 2e-6
IRREGULAR = 0.1  # a step that far off the median, relative, makes time irregular
GAP_STEPS = 5.0  # a step of that many medians is a gap
HOLE_S = 1.0  # … and from so long on a hole: the recorder paused
MAX_AVERAGED = 0.01  # share of samples that may carry a repeated stamp with other values
MAX_MISSING = 5  # samples in a row that may be bridged …
MAX_BRIDGE_S = 0.1  # … as long as the samples either side are no farther apart
MAX_SHARE = 0.05  # of a signal's samples that may be missing
MIN_KEPT = 0.5  # of a run that must be left when its end, or what is missing in its middle, is cut off
LEAST_PART = 0.1  # of a run: a shorter stretch between holes is left out
LONGEST = 2  # samples of a spike
LONGEST_S = 0.02  # from the last sample before to the first one after, less a step; slower logs show real peaks
STEPS = 10.0  # times what nearly all steps of the signal keep below …
NEARLY_ALL = 98.0  # … per cent
RANGE = 0.2  # of the range that nearly all samples keep to
MOST = 0.002  # share of the samples: more is how the signal is
_SAMPLED = 200_000  # of the steps, for the percentiles of very long logs
LARGEST = 1e9  # of any signal in SI units; beyond it no sensor measures
MIN_PLATEAU = 5  # samples in a row at the extreme value
MIN_CLIPPED = 10  # samples at the extreme value in all
PLATEAU_RATIO = 3  # … and that many times longer than the signal rests anywhere else


def check_time(run: RawRun) -> None:
    """InputError, naming the row, for time that is missing, infinite, goes backwards or is far too short or coarse."""
    time_s, label = run.time_s, run.label(TIME)
    if len(time_s) < MIN_SAMPLES:
        rows = "only the header" if len(time_s) == 0 else f"{len(time_s)} row{'s' if len(time_s) > 1 else ''}"
        raise run.fault(f"holds {rows}; expected at least {MIN_SAMPLES} samples")
    if not np.isfinite(time_s).all():
        row = int(np.argmin(np.isfinite(time_s)))
        what = "missing" if np.isnan(time_s[row]) else "infinite"
        last = f", after {seconds(time_s[row - 1])}" if row else ""
        raise run.fault(f"{label} is {what} at {run.row_name(row)}{last}")
    steps = np.diff(time_s)
    if not np.isfinite(steps).all():
        raise run.fault(f"{label} spans more than numbers can hold")
    if len(back := np.flatnonzero(steps < 0.0)):
        tail = f", and {len(back) - 1} more times" if len(back) > 1 else ""
        span = f"{seconds(time_s[back[0]])} to {seconds(time_s[back[0] + 1])}"
        raise run.fault(f"{label} goes backwards from {span} at {run.row_name(int(back[0]) + 1)}{tail}")
    if not (steps > 0.0).any():
        raise run.fault(f"{label} stands still at {seconds(time_s[0])}")
    step, duration = float(np.median(steps[steps > 0.0])), float(time_s[-1] - time_s[0])
    if not MIN_STEP_S <= step <= MAX_STEP_S:
        hint = f"at least {MIN_STEP_S:g} s; is it in days or hours?"
        if step > MAX_STEP_S:
            hint = f"at most {MAX_STEP_S} s; if it is in milliseconds, give the column a scale of 0.001"
        raise run.fault(f"{label} has a step of {step:g} s, expected {hint}")
    if duration < MIN_DURATION_S:
        raise run.fault(f"{label} spans {duration:.3g} s, expected at least {MIN_DURATION_S} s")


def refuse_infinite(run: RawRun) -> None:
    for name, column in run.values.items():
        if len(at := np.flatnonzero(np.isinf(column))):
            raise run.fault(f"{run.label(name)} is infinite at {seconds(run.time_s[at[0]])}")


def merge_repeated(run: RawRun) -> None:
    """Strictly rising time. Rows that repeat both stamp and values are dropped; where values
    differ under one stamp their mean stands for that instant, as long as that is rare.
    """
    time_s = run.time_s
    fresh = np.concatenate(([True], np.diff(time_s) > 0.0))
    if fresh.all():
        return
    starts = np.flatnonzero(fresh)
    sizes = np.diff(np.append(starts, len(time_s)))
    differs = np.zeros(len(starts), dtype=bool)
    for name, column in run.values.items():
        present = ~np.isnan(column)
        high = np.maximum.reduceat(np.where(present, column, -np.inf), starts)
        low = np.minimum.reduceat(np.where(present, column, np.inf), starts)
        count = np.add.reduceat(present.astype(np.int64), starts)
        total = np.add.reduceat(np.where(present, column, 0.0), starts)
        other = (count > 0) & (high != low)
        mean = np.divide(total, count, out=np.full(len(starts), np.nan), where=count > 0)
        run.values[name] = np.where(other, mean, np.where(count > 0, high, np.nan))
        differs |= other
    averaged = int((sizes[differs] - 1).sum())
    first = seconds(time_s[starts[differs][0]]) if averaged else ""
    if averaged > MAX_AVERAGED * len(time_s):
        raise run.fault(
            f"{averaged} of {len(time_s)} samples repeat a time stamp with other values, first at {first}; "
            "are the stamps rounded too coarsely?"
        )
    if dropped := len(time_s) - len(starts) - averaged:
        where = seconds(time_s[starts[(sizes > 1) & ~differs][0]])
        run.notes.append(f"{dropped} repeated samples (same time, same values) dropped, first at {where}")
    if averaged:
        run.notes.append(f"{averaged} samples repeat a time stamp with other values, averaged, first at {first}")
    run.time_s = time_s[starts]


def _too_long(time_s: Array, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which stretches of missing samples cannot be bridged, and how far the samples either side are apart, s."""
    before, after = np.maximum(starts - 1, 0), np.minimum(ends, len(time_s) - 1)
    widths = time_s[after] - time_s[before]
    return (ends - starts > MAX_MISSING) | (widths > MAX_BRIDGE_S * (1 + 1e-9)), widths


def whole_stretches(run: RawRun) -> list[tuple[int, int]]:
    """(first, end) of the stretches of a run between holes of its needed signals, or in time, too long to bridge.

    Only stretches of at least LEAST_PART of the run count, and a hole at the run's end is not one; [] where what is
    left is too little of the run, or nothing has to be cut.
    """
    n = len(run.time_s)
    hole = np.zeros(n, dtype=bool)
    for name in run.needed:
        starts, ends = stretches(np.isnan(run.values[name]))
        cut = _too_long(run.time_s, starts, ends)[0] & (ends < n)
        for start, end in zip(starts[cut], ends[cut], strict=True):
            hole[start:end] = True
    steps = np.diff(run.time_s)
    pauses = 1 + np.flatnonzero(steps > max(HOLE_S, GAP_STEPS * float(np.median(steps))))
    if not (hole.any() or len(pauses)):
        return []
    whole = [(int(a), int(b)) for a, b in zip(*stretches(~hole), strict=True)]
    edges = [sorted({a, b, *(int(k) for k in pauses if a < k < b)}) for a, b in whole]
    kept = [part for ends in edges for part in pairwise(ends) if part[1] - part[0] >= LEAST_PART * n]
    return kept if sum(b - a for a, b in kept) >= MIN_KEPT * n else []


def fill_gaps(run: RawRun) -> None:
    """Signals without a missing sample.

    A short gap is bridged by a straight line; a short one at the start takes the first
    value that is there. A needed signal that ends early shortens the run. A longer gap
    is an error in a needed signal; an optional signal is dropped for it.
    """
    needed, n = run.needed, len(run.time_s)
    for name in needed:
        if np.isnan(run.values[name]).all():
            raise run.fault(f"{run.label(name)} holds no numbers at all")
    end = min((int(np.flatnonzero(~np.isnan(run.values[name]))[-1]) + 1 for name in needed), default=n)
    if end < n:
        ended = next(run.label(name) for name in needed if np.isnan(run.values[name][end:]).any())
        text = f"{ended} ends at {seconds(run.time_s[end - 1])}"
        if end < MIN_KEPT * n:
            raise run.fault(f"{text}, the run at {seconds(run.time_s[-1])}")
        run.notes.append(f"{text}; the run's last {n - end} samples are cut off")
        run.cut(0, end)
    time_s = run.time_s
    for name, column in list(run.values.items()):
        missing = np.isnan(column)
        if not (total := int(missing.sum())):
            continue
        starts, ends = stretches(missing)
        long, widths = _too_long(time_s, starts, ends)
        first, problem = seconds(time_s[starts[0]]), ""
        if long.any():
            worst = int(np.argmax(np.where(long, widths, 0.0)))
            span = f"{seconds(time_s[starts[worst]])} to {seconds(time_s[ends[worst] - 1])}"
            allowed = f"at most {MAX_MISSING} within {MAX_BRIDGE_S} s can be bridged"
            problem = f"{ends[worst] - starts[worst]} samples in a row are missing from {span}; {allowed}"
        elif total > MAX_SHARE * len(time_s):
            problem = f"{total} of {len(time_s)} samples are missing, the first at {first}"
        if problem and name in needed:
            raise run.fault(f"{run.label(name)}: {problem}")
        if problem:
            run.drop(name, problem)
            continue
        run.values[name] = np.where(missing, np.interp(time_s, time_s[~missing], column[~missing]), column)
        text = f"{total} missing sample{'s' * (total > 1)} in {len(starts)} gap{'s' * (len(starts) > 1)}"
        run.notes.append(f"{run.label(name)}: {text} bridged by straight lines, first at {first}")


def bridge_spikes(run: RawRun) -> None:
    """Spikes of one or two samples are bridged by straight lines."""
    time_s = run.time_s
    for name, column in list(run.values.items()):
        spikes = find_spikes(time_s, column)
        if not spikes:
            continue
        mended = column.copy()
        for start, end in spikes:
            ends = [start - 1, end]
            mended[start:end] = np.interp(time_s[start:end], time_s[ends], column[ends])
        run.values[name] = mended
        start, count = spikes[0][0], sum(end - start for start, end in spikes)
        run.notes.append(
            f"{run.label(name)}: {count} sample{'s' * (count > 1)} far off the neighbours on both sides bridged by "
            f"straight lines, first {column[start]:.4g} at {seconds(time_s[start])}"
        )


def find_spikes(time_s: Array, column: Array) -> list[tuple[int, int]]:
    """(first sample, one after the last) of each spike; [] if there are so many that they belong to the signal."""
    if len(column) < 10:
        return []
    steps = np.diff(column)
    size = np.abs(steps)
    every = max(1, len(size) // _SAMPLED)
    low, high = np.percentile(column[::every], [2.0, NEARLY_ALL])
    least = max(STEPS * float(np.percentile(size[::every], NEARLY_ALL)), RANGE * float(high - low))
    if not 0.0 < least < np.inf:
        return []
    jumps = np.flatnonzero(size > least)
    if len(jumps) > 2 + 2 * MOST * len(column):
        return []
    spikes: list[tuple[int, int]] = []
    for at, jump in enumerate(jumps[:-1]):
        back = int(jumps[at + 1])
        start, end = int(jump) + 1, back + 1
        if end - start > LONGEST or time_s[back] - time_s[jump] > LONGEST_S * (1.0 + 1e-9):
            continue
        returns = abs(float(column[end] - column[start - 1])) < 0.5 * min(size[jump], size[back])
        if steps[jump] * steps[back] < 0.0 and returns and (not spikes or spikes[-1][1] < start):
            spikes.append((start, end))
    return spikes


def check_sizes(run: RawRun) -> None:
    """An optional signal of impossible size is dropped, a needed one is an error."""
    for name, column in list(run.values.items()):
        largest = max(abs(float(column.min())), abs(float(column.max())))
        problem = f"reaches {largest:.3g}, expected at most {LARGEST:g} in SI units"
        if largest > LARGEST and name in run.needed:
            raise run.fault(f"{run.label(name)} {problem}")
        if largest > LARGEST:
            run.drop(name, f"it {problem}")


def note_time(run: RawRun) -> None:
    """Notes on irregular steps and gaps of a strictly rising time."""
    time_s, steps = run.time_s, np.diff(run.time_s)
    median = float(np.median(steps))
    if steps.max() > (1 + IRREGULAR) * median or steps.min() < (1 - IRREGULAR) * median:
        span = f"from {steps.min():.4g} to {steps.max():.4g} s, median {median:.4g} s"
        run.notes.append(f"time is irregular: steps {span}; kept as is")
    gaps = np.flatnonzero(steps > GAP_STEPS * median)
    if len(gaps):
        longest = gaps[np.argmax(steps[gaps])]
        run.notes.append(
            f"{len(gaps)} gap{'s' * (len(gaps) > 1)} in time, the longest from {seconds(time_s[longest])} "
            f"to {seconds(time_s[longest + 1])}; signals count as straight lines there"
        )


def drop_dead_motion(run: RawRun) -> None:
    """A position (or speed) that is zero throughout is dropped, if both are logged."""
    zero = [name for name in run.motion if not run.values[name].any()]
    if len(run.motion) == 2 and len(zero) == 1:
        run.drop(zero[0], "it is zero throughout")


def drop_dead(run: RawRun) -> None:
    """Optional channels that are zero throughout are dropped, a reference of a machine at rest apart."""
    reference, follows = run.kind.reference
    at_rest = follows in run.values and (
        is_constant(run.values[follows]) if follows in run.kind.plant.positions else not run.values[follows].any()
    )
    for name in run.kind.signals.optional:
        if name in run.values and not run.values[name].any() and not (name == reference and at_rest):
            run.drop(name, "it is zero throughout")


def note_clipped(run: RawRun) -> None:
    """Notes on noisy signals that often rest at their largest or smallest value, as clipped signals do."""
    for name in run.kind.can_clip:
        if name in run.columns and name in run.values and (sentence := clipped(run.time_s, run.values[name])):
            run.notes.append(f"{run.label(name)} {sentence}")


def clipped(time_s: Array, column: Array) -> str | None:
    if len(np.unique(column)) < MIN_CLIPPED:  # a command's steps
        return None
    for extreme, word in ((float(column.max()), "largest"), (float(column.min()), "smallest")):
        at = column == extreme
        count = int(np.count_nonzero(at))
        if count < MIN_CLIPPED or extreme == 0.0:
            continue
        plateau, start = _longest_rest(column, at)
        if plateau >= MIN_PLATEAU and plateau >= PLATEAU_RATIO * _longest_rest(column, ~at)[0]:
            return (
                f"may be clipped: {count} samples at its {word} value {extreme:g}, "
                f"the longest stretch from {seconds(time_s[start])}"
            )
    return None


def _longest_rest(column: Array, among: np.ndarray) -> tuple[int, int]:
    """(length, start) of the longest run of equal consecutive values among some samples."""
    starts, ends = stretches((np.diff(column) == 0.0) & among[1:] & among[:-1])
    if not len(starts):
        return 1, int(np.argmax(among)) if among.any() else 0
    longest = int(np.argmax(ends - starts))
    return int(ends[longest] - starts[longest]) + 1, int(starts[longest])


# Dropouts

LEAST, LEAST_S = 10, 0.25  # samples, and time, that are worth a word; less time is where no chance explains it
CHANCE = 1e-6  # that equal samples in a row of a noisy channel come by chance
TURNS = 0.3  # share of turning points among a noisy channel's samples; white noise has 2/3
JUMP = 10.0  # times what nearly all steps keep below: how a channel comes back from a dropout

Stretch = tuple[int, int]  # first sample, one after the last


class Channel:
    """A channel's samples and when they were taken: column, time_s (n,). Each stretch is judged in constant time."""

    def __init__(self, time_s: Array, column: Array) -> None:
        self.time_s, self.column = time_s, column
        self.low, self.high = float(column.min()), float(column.max())
        steps = np.diff(column)
        turns = np.count_nonzero(np.sign(steps[1:]) * np.sign(steps[:-1]) < 0.0)
        self._counts = len(steps), int(np.count_nonzero(steps == 0.0)), int(turns)
        starts, ends = stretches(steps == 0.0)
        ends = np.minimum(ends + 1, len(column))
        long = (ends - starts >= LEAST) & (ends - starts < len(column))
        self._starts, self._ends = starts[long], ends[long]  # of at least LEAST equal samples
        self._lasting = time_s[self._ends - 1] - time_s[self._starts] >= LEAST_S

    def rests(self) -> list[Stretch]:
        """Stretches of equal values that last; none of a channel that is constant throughout."""
        return self._chosen(self._lasting)

    def brief_freezes(self) -> list[Stretch]:
        """Shorter stretches of a noisy channel that are too long for chance."""
        return self._chosen(~self._lasting & (self._ends - self._starts > self._most_by_chance(0)))

    def brief_jumps(self) -> list[Stretch]:
        """Shorter stretches with a jump of the channel before and after."""
        between = ~self._lasting & (self._starts > 0) & (self._ends < len(self.column))
        return [stretch for stretch in self._chosen(between) if min(self._ends_of(stretch)) > self._least_jump > 0.0]

    def jumps(self, stretch: Stretch) -> bool:
        """Whether the channel jumps at an end of the stretch, which the motion of a stopped machine does not."""
        return max(self._ends_of(stretch)) > self._least_jump > 0.0

    def rest(self, first: int, end: int) -> str:
        since, until = map(seconds, self.time_s[[first, end - 1]])
        return f"is exactly {self.column[first] + 0.0:.6g} from {since} to {until}"  # zero has no sign

    def inside(self, stretch: Stretch) -> bool:
        """Whether the value is inside the channel's range: at an end a clipped channel rests."""
        return bool(self.low < self.column[stretch[0]] < self.high)

    def too_long(self, stretch: Stretch) -> bool:
        """Whether the stretch is too long for chance, in a channel that is noisy elsewhere."""
        length = stretch[1] - stretch[0]
        return length > self._most_by_chance(length)

    def _chosen(self, which: np.ndarray) -> list[Stretch]:
        return [(int(a), int(b)) for a, b in zip(self._starts[which], self._ends[which], strict=True)]

    def _ends_of(self, stretch: Stretch) -> tuple[float, float]:
        """The steps to the stretch and from it; 0 at an end of the log."""
        start, end = stretch
        column = self.column
        before = abs(float(column[start] - column[start - 1])) if start else 0.0
        return before, abs(float(column[end] - column[end - 1])) if end < len(column) else 0.0

    def _most_by_chance(self, without: int) -> float:
        """Equal samples in a row, as the channel beside `without` of them is; infinite where it is not noisy."""
        steps, equal, turns = self._counts
        steps -= max(without, 0)
        share = (equal - max(without - 1, 0)) / max(steps, 1)
        if steps < 50 or turns / steps < TURNS or share > 0.9:
            return math.inf
        return math.log(CHANCE / len(self.column)) / math.log(max(share, 0.01))

    @cached_property
    def _least_jump(self) -> float:
        """The largest step that the motion of this channel explains, which goes by counts of its resolution even where
        it hardly ever moves; 0 for a channel without motion."""
        size = np.abs(np.diff(self.column[:: max(1, len(self.column) // 200_000)]))
        count = float(np.min(size[size > 0.0], initial=np.inf)) if size.any() else 0.0
        return max(JUMP * max(float(np.percentile(size, 98.0)), count), 0.05 * (self.high - self.low))


KEPT = 1.0 / 3.0  # of the run that must be whole
CARRIES_ON = 0.7  # of the sum around it: what the motors give together where one of them gives nothing


def cut_dropouts(run: RawRun) -> None:
    """Keep the longest part of a run without a dropout of its input or motion. InputError when that is too short."""
    lost: dict[Stretch, str] = {}
    time_s, inputs = run.time_s, run.kind.inputs
    for name in (*inputs, run.position, run.speed):
        if name not in run.values:
            continue
        channel = Channel(time_s, run.values[name])
        for stretch in [*channel.rests(), *(channel.brief_freezes() if name in inputs else channel.brief_jumps())]:
            problem = f"{run.label(name)} {channel.rest(*stretch)}"
            verdict = "lost" if channel.jumps(stretch) else ""
            if name in inputs:
                verdict = _input_dropout(run, name, channel, stretch)
            if verdict == "note":
                run.notes.append(f"{problem} while the machine moves; kept")
            elif verdict == "lost":
                lost.setdefault(stretch, f"{problem} while the machine moves")
    if not lost:
        return
    parts, at = [], 0
    for start, end in sorted(lost):
        if start > at:
            parts.append((at, start))
        at = max(at, end)
    first, end = max([*parts, (at, len(time_s))], key=lambda part: part[1] - part[0])
    problem = lost[min(lost)]
    if len(lost) > 1:
        problem += f", and {len(lost) - 1} more such stretch{'es' if len(lost) > 2 else ''}"
    if end - first < KEPT * len(time_s):
        raise run.fault(f"{problem}; is the channel frozen? What is whole beside it is too short")
    span = f"{seconds(time_s[first])} to {seconds(time_s[end - 1])}"
    left_out = f"{len(time_s) - end + first} samples are left out"
    run.notes.append(f"{problem}; the run is kept from {span}, {left_out}")
    run.entry = run.begun_at(first, run.entry.name, run.values)
    run.cut(first, end)


def drop_frozen(run: RawRun) -> None:
    """Optional channels that are frozen for a while are dropped: noisy elsewhere, or with a jump at the end. A
    reference may well rest."""
    for name in run.kind.signals.optional:
        if name not in run.values or name == run.kind.reference[0]:
            continue
        channel = Channel(run.time_s, run.values[name])
        for stretch in channel.rests():
            if channel.jumps(stretch) or (channel.inside(stretch) and channel.too_long(stretch)):
                run.drop(name, f"it {channel.rest(*stretch)}")
                break


def _input_dropout(run: RawRun, name: str, channel: Channel, stretch: Stretch) -> str:
    """ "lost", "note" (odd, yet a machine may do so), or "" for a rest that is none."""
    start, end = stretch
    if run.speed in run.values:
        nominal = run.kind.nominal_speed
        moving = 0.0 if nominal is None else MOVING * nominal(run.machine)
        moves = float(np.mean(np.abs(run.values[run.speed][start:end]))) > moving
    else:
        position = run.values[run.position]
        moves = float(np.ptp(position[start:end])) > 0.01 * float(np.ptp(position))
    zero = channel.column[start] == 0.0
    if not moves or not (zero or (channel.inside(stretch) and channel.too_long(stretch))):
        return ""
    if not run.kind.holds_load:
        return "note" if zero or channel.too_long(stretch) else ""
    total = run.values[run.kind.plant.input]
    if name != run.kind.plant.input and zero:
        # One motor may fail and the other carry on: then the sum goes on as around the stretch.
        width = end - start
        around = np.concatenate((total[max(0, start - width) : start], total[end : end + width]))
        if len(around) and abs(total[start:end].mean()) > CARRIES_ON * abs(around.mean()):
            return "note"
    return "lost"


# A run, checked


def checked_runs(raw: RawRun, *, whole: bool = False) -> list[Run]:
    """The run, or each stretch between holes as a run of its own, which begins where the motion has taken the machine.
    whole: holes are refused."""
    # Numbers near the largest a float holds overflow to infinite here and are refused as such.
    with np.errstate(over="ignore", invalid="ignore"):
        check_time(raw)
        refuse_infinite(raw)
        merge_repeated(raw)
        if not (parts := [] if whole else whole_stretches(raw)):
            return [_checked(raw)]
        time_s, known = raw.time_s, {}
        for name, column in raw.values.items():
            there = ~np.isnan(column)
            if there.any():
                known[name] = np.interp(time_s, time_s[there], column[there])
        # Between the last sample before and the first one behind, where no row of the log is empty.
        ends = [(b, a - 1) if a > b else (b - 1, a) for (_, b), (a, _) in pairwise(parts)]
        holes = [f"{seconds(time_s[b])} to {seconds(time_s[a])}" for b, a in ends]
        holes = ([f"the start to {seconds(time_s[parts[0][0] - 1])}"] if parts[0][0] else []) + holes
        holes += [f"{seconds(time_s[parts[-1][1]])} to the end"] if parts[-1][1] < len(time_s) else []
        said = f"samples are missing from {', '.join(holes)}; the stretches before and behind are used, each as a run"
        runs: list[Run] = []
        refused: list[InputError] = []
        for number, (first, end) in enumerate(parts, 1):
            name = raw.entry.name if number == 1 else f"{raw.entry.name}_{number}"
            try:
                runs.append(_checked(raw.part(first, end, raw.begun_at(first, name, known), said)))
            except InputError as error:
                refused.append(error)
        if not runs:
            raise refused[0]
        return runs


def _checked(run: RawRun) -> Run:
    """Each check repairs the run, notes something, or raises; what a later one takes for granted, an earlier one has
    made sure of."""
    for check in (
        fill_gaps, bridge_spikes, check_sizes,
        check_time,  # again: repairs may have shortened the run
        note_time, _sum_inputs, cut_dropouts, drop_dead_motion, _place,
        check_plausible, drop_dead, drop_frozen, drop_wrong_scale, note_clipped,
    ):  # fmt: skip
        check(run)
    return Run(
        name=run.entry.name,
        time_s=run.time_s,
        signals=run.values,
        payload_kg=run.payload_kg,
        start_position_m=run.entry.start_position_m or 0.0,
        start_time_s=run.entry.start_time_s or 0.0,
        source=str(run.file),
        notes=tuple(run.notes),
    )


def _sum_inputs(run: RawRun) -> None:
    """The input as the sum of its parts, such as both motors' torque; the parts stay beside it when all are logged."""
    parts, total = run.kind.drive.parts, run.kind.plant.input
    if parts and all(name in run.values for name in parts):
        if total in run.values:
            run.notes.append(f"{run.label(total)} is not used: both motors are logged for themselves")
        run.values[total] = np.sum([run.values[name] for name in parts], axis=0)
        return
    for name in parts:
        if name in run.values:
            run.notes.append(f"{run.label(name)} is not used: the other motor is not logged, the sum is")
            del run.values[name]


def _place(run: RawRun) -> None:
    """The start position: from runs.yaml, else the first logged position of a kind that is placed by its log."""
    if run.entry.start_position_m is None and run.kind.moved.placed_by_log and run.position in run.values:
        start = float(run.values[run.position][0])
        run.entry = run.entry.model_copy(update={"start_position_m": start})
