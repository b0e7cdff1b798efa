"""A study as people read it: tables, sentences on what the machine bears, figures, the page, the view for notebooks."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core import shown as core_shown
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_file
from workbench.machines import kind_of
from workbench.metrics import Metric, View, shown_in
from workbench.study import conclude
from workbench.study.conclude import QUANTILES, SIGN, Use, utilisation
from workbench.study.decide import TIME, Decision, decisions
from workbench.study.front import fronts
from workbench.study.labels import SweptAxis, drawn_columns, field_label, run_in_words, said, shown, swept_axes
from workbench.study.rows import Row, index_table, metrics_of, with_payload
from workbench.study.run import StudyResult, peak_limit
from workbench.view import study_figures as draw
from workbench.view.page import Section, save_page
from workbench.view.study_figures import QUANTITIES, over_time, plane
from workbench.view.style import Figure, label

__all__ = ["over_time", "plane"]  # beside what is defined here
MARK = "workbench report"
BEST = "★"
MOST_SWEPT = 3  # columns of swept values, or one for each axis
WIDEST_HEAD, WIDEST_RUN, WIDEST_NAME = 12, 42, 26  # characters of a head's line, of a run in words, of a name
MOST_LINES = 60  # runs that are listed one by one
MOST_CURVES, MOST_GROUPS, MOST_NAMED = 6, 3, 12
SWING = "wire_tension_swing_n"
Noted = tuple[Figure, str]


def _case(rows: Sequence[Row]) -> list[Column]:
    """Payload, where the machine carries one, and reference."""
    return [*([Column("payload", "kg")] if metrics_of(rows).payload else []), words("reference")]


def _case_cells(row: Row) -> list[str]:
    return [*([f"{row.payload_kg:g}"] if with_payload(row) else []), row.reference]


def run_table(rows: Sequence[Row]) -> Table:
    """A line a run: payload, reference, the fields that differ between the runs, metrics.

    A failed run has no metrics but those known before it runs.
    """
    return _lines(rows, shown_in(View.SWEPT_RUNS if _swept(rows) else View.RUNS, metrics_of(rows)))


def _lines(rows: Sequence[Row], metrics: Sequence[Metric], what: str = "") -> Table:
    swept, lines = _swept(rows), []
    for row in rows:
        cells = [metric.text(row.get(metric.name)) for metric in metrics]
        if not row.ok and cells and not what:
            cells[0] = "failed"
        lines.append([*_case_cells(row), *(shown(row.assigned.get(name, "")) for name in swept), *cells])
    fields = []
    for name in swept:
        field, text = field_label(name), any(isinstance(row.assigned.get(name), str) for row in rows)
        fields.append(Column(_narrow(field.words), field.unit, "left" if text else "right"))
    return Table([*_case(rows), *fields, *metric_heads(metrics)], lines, f"{what}{metric_note(metrics)}")


def _swept(rows: Sequence[Row]) -> list[str]:
    """Of each axis of the sweep a field, and more of them where there is room; without any, some of the drawn ones."""
    axes = swept_axes(rows)
    swept = [column for axis in axes for column in axis.columns]
    needed = [axis.columns[0] for axis in axes]
    more = [column for column in swept if column not in needed][: max(MOST_SWEPT - len(needed), 0)]
    return [column for column in swept if column in {*needed, *more}] or drawn_columns(rows)[:MOST_SWEPT]


def quantile_table(rows: Sequence[Row]) -> Table:
    """Five lines for each payload and reference; of failed runs their number only."""
    metrics, lines = shown_in(View.QUANTILES, metrics_of(rows)), []
    cases: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        cases.setdefault(tuple(_case_cells(row)), []).append(row)
    shares = dict(zip(("least", "5 %", "median", "95 %", "most"), (0.0, *QUANTILES, 1.0), strict=True))
    for case, members in cases.items():
        good = [row for row in members if row.ok]
        failed = f" + {len(members) - len(good)} failed" if len(good) < len(members) else ""
        head = [*case, f"{len(good)}{failed}"]
        if not good:
            lines.append([*head, "", *("–" for _ in metrics)])
        for name, share in shares.items() if good else ():
            values = [np.quantile([row.get(metric.name) for row in good], share) for metric in metrics]
            cells = [metric.text(float(value)) for metric, value in zip(metrics, values, strict=True)]
            lines.append([*(head if name == "least" else [""] * len(head)), name, *cells])
    each = "payload and reference" if metrics_of(rows).payload else "reference"
    note = f"Of each {each} and column: smallest value, 5 %, 50 % and 95 % quantiles, largest. {metric_note(metrics)}"
    return Table([*_case(rows), Column("runs"), words("quantile"), *metric_heads(metrics)], lines, note)


def extremes_table(rows: Sequence[Row], axes: Sequence[SweptAxis]) -> Table:
    """The runs at the ends of what matters; where all runs are alike no line."""
    good, metrics, lines = [row for row in rows if row.ok], shown_in(View.EXTREMES, metrics_of(rows)), []
    for metric in metrics:
        known = [row for row in good if np.isfinite(row.get(metric.name))]
        values = np.array([row[metric.name] for row in known])
        values = np.abs(values) if metric.better == "zero" else values
        if not len(values) or np.ptp(values) <= 1e-9 * abs(values[0]):
            continue
        for name, sign in metric.ends:
            row = known[int(np.argmax(sign * values))]
            which = textwrap.fill(run_in_words(row, axes), WIDEST_RUN)
            lines.append([name, which, *(column.text(row.get(column.name)) for column in metrics)])
    return Table([words("run with the"), words("which"), *metric_heads(metrics)], lines)


def metric_heads(metrics: Sequence[Metric]) -> list[Column]:
    """A column a metric."""
    return [Column(metric.head or _narrow(metric.label), metric.shown_unit) for metric in metrics]


def metric_note(metrics: Sequence[Metric]) -> str:
    """What the heads mean: `Peak and RMS: torque of one motor; moves: time in motion.`; heads of one note together."""
    by_note: dict[str, dict[str, None]] = {}
    for metric in metrics:
        head = (metric.head or metric.label).replace("\n", " ")
        by_note.setdefault(metric.note or metric.label, {})[head] = None
    parts = [note if [note] == list(heads) else f"{' and '.join(heads)}: {note}" for note, heads in by_note.items()]
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _narrow(text: str) -> str:
    """Words over as many lines as they need to be narrow."""
    return "\n".join(textwrap.wrap(text, WIDEST_HEAD, break_long_words=False, break_on_hyphens=False))


def decision_table(decision: Decision) -> Table | None:
    """Of each reference its best limits in the time of the one taken; None where there is nothing to choose."""
    compared, judged, lines = decision.at_equal_time, decision.judged, []
    if len(compared) < 2:
        return None
    names = (judged.peak, TIME, judged.rms_error, SWING)
    metrics = [c.metric for c in decision.criteria if c.name in names]
    for one in compared:
        name = label(one.reference).removesuffix(", same limits" if one.setting else "")
        name = f"{BEST} {name}" if one is decision.taken else name
        texts = [textwrap.fill(text, WIDEST_NAME) for text in (name, one.setting or "as given")]
        cells = [metric.text(one.values[metric.name]) for metric in metrics]
        lines.append([*texts, *cells, "out" if one.broken else f"{one.total:.2f}"])
    note = said.compared(decision, BEST, metric_note(metrics))
    return Table([words("reference"), words("with"), *metric_heads(metrics), Column("sum")], lines, note)


def criteria_table(decision: Decision) -> Table:
    """Each criterion with weight, limit and its value for the one taken and for its rival."""
    compared = [candidate for candidate in (decision.taken, decision.rival) if candidate is not None]
    columns = [words("criterion"), Column("weight"), words("limit"), *(Column(c.words) for c in compared)]
    lines = [
        [c.metric.heading, f"{c.weight:g}", c.limit_words, *(c.text(one.values[c.name]) for one in compared)]
        for c in decision.criteria
    ]
    lines.append(["Weighted sum of shares", "", "", *(f"{one.total:.3f}" for one in compared)])
    where = f"At {decision.payload_kg:g} kg. " if decision.judged.payload else ""
    return Table(columns, lines, f"{where}The least weighted sum is taken of those that keep every limit.")


def utilisation_table(uses: Sequence[Use]) -> Table:
    """A line each, with its light."""
    lines = [[f"{SIGN[use.light]} {use.light}", use.what, f"{use.percent:.0f}", use.bound, use.where] for use in uses]
    note = "Green up to 85 % of what is borne, amber above, red where it is reached; the run that uses most."
    return Table([words("light"), words("utilisation"), Column("used", "%"), words("of"), words("in")], lines, note)


def run_tables(rows: Sequence[Row]) -> list[Table]:
    """Tables with a line a run; of more than sixty runs their quantiles and the runs at the ends."""
    if len(rows) > MOST_LINES:
        note = f"Each of the {len(rows)} runs has its line in index.parquet."
        return [quantile_table(rows), replace(extremes_table(rows, swept_axes(rows)), note=note)]
    judged, tables = metrics_of(rows), [run_table(rows)]
    for view, what in ((View.DRIVE, "The drive"), (View.MOTION, "Motion and wire" if judged.payload else "Motion")):
        metrics = [m for m in shown_in(view, judged) if any(row.metrics.get(m.name) is not None for row in rows)]
        tables += [_lines(rows, metrics, f"{what}. ")] if metrics else []
    return tables


def what_was_run(result: StudyResult) -> Table:
    """Scenario, machine, versions: enough to run it again."""
    scenario, manifest, machine, rows = result.scenario, result.manifest, result.machine, result.rows

    def few(names: Sequence[str]) -> str:
        return ", ".join(names) if len(names) <= MOST_NAMED else f"{names[0]} to {names[-1]}, {len(names)} values"

    failed = sum(not row.ok for row in rows)
    payloads = few([f"{p:g}" for p in sorted({row.payload_kg for row in rows})])
    lines = {
        "machine": f"{machine.name} ({manifest.get('machine_hash', '')})".removesuffix(" ()"),
        "drive": kind_of(machine).looped.drive_words(machine),
        "payloads": f"{payloads} kg" if metrics_of(rows).payload else "",
        "references": ", ".join(dict.fromkeys(row.reference for row in rows)),
        "moves": "; ".join(_block(move) for move in scenario.get("moves") or ()),
        **{name: _block(scenario.get(name) or {}) for name in ("limits", "controller", "events")},
    }
    for axis in swept_axes(rows):
        lines[f"swept: {axis.words}"] = few([axis.short(point) for point in axis.points])
    for column in drawn_columns(rows):
        values = [float(value) for row in rows if not isinstance(value := row.assigned[column], str)]
        field = field_label(column)
        lines[f"drawn: {field.words}"] = f"{shown(min(values))} to {shown(max(values))} {field.unit}"
    lines["runs"] = f"{len(rows)}" + (f", of which {failed} failed" if failed else "")
    if manifest:
        lines["scenario"] = f"{manifest.get('scenario_hash', '')}, seed {manifest.get('seed')}"
        versions = ", ".join(f"{name} {number}" for name, number in (manifest.get("versions") or {}).items())
        commit = f"; commit {str(manifest['commit'])[:12]}" if manifest.get("commit") else ""
        lines["program"] = f"{versions}; {manifest.get('platform', '')}{commit}"
    return Table([words("what"), words("was run")], [[name, text] for name, text in lines.items() if text])


def _block(block: Mapping[str, Any]) -> str:
    """The values of a block of the scenario that are given, each with its key's words and unit."""
    parts = []
    for key, value in block.items():
        if isinstance(value, Mapping):
            inner = _block({k: v for k, v in value.items() if v})
            parts += [f"{key.replace('_', ' ')}: {inner}"] if inner else []
        elif isinstance(value, bool):
            parts.append(f"{key.replace('_', ' ')} {'yes' if value else 'no'}")
        elif value is not None:
            parts.append(value if key == "kind" else field_label(key).of(value))
    return ", ".join(parts)


