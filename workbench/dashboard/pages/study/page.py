"""The page Study: what a jerk limit, another payload or another controller does to the move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from workbench.dashboard import controller, session
from workbench.dashboard.machines import session_machine
from workbench.dashboard.pages.compare.kept import is_kept, keep
from workbench.dashboard.pages.study.address import KEY, from_address, in_address
from workbench.dashboard.pages.study.controls import Desk, scenario_of
from workbench.dashboard.pages.study.forces import forces
from workbench.dashboard.pages.study.form import DESK, controls, named
from workbench.dashboard.pages.study.runs import beside_payloads, beside_ramps, on_damping, results, told
from workbench.dashboard.widgets import Better, Number, chart, guarded, numbers, plain, problem, table
from workbench.errors import InputError
from workbench.figures.pareto import pareto
from workbench.figures.study import overview, peak_torque_over_payload
from workbench.figures.study_page import save_study_page, start_of_move
from workbench.figures.study_plane import torque_speed_plane
from workbench.figures.style import label
from workbench.logs.signal_files import FORMS
from workbench.machine import Hoist
from workbench.metrics import Metric, View, shown_in
from workbench.references import BASELINE
from workbench.study.conclude.decide import decision_table, verdict
from workbench.study.conclude.pareto import fronts
from workbench.study.conclude.price import price_sentence
from workbench.study.conclude.sentences import sentences
from workbench.study.conclude.utilisation import SIGN, alarm, utilisation
from workbench.study.execute.run import StudyResult, motor_torque_limit_nm
from workbench.study.results.row import Row
from workbench.study.results.signals import labelled_runs
from workbench.study.scenario.record import Scenario
from workbench.study.scenario.standalone import standalone_text
from workbench.study.variations.varying import swept_axes

PEAK = "peak_torque_motor_nm"
MOST_CARDS = 4  # numbers side by side
GOOD = "study good"
WHOLE, RAMP, OWN = "whole run", "start of the first move", "from … to …"


def show() -> None:
    """Draws the page."""
    _from_link()
    bad: list[InputError] = []
    with st.sidebar:
        machine = session_machine("study machine")
        desk = controls(machine, bad)
    head, top = st.container(), st.container()
    with top:
        scenario, machine, result = _run(desk, machine, bad)
    with head:
        _head(scenario, machine, result)
    with top:
        sentence = st.empty()
        _decision(result, sentence)
        with st.expander("One reference against the trapezoid", icon=":material/compare:"):
            _numbers(result)
    _over_time(result)
    forces(result)
    _take_away(result)
    _plane(result)
    with guarded():
        _over_payload(beside_payloads(scenario, machine))
        said = _ramps(scenario, machine, result)
        # The ramps' runs are the lumped model's: a verdict over both would lay two models side by side.
        if scenario.plant == "lumped" and (better := verdict(result.rows, said)) is not None:
            _say(sentence, better, result.rows)
        if (hangs := on_damping(scenario, machine)) is not None:
            st.caption(plain(hangs))


def _from_link() -> None:
    """A session that has set nothing yet begins as its address says."""
    text = st.query_params.get(KEY)
    if not text or DESK in st.session_state:
        return
    try:
        session.put(DESK, from_address(text))
    except InputError as error:
        problem(error)


def _run(desk: Desk, machine: Hoist, bad: Sequence[InputError]) -> tuple[Scenario, Hoist, StudyResult]:
    """The study that is asked for; where it cannot be run, the error under its control's name and the last that was."""
    try:
        if bad:
            raise bad[0]
        scenario = scenario_of(desk, machine)
        with told():
            good = (scenario, machine, results(scenario, machine))
    except InputError as error:
        problem(named(error))
        last = session.get(GOOD, tuple, ())
        if not last:
            st.stop()
        st.caption("Shown below: the last settings that could be run.")
        scenario, machine, result = last
        return scenario, machine, result
    session.put(GOOD, good)
    controller.said("study", scenario.controller)
    text = in_address(scenario, machine)
    if text != st.query_params.get(KEY):
        if text is None:
            st.query_params.pop(KEY, None)
        else:
            st.query_params[KEY] = text
    return good


