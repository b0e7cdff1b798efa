"""What a study found beside its decision: what went wrong, what a sweep or a sample does, what the machine bears."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.core.table import Column, Table, words
from workbench.machines import Axis, Hoist, kind_of
from workbench.metrics import View, set_of, shown_in
from workbench.study.labels import SweptAxis, drawn_columns, listed, reads, run_in_words, shown, swept_axes
from workbench.study.pareto import Front, fronts, rank_correlations
from workbench.study.rows import ASTRAY_M, SWINGS_PER_S, Row, hunts, is_astray, metrics_of, swings_per_s
from workbench.study.run import peak_limit

MOST_FAILED = 3
NO_CHANGE = 0.005  # relative: less is no effect worth a sentence
AT_THE_LIMIT = 0.85  # rms over limit: three quarters of the time are spent there


def sentences(rows: Sequence[Row], limit: float) -> list[str]:
    """All findings, first what went wrong. limit: the largest torque of one motor, an axis' largest input, or inf."""
    return [*troubles(rows, limit), *variations(rows)]


def troubles(rows: Sequence[Row], limit: float) -> list[str]:
    """Runs that failed, are at a limit, hunt, go slack or end elsewhere: each can turn the decision round."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    failures = " ".join(_failures(rows))
    said = [failures] if failures else []
    if not good:
        return said
    judged = metrics_of(good)
    own_limits = any("drive." in column or "motor." in column for column in good[0].assigned)
    at_limit = [row for row in good if row[judged.peak] >= limit * (1.0 - 1e-9) and not own_limits]
    stuck = [row for row in at_limit if row[judged.rms] >= AT_THE_LIMIT * limit]
    if at_limit:
        value = f"{judged.by_name[judged.peak].text(limit)} {judged.input_unit}"
        said.append(f"The {judged.input_words} limit of {value} is reached{_which(at_limit, good, axes)}.")
    if stuck:
        cannot = "motors cannot" if judged.payload else "drive cannot"
        said.append(
            f"The {judged.input_words} is at its limit nearly all the time{_which(stuck, good, axes)}: the loop swings "
            f"from limit to limit, or the {cannot} carry the load."
        )
    if hunting := [row for row in good if hunts(row)]:
        worst = max(hunting, key=swings_per_s)
        said.append(
            f"The torque swings by more than nominal torque{_which(hunting, good, axes)}; most often "
            f"{_name(worst, axes)}, {swings_per_s(worst):.0f} times a second of motion: the loop hunts."
        )
    if slack := [row for row in good if row.get("slack_time_s") > 0.0]:
        longest = max(slack, key=lambda row: row["slack_time_s"])
        said.append(
            f"The wire goes slack{_which(slack, good, axes)}; longest {longest['slack_time_s']:.2g} s "
            f"({_name(longest, axes)}). It tightens again with a jerk."
        )
    if astray := [row for row in good if is_astray(row)]:
        worst = max(astray, key=lambda row: abs(row[judged.end]))
        error, metric = worst[judged.end], judged.by_name[judged.end]
        amount = f"{abs(error):.2f} m" if judged.payload else f"{metric.text(abs(error))} {metric.shown_unit}"
        said.append(
            f"The {judged.moved} does not end where its reference does{_which(astray, good, axes)}; farthest off "
            f"{_name(worst, axes)}, {amount} {judged.sides[0] if error > 0.0 else judged.sides[1]} it."
        )
    return said


def _failures(rows: Sequence[Row]) -> Iterator[str]:
    failed = [row for row in rows if not row.ok]
    yield from (f"{row.run_id} failed: {row.reason}." for row in failed[:MOST_FAILED])
    if len(failed) > MOST_FAILED:
        yield f"{len(failed) - MOST_FAILED} more of {len(rows)} runs failed; the index says why."


def _which(rows: Sequence[Row], good: Sequence[Row], axes: Sequence[SweptAxis]) -> str:
    """`: a, b, c` of a few runs; of many how many, and the first."""
    names = [_name(row, axes) for row in rows]
    if len(names) <= (3 if rows[0].assigned else 6):
        return f": {('; ' if rows[0].assigned else ', ').join(names)}"
    return f" in {len(names)} of {len(good)} runs, the first {names[0]}"


def _name(row: Row, axes: Sequence[SweptAxis]) -> str:
    return run_in_words(row, axes) if row.assigned else row.run_id


def variations(rows: Sequence[Row], told: bool = False) -> list[str]:
    """What a sweep or a sample does; of a study that varies nothing, and has `told` no decision, the largest peak."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    if not good:
        return []
    heaviest = max(row.payload_kg for row in good)
    here = [row for row in good if row.payload_kg == heaviest]
    paid = any(".limits." in column for axis in axes for column in axis.columns)
    said = [_knee(front, axes) for front in fronts(good)[-1:] if front.knee is not None] if paid else []
    said += [text for axis in axes for text in _effect(axis, here, heaviest)]
    if drawn_columns(good):
        said += scatter(good)
    if said or told:
        return said
    judged = metrics_of(good)
    worst = max(good, key=lambda row: row[judged.peak])
    peak = f"{judged.by_name[judged.peak].text(worst[judged.peak])} {judged.input_unit}"
    share = f" ({worst['peak_torque_percent']:.0f} % of nominal)" if judged.payload else ""
    where = f" at {worst.payload_kg:g} kg" if judged.payload else ""
    return [f"The largest {judged.input_words} peak is {peak}{share}, with {worst.reference}{where}."]


