"""The page for large studies: choose a scenario, run it in a process of its own, watch it, open what it came to."""

from __future__ import annotations

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.jobs.job import INPUTS, Call, jobs_of, poll, start
from workbench.dashboard.jobs.place import jobs_workspace, new_jobs_workspace
from workbench.dashboard.pages.batches.choose import Choice, chosen
from workbench.dashboard.pages.batches.results import show_results
from workbench.dashboard.pages.batches.watch import OPEN, watch
from workbench.dashboard.widgets import plain, problem
from workbench.errors import InputError
from workbench.figures.style import label

KIND = "batch"


def show() -> None:
    """The page."""
    with st.sidebar:
        try:
            _new()
        except InputError as error:  # the batches that run are shown all the same
            problem(error)
    workspace = jobs_workspace()
    jobs = [] if workspace is None else jobs_of(workspace, KIND)
    opened = next((job for job in jobs if job.id == st.session_state.get(OPEN)), None)
    if opened is None:  # after a reload: the newest that is done
        opened = next((job for job in jobs if poll(job).state == "done"), None)
        session.put(OPEN, opened.id if opened else None)
    if jobs:
        watch(jobs)
    else:
        st.info(
            "No batch yet. Choose a scenario and start it: it runs in a process of its own and goes on while you "
            "look at other pages."
        )
    if opened is not None:
        try:
            show_results(opened)
        except InputError as error:
            problem(error)


def _new() -> None:
    choice = chosen()
    if choice is None:
        st.info("Choose a scenario file.", icon=":material/upload:")
        return
    _describe(choice)
    if st.button("Start", key="batches start", type="primary", icon=":material/play_arrow:"):
        file = f"{INPUTS}/{choice.file.name}" if choice.file.name in choice.inputs else str(choice.file)
        what = Call("workbench.dashboard.pages.batches.work:run", {"scenario": file})
        job = start(KIND, what, new_jobs_workspace(), choice.study.scenario.name, choice.inputs)
        session.put(OPEN, job.id)
        st.rerun()


def _describe(choice: Choice) -> None:
    study = choice.study
    if study.scenario.description:
        st.markdown(plain(study.scenario.description))
    payloads = len({spec.payload_kg for spec in study.specs[:2000]})
    kinds = ", ".join(label(kind) for kind in study.scenario.kinds)
    st.markdown(
        f"**{len(study.specs):,} runs** of {study.duration_s:.0f} s each: {payloads} "
        f"payload{'s' if payloads != 1 else ''}, {plain(kinds)}, on {plain(study.machine.name)}."
    )
    with st.expander("The scenario's file"):
        st.code(choice.file.read_text(encoding="utf-8"), language="yaml")
