"""The comparison in sentences; each says what changes, or that it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from workbench.consequences.motion import REFERENCES
from workbench.consequences.phases import PHASES, from_the_cold, per_run
from workbench.consequences.record import Change, Choice, Consequences, LoopFigures, percent
from workbench.effects import find
from workbench.machine import Hoist
from workbench.study.conclude.variation_sentences import NO_CHANGE, listed

SMALL = 100.0 * NO_CHANGE  # per cent
GAIN_MOVES = 3.0  # per cent of a gain: less is within what tuning by hand leaves
AT_LIMIT = 99.9  # per cent of the torque limit


def sentences_of(consequences: Consequences, corrected: Hoist) -> tuple[str, ...]:
    """In order: what was run, failures, torque, tracking, wire, time, better reference, loop, gains, caveats."""
    return (
        _what(consequences),
        *_failures(consequences.rows),
        *_limited(consequences.rows, corrected),
        *_figures(consequences.rows),
        *_time(consequences.rows),
        *(_better(consequences.choices, metric, words) for metric, words in _CHOSEN_BY),
        _loop(consequences),
        _gains(consequences),
        *_caveats(corrected),
    )


def _what(consequences: Consequences) -> str:
    s = consequences.study
    source = "as the campaign's runs do at most" if s.from_runs else "by default"
    origin = "" if s.controller_given else ", by rule"
    known = consequences.effects
    effects = f"without and with {listed(known)}" if known else "before and after its correction"
    payloads = listed([f"{load:g}" for load in s.payloads_kg])
    return (
        f"The machine {effects}: up by {s.travel_m:g} m from {s.start_position_m:g} m and down again, "
        f"{s.limits.speed_m_s:g} m/s and {s.limits.acceleration_m_s2:g} m/s² {source}, jerk {s.limits.jerk_m_s3:g} "
        f"m/s³; {payloads} kg; one controller (kp {s.controller.kp_nm_s_per_rad:g} N m s/rad, "
        f"ki {s.controller.ki_nm_per_rad:g} N m/rad{origin})."
    )


def _failures(rows: Sequence[Change]) -> Iterator[str]:
    groups: dict[tuple[float, bool, str], list[Change]] = {}
    for row in rows:
        if not row.ok:
            # Where the motors cannot hold the load, how far it fell says nothing.
            reason = (row.after.reason or row.before.reason).rpartition("; ")[2]
            groups.setdefault((row.payload_kg, row.before.ok, reason), []).append(row)
    for (payload, was_ok, reason), alike in groups.items():
        which = "with either reference" if len(alike) == len(REFERENCES) else f"with the {alike[0].reference} reference"
        if was_ok:
            yield f"At {payload:g} kg {which} the move is no longer possible: {reason}."
        elif alike[0].after.ok:
            yield f"At {payload:g} kg {which} the move is possible now; before: {reason}."
        else:
            yield f"At {payload:g} kg {which} the move is possible neither before nor after: {reason}."


def _limited(rows: Sequence[Change], machine: Hoist) -> Iterator[str]:
    most = AT_LIMIT * machine.drive.overload
    new = [row for row in rows if row.ok and row.after.peak_torque_percent >= most > row.before.peak_torque_percent]
    if new:
        where = listed([f"{row.payload_kg:g} kg with {row.reference}" for row in new])
        yield f"The motors now reach their torque limit at {where}."


_FIGURES = (
    ("peak_torque_motor_nm", "torque peak per motor", "N m", 1.0),
    ("speed_error_max_rad_s", "largest speed error of the motor", "rad/s", 1.0),
    ("min_wire_tension_n", "least wire tension", "kN", 1e-3),
)


def _figures(rows: Sequence[Change]) -> Iterator[str]:
    good = [row for row in rows if row.ok]
    for metric, words, unit, scale in _FIGURES if good else ():
        if metric == "min_wire_tension_n" and (slack := [row for row in good if row.after.min_wire_tension_n <= 0.0]):
            where = listed([f"{row.payload_kg:g} kg with {row.reference}" for row in slack])
            was = all(row.before.min_wire_tension_n <= 0.0 for row in slack)
            yield f"The wire goes slack at {where}{', as before' if was else ''}."
            continue
        changes = [row.percent(metric) for row in good]
        low, high = min(changes), max(changes)
        most = max(good, key=lambda row: abs(row.percent(metric)))
        if max(abs(low), abs(high)) < SMALL:
            yield f"The {words} does not change."
            continue
        before, after = (scale * getattr(run, metric) for run in (most.before, most.after))
        yield (
            f"The {words} changes by {_span(low, high)}, most at {most.payload_kg:g} kg with {most.reference}: "
            f"{before:.3g} to {after:.3g} {unit}."
        )


def _span(low: float, high: float) -> str:
    """A range of changes in per cent; an end of zero is omitted."""
    if f"{low:+.1f}" == f"{high:+.1f}":
        return f"{high:+.1f} %"
    if abs(low) < SMALL or abs(high) < SMALL:
        return f"up to {max(low, high, key=abs):+.1f} %"
    return f"{low:+.1f} to {high:+.1f} %"


def _time(rows: Sequence[Change]) -> Iterator[str]:
    by = {(row.payload_kg, row.reference): row.before.move_time_s for row in rows}
    payload = rows[0].payload_kg
    longer = by[payload, "ruckig"] - by[payload, "trapezoid"]
    if math.isfinite(longer):
        yield (
            f"Move times do not change, for they follow from the limits: ruckig takes {longer:.2g} s longer than the "
            "trapezoid over both moves."
        )


_CHOSEN_BY = (("peak_torque_motor_nm", "torque peak at equal limits"), ("speed_error_max_rad_s", "tracking error"))


def _better(choices: Sequence[Choice], metric: str, words: str) -> str:
    mine = [choice for choice in choices if choice.metric == metric]
    single = [choice for choice in mine if choice.payload_kg is not None]
    moved = [choice for choice in single if choice.changed]
    if moved:
        cases = [f"at {c.payload_kg:g} kg {_name(c.after)} instead of {_name(c.before)}" for c in moved]
        return f"By {words} the better reference is another one now: {listed(cases)}."
    known = [choice for choice in single if choice.before and choice.after]
    if not known:
        return f"By {words} the references cannot be compared, for runs failed."
    names = list(dict.fromkeys(choice.after for choice in known))
    if len(names) > 1:
        cases = [f"{_name(c.after)} at {c.payload_kg:g} kg" for c in known]
        return f"By {words} the better reference stays the same: {listed(cases)}."
    if names == ["alike"]:
        return f"By {words} both references stay alike."
    where = "at every payload" if len(known) > 1 else f"at {known[0].payload_kg:g} kg"
    where += " that both move" if 1 < len(known) < len(single) else ""
    return f"By {words} {names[0]} stays the better reference {where}."


def _name(reference: str) -> str:
    return "neither" if reference == "alike" else reference


def _loop(consequences: Consequences) -> str:
    a, b = consequences.loop_before, consequences.loop_after
    if not b.stable:
        was = "" if a.stable else ", as before"
        return f"The speed loop is unstable at {b.payload_kg:g} kg and {b.height_m:g} m{was}."
    if not a.stable:
        return f"The speed loop, unstable before at {a.payload_kg:g} kg, is stable: Ms {b.ms:.2f}."
    moved, still = [], []
    for name, least, show, x, y in (
        ("the least gain margin", 0.5, _db, a.gain_margin_db, b.gain_margin_db),
        ("the least phase margin", 1.0, "{:.0f}°".format, a.phase_margin_deg, b.phase_margin_deg),
        ("the largest Ms", 0.01, "{:.2f}".format, a.ms, b.ms),
    ):
        if x == y or abs(y - x) < least:
            still.append(f"{name} is {show(y)}")
        else:
            moved.append(f"{name} goes from {show(x)} to {show(y)}")
    if not moved:
        return f"The loop's margins do not change: at the least, {_stay(b)}."
    return f"Over loads and heights, {listed(moved)}" + (f"; {listed(still)} as before." if still else ".")


def _stay(loop: LoopFigures) -> str:
    phase = f"{loop.phase_margin_deg:.0f}°"
    return f"the gain margin is {_db(loop.gain_margin_db)}, the phase margin {phase}, Ms {loop.ms:.2f}"


def _db(value: float) -> str:
    return f"{value:.1f} dB" if math.isfinite(value) else "without bound"


def _gains(consequences: Consequences) -> str:
    bandwidth, ms = consequences.gains_goal
    goal = "the best rejection of load steps" if bandwidth is None else f"a bandwidth of {bandwidth:g} Hz"
    bound = f"Ms {'' if bandwidth is None else 'and Mt '}at most {ms:g}"
    before, after = consequences.gains_before, consequences.gains_after
    if not after.ok:
        was = "" if before.ok else ", nor before"
        return f"For {goal} with {bound} loop shaping finds no gains{was}: {after.reason}."
    now = f"kp {after.kp_nm_s_per_rad:.3g} N m s/rad, ki {after.ki_nm_per_rad:.3g} N m/rad"
    if not before.ok:
        return f"For {goal} with {bound} loop shaping now finds {now}; before: {before.reason}."
    kp = percent(before.kp_nm_s_per_rad, after.kp_nm_s_per_rad)
    ki = percent(before.ki_nm_per_rad, after.ki_nm_per_rad)
    if max(abs(kp), abs(ki)) < GAIN_MOVES:
        return f"For {goal} with {bound} the recommended gains stay: {now}."
    old = consequences.old_gains_bandwidth_hz
    left = "make the loop unstable" if math.isnan(old) else f"give {old:.3g} Hz"
    return (
        f"For {goal} with {bound} the recommended gains are others now: {now} instead of kp "
        f"{before.kp_nm_s_per_rad:.3g}, ki {before.ki_nm_per_rad:.3g} ({kp:+.0f} %, {ki:+.0f} %); the old ones {left}."
    )


def _caveats(machine: Hoist) -> Iterator[str]:
    if own := per_run(machine):
        yield (
            f"In each run {listed(own)} has a phase of its own: every run was made at {PHASES} phases, and each figure "
            "is the worst of them."
        )
    if cold := from_the_cold(machine):
        yield f"Time counts from the start of the campaign, so {listed(cold)} is as on the cold machine."
    if outside := [name for name in machine.effects if find(name, "hoist").on_sensor]:
        yield f"On the log alone, so that neither runs nor loop know of it: {listed(outside)}."
    drive = machine.drive
    if not (drive.torque_lag_s or drive.speed_filter_s or drive.speed_delay_s):
        yield "The machine's drive has no lag, filter or delay, so its margins are those of sampling alone."