def _effect(axis: SweptAxis, rows: Sequence[Row], payload_kg: float) -> Iterator[str]:
    """What an axis does at the heaviest payload, of all runs at a value the worst; only of references that read it."""
    rows = [row for row in rows if any(reads(row.reference, column) for column in axis.columns)]
    groups = {point: [row for row in rows if axis.at(row) == point] for point in axis.points}
    groups = {point: members for point, members in groups.items() if members}
    if len(groups) < 2:
        return
    points, judged = list(groups), metrics_of(rows)
    several = max(map(len, groups.values())) > 1
    at = f"at {payload_kg:g} kg" if judged.payload else ""
    where = f"{at}, the worst runs," if several and at else "in the worst runs" if several else at
    parts, same = [], []
    for metric in shown_in(View.SENTENCES, judged):
        if not all(row.metrics.get(metric.name) is not None for row in rows):
            continue
        values = [metric.scale * metric.worst([row[metric.name] for row in groups[point]]) for point in points]
        if max(values) - min(values) > NO_CHANGE * max(map(abs, values)):
            parts.append(f"the {metric.label} {_course(axis, points, values, metric.shown_unit)}")
        else:
            same.append(metric.label)
    if not parts:
        to = f"the worst runs' {listed(same)}; single runs may differ" if several else listed(same)
        yield f"{axis.words.capitalize()} makes no difference {f'{at} ' if at else ''}to {to}."
        return
    start = f"{axis.words.capitalize()} from {axis.short(points[0])} to {axis.short(points[-1])}"
    yield f"{start if axis.numeric else axis.words.capitalize()}: {where} {listed(parts)}."


def _course(axis: SweptAxis, points: Sequence[tuple[float | str, ...]], values: Sequence[float], unit: str) -> str:
    """From end to end, with the extreme between them where there is one; of words each."""
    if not axis.numeric:
        return "is " + ", ".join(f"{v:.3g} {unit} with {shown(p[0])}" for p, v in zip(points, values, strict=True))
    text = f"goes from {values[0]:.3g} to {values[-1]:.3g} {unit}"
    reach = max(abs(value) for value in values) * NO_CHANGE
    low, high = int(np.argmin(values)), int(np.argmax(values))
    if values[low] < min(values[0], values[-1]) - reach:
        return f"{text}, with its least, {values[low]:.3g} {unit}, at {axis.short(points[low])}"
    if values[high] > max(values[0], values[-1]) + reach:
        return f"{text}, with its most, {values[high]:.3g} {unit}, at {axis.short(points[high])}"
    return text


