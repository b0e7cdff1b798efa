"""The page Gap: a campaign's diagnosis, which runs in a process of its own; the answer first, then tabs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.table import Column, Table, words
from workbench.dashboard import session
from workbench.dashboard.campaigns import campaign_or_none, is_own, last_name, offered, prefer, uploaded
from workbench.dashboard.job_cards import cards
from workbench.dashboard.jobs import INPUTS, Job, jobs_of, poll, result_folder, start
from workbench.dashboard.machines import keep_machine
from workbench.dashboard.widgets import beside, chart, is_dark, notes, numbers, plain, problem, said, table
from workbench.dashboard.work import VIEW, View, read_view, shown
from workbench.effects import check, effects_for
from workbench.figures.place import for_dark_ground
from workbench.logs import Campaign
from workbench.machines import kind_of, load_machine, plant_of
from workbench.view.page import Section

KIND = "gap"
LISTED, ALL, OWN = "the listed effects", "all effects, the unlisted too", "my own choice"
OPEN, OF, SHOWN, TAB = "gap open", "gap open of", "gap shown", "gap tab"
STAGES = (
    "Read the logs", "Search the effects", "Weigh the verdict", "Find the place", "What can be told apart",
    "How far it shrinks", "What the study says", "Write the report",
)  # fmt: skip
TALL = 340  # px: what the first tab has room for on a screen of 800
BADGES = {
    "named": ":blue-badge[:material/search_check: cause named]",
    "no_gap": ":green-badge[:material/check: no gap]",
    "unknown": ":violet-badge[:material/help: unknown cause]",
}
FILES = (
    ("Report", "diagnose.html", "text/html"),
    ("diagnosis.json", "diagnosis.json", "application/json"),
    ("machine.yaml", "machine.yaml", "application/yaml"),
)
# Title -> the sections that a tab shows, one under the other; the first one has an arrangement of its own.
TABS: dict[str, tuple[str, ...]] = {
    "Verdict": (),
    "Unknown cause": ("unknown",),
    "Where it lies": ("where",),
    "Before and after": ("shrink",),
    "Told apart, next run": ("next_run", "isolability"),
    "Control study": ("consequences",),
    "Gap and logs": ("gap", "condition"),
}


@dataclass(frozen=True)
class Asked:
    """name: what the campaign's select box calls it. candidates: None for the listed ones."""

    campaign: Campaign
    name: str
    most_effects: int
    candidates: tuple[str, ...] | None


def show() -> None:
    """Draws the page."""
    jobs = jobs_of(session.work_folder(), KIND)
    if jobs and jobs[0].title in offered() | uploaded():  # after a reload
        prefer(jobs[0].title)
    question: Asked | None = None
    bad: InputError | None = None
    with st.sidebar:
        try:
            question = _asked()
        except InputError as error:
            bad = error
        wanted = st.button("Diagnose", key="gap start", type="primary", icon=":material/play_arrow:",
                           width="stretch", disabled=question is None)  # fmt: skip
    if bad is not None:
        problem(bad)
        return
    if wanted and question is not None:
        try:
            _open(begin(question).id)
        except InputError as error:
            problem(error)
        jobs = jobs_of(session.work_folder(), KIND)
    with st.sidebar:
        opened = _choice(jobs, _opened(jobs))
    if opened is None:
        if question is not None:
            _before(question.campaign)
    elif poll(opened).state != "done":
        cards([opened], stages=STAGES)
    else:
        try:
            _results(opened)
        except InputError as error:
            problem(error)


def _asked() -> Asked | None:
    """What the controls say; None as long as a campaign is to be uploaded. InputError for a bad campaign."""
    campaign = campaign_or_none("gap campaign")
    if campaign is None:
        return None
    most = st.segmented_control(
        "Missing at once, at most", [1, 2], required=True, key=session.held("gap most effects", 2),
        format_func=lambda count: f"{count} effect{'s' if count > 1 else ''}",
        help="Two at once takes longer, for pairs are weighed too.",
    )  # fmt: skip
    effects = effects_for(plant_of(campaign.machine).kind)
    listed = [name for name, effect in effects.items() if effect.listed]
    which = st.selectbox(
        "Candidates", [LISTED, ALL, OWN], key=session.held("gap candidates", LISTED),
        help=f"What may be missing: {len(listed)} of the library's {len(effects)} effects are listed.",
    )  # fmt: skip
    candidates = None if which == LISTED else tuple(effects)
    if which == OWN:
        key = session.held(f"gap own {campaign.machine.kind}", listed[:1])
        candidates = tuple(st.multiselect("Effects to weigh", list(effects), key=key))
    return Asked(campaign, last_name(), int(most or 2), candidates)


def begin(question: Asked) -> Job:
    """Starts the diagnosis. InputError where nothing is to be weighed, or too much is running."""
    if question.candidates == ():
        raise InputError("choose at least one effect to weigh", place="candidates")
    campaign, own = question.campaign, is_own(question.campaign)
    arguments = {
        "folder": f"{INPUTS}/campaign" if own else str(campaign.path.resolve()),  # the server's own stay where they are
        "name": campaign.name,
        "most_effects": question.most_effects,
        "candidates": None if question.candidates is None else list(question.candidates),
    }
    inputs = {"campaign": campaign.path} if own else {}
    return start(
        KIND, "workbench.dashboard.work:diagnosis", arguments, session.new_work_folder(), question.name, inputs
    )


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
        "Diagnoses", list(known), key=SHOWN, index=None, placeholder="choose one", format_func=known.__getitem__,
        on_change=lambda: _open(st.session_state[SHOWN]),
    )  # fmt: skip
    return next((job for job in jobs if job.id == number), None)


