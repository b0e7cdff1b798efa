"""Jobs on a page: a card each, drawn anew by itself while one runs: how far, stop, resume, open, remove."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import streamlit as st

from workbench.core.errors import InputError
from workbench.dashboard import session
from workbench.dashboard.jobs import Job, Progress, poll, remove, restart, stop
from workbench.dashboard.widgets import plain, problem

EVERY_S = 0.5
COLOURS = {"running": "blue", "stopping": "orange", "done": "green", "stopped": "gray", "failed": "red"}


def cards(jobs: Sequence[Job], open_key: str = "", unit: str = "", stages: Sequence[str] = ()) -> None:
    """open_key: where the session keeps the id of the job that is open; none can be opened where it is empty.

    unit: what is counted. stages: their names, where the worker counts an equal share for each.
    """
    running = any(not poll(job).ended for job in jobs)

    def draw() -> None:
        states = [poll(job) for job in jobs]
        for job, progress in zip(jobs, states, strict=True):
            with st.container(border=True):
                _card(job, progress, open_key, unit, stages)
        if running and all(progress.ended for progress in states):
            st.rerun()  # the whole page: there is a result to show, or a reason

    st.fragment(draw, run_every=EVERY_S if running else None)()


def _card(job: Job, progress: Progress, open_key: str, unit: str, stages: Sequence[str]) -> None:
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        said = f"started {_when(job)}" + ("" if progress.state == "failed" else f" · {counts(progress, unit)}")
        badge = f":{COLOURS[progress.state]}-badge[{progress.state}]"
        st.markdown(f"**{plain(job.title)}** {badge} :small[{plain(said)}]", width="content")
        with st.container(horizontal=True, width="content"):
            _buttons(job, progress, open_key)
    if not progress.ended or (progress.state == "stopped" and progress.total):
        st.progress(progress.share)
    if not progress.ended and stages:
        now, half = int(progress.share * len(stages)), (len(stages) + 1) // 2
        done, doing, to_come = ":green[:material/check_circle:] {}", ":blue[:material/pending: **{}**]", ":gray[{}]"
        lines = [(done if k < now else doing if k == now else to_come).format(stage) for k, stage in enumerate(stages)]
        for column, part in zip(st.columns(2), (lines[:half], lines[half:]), strict=True):
            column.markdown("  \n".join(part))
    if progress.state == "failed":
        problem(InputError(progress.sentence))


def _buttons(job: Job, progress: Progress, open_key: str) -> None:
    if not progress.ended:
        st.button("Stop", key=f"stop {job.id}", icon=":material/stop:", on_click=stop, args=(job,),
                  disabled=progress.state == "stopping", help="What is done is kept.")  # fmt: skip
    opened = bool(open_key) and st.session_state.get(open_key) == job.id
    if open_key and progress.state == "done" and st.button(
        "Open", key=f"open {job.id}", icon=":material/bar_chart:", disabled=opened
    ):  # fmt: skip
        session.put(open_key, job.id)
        st.rerun()
    if progress.state in ("stopped", "failed") and st.button(
        "Resume" if progress.done else "Try again", key=f"resume {job.id}", icon=":material/resume:"
    ):
        _try(restart, job)
    if progress.ended and st.button("Remove", key=f"remove {job.id}", icon=":material/delete:"):
        _try(remove, job)


def _try(action: Callable[[Job], None], job: Job) -> None:
    try:
        action(job)
    except InputError as error:
        problem(error)
    else:
        st.rerun()


def _when(job: Job) -> str:
    begun = time.localtime(job.begun_s)
    today = time.strftime("%j %Y", begun) == time.strftime("%j %Y")
    return time.strftime("%H:%M" if today else "%d %b %H:%M", begun)


def counts(progress: Progress, unit: str = "") -> str:
    """`1,024 of 1,280 runs, 3 failed, 410 runs/s, 2 s to go`; the stage where nothing is counted in a unit."""
    if not unit or progress.total <= 1:
        said = "getting ready" if not progress.stage else progress.stage
        said = progress.sentence if progress.sentence and not progress.ended and not progress.stage else said
        return f"{said}, {progress.running_s:,.0f} s" if progress.running_s and not progress.ended else said
    parts = [f"{progress.done:,} of {progress.total:,} {unit}"]
    if progress.done == progress.total and progress.ended:
        parts = [f"{progress.total:,} {unit}"]
    if progress.failed:
        parts.append(f"{progress.failed:,} failed")
    if progress.rate_per_s and not progress.ended:
        parts.append(f"{progress.rate_per_s:,.0f} {unit}/s")
        parts.append(f"{(progress.total - progress.done) / progress.rate_per_s:,.0f} s to go")
    elif progress.running_s:
        parts.append(f"{progress.running_s:,.0f} s")
    return ", ".join(parts)