def _knee(front: Front, axes: Sequence[SweptAxis]) -> str:
    """Where a front of move time against the peak turns, and whether that is at the edge of what was swept."""
    knee = front.knee
    assert knee is not None
    judged = metrics_of([knee])
    peak = judged.by_name[front.costs[1]]
    setting = ", ".join(axis.say(axis.at(knee)) for axis in axes)
    ends = [f"{row['move_time_s']:.4g} s for {peak.text(row[peak.name])}" for row in (front.rows[0], front.rows[-1])]
    edges = [axis for axis in axes if _at_edge(axis, knee)]
    said = (
        f"{f'At {front.payload_kg:g} kg the' if judged.payload else 'The'} knee of move time against {peak.label} is "
        f"{knee.reference} with {setting}: {knee['move_time_s']:.4g} s and {peak.text(knee[peak.name])} "
        f"{peak.shown_unit}, between {' and '.join(ends)} at the ends"
    )
    if edges:
        said += f"; it lies at the edge of {listed([axis.words for axis in edges])}: widen that range"
    return f"{said}."


def _at_edge(axis: SweptAxis, row: Row) -> bool:
    read = any(reads(row.reference, column) for column in axis.columns)
    return read and axis.numeric and len(axis.points) > 2 and axis.at(row) in (axis.points[0], axis.points[-1])


def scatter(good: Sequence[Row]) -> list[str]:
    """Of a sample: the spread of the peak for each payload and reference, and what it depends on."""
    texts = []
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in good:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    for (payload, reference), rows in groups.items():
        if len(rows) < 3:
            continue
        judged = metrics_of(rows)
        metric = judged.by_name[judged.peak]
        low, middle, high, most = np.quantile([row[judged.peak] for row in rows], (0.05, 0.5, 0.95, 1.0))
        ranked = rank_correlations(rows, drawn_columns(good), judged.peak)
        strong = [f"{r.label.words} (rank correlation {r.value:+.2f})" for r in ranked if abs(r.value) >= 0.2][:3]
        texts.append(
            f"Over {len(rows)} runs {f'at {payload:g} kg ' if judged.payload else ''}with {reference} the "
            f"{metric.label} is {metric.text(middle)} {metric.unit} in the median, {metric.text(low)} to "
            f"{metric.text(high)} {metric.unit} in nine of ten, {metric.text(most)} {metric.unit} at most"
            f"{f'; it goes with {listed(strong)}' if strong else ''}."
        )
    return texts


Light = Literal["green", "amber", "red"]
WIRE_SAFETY = 4.5  # least breaking load over tension of a running rope, mechanism group M5 (ISO 4308-1)
OVERSPEED = (
    1.2  # of nominal speed, where the field is weakened: a drive's own limit (ABB ACS850 firmware manual, 20.01)
)
AMBER, RED = 85.0, 99.9  # % of what is borne
MANY = 1000.0  # % from which on a share is said in times
SIGN = {"green": "●", "amber": "▲", "red": "■"}  # told apart without colour, too


@dataclass(frozen=True)
class Use:
    """percent: of what is borne, in the run that uses most. bound: what that is, in words; where: that run."""

    what: str
    percent: float
    bound: str
    where: str

    @property
    def used(self) -> str:
        """`104 % of`, `176 times`."""
        return f"{self.percent:.0f} % of" if self.percent < MANY else f"{self.percent / 100.0:.0f} times"

    @property
    def light(self) -> Light:
        return "red" if self.percent >= RED else "amber" if self.percent > AMBER else "green"


