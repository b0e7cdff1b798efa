"""What all pages show the same way.

chart(figure, key)      a plotly figure over the page's width, light or dark as the page is
numbers([Number(...)])  a row of the numbers that decide, with deltas green or red
table(shown)            a report's table
problem(error)          the reader's one clear error
with guarded(): ...     an InputError inside ends the page with `problem`
text(value, digits)     a number with sane digits
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import streamlit as st
from streamlit.components import v2

from workbench.core.errors import InputError
from workbench.core.names import powers
from workbench.dashboard.server import PLOTLY
from workbench.view.page import NOT_SHARED

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from streamlit.delta_generator import DeltaGenerator

    from workbench.core.table import Table

SMALL = 1e-4  # below it leading zeros are no number that people read
SAME = 5e-4  # relative: a smaller difference is rounding to the reader
_UNIT = re.compile(r"(?<=\d) (?:N m|k?N|Hz|%|k?g|m?[ms])(?!\w)")  # that stays on its number's line
Better = Literal["lower", "higher"]
# `st.plotly_chart` draws a changed figure anew, and the reader's zoom is lost. This component changes the drawing.
CHART = "workbench_chart"
_JS = (Path(__file__).parent / "assets" / "chart.js").read_text(encoding="utf-8").replace("@PLOTLY@", PLOTLY)
_chart = v2.component(CHART, js=_JS, isolate_styles=False)


class Number(NamedTuple):
    """One of the numbers that decide. `delta`: to the baseline, in the same unit; `better` colours it."""

    label: str
    value: float | None
    unit: str = ""
    delta: float | None = None
    better: Better | None = None
    digits: int = 3
    help: str | None = None


def text(value: float | None, digits: int = 3, sign: bool = False) -> str:
    """A number with so many significant digits; in powers of ten where it is below a ten-thousandth."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) < SMALL:
        return powers(f"{value:{'+' if sign else ''}.{digits - 1}e}").replace("-", "\N{MINUS SIGN}")
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:{'+' if sign else ''}.{min(decimals, 6)}f}".replace("-", "\N{MINUS SIGN}")


WIDEST_NUMBER = 11  # characters that one of four cards shows


def _delta(number: Number) -> tuple[str | None, Literal["normal", "inverse", "off"]]:
    """The delta in words, with which of streamlit's colours is green; a difference of rounding has none."""
    by = number.delta
    if by is None or not math.isfinite(by):
        return None, "off"
    if abs(by) <= SAME * abs(number.value or 0.0):
        return f"±0 {number.unit}", "off"
    # A plain hyphen: that is where streamlit reads the arrow's direction.
    said = f"{text(by, 2, sign=True)} {number.unit}".replace("\N{MINUS SIGN}", "-")
    return said, "off" if number.better is None else "inverse" if number.better == "lower" else "normal"


def _headed(number: Number) -> tuple[str, str]:
    """Heading and value; the unit goes into the heading where the value would be cut beside it."""
    alone = text(number.value, number.digits)
    both = f"{alone} {number.unit}".strip()
    return (number.label, both) if len(both) <= WIDEST_NUMBER else (f"{number.label} ({number.unit})", alone)


def numbers(row: Sequence[Number]) -> None:
    """The numbers side by side, each with its delta: green where better, red where worse."""
    with st.container(horizontal=True, key=f"cards {row[0].label}"):  # they wrap where the page is narrow
        for number in row:
            delta, colour = _delta(number)
            label, shown = _headed(number)
            st.metric(
                label,
                shown,
                delta,
                delta_color=colour,
                delta_arrow="off" if delta and delta.startswith("±") else "auto",
                help=number.help,
                border=True,
                height="stretch",  # a number without a delta is as tall as its neighbours
            )


def beside(key: str, parts: int = 2) -> list[DeltaGenerator]:
    """Places side by side, one under the other where the page is narrow."""
    with st.container(horizontal=True, key=f"beside {key}"):
        return [st.container() for _ in range(parts)]


def is_dark() -> bool:
    """Whether the page stands on a dark ground."""
    return bool(st.context.theme.type == "dark")


def chart(figure: Figure, key: str, alt: str | None = None) -> None:
    """The figure over the page's width. Zoom by wheel or box, double click to come back, camera for a PNG."""
    from workbench.view.style import for_dark

    config = {
        **NOT_SHARED,
        "scrollZoom": True,
        "modeBarButtonsToRemove": [*NOT_SHARED["modeBarButtonsToRemove"], "select2d", "lasso2d", "autoScale2d"],
        "toImageButtonOptions": {"format": "png", "filename": key, "scale": 2},
    }
    shown = for_dark(figure) if is_dark() else figure
    said = f'{{"figure": {shown.to_json(validate=False)}, "config": {json.dumps(config)}, "alt": {json.dumps(alt)}}}'
    # Streamlit keeps `__` in a component's key for itself; names of runs and jobs may hold it.
    _chart(key=key.replace("%", "%25").replace("_", "%5F"), data=said.encode())


def table(shown: Table) -> None:
    """A report's table with its note; heads with their units."""
    from workbench.study import rows as arrow

    columns = {head: arrow.texts([powers(text.strip()) for text in texts]) for head, texts in shown.by_column.items()}
    align = {column.line: st.column_config.TextColumn(alignment=column.align) for column in shown.columns}
    # Not lazily: streamlit would import pandas to find out whether it could.
    st.dataframe(arrow.table(columns), hide_index=True, column_config=align, lazy=False)
    if shown.note:
        st.caption(said(shown.note))


def notes(sentences: Sequence[str]) -> None:
    """What the reader of logs notes, folded up."""
    if sentences:
        with st.expander(f"What the reader says of the logs ({len(sentences)})"):
            st.markdown("\n".join(f"- {plain(note)}" for note in sentences))


def problem(error: InputError) -> None:
    """One clear error: place and problem, with the file's name only, for its folder is the server's own."""
    path = Path(error.file or "")
    # Of several problems each further line names the file anew.
    said = error.problem.replace(f"{path.parent}/", "") if path.parent != Path() else error.problem
    shown = InputError(said, file=path.name or None, line=error.line, place=error.place)
    st.error(plain(str(shown)), icon=":material/error:")


def said(sentence: str) -> str:
    """A report's sentence on a page, where what it has in backticks for a terminal stands plainly."""
    return plain(_UNIT.sub(lambda match: match[0].replace(" ", "\u00a0"), powers(sentence.replace("`", ""))))


def plain(sentence: str) -> str:
    """A sentence with nothing in it that markdown would act on."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]()<>#+!|$~:" else c for c in sentence)


@contextmanager
def guarded() -> Iterator[None]:
    """Bad input met inside ends the page with its one error; a defect still shows its traceback."""
    try:
        yield
    except InputError as error:
        problem(error)
        st.stop()
