"""The dashboard's frame: the table of pages and what stands around each.

`run()` is the whole app; `run_page(title)` draws one page alone, which is what tests call.
"""

from __future__ import annotations

import importlib
import sys
from functools import partial

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.widgets import ahead, is_dark

# Less air than streamlit's own, so that the numbers and the first figure fit 1280 by 800.
_STYLE = """<style>
.stMainBlockContainer {padding-top: 4rem; padding-bottom: 2rem; padding-left: 2rem; padding-right: 2rem;}
:has(> .st-key-ahead) {display: none;}
@media (max-width: 900px) {.stMainBlockContainer {padding-left: 1rem; padding-right: 1rem;}}
[class*="st-key-cards"] > * {flex: 1 1 10.5rem; min-width: 10.5rem;}
@media (max-width: 500px) {[class*="st-key-cards"] > * {min-width: 100%;}}
[class*="st-key-beside"] > * {flex: 1 1 26rem; min-width: min(26rem, 100%);}
@media (max-width: 900px) {[data-testid="stMarkdownContainer"] :is(th, td) {padding: 0.4rem 0.5rem;}}
[data-testid="stMarkdownContainer"] table {display: block; width: fit-content; max-width: 100%; overflow-x: auto;}
@media (max-width: 500px) {[data-testid="stMarkdownContainer"] :is(th, td) {padding: 0.2rem; font-size: 0.8rem;}}
.st-key-told-and-drawn > :first-child {flex: 3 1 22rem;}
.st-key-told-and-drawn > :nth-child(2) {flex: 1 1 15rem; max-width: 24rem;}
</style>"""

# On the dark ground the colour of buttons is a light one, on which white is hard to read.
_STYLE_DARK = """<style>
[data-testid="stBaseButton-primary"], [data-tag], [data-tag] * {color: #0E1117;}
</style>"""

# A carriage on its wire. Drawn here, for streamlit fetches icons and emoji from elsewhere.
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><path d="M4 4h24M16 4v11" stroke="#0072B2" '
    'stroke-width="3" fill="none"/><rect x="8" y="15" width="16" height="13" rx="2" fill="#D55E00"/></svg>'
)

# title -> the module whose show() draws it. No icons: with them some pages stood in a menu at 1280 px.
PAGES: dict[str, str] = {
    "Study": "study", "Compare": "compare", "Loop": "loop", "Sizing": "sizing", "Import": "imports",
    "Signals": "signals", "Validate": "validate", "Gap": "gap", "Machine": "machine", "Plant": "plant",
    "Batches": "batches",
}  # fmt: skip
FIRST = "Study"


def run_page(title: str) -> None:
    """Draws one page, without the frame; its module is imported when it is first shown."""
    importlib.import_module(f"workbench.dashboard.pages.{PAGES[title]}").show()


def run() -> None:
    """The whole app: called once per rerun by the script that streamlit runs."""
    if "pandas" in sys.modules:  # Plotly looks for it there, and would use one that another session half imported
        import pandas  # noqa: F401
    st.set_page_config(page_title="workbench", page_icon=_ICON, layout="wide")
    st.html(_STYLE_DARK + _STYLE if is_dark() else _STYLE)
    ahead()
    session.work_folder()  # a page's link drops what names this session's jobs from the address; here it comes back
    pages = [
        st.Page(
            partial(run_page, title), title=title, default=title == FIRST,
            url_path="first" if title == FIRST else title.lower(),  # the first page's own address is the server's
        )
        for title in PAGES
    ]  # fmt: skip

    def by_name() -> None:
        """Whoever writes the first page's name into an address finds it, too."""
        st.switch_page(pages[0], query_params=st.query_params.to_dict())

    hidden = st.Page(by_name, url_path=FIRST.lower(), visibility="hidden")
    st.navigation([*pages, hidden], position="top").run()
