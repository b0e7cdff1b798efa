"""The page Gap: a campaign's diagnosis, which runs in a process of its own; the answer first, then tabs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import streamlit as st
from plotly.graph_objects import Figure

from workbench.core.errors import InputError
from workbench.core.names import powers
from workbench.core.numbers import whole_percent
from workbench.dashboard import chosen, jobs, session, widgets
from workbench.dashboard.jobs import VIEW, Job, Teller
from workbench.dashboard.pages.signals import runs_table
from workbench.dashboard.widgets import Number, guarded, held, plain, points, problem, said
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS
from workbench.diagnose.progress import Progress, Stage
from workbench.effects import check, effects_for
from workbench.logs import Campaign, read_campaign
from workbench.machines import kind_of, load_machine, plant_of
from workbench.view.film import for_dark_ground, marked_machine
from workbench.view.page import Section

if TYPE_CHECKING:
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
FILES = {  # name -> type; from the next run on where the diagnosis has it
    "diagnose.html": "text/html",
    "diagnosis.json": "application/json",
    "machine.yaml": "application/yaml",
    "next_run.csv": "text/csv",
    "next_run.yaml": "application/yaml",
    "law.py": "text/x-python",
    "machine_law.yaml": "application/yaml",
}
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

    of: str
    campaign: str
    verdict: str
    sentence: str
    lead: Sequence[str]
    meaning: Sequence[str]
    warnings: Sequence[str]
    numbers: Sequence[Number]
    sections: Mapping[str, Section]
    plain: Sequence[str]
    place: str


def show() -> None:
    """Draws the page."""
    own = session.own_jobs(KIND)
    if own and not chosen.last_name() and own[0].title in chosen.offered() | chosen.uploaded():  # after a reload
        chosen.choose_campaign(own[0].title)
    campaign, bad = None, None
    with st.sidebar:
        try:
            campaign = chosen.campaign_or_none("gap campaign")
            arguments = {} if campaign is None else _asked(campaign)
        except InputError as error:
            bad = error
        wanted = st.button("Diagnose", key="gap start", type="primary", icon=":material/play_arrow:",
                           width="stretch", disabled=campaign is None)  # fmt: skip
    if bad is not None:
        problem(bad)
        return
    if wanted and campaign is not None:
        with guarded(stop=False):
            if arguments["candidates"] == []:
                raise InputError("choose at least one effect to weigh", place="candidates")
            folder, inputs = chosen.sent_to_job(campaign)
            asked = {"folder": folder, "name": campaign.name, **arguments}
            jobs.start(KIND, f"{__name__}:work", asked, session.new_work_folder(), chosen.last_name(), inputs)
            own = session.own_jobs(KIND)
    newest = next((job.id for job in own if job.title == chosen.last_name()), None)
    known = {job.id: f"{job.title}, {time.strftime('%H:%M', time.localtime(job.begun_s))}" for job in own}
    number = newest
    if len(own) > 1 or (own and newest is None):  # of several the campaign's newest, or the one that is chosen
        number = st.sidebar.selectbox(
            "Diagnoses", list(known), key=held(SHOWN, newest, [None, *known]), index=None, placeholder="choose one",
            format_func=known.__getitem__,
        )  # fmt: skip
    opened = next((job for job in own if job.id == number), None)
    if opened is not None and jobs.poll(opened).state == "done":
        with guarded(stop=False):
            _results(opened)
    elif opened is not None:
        jobs.cards([opened], stages=STAGES)
    elif campaign is not None:
        _before(campaign)


def _asked(campaign: Campaign) -> dict[str, Any]:
    """What the controls say."""
    most = st.segmented_control(
        "Missing at once, at most", [1, MOST_EFFECTS], required=True, key=held("gap most effects", MOST_EFFECTS),
        format_func=lambda count: f"{count} effect{'s' if count > 1 else ''}",
        help="A further effect is named only where its gain on held-out runs is significant.",
    )  # fmt: skip
    effects = effects_for(plant_of(campaign.machine).kind)
    listed = [name for name, effect in effects.items() if effect.listed]
    which = st.selectbox(
        "Candidates", [LISTED, ALL, OWN], key=held("gap candidates", LISTED),
        help=f"What may be missing: {len(listed)} of the library's {len(effects)} effects are listed.",
    )  # fmt: skip
    candidates = None if which == LISTED else list(effects)
    if which == OWN:
        key = held(f"gap own {campaign.machine.kind}", listed[:1])
        candidates = st.multiselect("Effects to weigh", list(effects), key=key)
    return {"most_effects": int(most or MOST_EFFECTS), "candidates": candidates}


def _before(campaign: Campaign) -> None:
    """What there is to be diagnosed."""
    st.markdown(f"##### Campaign {plain(campaign.name)} · {plain(campaign.machine.name)}")
    st.info(
        "**Diagnose** compares these runs with the machine's model: where they part, which effect the model lacks, "
        "how sure that is, and how far the gap shrinks. It takes about a minute, in a process of its own.",
        icon=":material/troubleshoot:",
    )
    widgets.table(runs_table(campaign.runs))
    widgets.notes(campaign.all_notes)


def _results(job: Job) -> None:
    """Everything about a diagnosis that is done. InputError where its result is damaged."""
    view, folder = session.once("gap view", job.id, lambda: jobs.read_view(View, job)), job.file("result")
    with st.sidebar:
        st.markdown("**Results**")
        # The bytes, not a function that reads them: its address would last for one run of the page only, and a click
        # while the page is drawn anew would be lost.
        widgets.downloads("gap download", files_of(folder), "stretch")
        chosen.keep_button(
            "gap keep", f"corrected by {view.campaign}",
            lambda: load_machine(folder / "machine.yaml", check_effects=check),
        )  # fmt: skip
    with st.container(border=True), st.container(horizontal=True, key="told and drawn"):
        weighed, text = job.arguments["candidates"], st.container()
        asked = ["one effect at most"] if job.arguments["most_effects"] == 1 else []
        asked += [] if weighed is None else [f"{len(weighed)} candidate{'s' if len(weighed) != 1 else ''}"]
        plainly = f"**In plain words.** {said(' '.join(view.plain))}\n\n" if view.plain else ""
        # One block of words, so that they stand close.
        text.markdown(
            f"{BADGES.get(view.verdict, '')} :small[{plain(' · '.join([view.of, *asked]))}]\n"
            f"##### {said(view.sentence)}\n{plainly}{said(' '.join(view.lead))}"
        )
        if view.place:
            drawing = for_dark_ground(view.place) if widgets.is_dark() else view.place
            st.container().image(drawing, width="stretch")
    for warning in view.warnings:
        st.warning(said(warning), icon=":material/warning:")
    widgets.numbers(view.numbers)
    titles = [title for title in TABS if title != "Unknown cause" or "unknown" in view.sections]
    for title, tab in widgets.tabs(titles, f"{TAB} {job.id}"):
        with tab:
            if not TABS[title]:
                _verdict(view, f"gap {job.id}")
            if "isolability" in TABS[title] and view.lead[1:]:
                st.markdown(f"**Alike.** {said(view.lead[1])}")
            for name in TABS[title]:
                _section(name, view.sections[name], f"gap {job.id} {name}")


def files_of(folder: Path) -> list[tuple[str, bytes, str, str]]:
    """What there is to download of a diagnosis, for `widgets.downloads`."""
    there = [(name, kind) for name, kind in FILES.items() if (folder / name).is_file()]
    called = {"diagnose.html": "Report"}
    return [(called.get(name, name), (folder / name).read_bytes(), name, kind) for name, kind in there]


def _verdict(view: View, key: str) -> None:
    ranked, answer = view.sections["verdict"], view.sections["answer"]
    columns = widgets.beside("verdict") if answer.figures else [st.container()]
    for column, name in zip(columns, ("verdict", "answer"), strict=False):
        with column:
            widgets.figures(view.sections[name].figures, f"{key} {name}")
    points(view.meaning)
    if ranked.points:
        st.markdown(said(ranked.sentences[-1]))
        points(ranked.points)
    for shown in answer.tables:
        widgets.table(shown, in_words=True)
    with st.expander("All candidates"):
        for shown in view.sections["candidates"].tables:
            widgets.table(shown)


def _section(name: str, section: Section, key: str) -> None:
    """The first sentence, what there is to look at, and then the rest of the words."""
    sentences = [] if name == "isolability" else list(section.sentences)
    if name == "next_run":
        st.markdown(f"**The next run.** {said(' '.join(sentences))}")
        sentences = []
    elif sentences:
        st.markdown(said(sentences.pop(0)))
    widgets.figures(section.figures, key)
    points([*sentences, *section.points])
    for shown in section.tables:
        widgets.table(shown, in_words=name in ("where", "next_run"))  # with a cell of any length


# ---- in the worker's process -----------------------------------------------------------------------------------------


def work(
    out: Path, tell: Teller, folder: str, name: str, most_effects: int, candidates: Sequence[str] | None = None
) -> None:
    """In the worker: diagnoses the campaign in `folder`, called `name`. InputError for one that cannot be diagnosed."""
    from workbench.diagnose.diagnose import diagnose
    from workbench.view.diagnosis import progress_words, write_diagnosis

    def told(progress: Progress, sentence: str = "") -> None:
        tell(sentence or progress_words(progress), round(PARTS * progress.share_done), PARTS)

    def diagnosed() -> Diagnosis:
        campaign = replace(read_campaign(folder, confined=True, check_effects=check), name=name)
        return diagnose(campaign, candidates=candidates, most_effects=most_effects, tell=told)

    # The last stage is left to whoever writes the diagnosis down.
    found = write_diagnosis(diagnosed, out, lambda sentence: told(Progress(Stage.WRITE), sentence))
    jobs.write_view(view_of(found), out.parent / VIEW)


def view_of(d: Diagnosis) -> View:
    """The runs are replayed for the figures."""
    from workbench.view import diagnosis as words

    sections, machine = words.sections_of(d), d.campaign.machine
    for figure, _ in sections["verdict"].figures:  # for a place of half the page's width
        assert figure is not None
        figure.update_traces(y=[name.replace(" + ", " +<br>") for name in figure.data[0].y])
        _lower(figure, "Probability")
    return View(
        f"Campaign {d.campaign.name} · {machine.name}",
        d.campaign.name,
        d.verdict.word,
        d.verdict.sentence,
        [sentence for sentence in (words.probability_sentence(d), words.alike_sentence(d)) if sentence],
        words.effect_sentences(d),
        d.warnings,
        _numbers(d),
        sections | {"answer": replace(sections["answer"], figures=_how_it_shows(d))},
        words.plain_summary(d),
        "" if d.where is None else marked_machine(machine, d.where.subsystem, d.shrink),
    )


def _lower(figure: Figure, title: str) -> None:
    """The figure as high as the first tab has room for, its title and legend as far from the top as before."""
    for part in (figure.layout.title, figure.layout.legend):
        if part.y is not None:
            part.y = 1.0 - (1.0 - part.y) * figure.layout.height / TALL
    figure.update_layout(height=TALL, title_text=title)


def _how_it_shows(d: Diagnosis) -> list[tuple[Figure, str]]:
    """The gap over the one variable that explains it best, for a place of half the page's width."""
    from workbench.view import diagnosis_figures as drawn

    profiles = [] if d.where is None else [p for p in d.where.profiles if drawn.worth_a_panel(p)]
    if not profiles:
        return []
    # A mean shows more than a spectrum that explains hardly more.
    best = max(profiles, key=lambda p: p.explains - NEARLY * drawn.is_spectrum(p))
    kind = kind_of(d.campaign.machine)
    figure = drawn.profiles([best], kind.drive.unit, kind.directions.names)
    figure.update_traces(showlegend=False, selector={"legendgroup": "share"})
    figure.update_layout(margin_t=92).layout.annotations = ()
    _lower(figure, "How the gap shows")
    what = f"{best.label[0].upper()}{best.label[1:]}"
    note = f"{what}: explains {whole_percent(best.explains)} of the gap. Grey: the share of its energy."
    return [(figure, note)]