def _before(campaign: Campaign) -> None:
    """What there is to be diagnosed."""
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
    notes(campaign.all_notes)


def _results(job: Job) -> None:
    """Everything about a diagnosis that is done. InputError where its result is damaged."""
    last = session.get("gap view", tuple, ())
    if not last or last[0] != job.id:  # read once for as long as it is the one that is open
        session.put("gap view", last := (job.id, read_view(View, job.file(VIEW))))
    view: View = last[1]
    with st.sidebar:
        _take_away(job, view)
    with st.container(border=True):
        text, drawing = st.columns([2.4, 1.0]) if view.place else (st.container(), None)
        of = plain(" · ".join([f"Campaign {view.campaign}", view.machine, *_unusual(job)]))
        plainly = f"**In plain words.** {said(' '.join(view.plain))}\n\n" if view.plain else ""
        # One block of words, so that they stand close.
        text.markdown(
            f"{BADGES.get(view.verdict, '')} :small[{of}]\n#### {said(view.sentence)}\n{plainly}"
            f"{said(' '.join(view.lead))}"
        )
        if drawing is not None:
            drawing.image(for_dark_ground(view.place) if is_dark() else view.place, width="stretch")
    for warning in view.warnings:
        st.warning(said(warning), icon=":material/warning:")
    numbers(view.numbers)
    parts = {title: names for title, names in TABS.items() if title != "Unknown cause" or "unknown" in view.sections}
    # Only the tab that is looked at is drawn: a page of ten figures would be slow.
    tabs = st.tabs(list(parts), key=f"{TAB} {job.id}", on_change="rerun")
    for tab, names in zip(tabs, parts.values(), strict=True):
        if tab.open:
            with tab:
                if not names:
                    _verdict(job, view)
                if "isolability" in names and view.lead[1:]:
                    st.markdown(f"**Alike.** {said(view.lead[1])}")
                for name in names:
                    _section(job, name, view.sections[name])


def _unusual(job: Job) -> list[str]:
    """What was asked other than usually."""
    weighed = job.arguments["candidates"]
    return [*(["one effect at most"] if job.arguments["most_effects"] == 1 else []),
            *([] if weighed is None else [f"{len(weighed)} candidate{'s' if len(weighed) != 1 else ''}"])]  # fmt: skip


def _take_away(job: Job, view: View) -> None:
    """What is downloaded or kept."""
    folder = result_folder(job)
    assert folder is not None
    st.markdown("**Results**")
    for label, name, kind in FILES:
        # The bytes, not a function that reads them: its address would last for one run of the page only, and a click
        # while the page is drawn anew would be lost.
        st.download_button(
            label, (folder / name).read_bytes(), name, kind, key=f"gap download {name}", icon=":material/download:",
            on_click="ignore", width="stretch",
        )  # fmt: skip

    def keep() -> None:  # runs before the page, whose lists of machines then hold it
        machine = load_machine(folder / "machine.yaml", check_effects=check)
        st.toast(f"Kept as {plain(keep_machine(f'corrected by {view.campaign}', machine))}", icon=":material/check:")

    st.button(
        "Keep the machine", key="gap keep", icon=":material/save:", on_click=keep, width="stretch",
        help="The corrected machine can then be chosen on the other pages.",
    )  # fmt: skip


def _verdict(job: Job, view: View) -> None:
    ranked, answer = view.sections["verdict"], view.sections["answer"]
    columns = beside("verdict") if answer.figures else [st.container()]
    for column, (name, section) in zip(columns, (("verdict", ranked), ("answer", answer)), strict=False):
        with column:
            _figures(job, name, section, TALL if answer.figures else None)
    _points(view.meaning)
    if ranked.points:
        st.markdown(said(ranked.sentences[-1]))
        _points(ranked.points)
    for shown_table in answer.tables:
        table(shown_table)
    with st.expander("All candidates"):
        for shown_table in view.sections["candidates"].tables:
            table(shown_table)


def _section(job: Job, name: str, section: Section) -> None:
    """The first sentence, what there is to look at, and then the rest of the words."""
    head = "**The next run.** " if name == "next_run" else ""
    sentences = [" ".join(section.sentences)] if head else list(section.sentences)
    if sentences and name != "isolability":
        st.markdown(head + said(sentences[0]))
    _figures(job, name, section)
    _points([*(sentences[1:] if name != "isolability" else []), *section.points])
    for shown_table in section.tables:
        table(shown_table)


def _points(points: Sequence[str]) -> None:
    if points:
        st.markdown("\n".join(f"- {said(point)}" for point in points))


def _figures(job: Job, name: str, section: Section, height: int | None = None) -> None:
    for number, (figure, note) in enumerate(section.figures):
        drawn = shown(figure)
        if height is not None:
            for part in (drawn.layout.title, drawn.layout.legend):  # as far from the top as before
                if part.y is not None:
                    part.y = 1.0 - (1.0 - part.y) * drawn.layout.height / height
            drawn.update_layout(height=height)
        chart(drawn, f"gap {job.id} {name} {number}", note or None)
        if note:
            st.caption(said(note))
