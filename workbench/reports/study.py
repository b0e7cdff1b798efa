"""The report of a finished study: one page with what was run, what came out, and what that means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.core.table import Table, words
from workbench.figures.pareto import curves_over_time, pareto
from workbench.figures.study import overview, peak_torque_over_payload
from workbench.figures.study_axis import axis_overview
from workbench.figures.study_plane import torque_speed_plane
from workbench.figures.study_scatter import spread, tornado
from workbench.figures.study_sweep import changing, metrics_over_axis
from workbench.machines import kind_of
from workbench.metrics import View, shown_in
from workbench.study import tables
from workbench.study.answer import answer, read_answer
from workbench.study.decide import Decision, criteria_table, decision_table, decisions
from workbench.study.findings import sentences, utilisation, utilisation_table
from workbench.study.labels import SweptAxis, drawn_columns, field_label, run_in_words, shown, swept_axes
from workbench.study.load import plan_study
from workbench.study.pareto import fronts, rank_correlations
from workbench.study.rows import Row, metrics_of, with_payload
from workbench.study.run import peak_limit
from workbench.study.scenario import Scenario
from workbench.study.store import Finished
from workbench.view.page import Section, save_page

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MARK = "workbench report"


def write_study_report(result: Finished, path: Path) -> None:
    """Write the page; it needs no network. The same result, the same bytes.

    InputError where another file stands there, or it cannot be written.
    """
    _check_free(path)
    description = str(result.scenario.get("description") or "")
    section = Section(
        sentences=[description] if description else [],
        points=conclusions(result),
        tables=[*decision(result), *run_tables(result.rows), what_was_run(result)],
        figures=figures_of(result),
    )
    temporary = path.with_name(f".{path.name}.part")
    try:
        save_page([section], temporary, f"Study {result.name}", generator=MARK)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"the report cannot be written: {error.strerror or error}", file=path) from error
    finally:
        temporary.unlink(missing_ok=True)


def _check_free(path: Path) -> None:
    """An earlier report is replaced; nothing else is."""
    if path.is_dir():
        raise InputError("is a folder, expected the name of an .html file", file=path)
    if path.exists():
        with path.open(encoding="utf-8", errors="replace") as page:
            if f'content="{MARK}"' not in page.read(2000):
                raise InputError("is there and is no report; nothing is overwritten, choose another file", file=path)


def conclusions(result: Finished) -> list[str]:
    """The study's answer, as it stands in the result or made again, then what it means for drive and wire."""
    kept = read_answer(result.folder)
    good = [row for row in result.rows if row.ok]
    said = list(kept.sentences) if kept is not None else _asked_again(result)
    return [*said, *_heat(good, result.scenario), *_power(good), *_wire(good)]


def _asked_again(result: Finished) -> list[str]:
    """The answer of a result that was written without one; only what its rows say where it cannot be planned here."""
    try:
        return answer(plan_study(Scenario.model_validate(dict(result.scenario)), result.machine), result.rows)
    except (InputError, ValidationError):
        return sentences(result.rows, peak_limit(result.machine))


def _heat(good: Sequence[Row], scenario: Mapping[str, Any]) -> list[str]:
    """The thermal load; only a cycle that ends where it began is said to be repeatable."""
    known = [row for row in good if row.get("thermal_load_percent") > 0.0]
    if not known:
        return []
    hot = max(known, key=lambda row: row["thermal_load_percent"])
    load, hoist = hot["thermal_load_percent"], metrics_of(known).payload
    where = run_in_words(hot, swept_axes(good))
    text = f"The {'motors' if hoist else 'drive'}'s thermal load is at most {load:.0f} % of nominal ({where})"
    text = text.replace("motors's", "motors'")
    if load > 100.0 and hoist and _closes(scenario):
        pause = hot["i2t_s"] * (1.0 - 100.0 / load)
        text += f": repeated without end the cycle needs {pause:.1f} s more of rest at no torque"
    elif load > 100.0:
        text += ": more than it bears without end"
    elif _closes(scenario):
        text += ": the cycle can be repeated without end"
    if not hoist:
        return [f"{text}."]
    above = max(row["overload_time_s"] for row in known)
    return [f"{text}. One motor is above its nominal torque for up to {above:.2g} s of it."]


def _closes(scenario: Mapping[str, Any]) -> bool:
    """Whether the moves end where they began; a jog's end depends on its limits, and events stop a move on its way."""
    start = scenario.get("start_position_m", scenario.get("start_position_rad"))
    if start is None or any(value is not None for value in (scenario.get("events") or {}).values()):
        return False
    here = float(start)
    for move in scenario.get("moves") or ():
        if move.get("speed_m_s", move.get("speed_rad_s")) is not None:
            return False
        target = move.get("to_m", move.get("to_rad"))
        here = here + float(move.get("by_m", move.get("by_rad", 0.0))) if target is None else float(target)
    return abs(here - float(start)) < 1e-9