def conclusions(result: StudyResult) -> list[str]:
    """The study's answer, as it stands in the result or made again, then what it means for drive and wire."""
    kept, good = _kept(result), [row for row in result.rows if row.ok]
    answer = list(kept.sentences) if kept is not None else _asked_again(result)
    return [*answer, *_heat(good, result.scenario), *_power(good), *_wire(good)]


def _kept(result: StudyResult) -> conclude.Answer | None:
    return None if result.folder is None else conclude.read_answer(result.folder)


def _asked_again(result: StudyResult) -> list[str]:
    """The answer of a result without one; only what its rows say where it cannot be planned here."""
    try:
        return conclude.answer(result.study, result.rows)
    except InputError:
        return conclude.sentences(result.rows, peak_limit(result.machine))


def _heat(good: Sequence[Row], scenario: Mapping[str, Any]) -> list[str]:
    """The thermal load; only a cycle that ends where it began is said to be repeatable."""
    known = [row for row in good if row.get("thermal_load_percent") > 0.0]
    if not known:
        return []
    hot = max(known, key=lambda row: row["thermal_load_percent"])
    load, hoist, closes = hot["thermal_load_percent"], metrics_of(known).payload, _closes(scenario)
    pause = hot["i2t_s"] * (1.0 - 100.0 / load) if load > 100.0 and hoist and closes else None
    above = max(row["overload_time_s"] for row in known) if hoist else 0.0
    return [said.heat(load, hoist, run_in_words(hot, swept_axes(good)), closes, pause, above)]