def utilisation(rows: Sequence[Row], machine: Hoist | Axis) -> list[Use]:
    """Torque peak, rms torque, overload, speed, wire, place of the stop; those that the runs know."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    shares = _SHARES.get(kind_of(machine).name, _axis_shares)(machine)
    uses = []
    for what, name, scale, bound in shares:
        known = [row for row in good if row.metrics.get(name) is not None]
        if known:
            worst = max(known, key=lambda row: abs(row[name]))
            uses.append(Use(what, scale * abs(worst[name]), bound, run_in_words(worst, axes)))
    return [*uses, *_hunting_use(good, axes), *_wire(good, axes)]


Share = tuple[str, str, float, str]  # what, metric, per cent per unit of it, of what


def _hoist_shares(machine: Any) -> tuple[Share, ...]:
    limit, nominal, drive = peak_limit(machine), machine.motor.nominal_torque_nm, machine.drive
    overspeed = OVERSPEED if drive.field_weakening else 1.0
    fastest = f"{overspeed:g} times nominal speed, {overspeed * machine.motor.nominal_speed_rad_s:.4g} rad/s"
    cycle = f"{100 * drive.overload:.0f} % for {drive.overload_time_s:g} s in {drive.overload_period_s:g} s"
    return (
        ("torque peak", "peak_torque_motor_nm", 100.0 / limit, f"the limit of {limit:.0f} N m per motor"),
        ("rms torque", "rms_torque_motor_nm", 100.0 / nominal, f"nominal torque, {nominal:g} N m, without end"),
        ("overload", "overload_use_percent", 1.0, cycle),
        ("motor speed", "peak_speed_percent", 1.0 / overspeed, fastest),
        ("place of the stop", "position_error_end_m", 100.0 / ASTRAY_M, f"{1000 * ASTRAY_M:g} mm from the reference"),
    )


def _axis_shares(machine: Any) -> tuple[Share, ...]:
    """Of what the drive states: its limit, what it gives without end, its top speed."""
    drive, kind, judged = machine.drive, kind_of(machine), set_of(kind_of(machine).name)
    unit, word = kind.drive.unit, kind.drive.quantity
    fastest = next(name for name in judged.by_name if name.startswith(("peak_velocity", "peak_speed")))
    shares: list[Share] = []
    if math.isfinite(drive.limit):
        shares.append((f"{word} peak", judged.peak, 100.0 / drive.limit, f"the limit of {drive.limit:g} {unit}"))
    if drive.nominal is not None:
        without_end = f"nominal {word}, {drive.nominal:g} {unit}, without end"
        shares.append((f"rms {word}", judged.rms, 100.0 / drive.nominal, without_end))
    if drive.top_speed is not None:
        bound = f"the top speed, {drive.top_speed:g} {kind.moved.speed_unit}"
        shares.append(("speed", fastest, 100.0 / drive.top_speed, bound))
    return tuple(shares)


_SHARES: dict[str, Callable[[Any], tuple[Share, ...]]] = {"hoist": _hoist_shares}


def _hunting_use(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Use]:
    hunting = [row for row in good if hunts(row)]
    if not hunting:
        return []
    worst = max(hunting, key=swings_per_s)
    bound = f"{SWINGS_PER_S:g} a second of motion, each by more than nominal torque: the loop hunts"
    return [Use("torque swings", 100.0 * swings_per_s(worst) / SWINGS_PER_S, bound, run_in_words(worst, axes))]


def _wire(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Use]:
    factors = [row for row in good if (row.metrics.get("wire_safety_factor") or 0.0) > 0.0]
    if not factors:
        return []
    worst = min(factors, key=lambda row: row["wire_safety_factor"])
    bound = f"a safety factor of {WIRE_SAFETY:g} (ISO 4308-1, M5)"
    return [Use("wire", 100.0 * WIRE_SAFETY / worst["wire_safety_factor"], bound, run_in_words(worst, axes))]


def utilisation_table(uses: Sequence[Use]) -> Table:
    """A line each, with its light."""
    lines = [[f"{SIGN[use.light]} {use.light}", use.what, f"{use.percent:.0f}", use.bound, use.where] for use in uses]
    note = f"Green up to {AMBER:g} % of what is borne, amber above, red where it is reached; the run that uses most."
    return Table([words("light"), words("utilisation"), Column("used", "%"), words("of"), words("in")], lines, note)


def alarm(uses: Sequence[Use]) -> str | None:
    """One sentence on what is at or beyond its bound; None where nothing is."""
    over = [f"{use.what} {use.used} {use.bound} ({use.where})" for use in uses if use.light == "red"]
    return f"Overload: {'; '.join(over)}." if over else None
