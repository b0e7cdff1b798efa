"""A run's signals against each other and against its machine: units, sizes, frozen motion.

A log in mm under a name that says m, or in kN under one that says N, is off by a factor that no machine is off by; it
is refused with the factor that would fit. An optional signal of another unit or sign is left out.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.core.run import Array, integrated
from workbench.logs.raw_run import RawRun, is_constant, seconds, smoothed
from workbench.machines import Limits

TOO_FAST = 2.0  # times nominal speed, or the drive's top speed
TOO_STRONG = 4.0  # times the motors' nominal torque together
OVER_LIMIT = 2.0  # times the limit that an axis' drive states
MOVING = 0.05  # of nominal speed: faster than that counts as moving
HEAVY_PAYLOAD = 20.0  # times the carriage's mass
OFF_RAIL = 0.1  # of the segment length that the integrated speed may leave the rail by
TORQUE_RATIO = (0.2, 5.0)  # mean torque while moving over what holds the load: outside, the unit is wrong
TORQUE_RATIO_NOTE = (0.6, 1.6)
HARDLY = 0.02  # of the top speed or the limit: a machine at work reaches more
GAINED = 0.5  # of the top speed: what noise and a swing through the low-pass do not show
FAR = 2.0  # of two signals of one motion: beyond it, or below its inverse, one is in another unit
ALIKE = 0.9  # correlation: below, they do not show the same motion
OFF = 20.0  # times what the nominal machine takes for this motion, or a part of it
BEYOND = 200.0  # times: no part that machine.yaml lacks takes so much more than all that it has
STRAIGHT = 0.01  # of the way, rms: what stays beside a straight line in time is its noise
SMOOTH = 0.003  # of the run's duration
# What a factor is usually called.
UNITS = ((1e-3, "milli"), (1e-2, "centi"), (1e3, "kilo"), (1.0 / 60.0, "a minute"), (1e-3 / 60.0, "milli a minute"))
ANGLES = ((math.pi / 180.0, "degrees"), (2.0 * math.pi, "turns"), (2.0 * math.pi / 60.0, "rpm"), (1e-3, "milli"))
_SPEED_UNITS = (("rpm", 2.0 * math.pi / 60.0), ("degrees per second", math.pi / 180.0))


def check_plausible(run: RawRun) -> None:
    """Notes on unusual signals. InputError for signals that are impossible for this machine in these units.

    Sizes are judged for kinds whose machine.yaml says what they are built for.
    """
    kind = run.kind
    limits = None if kind.limits is None else kind.limits(run.machine)
    if limits is not None and run.payload_kg > HEAVY_PAYLOAD * limits.empty_mass_kg:
        run.notes.append(
            f"payload {run.payload_kg:g} kg is more than {HEAVY_PAYLOAD:g} times the carriage's mass; is it in kg?"
        )
    for name in kind.inputs:
        if name in run.values and not run.values[name].any():
            if kind.zero_input:
                raise run.fault(f"{run.label(name)} is zero throughout; {kind.zero_input}")
            _check_coasting(run, name)
    if limits is None:
        _check_axis_units(run)
    _check_standstill(run)
    if limits is not None:
        _check_speed(run, limits)
        _check_rail(run, limits)
        _check_torque(run, limits)


def _check_coasting(run: RawRun, name: str) -> None:
    """A note on a run without input: left to itself a machine coasts. InputError where it gains speed, as only a load
    could make it."""
    moved, role = run.speed if run.speed in run.values else run.position, getattr(run.machine, "role", None)
    width = max(SMOOTH * len(run.time_s), 1.0)
    smooth = smoothed(run.values[moved], width)
    speed = np.abs(smooth if moved == run.speed else np.gradient(smooth, run.time_s))
    loaded = role is not None and (role("gravity_sine") or role("gravity_constant"))
    gained, top = float(np.max(speed - np.minimum.accumulate(speed))), float(np.max(speed))
    if not loaded and gained > GAINED * top > 0.0:
        raise run.fault(f"{run.label(name)} is zero throughout, and the machine gains speed; is the channel dead?")
    run.notes.append(f"{run.label(name)} is zero throughout: the machine coasts, or the channel is dead; check it")


def _check_standstill(run: RawRun) -> None:
    """A note on a run at rest. An input that always holds a load is never constant in motion, nor motion under it."""
    holds, name = run.kind.holds_load, run.kind.plant.input
    at_rest, steady = all(is_constant(run.values[one]) for one in run.motion), is_constant(run.values[name])
    if at_rest and (not holds or steady or not any(run.values[one].any() for one in run.motion)):
        run.notes.append("the machine stands still throughout; this run says nothing of friction or inertia")
    elif holds and (at_rest or steady):
        name = run.motion[0] if at_rest else name
        raise run.fault(f"{run.label(name)} is {run.values[name][0]:g} throughout; is the channel frozen?")


def _check_speed(run: RawRun, limits: Limits) -> None:
    speed, label, limit = np.abs(run.values[run.speed]), run.label(run.speed), TOO_FAST * limits.nominal_speed
    fast = speed > limit
    if not fast.any():
        return
    typical = float(np.percentile(speed, 99.0))
    if typical > limit:
        fitting = [
            f"is it in {unit}? Then give the column a scale of {scale:.6g}"
            for unit, scale in _SPEED_UNITS
            if typical * scale <= limit
        ]
        hint = fitting[0] if fitting else "is it in another unit?"
        nominal = f"the machine's nominal speed is {limits.nominal_speed:g} rad/s"
        raise run.fault(f"{label} reaches {typical:.4g} rad/s, {nominal}; {hint}")
    run.notes.append(f"{label}: {_samples(run, fast)} beyond twice the nominal speed, {_first(run, fast)}")


def _samples(run: RawRun, which: np.ndarray) -> str:
    count = int(np.count_nonzero(which))
    return f"{count} sample{'s' * (count > 1)}"


def _first(run: RawRun, which: np.ndarray) -> str:
    return f"first at {seconds(run.time_s[int(np.argmax(which))])}"


def _check_rail(run: RawRun, limits: Limits) -> None:
    """The integrated speed must keep the carriage on the rail. This detects a wrong unit in slow runs too."""
    start = run.entry.start_position_m or 0.0
    height = start + run.kind.transmission_of(run.machine) * integrated(run.values[run.speed], run.time_s)
    low, high = limits.lowest, limits.highest
    beyond = np.maximum(low - height, height - high)
    beyond[0] = 0.0
    row = int(np.argmax(beyond))
    if beyond[row] <= 0.0:
        return
    text = (
        f"{run.label(run.speed)}, integrated from {start:g} m, takes the {run.kind.moved.noun} to "
        f"{height[row]:.4g} m at {seconds(run.time_s[row])}; the rail goes from {low:g} to {high:g} m"
    )
    if beyond[row] > OFF_RAIL * limits.length:
        raise run.fault(f"{text}; is the speed in rpm, its sign flipped, or start_position_m wrong?")
    run.notes.append(text)


def _check_torque(run: RawRun, limits: Limits) -> None:
    name, nominal = run.kind.plant.input, limits.nominal_input
    torque, speed = run.values[name], run.values[run.speed]
    strong, typical = np.abs(torque) > TOO_STRONG * nominal, float(np.percentile(np.abs(torque), 99.0))
    if typical > TOO_STRONG * nominal:
        raise run.fault(
            f"{run.label(name)} reaches {typical:.4g} N m, the motors' nominal "
            f"torque together is {nominal:g} N m; is it the drum's torque, or in another unit?"
        )
    if strong.any():
        beyond = f"beyond {TOO_STRONG:g} times the motors' nominal torque"
        run.notes.append(f"{name}: {_samples(run, strong)} {beyond}, {_first(run, strong)}")
    moving = np.abs(speed) > MOVING * limits.nominal_speed
    if np.count_nonzero(moving) < 0.1 * len(speed):
        return
    mean, holding = float(np.mean(torque[moving])), run.kind.rigid(run.machine, run.payload_kg).hold
    takes = f"holding carriage and payload takes {holding:.4g} N m"
    text = f"{run.label(name)} is {mean:.4g} N m on average while moving; {takes}"
    # Compared as products: a machine whose load is nearly nothing has no ratio.
    if not TORQUE_RATIO[0] * holding <= abs(mean) <= TORQUE_RATIO[1] * holding:
        unit = "is it in kN m or per cent" if abs(mean) < holding else "is it in another unit, a mass in tonnes"
        if strong.any():
            unit = f"are its {_samples(run, strong)} {beyond} spikes, is it in another unit"
        raise run.fault(f"{text}; {unit}, or is the payload wrong?")
    if mean < 0.0:
        run.notes.append(f"{text}; is its sign flipped?")
    elif not TORQUE_RATIO_NOTE[0] * holding <= mean <= TORQUE_RATIO_NOTE[1] * holding:
        half = "; is it one motor's only?" if limits.motors > 1 and mean < holding else ""
        run.notes.append(f"{text}{half}")


# Axes: their motion against itself, their input against what the motion takes.


def _check_axis_units(run: RawRun) -> None:
    """InputError for a signal that is another unit's."""
    drive = getattr(run.machine, "drive", None)
    if drive is None or len(run.time_s) < 50:
        return
    position, speed, name, time_s = run.position, run.speed, run.kind.plant.input, run.time_s
    if position in run.values and speed in run.values:
        _check_one_motion(run)
    moved = speed if speed in run.values else position
    width = max(SMOOTH * float(time_s[-1] - time_s[0]) / float(np.median(np.diff(time_s))), 1.0)
    smooth = smoothed(run.values[moved], width)
    if np.ptp(smooth) <= OFF * np.std(run.values[moved] - smooth):  # at rest, where friction holds any force
        return
    rate = smooth if moved == speed else np.gradient(smooth, time_s)
    fast, top = float(np.percentile(np.abs(rate), 99.0)), drive.top_speed
    if top and fast > TOO_FAST * top:
        fits = _fits(top / fast, moved, below=True)
        raise run.fault(f"{run.label(moved)} moves at {fast:.4g}, the drive's top speed is {top:g}; {fits}")
    force, unit = run.values[name], run.kind.drive.unit
    strong = float(np.percentile(np.abs(force), 99.0))
    if strong > OVER_LIMIT * drive.limit:
        fits = _fits(drive.limit / strong, name, below=True)
        limit = f"the drive's limit is {drive.limit:g} {unit}"
        raise run.fault(f"{run.label(name)} reaches {strong:.4g} {unit}, {limit}; {fits}")
    role = getattr(run.machine, "role", None)
    if role is None or fast == 0.0:
        return
    # What the nominal machine takes at most, rms: every part counted with its size.
    acceleration = float(np.sqrt(np.mean(np.gradient(rate, time_s) ** 2)))
    friction = max(role("coulomb_forward"), role("coulomb_backward")) + role("viscous") * fast
    taken = abs(run.kind.rigid(run.machine, 0.0).inertia) * acceleration + friction
    taken += abs(role("gravity_sine")) + abs(role("gravity_constant"))
    ratio = float(np.sqrt(np.mean(force**2))) / taken if taken > 0.0 and force.any() else 1.0
    if not 1.0 / OFF < ratio < OFF:
        text = (
            f"{run.label(name)} is {ratio:.3g} times what this machine takes for the motion of {run.label(moved)}; "
            f"{_fits(1.0 / ratio, name)} for {name}, or {_fits(ratio, moved)} for {moved}; "
            "or is machine.yaml another machine's?"
        )
        if not 1.0 / BEYOND < ratio < BEYOND:
            raise run.fault(text)
        run.notes.append(text)