def _closes(scenario: Mapping[str, Any]) -> bool:
    """Whether the moves end where they began; a jog's end depends on its limits, and events stop a move on its way."""
    start = scenario.get("start_position_m", scenario.get("start_position_rad"))
    moves = scenario.get("moves") or ()
    jogs = any("for_s" in move for move in moves)
    if start is None or jogs or any(value is not None for value in (scenario.get("events") or {}).values()):
        return False
    here = float(start)
    for move in moves:
        target = move.get("to_m", move.get("to_rad"))
        here = here + float(move.get("by_m", move.get("by_rad", 0.0))) if target is None else float(target)
    return abs(here - float(start)) < 1e-9


def _power(good: Sequence[Row]) -> list[str]:
    known = [row for row in good if row.get("peak_power_motoring_kw") >= 0.0]
    if not known:
        return []
    up, down = (max(row[f"peak_power_{way}_kw"] for row in known) for way in ("motoring", "regenerating"))
    back = [row["energy_regenerated_j"] / row["energy_motoring_j"] for row in known if row["energy_motoring_j"] > 0.0]
    told = back and 0.01 < max(back) < 1.0  # runs that only lower get all of it back, and more
    return [said.power(up, down, dict.fromkeys(f"{100.0 * pick(back):.0f}" for pick in (min, max)) if told else ())]


