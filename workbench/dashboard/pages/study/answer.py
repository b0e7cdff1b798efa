"""What a study answers, of any kind of machine: verdict, lights, table, numbers, files to take away."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from workbench.dashboard import session
from workbench.dashboard.widgets import Better, Number, numbers, plain, problem, table
from workbench.errors import InputError
from workbench.figures.study_page import save_study_page, start_of_move
from workbench.figures.style import label
from workbench.logs.signal_files import FORMS
from workbench.metrics import Metric, View, shown_in
from workbench.names import powers
from workbench.references import BASELINE
from workbench.study.decide import decision_table, verdict
from workbench.study.findings import SIGN, alarm, sentences, utilisation
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, labelled_runs, peak_limit

MOST_CARDS = 4  # numbers side by side
WHOLE, RAMP, OWN = "whole run", "start of the first move", "from … to …"


def decision(result: StudyResult, sentence: DeltaGenerator) -> None:
    """What an engineer chooses by: the verdict, a row a reference, and how much of what is borne is used."""
    said = verdict(result.rows, machine=result.study.machine, given=result.study.scenario.decide)
    if said is not None:
        say(sentence, said)
    uses = utilisation(result.rows, result.study.machine)
    if (alarmed := alarm(uses)) is not None:
        st.error(plain(powers(alarmed)), icon=":material/warning:")
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
    """Which runs failed and why; the table is of the payloads that every reference has run."""
    failed = [row for row in rows if not row.ok]
    if not failed:
        return
    said = f"{len(failed)} of {len(rows)} runs failed. "
    load = f"{failed[0].payload_kg:g} kg, " if metrics_of(rows).payload else ""
    said += f"{load}{label(failed[0].reference)}: {failed[0].reason}."
    without, rest = _left_out(rows)
    if rest and without:
        left_out, kept = (", ".join(f"{kg:g}" for kg in payloads) for payloads in (without, rest))
        said += f" The table is of {kept} kg and leaves out {left_out} kg; decision and lights are of all runs."
    st.warning(plain(said), icon=":material/warning:")


def _left_out(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Payloads (kg) that the table leaves out, for a reference failed there; the others."""
    weighed = {row.reference for row in rows if row.ok}  # one that has run nowhere is in neither
    without = {row.payload_kg for row in rows if not row.ok and row.reference in weighed}
    return sorted(without), sorted({row.payload_kg for row in rows} - without)


def say(place: DeltaGenerator, sentence: str) -> None:
    """The decision, a sentence for each payload whose choice is another one."""
    place.info(plain(powers(sentence)), icon=":material/gavel:")


def numbers_of(result: StudyResult) -> None:
    """The worst of the payloads, of the first reference beside the trapezoid, against the trapezoid; then in words."""
    rows = result.rows
    judged = metrics_of(rows)
    worst = "; the worst of the payloads" if judged.payload else ""
    kinds = [kind for kind in dict.fromkeys(row.reference for row in rows) if kind != BASELINE]
    kind = kinds[0] if kinds else BASELINE
    # Only payloads at which both have run: the worst of different loads does not compare.
    both = {who: {row.payload_kg for row in rows if row.ok and row.reference == who} for who in (kind, BASELINE)}
    common = both[kind] & both[BASELINE]
    fair = [row for row in rows if row.payload_kg in (common or both[kind])]
    metrics = [
        m for m in shown_in(View.CARDS, judged) if all(row.metrics.get(m.name) is not None for row in fair if row.ok)
    ]
    cards = []
    for metric in metrics:
        mine, base = (_worst([row for row in fair if row.reference == who], metric) for who in (kind, BASELINE))
        delta = None if kind == BASELINE or not common else metric.scale * (mine - base)
        better: Better = "higher" if metric.better == "higher" else "lower"
        said = f"{label(kind)}{worst}"
        cards.append(Number(metric.heading, metric.scale * mine, metric.shown_unit, delta, better, help=said))
    for start in range(0, len(cards), MOST_CARDS):
        numbers(cards[start : start + MOST_CARDS])
    good = [row for row in rows if row.ok]
    said_first = f"**{label(kind).capitalize()}**{worst.replace(';', ',')}"
    said_first += "; below it the difference to the trapezoid." if kinds else "."
    st.caption(f"{said_first} {plain(powers(' '.join(sentences(good, peak_limit(result.study.machine)))))}")


def _worst(rows: Sequence[Row], metric: Metric) -> float:
    values = [row[metric.name] for row in rows if row.ok]
    return float(metric.worst(values)) if values else float("nan")


def window(result: StudyResult, end_s: float) -> tuple[float, float] | None:
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


def take_away(result: StudyResult) -> None:
    """The runs' signals and the report; each is written when it is asked for."""
    name = result.study.scenario.name
    # Taken here: Streamlit calls the function of a download in a thread that belongs to no session.
    folder = session.workspace()
    with st.expander("Signals and report", icon=":material/download:"), st.container(horizontal=True):
        for ending, (write, kind) in FORMS.items():
            st.download_button(
                f"Signals ({ending})", lambda write=write: write(labelled_runs(result)), f"{name}.{ending}", kind,  # type: ignore[misc]
                key=f"study signals {ending}", on_click="ignore",
            )  # fmt: skip
        st.download_button(
            "Report", lambda: report_of(result, folder), f"{name}.html", "text/html", key="study report",
            on_click="ignore",
        )  # fmt: skip


def report_of(result: StudyResult, folder: Path) -> bytes:
    """The report's page. folder: a private one of the session."""
    with tempfile.TemporaryDirectory(dir=folder) as own:  # each click its own: two may come at once
        file = Path(own) / "study.html"
        save_study_page(result, file)
        return file.read_bytes()