def _numbers(d: Diagnosis) -> list[Number]:
    from workbench.view.diagnosis import RUN_AWAY

    s, kind, (low, high) = d.shrink, kind_of(d.campaign.machine), d.shrink.ci95
    w, scale = kind.drive, kind.speed_scale[0]
    corrected = d.verdict.word != "no_gap"
    band = f"below {s.band_hz:.3g} Hz, on runs that were held out of the fit"
    was = powers(f"; before the correction {s.before:.3g} {s.unit}") if corrected else ""
    residual = f"rms of measured minus predicted {w.quantity} {band}{was}"
    by = s.after - s.before if corrected else None
    numbers = [
        Number(f"{w.quantity.capitalize()} residual", s.after, s.unit, by, "lower", help=residual),
        Number("Noise floor", s.noise, s.unit, help=f"rms that the sensors' noise alone makes, {band}"),
    ]
    if corrected:
        what = f"of the {w.quantity} residual, held out; 95 % interval {low:.3g} to {high:.3g}"
        numbers.append(Number("Shrinks by", s.factor, "×", help=what))
    if s.speed_rmse_percent_after <= RUN_AWAY:
        by = s.speed_rmse_percent_after - s.speed_rmse_percent_before if corrected else None
        what = f"rms of the speed replayed open loop, in % of {scale}; adds up every bias from the first sample on"
        numbers.append(Number("Speed error", s.speed_rmse_percent_after, "%", by, "lower", help=what))
    return numbers