def _wire(good: Sequence[Row]) -> list[str]:
    if not good or not metrics_of(good).payload:
        return []
    least, most = "min_wire_tension_n", "max_wire_tension_n"
    ends = min(good, key=lambda row: row[least]), max(good, key=lambda row: row[most])
    runs = (run_in_words(row, swept_axes(good)) for row in ends)
    factors = [row["wire_safety_factor"] for row in good if row.metrics.get("wire_safety_factor") is not None]
    return [said.wire(ends[0][least], ends[1][most], *runs, factors)]


def decision(result: StudyResult) -> list[Table]:
    """What decides: at each payload a row a reference, the criteria at the heaviest, the use of what is borne."""
    made, uses = _decisions(result), utilisation(result.rows, result.machine)
    tables = [table for one in made[-MOST_GROUPS:] if (table := decision_table(one)) is not None]
    criteria = [criteria_table(made[-1])] if made[-1].rival is not None else []
    return [*tables, *criteria, *([utilisation_table(uses)] if uses else [])]


def _decisions(result: StudyResult) -> list[Decision]:
    kept = _kept(result)
    beside = kept.beside if kept is not None else ()
    return decisions(result.rows, result.machine, result.study.scenario.decide, beside)


def figures_of(result: StudyResult) -> list[Noted]:
    """The figures that a study's kind asks for, each with a line that says how to read it."""
    good = [row for row in result.rows if row.ok]
    if not good:
        return []
    kept, judged, figures = _kept(result), metrics_of(good), list[Noted]()
    axes, drawn = swept_axes(result.rows), drawn_columns(result.rows)
    beside = [row for row in kept.beside if row.ok] if kept is not None else []
    if any(".limits." in column for axis in axes for column in axis.columns):
        every = [*good, *(row for row in beside if row.assigned.keys() == good[0].assigned.keys())]
        names = [name for name in (judged.peak, SWING) if all(name in row.metrics for row in every)]
        for name in names:
            figures.append((draw.pareto(every, fronts(every, name)[-MOST_GROUPS:], axes, name), said.pareto()))
    elif beside:
        taken = {d.payload_kg: d.taken.values for d in _decisions(result) if d.taken is not None}
        names = [name for name in (judged.peak, judged.rms_error, SWING) if name in good[0].metrics]
        figures.append((draw.curves_over_time(good, beside, names, taken), said.over_time()))
    figures += _scatter(good, drawn) if drawn else []
    figures += [_over(result, good, axis) for axis in axes if draw.changing(good, axis)]
    if not axes and not drawn and len({row.payload_kg for row in good}) > 1:
        figures.append((peaks_figure(result), ""))
    return [*figures, *_curves(result)]


