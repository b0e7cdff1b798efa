"""The page Gap: a campaign's diagnosis, which runs in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.campaigns import last_name, offered, prefer, uploaded
from workbench.dashboard.jobs.job import Job, jobs_of, poll
from workbench.dashboard.jobs.place import jobs_workspace
from workbench.dashboard.pages.gap.choose import KIND, Asked, asked, begin
from workbench.dashboard.pages.gap.results import show_results
from workbench.dashboard.pages.gap.watch import watch
from workbench.dashboard.widgets import plain, problem, table
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.tables import Column, Table, words

OPEN, OF = "gap open", "gap open of"
SHOWN = "gap shown"


def show() -> None:
    """Draws the page."""
    jobs = _jobs()
    if jobs and jobs[0].title in offered() | uploaded():  # after a reload
        prefer(jobs[0].title)
    question: Asked | None = None
    bad: InputError | None = None
    with st.sidebar:
        try:
            question = asked()
        except InputError as error:
            bad = error
        wanted = st.button("Diagnose", key="gap start", type="primary", icon=":material/play_arrow:",
                           width="stretch", disabled=question is None)  # fmt: skip
    if bad is not None:
        problem(bad)
        return
    if wanted and question is not None:
        try:
            job = begin(question)
        except InputError as error:
            problem(error)
        else:
            _open(job.id)
            jobs = _jobs()
    opened = _opened(jobs)
    with st.sidebar:
        opened = _choice(jobs, opened)
    if opened is None:
        if question is not None:
            _before(question)
        return
    if poll(opened).state != "done":
        watch(opened)
        return
    try:
        show_results(opened)
    except InputError as error:
        problem(error)


def _jobs() -> list[Job]:
    workspace = jobs_workspace()
    return [] if workspace is None else jobs_of(workspace, KIND)


def _open(number: str | None) -> None:
    session.put(OPEN, number)
    session.put(OF, last_name())


def _opened(jobs: Sequence[Job]) -> Job | None:
    """The one that was opened last; the newest after a reload, and the campaign's newest once another is chosen."""
    if OF not in st.session_state:
        _open(jobs[0].id if jobs else None)
    elif st.session_state[OF] != last_name():
        _open(next((job.id for job in jobs if job.title == last_name()), None))
    return next((job for job in jobs if job.id == st.session_state[OPEN]), None)


def _choice(jobs: Sequence[Job], opened: Job | None) -> Job | None:
    """A list of the diagnoses of this session, where there are several."""
    if not jobs or (len(jobs) == 1 and opened is not None):
        return opened
    known = {job.id: f"{job.title}, {time.strftime('%H:%M', time.localtime(job.begun_s))}" for job in jobs}
    st.session_state[SHOWN] = None if opened is None else opened.id
    number = st.selectbox(
        "Diagnoses", list(known), key=SHOWN, index=None, placeholder="choose one", on_change=_chosen,
        format_func=lambda number: known[number],
    )  # fmt: skip
    return next((job for job in jobs if job.id == number), None)


def _chosen() -> None:
    _open(st.session_state[SHOWN])


def _before(question: Asked) -> None:
    """What there is to be diagnosed."""
    campaign = question.campaign
    st.markdown(f"##### Campaign {plain(campaign.name)} · {plain(campaign.machine.name)}")
    st.info(
        "**Diagnose** compares these runs with the machine's model: where they part, which effect the model lacks, "
        "how sure that is, and how far the gap shrinks. It takes about a minute, in a process of its own.",
        icon=":material/troubleshoot:",
    )
    payload = kind_of(campaign.machine).payload
    columns = [words("run"), *([Column("payload", "kg")] if payload else []), Column("length", "s"), Column("samples")]
    rows = [
        [run.name, *([f"{run.payload_kg:g}"] if payload else []), f"{run.duration_s:.1f}", str(len(run.time_s))]
        for run in campaign.runs
    ]
    table(Table(columns, rows))
    if campaign.all_notes:
        with st.expander(f"What the reader says of the logs ({len(campaign.all_notes)})"):
            st.markdown("\n".join(f"- {plain(note)}" for note in campaign.all_notes))
