"""The conclusions of a study as plain sentences, computed from its rows."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.references import BASELINE, planned_kinds
from workbench.study.conclude.variation_sentences import against_baseline, effects, knees, scatter, span, sweeps_limits
from workbench.study.results.row import Row, metrics_of
from workbench.study.variations.varying import SweptAxis, drawn_columns, run_in_words, swept_axes

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
                texts.append(f"{start} the {kind.same_time_as}'s own time {kind.words} {_effect(row, base)}.")
                continue
            longer = (row["move_time_s"] - base["move_time_s"]) / row["moves"]
            time = f"{abs(longer):.2g} s {'longer' if longer >= 0.0 else 'less'} per move"
            said = f"{kind.words} takes {time}, {_effect(row, base)}."
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


def _effect(row: Row, base: Row) -> str:
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