def _scatter(good: Sequence[Row], drawn: Sequence[str]) -> list[Noted]:
    judged, groups = metrics_of(good), dict[str, list[Row]]()
    for row in good:
        case = f"{row.payload_kg:g} kg, {row.reference}" if judged.payload else row.reference
        groups.setdefault(case, []).append(row)
    ranked = [(name, conclude.rank_correlations(rows, drawn, judged.peak)) for name, rows in groups.items()]
    ranked = [group for group in ranked if group[1]][-MOST_GROUPS:]
    names = [m.name for m in shown_in(View.SPREAD, judged) if all(row.metrics.get(m.name) is not None for row in good)]
    figures: list[Noted] = [(draw.spread(good, names), said.spread())]
    return [*figures, (draw.tornado(ranked, judged.peak), said.tornado())] if ranked else figures


def _over(result: StudyResult, good: Sequence[Row], axis: SweptAxis) -> Noted:
    machine = result.machine
    figure = draw.metrics_over_axis(good, axis, kind_of(machine).looped.nominal(machine), peak_limit(machine))
    several = len(good) > len({(row.payload_kg, row.reference, axis.at(row)) for row in good})
    note = "The line is the worst of the runs at a value, the band all of them." if several else ""
    together = f"{axis.words.capitalize()} are walked together. " if len(axis.columns) > 1 else ""
    return figure, f"{together}{note}".strip()


def peaks_figure(result: StudyResult) -> Figure:
    """The torque peak over payload, a line a reference, with what holds the load."""
    machine, good = result.machine, [row for row in result.rows if row.ok]
    loads = np.array(sorted({row.payload_kg for row in good}))
    if len(loads) < 2:
        raise InputError("there is nothing to draw: it takes two payloads")
    peak = {(row.reference, row.payload_kg): row[metrics_of(good).peak] for row in good}
    held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in good}
    kinds = dict.fromkeys(row.reference for row in good)
    peaks = {kind: np.array([peak.get((kind, load), np.nan) for load in loads]) for kind in kinds}
    static: Array = np.array([held[load] for load in loads])
    limits = machine.motor.nominal_torque_nm, peak_limit(machine)
    return draw.peak_torque_over_payload(loads, peaks, *limits, static)


def _curves(result: StudyResult) -> list[Noted]:
    """Signals over time, and torque over speed, of a choice of runs that can be told apart."""
    runs, what = chosen_runs(result)
    if not runs:
        return []
    start = (start_figure(result), what)
    if kind_of(result.machine).looped.position_loop:
        return [start, (runs_figure(result), what)]
    shaded = "Where a fall of wire is slack the panel of its tension is shaded."
    within = "Within the continuous line for as long as one likes, up to the peak line for a while."
    whole = (runs_figure(result), f"{what} {shaded}".strip())
    return [start, whole, (plane(runs, result.machine), f"{what} {within}".strip())]


