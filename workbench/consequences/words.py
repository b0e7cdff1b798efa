"""The comparison in sentences; each says what changes, or that it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from workbench.consequences.motion import REFERENCES
from workbench.consequences.phases import PHASES, from_the_cold, per_run
from workbench.consequences.record import Change, Choice, Consequences, LoopFigures, percent
from workbench.control import Cascade
from workbench.effects import find
from workbench.kinds import Kind, kind_of
from workbench.machine import Axis, Hoist
from workbench.metrics import set_of
from workbench.study.findings import NO_CHANGE
from workbench.study.labels import listed

SMALL = 100.0 * NO_CHANGE  # per cent
GAIN_MOVES = 3.0  # per cent of a gain: less is within what tuning by hand leaves
AT_LIMIT = 0.999  # of the limit


def sentences_of(consequences: Consequences, corrected: Hoist | Axis) -> tuple[str, ...]:
    """In order: what was run, failures, torque, tracking, wire, time, better reference, loop, gains, caveats."""
    kind = consequences.study.kind
    return (
        _what(consequences),
        *_failures(consequences.rows, kind),
        *_limited(consequences.rows, corrected),
        *_figures(consequences.rows, kind),
        *_time(consequences.rows),
        *(_better(consequences.choices, metric, words, kind) for metric, words in _chosen_by(kind)),
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
    c, unit = s.controller, s.kind.moved.unit
    way, back = ("up", "down") if s.kind.payload else ("forward", "back")
    loads = f" {payloads} kg;" if s.kind.payload else ""
    kv = f"kv {c.kv_per_s:g} 1/s, " if isinstance(c, Cascade) else ""
    return (
        f"The machine {effects}: {way} by {s.travel_m:g} {unit} from {s.start_position_m:g} {unit} and {back} again, "
        f"{s.limits.speed_m_s:g} {unit}/s and {s.limits.acceleration_m_s2:g} {unit}/s² {source}, jerk "
        f"{s.limits.jerk_m_s3:g} {unit}/s³;{loads} one controller ({kv}kp {c.kp:g} {c.UNITS[0]}, ki {c.ki:g} "
        f"{c.UNITS[1]}{origin})."
    )


def _at(kind: Kind, payload_kg: float, reference: str = "") -> str:
    """`4500 kg with ruckig`; of an axis its reference."""
    load = [f"{payload_kg:g} kg"] if kind.payload else []
    return " with ".join([*load, *([reference] if reference else [])])


def _failures(rows: Sequence[Change], kind: Kind) -> Iterator[str]:
    groups: dict[tuple[float, bool, str], list[Change]] = {}
    for row in rows:
        if not row.ok:
            # Where the motors cannot hold the load, how far it fell says nothing.
            reason = (row.after.reason or row.before.reason).rpartition("; ")[2]
            groups.setdefault((row.payload_kg, row.before.ok, reason), []).append(row)
    for (payload, was_ok, reason), alike in groups.items():
        which = "with either reference" if len(alike) == len(REFERENCES) else f"with the {alike[0].reference} reference"
        start = f"At {payload:g} kg {which}" if kind.payload else f"{which[0].upper()}{which[1:]}"
        if was_ok:
            yield f"{start} the move is no longer possible: {reason}."
        elif alike[0].after.ok:
            yield f"{start} the move is possible now; before: {reason}."
        else:
            yield f"{start} the move is possible neither before nor after: {reason}."


def _limited(rows: Sequence[Change], machine: Hoist | Axis) -> Iterator[str]:
    kind = kind_of(machine)
    most, peak = AT_LIMIT * kind.looped.peak_limit(machine), set_of(kind.name).peak
    new = [row for row in rows if row.ok and row.after[peak] >= most > row.before[peak]]
    if new and kind.payload:
        where = listed([_at(kind, row.payload_kg, row.reference) for row in new])
        yield f"The motors now reach their torque limit at {where}."
    elif new:
        where = listed([row.reference for row in new])
        yield f"The drive now reaches its {kind.drive.quantity} limit with {where}."


Told = tuple[str, str, str, float]  # metric, in words, unit, scale

_HOIST_FIGURES: tuple[Told, ...] = (
    ("peak_torque_motor_nm", "torque peak per motor", "N m", 1.0),
    ("speed_error_max_rad_s", "largest speed error of the motor", "rad/s", 1.0),
    ("min_wire_tension_n", "least wire tension", "kN", 1e-3),
)


def figures_told(kind: Kind) -> tuple[Told, ...]:
    """The metrics that sentences and figures tell."""
    if kind.payload:
        return _HOIST_FIGURES
    judged = set_of(kind.name)
    chosen = (judged.by_name[name] for name in (judged.peak, judged.rms, judged.error, "settling_time_s"))
    return tuple((m.name, m.label, m.shown_unit, m.scale) for m in chosen)


def _figures(rows: Sequence[Change], kind: Kind) -> Iterator[str]:
    good = [row for row in rows if row.ok]
    for metric, words, unit, scale in figures_told(kind) if good else ():
        if metric == "min_wire_tension_n" and (slack := [row for row in good if row.after[metric] <= 0.0]):
            where = listed([_at(kind, row.payload_kg, row.reference) for row in slack])
            was = all(row.before[metric] <= 0.0 for row in slack)
            yield f"The wire goes slack at {where}{', as before' if was else ''}."
            continue
        changes = [row.percent(metric) for row in good]
        low, high = min(changes), max(changes)
        most = max(good, key=lambda row: abs(row.percent(metric)))
        if max(abs(low), abs(high)) < SMALL:
            yield f"The {words} does not change."
            continue
        before, after = (scale * run[metric] for run in (most.before, most.after))
        where = (
            f"most at {_at(kind, most.payload_kg, most.reference)}" if kind.payload else f"most with {most.reference}"
        )
        yield f"The {words} changes by {_span(low, high)}, {where}: {before:.3g} to {after:.3g} {unit}."


def _span(low: float, high: float) -> str:
    """A range of changes in per cent; an end of zero is omitted."""
    if f"{low:+.1f}" == f"{high:+.1f}":
        return f"{high:+.1f} %"
    if abs(low) < SMALL or abs(high) < SMALL:
        return f"up to {max(low, high, key=abs):+.1f} %"
    return f"{low:+.1f} to {high:+.1f} %"


def _time(rows: Sequence[Change]) -> Iterator[str]:
    by = {(row.payload_kg, row.reference): row.before["move_time_s"] for row in rows}
    payload = rows[0].payload_kg
    longer = by[payload, "ruckig"] - by[payload, "trapezoid"]
    if math.isfinite(longer):
        yield (
            f"Move times do not change, for they follow from the limits: ruckig takes {longer:.2g} s longer than the "
            "trapezoid over both moves."
        )


def _chosen_by(kind: Kind) -> tuple[tuple[str, str], ...]:
    judged = set_of(kind.name)
    return ((judged.peak, f"{judged.input_words} peak at equal limits"), (judged.error, "tracking error"))


def _better(choices: Sequence[Choice], metric: str, words: str, kind: Kind) -> str:
    mine = [choice for choice in choices if choice.metric == metric]
    single = [choice for choice in mine if choice.payload_kg is not None]
    moved = [choice for choice in single if choice.changed]
    if moved:
        load = ["" if c.payload_kg is None or not kind.payload else f"at {c.payload_kg:g} kg " for c in moved]
        cases = [f"{at}{_name(c.after)} instead of {_name(c.before)}" for at, c in zip(load, moved, strict=True)]
        return f"By {words} the better reference is another one now: {listed(cases)}."
    known = [choice for choice in single if choice.before and choice.after]
    if not known:
        return f"By {words} the references cannot be compared, for runs failed."
    names = list(dict.fromkeys(choice.after for choice in known))
    if len(names) > 1:
        cases = [f"{_name(c.after)} at {c.payload_kg:g} kg" for c in known]
        return f"By {words} the better reference stays the same: {listed(cases)}."
    if not kind.payload and names != ["alike"]:
        return f"By {words} {names[0]} stays the better reference."
    if names == ["alike"]:
        return f"By {words} both references stay alike."
    where = "at every payload" if len(known) > 1 else f"at {known[0].payload_kg:g} kg"
    where += " that both move" if 1 < len(known) < len(single) else ""
    return f"By {words} {names[0]} stays the better reference {where}."


def _name(reference: str) -> str:
    return "neither" if reference == "alike" else reference


def _loop(consequences: Consequences) -> str:
    a, b = consequences.loop_before, consequences.loop_after
    kind = consequences.study.kind
    name = "speed loop" if kind.payload else "loop"
    if not b.stable:
        was = "" if a.stable else ", as before"
        load = f"{b.payload_kg:g} kg and " if kind.payload else ""
        return f"The {name} is unstable at {load}{b.height_m:g} {kind.moved.unit}{was}."
    if not a.stable:
        return f"The {name}, unstable before at {_at(kind, a.payload_kg) or 'some places'}, is stable: Ms {b.ms:.2f}."
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
    over = "Over loads and heights" if kind.payload else "Over its positions"
    return f"{over}, {listed(moved)}" + (f"; {listed(still)} as before." if still else ".")


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
    kp_unit, ki_unit = consequences.study.controller.UNITS
    now = f"kp {after.kp:.3g} {kp_unit}, ki {after.ki:.3g} {ki_unit}"
    if not before.ok:
        return f"For {goal} with {bound} loop shaping now finds {now}; before: {before.reason}."
    kp = percent(before.kp, after.kp)
    ki = percent(before.ki, after.ki)
    if max(abs(kp), abs(ki)) < GAIN_MOVES:
        return f"For {goal} with {bound} the recommended gains stay: {now}."
    old = consequences.old_gains_bandwidth_hz
    left = "make the loop unstable" if math.isnan(old) else f"give {old:.3g} Hz"
    return (
        f"For {goal} with {bound} the recommended gains are others now: {now} instead of kp "
        f"{before.kp:.3g}, ki {before.ki:.3g} ({kp:+.0f} %, {ki:+.0f} %); the old ones {left}."
    )


def _caveats(machine: Hoist | Axis) -> Iterator[str]:
    if own := per_run(machine):
        yield (
            f"In each run {listed(own)} has a phase of its own: every run was made at {PHASES} phases, and each figure "
            "is the worst of them."
        )
    if cold := from_the_cold(machine):
        yield f"Time counts from the start of the campaign, so {listed(cold)} is as on the cold machine."
    if outside := [name for name in machine.effects if find(name, kind_of(machine).name).on_sensor]:
        yield f"On the log alone, so that neither runs nor loop know of it: {listed(outside)}."
    drive = machine.drive
    if not (drive.torque_lag_s or drive.speed_filter_s or drive.speed_delay_s):
        yield "The machine's drive has no lag, filter or delay, so its margins are those of sampling alone."
