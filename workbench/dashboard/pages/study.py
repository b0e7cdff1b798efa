"""The page Study: what a jerk limit, another payload or another controller does to the move of a hoist or an axis."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.names import powers, words_of
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.dashboard import desk, session, widgets
from workbench.dashboard.chosen import session_machine
from workbench.dashboard.pages import compare
from workbench.dashboard.widgets import Number, chart, fold, guarded, held, plain, problem, table, text
from workbench.machines import HOIST, Hoist, Machine, default_hoist, kind_of, machine_text
from workbench.metrics import View, columns, shown_in
from workbench.references import BASELINE
from workbench.study.beside import beyond_its_limits, damping_sentence, over_payload, over_ramps
from workbench.study.conclude import SIGN, alarm, sentences, utilisation
from workbench.study.decide import Decision, decisions, take_sentences
from workbench.study.front import fronts
from workbench.study.labels import swept_axes
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, labelled_runs, peak_limit, run_study
from workbench.study.scenario import Scenario
from workbench.view import study as view
from workbench.view.logs import Stretch, browser
from workbench.view.study_figures import pareto
from workbench.view.style import label

GOOD = "study good"
WHOLE, RAMP, OWN = "whole run", "start of the first move", "from … to …"
FIGURE, PLANE, PEAKS, LIMITS = "study figure", "Torque over speed", "Peak over payload", "Other limits"
RAMPS = (0.4, 0.55, 0.7, 0.85, 1.0, 1.25, 1.6)  # of the acceleration that is set
JERKS = (0.25, 0.4, 0.63, 1.0, 1.6, 2.5, 4.0)  # of the jerk that is set
POINTS = 5  # payloads of the curve over payload
KEPT = 12  # studies of all sessions together, some 5 MB of signals each
LUMPED = {"plant": "lumped"}  # of the curves beside a study: dozens of runs
COLOURS = {"green": "green", "amber": "orange", "red": "red"}
Good = tuple[Scenario, Machine, StudyResult]


def show() -> None:
    """Draws the page."""
    linked = st.query_params.get(desk.ADDRESS_KEY)
    if linked and not any(str(key).startswith("desk ") for key in st.session_state):  # nothing is set yet
        try:
            desk.set_desk(*desk.from_address(linked))
        except InputError as error:
            problem(error)
    bad: list[InputError] = []
    with st.sidebar:
        machine = session_machine("study machine")
        asked = desk.controls(machine, bad)
    head, top = st.container(), st.container()
    with top:
        scenario, machine, result = _ran(asked, machine, bad)
    with head:
        _head(scenario, machine, result)
    with top:
        made = decisions(result.rows, result.study.machine, result.study.scenario.decide)
        _decision(result, made)
    runs = [(row.reference, result.runs[row.run_id]) for row in result.rows if row.ok and row.run_id in result.runs]
    if runs:
        stretch = _window(result, max(float(run.time_s[-1]) for _, run in runs))
        figure = view.over_time(runs, result.study.machine, "", stretch, height=740)
        chart(figure, "study over time", "The references' signals over time")
    if (part := fold("One reference against the trapezoid", "against", "compare")).open:
        with part:
            _numbers(result, made)
    _forces(runs)
    _take_away(result)
    with guarded():
        _further(scenario, machine, result, runs)
        said = f"{scenario.model_dump_json()} {machine_text(machine)}"
        if (depends := on_damping(said, scenario, machine)) is not None:
            st.caption(plain(depends))


def run_first() -> None:
    """The runs of the study that the page begins with, ahead of a visitor."""
    machine = default_hoist()
    results(desk.usual_desk(machine).scenario, machine)


# ---- what is run --------------------------------------------------------------------------------------------------


def results(scenario: Scenario, machine: Machine) -> StudyResult:
    """The scenario's runs. InputError for what cannot be run."""
    return _run(plan_study(scenario, machine))


def _said(study: Study) -> tuple[str, ...]:
    return study.scenario_hash, study.machine_hash, *columns()


# Resources rather than data: the records are frozen, so that nobody need have a copy.
@st.cache_resource(max_entries=KEPT, show_spinner="Simulating", hash_funcs={Study: _said})
def _run(study: Study) -> StudyResult:
    return run_study(study)


