"""Checks of a campaign before a diagnosis: length, motion, signs, units, one machine; and what its runs do not vary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.impacts import impacts_of
from workbench.simulate.lowpass import LEAST_PERIODS, lowpass, noise_rms

BAND_SHARE = 0.5  # of the band: farther below the wire's resonance the machine is nearly rigid
TURNS_OVER = 0.005  # of the speed scale: where friction takes on its full value
SURE = 5.0  # standard errors
SHOWN = 0.05  # of the input, rms: beside a lag of friction or load, less of it says nothing of the inertia
MOST = 0.5  # of the input
UNLIKE = 0.2  # of the input's variance: a run of which a rigid machine leaves more says nothing of its inertia
WORKS = 0.2  # of the power's size: what the input gives on average, at least
AS_WELL = 0.4  # of what the inertia takes in the run that shows it best: an axis' slower runs show friction's lag


@dataclass(frozen=True)
class Rigid:
    """Ratios of a run's fitted values to those of the nominal machine, with standard errors.

    inertia: None where the run does not accelerate enough to tell, or is not like a rigid machine at all: of an axis,
    where more is left than the inertia takes. hold: mean
    load, None on an axis or where friction hides it. friction: in the input's unit, against the motion positive.
    shown: what the nominal inertia takes of the input, rms.
    """

    run: str
    inertia: float | None
    inertia_std: float
    hold: float | None
    friction: float
    shown: float = 0.0


def rigid_of(bench: InverseSimulation, j: int) -> Rigid:
    """Run j of the bench as a rigid machine."""
    run, machine = bench.runs[j], bench.machine
    rows = bench.moving[j]
    band = BAND_SHARE * bench.band_hz
    speed = lowpass(run.time_s, bench.motions[j].speed, band)
    sign = lowpass(run.time_s, np.clip(speed / (TURNS_OVER * bench.scale), -1.0, 1.0), band)
    kind = kind_of(machine)
    body = kind.rigid(machine, run.payload_kg)
    columns = [body.inertia * np.gradient(speed, run.time_s), np.ones_like(speed), sign]
    if kind.friction.viscous:
        columns.append(speed)
    if body.wave:
        angle = bench.motions[j].position
        columns += [lowpass(run.time_s, wave(angle), band) for wave in (np.sin, np.cos)]
    x = np.stack(columns, axis=1)[rows]
    y = lowpass(run.time_s, run[bench.plant.input], band)[rows]
    independent = 2.0 * band * run.sample_time_s * len(y)
    if independent < 2.0 * x.shape[1]:
        return Rigid(run.name, None, float("inf"), None, 0.0)
    values, std = _least_squares(x, y, independent)
    power = y * speed[rows]
    works = kind.friction.viscous and float(np.mean(power)) > WORKS * float(np.mean(np.abs(power)))
    size = max(float(np.std(y)), 1e-300)
    shown = float(np.sqrt(np.mean(x[:, 0] ** 2))) / size
    left = float(np.var(y - x @ values)) / size**2
    taken = abs(float(values[0])) * shown
    like = left < UNLIKE and not (kind.friction.viscous and left > taken**2)
    springs = values[0] < 0.0 and works  # with a wrong sign the input would take power from friction
    told = like and not springs and std[0] < np.inf and abs(values[0]) > SURE * std[0] and taken > SHOWN
    hold = float(values[1]) / body.hold if body.hold and std[1] < 0.1 * body.hold else None
    return Rigid(run.name, float(values[0]) if told else None, float(std[0]), hold, float(values[2]), shown)


def as_well_shown(rigid: Sequence[Rigid]) -> list[Rigid]:
    """Drops the inertia of runs of an axis in which it shows far less than in other runs, because the lag of friction
    biases it there. It is kept if it takes most of the input, as with a wrong unit."""
    most = max((r.shown for r in rigid), default=0.0)
    return [
        r
        if r.inertia is None or r.shown >= AS_WELL * most or abs(r.inertia) * r.shown > MOST
        else replace(r, inertia=None)
        for r in rigid
    ]


def _least_squares(x: Array, y: Array, independent: float) -> tuple[Array, Array]:
    """Values and standard errors; infinite ones where the columns cannot be told apart."""
    size = np.linalg.norm(x, axis=0)
    size[size == 0.0] = 1.0
    scaled = x / size
    solution, *_ = np.linalg.lstsq(scaled, y, rcond=1e-6)
    left = y - scaled @ solution
    normal = scaled.T @ scaled
    values, vectors = np.linalg.eigh(normal)
    variance = (vectors**2) @ (1.0 / np.maximum(values, 1e-12))
    # Scaled columns: what is left of one after the others are taken out is 1/variance.
    variance[variance > 1e6] = np.inf
    per_row = float(left @ left) / max(independent - x.shape[1], 1.0)
    return solution / size, np.sqrt(variance * per_row) / size


WRONG_UNIT = 5.0  # inertia over the nominal one, or the inverse: no such machine, but such units
ODD_INERTIA, ODD_LOAD = 2.0, 1.4  # over the nominal ones: worth a warning
LOADS_APART = 1.25  # of the loads that runs hold over the nominal ones: offsets and payload errors stay below
INERTIAS_APART = 2.0  # a lag of a tenth of a second takes a third off the inertia of a brisk run
SPEED_SLIPS = (("rpm", 60.0 / (2.0 * math.pi)), ("degrees per second", 180.0 / math.pi))

Ratios = list[tuple[str, float]]


def check_machine(bench: InverseSimulation, rigid: Sequence[Rigid], file: object) -> list[str]:
    """Warnings. InputError for signals upside down or in another unit, and for runs of different machines."""
    _check_signs(bench, rigid, file)
    _check_units(bench, rigid, file)
    struck = any(len(blows) for blows in bench.impacts)
    return [*_check_one_machine(rigid, file, kind_of(bench.machine).holds_load, struck), *_odd(rigid)]


def listed(names: Sequence[str], most: int = 6) -> str:
    """run a; runs a, b and c"""
    if len(names) == 1:
        return f"run {names[0]}"
    shown = list(names[:most])
    if len(names) > most:
        return f"runs {', '.join(shown)} and {len(names) - most} more"
    return f"runs {', '.join(shown[:-1])} and {shown[-1]}"


def _in_runs(which: Sequence[Rigid], all_runs: Sequence[Run]) -> str:
    """in 4 of 6 runs (a, b, c, d)"""
    names = ", ".join(r.run for r in which)
    if len(all_runs) == 1:
        return f"in run {names}"
    many = f"all {len(all_runs)}" if len(which) == len(all_runs) else f"{len(which)} of {len(all_runs)}"
    return f"in {many} runs ({names})"


def _check_signs(bench: InverseSimulation, rigid: Sequence[Rigid], file: object) -> None:
    """On a hoist the load shows whether torque or speed has the wrong sign; on an axis it can be either."""
    signal, runs, kind = bench.plant.input, bench.runs, kind_of(bench.machine)
    positive = f"{kind.directions.positive} is positive"
    sinking = [r for r in rigid if r.hold is not None and r.hold < 0.0]
    both = [r for r in sinking if r.inertia is not None and r.inertia > 0.0]
    torque = [r for r in sinking if r not in both]
    braked = [r for r in rigid if r.inertia is not None and r.inertia < 0.0 and r not in sinking]
    if torque:
        raise InputError(
            f"torque pulls the load down and falls where the load is lifted faster {_in_runs(torque, runs)}: is the "
            f"sign of {signal} flipped? {positive}; give its columns a scale of -1",
            file=file,
        )
    if both:
        raise InputError(
            f"torque pulls the load down {_in_runs(both, runs)}: are torque and speed both counted downwards? "
            "Up is positive; give both columns a scale of -1",
            file=file,
        )
    if braked and kind.holds_load:
        raise InputError(
            f"speed rises against the torque {_in_runs(braked, runs)}: is its sign flipped? "
            f"{positive}; give its column a scale of -1",
            file=file,
        )
    if braked:
        raise InputError(
            f"speed rises against {signal} {_in_runs(braked, runs)}: is the sign of {signal} or of the motion flipped? "
            f"{positive} for both; give the column a scale of -1",
            file=file,
        )


def _check_units(bench: InverseSimulation, rigid: Sequence[Rigid], file: object) -> None:
    """A speed k times too large gives 1/k of the inertia, and so does an axis' force k times too small."""
    off = [r for r in rigid if r.inertia is not None and not 1.0 / WRONG_UNIT < r.inertia < WRONG_UNIT]
    if not off:
        return
    typical = float(np.median([r.inertia for r in off if r.inertia is not None]))
    load = kind_of(bench.machine).holds_load
    signals = bench.plant.speeds[0] if load else f"{bench.plant.input} or the motion"
    unit = next((unit for unit, k in SPEED_SLIPS if 0.7 < typical * k < 1.4), None)
    guess = f"is {signals} in {unit}?" if unit else f"is {signals} in another unit, or machine.yaml another machine's?"
    if unit:
        scale = next(1.0 / k for name, k in SPEED_SLIPS if name == unit)
        guess += f" Then give the column a scale of {scale:.6g}"
    raise InputError(
        f"the torque that an acceleration takes is {typical:.3g} times what the nominal inertia needs "
        f"{_in_runs(off, bench.runs)}; {guess}",
        file=file,
    )


