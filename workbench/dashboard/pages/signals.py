"""The page Signals: runs and signals of a campaign as they were logged, under one cursor and one zoom."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import streamlit as st

from workbench.core.errors import InputError, nearest
from workbench.core.run import Array, Run
from workbench.core.table import Column, Table
from workbench.dashboard import session, widgets
from workbench.dashboard.chosen import chosen_campaign
from workbench.dashboard.widgets import guarded, held, plain, text
from workbench.logs import Campaign
from workbench.logs.signal_files import Labelled
from workbench.view.logs import Stretch, browser, start_of_move

WHOLE, RAMP = "whole runs", "start of the first move"
FEW_RUNS, MOST_ROWS, MOST_IN_ROW = 3, 10, 4
FIRST = ("speed", "torque", "force", "current", "tension")  # what a log is looked at for first, by name's beginning
OPERATORS = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power,
    ast.USub: np.negative, ast.UAdd: np.positive,
}  # fmt: skip
FUNCTIONS = {"abs": np.abs, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "exp": np.exp, "log": np.log}


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        campaign = chosen_campaign("signals campaign")
        runs, rows = _chosen(campaign)
        stretches = _stretches(runs)
    st.markdown(f"#### Campaign {plain(campaign.name)} · {plain(campaign.machine.name)}")
    # A zoom stays while other runs and signals are chosen, and goes with the stretch that it was made in.
    within = sorted({(part.zero_s != 0.0, part.start_s if part.zero_s == 0.0 else 0.0) for part in stretches})
    key = f"signals {campaign.name} {within}"
    widgets.chart(browser(stretches, rows), key, "The chosen signals of the chosen runs over time")
    st.caption(
        "As logged, in SI, unfiltered. Of a long stretch the least and the largest of each part are drawn, so that no "
        "peak is lost; a shorter stretch shows every sample. Drag for a zoom, double click to come back."
    )
    _take_away(campaign, stretches, [signal for row in rows for signal in row])
    widgets.table(runs_table(runs), in_words=len(runs) <= MOST_ROWS)
    widgets.notes(campaign.all_notes)


def _chosen(campaign: Campaign) -> tuple[list[Run], list[list[str]]]:
    """The side bar's runs, and the signals of each row; ends the page where there are none."""
    names = [run.name for run in campaign.runs]
    which = f"{campaign.path} {campaign.name}"
    chosen = st.multiselect("Runs", names, key=held(f"signals runs {which}", names[:FEW_RUNS]))
    runs = [run for run in campaign.runs if run.name in chosen]
    rows_place = st.container()  # above; the computed ones are in its lists
    known = list(dict.fromkeys(name for run in campaign.runs for name in run.signals))
    first = [name for name in known if name.startswith(FIRST)] or known
    said = st.text_area(
        "Computed signals", key=held(f"signals computed {which}", ""), max_chars=2000, height=68,
        placeholder=f"product = {min(first)} * {max(first)}",
        help=f"A line each, name = expression of signals, with + - * / **, ddt(…) for the slope and "
        f"{', '.join(FUNCTIONS)}. The name's end is its unit.",
    )  # fmt: skip
    computed = []
    try:
        for line in filter(None, map(str.strip, said.splitlines())):
            runs = [with_computed(line, run) for run in runs]
            computed.append(line.partition("=")[0].strip())
    except InputError as error:
        widgets.problem(error)
    with rows_place:
        rows = _rows(which, known, computed)
    if not runs or not rows:
        st.info("Choose at least one run and one signal.", icon=":material/info:")
        st.stop()
    return runs, rows


def _rows(which: str, known: Sequence[str], computed: Sequence[str]) -> list[list[str]]:
    """The signals of each row. Streamlit has nothing to drag: a field a row, and an empty one that begins another; a
    computed signal that stands in none has a row of its own."""
    usual = [[name] for name in known if name.startswith(FIRST)][:4] or [[name] for name in known[:3]]
    kept: list[list[str]] = session.get(f"signals rows {which}", list, usual)
    options = [*known, *computed]
    rows = [
        st.multiselect(
            f"Row {number + 1}", options, max_selections=MOST_IN_ROW, placeholder="Choose signals",
            key=held(f"signals row {number} {which}", [name for name in row if name in options]),
        )
        for number, row in enumerate([*kept, []][:MOST_ROWS])
    ]  # fmt: skip
    kept = [row for row in rows if row]
    session.put(f"signals rows {which}", kept)
    if len(rows) != min(len(kept) + 1, MOST_ROWS):
        st.rerun()  # a row was emptied, or the last one filled: the fields move up, or one more is there
    return [*kept, *([name] for name in computed if not any(name in row for row in kept))]


