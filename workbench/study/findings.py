"""The conclusions of a study as plain sentences, computed from its rows.
Sentences on what a sweep or a sample does, computed from a study's rows.
How much of what machine and drive bear a study's runs use: the largest share each, with a light."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.metrics import View, set_of, shown_in
from workbench.references import BASELINE, planned_kinds
from workbench.study.labels import SweptAxis, drawn_columns, metric_label, reads, run_in_words, shown, swept_axes
from workbench.study.pareto import Front, fronts, rank_correlations
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit
from workbench.tables import Column, Table, words

MOST_FAILED = 5
ASTRAY_M = 0.05  # of a hoist
AT_THE_LIMIT = 0.85  # rms over limit: three quarters of the time are spent there

SWINGS_PER_S = 2.0  # of motion, each by more than nominal torque: no motion asks for that, a loop that hunts does
MOST_SWINGS = 10.0  # fewer may come of a single event, such as a wire that tightens with a jerk


def sentences(rows: Sequence[Row], torque_limit_nm: float) -> list[str]:
    """Conclusions computed from the rows; the first is the answer to the study's question.

    torque_limit_nm: the largest torque of one motor; of an axis the largest force or torque, inf where none is stated.
    """
    good = [row for row in rows if row.ok]
    axes = swept_axes(rows)
    first = _varied_runs(good, axes) if any(row.assigned for row in rows) else _comparison(good)
    limits = [*_limits(good, torque_limit_nm, axes), *_hunting(good, axes)]
    return [*first, *limits, *_slack(good, axes), *_astray(good, axes), *_failures(rows)]


def hunts(row: Row) -> bool:
    """Whether the torque swings to and fro as it does in a loop only that is not stable."""
    return (row.metrics.get("torque_swings") or 0.0) > MOST_SWINGS and swings_per_s(row) > SWINGS_PER_S


def swings_per_s(row: Row) -> float:
    """Torque swings a second of motion."""
    return row["torque_swings"] / max(row["move_time_s"], 1.0)


def _varied_runs(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    if drawn_columns(good):
        return [*scatter(good), *against_baseline(good, axes)] if not axes else [*span(good, axes), *scatter(good)]
    paid = [*knees(good, axes)] if sweeps_limits(good) else []
    return [*span(good, axes), *paid, *effects(good, axes), *against_baseline(good, axes)]


def _comparison(good: Sequence[Row]) -> list[str]:
    """Each planned kind of reference against the baseline, at the heaviest payload that has both."""
    by_case = {(row.payload_kg, row.reference): row for row in good}
    for payload in sorted({row.payload_kg for row in good}, reverse=True):
        base = by_case.get((payload, BASELINE))
        if base is None:
            continue
        texts: list[str] = []
        row_set = metrics_of(good)
        for name, kind in planned_kinds().items():
            row = by_case.get((payload, name))
            if row is None or name == BASELINE:
                continue
            if kind.same_time_as:
                start = "In" if texts or not row_set.payload else f"At {payload:g} kg, in"
                texts.append(f"{start} the {kind.same_time_as}'s own time {kind.words} {_against(row, base)}.")
                continue
            longer = (row["move_time_s"] - base["move_time_s"]) / row["moves"]
            time = f"{abs(longer):.2g} s {'longer' if longer >= 0.0 else 'less'} per move"
            said = f"{kind.words} takes {time}, {_against(row, base)}."
            texts.append(f"At {payload:g} kg {said}" if row_set.payload else f"{said[0].upper()}{said[1:]}")
        if texts:
            return texts
    if not good:
        return []
    judged = metrics_of(good)
    worst = max(good, key=lambda row: row[judged.peak])
    peak = f"{judged.by_name[judged.peak].text(worst[judged.peak])} {judged.input_unit}"
    share = f" ({worst['peak_torque_percent']:.0f} % of nominal)" if judged.payload else ""
    where = f" at {worst.payload_kg:g} kg" if judged.payload else ""
    return [f"The largest {judged.input_words} peak is {peak}{share}, with {worst.reference}{where}."]


def _against(row: Row, base: Row) -> str:
    judged = metrics_of([row])
    above = judged.by_name[judged.above]
    peak, error = (_change(row[name], base[name]) for name in (judged.above, judged.error))
    change = f"({above.text(base[above.name])} → {above.text(row[above.name])} {above.unit})"
    return f"{_verb(peak)} the {above.label} {change} and {_verb(error)} the {judged.error_words}"


def _change(value: float, base: float) -> float:
    return 100.0 * (value - base) / base if base else math.nan


def _verb(percent: float) -> str:
    if math.isnan(percent):
        return "cannot be compared in"
    if abs(percent) < 0.5:
        return "changes nothing in"
    return f"takes {-percent:.0f} % off" if percent < 0.0 else f"adds {percent:.0f} % to"


def _limits(good: Sequence[Row], torque_limit_nm: float, axes: Sequence[SweptAxis]) -> list[str]:
    if any("drive." in column or "motor." in column for row in good[:1] for column in row.assigned):
        return []  # each run has a limit of its own
    judged = metrics_of(good)
    at_limit = [row for row in good if row[judged.peak] >= torque_limit_nm * (1.0 - 1e-9)]
    if not at_limit:
        return []
    limit = f"{judged.by_name[judged.peak].text(torque_limit_nm)} {judged.input_unit}"
    said = [f"The {judged.input_words} limit of {limit} is reached{_which(at_limit, good, axes)}."]
    stuck = [row for row in at_limit if row[judged.rms] >= AT_THE_LIMIT * torque_limit_nm]
    if stuck:
        said.append(
            f"The {judged.input_words} is at its limit, one way or the other, nearly all the time"
            f"{_which(stuck, good, axes)}: the loop swings from limit to limit, or the "
            f"{'motors cannot' if judged.payload else 'drive cannot'} carry the load. Such a run is ok only in that it "
            "came to its end."
        )
    return said


def _hunting(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    hunting = [row for row in good if hunts(row)]
    if not hunting:
        return []
    worst = max(hunting, key=swings_per_s)
    return [
        f"The torque swings to and fro by more than nominal torque{_which(hunting, good, axes)}; most often "
        f"{_name(worst, axes)}, {swings_per_s(worst):.0f} times a second of motion: the loop hunts. Such a run is ok "
        "only in that it came to its end."
    ]


def _slack(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    slack = [row for row in good if row.get("slack_time_s") > 0.0]
    if not slack:
        return []
    longest = max(slack, key=lambda row: row["slack_time_s"])
    return [
        f"The wire goes slack{_which(slack, good, axes)}; longest {longest['slack_time_s']:.2g} s in "
        f"{longest['slack_events']:.0f} {'event' if longest['slack_events'] == 1 else 'events'} "
        f"({_name(longest, axes)}). "
        "It tightens again with a jerk."
    ]


def is_astray(row: Row) -> bool:
    """Whether a run ends where its reference does not."""
    judged = metrics_of([row])
    return abs(row[judged.end]) > judged.astray * (row[judged.window] if judged.window else 1.0)


def _astray(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    """Runs that do not end where they should."""
    astray = [row for row in good if is_astray(row)]
    if not astray:
        return []
    judged = metrics_of(good)
    worst = max(astray, key=lambda row: abs(row[judged.end]))
    error, metric = worst[judged.end], judged.by_name[judged.end]
    amount = f"{abs(error):.2f} m" if judged.payload else f"{metric.text(abs(error))} {metric.shown_unit}"
    return [
        f"The {judged.moved} does not end where its reference does{_which(astray, good, axes)}; farthest off "
        f"{_name(worst, axes)}, {amount} {judged.sides[0] if error > 0.0 else judged.sides[1]} it."
    ]


def _failures(rows: Sequence[Row]) -> list[str]:
    failed = [row for row in rows if not row.ok]
    said = [f"{row.run_id} failed: {row.reason}." for row in failed[:MOST_FAILED]]
    if len(failed) > len(said):
        said.append(f"{len(failed) - len(said)} more of {len(rows)} runs failed; the index says why.")
    return said


def _which(rows: Sequence[Row], good: Sequence[Row], axes: Sequence[SweptAxis]) -> str:
    """`: a, b, c` of a few runs; of many how many, and the first."""
    names = [_name(row, axes) for row in rows]
    sign = "; " if rows[0].assigned else ", "
    if len(names) <= (3 if rows[0].assigned else 6):
        return f": {sign.join(names)}"
    return f" in {len(names)} of {len(good)} runs, the first {names[0]}"


def _name(row: Row, axes: Sequence[SweptAxis]) -> str:
    return run_in_words(row, axes) if row.assigned else row.run_id


NO_CHANGE = 0.005  # relative: less is no effect worth a sentence
MOST_FRONTS = 3


def span(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    """Between which runs the torque peak and the speed error lie."""
    if not good:
        return []
    texts = []
    judged = metrics_of(good)
    for name in (judged.peak, judged.error):
        low, high = (choose(good, key=lambda row: row[name]) for choose in (min, max))
        metric = judged.by_name[name]
        texts.append(
            f"Over {len(good)} runs the {metric.label} goes from {metric.scale * low[name]:.3g} {metric.shown_unit} "
            f"({run_in_words(low, axes)}) to {metric.scale * high[name]:.3g} {metric.shown_unit} "
            f"({run_in_words(high, axes)})."
        )
    return texts


def effects(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    """What each axis does at the heaviest payload, of all runs at a value the worst."""
    if not good:
        return []
    heaviest = max(row.payload_kg for row in good)
    here = [row for row in good if row.payload_kg == heaviest]
    return [text for axis in axes for text in _effect(axis, here, heaviest)]


def _effect(axis: SweptAxis, rows: Sequence[Row], payload_kg: float) -> Iterator[str]:
    rows = [row for row in rows if any(reads(row.reference, column) for column in axis.columns)]
    groups = {point: [row for row in rows if axis.at(row) == point] for point in axis.points}
    groups = {point: members for point, members in groups.items() if members}
    if len(groups) < 2:
        return
    points = list(groups)
    several = max(map(len, groups.values())) > 1
    judged = metrics_of(rows)
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


def listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _course(axis: SweptAxis, points: Sequence[tuple[float | str, ...]], values: Sequence[float], unit: str) -> str:
    """From end to end, with the extreme between them where there is one; of words each."""
    if not axis.numeric:
        return "is " + ", ".join(f"{v:.3g} {unit} with {shown(p[0])}" for p, v in zip(points, values, strict=True))
    ends = sorted((values[0], values[-1]))
    text = f"goes from {values[0]:.3g} to {values[-1]:.3g} {unit}"
    reach = max(abs(value) for value in values) * NO_CHANGE
    low, high = int(np.argmin(values)), int(np.argmax(values))
    if values[low] < ends[0] - reach:
        return f"{text}, with its least, {values[low]:.3g} {unit}, at {axis.short(points[low])}"
    if values[high] > ends[1] + reach:
        return f"{text}, with its most, {values[high]:.3g} {unit}, at {axis.short(points[high])}"
    return text


def sweeps_limits(rows: Sequence[Row]) -> bool:
    """Whether move time is paid for: acceleration or jerk is swept."""
    return any(".limits." in column for axis in swept_axes(rows) for column in axis.columns)


def knees(good: Sequence[Row], axes: Sequence[SweptAxis], second: str = "") -> list[str]:
    """Where the fronts of move time against the peak (or `second`) turn, and what the ends of them cost."""
    second = second or metrics_of(good).peak
    texts = [_knee(front, axes) for front in fronts(good, second) if front.knee is not None]
    return texts[-MOST_FRONTS:]


def _knee(front: Front, axes: Sequence[SweptAxis]) -> str:
    knee, fast, slow = front.knee, front.rows[0], front.rows[-1]
    assert knee is not None
    what = metric_label(front.costs[1])
    cost = {id(row): row[front.costs[1]] for row in (knee, fast, slow)}
    s = ".1f" if metrics_of([knee]).payload else ".3g"  # an axis' moves are short
    f = ".0f" if metrics_of([knee]).payload else ".4g"
    longer = knee["move_time_s"] - fast["move_time_s"]
    off = 100.0 * (1.0 - cost[id(knee)] / cost[id(fast)])
    setting = ", ".join(axis.say(axis.at(knee)) for axis in axes)
    load = f"At {front.payload_kg:g} kg the" if metrics_of([knee]).payload else "The"
    return (
        f"{load} knee of move time against {what.words} is {knee.reference} with {setting}: "
        f"{knee['move_time_s']:{s}} s and {cost[id(knee)]:{f}} {what.unit}. Against the fastest run, "
        f"{fast['move_time_s']:{s}} s and {cost[id(fast)]:{f}} {what.unit}, it costs "
        f"{longer / knee['moves']:.2g} s per move and takes {off:.0f} % off; the gentlest needs "
        f"{slow['move_time_s']:{s}} s for {cost[id(slow)]:{f}} {what.unit}."
    )


def scatter(good: Sequence[Row]) -> list[str]:
    """Of a sample: the spread of the torque peak for each payload and reference, and what it hangs on."""
    texts = []
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in good:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    columns = drawn_columns(good)
    for (payload, reference), rows in groups.items():
        if len(rows) < 3:
            continue
        judged = metrics_of(rows)
        metric = judged.by_name[judged.peak]
        peak = [row[judged.peak] for row in rows]
        low, middle, high = np.quantile(peak, (0.05, 0.5, 0.95))
        texts.append(
            f"Over {len(rows)} runs {f'at {payload:g} kg ' if judged.payload else ''}with {reference} the "
            f"{metric.label} is {metric.text(middle)} {metric.unit} in the median, {metric.text(low)} to "
            f"{metric.text(high)} {metric.unit} in nine of ten, {metric.text(max(peak))} {metric.unit} at most"
            + _hangs_on(rows, columns)
            + "."
        )
    return texts


def _hangs_on(rows: Sequence[Row], columns: Sequence[str]) -> str:
    ranked = [field for field in rank_correlations(rows, columns, metrics_of(rows).peak) if abs(field.value) >= 0.2][:3]
    if not ranked:
        return ""
    return "; it goes with " + ", ".join(
        f"{field.label.words} (rank correlation {field.value:+.2f})" for field in ranked
    )


def against_baseline(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[str]:
    """Each planned kind of reference against the baseline at equal settings, over all points that have both.

    Of the heaviest payload that has both.
    """
    by_case = {(row.payload_kg, row.reference, *_settings(row, axes)): row for row in good}
    for payload in sorted({row.payload_kg for row in good}, reverse=True):
        base = [row for row in good if row.payload_kg == payload and row.reference == BASELINE]
        texts = []
        for name, kind in planned_kinds().items():
            pairs = [
                (row, by_case[payload, name, *_settings(row, axes)])
                for row in base
                if (payload, name, *_settings(row, axes)) in by_case
            ]
            if pairs and name != BASELINE:
                texts.append(_against_baseline(payload, name, pairs, axes, bool(kind.same_time_as)))
        if texts:
            return texts
    return []


def _against_baseline(
    payload_kg: float, name: str, pairs: Sequence[tuple[Row, Row]], axes: Sequence[SweptAxis], in_its_time: bool
) -> str:
    judged = metrics_of([pairs[0][0]])
    above = judged.above
    off = [100.0 * (1.0 - row[above] / base[above]) for base, row in pairs]
    where = f"At {payload_kg:g} kg {name}" if judged.payload else f"{name[0].upper()}{name[1:]}"
    longer = [(row["move_time_s"] - base["move_time_s"]) / row["moves"] for base, row in pairs]
    time = f"takes the {BASELINE}'s time" if in_its_time else (
        f"costs {_range(longer, '.2g')} s per move against the {BASELINE} at the same settings"
    )  # fmt: skip
    drawn = any(column.startswith("sample.") for column in pairs[0][1].assigned)
    said = _off(min(off)) if f"{min(off):.0f}" == f"{max(off):.0f}" else _off(min(off), max(off))
    ends = [pairs[pick][1] for pick in (int(np.argmax(off)), int(np.argmin(off)))]
    points = [", ".join(axis.say(axis.at(row)) for axis in _read(axes, name)) for row in ends]
    most = "" if drawn or points[0] == points[1] or max(off) - min(off) < 1.0 else (
        f": most at {points[0]}, least at {points[1]}"
    )  # fmt: skip
    return f"{where} {time} and {said} the {judged.by_name[above].label}{most}."


def _read(axes: Sequence[SweptAxis], reference: str) -> list[SweptAxis]:
    return [axis for axis in axes if any(reads(reference, column) for column in axis.columns)]


def _off(low: float, high: float | None = None) -> str:
    """`takes 9 to 17 % off`, `adds 2 to 5 % to`; where the sign turns, what is taken off goes from … to …"""
    high = low if high is None else high
    if max(abs(low), abs(high)) < 0.5:
        return "changes nothing in"
    if high < 0.0:
        return f"adds {_range([-high, -low], '.0f')} % to"
    if low >= -0.5:
        return f"takes {_range([max(low, 0.0), high], '.0f')} % off"
    return f"does anything from adding {-low:.0f} % to taking {high:.0f} % off"


def _settings(row: Row, axes: Sequence[SweptAxis]) -> tuple[object, ...]:
    drawn = row.run_id.rpartition("_s")[2] if any(name.startswith("sample.") for name in row.assigned) else ""
    return (*(axis.at(row) for axis in axes), drawn)


def _range(values: Sequence[float], form: str) -> str:
    low, high = f"{min(values):{form}}", f"{max(values):{form}}"
    return low if low == high else f"{low} to {high}"


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
