"""The batches of this session while they run: how far, how fast, stop, resume, open, remove."""

from __future__ import annotations

import time
from collections.abc import Sequence

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.jobs.job import Job, Progress, poll, remove, restart, stop
from workbench.dashboard.pages.batches.work import WRITING
from workbench.dashboard.widgets import plain, problem
from workbench.errors import InputError

OPEN = "batches open"
EVERY_S = 0.5
COLOURS = {"running": "blue", "stopping": "orange", "done": "green", "stopped": "gray", "failed": "red"}


def watch(jobs: Sequence[Job]) -> None:
    """A card a batch, drawn anew by itself as long as one of them runs."""
    running = any(not poll(job).ended for job in jobs)
    st.fragment(_cards, run_every=EVERY_S if running else None)(jobs, running)


def _cards(jobs: Sequence[Job], running: bool) -> None:
    states = [poll(job) for job in jobs]
    for job, progress in zip(jobs, states, strict=True):
        with st.container(border=True):
            _card(job, progress)
    if running and all(progress.ended for progress in states):
        st.rerun()  # the whole page: the results are there, and nothing is left to watch


def _card(job: Job, progress: Progress) -> None:
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        said = f"started {_when(job)}" + ("" if progress.state == "failed" else f" · {counts(progress)}")
        badge = f":{COLOURS[progress.state]}-badge[{progress.state}]"
        st.markdown(f"**{plain(job.title)}** {badge} :small[{plain(said)}]", width="content")
        with st.container(horizontal=True, width="content"):
            _buttons(job, progress)
    if not progress.ended or (progress.state == "stopped" and progress.total):
        st.progress(progress.share)
    if progress.state == "failed":
        problem(InputError(progress.sentence))


def _buttons(job: Job, progress: Progress) -> None:
    if not progress.ended:
        st.button("Stop", key=f"stop {job.id}", icon=":material/stop:", on_click=stop, args=(job,),
                  disabled=progress.state == "stopping", help="What is done is kept.")  # fmt: skip
    opened = st.session_state.get(OPEN) == job.id
    if progress.state == "done" and st.button(
        "Open", key=f"open {job.id}", icon=":material/bar_chart:", disabled=opened
    ):
        session.put(OPEN, job.id)
        st.rerun()
    if progress.state in ("stopped", "failed") and st.button(
        "Resume" if progress.done else "Try again", key=f"resume {job.id}", icon=":material/resume:"
    ):
        _try(restart, job)
    if progress.ended and st.button("Remove", key=f"remove {job.id}", icon=":material/delete:"):
        _try(remove, job)


def _when(job: Job) -> str:
    begun = time.localtime(job.begun_s)
    today = time.strftime("%j %Y", begun) == time.strftime("%j %Y")
    return time.strftime("%H:%M" if today else "%d %b %H:%M", begun)


def _try(action: object, job: Job) -> None:
    assert callable(action)
    try:
        action(job)
    except InputError as error:
        problem(error)
    else:
        st.rerun()


def counts(progress: Progress) -> str:
    """`1,024 of 1,280 runs, 3 failed, 410 runs/s, 2 s`."""
    if not progress.total:
        return progress.sentence if progress.sentence and not progress.ended else "getting ready"
    if progress.stage == WRITING:
        return "writing the report"
    parts = [f"{progress.done:,} of {progress.total:,} runs"]
    if progress.done == progress.total and progress.ended:
        parts = [f"{progress.total:,} runs"]
    if progress.failed:
        parts.append(f"{progress.failed:,} failed")
    if progress.rate_per_s and not progress.ended:
        parts.append(f"{progress.rate_per_s:,.0f} runs/s")
        parts.append(f"{(progress.total - progress.done) / progress.rate_per_s:,.0f} s to go")
    elif progress.running_s:
        parts.append(f"{progress.running_s:,.0f} s")
    return ", ".join(parts)
