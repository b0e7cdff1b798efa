"""The dashboard's frame: the table of pages and what stands around each.

A page is a function without arguments in a module of its own, imported when it is first shown.
A page whose module is not there is left out. `run()` is the whole app; `run_page(title)` draws
one page alone, which is what tests call.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import TYPE_CHECKING

import streamlit as st

if TYPE_CHECKING:
    from streamlit.navigation.page import StreamlitPage

# title -> (where its function stands, its icon)
PAGES: dict[str, tuple[str, str]] = {
    "Study": ("workbench.dashboard.study:show", ":material/tune:"),
    "Compare": ("workbench.dashboard.compare:show", ":material/compare_arrows:"),
    "Loop": ("workbench.dashboard.loop:show", ":material/all_inclusive:"),
    "Validate": ("workbench.dashboard.validate:show", ":material/fact_check:"),
    "Gap": ("workbench.dashboard.gap:show", ":material/troubleshoot:"),
    "Machine": ("workbench.dashboard.machine:show", ":material/precision_manufacturing:"),
    "Batches": ("workbench.dashboard.batches:show", ":material/dynamic_feed:"),
}


def present() -> list[str]:
    """Titles of the pages whose modules are there, in order."""
    return [title for title, (place, _) in PAGES.items() if importlib.util.find_spec(place.partition(":")[0])]


def run_page(title: str) -> None:
    """Draws one page, without the frame."""
    module, _, name = PAGES[title][0].partition(":")
    getattr(importlib.import_module(module), name)()


def _function(title: str) -> Callable[[], None]:
    def page() -> None:
        run_page(title)

    return page


def run() -> None:
    """The whole app: called once per rerun by the script that streamlit runs."""
    st.set_page_config(page_title="workbench", page_icon=":material/elevator:", layout="wide")
    pages: list[StreamlitPage] = []
    for title in present():
        page = st.Page(
            _function(title), title=title, icon=PAGES[title][1], url_path=title.lower(), default=title == "Study"
        )
        pages.append(page)
    st.navigation(pages, position="top").run()
