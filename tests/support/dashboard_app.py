"""The dashboard's pages under test: one page alone in streamlit's own test bench."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from workbench.dashboard.widgets import CHART

if TYPE_CHECKING:
    from streamlit.testing.v1 import AppTest

SLOWEST_S = 240.0  # a first run may compile kernels, on a computer that does other work too


def page(title: str) -> AppTest:
    """The page, not yet run; `page("Study").run()` draws it."""
    from streamlit.testing.v1 import AppTest

    return AppTest.from_string(
        f"from workbench.dashboard.shell import run_page\nrun_page({title!r})\n", default_timeout=SLOWEST_S
    )


def errors(app: AppTest) -> list[str]:
    """The errors that the page shows, as sentences."""
    return [shown.value.replace("\\", "") for shown in app.error]


def figures(app: AppTest) -> list[dict[str, Any]]:
    """The figures that the page shows, as Plotly reads them: data and layout."""
    drawn = [chart.proto.bytes for chart in app.get("bidi_component") if chart.proto.component_name == CHART]
    return [json.loads(said)["figure"] for said in drawn if said]