def _check_one_machine(rigid: Sequence[Rigid], file: object, holds_load: bool, struck: bool) -> list[str]:
    """InputError where runs hold loads, or axes show inertias, of two machines. A warning for a hoist's inertia:
    a slow run hardly shows it, and a load that swings hides some of it; the load that is held says more. A warning
    as well where blows of a play come again: the inertia behind it goes with the motor part of the time only."""
    loads = [(r.run, r.hold) for r in rigid if r.hold is not None]
    inertias = [(r.run, r.inertia) for r in rigid if r.inertia is not None]
    warnings = []
    for ratios, apart, what, remedy in (
        (loads, LOADS_APART, "load", ", or is payload_kg wrong"),
        (inertias, INERTIAS_APART, "inertia", ", or is their speed in another unit" if holds_load else ""),
    ):
        split = _two_groups([(name, value) for name, value in ratios if value is not None], apart)
        if split is None:
            continue
        others, odd = split
        one = len(odd) == 1
        said = (
            f"{listed([n for n, _ in odd])} disagree{'s' if one else ''} with the machine and with the others: "
            f"{'its' if one else 'their'} {what} is {_range(odd)} times the nominal one, that of "
            f"{listed([n for n, _ in others])} {_range(others)} times; "
            f"{'is it' if one else 'are they'} of another machine{remedy}?"
        )
        if not struck and (what == "load" or not holds_load):
            raise InputError(said, file=file)
        warnings.append(f"{said[0].upper()}{said[1:]}")
    return warnings


