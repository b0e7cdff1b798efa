"""Checks of a campaign before a diagnosis: length, motion, signs, units, one machine; and what its runs do not vary."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of
from workbench.machines.declare import RESTS_BELOW, CrossCheck
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import LEAST_PERIODS, lowpass, noise_rms
from workbench.simulate.motion import impacts_of

FEWEST = 20.0  # independent values while moving: about as many as a diagnosis turns numbers
ABOVE_NOISE = 5.0  # in the band: less is no motion
WRONG_UNIT = 5.0  # inertia over the nominal one, or the inverse: no such machine, but such units
ODD_INERTIA, ODD_LOAD = 2.0, 1.4  # over the nominal ones: worth a warning
VARIES = 0.25  # of a constant input: by more than a part that is missing, the motion takes another one
LOADS_APART = 1.25  # of the loads that runs hold over the nominal ones: offsets and payload errors stay below
INERTIAS_APART = 2.0  # play and friction that builds up over a distance take a third off the inertia of a brisk run
SPEED_SLIPS = (("rpm", 60.0 / (2.0 * math.pi)), ("degrees per second", 180.0 / math.pi))
TOO_FAST = 3.0  # times the nominal speed
FAR = 2.0  # a ratio beyond this or its inverse is a unit, not a machine
NEAR = 0.1  # what geometry, layers and a yielding wire may make of it
HARDLY = 0.2  # of the longest way of a run
ALIKE = 0.8  # correlation: below, the two do not show the same motion
ONE_WAY = 0.03  # of the moving time the other way: too little to tell friction from load
ONE_SPEED = 0.7  # of the larger cruising speeds over the smaller: slower and faster are then one speed
EVEN = 0.1  # of the largest acceleration: below it counts as cruising
PAYLOADS_ALIKE = 0.02  # of the moved mass: less is no other payload
FEW_SAMPLES = 5.0  # of a ramp: fewer, and an acceleration is hardly in the log
BAND_SHARE = 0.5  # of the band: farther below the wire's resonance the machine is nearly rigid
TURNS_OVER = 0.005  # of the speed scale: where friction takes on its full value
SURE, PARTS = 5.0, 4  # standard errors; parts of a run for the jackknife's of the inertia (J. W. Tukey 1958)
SHOWN = 0.05  # of the input, rms: beside a lag of friction or load, less of it says nothing of the inertia
MOST = 0.5  # of the input
UNLIKE = 0.2  # of the input's variance: a run of which a rigid machine leaves more says nothing of its inertia
LATEST_S, AS_LATE = 1.0, 0.5  # a motion that is logged so late at most leaves less than this part of it
WORKS = 0.2  # of the power's size: what the input gives on average, at least; what friction takes, if it is not to give
AS_WELL = 0.4  # of what the inertia takes in the run that shows it best: an axis' slower runs show friction's lag


def check_runs(campaign: Campaign) -> tuple[str, ...]:
    """Warnings: effects that these runs cannot show or tell apart.

    InputError, naming the runs, for runs that are too short, that all stand still, that hold unlike loads, and
    for signals of the wrong sign or unit.
    """
    bench = InverseSimulation(campaign.machine, campaign.runs, impacts=impacts_of(campaign.machine, campaign.runs))
    going = _going(bench)
    warnings: list[str] = []
    for problem, run in _faults(bench, going, warnings):
        raise InputError(problem, file=campaign.path / "runs.yaml", place=run)
    return (*warnings, *variety(bench))


def long_enough(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign without the runs that are too short for its band, which a warning names; all of it, where no run
    would be left (`check_runs` says so)."""
    bench = InverseSimulation(campaign.machine, campaign.runs)
    short, said = _short(bench)
    if not short or len(short) == len(campaign.runs):
        return campaign, ()
    left_out = {run.name for run in short}
    kept = tuple(run for run in campaign.runs if run.name not in left_out)
    return replace(campaign, runs=kept), (f"{said}: left out.",)


