"""What a study says: its decision, the number that it asks for, then at most three findings that could change it.

The knee of a front: its costs are brought to 0…1, from the best to the worst on the front; the chord joins its two
ends; the knee is the run farthest below the chord. A front of fewer than three runs, or one that nowhere lies below its
chord, has no knee. (Distance to the chord: I. Das, "On characterizing the 'knee' of the Pareto curve", Structural
Optimization 18, 1999, for two costs.)
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from workbench.core.errors import InputError, nearest
from workbench.core.run import Array
from workbench.core.whole_folder import write_json
from workbench.machines import Axis, Hoist, kind_of
from workbench.metrics import View, set_of, shown_in
from workbench.study.beside import (
    Asked,
    answers,
    asked_sentences,
    beside,
    from_the_bound,
    on_another_damping,
)
from workbench.study.decide import decisions, take_sentences
from workbench.study.labels import (
    Label,
    SweptAxis,
    drawn_columns,
    field_label,
    listed,
    reads,
    run_in_words,
    shown,
    swept_axes,
)
from workbench.study.load import Study
from workbench.study.rows import (
    ASTRAY_M,
    SWINGS_PER_S,
    Row,
    hunts,
    index_table,
    is_astray,
    metrics_of,
    parquet_bytes,
    read_table,
    rows_of,
    swings_per_s,
)
from workbench.study.run import StudyResult, peak_limit

ANSWER, EQUAL_TIME = "answer.json", "equal_time.parquet"
MOST_FINDINGS, MOST_FAILED = 3, 3
MOST_BYTES = 1_000_000
QUANTILES = (0.05, 0.5, 0.95)
NO_CHANGE = 0.005  # relative: less is no effect worth a sentence
AT_THE_LIMIT = 0.85  # rms over limit: three quarters of the time are spent there


@dataclass(frozen=True)
class Front:
    """The front of one group of runs. rows: from the smallest first cost to the largest; knee: one of them or None."""

    payload_kg: float
    costs: tuple[str, str]
    rows: tuple[Row, ...]
    knee: Row | None


def non_dominated(first: Array, second: Array) -> npt.NDArray[np.intp]:
    """Indices of the non-dominated points, by rising `first`. Of equal points the earliest is kept.

    first, second: (n,) costs, finite.
    """
    order = np.lexsort((np.arange(len(first)), second, first))
    falling = second[order]
    below = np.concatenate(([True], falling[1:] < np.minimum.accumulate(falling)[:-1])) if len(order) else order > 0
    return order[below]


def knee(first: Array, second: Array) -> int | None:
    """The place of the knee on a front: (n,) rising and (n,) falling costs. None where there is none."""
    if len(first) < 3:
        return None
    x = (first - first[0]) / (first[-1] - first[0])
    y = (second - second[-1]) / (second[0] - second[-1])
    depth = (1.0 - x - y) / np.sqrt(2.0)  # below the chord from (0, 1) to (1, 0)
    at = int(np.argmax(depth))
    return at if depth[at] > 1e-9 else None


def fronts(rows: Sequence[Row], second: str = "", first: str = "move_time_s") -> list[Front]:
    """The front of each payload: the runs that no other is at least as good as in both costs and better in one.

    first, second: metrics to be kept small, without a second the largest torque or force. Failed runs are left out.
    InputError for a metric that the rows do not have.
    """
    costs = first, second or metrics_of(rows).peak
    found = []
    for payload in sorted({row.payload_kg for row in rows if row.ok}):
        own = [row for row in rows if row.ok and row.payload_kg == payload]
        x, y = (np.array([cost(row, name) for row in own]) for name in costs)
        known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        chosen = known[non_dominated(x[known], y[known])]
        at = knee(x[chosen], y[chosen])
        front = tuple(own[i] for i in chosen)
        found.append(Front(payload, costs, front, None if at is None else front[at]))
    return found


def cost(row: Row, name: str) -> float:
    """A row's cost; InputError for what it has no number of."""
    if name == "wire_tension_swing_n" and name not in row.metrics:  # of an older version
        return row["max_wire_tension_n"] - row["min_wire_tension_n"]
    if name not in row.metrics:
        raise InputError(f"no metric '{name}'; {nearest(name, row.metrics)}")
    return row[name]


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a drawn field with a metric."""

    column: str
    value: float

    @property
    def label(self) -> Label:
        return field_label(self.column)


def rank_correlations(rows: Sequence[Row], columns: Sequence[str], metric: str) -> list[Correlation]:
    """Of each field with the metric, the strongest first; a field or metric that is constant is left out."""
    from scipy.stats import rankdata

    good = [row for row in rows if row.ok]
    if len(good) < 3:
        return []
    wanted, correlations = rankdata([row[metric] for row in good]), []
    for column in columns:
        values = [row.assigned.get(column) for row in good]
        if any(value is None or isinstance(value, str) for value in values):
            continue
        drawn = rankdata(values)
        if np.ptp(drawn) > 0.0 and np.ptp(wanted) > 0.0:
            correlations.append(Correlation(column, float(np.corrcoef(drawn, wanted)[0, 1])))
    return sorted(correlations, key=lambda field: -abs(field.value))


def sentences(rows: Sequence[Row], limit: float) -> list[str]:
    """All findings, first what went wrong. limit: the largest torque of one motor, an axis' largest input, or inf."""
    return [*troubles(rows, limit), *variations(rows)]