def runs_figure(result: StudyResult) -> Figure:
    """The runs over time."""
    return over_time(_runs(result), result.machine, "Closed loop over time")


def start_figure(result: StudyResult) -> Figure:
    """The start of the first move."""
    runs = _runs(result)
    return over_time(runs, result.machine, "Start of the first move", start_of_move(result), QUANTITIES[:3])


def _runs(result: StudyResult) -> list[tuple[str, Run]]:
    runs = chosen_runs(result)[0]
    if not runs:
        raise InputError("there is nothing to draw: it takes a run that ends and keeps its signals")
    return runs


def start_of_move(result: StudyResult) -> tuple[float, float]:
    """From when to when (s) the first move gathers speed, and what rings after it."""
    loop = kind_of(result.machine).looped
    run = chosen_runs(result)[0][0][1]
    speed = np.abs(run[loop.references[1] if loop.position_loop else "speed_reference_rad_s"])
    moving = np.flatnonzero(speed > 1e-3 * speed.max())
    if not len(moving):
        return float(run.time_s[0]), float(run.time_s[-1])
    there = moving[0] + int(np.argmax(speed[moving[0] :] >= 0.999 * speed.max()))
    start, end = float(run.time_s[moving[0]]), float(run.time_s[there])
    if loop.position_loop:  # what an axis does is soon over
        return start - 0.1, max(end + 0.2, 1.5 * end - 0.5 * start + 0.35)
    return start - 0.4, end + 1.5


def chosen_runs(result: StudyResult) -> tuple[list[tuple[str, Run]], str]:
    """Some runs with their names, and what they have in common: without a sweep all that kept their signals."""
    kept = [row for row in result.rows if row.ok and row.run_id in result.runs]
    axes = swept_axes(result.rows)
    if not kept or drawn_columns(result.rows):
        return [], ""
    if not axes:
        return [(row.reference, result.runs[row.run_id]) for row in kept], ""
    axis, others = axes[0], axes[1:]
    points = [axis.points[i] for i in np.unique(np.linspace(0, len(axis.points) - 1, MOST_CURVES).round().astype(int))]
    kind = kept[-1].reference
    some = [
        row for row in kept
        if row.reference == kind and axis.at(row) in points and all(o.at(row) == o.points[0] for o in others)
    ]  # fmt: skip
    where = "; ".join([kind, *(other.say(other.points[0]) for other in others)])
    return [(axis.say(axis.at(row)), result.runs[row.run_id]) for row in some], f"Runs with {where}."


def save_study_page(result: StudyResult, path: Path) -> None:
    """Write the report as one page that needs no network. The same result, the same bytes."""
    description = str(result.scenario.get("description") or "")
    section = Section(
        sentences=[description] if description else [],
        points=conclusions(result),
        tables=[*decision(result), *run_tables(result.rows), what_was_run(result)],
        figures=figures_of(result),
    )
    save_page([section], path, f"Study {result.name}", generator=MARK)


def write_study_report(result: StudyResult, path: Path) -> None:
    """The page at a place of the user's; InputError where another file stands there, or it cannot be written."""
    if path.is_dir():
        raise InputError("is a folder, expected the name of an .html file", file=path)
    if path.exists():
        with path.open(encoding="utf-8", errors="replace") as page:
            if f'content="{MARK}"' not in page.read(2000):
                raise InputError("is there and is no report; nothing is overwritten, choose another file", file=path)
    with whole_file(path) as part:
        save_study_page(result, part)


def _columns(result: StudyResult) -> Mapping[str, Sequence[Any]]:
    """The index of the study: what a run was, what a sweep set, its metrics."""
    table = index_table(result.rows)
    return {name: table[name].to_pylist() for name in table.column_names}


VIEW = core_shown.View(
    {"runs": lambda result: run_table(result.rows)},
    {"runs": runs_figure, "start": start_figure, "peaks": peaks_figure},
    _columns,
    index="run_id",
)