def _check_one_motion(run: RawRun) -> None:
    """Position and integrated speed change alike; a drift of the integral and an offset say nothing of the unit, unless
    the machine goes on at one speed."""
    ways = integrated(run.values[run.speed], run.time_s), run.values[run.position]
    a, b = (y - np.polyval(np.polyfit(run.time_s, y, 1), run.time_s) for y in ways)
    slope = _slope(*((a, b) if np.std(a) > STRAIGHT * np.ptp(ways[0]) else ways))
    if slope is not None and not 1.0 / FAR < slope < FAR:
        raise run.fault(
            f"{run.label(run.position)} changes {slope:.4g} times as much as the integrated {run.label(run.speed)}; "
            f"{_fits(1.0 / slope, run.position)} for {run.position}, or {_fits(slope, run.speed)} for {run.speed}"
        )


def _fits(factor: float, signal: str, *, below: bool = False) -> str:
    """a scale of 0.001 (milli) would fit: the usual factor next to the one that is needed; below: every usual one that
    keeps below twice the one that is needed, and moves the machine at all."""
    units = ANGLES if "_rad" in signal else UNITS if signal.endswith("_m_s") else UNITS[:3]
    if below:
        fitting = [(s, u) for s, u in units if HARDLY * factor <= s <= TOO_FAST * factor]
    else:
        fitting = [min(units, key=lambda one: abs(math.log(abs(factor) / one[0])))]
        fitting = [(s, u) for s, u in fitting if abs(math.log(abs(factor) / s)) < math.log(3.0)]
    named = [f"{math.copysign(scale, factor):.6g} ({unit})" for scale, unit in fitting] or [f"{factor:.6g}"]
    return f"a scale of {' or '.join(named)} would fit"


