"""Both models on the page Validate: the lumped and the multi-body machine under the campaign's torque."""

from __future__ import annotations

import streamlit as st

from workbench.dashboard.campaigns import is_own
from workbench.dashboard.jobs.job import INPUTS, Call, Job, jobs_of, poll, remove, result_folder, start, stop
from workbench.dashboard.jobs.place import jobs_workspace, new_jobs_workspace
from workbench.dashboard.pages.validate.models_work import SHOWN
from workbench.dashboard.section_file import read_section
from workbench.dashboard.widgets import chart, plain, problem, table
from workbench.errors import InputError
from workbench.kinds import studied
from workbench.logs import Campaign
from workbench.machine.files import machine_text
from workbench.simulate.multibody_loop import check_multibody

KIND = "models"
EVERY_S = 0.5
FILES = (("Report", "models.html", "text/html"), ("models.json", "models.json", "application/json"))


def both_models(campaign: Campaign) -> None:
    """The section: a button, how far the comparison is, or what it found. Nothing for a machine of another kind."""
    if studied(campaign.machine) is None:
        return
    head, button = st.columns([5.0, 1.4], vertical_alignment="center")
    head.markdown("##### Lumped and multi-body model")
    job = _job(campaign)
    running = job is not None and not poll(job).ended
    if button.button("Compare models", width="stretch", key="validate models", disabled=running):
        try:
            job = _begin(campaign)
        except InputError as error:
            problem(error)
            return
    if job is None:
        st.caption(
            "Replays the torque of these runs on the multi-body machine too: rigid bodies, joints, rollers and wire. "
            "It takes some seconds a run, in a process of its own."
        )
    elif poll(job).state == "done":
        _result(job)
    else:
        st.fragment(_watch, run_every=None if poll(job).ended else EVERY_S)(job, poll(job).ended)


def _question(campaign: Campaign) -> dict[str, object]:
    """What decides the result: the campaign, its chosen runs, the machine."""
    return {
        "name": campaign.name,
        "source": str(campaign.path.resolve()),
        "runs": [run.name for run in campaign.runs],
        "machine": machine_text(campaign.machine),
    }


def _job(campaign: Campaign) -> Job | None:
    """The newest one that was asked just this."""
    workspace = jobs_workspace()
    asked = _question(campaign)
    jobs = [] if workspace is None else jobs_of(workspace, KIND)
    return next((job for job in jobs if asked.items() <= job.spec["arguments"].items()), None)


def _begin(campaign: Campaign) -> Job:
    """Starts it. InputError where the extra is missing, the machine is not taken, or too much is running."""
    hoist = studied(campaign.machine)
    assert hoist is not None
    check_multibody(hoist)
    # A session's own files go with it: the job gets a copy. The server's stay where they are.
    own = is_own(campaign)
    folder = f"{INPUTS}/campaign" if own else str(campaign.path.resolve())
    what = Call("workbench.dashboard.pages.validate.models_work:run", {"folder": folder, **_question(campaign)})
    return start(KIND, what, new_jobs_workspace(), campaign.name, {"campaign": campaign.path} if own else {})


def _watch(job: Job, had_ended: bool) -> None:
    """How far it is; the whole page is drawn anew once it ends."""
    progress = poll(job)
    if progress.ended and not had_ended:
        st.rerun()
    if progress.state == "failed":
        problem(InputError(progress.sentence))
    if progress.ended:
        if progress.state == "stopped":
            st.info("The comparison was cancelled.", icon=":material/info:")
        if st.button("Remove", key=f"validate models remove {job.id}", icon=":material/delete:"):
            remove(job)
            st.rerun()
        return
    line, button = st.columns([5.0, 1.4], vertical_alignment="center")
    line.progress(progress.share, f"{progress.running_s:.0f} s · {plain(progress.stage) or 'starting'}")
    button.button("Cancel", key=f"validate models cancel {job.id}", icon=":material/stop:", on_click=stop, args=(job,),
                  width="stretch", disabled=progress.state == "stopping")  # fmt: skip


def _result(job: Job) -> None:
    """Sentences, table and figures of the report, and its files."""
    try:
        section = read_section(job.folder / SHOWN)
    except InputError as error:
        problem(error)
        return
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in section.sentences))
    for report_table in section.tables:
        table(report_table)
    for number, (figure, note) in enumerate(section.figures):
        chart(figure, f"validate models {job.id} {number}", note)
        st.caption(plain(note))
    folder = result_folder(job)
    if folder is not None:
        with st.container(horizontal=True):
            for label, name, kind in FILES:
                st.download_button(label, (folder / name).read_bytes(), f"{campaign_file(job)}-{name}", kind,
                                   key=f"validate models download {name}", icon=":material/download:",
                                   on_click="ignore")  # fmt: skip


def campaign_file(job: Job) -> str:
    """The campaign's name as part of a file's name."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in job.title)
