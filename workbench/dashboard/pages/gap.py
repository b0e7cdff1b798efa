"""The page Gap: a campaign's diagnosis, which runs in a process of its own; the answer first, then tabs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.names import powers
from workbench.core.table import Column, Table
from workbench.core.table import words as head
from workbench.dashboard import session
from workbench.dashboard.chosen import (
    campaign_or_none,
    choose_campaign,
    is_own,
    keep_machine,
    last_name,
    offered,
    uploaded,
)
from workbench.dashboard.jobs import (
    INPUTS,
    VIEW,
    Job,
    Teller,
    cards,
    jobs_of,
    poll,
    read_view,
    result_folder,
    start,
    without_folder,
    write_view,
)
from workbench.dashboard.widgets import (
    Number,
    beside,
    chart,
    held,
    is_dark,
    notes,
    numbers,
    plain,
    points,
    problem,
    said,
    table,
)
from workbench.effects import check, effects_for
from workbench.logs import Campaign, read_campaign
from workbench.machines import kind_of, load_machine, plant_of
from workbench.view.page import Section
from workbench.view.place import for_dark_ground
from workbench.view.words import words_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from workbench.diagnose.diagnose import Diagnosis

KIND = "gap"
LISTED, ALL, OWN = "the listed effects", "all effects, the unlisted too", "my own choice"
SHOWN, TAB = "gap shown", "gap tab"
STAGES = (
    "Read the logs", "Search the effects", "Weigh the verdict", "Find the place", "Which effects the runs discriminate",
    "Residual on held-out runs", "What the study says", "Write the report",
)  # fmt: skip
PARTS = 800  # that a diagnosis is counted in
NEARLY = 0.05  # of the gap: what explains so little less may explain it more plainly
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
class View:
    """What the page shows of one diagnosis. lead: what the verdict's probability means, what is alike.

    meaning: what each named effect is. numbers: those that decide. sections: the report's, by what they are about.
    plain: the verdict in plain words. place: a drawing of the machine with the gap's place marked, SVG.
    """

    campaign: str
    machine: str
    verdict: str
    sentence: str
    lead: Sequence[str]
    meaning: Sequence[str]
    warnings: Sequence[str]
    numbers: Sequence[Number]
    sections: Mapping[str, Section]
    plain: Sequence[str] = ()
    place: str = ""


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
    if jobs and not last_name() and jobs[0].title in offered() | uploaded():  # after a reload
        choose_campaign(jobs[0].title)
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
            begin(question)
        except InputError as error:
            problem(error)
        jobs = jobs_of(session.work_folder(), KIND)
    with st.sidebar:
        opened = _chosen(jobs)
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
        "Missing at once, at most", [1, 2], required=True, key=held("gap most effects", 2),
        format_func=lambda count: f"{count} effect{'s' if count > 1 else ''}",
        help="Two at once takes longer, for pairs are weighed too.",
    )  # fmt: skip
    effects = effects_for(plant_of(campaign.machine).kind)
    listed = [name for name, effect in effects.items() if effect.listed]
    which = st.selectbox(
        "Candidates", [LISTED, ALL, OWN], key=held("gap candidates", LISTED),
        help=f"What may be missing: {len(listed)} of the library's {len(effects)} effects are listed.",
    )  # fmt: skip
    candidates = None if which == LISTED else tuple(effects)
    if which == OWN:
        key = held(f"gap own {campaign.machine.kind}", listed[:1])
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
    return start(KIND, f"{__name__}:work", arguments, session.new_work_folder(), question.name, inputs)


def _chosen(jobs: Sequence[Job]) -> Job | None:
    """The campaign's newest diagnosis, or the one that is chosen of a list, where there are several."""
    newest = next((job.id for job in jobs if job.title == last_name()), None)
    known = {job.id: f"{job.title}, {time.strftime('%H:%M', time.localtime(job.begun_s))}" for job in jobs}
    number = newest
    if len(jobs) > 1 or (jobs and newest is None):
        number = st.selectbox(
            "Diagnoses", list(known), key=held(SHOWN, newest, [None, *known]), index=None, placeholder="choose one",
            format_func=known.__getitem__,
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
    columns = [head("run"), *([Column("payload", "kg")] if payload else []), Column("length", "s"), Column("samples")]
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
        session.put("gap view", last := (job.id, read_view(View, job)))
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
    points(view.meaning)
    if ranked.points:
        st.markdown(said(ranked.sentences[-1]))
        points(ranked.points)
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
    points([*(sentences[1:] if name != "isolability" else []), *section.points])
    for shown_table in section.tables:
        table(shown_table)


def _figures(job: Job, name: str, section: Section, height: int | None = None) -> None:
    import plotly.graph_objects as go

    for number, (figure, note) in enumerate(section.figures):
        drawn = go.Figure(figure)
        if height is not None:
            for part in (drawn.layout.title, drawn.layout.legend):  # as far from the top as before
                if part.y is not None:
                    part.y = 1.0 - (1.0 - part.y) * drawn.layout.height / height
            drawn.update_layout(height=height)
        chart(drawn, f"gap {job.id} {name} {number}", note or None)
        if note:
            st.caption(said(note))


# ---- in the worker's process -----------------------------------------------------------------------------------------


def work(
    out: Path, tell: Teller, folder: str, name: str, most_effects: int, candidates: Sequence[str] | None = None
) -> None:
    """In the worker: diagnoses the campaign in `folder`, called `name`. InputError for one that cannot be diagnosed."""
    from workbench.diagnose.diagnose import diagnose
    from workbench.diagnose.progress import Progress, Stage
    from workbench.view.diagnosis import progress_words, write_diagnosis

    def said(progress: Progress) -> None:
        tell(progress_words(progress), round(PARTS * progress.share_done), PARTS)

    def written(sentence: str) -> None:  # the last stage, which a diagnosis leaves to whoever writes it down
        tell(sentence, round(PARTS * Progress(Stage.WRITE).share_done), PARTS)

    def diagnosed() -> Diagnosis:
        campaign = replace(read_campaign(folder, confined=True, check_effects=check), name=name)
        return diagnose(campaign, candidates=candidates, most_effects=most_effects, tell=said)

    with without_folder(folder):
        found = write_diagnosis(diagnosed, out, written)
    write_view(view_of(found), out.parent / VIEW)


def view_of(d: Diagnosis) -> View:
    """The runs are replayed for the figures."""
    from workbench.view import diagnosis as words
    from workbench.view.diagnosis import sections_of
    from workbench.view.place import marked_machine

    sections = sections_of(d)
    for figure, _ in sections["verdict"].figures:  # for a place of half the page's width
        figure.update_traces(y=[name.replace(" + ", " +<br>") for name in figure.data[0].y]).update_layout(
            title_text="Probability"
        )
    return View(
        d.campaign.name,
        d.campaign.machine.name,
        d.verdict.word,
        d.verdict.sentence,
        [sentence for sentence in (words.probability_sentence(d), words.alike_sentence(d)) if sentence],
        words.effect_sentences(d),
        d.warnings,
        _numbers(d),
        sections | {"answer": replace(sections["answer"], figures=_how_it_shows(d))},
        words.plain_summary(d),
        "" if d.where is None else marked_machine(d.campaign.machine, d.where.subsystem, d.shrink),
    )


def _how_it_shows(d: Diagnosis) -> list[tuple[Figure, str]]:
    """The gap over the one variable that explains it best, for a place of half the page's width."""
    from workbench.view import diagnosis_figures as diagnose_where
    from workbench.view.words import direction_names

    profiles = [] if d.where is None else [p for p in d.where.profiles if diagnose_where.worth_a_panel(p)]
    if not profiles:
        return []
    most = max(profile.explains for profile in profiles)
    # A mean shows more than a spectrum that explains hardly more.
    best = max(
        (profile for profile in profiles if profile.explains >= most - NEARLY),
        key=lambda profile: (not diagnose_where.is_spectrum(profile), profile.explains),
    )
    machine = d.campaign.machine
    figure = diagnose_where.profiles([best], words_of(machine).unit, direction_names(machine))
    figure.update_traces(showlegend=False, selector={"legendgroup": "share"})
    figure.update_layout(title_text="How the gap shows", margin_t=92).layout.annotations = ()
    explains = round(100.0 * best.explains)
    note = f"{best.label[0].upper()}{best.label[1:]}: explains {explains} % of the gap. Grey: the share of its energy."
    return [(figure, note)]


def _numbers(d: Diagnosis) -> list[Number]:
    from workbench.view import diagnosis as words

    s, w = d.shrink, words_of(d.campaign.machine)
    corrected = d.verdict.word != "no_gap"
    low, high = s.ci95
    band = f"below {s.band_hz:.3g} Hz, on runs that were held out of the fit"
    was = powers(f"; before the correction {s.before:.3g} {s.unit}") if corrected else ""
    numbers = [
        Number(
            f"{w.quantity.capitalize()} residual", s.after, s.unit, s.after - s.before if corrected else None, "lower",
            help=f"rms of measured minus predicted {w.quantity} {band}{was}",
        ),
        Number("Noise floor", s.noise, s.unit, help=f"rms of what a machine without a gap would leave, {band}"),
    ]  # fmt: skip
    if corrected:
        said = f"of the {w.quantity} residual, held out; 95 % interval {low:.3g} to {high:.3g}"
        numbers.append(Number("Shrinks by", s.factor, "×", help=said))
    if s.speed_rmse_percent_after <= words.RUN_AWAY:
        by = s.speed_rmse_percent_after - s.speed_rmse_percent_before
        said = f"rms of the speed replayed open loop, in % of {w.scale}; adds up every bias from the first sample on"
        numbers.append(
            Number("Speed error", s.speed_rmse_percent_after, "%", by if corrected else None, "lower", help=said)
        )
    return numbers
