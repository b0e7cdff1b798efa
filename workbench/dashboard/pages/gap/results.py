"""A finished diagnosis on the page: the answer first, then tabs with the evidence and the consequences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.jobs.job import Job, result_folder
from workbench.dashboard.machines import keep_machine
from workbench.dashboard.pages.gap.view import VIEW, View, read_view
from workbench.dashboard.widgets import chart, is_dark, numbers, plain, said, table
from workbench.effects import check
from workbench.figures.place import for_dark_ground
from workbench.figures.save import Section
from workbench.machine import load_machine

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

TALL = 340  # px: what the first tab has room for on a screen of 800
TAB = "gap tab"
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


def show_results(job: Job) -> None:
    """Everything about a diagnosis that is done. InputError where its result is damaged."""
    view = _read(job)
    with st.sidebar:
        _take_away(job, view)
    with st.container(border=True):
        words, drawing = st.columns([2.4, 1.0]) if view.place else (st.container(), None)
        of = plain(" · ".join([f"Campaign {view.campaign}", view.machine, *_unusual(job)]))
        plainly = f"**In plain words.** {said(' '.join(view.plain))}\n\n" if view.plain else ""
        # One block of words, so that they stand close.
        words.markdown(
            f"{BADGES.get(view.verdict, '')} :small[{of}]\n#### {said(view.sentence)}\n{plainly}"
            f"{said(' '.join(view.lead))}"
        )
        if drawing is not None:
            drawing.image(for_dark_ground(view.place) if is_dark() else view.place, width="stretch")
    for warning in view.warnings:
        st.warning(said(warning), icon=":material/warning:")
    numbers(view.numbers)
    parts = {title: draw for title, (needs, draw) in _PARTS.items() if needs is None or needs in view.sections}
    # Only the tab that is looked at is drawn: a page of ten figures would be slow.
    tabs = st.tabs(list(parts), key=f"{TAB} {job.id}", on_change="rerun")
    for tab, draw in zip(tabs, parts.values(), strict=True):
        if tab.open:
            with tab:
                draw(job, view)


def _unusual(job: Job) -> list[str]:
    """What was asked other than usually."""
    arguments = job.spec["arguments"]
    weighed = arguments["candidates"]
    return [*(["one effect at most"] if arguments["most_effects"] == 1 else []),
            *([] if weighed is None else [f"{len(weighed)} candidate{'s' if len(weighed) != 1 else ''}"])]  # fmt: skip


def _read(job: Job) -> View:
    """Read once for as long as it is the one that is open."""
    last = session.get("gap view", tuple, ())
    if not last or last[0] != job.id:
        last = (job.id, read_view(job.folder / VIEW))
        session.put("gap view", last)
    view: View = last[1]
    return view


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
    # A callback runs before the page, whose lists of machines then hold it.
    st.button(
        "Keep the machine", key="gap keep", icon=":material/save:", on_click=_keep, args=(job, view), width="stretch",
        help="The corrected machine can then be chosen on the other pages.",
    )  # fmt: skip


def _keep(job: Job, view: View) -> None:
    folder = result_folder(job)
    assert folder is not None
    machine = load_machine(folder / "machine.yaml", check_effects=check)
    st.toast(f"Kept as {plain(keep_machine(f'corrected by {view.campaign}', machine))}", icon=":material/check:")


def _answer(job: Job, view: View) -> None:
    ranked, answer = view.sections["verdict"], view.sections["answer"]
    if answer.figures:
        left, right = st.columns(2)
        with left:
            _figures(job, "verdict", ranked, height=TALL)
        with right:
            _figures(job, "answer", answer, height=TALL)
    else:
        _figures(job, "verdict", ranked)
    _points(view.meaning)
    if ranked.points:
        st.markdown(said(ranked.sentences[-1]))
        _points(ranked.points)
    _tables(answer)
    with st.expander("All candidates"):
        _tables(view.sections["candidates"])


def _unknown(job: Job, view: View) -> None:
    _section(job, "unknown", view)


def _where(job: Job, view: View) -> None:
    _section(job, "where", view)


def _before_and_after(job: Job, view: View) -> None:
    _section(job, "shrink", view)


def _apart(job: Job, view: View) -> None:
    matrix, following = view.sections["isolability"], view.sections["next_run"]
    if view.lead[1:]:
        st.markdown(f"**Alike.** {said(view.lead[1])}")
    st.markdown(f"**The next run.** {said(' '.join(following.sentences))}")
    _tables(following)
    _figures(job, "isolability", matrix)
    _points(matrix.points)
    _tables(matrix)


def _study(job: Job, view: View) -> None:
    _section(job, "consequences", view)


def _logs(job: Job, view: View) -> None:
    for name in ("gap", "condition"):
        _section(job, name, view)


# title -> (the section it needs to be there, what draws it)
_PARTS: Mapping[str, tuple[str | None, Callable[[Job, View], None]]] = {
    "Verdict": (None, _answer),
    "Unknown cause": ("unknown", _unknown),
    "Where it lies": (None, _where),
    "Before and after": (None, _before_and_after),
    "Told apart, next run": (None, _apart),
    "Control study": (None, _study),
    "Gap and logs": (None, _logs),
}


def _section(job: Job, name: str, view: View) -> None:
    """The first sentence, what there is to look at, and then the rest of the words."""
    section = view.sections[name]
    if section.sentences:
        st.markdown(said(section.sentences[0]))
    _figures(job, name, section)
    _points([*section.sentences[1:], *section.points])
    _tables(section)


def _points(points: Sequence[str]) -> None:
    if points:
        st.markdown("\n".join(f"- {said(point)}" for point in points))


def _tables(section: Section) -> None:
    for report_table in section.tables:
        table(report_table)


def _figures(job: Job, name: str, section: Section, height: int | None = None) -> None:
    for number, (figure, note) in enumerate(section.figures):
        chart(figure if height is None else _of_height(figure, height), f"gap {job.id} {name} {number}", note or None)
        if note:
            st.caption(said(note))


def _of_height(figure: Figure, height: int) -> Figure:
    """The same, its title and legend as far from the top as before."""
    shown = type(figure)(figure)
    was = figure.layout.height
    for part in (shown.layout.title, shown.layout.legend):
        if part.y is not None:
            part.y = 1.0 - (1.0 - part.y) * was / height
    return shown.update_layout(height=height)
