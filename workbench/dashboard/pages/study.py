"""The page Study: what a jerk limit, another payload or another controller does to the move of a hoist or an axis."""

from __future__ import annotations

import logging
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from workbench.core.errors import InputError
from workbench.core.names import powers, words_of
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.dashboard import desk, session, widgets
from workbench.dashboard.chosen import session_machine
from workbench.dashboard.pages import compare
from workbench.dashboard.widgets import Number, chart, guarded, held, plain, problem, table, text
from workbench.logs.signal_files import FORMS
from workbench.machines import HOIST, Axis, Hoist, default_hoist, kind_of
from workbench.machines.files import machine_text
from workbench.metrics import View, columns, shown_in
from workbench.references import BASELINE
from workbench.study.beside import damping_sentence, over_payload, over_ramps
from workbench.study.conclude import SIGN, alarm, sentences, utilisation
from workbench.study.decide import Decision, decisions, take_sentences
from workbench.study.front import fronts
from workbench.study.labels import swept_axes
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, labelled_runs, peak_limit, run_study
from workbench.study.scenario import Scenario
from workbench.view import study as view
from workbench.view.signals import Stretch, browser
from workbench.view.study_figures import pareto
from workbench.view.style import label

log = logging.getLogger(__name__)

GOOD = "study good"
WHOLE, RAMP, OWN = "whole run", "start of the first move", "from … to …"
RAMPS = (0.4, 0.55, 0.7, 0.85, 1.0, 1.25, 1.6)  # of the acceleration that is set
JERKS = (0.25, 0.4, 0.63, 1.0, 1.6, 2.5, 4.0)  # of the jerk that is set
POINTS = 5  # payloads of the curve over payload
KEPT = 20  # studies whose signals are kept, of all sessions together
STEP_S = 1.5e-4  # of compute, for a step of the multi-body model
LUMPED = {"plant": "lumped"}  # of the curves beside a study: dozens of runs
COLOURS = {"green": "green", "amber": "orange", "red": "red"}
Good = tuple[Scenario, Hoist | Axis, StudyResult]


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
        sentence = st.empty()
        _decision(result, sentence)
    runs = _runs(result)
    if runs:
        stretch = _window(result, max(float(run.time_s[-1]) for _, run in runs))
        figure = view.over_time(runs, result.study.machine, "", stretch, height=740)
        chart(figure, "study over time", "The references' signals over time")
    with st.expander("One reference against the trapezoid", icon=":material/compare:"):
        _numbers(result)
    _forces(runs)
    _take_away(result)
    with guarded():
        if kind_of(machine).payload and runs:
            figure = view.plane(runs, result.study.machine, 460)
            chart(figure, "study plane", "Torque over speed of one motor with continuous and peak envelope")
            figure = view.peaks_figure(beside_payloads(scenario, cast(Hoist, machine)))
            chart(figure, "study payload", "Torque peak over payload for each reference")
        _ramps(scenario, machine, result, sentence)
        if (depends := on_damping(scenario, machine)) is not None:
            st.caption(plain(depends))


def run_first() -> None:
    """The runs of the study that the page begins with, ahead of a visitor."""
    machine = default_hoist()
    for run in (results, beside_payloads, beside_ramps, on_damping):
        run(desk.usual_desk(machine).scenario, machine)


# ---- what is run --------------------------------------------------------------------------------------------------


def results(scenario: Scenario, machine: Hoist | Axis) -> StudyResult:
    """The scenario's runs. InputError for what cannot be run."""
    study = plan_study(scenario, machine)
    if scenario.plant == "multibody":
        steps = sum(spec.duration_s / min(spec.step_s, spec.controller.sample_time_s) for spec in study.specs)
        log.info("%d runs on the multi-body machine, some %.0f s", len(study.specs), max(1.0, STEP_S * steps))
    return _with_signals(*_values(study), study)


