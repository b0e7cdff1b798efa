"""The page Machine: the machine as a drawing that moves with a run, or with two beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.dashboard.chosen import hoist_of_session, last_campaign
from workbench.dashboard.desk import current
from workbench.dashboard.pages.compare import kept
from workbench.dashboard.pages.study import results
from workbench.dashboard.widgets import guarded, held, is_dark, plain
from workbench.machines import STUDIED, Hoist, of_kind, studied
from workbench.references import planned_kinds
from workbench.study.load import changed
from workbench.view.film import HEIGHT, film, scene_of
from workbench.view.style import label

LARGE = 900
ALONE = "no other"
QUICK, STUDY, MEASURED = "the move of Study", "a run kept from Study", "a run of the campaign"


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        shown = _chosen()
        large = st.toggle("Large", key=held("machine large", False), help="For a large screen or a projector.")
    machine, runs = shown
    with guarded():
        scenes = [replace(scene_of(machine, run), name=name) for name, run in runs.items()]
    height = LARGE if large else HEIGHT
    st.markdown(f"#### {plain(machine.name)} · {plain(' beside '.join(runs))}")
    st.iframe(film(machine, scenes, is_dark(), height), height=height + 8)
    st.caption(
        "Heights are to scale; drum, sheave, arm and pipe are drawn larger and turn as the drawn wire runs. "
        f"Wire coloured by tension at the top of each fall, dashed while slack. Tension: {scenes[0].tension_of}; "
        f"height: {scenes[0].height_of}. Up and hoisting are positive; torque of the harder-worked motor at its shaft."
    )


def _chosen() -> tuple[Hoist, dict[str, Run]]:
    """The side bar's choice: a machine and one run of it, or two beside each other, by what the page calls them.
    InputError for what cannot be shown."""
    campaign = last_campaign()
    studies = {name: study for name, study in kept().items() if studied(study.machine) is not None}
    there = [QUICK, *([STUDY] if studies else []), *([MEASURED] if campaign is not None else [])]
    what = st.radio("Run", there, key=held("machine source", QUICK, there))
    if what == QUICK:
        return _quick()
    if what == MEASURED and campaign is not None:
        machine = studied(campaign.machine)
        if machine is None:
            said = f"is {of_kind(campaign.machine)}; this drawing is of {STUDIED}"
            raise InputError(said, file="machine.yaml", place="kind")
        name = st.selectbox("Run of the campaign", [run.name for run in campaign.runs], key="machine measured")
        return machine, {f"{campaign.name}, {name}": campaign.run(name)}
    study = st.selectbox("Study", list(studies), key="machine study")
    result = studies[study].result
    names = {f"{row.reference}, {row.payload_kg:g} kg": row.run_id for row in result.rows if row.run_id in result.runs}
    if not names:
        raise InputError("no run of it has come to its end; there is nothing to show", place=study)
    # Several runs may be alike in payload and reference, where a sweep varied something else.
    if len(names) < len(result.runs):
        names = {run_id: run_id for run_id in result.runs}
    both = _one_or_two("Run of the study", list(names), "machine study run", "machine study beside")
    return result.study.machine, {f"{study}, {run}": result.runs[names[run]] for run in both}


def _one_or_two(words: str, names: Sequence[str], key: str, beside: str) -> list[str]:
    """One of the names, and another that is seen beside it."""
    name = st.selectbox(words, names, key=held(key, names[0], names), format_func=label)
    others = [ALONE, *(other for other in names if other != name)]
    other = st.selectbox("Beside it", others, key=held(beside, ALONE, others), format_func=label)
    return [name] if other == ALONE else [name, other]


def _quick() -> tuple[Hoist, dict[str, Run]]:
    """The move that Study asks for, at one payload, under one reference or two. InputError where it fails."""
    machine = hoist_of_session("machine machine")
    payload = st.slider("Payload (kg)", 0, 12000, step=250, key=held("machine payload", 4500))
    both = _one_or_two("Reference", list(planned_kinds()), "machine reference", "machine beside")
    asked = {"payloads_kg": (float(payload),), "references": tuple(both), "plant": "lumped"}
    result = results(changed(current(machine).scenario, asked), machine)
    rows = {row.reference: row for row in result.rows}
    if failed := [row for row in rows.values() if not row.ok]:
        raise InputError(f"{failed[0].reason}; try a lighter one", place="payload")
    return machine, {f"{label(kind)}, {payload:g} kg": result.runs[rows[kind].run_id] for kind in both}