def with_computed(said: str, run: Run) -> Run:
    """The run with one signal more, `name = expression`. InputError for what is no expression of its signals."""
    name, equals, expression = (part.strip() for part in said.partition("="))
    if not equals or re.fullmatch(r"[A-Za-z]\w*", name) is None:
        raise InputError(f"'{said}', expected name = expression", place="Computed signal")
    if name in run.signals:
        raise InputError(f"'{name}' is a signal of the log; choose another name", place="Computed signal")
    try:
        tree = ast.parse(expression, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise InputError(f"'{expression}' is no expression", place="Computed signal") from error
    with np.errstate(all="ignore"):
        values = np.broadcast_to(np.asarray(_value(tree, run), dtype=float), run.time_s.shape)
    return replace(run, signals={**run.signals, name: values})


def _value(node: ast.expr, run: Run) -> Array | float:
    """Walks the expression; nothing but numbers, signals, arithmetic and the functions above is evaluated."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name) if name in run:
            return run[name]
        case ast.Name(id=name):
            raise InputError(f"'{name}' is no signal; {nearest(name, run.signals)}", place="Computed signal")
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_value(left, run), _value(right, run))
        case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_value(operand, run))
        case ast.Call(func=ast.Name(id="ddt"), args=[argument], keywords=[]):
            return np.gradient(np.broadcast_to(_value(argument, run), run.time_s.shape), run.time_s)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            return FUNCTIONS[name](_value(argument, run))
    raise InputError(f"'{ast.unparse(node)}' is not arithmetic of signals", place="Computed signal")


def _stretches(runs: Sequence[Run]) -> list[Stretch]:
    """The stretch of time that is asked for, of each run."""
    what = st.segmented_control("Stretch", (WHOLE, RAMP), key=held("signals stretch", WHOLE), required=True,
                                label_visibility="collapsed", width="stretch")  # fmt: skip
    if what == RAMP:
        starts = {run.name: start_of_move(run) for run in runs}
        if still := [name for name, start in starts.items() if start is None]:
            st.caption(plain(f"Not shown, for nothing moves in them: {', '.join(still)}."))
        return [start for start in starts.values() if start is not None]
    end = max(float(run.time_s[-1]) for run in runs)
    begin = min(float(run.time_s[0]) for run in runs)
    low, high = (
        column.number_input(
            words, begin, end, step=1.0, key=held(f"signals {words} {begin:g} {end:g}", value), format="%.4g"
        )
        for column, words, value in zip(st.columns(2), ("From (s)", "To (s)"), (begin, end), strict=True)
    )
    if high <= low:
        st.error("The end lies before the beginning; all is shown.", icon=":material/error:")
        low, high = begin, end
    return [Stretch(run, low, high) for run in runs]


def _take_away(campaign: Campaign, stretches: Sequence[Stretch], signals: Sequence[str]) -> None:
    """The chosen signals of the chosen runs, every sample of the stretch; written when it is asked for."""

    def labelled() -> list[Labelled]:
        return [
            Labelled(part.run.name, {"run": part.run.name, "payload_kg": part.run.payload_kg}, part_of(part, signals))
            for part in stretches
        ]

    with st.container(horizontal=True):
        widgets.downloads("signals file", widgets.signal_files(campaign.name, labelled))


def part_of(stretch: Stretch, signals: Sequence[str]) -> Run:
    """The stretch of a run, in the run's own time."""
    run = stretch.run
    inside = (run.time_s >= stretch.start_s) & (run.time_s <= stretch.end_s)
    kept = {name: run[name][inside] for name in signals if name in run}
    return replace(run, time_s=run.time_s[inside], signals=kept)


def runs_table(runs: Sequence[Run]) -> Table:
    """What each log is: samples, time, payload, how much of it is missing; its signals where they are not all alike."""
    rows, alike = [], len({tuple(run.signals) for run in runs}) == 1
    for run in runs:
        missing = max((int(np.count_nonzero(~np.isfinite(values))) for values in run.signals.values()), default=0)
        rows.append((
            run.name, f"{len(run.time_s)}", text(1e3 * run.sample_time_s), text(run.duration_s, 4),
            f"{run.payload_kg:g}", f"{missing}", *([] if alike else [", ".join(run.signals)]),
        ))  # fmt: skip
    heads = ("run", "samples", "step (ms)", "length (s)", "payload (kg)", "samples missing", *["signals"][alike:])
    columns = tuple(Column(head, align="left" if head in ("run", "signals") else "right") for head in heads)
    return Table(columns, rows, f"Signals of each run: {', '.join(runs[0].signals)}." if alike else "")
