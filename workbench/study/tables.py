"""The tables of a study as ready text: a line a run, quantiles of many runs, the runs at the ends.

Which metrics are columns, and how, is declared with the metrics.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from workbench.core.table import Column, Table, words
from workbench.metrics import Metric, View, shown_in
from workbench.study.labels import SweptAxis, drawn_columns, field_label, run_in_words, shown, swept_axes
from workbench.study.rows import Row, metrics_of, with_payload

QUANTILES = (0.05, 0.5, 0.95)
MOST_SWEPT = 3  # columns of swept values, or one for each axis
WIDEST_HEAD = 12  # characters of a head's line
WIDEST_RUN = 42  # of a run in words; longer ones take two lines
_SHARES = (0.0, *QUANTILES, 1.0)
_NAMES = ("least", "5 %", "median", "95 %", "most")


def _case(rows: Sequence[Row]) -> list[Column]:
    """Payload, where the machine carries one, and reference."""
    return [*([Column("payload", "kg")] if metrics_of(rows).payload else []), words("reference")]


def _case_cells(row: Row) -> list[str]:
    return [*([f"{row.payload_kg:g}"] if with_payload(row) else []), row.reference]


def run_table(rows: Sequence[Row]) -> Table:
    """A line a run: payload, reference, the fields that differ between the runs, metrics.

    A failed run has no metrics but those known before it runs.
    """
    swept, columns = _swept(rows), _columns(rows)
    lines = []
    for row in rows:
        cells = [metric.text(row.get(metric.name)) for metric in columns]
        if not row.ok and cells:
            cells[0] = "failed"
        values = [shown(row.assigned.get(name, "")) for name in swept]
        lines.append([*_case_cells(row), *values, *cells])
    fields = [_field_column(name, rows) for name in swept]
    return Table([*_case(rows), *fields, *metric_heads(columns)], lines, metric_note(columns))


def metric_columns(rows: Sequence[Row]) -> int:
    """How many columns of `run_table` are metrics; they are its last ones."""
    return len(_columns(rows))


def _columns(rows: Sequence[Row]) -> tuple[Metric, ...]:
    return shown_in(View.SWEPT_RUNS if _swept(rows) else View.RUNS, metrics_of(rows))


def _swept(rows: Sequence[Row]) -> list[str]:
    """Of each axis of the sweep a field, and more of them where there is room; without any, some of the drawn ones."""
    axes = swept_axes(rows)
    swept = [column for axis in axes for column in axis.columns]
    needed = [axis.columns[0] for axis in axes]
    more = [column for column in swept if column not in needed][: max(MOST_SWEPT - len(needed), 0)]
    return [column for column in swept if column in {*needed, *more}] or drawn_columns(rows)[:MOST_SWEPT]


def _field_column(field: str, rows: Sequence[Row]) -> Column:
    """A field's words over as many lines as it needs to be narrow; left where it holds words."""
    label = field_label(field)
    text = any(isinstance(row.assigned.get(field), str) for row in rows)
    return Column("\n".join(_narrow(label.words)), label.unit, "left" if text else "right")


def quantile_table(rows: Sequence[Row]) -> Table:
    """Five lines for each payload and reference; of failed runs their number only."""
    columns = shown_in(View.QUANTILES, metrics_of(rows))
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    lines = []
    for members in groups.values():
        good = [row for row in members if row.ok]
        failed = len(members) - len(good)
        number = f"{len(good)}" if not failed else f"{len(good)} + {failed} failed"
        if not good:
            lines.append([*_case_cells(members[0]), number, "", *("–" for _ in columns)])
            continue
        for k, (name, share) in enumerate(zip(_NAMES, _SHARES, strict=True)):
            case = [*_case_cells(members[0]), number]
            start = case if k == 0 else [""] * len(case)
            cells = [
                metric.text(float(np.quantile([row.get(metric.name) for row in good], share))) for metric in columns
            ]
            lines.append([*start, name, *cells])
    each = "payload and reference" if metrics_of(rows).payload else "reference"
    note = (
        f"Of each {each} the smallest value, the 5 %, 50 % and 95 % quantiles and the largest value of each column for "
        f"itself. {metric_note(columns)}"
    )
    return Table([*_case(rows), Column("runs"), words("quantile"), *metric_heads(columns)], lines, note)


def extremes_table(rows: Sequence[Row], axes: Sequence[SweptAxis]) -> Table:
    """The runs at the ends of what matters; where all runs are alike no line."""
    good = [row for row in rows if row.ok]
    columns = shown_in(View.EXTREMES, metrics_of(rows))
    lines = []
    for metric in columns:
        known = [row for row in good if np.isfinite(row.get(metric.name))]
        values = np.array([row[metric.name] for row in known])
        values = np.abs(values) if metric.better == "zero" else values
        if not len(values) or np.ptp(values) <= 1e-9 * abs(values[0]):
            continue
        for name, sign in metric.ends:
            row = known[int(np.argmax(sign * values))]
            which = textwrap.fill(run_in_words(row, axes), WIDEST_RUN)
            lines.append([name, which, *(column.text(row.get(column.name)) for column in columns)])
    return Table([words("run with the"), words("which"), *metric_heads(columns)], lines)


def metric_heads(metrics: Sequence[Metric]) -> list[Column]:
    """A column a metric."""
    return [Column(metric.head or "\n".join(_narrow(metric.label)), metric.shown_unit) for metric in metrics]


def metric_note(metrics: Sequence[Metric]) -> str:
    """What the heads mean: `Peak and RMS: torque of one motor; moves: time in motion.`; heads of one note together."""
    by_note: dict[str, dict[str, None]] = {}
    for metric in metrics:
        head = (metric.head or metric.label).replace("\n", " ")
        by_note.setdefault(metric.note or metric.label, {})[head] = None
    parts = [note if [note] == list(heads) else f"{' and '.join(heads)}: {note}" for note, heads in by_note.items()]
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _narrow(label: str) -> list[str]:
    """Words over as many lines as they need to be narrow."""
    lines = [""]
    for word in label.split():
        joined = f"{lines[-1]} {word}".strip()
        if len(joined) <= WIDEST_HEAD:
            lines[-1] = joined
        else:
            lines.append(word)
    return lines