def _short(bench: InverseSimulation) -> tuple[list[Run], str]:
    """Runs of less than LEAST_PERIODS of the band, and a sentence on them."""
    needed = LEAST_PERIODS / bench.band_hz
    short = [run for run in bench.runs if run.duration_s < needed]
    spans = ", ".join(f"{run.name} lasts {run.duration_s:.3g} s" for run in short[:6])
    return short, (
        f"{spans}; a diagnosis in the band of {bench.band_hz:.3g} Hz needs at least {needed:.3g} s of a run "
        f"({LEAST_PERIODS:g} periods)"
    )


def _going(bench: InverseSimulation) -> list[int]:
    return [j for j in range(len(bench.runs)) if moves(bench, j)]


def moves(bench: InverseSimulation, j: int) -> bool:
    """Whether run j moves: faster than at rest, and beyond the noise of its motion."""
    run, motion = bench.runs[j], bench.motions[j]
    speed = bench.speeds[j][bench.inside[j]]
    noise = noise_rms(run.time_s, motion.speed, bench.band_hz)
    return bool(bench.moving[j].any()) and float(np.max(np.abs(speed))) > ABOVE_NOISE * noise


Faults = Iterator[tuple[str, str | None]]  # what is wrong, and the run that it is in


def _faults(bench: InverseSimulation, going: Sequence[int], warnings: list[str]) -> Faults:
    """The faults, in the order in which they matter; warnings are added to the list."""
    runs, band = bench.runs, bench.band_hz
    short, said = _short(bench)
    if short:
        yield said, None
    if not going:
        yield (
            f"{'the run stands' if len(runs) == 1 else 'all runs stand'} still; a diagnosis needs motion: "
            "without it there is no friction and no inertia to see",
            None,
        )
    steady = any(bench.inputs[j].any() and np.ptp(bench.inputs[j]) == 0.0 for j in going)
    balances = bench.balances() if steady else []
    for j in going:
        values = bench.inputs[j]
        if not values.any():
            coasts = f"Run {runs[j].name} has no {bench.plant.input} throughout: it coasts, or the channel is dead."
            warnings.append(coasts)
        elif values.min() == values.max():
            constant = f"{bench.plant.input} is {values[0]:g} throughout while the machine moves"
            taken = balances[j].predicted[bench.moving[j]]
            if len(taken) and np.std(taken) > VARIES * abs(values[0]):
                yield f"{constant}; is the channel frozen?", runs[j].name
            warnings.append(f"Run {runs[j].name}: {constant}: as commanded, or the channel is frozen.")
    moving = sum(float(np.count_nonzero(bench.moving[j])) * runs[j].sample_time_s for j in going)
    if moving < (enough := FEWEST / (2.0 * band)):
        yield (
            f"{'the run moves' if len(runs) == 1 else 'the runs together move'} for {moving:.2g} s, rests and "
            f"both ends left out; a diagnosis in the band of {band:.3g} Hz needs at least {enough:.2g} s",
            None,
        )
    rigid = [rigid_of(bench, j) for j in going]
    if any(r.late for r in rigid):  # one log: where it turns again and again it may look like either
        rigid = [replace(r, inertia=None) if (r.inertia or 0.0) < 0.0 else r for r in rigid]
    odd: list[str] = []
    if kind_of(bench.machine).holds_load:  # the load says which signal is upside down; else the signals have to say it
        yield from _machine_faults(bench, rigid, odd)
        yield from _signal_faults(bench, going, warnings)
    else:
        yield from _signal_faults(bench, going, warnings)
        yield from _machine_faults(bench, as_well_shown(rigid), odd)
    nominal = kind_of(bench.machine).nominal_speed
    for j in going if nominal is not None else ():
        fastest = float(np.max(np.abs(bench.motions[j].speed)))
        if fastest > TOO_FAST * bench.scale:
            yield (
                f"{bench.plant.speeds[0]} reaches {fastest:.3g}, the nominal speed is {bench.scale:.3g}; is another "
                "signal in its column, or another unit?",
                runs[j].name,
            )
    if still := [run.name for j, run in enumerate(runs) if j not in going]:
        stays, adds = ("stays", "adds") if len(still) == 1 else ("stay", "add")
        rest = f"below {100.0 * RESTS_BELOW:g} % of {kind_of(bench.machine).speed_scale[0]} throughout"
        who = listed(still).replace("run", "Run", 1)
        warnings.append(f"{who} {stays} {rest}, which counts as rest, and {adds} nothing to the diagnosis.")
    warnings += odd