def _power(good: Sequence[Row]) -> list[str]:
    known = [row for row in good if row.get("peak_power_motoring_kw") >= 0.0]
    if not known:
        return []
    up, down = (max(row[f"peak_power_{way}_kw"] for row in known) for way in ("motoring", "regenerating"))
    back = [row["energy_regenerated_j"] / row["energy_motoring_j"] for row in known if row["energy_motoring_j"] > 0.0]
    text = f"Both motors together give up to {up:.0f} kW and take back up to {down:.0f} kW"
    if back and 0.01 < max(back) < 1.0:  # runs that only lower get all of it back, and more
        low, high = f"{100.0 * min(back):.0f}", f"{100.0 * max(back):.0f}"
        text += f"; {low if low == high else f'{low} to {high}'} % of the work comes back at the shaft"
    return [f"{text}."]


def _wire(good: Sequence[Row]) -> list[str]:
    if not good or not metrics_of(good).payload:
        return []
    most = max(good, key=lambda row: row["max_wire_tension_n"])
    least = min(good, key=lambda row: row["min_wire_tension_n"])
    axes = swept_axes(good)
    text = (
        f"A fall of wire carries between {least['min_wire_tension_n'] / 1000.0:.1f} kN ({run_in_words(least, axes)}) "
        f"and {most['max_wire_tension_n'] / 1000.0:.1f} kN ({run_in_words(most, axes)})"
    )
    factors = [row["wire_safety_factor"] for row in good if row.metrics.get("wire_safety_factor") is not None]
    if factors:
        text += f"; the safety factor is {min(factors):.1f} or more"
    return [f"{text}."]


MOST_LINES = 60


def decision(result: Finished) -> list[Table]:
    """What decides: a row a reference, the criteria at the heaviest payload, the use of what the machine bears."""
    uses = utilisation(result.rows, result.machine)
    first = decision_table(result.rows)
    made = [one for one in _decisions(result) if one.taken is not None]
    criteria = [criteria_table(made[-1])] if made and len(made[-1].candidates) > 1 else []
    return [*([first] if first is not None else []), *criteria, *([utilisation_table(uses)] if uses else [])]


def _decisions(result: Finished) -> list[Decision]:
    given = Scenario.model_validate(dict(result.scenario)).decide
    return decisions(result.rows, result.machine, given, _beside(result))


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


Noted = tuple["Figure", str]
MOST_CURVES = 6
MOST_GROUPS = 3
SWING = "wire_tension_swing_n"


def figures_of(result: Finished) -> list[Noted]:
    """The figures that a study's kind asks for, each with a line that says how to read it."""
    good = [row for row in result.rows if row.ok]
    if not good:
        return []
    axes, drawn = swept_axes(result.rows), drawn_columns(result.rows)
    figures: list[Noted] = []
    if any(".limits." in column for axis in axes for column in axis.columns):
        figures += _paretos(good, axes)
    elif beside := [row for row in _beside(result) if row.ok]:
        taken = {d.payload_kg: d.taken.values for d in _decisions(result) if d.taken is not None}
        figures += _over_time(good, beside, taken)
    if drawn:
        figures += _scatter(good, drawn)
    figures += [_over(result, good, axis) for axis in axes if changing(good, axis)]
    if not axes and not drawn and len({row.payload_kg for row in good}) > 1:
        figures.append((_over_payload(result, good), ""))
    if (curves := _curves(result, good, axes, bool(drawn))) is not None:
        figures += curves
    return figures


def _paretos(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Noted]:
    note = (
        "Each point is a run; the line joins those that no other run beats in both. The knee is the run farthest below "
        "the line between the front's ends: beyond it on either side a little of one cost is bought dearly."
    )
    seconds = [name for name in (metrics_of(good).peak, SWING) if all(name in row.metrics for row in good)]
    return [(pareto(good, fronts(good, name)[-MOST_GROUPS:], axes, name), note) for name in seconds]


def _beside(result: Finished) -> Sequence[Row]:
    kept = read_answer(result.folder)
    return kept.beside if kept is not None else ()


def _over_time(good: Sequence[Row], beside: Sequence[Row], taken: Mapping[float, Mapping[str, float]]) -> list[Noted]:
    """For each payload and family of references peak, error and tension swing over move time."""
    judged = metrics_of(good)
    names = [name for name in (judged.peak, judged.rms_error, SWING) if name in good[0].metrics]
    note = (
        "Each line is a family of references, slowed down by its limits; of each time its best limits. Filled: runs of "
        "the study; open: run beside it; star: taken."
    )
    return [(curves_over_time(good, beside, names, taken), note)]


def _scatter(good: Sequence[Row], drawn: Sequence[str]) -> list[Noted]:
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in good:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    peak = metrics_of(good).peak
    ranked = [
        (f"{payload:g} kg, {kind}" if with_payload(rows[0]) else kind, rank_correlations(rows, drawn, peak))
        for (payload, kind), rows in groups.items()
    ]
    ranked = [group for group in ranked if group[1]][-MOST_GROUPS:]
    figures: list[Noted] = [
        (
            spread(good, _spread(good)),
            "Above the histogram, below the share of runs at or below a value; ticks: 5, 50, 95 %.",
        )
    ]
    if ranked:
        note = "Spearman's rank correlation of each drawn value with the metric: ±1 is a fixed order, 0 no relation."
        figures.append((tornado(ranked, peak), note))
    return figures