def troubles(rows: Sequence[Row], limit: float) -> list[str]:
    """Runs that failed, are at a limit, hunt, go slack or end elsewhere: each can turn the decision round."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    failed = [row for row in rows if not row.ok]
    said = [" ".join(f"{row.run_id} failed: {row.reason}." for row in failed[:MOST_FAILED])] if failed else []
    if len(failed) > MOST_FAILED:
        said[0] += f" {len(failed) - MOST_FAILED} more of {len(rows)} runs failed; the index says why."
    if not good:
        return said
    judged = metrics_of(good)

    def which(some: Sequence[Row]) -> str:
        names = [run_in_words(row, axes) for row in some]
        if len(names) <= (3 if some[0].assigned else 6):
            return f": {'; '.join(names)}"
        return f" in {len(names)} of {len(good)} runs, the first {names[0]}"

    own_limits = any("drive." in column or "motor." in column for column in good[0].assigned)
    at_limit = [row for row in good if row[judged.peak] >= limit * (1.0 - 1e-9) and not own_limits]
    stuck = [row for row in at_limit if row[judged.rms] >= AT_THE_LIMIT * limit]
    at_limit = [row for row in at_limit if row not in stuck]  # the stronger sentence says it too
    if at_limit:
        value = f"{judged.by_name[judged.peak].text(limit)} {judged.input_unit}"
        said.append(f"The {judged.input_words} limit of {value} is reached{which(at_limit)}.")
    if stuck:
        cannot = "motors cannot" if judged.payload else "drive cannot"
        said.append(
            f"The {judged.input_words} is at its limit nearly all the time{which(stuck)}: the loop swings from limit "
            f"to limit, or the {cannot} carry the load."
        )
    if hunting := [row for row in good if hunts(row)]:
        worst = max(hunting, key=swings_per_s)
        said.append(
            f"The loop hunts: the torque swings by more than nominal torque{which(hunting)}; most often "
            f"{run_in_words(worst, axes)}, {swings_per_s(worst):.0f} times a second of motion."
        )
    if slack := [row for row in good if row.get("slack_time_s") > 0.0]:
        longest = max(slack, key=lambda row: row["slack_time_s"])
        said.append(
            f"The wire goes slack{which(slack)}; longest {longest['slack_time_s']:.2g} s "
            f"({run_in_words(longest, axes)}). It tightens again with a jerk."
        )
    if astray := [row for row in good if is_astray(row)]:
        worst = max(astray, key=lambda row: abs(row[judged.end]))
        error, metric = worst[judged.end], judged.by_name[judged.end]
        amount = f"{abs(error):.2f} m" if judged.payload else f"{metric.text(abs(error))} {metric.shown_unit}"
        farthest = f"; farthest off {run_in_words(worst, axes)}," if len(astray) > 1 else ","
        said.append(
            f"The {judged.moved} does not end where its reference does{which(astray)}{farthest} {amount} "
            f"{judged.sides[0] if error > 0.0 else judged.sides[1]} it."
        )
    return said


def variations(rows: Sequence[Row], told: bool = False) -> list[str]:
    """What a sweep or a sample does; of a study that varies nothing, and has `told` no decision, the largest peak."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    if not good:
        return []
    heaviest = max(row.payload_kg for row in good)
    here = [row for row in good if row.payload_kg == heaviest]
    said = []
    if any(".limits." in column for axis in axes for column in axis.columns) and fronts(here)[0].knee is not None:
        said.append(_knee(fronts(here)[0], axes))
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
    groups: dict[Any, list[Row]] = {point: [] for point in axis.points}
    for row in rows:
        if any(reads(row.reference, column) for column in axis.columns):
            groups[axis.at(row)].append(row)
    groups = {point: members for point, members in groups.items() if members}
    if len(groups) < 2:
        return
    points, judged, own = list(groups), metrics_of(rows), [row for members in groups.values() for row in members]
    several = max(map(len, groups.values())) > 1
    at = f"at {payload_kg:g} kg" if judged.payload else ""
    where = f"{at}, the worst runs," if several and at else "in the worst runs" if several else at
    parts, same = [], []
    for metric in shown_in(View.SENTENCES, judged):
        if any(row.metrics.get(metric.name) is None for row in own):
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
    reach, ends = max(abs(value) for value in values) * NO_CHANGE, (values[0], values[-1])
    low, high = int(np.argmin(values)), int(np.argmax(values))
    if values[low] < min(ends) - reach:
        return f"{text}, with its least, {values[low]:.3g} {unit}, at {axis.short(points[low])}"
    if values[high] > max(ends) + reach:
        return f"{text}, with its most, {values[high]:.3g} {unit}, at {axis.short(points[high])}"
    return text


