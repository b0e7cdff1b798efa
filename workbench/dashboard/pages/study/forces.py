"""Forces of rollers and joints in a study on the multi-body machine: the largest of each, and over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import streamlit as st

from workbench.dashboard.widgets import chart, table, text
from workbench.figures.signals import Stretch, browser
from workbench.figures.style import label
from workbench.names import words_of
from workbench.plants import HOIST
from workbench.run import Run
from workbench.study.run import StudyResult
from workbench.tables import Column, Table, words

FIRST = "force_roller_"  # what is drawn to begin with: rollers leave the rail where theirs turns over


def forces_of(run: Run) -> list[str]:
    """The forces that the multi-body machine alone has, in the run's order."""
    lumped = {signal.name for signal in HOIST.signals}
    return [name for name in run.signals if name.startswith("force_") and name not in lumped]


def force_table(runs: Sequence[tuple[str, Run]]) -> Table:
    """The largest force either way, a row a roller or joint, a column a reference. runs: (reference, run)."""
    by_reference = {kind: [run for other, run in runs if other == kind] for kind in dict.fromkeys(k for k, _ in runs)}
    names = list(dict.fromkeys(name for _, run in runs for name in forces_of(run)))
    rows = [
        [words_of(name).removeprefix("force "), *(_largest(own, name) for own in by_reference.values())]
        for name in names
    ]
    heads = [words("roller or joint"), *(Column(label(kind), "kN") for kind in by_reference)]
    return Table(heads, rows, "The largest of all payloads, with its sign; a pin's force has none.")


def _largest(runs: Sequence[Run], name: str) -> str:
    values = [float(run[name][int(np.argmax(np.abs(run[name])))]) for run in runs if name in run]
    return text(1e-3 * max(values, key=abs)) if values else "–"


def forces(result: StudyResult) -> None:
    """Nothing where the study ran on the lumped machine, which has no rollers."""
    runs = [(row.reference, result.runs[row.run_id]) for row in result.rows if row.ok and row.run_id in result.runs]
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
            "Rollers and joints", names, [name for name in names if name.startswith(FIRST)], key="study forces names",
            format_func=lambda name: words_of(name).removeprefix("force "),
        )  # fmt: skip
        mine = [(kind, run) for kind, run in runs if run.payload_kg == payload]
        if chosen:
            figure = browser([Stretch.whole(run) for _, run in mine], chosen, [kind for kind, _ in mine])
            chart(figure, "study forces", "Forces of rollers and joints over time")
        table(force_table(runs))