@st.cache_resource(max_entries=200, show_spinner=False)
def on_damping(said: str, _scenario: Scenario, _machine: Machine) -> str | None:
    """How far the answer depends on the damping assumed for wire or coupling; None where its runs fail. said: both as
    text."""
    return damping_sentence(_scenario, _machine)


def _ran(asked: desk.Desk, machine: Machine, bad: Sequence[InputError]) -> Good:
    """The study that is asked for, told to the address; where it cannot be run, the error under its control's name,
    and the last one of this kind of machine that was."""
    key = f"{GOOD} {asked.kind}"
    try:
        if bad:
            raise bad[0]
        good = (asked.scenario, machine, results(asked.scenario, machine))
    except InputError as error:
        problem(desk.named(error, machine, asked))
        last: Good | tuple[()] = session.get(key, tuple, ())
        if not last:
            st.stop()
        st.caption("Shown below: the last settings that could be run.")
        return last
    session.put(key, good)
    address = desk.in_address(asked.scenario, machine)
    if address is None:
        st.query_params.pop(desk.ADDRESS_KEY, None)
    elif address != st.query_params.get(desk.ADDRESS_KEY):
        st.query_params[desk.ADDRESS_KEY] = address
    return good


# ---- what it answers ----------------------------------------------------------------------------------------------


def _head(scenario: Scenario, machine: Machine, result: StudyResult) -> None:
    """The study's name, the button that keeps it for Compare, its files to save."""
    known = any((study.scenario, study.machine) == (scenario, machine) for study in compare.kept().values())
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        st.markdown(f"##### {plain(scenario.name)} · {plain(result.study.machine.name)}", width="content")
        with st.container(horizontal=True, width="content"):
            said, icon = ("Kept", "check") if known else ("Keep for Compare", "compare_arrows")
            if st.button(said, disabled=known, key="study keep", icon=f":material/{icon}:"):
                compare.keep(scenario.name, scenario, machine, result)
                st.rerun()
            files = desk.files_of(scenario, machine)
            widgets.downloads("study", [(what, text, name, "application/yaml") for what, name, text in files])


def _decision(result: StudyResult, made: Sequence[Decision]) -> None:
    """What an engineer chooses by: the verdict, a row a reference, and how much of what is borne each uses. This is the
    one place where the page says which reference to take."""
    if taken := " ".join([*take_sentences(made), *beyond_its_limits(result.study)]):
        st.info(plain(powers(taken)), icon=":material/gavel:")
    if (alarmed := alarm(utilisation(result.rows, result.study.machine))) is not None:
        st.error(plain(powers(alarmed)), icon=":material/warning:")
    if failed := [row for row in result.rows if not row.ok]:
        first, load = failed[0], f"{failed[0].payload_kg:g} kg, " if metrics_of(failed).payload else ""
        said = f"{len(failed)} of {len(result.rows)} runs failed. {load}{label(first.reference)}: {first.reason}."
        st.warning(plain(said), icon=":material/warning:")
    shown = view.decision_table(made[-1])
    if shown is not None:
        table(replace(shown, note=""), in_words=True)
    _lights(result, made, shown.note if shown is not None else "")


def _lights(result: StudyResult, made: Sequence[Decision], note: str) -> None:
    """A row a reference, a column a bound: the share that is used, with a sign, a colour and a word; folded up under
    the largest. note: what the columns of the table above are."""
    good, machine = [row for row in result.rows if row.ok], result.study.machine
    kinds = list(dict.fromkeys(row.reference for row in good))
    uses = {kind: utilisation([row for row in good if row.reference == kind], machine) for kind in kinds}
    every = [use for used in uses.values() for use in used]
    if not every:
        return
    most, bounds = max(every, key=lambda use: use.percent), {use.what: use.bound for use in every}
    head = f"{SIGN[most.light]} Used of what machine and drive bear: at most {most.used} {most.bound} ({most.where})"
    if not (part := fold(plain(head), "lights")).open:
        return
    with part:
        lines = [["used of what is borne", *bounds], ["---"] * (len(bounds) + 1)]
        for kind, used in uses.items():
            said = {use.what: f":{COLOURS[use.light]}[{SIGN[use.light]}] {use.percent:.0f} % {use.light}"
                    for use in used}  # fmt: skip
            lines.append([label(kind), *(said.get(what, "–") for what in bounds)])
        st.markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))  # st.table would import pandas
        st.caption(plain("Per cent of: " + "; ".join(f"{what}, {bound}" for what, bound in bounds.items()) + "."))
        st.caption(plain(powers(note)))
        table(view.criteria_table(made[-1]), in_words=True)