def _decision(result: StudyResult, sentence: DeltaGenerator) -> None:
    """What an engineer chooses by: the verdict, a row a reference, and how much of what is borne is used."""
    said = verdict(result.rows)
    if said is not None:
        _say(sentence, said, result.rows)
    uses = utilisation(result.rows, result.study.machine)
    if (alarmed := alarm(uses)) is not None:
        st.error(plain(alarmed), icon=":material/warning:")
    _failures(result.rows)
    if (shown := decision_table(result.rows)) is not None:
        table(replace(shown, rows=[[label(name), *cells] for name, *cells in shown.rows]))
    for column, use in zip(st.columns(max(len(uses), 1)), uses, strict=False):
        colour = {"green": "green", "amber": "orange", "red": "red"}[use.light]
        column.markdown(
            f":{colour}[{SIGN[use.light]}] {use.what}  \n**{use.percent:.0f} %**",
            help=plain(f"{use.percent:.0f} % of {use.bound}; {use.where}"),
        )


def _failures(rows: Sequence[Row]) -> None:
    """Which runs failed and why; the table and the verdict are of the payloads that every reference has run."""
    failed = [row for row in rows if not row.ok]
    if not failed:
        return
    said = f"{len(failed)} of {len(rows)} runs failed. "
    said += f"{failed[0].payload_kg:g} kg, {label(failed[0].reference)}: {failed[0].reason}."
    weighed = {row.reference for row in rows if row.ok}  # one that has run nowhere is in neither
    without = {row.payload_kg for row in failed if row.reference in weighed}
    rest = sorted({row.payload_kg for row in rows} - without)
    if rest and without:
        left_out, kept = (", ".join(f"{kg:g}" for kg in each) for each in (sorted(without), rest))
        said += f" Table and verdict are of {kept} kg and leave out {left_out} kg; the lights are of all runs."
    st.warning(plain(said), icon=":material/warning:")


def _say(place: DeltaGenerator, sentence: str, rows: Sequence[Row]) -> None:
    place.info(plain(" ".join([sentence, price_sentence(rows) or ""]).strip()), icon=":material/gavel:")


def _head(scenario: Scenario, machine: Hoist, result: StudyResult) -> None:
    title, keeping, saving = st.columns([5, 1.5, 1.5], vertical_alignment="center")
    title.markdown(f"##### {plain(scenario.name)} · {plain(result.study.machine.name)}")
    known = is_kept(scenario, machine)
    if keeping.button(
        "Kept" if known else "Keep for Compare", disabled=known, width="stretch", key="study keep",
        icon=":material/check:" if known else ":material/compare_arrows:",
    ):  # fmt: skip
        keep(scenario.name, scenario, machine, result)
        st.rerun()
    saving.download_button(
        "Save scenario", standalone_text(scenario, machine), file_name=f"{scenario.name}.yaml", mime="application/yaml",
        icon=":material/download:", on_click="ignore", width="stretch", key="study save",
    )  # fmt: skip


def _numbers(result: StudyResult) -> None:
    """The worst of the payloads, of the first reference beside the trapezoid, against the trapezoid; then in words."""
    rows = result.rows
    kinds = [kind for kind in dict.fromkeys(row.reference for row in rows) if kind != BASELINE]
    kind = kinds[0] if kinds else BASELINE
    # Only payloads at which both have run: the worst of different loads does not compare.
    both = {who: {row.payload_kg for row in rows if row.ok and row.reference == who} for who in (kind, BASELINE)}
    common = both[kind] & both[BASELINE]
    fair = [row for row in rows if row.payload_kg in (common or both[kind])]
    metrics = [m for m in shown_in(View.CARDS) if all(row.metrics.get(m.name) is not None for row in fair if row.ok)]
    cards = []
    for metric in metrics:
        mine, base = (_worst([row for row in fair if row.reference == who], metric) for who in (kind, BASELINE))
        delta = None if kind == BASELINE or not common else metric.scale * (mine - base)
        better: Better = "higher" if metric.better == "higher" else "lower"
        said = f"{label(kind)}; the worst of the payloads"
        cards.append(Number(metric.heading, metric.scale * mine, metric.shown_unit, delta, better, help=said))
    for start in range(0, len(cards), MOST_CARDS):
        numbers(cards[start : start + MOST_CARDS])
    good = [row for row in rows if row.ok]
    said_first = f"**{label(kind).capitalize()}**, the worst of the payloads"
    said_first += "; below it the difference to the trapezoid." if kinds else "."
    st.caption(f"{said_first} {plain(' '.join(sentences(good, motor_torque_limit_nm(result.study.machine))))}")


def _worst(rows: Sequence[Row], metric: Metric) -> float:
    values = [row[metric.name] for row in rows if row.ok]
    return float(metric.worst(values)) if values else float("nan")


def _good(result: StudyResult) -> list[tuple[str, Row]]:
    return [(row.reference, row) for row in result.rows if row.ok]