def drop_wrong_scale(run: RawRun) -> None:
    """Optional signals of another unit or sign are dropped: against a redundant signal, or the load at rest."""
    kind, values = run.kind, run.values
    reference, follows = kind.reference
    twins: dict[str, tuple[str, Array]] = {reference: (follows, values[follows])} if follows in values else {}
    placed = kind.plant.positions[kind.plant.placed]
    if kind.transmission is not None and placed in values:
        way = kind.transmission(run.machine) * integrated(values[run.speed], run.time_s)
        twins[placed] = (f"the integrated {run.speed}", way)
    for name, (other, twin) in twins.items():
        slope = _slope(twin, values[name]) if name in values else None
        if slope is not None and not 1.0 / FAR < slope < FAR:
            what = "in another unit" if slope > 0.0 else "of another sign"
            run.drop(name, f"it changes {slope:.3g} times as much as {other} says; is it {what}?")
    if kind.dead_line is not None and (line := kind.dead_line.signal) in values:
        carried, mean = kind.dead_line.at_rest(run.machine, run.payload_kg), float(np.mean(values[line]))
        if not carried / FAR < mean < carried * FAR:
            at_rest = f"at rest the load makes it {carried:.4g} N"
            run.drop(line, f"it is {mean:.4g} N on average, {at_rest}; is it in another unit?")


def _slope(x: Array, y: Array) -> float | None:
    """Of y over x by least squares; None where they do not go together."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if not (xx > 0.0 and yy > 0.0 and np.isfinite(xx * yy)) or abs(xy) < ALIKE * np.sqrt(xx) * np.sqrt(yy):
        return None
    return xy / xx
