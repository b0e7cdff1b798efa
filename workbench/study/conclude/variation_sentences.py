"""Sentences on what a sweep or a sample does, computed from a study's rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from workbench.metrics import View, shown_in
from workbench.references import BASELINE, planned_kinds
from workbench.study.conclude.pareto import Front, fronts
from workbench.study.conclude.rank import rank_correlations
from workbench.study.results.labels import metric_label, shown
from workbench.study.results.row import Row, metrics_of
from workbench.study.variations.varying import SweptAxis, drawn_columns, reads, run_in_words, swept_axes

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
