"""A diagnosis while it runs, and one that was stopped or failed: how far, cancel, try again, remove."""

from __future__ import annotations

from collections.abc import Callable

import streamlit as st

from workbench.dashboard.jobs.job import Job, Progress, poll, remove, restart, stop
from workbench.dashboard.widgets import plain, problem
from workbench.errors import InputError

EVERY_S = 0.5
# A diagnosis' stages, as they are counted.
STAGES = (
    "Read the logs", "Search the effects", "Weigh the verdict", "Find the place", "What can be told apart",
    "How far it shrinks", "What the study says", "Write the report",
)  # fmt: skip


def watch(job: Job) -> None:
    """A card, drawn anew by itself until the diagnosis ends."""
    st.fragment(_card, run_every=None if poll(job).ended else EVERY_S)(job, poll(job).ended)


def _card(job: Job, had_ended: bool) -> None:
    progress = poll(job)
    if progress.ended and not had_ended:
        st.rerun()  # the whole page: there is a result to show, or a reason
    with st.container(border=True):
        if progress.state == "failed":
            problem(InputError(progress.sentence))
        with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
            st.markdown(_said(job, progress), width="content")
            with st.container(horizontal=True, width="content"):
                _buttons(job, progress)
        if not progress.ended:
            st.progress(progress.share)
            _stages(progress)


def _stages(progress: Progress) -> None:
    """Those that are done, the one that is under way, those to come."""
    now = int(progress.share * len(STAGES))
    for column, half in zip(st.columns(2), (range(4), range(4, 8)), strict=True):
        lines = [
            f":green[:material/check_circle:] {STAGES[k]}" if k < now
            else f":blue[:material/pending: **{STAGES[k]}**]" if k == now
            else f":gray[:material/circle: {STAGES[k]}]"
            for k in half
        ]  # fmt: skip
        column.markdown("  \n".join(lines))


def _said(job: Job, progress: Progress) -> str:
    name = f"**{plain(job.title)}**"
    if progress.ended:
        return f"{name} :small[{'was cancelled' if progress.state == 'stopped' else 'could not be diagnosed'}]"
    stage = "stopping" if progress.state == "stopping" else progress.stage or "starting"
    return f"{name} · {progress.running_s:.0f} s · {plain(stage)}"


def _buttons(job: Job, progress: Progress) -> None:
    if not progress.ended:
        st.button("Cancel", key=f"gap cancel {job.id}", icon=":material/stop:", on_click=stop, args=(job,),
                  disabled=progress.state == "stopping")  # fmt: skip
        return
    if st.button("Try again", key=f"gap again {job.id}", icon=":material/replay:"):
        _try(restart, job)
    if st.button("Remove", key=f"gap remove {job.id}", icon=":material/delete:"):
        _try(remove, job)


def _try(action: Callable[[Job], None], job: Job) -> None:
    try:
        action(job)
    except InputError as error:
        problem(error)
    else:
        st.rerun()