def beside_payloads(scenario: Scenario, machine: Hoist) -> StudyResult:
    """The same at payloads from none to the heaviest."""
    most = max(9000.0, *(scenario.payloads_kg or (0.0,)))
    study = over_payload(changed(scenario, LUMPED), machine, [most * k / (POINTS - 1) for k in range(POINTS)])
    return _run(*_values(study), study)


def beside_ramps(scenario: Scenario, machine: Hoist | Axis) -> Sequence[Row]:
    """Other accelerations and jerks at the heaviest payload; the trapezoid has accelerations only."""
    limits = scenario.limits.given()
    acceleration, jerk = (limits.get(name, 0.0) for name in ("acceleration_m_s2", "jerk_m_s3"))
    accelerations = [float(f"{acceleration * k:.3g}") for k in RAMPS if acceleration]  # as a sentence can say it
    jerks = [float(f"{jerk * k:.3g}") for k in JERKS if jerk]
    rows: list[Row] = []
    for kinds, other in ((("trapezoid",), jerks[3:4]), (("ruckig",), jerks)):
        study = over_ramps(changed(scenario, {"references": kinds} | LUMPED), machine, accelerations, other)
        rows += _run(*_values(study), study).rows
    return rows


def on_damping(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """How far the answer depends on the damping assumed for wire or coupling; None where its runs fail."""
    return _on_damping(scenario.model_dump_json(), machine_text(machine), scenario, machine)


@st.cache_resource(max_entries=200, show_spinner=False)
def _on_damping(said: str, machine: str, _scenario: Scenario, _machine: Hoist | Axis) -> str | None:
    return damping_sentence(_scenario, _machine)


def _values(study: Study) -> tuple[str, str]:
    """What the runs depend on: scenario with metrics, and machine."""
    return f"{study.scenario_hash} {' '.join(columns())}", study.machine_hash


# Resources rather than data: the records are frozen, so that nobody need have a copy. The runs of a study hold some
# 5 MB of signals, those beside it none.
@st.cache_resource(max_entries=KEPT, show_spinner=False)
def _with_signals(scenario: str, machine: str, _study: Study) -> StudyResult:
    return run_study(_study)


@st.cache_resource(max_entries=200, show_spinner=False)
def _run(scenario: str, machine: str, _study: Study) -> StudyResult:
    return run_study(_study)


@contextmanager
def _told() -> Iterator[None]:
    """While the block runs, what the library says (that it compiles, the first time) stands on the page."""
    place, thread = st.empty(), threading.get_ident()

    class Told(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if threading.get_ident() == thread:  # other sessions compile in their own threads
                place.info(record.getMessage(), icon=":material/hourglass_top:")

    library, teller = logging.getLogger("workbench"), Told(logging.INFO)
    if library.getEffectiveLevel() > logging.INFO:
        library.setLevel(logging.INFO)
    library.addHandler(teller)
    try:
        yield
    finally:
        library.removeHandler(teller)
        place.empty()


def _ran(asked: desk.Desk, machine: Hoist | Axis, bad: Sequence[InputError]) -> Good:
    """The study that is asked for, told to the address; where it cannot be run, the error under its control's name,
    and the last one of this kind of machine that was."""
    key = f"{GOOD} {asked.kind}"
    try:
        if bad:
            raise bad[0]
        with _told():
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


def _head(scenario: Scenario, machine: Hoist | Axis, result: StudyResult) -> None:
    """The study's name, the button that keeps it for Compare, its files to save."""
    known = compare.is_kept(scenario, machine)
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        st.markdown(f"##### {plain(scenario.name)} · {plain(result.study.machine.name)}", width="content")
        with st.container(horizontal=True, width="content"):
            if st.button(
                "Kept" if known else "Keep for Compare", disabled=known, key="study keep",
                icon=":material/check:" if known else ":material/compare_arrows:",
            ):  # fmt: skip
                compare.keep(scenario.name, scenario, machine, result)
                st.rerun()
            files = desk.files_of(scenario, machine)
            widgets.downloads("study", [(what, text, name, "application/yaml") for what, name, text in files])


def _decision(result: StudyResult, sentence: DeltaGenerator) -> None:
    """What an engineer chooses by: the verdict, a row a reference, and how much of what is borne each uses."""
    rows, machine = result.rows, result.study.machine
    _recommend(sentence, result)
    if (alarmed := alarm(utilisation(rows, machine))) is not None:
        st.error(plain(powers(alarmed)), icon=":material/warning:")
    _failures(rows)
    made = _weighed(result)[0]
    shown = view.decision_table(made[-1]) if made else None
    if shown is not None:
        table(replace(shown, note=""))
    _lights(result, shown.note if shown is not None else "")


def _weighed(result: StudyResult, beside: Sequence[Row] = ()) -> tuple[list[Decision], list[Row], list[str]]:
    """The decision at each payload, of the references that reach no bound of machine or drive; their rows, and the
    others' names. beside: runs under other limits."""
    kinds, machine = sorted({row.reference for row in result.rows}), result.study.machine
    uses = {kind: utilisation([row for row in result.rows if row.reference == kind], machine) for kind in kinds}
    alarmed = [kind for kind in kinds if alarm(uses[kind]) is not None]
    rows = [row for row in result.rows if row.reference not in alarmed]
    return decisions(rows, machine, result.study.scenario.decide, beside), rows, alarmed


def _recommend(place: DeltaGenerator, result: StudyResult, beside: Sequence[Row] = ()) -> None:
    """The sentences of `study`'s decision. This is the one place where the page says which reference to take."""
    made, rows, alarmed = _weighed(result, beside)
    if alarmed and len({row.reference for row in rows}) < 2:
        place.info("No recommendation: too few references stay below what machine and drive bear.",
                   icon=":material/gavel:")  # fmt: skip
        return
    said = " ".join(take_sentences(made))
    if not said:
        return
    without, rest = _left_out(rows)
    if without and rest:
        said = f"Of {', '.join(f'{kg:g}' for kg in rest)} kg only: {said[0].lower()}{said[1:]}"
    if alarmed:
        said += f" Left out, for they reach a bound: {', '.join(map(label, alarmed))}."
    place.info(plain(powers(said)), icon=":material/gavel:")


def _lights(result: StudyResult, note: str) -> None:
    """A row a reference, a column a bound: the share that is used, with a sign, a colour and a word; folded up under
    the largest. note: what the columns of the table above are."""
    uses, machine = utilisation(result.rows, result.study.machine), result.study.machine
    if not uses:
        return
    kinds = list(dict.fromkeys(row.reference for row in result.rows if row.ok))
    shown: dict[str, list[str]] = {"used of what is borne": [label(kind) for kind in kinds]}
    bounds: dict[str, str] = {}
    for k, kind in enumerate(kinds):
        for use in utilisation([row for row in result.rows if row.reference == kind], machine):
            bounds[use.what] = use.bound
            cells = shown.setdefault(use.what, ["–"] * len(kinds))
            cells[k] = f":{COLOURS[use.light]}[{SIGN[use.light]}] {plain(f'{use.percent:.0f} %')} {use.light}"
    most = max(uses, key=lambda use: use.percent)
    head = f"{SIGN[most.light]} Used of what machine and drive bear: at most {most.used} {most.bound} ({most.where})"
    with st.expander(plain(head)):
        rows = [list(shown), ["---"] * len(shown), *zip(*shown.values(), strict=True)]
        st.markdown("\n".join(f"| {' | '.join(row)} |" for row in rows))  # st.table would import pandas
        st.caption(plain("Per cent of: " + "; ".join(f"{what}, {bound}" for what, bound in bounds.items()) + "."))
        st.caption(plain(powers(note)))
        if made := _weighed(result)[0]:
            table(view.criteria_table(made[-1]))


def _failures(rows: Sequence[Row]) -> None:
    """Which runs failed and why; the table and the verdict are of the payloads that every reference has run."""
    failed = [row for row in rows if not row.ok]
    if not failed:
        return
    load = f"{failed[0].payload_kg:g} kg, " if metrics_of(rows).payload else ""
    said = f"{len(failed)} of {len(rows)} runs failed. {load}{label(failed[0].reference)}: {failed[0].reason}."
    without, rest = _left_out(rows)
    if rest and without:
        left_out, kept = (", ".join(f"{kg:g}" for kg in payloads) for payloads in (without, rest))
        said += f" Table and verdict are of {kept} kg and leave out {left_out} kg; the lights are of all runs."
    st.warning(plain(said), icon=":material/warning:")


def _left_out(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Payloads (kg) that table and verdict leave out, for a reference failed there; the others."""
    weighed = {row.reference for row in rows if row.ok}  # one that has run nowhere is in neither
    without = {row.payload_kg for row in rows if not row.ok and row.reference in weighed}
    return sorted(without), sorted({row.payload_kg for row in rows} - without)


def _numbers(result: StudyResult) -> None:
    """The worst of the payloads, of one reference against the trapezoid; then in words."""
    good, judged = [row for row in result.rows if row.ok], metrics_of(result.rows)
    kinds = [kind for kind in dict.fromkeys(row.reference for row in result.rows) if kind != BASELINE]
    kind = BASELINE
    if kinds:
        taken = [decision.taken.reference for decision in _weighed(result)[0] if decision.taken is not None]
        first = next((kind for kind in reversed(taken) if kind in kinds), kinds[0])
        kind = st.segmented_control(
            "Reference", kinds, key=held("study against", first, kinds), format_func=label, required=True
        ) or first  # fmt: skip
    # Only payloads at which both have run: the worst of different loads does not compare.
    both = {who: {row.payload_kg: row for row in good if row.reference == who} for who in (kind, BASELINE)}
    common = both[kind].keys() & both[BASELINE].keys()
    mine, base = ([rows[kg] for kg in sorted(common or both[kind].keys()) if kg in rows] for rows in both.values())
    of, cards = f"{label(kind)}{'; the worst of the payloads' * bool(judged.payload)}", list[Number]()
    for metric in shown_in(View.CARDS, judged):
        if not mine or any(row.metrics.get(metric.name) is None for row in [*mine, *base]):
            continue
        now, before = (metric.scale * metric.worst([row[metric.name] for row in rows]) if rows else float("nan")
                       for rows in (mine, base))  # fmt: skip
        delta = None if kind == BASELINE or not common else now - before
        better = "higher" if metric.better == "higher" else "lower"
        cards.append(Number(metric.heading, now, metric.shown_unit, delta, better, help=of))  # type: ignore[arg-type]
    if cards:
        widgets.numbers(cards)
    said = f"**{of[0].upper()}{of[1:]}**{'; below it the difference to the trapezoid.' if kinds else '.'}"
    st.caption(f"{said} {plain(powers(' '.join(sentences(good, peak_limit(result.study.machine)))))}")


# ---- what it looks like -------------------------------------------------------------------------------------------


def _runs(result: StudyResult) -> list[tuple[str, Run]]:
    """(reference, run) of those that came to their end."""
    return [(row.reference, result.runs[row.run_id]) for row in result.rows if row.ok and row.run_id in result.runs]


def _window(result: StudyResult, end_s: float) -> tuple[float, float] | None:
    """The stretch of time that is drawn, which stays while sliders move; None for all of it."""
    choice, first, last = st.columns([2.6, 1.0, 1.0], vertical_alignment="center")
    stretch = choice.segmented_control(
        "Stretch of time", (WHOLE, RAMP, OWN), key=held("study stretch", WHOLE), label_visibility="collapsed",
        required=True,
    )  # fmt: skip
    if stretch == WHOLE:
        return None
    usual = view.start_of_move(result)
    if stretch == RAMP:
        return usual
    start, end = (
        column.number_input(words_, 0.0, None, value, 0.5, key=f"study {words_}", format="%.4g",
                            persist_state="session", label_visibility="collapsed", icon=f":material/{icon}_page:")
        for column, words_, value, icon in ((first, "from (s)", usual[0], "first"), (last, "to (s)", usual[1], "last"))
    )  # fmt: skip
    if not start < min(end, end_s):
        problem(InputError(f"{start:g} to {end:g} s, expected a stretch of the run's {end_s:.4g} s", place="from … to"))
        return None
    return float(start), float(end)


def _ramps(scenario: Scenario, machine: Hoist | Axis, result: StudyResult, sentence: DeltaGenerator) -> None:
    """The front of move time and peak over other limits, and the verdict anew where one of its runs does better."""
    rows = [row for row in beside_ramps(scenario, machine) if row.ok]
    if not rows:
        return
    judged, axes, limits = metrics_of(rows), swept_axes(rows), scenario.limits.model_dump()
    heaviest = max(row.payload_kg for row in result.rows)
    own = {name: limits[name.rpartition(".")[2]] for axis in axes for name in axis.columns}
    chosen = [replace(r, assigned=own) for r in result.rows if r.ok and r.payload_kg == heaviest]
    # The ramps' runs are the lumped model's: front and verdict would else lay two models side by side.
    lumped = scenario.plant == "lumped"
    front = fronts([*rows, *chosen] if lumped else rows)
    figure = pareto(rows, front, axes, judged.peak, height=480, chosen=chosen)
    what = f"Move time against {judged.input_words} peak"
    figure.update_layout(title_text=f"{what}, {heaviest:g} kg" if judged.payload else what)
    chart(figure, "study pareto", f"{what} over accelerations and jerks")
    if lumped:
        _recommend(sentence, result, rows)


def forces_of(run: Run) -> list[str]:
    """The forces that the multi-body machine alone has, in the run's order."""
    lumped = {signal.name for signal in HOIST.plant.signals}
    return [name for name in run.signals if name.startswith("force_") and name not in lumped]


def force_table(runs: Sequence[tuple[str, Run]]) -> Table:
    """The largest force either way, a row a roller or joint, a column a reference. runs: (reference, run)."""

    def largest(kind: str, name: str) -> str:
        own = [run[name] for other, run in runs if other == kind and name in run]
        values = [float(force[int(np.argmax(np.abs(force)))]) for force in own]
        return text(1e-3 * max(values, key=abs)) if values else "–"

    kinds = dict.fromkeys(kind for kind, _ in runs)
    names = dict.fromkeys(name for _, run in runs for name in forces_of(run))
    rows = [[words_of(name).removeprefix("force "), *(largest(kind, name) for kind in kinds)] for name in names]
    heads = [words("roller or joint"), *(Column(label(kind), "kN") for kind in kinds)]
    return Table(heads, rows, "The largest of all payloads, with its sign; a pin's force has none.")


def _forces(runs: Sequence[tuple[str, Run]]) -> None:
    """Of rollers and joints; nothing where the study ran on the lumped machine, which has none."""
    runs = [(kind, run) for kind, run in runs if forces_of(run)]
    if not runs:
        return
    with st.expander("Forces of rollers and joints", expanded=True, icon=":material/conversion_path:"):
        names = forces_of(runs[0][1])
        left, right = st.columns([1.0, 2.2])
        payloads = sorted({run.payload_kg for _, run in runs})
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
        table(force_table(runs))


def _take_away(result: StudyResult) -> None:
    """The runs' signals and the report; each is written when it is asked for."""
    name = result.study.scenario.name
    # Taken here: Streamlit calls the function of a download in a thread that belongs to no session.
    folder = session.workspace()
    with st.expander("Signals and report", icon=":material/download:"), st.container(horizontal=True):
        signals = [
            (f"Signals ({ending})", lambda write=write: write(labelled_runs(result)), f"{name}.{ending}", kind)
            for ending, (write, kind) in FORMS.items()
        ]
        report = ("Report", partial(report_of, result, folder), f"{name}.html", "text/html")
        widgets.downloads("study", [*signals, report])


def report_of(result: StudyResult, folder: Path) -> bytes:
    """The report's page. folder: a private one of the session."""
    with tempfile.TemporaryDirectory(dir=folder) as own:  # each click its own: two may come at once
        file = Path(own) / "study.html"
        view.save_study_page(result, file)
        return file.read_bytes()