# Redundant signals compared with each other: an error of sign or unit shows in their ratio.


def _signal_faults(bench: InverseSimulation, going: Sequence[int], warnings: list[str]) -> Faults:
    """Two signals of one run that contradict each other. A speed's noise adds up to a way: what hardly goes any beside
    another run says nothing."""
    checks, odd = kind_of(bench.machine).cross_checks, dict[str, list[str]]()
    found: dict[int, list[CrossCheck]] = {}
    for j in going:
        run = bench.runs[j]

        def smooth(values: Array, run: Run = run) -> Array:
            return lowpass(run.time_s, values, bench.band_hz)

        found[j] = list(checks(bench.machine, run, bench.motions[j].position, smooth, slope_of)) if checks else []
    most = max((check.way for every in found.values() for check in every), default=0.0)
    for j in going:
        run = bench.runs[j]
        for check in found[j]:
            if check.way < HARDLY * most:
                continue
            if not 1.0 / FAR < check.ratio < FAR:
                yield check.wrong, run.name
            if check.odd and abs(check.ratio - 1.0) > NEAR:
                odd.setdefault(check.odd, []).append(run.name)
        slope = reference_slope(bench, j)
        if slope is not None and not 1.0 / FAR < slope < FAR:
            text = "the motion is not that of its reference; is the reference in another unit? No delay is read off it"
            odd.setdefault(text, []).append(run.name)
    warnings += [f"{text} ({', '.join(names)})." for text, names in odd.items()]


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