def _knee(front: Front, axes: Sequence[SweptAxis]) -> str:
    """Where a front of move time against the peak turns, and whether that is at the edge of what was swept."""
    knee, judged = front.knee, metrics_of(front.rows)
    assert knee is not None
    peak = judged.by_name[front.costs[1]]
    setting = ", ".join(axis.say(axis.at(knee)) for axis in axes)
    ends = [f"{row['move_time_s']:.4g} s for {peak.text(row[peak.name])}" for row in (front.rows[0], front.rows[-1])]
    edges = [axis.words for axis in axes if _at_edge(axis, knee)]
    edge = f"; it lies at the edge of {listed(edges)}: widen that range" if edges else ""
    return (
        f"{f'At {front.payload_kg:g} kg the' if judged.payload else 'The'} knee of move time against {peak.label} is "
        f"{knee.reference} with {setting}: {knee['move_time_s']:.4g} s and {peak.text(knee[peak.name])} "
        f"{peak.shown_unit}, between {' and '.join(ends)} at the ends{edge}."
    )


def _at_edge(axis: SweptAxis, row: Row) -> bool:
    read = any(reads(row.reference, column) for column in axis.columns)
    return read and axis.numeric and len(axis.points) > 2 and axis.at(row) in (axis.points[0], axis.points[-1])