def _odd(rigid: Sequence[Rigid]) -> list[str]:
    """Warnings if all runs agree with each other but not with machine.yaml."""
    sentences = []
    for what, ratios, odd in (
        ("inertia", [r.inertia for r in rigid if r.inertia is not None], ODD_INERTIA),
        ("load", [r.hold for r in rigid if r.hold is not None], ODD_LOAD),
    ):
        typical = float(np.median(ratios)) if ratios else 1.0
        if not 1.0 / odd <= typical <= odd:
            sentences.append(
                f"The {what} is about {typical:.2f} times what machine.yaml says in all runs; "
                "is it this machine's file?"
            )
    return sentences


def _two_groups(ratios: Ratios, apart: float) -> tuple[Ratios, Ratios] | None:
    """The runs split at the largest step of their ratios, the group nearer to 1 first; None if it is small."""
    if len(ratios) < 2:
        return None
    ordered = sorted(ratios, key=lambda named: named[1])
    steps = [math.log(b[1] / a[1]) for a, b in pairwise(ordered)]
    at = int(np.argmax(steps))
    if steps[at] < math.log(apart):
        return None
    low, high = ([named for named in ratios if named in part] for part in (ordered[: at + 1], ordered[at + 1 :]))
    off = [abs(float(np.median([math.log(value) for _, value in group]))) for group in (low, high)]
    return (low, high) if off[0] <= off[1] else (high, low)


def _range(ratios: Ratios) -> str:
    values = [value for _, value in ratios]
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


FAR = 2.0  # a ratio beyond this or its inverse is a unit, not a machine
NEAR = 0.1  # what geometry, layers and a yielding wire may make of it
ALIKE = 0.8  # correlation: below, the two do not show the same motion


def check_other_signals(bench: InverseSimulation, going: Sequence[int], file: object) -> list[str]:
    """Warnings. InputError where two signals of one run contradict each other."""
    warnings: dict[str, list[str]] = {}
    for j in going:
        run = bench.runs[j]
        for text in _of_kind(bench, j, file):
            warnings.setdefault(text, []).append(run.name)
        slope = reference_slope(bench, j)
        if slope is not None and not 1.0 / FAR < slope < FAR:
            text = "the motion is not that of its reference; is the reference in another unit? No delay is read off it"
            warnings.setdefault(text, []).append(run.name)
    return [f"{text} ({', '.join(names)})." for text, names in warnings.items()]