def slope_of(x: Array, y: Array) -> float:
    """The slope of y over x, by least squares in the noisier of the two; 0 if they are not related."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if xx == 0.0 or yy == 0.0 or abs(xy) < ALIKE * np.sqrt(xx * yy):
        return 0.0
    return xy / xx


# The runs compared with their machine and with each other.


@dataclass(frozen=True)
class Rigid:
    """A run's torque compared with that of a rigid machine: ratios to the nominal values, with standard errors.

        input = inertia · acceleration + friction · sign(speed) + load

    fitted by least squares to each run for itself, low-passed to half the band; an axis' friction has a viscous part
    too, its input a lag, less lag · d(input)/dt, for one behind a filter would hide the inertia, and the load of one
    that turns against gravity a wave over its angle. Coarse, but every error of sign, unit or machine shows: every
    effect of the library leaves inertia and load within a third of the nominal ones. Friction that builds up over a
    distance is a spring after each reversal, as an inertia below zero would be; a wrong sign shows one too, but then
    the input takes power from the motion. So does a motion that is logged late by a part of its period. So an axis' run
    with an inertia below zero whose input gives power, or that is explained much better if it is late, says nothing of
    its inertia. late: whether it is. driven: whether its friction, as fitted, gives power to the motion, as none does.

    inertia: None where the run does not accelerate enough to tell, or its parts differ by as much, or it is not like a
    rigid machine at all: of an axis, where more is left than the inertia takes. hold: mean load, None on an axis or
    where friction hides it. friction: in the input's unit, against the motion positive. shown: what the nominal inertia
    takes of the input, rms.
    """

    run: str
    inertia: float | None
    inertia_std: float
    hold: float | None
    friction: float
    shown: float = 0.0
    late: bool = False
    driven: bool = False


def rigid_of(bench: InverseSimulation, j: int) -> Rigid:
    """Run j of the bench as a rigid machine."""
    run, rows, kind = bench.runs[j], bench.moving[j], kind_of(bench.machine)
    band = BAND_SHARE * bench.band_hz
    body = kind.rigid(bench.machine, run.payload_kg)
    measured = lowpass(run.time_s, run[bench.plant.input], band)
    angle = bench.motions[j].position
    waves = [lowpass(run.time_s, wave(angle), band) for wave in (np.sin, np.cos)] if body.wave else []
    logged, y = lowpass(run.time_s, bench.motions[j].speed, band), measured[rows]

    def columns(speed: Array) -> Array:
        sign = lowpass(run.time_s, np.clip(speed / (TURNS_OVER * bench.scale), -1.0, 1.0), band)
        own = [speed, -np.gradient(measured, run.time_s)] if kind.friction.viscous else []
        all_of = [body.inertia * np.gradient(speed, run.time_s), np.ones_like(speed), sign, *own, *waves]
        return np.stack(all_of, axis=1)[rows]

    x = columns(logged)
    independent = 2.0 * band * run.sample_time_s * len(y)
    if independent < 2.0 * x.shape[1] or not np.ptp(y):  # too short, or it coasts
        return Rigid(run.name, None, float("inf"), None, 0.0)
    values, std = _least_squares(x, y, independent)
    inertia_std, without = float(std[0]), list[float]()
    for part in np.array_split(np.arange(len(y)), PARTS):  # of a ripple that hangs together each shows another inertia
        its, error = _least_squares(np.delete(x, part, axis=0), np.delete(y, part), independent)
        without += [float(its[0])] if error[0] < 2.0 * std[0] else []
    if without:
        inertia_std = max(inertia_std, float(np.std(without)) * math.sqrt(len(without) - 1.0))
    power = y * logged[rows]
    works = kind.friction.viscous and float(np.mean(power)) > WORKS * float(np.mean(np.abs(power)))
    size = max(float(np.std(y)), 1e-300)
    shown = float(np.sqrt(np.mean(x[:, 0] ** 2))) / size
    left = float(np.var(y - x @ values)) / size**2
    taken = abs(float(values[0])) * shown
    like = left < UNLIKE and not (kind.friction.viscous and left > taken**2)
    given = float(np.mean((x[:, 2:4] @ values[2:4]) * logged[rows])) if kind.friction.viscous else 0.0
    most = size * float(np.sqrt(np.mean(logged[rows] ** 2)))
    # With a wrong sign the input would take power from friction; a load to and fro hides what friction takes.
    springs = values[0] < 0.0 and (works or given > SHOWN * most)
    turns = ONE_WAY < float(np.mean(logged[rows] > 0.0)) < 1.0 - ONE_WAY  # else a load passes for friction
    goes = values[0] > 0.0 and taken > MOST  # with the input: a flipped sign would turn that, too
    driven = turns and not goes and left < UNLIKE and given < -WORKS * most
    late = False
    odd = kind.friction.viscous and (values[0] < 0.0 or driven)
    for late_s in np.arange(0.125 / band, LATEST_S, 0.125 / band) if odd else ():
        early = columns(np.interp(run.time_s + late_s, run.time_s, logged))
        its, _ = _least_squares(early, y, independent)
        late |= its[0] > 0.0 and float(np.var(y - early @ its)) < min(AS_LATE * left, UNLIKE) * size**2
    told = like and not (springs or late) and std[0] < np.inf and abs(values[0]) > SURE * inertia_std and taken > SHOWN
    hold = float(values[1]) / body.hold if body.hold and std[1] < 0.1 * body.hold else None
    return Rigid(run.name, float(values[0]) if told else None, inertia_std, hold, float(values[2]), shown, late, driven)


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


def _machine_faults(bench: InverseSimulation, rigid: Sequence[Rigid], warnings: list[str]) -> Faults:
    """Signals upside down or in another unit, and runs of different machines."""
    yield from _wrong_signs(bench, rigid)
    yield from _wrong_units(bench, rigid)
    holds_load, struck = kind_of(bench.machine).holds_load, any(len(impacts) for impacts in bench.impacts)
    # An inertia is a warning only: a slow run hardly shows it, a load that swings, on a wire or on the machine, hides
    # some of it or adds to it; the load that is held says more. So is all where impacts of a play come again: the
    # inertia behind it goes with the motor part of the time only.
    for attribute, apart, what, remedy in (
        ("hold", LOADS_APART, "load", ", or is payload_kg wrong"),
        ("inertia", INERTIAS_APART, "inertia", ", or is their speed in another unit" if holds_load else ""),
    ):
        ratios = [(r.run, float(value)) for r in rigid if (value := getattr(r, attribute)) is not None]
        if (split := _two_groups(ratios, apart)) is None:
            continue
        others, odd = split
        its, is_it, s = ("its", "is it", "s") if len(odd) == 1 else ("their", "are they", "")
        said = (
            f"{listed([n for n, _ in odd])} disagree{s} with the machine and with the others: {its} {what} is "
            f"{_range(odd)} times the nominal one, that of {listed([n for n, _ in others])} {_range(others)} times; "
            f"{is_it} of another machine{remedy}?"
        )
        if attribute == "hold" and not struck:
            rest = [run.name for run in bench.runs if run.name not in dict(odd)]
            yield f"{said} Mend {'it' if len(odd) == 1 else 'them'}, or take the others alone ({','.join(rest)})", None
        warnings.append(f"{said[0].upper()}{said[1:]}")
    for attribute, what, odd_ratio in (("inertia", "inertia", ODD_INERTIA), ("hold", "load", ODD_LOAD)):
        known = [value for r in rigid if (value := getattr(r, attribute)) is not None]
        typical = float(np.median(known)) if known else 1.0
        if not 1.0 / odd_ratio <= typical <= odd_ratio:
            so = sum((value > 1.0) == (typical > 1.0) and not 1.0 / odd_ratio <= value <= odd_ratio for value in known)
            where = "all runs" if so == len(known) else f"{so} of the {len(known)} runs that show it"
            warnings.append(
                f"The {what} is about {typical:.2f} times what machine.yaml says in {where}; is it this machine's file?"
            )


def _wrong_signs(bench: InverseSimulation, rigid: Sequence[Rigid]) -> Faults:
    """On a hoist the load shows whether torque or speed has the wrong sign; on an axis it can be either."""
    signal, kind = bench.plant.input, kind_of(bench.machine)
    positive = f"{kind.directions.positive} is positive"
    sinking = [r for r in rigid if r.hold is not None and r.hold < 0.0]
    both = [r for r in sinking if r.inertia is not None and r.inertia > 0.0]
    torque = [r for r in sinking if r not in both]
    braked = [r for r in rigid if r.inertia is not None and r.inertia < 0.0 and r not in sinking]
    sound = [r for r in rigid if r.inertia is not None and r.inertia > 0.0]  # a flipped sign would turn it, too
    driven = [r for r in rigid if r.driven and r not in [*braked, *sound] and not any(other.late for other in rigid)]
    against_torque = (
        f"speed rises against the torque {{}}: is its sign flipped? {positive}; give its column a scale of -1"
        if kind.holds_load
        else f"speed rises against {signal} {{}}: is the sign of {signal} or of the motion flipped? {positive} for "
        "both; give the column a scale of -1"
    )
    for which, said in (
        (torque, "torque pulls the load down and falls where the load is lifted faster {}: is the sign of "
         f"{signal} flipped? {positive}; give its columns a scale of -1"),
        (both, "torque pulls the load down {}: are torque and speed both counted downwards? Up is positive; give both "
         "columns a scale of -1"),
        (braked, against_torque),
        (driven, "friction would drive the motion {}: " f"{signal} takes power from it all the way; is the sign of "
         f"{signal} or of the motion flipped? {positive} for both; give the column a scale of -1"),
    ):  # fmt: skip
        if which:
            yield said.format(_in_runs(which, bench.runs)), None


def _wrong_units(bench: InverseSimulation, rigid: Sequence[Rigid]) -> Faults:
    """A speed k times too large gives 1/k of the inertia, and so does an axis' force k times too small."""
    off = [r for r in rigid if r.inertia is not None and not 1.0 / WRONG_UNIT < r.inertia < WRONG_UNIT]
    if not off:
        return
    typical = float(np.median([r.inertia for r in off if r.inertia is not None]))
    load = kind_of(bench.machine).holds_load
    signals = bench.plant.speeds[0] if load else f"{bench.plant.input} or the motion"
    guess = f"is {signals} in another unit, or machine.yaml another machine's?"
    for unit, k in SPEED_SLIPS:
        if 0.7 < typical * k < 1.4:
            guess = f"is {signals} in {unit}? Then give the column a scale of {1.0 / k:.6g}"
            break
    yield (
        f"the torque that an acceleration takes is {typical:.3g} times what the nominal inertia needs "
        f"{_in_runs(off, bench.runs)}; {guess}",
        None,
    )