def scatter(good: Sequence[Row]) -> list[str]:
    """Of a sample: the spread of the peak for each payload and reference, and what it depends on."""
    judged, texts = metrics_of(good), []
    metric = judged.by_name[judged.peak]
    for payload, reference in dict.fromkeys((row.payload_kg, row.reference) for row in good):
        rows = [row for row in good if (row.payload_kg, row.reference) == (payload, reference)]
        if len(rows) < 3:
            continue
        low, middle, high, most = np.quantile([row[judged.peak] for row in rows], (*QUANTILES, 1.0))
        ranked = rank_correlations(rows, drawn_columns(good), judged.peak)
        strong = [f"{r.label.words} (rank correlation {r.value:+.2f})" for r in ranked if abs(r.value) >= 0.2][:3]
        texts.append(
            f"Over {len(rows)} runs {f'at {payload:g} kg ' if judged.payload else ''}with {reference} the "
            f"{metric.label} is {metric.text(middle)} {metric.unit} in the median, {metric.text(low)} to "
            f"{metric.text(high)} {metric.unit} in nine of ten, {metric.text(most)} {metric.unit} at most"
            f"{f'; it depends most on {listed(strong)}' if strong else ''}."
        )
    return texts


Light = Literal["green", "amber", "red"]
WIRE_SAFETY = 4.5  # least breaking load over tension of a running rope, mechanism group M5 (ISO 4308-1)
OVERSPEED = 1.2  # of nominal speed, where the field is weakened: a drive's own limit (ABB ACS850 manual, 20.01)
AMBER, RED = 85.0, 99.9  # % of what is borne
MANY = 1000.0  # % from which on a share is said in times
SIGN = {"green": "●", "amber": "▲", "red": "■"}  # told apart without colour, too


@dataclass(frozen=True)
class Use:
    """percent: of what is borne, in the run that uses most. bound: what that is, in words; where: that run.

    told: whether a finding says it too.
    """

    what: str
    percent: float
    bound: str
    where: str
    told: bool = False

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
    uses = []
    for what, name, scale, bound, told in _hoist_shares(machine) if metrics_of(rows).payload else _axis_shares(machine):
        known = [row for row in good if row.metrics.get(name) is not None]
        if known:
            worst = max(known, key=lambda row: abs(row[name]))
            uses.append(Use(what, scale * abs(worst[name]), bound, run_in_words(worst, axes), told))
    if hunting := [row for row in good if hunts(row)]:
        worst = max(hunting, key=swings_per_s)
        bound = f"{SWINGS_PER_S:g} a second of motion, each by more than nominal torque: the loop hunts"
        percent = 100.0 * swings_per_s(worst) / SWINGS_PER_S
        uses.append(Use("torque swings", percent, bound, run_in_words(worst, axes), True))
    if factors := [row for row in good if row.get("wire_safety_factor") > 0.0]:
        worst = min(factors, key=lambda row: row["wire_safety_factor"])
        bound = f"a safety factor of {WIRE_SAFETY:g} (ISO 4308-1, M5)"
        uses.append(Use("wire", 100.0 * WIRE_SAFETY / worst["wire_safety_factor"], bound, run_in_words(worst, axes)))
    return uses


Share = tuple[str, str, float, str, bool]  # what, metric, per cent per unit of it, of what, whether a finding says it


def _hoist_shares(machine: Any) -> tuple[Share, ...]:
    limit, nominal, drive = peak_limit(machine), machine.motor.nominal_torque_nm, machine.drive
    overspeed = OVERSPEED if drive.field_weakening else 1.0
    fastest = f"{overspeed:g} times nominal speed, {overspeed * machine.motor.nominal_speed_rad_s:.4g} rad/s"
    cycle = f"{100 * drive.overload:.0f} % for {drive.overload_time_s:g} s in {drive.overload_period_s:g} s"
    place = f"{1000 * ASTRAY_M:g} mm from the reference"
    return (
        ("torque peak", "peak_torque_motor_nm", 100.0 / limit, f"the limit of {limit:.0f} N m per motor", True),
        ("rms torque", "rms_torque_motor_nm", 100.0 / nominal, f"nominal torque, {nominal:g} N m, without end", False),
        ("overload", "overload_use_percent", 1.0, f"the drive's overload cycle, {cycle}", False),
        ("motor speed", "peak_speed_percent", 1.0 / overspeed, fastest, False),
        ("place of the stop", "position_error_end_m", 100.0 / ASTRAY_M, place, True),
    )