def _over_time(result: StudyResult) -> None:
    machine = result.study.machine
    runs = [(kind, result.runs[row.run_id]) for kind, row in _good(result)]
    if runs:
        limit = motor_torque_limit_nm(machine)
        window = _window(result, max(float(run.time_s[-1]) for _, run in runs))
        figure = overview(runs, machine.motor.nominal_torque_nm, limit, "", window, height=740)
        chart(figure, "study over time", "Speed, tracking error, torque and wire tension over time")


def _window(result: StudyResult, end_s: float) -> tuple[float, float] | None:
    """The stretch of time that is drawn, which stays while sliders move; None for all of it."""
    choice, first, last = st.columns([2.6, 1.0, 1.0], vertical_alignment="center")
    stretch = choice.segmented_control(
        "Stretch of time", (WHOLE, RAMP, OWN), default=WHOLE, key="study stretch", label_visibility="collapsed",
        required=True, persist_state="session",
    )  # fmt: skip
    if stretch == RAMP:
        return start_of_move(result)
    if stretch != OWN:
        return None
    usual = start_of_move(result)
    start, end = (
        column.number_input(
            words, 0.0, None, value, 0.5, key=f"study {words}", format="%.4g", persist_state="session",
            label_visibility="collapsed", icon=icon,
        )
        for column, words, value, icon in (
            (first, "from (s)", usual[0], ":material/first_page:"), (last, "to (s)", usual[1], ":material/last_page:")
        )
    )  # fmt: skip
    if not start < min(end, end_s):
        problem(InputError(f"{start:g} to {end:g} s, expected a stretch of the run's {end_s:.4g} s", place="from … to"))
        return None
    return float(start), float(end)


def _take_away(result: StudyResult) -> None:
    """The runs' signals and the report; each is written when it is asked for."""
    name = result.study.scenario.name
    with st.expander("Signals and report", icon=":material/download:"), st.container(horizontal=True):
        for ending, (write, kind) in FORMS.items():
            st.download_button(
                f"Signals ({ending})", lambda write=write: write(labelled_runs(result)), f"{name}.{ending}", kind,  # type: ignore[misc]
                key=f"study signals {ending}", on_click="ignore",
            )  # fmt: skip
        st.download_button(
            "Report", lambda: _report(result), f"{name}.html", "text/html", key="study report", on_click="ignore"
        )


def _report(result: StudyResult) -> bytes:
    file = session.file_in_workspace("study.html")
    save_study_page(result, file)
    return file.read_bytes()


def _plane(result: StudyResult) -> None:
    machine = result.study.machine
    runs = [(kind, result.runs[row.run_id]) for kind, row in _good(result)]
    if runs:
        motor, limit = machine.motor, motor_torque_limit_nm(machine)
        figure = torque_speed_plane(
            runs, motor.nominal_torque_nm, limit, motor.nominal_speed_rad_s, machine.drive.field_weakening, height=460
        )
        chart(figure, "study plane", "Torque over speed of one motor with continuous and peak envelope")


def _over_payload(result: StudyResult) -> None:
    machine = result.study.machine
    good = [row for row in result.rows if row.ok]
    payloads = np.array(sorted({row.payload_kg for row in good}))
    if len(payloads) < 2:
        return
    peak = {(row.reference, row.payload_kg): row[PEAK] for row in good}
    held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in good}
    peaks = {
        kind: np.array([peak.get((kind, payload), np.nan) for payload in payloads])
        for kind in result.study.scenario.kinds
    }
    figure = peak_torque_over_payload(
        payloads, peaks, machine.motor.nominal_torque_nm, motor_torque_limit_nm(machine),
        np.array([held[payload] for payload in payloads]), height=400,
    )  # fmt: skip
    chart(figure, "study payload", "Torque peak over payload for each reference")


def _ramps(scenario: Scenario, machine: Hoist, result: StudyResult) -> Sequence[Row]:
    """The front of move time and peak over other limits; the runs that it is of."""
    rows = [row for row in beside_ramps(scenario, machine) if row.ok]
    if not rows:
        return []
    heaviest = max(row.payload_kg for row in result.rows)
    chosen = [row for row in result.rows if row.ok and row.payload_kg == heaviest]
    axes = swept_axes(rows)
    figure = pareto(rows, fronts(rows), axes, PEAK, height=480, chosen=chosen)
    figure.update_layout(title_text=f"Move time against torque peak, {heaviest:g} kg")
    chart(figure, "study pareto", "Move time against torque peak over accelerations and jerks")
    return rows