def reference_slope(bench: InverseSimulation, j: int) -> float | None:
    """The slope of the motion over its logged reference; None without a reference, 0 if they are not related."""
    both = reference_of(bench.machine, bench.runs[j])
    return None if both is None else slope_of(*both)


def reference_of(machine: Hoist | Axis, run: Run) -> tuple[Array, Array] | None:
    """(reference, motion) of one run, where the reference is logged."""
    names = kind_of(machine).reference
    if any(name not in run for name in names) or np.ptp(run[names[0]]) == 0.0:
        return None
    return run[names[0]], run[names[1]]


def _of_kind(bench: InverseSimulation, j: int, file: object) -> list[str]:
    """Warnings about run j. InputError if two of its signals contradict each other."""
    run, kind = bench.runs[j], kind_of(bench.machine)
    if kind.cross_checks is None:
        return []

    def smooth(values: Array) -> Array:
        return lowpass(run.time_s, values, bench.band_hz)

    odd = []
    for check in kind.cross_checks(bench.machine, run, bench.motions[j].position, smooth, slope_of):
        if not 1.0 / FAR < check.ratio < FAR:
            raise InputError(check.wrong, file=file, place=run.name)
        if check.odd and abs(check.ratio - 1.0) > NEAR:
            odd.append(check.odd)
    return odd