def _numbers(result: StudyResult, made: Sequence[Decision]) -> None:
    """The worst of the payloads, of one reference against the trapezoid; then in words."""
    good, judged = [row for row in result.rows if row.ok], metrics_of(result.rows)
    kinds = [kind for kind in dict.fromkeys(row.reference for row in result.rows) if kind != BASELINE]
    kind = BASELINE
    if kinds:
        taken = [decision.taken.reference for decision in made if decision.taken is not None]
        first = next((kind for kind in reversed(taken) if kind in kinds), kinds[0])
        key = held("study against", first, kinds)
        kind = st.segmented_control("Reference", kinds, key=key, format_func=label, required=True) or first
    # Only payloads at which both have run: the worst of different loads does not compare.
    mine, base = ({row.payload_kg: row for row in good if row.reference == who} for who in (kind, BASELINE))
    common = mine.keys() & base.keys()
    cards = []
    for metric in shown_in(View.CARDS, judged):
        values = [[rows[kg].metrics.get(metric.name) for kg in sorted(common or rows)] for rows in (mine, base)]
        if not values[0] or None in [*values[0], *values[1]]:
            continue
        now, *before = (metric.scale * metric.worst(cast(list[float], each)) for each in values if each)
        delta = now - before[0] if common and kind != BASELINE else None
        better: Any = "higher" if metric.better == "higher" else "lower"
        cards.append(Number(metric.heading, now, metric.shown_unit, delta, better))
    if cards:
        widgets.numbers(cards)
    of = f"{label(kind)}{'; the worst of the payloads' * bool(judged.payload)}"
    said = f"**{of[0].upper()}{of[1:]}**{'; below it the difference to the trapezoid.' if kinds else '.'}"
    st.caption(f"{said} {plain(powers(' '.join(sentences(good, peak_limit(result.study.machine)))))}")


# ---- what it looks like -------------------------------------------------------------------------------------------


def _window(result: StudyResult, end_s: float) -> tuple[float, float] | None:
    """The stretch of time that is drawn, which stays while sliders move; None for all of it."""
    with st.container(horizontal=True, vertical_alignment="center"):  # they wrap where the page is narrow
        stretch = st.segmented_control(
            "Stretch of time", (WHOLE, RAMP, OWN), key=held("study stretch", WHOLE), label_visibility="collapsed",
            required=True,
        )  # fmt: skip
        if stretch == WHOLE:
            return None
        usual = view.start_of_move(result)
        if stretch == RAMP:
            return usual
        start, end = (
            st.number_input(words_, 0.0, None, value, 0.5, key=f"study {words_}", format="%.4g", width=160,
                            persist_state="session", label_visibility="collapsed", icon=f":material/{icon}_page:")
            for words_, value, icon in (("from (s)", usual[0], "first"), ("to (s)", usual[1], "last"))
        )  # fmt: skip
    if not start < min(end, end_s):
        problem(InputError(f"{start:g} to {end:g} s, expected a stretch of the run's {end_s:.4g} s", place="from … to"))
        return None
    return float(start), float(end)


def _further(scenario: Scenario, machine: Machine, result: StudyResult, runs: Sequence[tuple[str, Run]]) -> None:
    """A tab for each further figure; only the one that is open is simulated and drawn."""
    hoist = bool(kind_of(machine).payload)
    titles = [*([PLANE, PEAKS] if hoist and runs else []), LIMITS]
    if not (part := fold(", ".join(titles), "further", "insights")).open:
        return
    with part:
        tabs = widgets.tabs(titles, FIGURE)
    for title, tab in tabs:
        with tab:
            if title == PLANE:
                figure = view.plane(runs, result.study.machine, 460)
                chart(figure, "study plane", "Torque over speed of one motor with continuous and peak envelope")
            elif title == PEAKS:
                most = max(9000.0, *(scenario.payloads_kg or (0.0,)))
                payloads = [most * k / (POINTS - 1) for k in range(POINTS)]
                lumped = over_payload(changed(scenario, LUMPED), cast(Hoist, machine), payloads)
                figure = view.peaks_figure(_run(lumped))
                chart(figure, "study payload", "Torque peak over payload for each reference")
            else:
                _ramps(scenario, machine, result)