def _axis_shares(machine: Any) -> tuple[Share, ...]:
    """Of what the drive states: its limit, what it gives without end, its top speed."""
    drive, kind, judged = machine.drive, kind_of(machine), set_of(kind_of(machine).name)
    unit, word = kind.drive.unit, kind.drive.quantity
    fastest = next(name for name in judged.by_name if name.startswith(("peak_velocity", "peak_speed")))
    shares: list[Share] = []
    if math.isfinite(drive.limit):
        shares.append((f"{word} peak", judged.peak, 100.0 / drive.limit, f"the limit of {drive.limit:g} {unit}", True))
    if drive.nominal is not None:
        without_end = f"nominal {word}, {drive.nominal:g} {unit}, without end"
        shares.append((f"rms {word}", judged.rms, 100.0 / drive.nominal, without_end, False))
    if drive.top_speed is not None:
        bound = f"the top speed, {drive.top_speed:g} {kind.moved.speed_unit}"
        shares.append(("speed", fastest, 100.0 / drive.top_speed, bound, False))
    return tuple(shares)


def alarm(uses: Sequence[Use]) -> str | None:
    """One sentence on what is at or beyond its bound; None where nothing is."""
    over = [f"{use.what} {use.used} {use.bound} ({use.where})" for use in uses if use.light == "red"]
    return f"Overload: {'; '.join(over)}." if over else None


@dataclass(frozen=True)
class Answer:
    """sentences: the decision first. beside: runs at equal times. asked: the numbers that the scenario asks for."""

    sentences: tuple[str, ...]
    beside: tuple[Row, ...] = ()
    asked: tuple[Asked, ...] = ()


def answer_of(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> Answer:
    """simulate: runs beside the study may be made, for equal times, another damping and the number asked for."""
    rivals: list[Row] = []
    asked: list[Asked] = []
    if simulate:
        with suppress(InputError):  # a comparison that cannot be planned leaves the study's own rows as they are
            rivals, asked = beside(study), answers(study)
    taken = take_sentences(decisions(rows, study.machine, study.scenario.decide, rivals))
    alarmed = alarm([use for use in utilisation(rows, study.machine) if not use.told])
    first = [*asked_sentences(study, asked), *taken, *([alarmed] if alarmed else [])]
    found = [*troubles(rows, peak_limit(study.machine)), *variations(rows, told=bool(taken))]
    if simulate and len(found) < MOST_FINDINGS and (damping := on_another_damping(study)) is not None:
        found.append(damping)
    if len(found) < MOST_FINDINGS and not study.scenario.sweep and not study.scenario.sample:
        found += from_the_bound(study)  # of the base values: a sweep has others
    return Answer((*first, *found[:MOST_FINDINGS]), tuple(rivals), tuple(asked))


def answer(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> list[str]:
    """The sentences alone."""
    return list(answer_of(study, rows, simulate=simulate).sentences)


def write_answer(result: StudyResult, path: Path) -> None:
    """answer.json, and beside it the runs at equal times as an index of their own."""
    made = answer_of(result.study, result.rows)
    if made.beside:
        path.with_name(EQUAL_TIME).write_bytes(parquet_bytes(index_table(made.beside)))
    asked = [{**vars(one), "broken": list(one.broken)} for one in made.asked]
    write_json(path, {"format": 1, "sentences": list(made.sentences), "asked": asked})


def read_answer(folder: Path) -> Answer | None:
    """The answer that a result holds; None where it holds none that can be read."""
    file, rivals = folder / ANSWER, folder / EQUAL_TIME
    try:
        with file.open("rb") as stream:
            said = json.loads(stream.read(MOST_BYTES))
        rows = tuple(rows_of(read_table(rivals))) if rivals.is_file() else ()
        asked = tuple(Asked(**{**one, "broken": tuple(one["broken"])}) for one in said["asked"])
        return Answer(tuple(map(str, said["sentences"])), rows, asked)
    except (OSError, ValueError, KeyError, TypeError):
        return None