def listed(names: Sequence[str], most: int = 6) -> str:
    """run a; runs a, b and c"""
    if len(names) == 1:
        return f"run {names[0]}"
    shown, last = (names[:-1], names[-1]) if len(names) <= most else (names[:most], f"{len(names) - most} more")
    return f"runs {', '.join(shown)} and {last}"


def _in_runs(which: Sequence[Rigid], all_runs: Sequence[Run]) -> str:
    """in 4 of 6 runs (a, b, c, d)"""
    names = ", ".join(r.run for r in which)
    if len(all_runs) == 1:
        return f"in run {names}"
    many = f"all {len(all_runs)}" if len(which) == len(all_runs) else f"{len(which)} of {len(all_runs)}"
    return f"in {many} runs ({names})"


Ratios = list[tuple[str, float]]


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


# Effects that a campaign cannot tell apart because a run, a payload, a speed or a direction is missing.


def variety(bench: InverseSimulation) -> tuple[str, ...]:
    """Warnings as sentences; none if the campaign varies all of them."""
    sentences, going = list[str](), _going(bench)
    kind = kind_of(bench.machine)
    if len(going) == 1:
        of_runs = (
            "neither what the payload changes nor what the campaign's time does, and nothing is left to test on; "
            if kind.payload
            else "not what changes from run to run, and nothing is left to test on; "
        )
        can = "can show" if kind.payload else "cannot show"
        sentences.append(
            f"One run only: it {can} {of_runs.removeprefix('not ')}held-out figures are of parts of the same run."
        )
    elif kind.payload and kind.weight is not None:
        weights = [kind.weight(bench.machine, bench.runs[j].payload_kg) for j in going]
        if max(weights) - min(weights) < PAYLOADS_ALIKE * max(weights):
            sentences.append(
                f"All runs carry about {bench.runs[going[0]].payload_kg:g} kg: what grows with the load (gearbox "
                "efficiency, load-dependent friction, payload and torque scale) cannot be told from what does not."
            )
    speeds = [bench.speeds[j] for j in going]
    ahead = float(np.mean(np.concatenate([s[bench.moving[j]] for j, s in zip(going, speeds, strict=True)]) > 0.0))
    if not ONE_WAY < ahead < 1.0 - ONE_WAY:
        way, other = kind.directions.one_way[ahead <= 0.5]
        sentences.append(f"All runs only {way}: without {other}, friction cannot be told from the load or an offset.")
    if _one_speed(bench, going, speeds):
        sentences.append(
            "All runs move at one speed: only their ramps tell friction that grows or falls with the speed from a "
            "constant level; a slow run beside a fast one would show it."
        )
    coarse = {bench.runs[j].name: samples for j in going if (samples := _ramp(bench, j)) < FEW_SAMPLES}
    if coarse:
        sentences.append(
            f"The steepest ramps last {min(coarse.values()):.1f} samples in {listed(list(coarse))}: inertia, delays "
            "and what changes within a ramp hardly show; a faster log, or slower ramps, would show them."
        )
    return tuple(sentences)


def _ramp(bench: InverseSimulation, j: int) -> float:
    """Samples that the steepest ramps of run j take from its least to its largest speed, one in a hundred left out."""
    speed = bench.motions[j].speed
    steps = np.abs(np.diff(speed))[bench.moving[j][1:]]
    return float(np.ptp(speed) / max(float(np.percentile(steps, 99.0)), 1e-300)) if len(steps) else math.inf


def _one_speed(bench: InverseSimulation, going: Sequence[int], speeds: Sequence[Array]) -> bool:
    """Whether all phases of constant speed have the same speed; without such phases the speeds vary."""
    cruising, moving = [], 0
    for j, speed in zip(going, speeds, strict=True):
        acceleration = np.abs(np.gradient(speed, bench.runs[j].time_s))
        largest = float(np.max(acceleration[bench.moving[j]]))
        even = bench.moving[j] & (acceleration < EVEN * largest) & (np.abs(speed) > 0.02 * bench.scale)
        cruising.append(np.abs(speed[even]))
        moving += int(np.count_nonzero(bench.moving[j]))
    every = np.concatenate(cruising)
    if len(every) < 0.2 * moving:
        return False
    slow, fast = np.percentile(every, [5.0, 95.0])
    return bool(slow > ONE_SPEED * fast)
