"""One self-contained page of words, tables and figures: the only place here that writes a file."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.table import Table
from workbench.core.templates import render
from workbench.view.style import Figure

if TYPE_CHECKING:
    from markupsafe import Markup


# No button that uploads a chart to Plotly's cloud, and no address to upload it to.
NOT_SHARED: dict[str, Any] = {
    "displaylogo": False,
    "showSendToCloud": False,
    "modeBarButtonsToRemove": ["sendChartToCloud"],
    "plotlyServerURL": "",
}


def without_sharing() -> None:
    """The same for what a notebook or `figure.show()` draws: Plotly's renderers of this process."""
    from plotly.io import renderers

    for name in renderers:
        renderer = renderers[name]
        if hasattr(renderer, "config"):
            renderer.config = (renderer.config or {}) | NOT_SHARED


@dataclass(frozen=True)
class Section:
    """A part of a page, in this order: heading (none where empty), sentences, points as a list, tables, figures.

    What stands in backticks in sentences and points is set as code. figures: each with a line below it. Empty
    sentences, tables without rows and figures that are None are left out.
    """

    heading: str = ""
    sentences: Sequence[str] = ()
    points: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[tuple[Figure | None, str]] = ()

    def __post_init__(self) -> None:
        for name in ("sentences", "points", "tables"):
            object.__setattr__(self, name, list(filter(None, getattr(self, name))))
        object.__setattr__(self, "figures", [one for one in self.figures if one[0] is not None])

    def __bool__(self) -> bool:
        """Whether it says or shows anything."""
        return bool(self.sentences or self.points or self.tables or self.figures)


def save_page(
    sections: Sequence[Section], path: Path, title: str, answer: str = "", generator: str = "workbench"
) -> None:
    """Write a page that needs no network; answer: one line that stands out at the top.

    The same sections give the same bytes.
    """
    from plotly.offline import get_plotlyjs

    numbers = itertools.count(1)
    page = render(
        "view/page.html.j2",
        title=title,
        answer=answer,
        generator=generator,
        sections=sections,
        plotly_js=get_plotlyjs(),
        plot_config=NOT_SHARED,
        drawn=lambda figure: _drawn(next(numbers), figure),
    )
    path.write_text(page, encoding="utf-8")


def _drawn(number: int, figure: Figure) -> Markup:
    from markupsafe import Markup
    from plotly.io import to_html

    return Markup(
        to_html(
            figure,
            include_plotlyjs=False,
            full_html=False,
            div_id=f"figure-{number}",  # a fixed id instead of a random one: the same figures give the same bytes
            config={"responsive": True, **NOT_SHARED},
        )
    )