def _ramps(scenario: Scenario, machine: Machine, result: StudyResult) -> None:
    """The front of move time and peak over other accelerations and jerks, at the heaviest payload; the trapezoid has
    accelerations only."""
    given, made = scenario.limits.given(), list[Row]()
    accelerations, jerks = (
        [float(f"{given[name] * k:.3g}") for k in steps if given.get(name)]  # as a sentence can say it
        for name, steps in (("acceleration_m_s2", RAMPS), ("jerk_m_s3", JERKS))
    )
    for kind, others in (("trapezoid", jerks[3:4]), ("ruckig", jerks)):
        asked = changed(scenario, {"references": (kind,)} | LUMPED)
        made += _run(over_ramps(asked, machine, accelerations, others)).rows
    if not (rows := [row for row in made if row.ok]):
        return
    judged, axes, heaviest = metrics_of(rows), swept_axes(rows), max(row.payload_kg for row in result.rows)
    limits = scenario.limits.model_dump()
    own = {name: limits[name.rpartition(".")[2]] for axis in axes for name in axis.columns}
    # The ramps' runs are the lumped model's: a front would else lay two models side by side.
    here = result.rows if scenario.plant == "lumped" else []
    chosen = [replace(row, assigned=own) for row in here if row.ok and row.payload_kg == heaviest]
    figure = pareto(rows, fronts([*rows, *chosen]), axes, judged.peak, height=480, chosen=chosen)
    what = f"Move time against {judged.input_words} peak"
    figure.update_layout(title_text=f"{what}, {heaviest:g} kg" if judged.payload else what)
    chart(figure, "study pareto", f"{what} over accelerations and jerks")


def _forces(runs: Sequence[tuple[str, Run]]) -> None:
    """Of rollers and joints; nothing where the study ran on the lumped machine, which has none. The table: the largest
    force either way, a row a roller or joint, a column a reference."""
    lumped = {signal.name for signal in HOIST.plant.signals}
    names = [name for name in (runs[0][1].signals if runs else ()) if name.startswith("force_") and name not in lumped]
    if not names:
        return
    with st.expander("Forces of rollers and joints", expanded=True, icon=":material/conversion_path:"):
        payloads = sorted({run.payload_kg for _, run in runs})
        left, right = st.columns([1.0, 2.2])
        payload = left.selectbox(
            "Payload", payloads, len(payloads) - 1, format_func=lambda kg: f"{kg:g} kg", key="study forces payload"
        )
        chosen = right.multiselect(
            "Rollers and joints", names, [name for name in names if name.startswith("force_roller_")],
            key="study forces names", format_func=lambda name: words_of(name).removeprefix("force "),
        )  # fmt: skip
        mine = [(kind, run) for kind, run in runs if run.payload_kg == payload]
        if chosen:
            figure = browser([Stretch.whole(run) for _, run in mine], chosen, [kind for kind, _ in mine])
            chart(figure, "study forces", "Forces of rollers and joints over time")
        of_kind: dict[str, list[Run]] = {}
        for kind, run in runs:
            of_kind.setdefault(kind, []).append(run)
        rows = []
        for name in names:  # of the least and the largest the one that is further from zero
            ends = [[end for run in own for end in (run[name].min(), run[name].max())] for own in of_kind.values()]
            rows.append([words_of(name).removeprefix("force "), *(text(1e-3 * max(own, key=abs)) for own in ends)])
        heads = [words("roller or joint"), *(Column(label(kind), "kN") for kind in of_kind)]
        table(Table(heads, rows, "The largest of all payloads, with its sign; a pin's force has none."))


def _take_away(result: StudyResult) -> None:
    """The runs' signals and the report; each is written when it is asked for."""
    name = result.study.scenario.name
    # Taken here: Streamlit calls the function of a download in a thread that belongs to no session.
    folder = session.workspace()

    def report() -> bytes:
        with tempfile.TemporaryDirectory(dir=folder) as own:  # each click its own: two may come at once
            view.save_study_page(result, file := Path(own) / "study.html")
            return file.read_bytes()

    if not (part := fold("Signals and report", "signals", "download")).open:
        return
    with part, st.container(horizontal=True):
        files = widgets.signal_files(name, lambda: labelled_runs(result))
        widgets.downloads("study", [*files, ("Report", report, f"{name}.html", "text/html")])
