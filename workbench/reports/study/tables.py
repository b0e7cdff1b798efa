"""The tables of a study's report: what was run, each run or many in short."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from workbench.kinds import kind_of
from workbench.metrics import View, shown_in
from workbench.study import tables
from workbench.study.decide import decision_table
from workbench.study.findings import utilisation, utilisation_table
from workbench.study.labels import drawn_columns, field_label, shown, swept_axes
from workbench.study.rows import Row, metrics_of
from workbench.study.store import Finished
from workbench.tables import Table, words

MOST_LINES = 60


def decision(result: Finished) -> list[Table]:
    """What decides: a row a reference, then how much of what machine and drive bear is used."""
    uses = utilisation(result.rows, result.machine)
    first = decision_table(result.rows)
    return [*([first] if first is not None else []), *([utilisation_table(uses)] if uses else [])]


def run_tables(rows: Sequence[Row]) -> list[Table]:
    """Tables with a line a run; of more than sixty runs their quantiles and the runs at the ends."""
    if len(rows) > MOST_LINES:
        ends = tables.extremes_table(rows, swept_axes(rows))
        return [
            tables.quantile_table(rows),
            replace(ends, note=f"Each of the {len(rows)} runs has its line in index.parquet."),
        ]
    runs = tables.run_table(rows)
    first = len(runs.columns) - tables.metric_columns(rows)
    report = [runs]
    judged = metrics_of(rows)
    for view, what in ((View.DRIVE, "The drive"), (View.MOTION, "Motion and wire" if judged.payload else "Motion")):
        metrics = [
            metric for metric in shown_in(view, judged) if any(row.metrics.get(metric.name) is not None for row in rows)
        ]
        if metrics:
            cells = [[metric.text(row.get(metric.name)) for metric in metrics] for row in rows]
            more = [[*line[:first], *texts] for line, texts in zip(runs.rows, cells, strict=True)]
            columns = [*runs.columns[:first], *tables.metric_heads(metrics)]
            report.append(Table(columns, more, f"{what}. {tables.metric_note(metrics)}"))
    return report


def what_was_run(result: Finished) -> Table:
    """Scenario, machine, versions: enough to run it again."""
    said, manifest, machine = result.scenario, result.manifest, result.machine
    failed = sum(not row.ok for row in result.rows)
    payloads = sorted({row.payload_kg for row in result.rows})
    lines = [
        ("machine", f"{machine.name} ({manifest.get('machine_hash', '')})"),
        ("drive", kind_of(machine).looped.drive_words(machine)),
        ("payloads", f"{_some(payloads)} kg" if metrics_of(result.rows).payload else ""),
        ("references", ", ".join(dict.fromkeys(row.reference for row in result.rows))),
        ("moves", _moves(said.get("moves") or [])),
        ("limits", _limits(said.get("limits") or {})),
        ("controller", _block(said.get("controller") or {})),
        ("events", _block(said.get("events") or {})),
        *_varied(result.rows),
        ("runs", f"{len(result.rows)}" + (f", of which {failed} failed" if failed else "")),
        ("scenario", f"{manifest.get('scenario_hash', '')}, seed {manifest.get('seed')}"),
        ("program", _program(manifest)),
    ]  # fmt: skip
    return Table([words("what"), words("was run")], [[name, text] for name, text in lines if text])


def _varied(rows: Sequence[Row]) -> list[tuple[str, str]]:
    lines = []
    for axis in swept_axes(rows):
        points = ", ".join(axis.short(point) for point in axis.points)
        if len(axis.points) > 12:
            points = f"{axis.short(axis.points[0])} to {axis.short(axis.points[-1])}, {len(axis.points)} values"
        lines.append((f"swept: {axis.words}", points))
    for column in drawn_columns(rows):
        values = [float(value) for row in rows if not isinstance(value := row.assigned[column], str)]
        label = field_label(column)
        lines.append((f"drawn: {label.words}", f"{shown(min(values))} to {shown(max(values))} {label.unit}"))
    return lines


def _some(values: Sequence[float]) -> str:
    if len(values) > 12:
        return f"{values[0]:g} to {values[-1]:g}, {len(values)} values,"
    return ", ".join(f"{value:g}" for value in values)


def _moves(moves: Sequence[Mapping[str, Any]]) -> str:
    def one(move: Mapping[str, Any]) -> str:
        for key, unit in (("speed_m_s", "m/s"), ("speed_rad_s", "rad/s")):
            if key in move:
                return f"{move[key]:g} {unit} for {move['for_s']:g} s"
        ((key, value),) = move.items()
        word, _, unit = key.partition("_")
        return f"{'rest' if word == 'dwell' else word} {value:g} {unit}"

    return ", ".join(one(move) for move in moves)


def _limits(limits: Mapping[str, Any], way: str = "") -> str:
    parts = []
    for key, value in limits.items():
        if isinstance(value, Mapping):
            parts.append(_limits(value, f"{key} "))
        elif value is not None:
            parts.append(f"{way}{field_label(key).of(value)}")
    return ", ".join(part for part in parts if part)


def _block(block: Mapping[str, Any]) -> str:
    """The values of a block that say something; zeros of nested blocks are left out."""
    parts = []
    for key, value in block.items():
        if isinstance(value, Mapping):
            inner = ", ".join(f"{field_label(k).words} {v:g}" for k, v in value.items() if v)
            if inner:
                parts.append(f"{key.replace('_', ' ')}: {inner}")
        elif isinstance(value, bool):
            parts.append(f"{key.replace('_', ' ')} {'yes' if value else 'no'}")
        elif isinstance(value, int | float):
            parts.append(field_label(key).of(float(value)))
        elif isinstance(value, str):
            parts.append(value if key == "kind" else field_label(key).of(value))
    return ", ".join(parts)


def _program(manifest: Mapping[str, Any]) -> str:
    versions = manifest.get("versions") or {}
    text = ", ".join(f"{name} {number}" for name, number in versions.items())
    commit = manifest.get("commit")
    return f"{text}; {manifest.get('platform', '')}" + (f"; commit {str(commit)[:12]}" if commit else "")