def slope_of(x: Array, y: Array) -> float:
    """The slope of y over x, by least squares in the noisier of the two; 0 if they are not related."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if xx == 0.0 or yy == 0.0 or abs(xy) < ALIKE * np.sqrt(xx * yy):
        return 0.0
    return xy / xx


ONE_WAY = 0.03  # of the moving time the other way: too little to tell friction from load
ONE_SPEED = 0.7  # of the larger cruising speeds over the smaller: slower and faster are then one speed
EVEN = 0.1  # of the largest acceleration: below it counts as cruising
PAYLOADS_ALIKE = 0.02  # of the moved mass: less is no other payload


def variety(bench: InverseSimulation, going: Sequence[int]) -> tuple[str, ...]:
    """Warnings as sentences; none if the campaign varies all of them."""
    sentences = []
    kind = kind_of(bench.machine)
    if len(going) == 1:
        sentences.append(
            "One run only: it can show neither what the payload changes nor what the campaign's time does, "
            "and nothing is left to test on; held-out figures are of parts of the same run."
            if kind.payload
            else "One run only: it cannot show what changes from run to run, and nothing is left to test on; "
            "held-out figures are of parts of the same run."
        )
    elif kind.payload and _one_payload(bench, going):
        sentences.append(
            f"All runs carry about {bench.runs[going[0]].payload_kg:g} kg: what grows with the load (gearbox "
            "efficiency, load-dependent friction, payload and torque scale) cannot be told from what does not."
        )
    speeds = [_speeds(bench, j) for j in going]
    ahead = float(np.mean(np.concatenate(speeds) > 0.0))
    if not ONE_WAY < ahead < 1.0 - ONE_WAY:
        way, other = kind.directions.one_way[ahead <= 0.5]
        sentences.append(f"All runs only {way}: without {other}, friction cannot be told from the load or an offset.")
    if _one_speed(bench, going):
        sentences.append(
            "All runs move at one speed: friction that grows or falls with the speed cannot be told from a "
            "constant level; a slow run beside a fast one would show it."
        )
    return tuple(sentences)


def _one_payload(bench: InverseSimulation, going: Sequence[int]) -> bool:
    """Whether all runs carry about the same payload, judged by the weight."""
    weight = kind_of(bench.machine).weight
    if weight is None:
        return False
    weights = [weight(bench.machine, bench.runs[j].payload_kg) for j in going]
    return max(weights) - min(weights) < PAYLOADS_ALIKE * max(weights)


def _speeds(bench: InverseSimulation, j: int) -> Array:
    """(k,) low-passed speeds of run j in motion."""
    run = bench.runs[j]
    return lowpass(run.time_s, bench.motions[j].speed, bench.band_hz)[bench.moving[j]]


def _one_speed(bench: InverseSimulation, going: Sequence[int]) -> bool:
    """Whether all phases of constant speed have the same speed; without such phases the speeds vary."""
    cruising, moving = [], 0
    for j in going:
        run = bench.runs[j]
        speed = lowpass(run.time_s, bench.motions[j].speed, bench.band_hz)
        acceleration = np.abs(np.gradient(speed, run.time_s))
        largest = float(np.max(acceleration[bench.moving[j]]))
        even = bench.moving[j] & (acceleration < EVEN * largest) & (np.abs(speed) > 0.02 * bench.scale)
        cruising.append(np.abs(speed[even]))
        moving += int(np.count_nonzero(bench.moving[j]))
    every = np.concatenate(cruising)
    if len(every) < 0.2 * moving:
        return False
    slow, fast = np.percentile(every, [5.0, 95.0])
    return bool(slow > ONE_SPEED * fast)


FEWEST = 20.0  # independent values while moving: about as many as a diagnosis turns numbers
ABOVE_NOISE = 5.0  # in the band: less is no motion


def check_runs(campaign: Campaign) -> tuple[str, ...]:
    """Warnings: effects that these runs cannot show or tell apart.

    InputError, naming the runs, for runs that are too short, that all stand still, that are of
    different machines, and for signals of the wrong sign or unit.
    """
    bench = InverseSimulation(campaign.machine, campaign.runs, impacts=impacts_of(campaign.machine, campaign.runs))
    file = campaign.path / "runs.yaml"
    _check_lengths(bench, file)
    going = [j for j in range(len(bench.runs)) if moves(bench, j)]
    if not going:
        raise InputError(
            f"{'the run stands' if len(bench.runs) == 1 else 'all runs stand'} still; a diagnosis needs motion: "
            "without it there is no friction and no inertia to see",
            file=file,
        )
    _check_frozen(bench, going, file)
    _check_enough(bench, going, file)
    rigid = [rigid_of(bench, j) for j in going]
    if kind_of(bench.machine).holds_load:  # the load says which signal is upside down; else the signals have to say it
        odd, warnings = check_machine(bench, rigid, file), check_other_signals(bench, going, file)
    else:
        warnings, odd = check_other_signals(bench, going, file), check_machine(bench, as_well_shown(rigid), file)
    still = [run.name for j, run in enumerate(bench.runs) if j not in going]
    if still:
        one = len(still) == 1
        who = listed(still).replace("run", "Run", 1)
        warnings.append(
            f"{who} {'stands' if one else 'stand'} still throughout and {'adds' if one else 'add'} "
            "nothing to the diagnosis."
        )
    return (*warnings, *odd, *variety(bench, going))


def moves(bench: InverseSimulation, j: int) -> bool:
    """Whether run j moves: faster than at rest, and beyond the noise of its motion."""
    run, motion = bench.runs[j], bench.motions[j]
    speed = lowpass(run.time_s, motion.speed, bench.band_hz)[bench.inside[j]]
    noise = noise_rms(run.time_s, motion.speed, bench.band_hz)
    return bool(bench.moving[j].any()) and float(np.max(np.abs(speed))) > ABOVE_NOISE * noise


def _check_lengths(bench: InverseSimulation, file: object) -> None:
    needed = LEAST_PERIODS / bench.band_hz
    short = [run for run in bench.runs if run.duration_s < needed]
    if short:
        spans = ", ".join(f"{run.name} lasts {run.duration_s:.3g} s" for run in short[:6])
        raise InputError(
            f"{spans}; a diagnosis in the band of {bench.band_hz:.3g} Hz needs at least {needed:.3g} s of a run "
            f"({LEAST_PERIODS:g} periods); leave {'it' if len(short) == 1 else 'them'} out of runs.yaml",
            file=file,
        )


def _check_enough(bench: InverseSimulation, going: Sequence[int], file: object) -> None:
    moving = sum(float(np.count_nonzero(bench.moving[j])) * bench.runs[j].sample_time_s for j in going)
    needed = FEWEST / (2.0 * bench.band_hz)
    if moving < needed:
        raise InputError(
            f"{'the run moves' if len(bench.runs) == 1 else 'the runs together move'} for {moving:.2g} s, rests and "
            f"both ends left out; a diagnosis in the band of {bench.band_hz:.3g} Hz needs at least {needed:.2g} s",
            file=file,
        )


def _check_frozen(bench: InverseSimulation, going: Sequence[int], file: object) -> None:
    name = bench.plant.input
    for j in going:
        values = bench.inputs[j]
        if values.min() == values.max():
            raise InputError(
                f"{name} is {values[0]:g} throughout while the machine moves; is the channel frozen?",
                file=file,
                place=bench.runs[j].name,
            )