def _spread(good: Sequence[Row]) -> list[str]:
    """The metrics whose scatter is drawn."""
    return [
        m.name
        for m in shown_in(View.SPREAD, metrics_of(good))
        if all(row.metrics.get(m.name) is not None for row in good)
    ]


def _over(result: Finished, good: Sequence[Row], axis: SweptAxis) -> Noted:
    machine = result.machine
    figure = metrics_over_axis(good, axis, kind_of(machine).looped.nominal(machine), peak_limit(machine))
    several = len(good) > len({(row.payload_kg, row.reference, axis.at(row)) for row in good})
    note = "The line is the worst of the runs at a value, the band all of them." if several else ""
    if len(axis.columns) > 1:
        note = f"{axis.words.capitalize()} are walked together. {note}".strip()
    return figure, note


def _over_payload(result: Finished, good: Sequence[Row]) -> Figure:
    machine = result.machine
    payloads = np.array(sorted({row.payload_kg for row in good}))
    peak = {(row.reference, row.payload_kg): row[metrics_of(good).peak] for row in good}
    held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in good}
    kinds = dict.fromkeys(row.reference for row in good)
    peaks = {kind: np.array([peak.get((kind, payload), np.nan) for payload in payloads]) for kind in kinds}
    static = np.array([held[payload] for payload in payloads])
    limit = peak_limit(machine)
    return peak_torque_over_payload(payloads, peaks, machine.motor.nominal_torque_nm, limit, static)


def _curves(result: Finished, good: Sequence[Row], axes: Sequence[SweptAxis], drawn: bool) -> list[Noted] | None:
    """Signals over time, and torque over speed, of a choice of runs that can be told apart."""
    runs, what = _chosen(result, good, axes, drawn)
    if not runs:
        return None
    kind = kind_of(result.machine)
    if kind.looped.position_loop:
        of = kind, peak_limit(result.machine), result.machine.drive.nominal
        ramp = _first_ramp(runs[0][1], kind.looped.references[1])
        short = ramp[0] + 0.3, ramp[1] - 1.3  # what an axis does is soon over
        start = axis_overview(
            runs, *of, "Start of the first move", (short[0], max(short[1], 1.5 * short[1] - 0.5 * short[0]))
        )
        return [(start, what), (axis_overview(runs, *of, "Closed loop over time"), what)]
    motor, limit = result.machine.motor, peak_limit(result.machine)
    shaded = "Where a fall of wire is slack the panel of its tension is shaded."
    plane = torque_speed_plane(
        runs, motor.nominal_torque_nm, limit, motor.nominal_speed_rad_s, result.machine.drive.field_weakening
    )
    over_time = overview(runs, motor.nominal_torque_nm, limit, "Closed loop over time")
    start = overview(
        runs, motor.nominal_torque_nm, limit, "Start of the first move", _first_ramp(runs[0][1]),
        ("speed", "error", "torque"),
    )  # fmt: skip
    return [
        (start, what),
        (over_time, f"{what} {shaded}".strip()),
        (
            plane,
            f"{what} Within the continuous line for as long as one likes, up to the peak line for a while.".strip(),
        ),
    ]


def _first_ramp(run: Run, signal: str = "speed_reference_rad_s") -> tuple[float, float]:
    """From when the reference begins to move to a moment after it has its speed (s)."""
    speed = np.abs(run[signal])
    moving = np.flatnonzero(speed > 1e-3 * speed.max())
    if not len(moving):
        return float(run.time_s[0]), float(run.time_s[-1])
    there = moving[0] + int(np.argmax(speed[moving[0] :] >= 0.999 * speed.max()))
    return float(run.time_s[moving[0]]) - 0.4, float(run.time_s[there]) + 1.5


def _chosen(
    result: Finished, good: Sequence[Row], axes: Sequence[SweptAxis], drawn: bool
) -> tuple[list[tuple[str, Run]], str]:
    kept = [row for row in good if row.run_id in result.runs]
    if not kept or drawn:
        return [], ""
    if not axes:
        return [(row.reference, result.runs[row.run_id]) for row in kept], ""
    axis, others = axes[0], axes[1:]
    points = [axis.points[i] for i in np.unique(np.linspace(0, len(axis.points) - 1, MOST_CURVES).round().astype(int))]
    kind = kept[-1].reference
    shown = [
        row for row in kept
        if row.reference == kind and axis.at(row) in points and all(o.at(row) == o.points[0] for o in others)
    ]  # fmt: skip
    said = "; ".join([kind, *(other.say(other.points[0]) for other in others)])
    return [(axis.say(axis.at(row)), result.runs[row.run_id]) for row in shown], f"Runs with {said}."
