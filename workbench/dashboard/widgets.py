"""What all pages show the same way.

chart(figure, key)        a plotly figure over the page's width, light or dark as the page is
numbers([Number(...)])    a row of the numbers that decide, with deltas green or red
held(key, value)          the key of a widget that shows a value that the page keeps
fold(label, key)          a fold whose content is drawn only while it is open
number(Field(...), value) a slider with a field beside it in which any value may be typed
form(kind, values, key)   the fields of a record, drawn from its schema
table(shown)              a report's table
figures(drawn, key)       a report's figures, each with its line below it
problem(error)            the reader's one clear error
with guarded(): ...       an InputError inside is shown by `problem` and ends the page, or not: guarded(stop=False)
text(value, digits)       a number with sane digits
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import streamlit as st
from plotly.graph_objects import Figure
from pydantic import TypeAdapter
from streamlit.components import v2
from streamlit.delta_generator import DeltaGenerator

from workbench.core.errors import InputError
from workbench.core.names import powers, unit_of, words_of
from workbench.core.table import Table
from workbench.dashboard.server import ASSETS, PLOTLY
from workbench.view.page import NOT_SHARED
from workbench.view.style import for_dark

SMALL = 1e-4  # below it leading zeros are no number that people read
SAME = 5e-4  # relative: a smaller difference is rounding to the reader
MOST_ROWS = 30  # of a table that is shown whole
WIDEST_NUMBER, WIDEST_OF_MANY = 11, 8  # characters that one of four cards shows, and one of more
_UNIT = re.compile(r"(?<=\d) (?:N m|k?N|Hz|%|k?g|m?[ms])(?!\w)")  # that stays on its number's line
Better = Literal["lower", "higher"]
# `st.plotly_chart` draws a changed figure anew, and the reader's zoom is lost. This component changes the drawing.
CHART = "workbench_chart"
_JS = (ASSETS / "chart.js").read_text(encoding="utf-8").replace("@PLOTLY@", PLOTLY)
_chart = v2.component(CHART, js=_JS, isolate_styles=False)
_AHEAD = f'import(new URL("./{PLOTLY}", document.baseURI).href);\nexport default () => {{}};'
_ahead = v2.component(f"{CHART}_ahead", js=_AHEAD, isolate_styles=False)


# ---- words and numbers --------------------------------------------------------------------------------------------


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


def plain(sentence: str) -> str:
    """A sentence with nothing in it that markdown would act on."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]()<>#+!|$~:" else c for c in sentence)


def said(sentence: str) -> str:
    """A report's sentence on a page, where what it has in backticks for a terminal stands plainly."""
    return plain(_UNIT.sub(lambda match: match[0].replace(" ", "\u00a0"), powers(sentence.replace("`", ""))))


def points(sentences: Sequence[str]) -> None:
    if sentences:
        st.markdown("\n".join(f"- {said(sentence)}" for sentence in sentences))


def notes(sentences: Sequence[str]) -> None:
    """What the reader of logs notes, folded up."""
    if sentences:
        with st.expander(f"What the reader says of the logs ({len(sentences)})"):
            points(sentences)


def problem(error: InputError) -> None:
    """One clear error: place and problem, with the file's name only, for its folder is the server's own."""
    path = Path(error.file or "")
    # Of several problems each further line names the file anew.
    words = error.problem.replace(f"{path.parent}/", "") if path.parent != Path() else error.problem
    shown = InputError(words, file=path.name or None, line=error.line, place=error.place)
    st.error(plain(str(shown)), icon=":material/error:")


@contextmanager
def guarded(stop: bool = True) -> Iterator[None]:
    """Bad input met inside ends the page with its one error; a defect still shows its traceback. stop False: the page
    goes on."""
    try:
        yield
    except InputError as error:
        problem(error)
        if stop:
            st.stop()


class Number(NamedTuple):
    """One of the numbers that decide. `delta`: to the baseline, in the same unit; `better` colours it."""

    label: str
    value: float | None
    unit: str = ""
    delta: float | None = None
    better: Better | None = None
    digits: int = 3
    help: str | None = None


def by_words(by: float, unit: str) -> str:
    """A difference with its sign and unit: one of per cents is in points, `+0.14 pp`."""
    return f"{text(by, 2, sign=True)} {'pp' if unit == '%' else unit}".strip()


def numbers(row: Sequence[Number]) -> None:
    """The numbers side by side, each with its delta: green where better, red where worse; a difference of rounding has
    no colour and no arrow."""
    widest, greens = WIDEST_NUMBER if len(row) <= 4 else WIDEST_OF_MANY, {"lower": "inverse", "higher": "normal"}
    with st.container(horizontal=True, key=f"cards {row[0].label}"):  # they wrap where the page is narrow
        for number in row:
            by, delta = number.delta, None
            rounding = by is not None and abs(by) <= SAME * abs(number.value or 0.0)
            if by is not None and math.isfinite(by):
                # A plain hyphen: that is where streamlit reads the arrow's direction.
                words = by_words(by, number.unit).replace("\N{MINUS SIGN}", "-")
                delta = f"±0 {number.unit}" if rounding else words
            alone = text(number.value, number.digits)
            head, value = number.label, f"{alone} {number.unit}".strip()
            if len(value) > widest:  # it would be cut
                head, value = f"{head} ({number.unit})", alone
            green: Any = "off" if rounding else greens.get(number.better or "", "off")
            # Stretched: a number without a delta is as tall as its neighbours.
            st.metric(head, value, delta, green, help=number.help, border=True, height="stretch",
                      delta_arrow="off" if rounding else "auto")  # fmt: skip


def downloads(key: str, files: Sequence[tuple[str, Any, str, str]], width: Any = "content") -> None:
    """A button a file: what it says, the content (or what makes it, asked for at the click), its name, its type."""
    for words, content, name, kind in files:
        st.download_button(words, content, name, kind, on_click="ignore", key=f"{key} {words}", width=width,
                           icon=":material/download:")  # fmt: skip


def signal_files(name: str, labelled: Callable[[], Any]) -> list[tuple[str, Any, str, str]]:
    """For `downloads`: the signals of runs in each format, written when they are asked for."""
    from workbench.logs.signal_files import FORMS

    return [
        (f"Signals ({ending})", lambda write=write: write(labelled()), f"{name}.{ending}", kind)
        for ending, (write, kind) in FORMS.items()
    ]


def table(shown: Table, in_words: bool = False) -> None:
    """A report's table with its note; heads with their units. in_words: as text, whose cells wrap on a narrow page; the
    browser loads a megabyte less for it."""
    from workbench.study.rows import arrow_table, texts

    if in_words:
        short = [[c.replace(" ", "\u00a0") if len(c) < 8 else c for c in row] for row in shown.rows]
        st.markdown(replace(shown, rows=[[said(cell) for cell in row] for row in short]).markdown())
        if shown.note:
            st.caption(said(shown.note))
        return
    columns = {head: texts([powers(row[k].strip()) for row in shown.rows]) for k, head in enumerate(shown.heads)}
    align = {column.line: st.column_config.TextColumn(alignment=column.align) for column in shown.columns}
    # Not lazily: streamlit would import pandas to find out whether it could.
    tall: Any = "content" if len(shown.rows) <= MOST_ROWS else "auto"  # which scrolls
    st.dataframe(arrow_table(columns), hide_index=True, column_config=align, lazy=False, height=tall)
    if shown.note:
        st.caption(said(shown.note))


def fold(label: str, key: str, icon: str = "") -> Any:
    """A fold whose content is drawn only while it is open: `if (part := fold(…)).open:`."""
    return st.expander(label, key=f"fold {key}", icon=f":material/{icon}:" if icon else None, on_change="rerun")


def tabs(titles: Sequence[str], key: str) -> list[tuple[str, Any]]:
    """The title of the tab that is looked at, and its place: no other is computed and drawn."""
    made = zip(titles, st.tabs(titles, key=key, on_change="rerun"), strict=True)
    return [(title, tab) for title, tab in made if tab.open]


# ---- figures ------------------------------------------------------------------------------------------------------


def beside(key: str, parts: int = 2) -> list[DeltaGenerator]:
    """Places side by side, one under the other where the page is narrow."""
    with st.container(horizontal=True, key=f"beside {key}"):
        return [st.container() for _ in range(parts)]


def is_dark() -> bool:
    """Whether the page stands on a dark ground."""
    return bool(st.context.theme.type == "dark")


def ahead() -> None:
    """Has the browser read the figures' library while the page is still computed: half a second of its time."""
    with st.container(key="ahead"):
        _ahead(key="library ahead")


def chart(figure: Figure, key: str, alt: str | None = None) -> None:
    """The figure over the page's width. Zoom by wheel or box, double click to come back, camera for a PNG."""
    config = {
        **NOT_SHARED,
        "scrollZoom": True,
        "modeBarButtonsToRemove": [*NOT_SHARED["modeBarButtonsToRemove"], "select2d", "lasso2d", "autoScale2d"],
        "toImageButtonOptions": {"format": "png", "filename": key, "scale": 2},
    }
    shown = for_dark(figure) if is_dark() else figure
    words = f'{{"figure": {shown.to_json(validate=False)}, "config": {json.dumps(config)}, "alt": {json.dumps(alt)}}}'
    # Streamlit keeps `__` in a component's key for itself; names of runs and jobs may hold it.
    _chart(key=key.replace("%", "%25").replace("_", "%5F"), data=words.encode())


def figures(drawn: Sequence[tuple[Any, str]], key: str) -> None:
    """Of a report, each with its line below it; those of a job's view come as plain values."""
    for number, (figure, note) in enumerate(drawn):
        chart(figure if isinstance(figure, Figure) else Figure(figure), f"{key} {number}", note or None)
        if note:
            st.caption(said(note))


# ---- fields -------------------------------------------------------------------------------------------------------


def held(
    key: str,
    value: Any,
    options: Collection[Any] | None = None,
    read: Callable[[Any], Any] = lambda shown: shown,
    anew: bool = True,
) -> str:
    """The widget shows what the visitor has set in it, also where another page was looked at meanwhile; `value`, what
    the page keeps, where that has been changed by anything else, or where what it shows is none of the options.

    read: what the page makes of what is shown. anew: it is written each time, for a browser goes on showing what nobody
    can read in a field. A slider has nothing such, and a step that is taken while the page is drawn would be undone.
    """
    before, shown = st.session_state.get(f"{key} was", (value, value))
    now = st.session_state.get(key, shown)
    if not (_same(value, before) or _same(value, read(shown))) or (options is not None and now not in options):
        now = value
    if anew or key not in st.session_state or st.session_state[key] != now:
        st.session_state[key] = now
    st.session_state[f"{key} was"] = (value, now)
    return key


def _same(a: Any, b: Any) -> bool:
    numbers = isinstance(a, float) and isinstance(b, float)
    return math.isclose(a, b, rel_tol=1e-9) if numbers else bool(a == b)


@dataclass(frozen=True)
class Field:
    """A number that can be set: by slider from low to high in steps, or typed up to `most`.

    key: what its file calls it, in parts. steps: those of a slider that is even in the logarithm. form: how it is
    shown. slides: whether there is a slider. start: what stands there where its file says nothing.
    """

    words: str
    key: tuple[str, ...]
    low: float
    high: float
    step: float = 0.0
    form: str = "%.2f"
    tip: str = ""
    most: float | None = None
    slides: bool = True
    steps: Sequence[float] = ()
    start: float | None = None


def number(field: Field, value: float, key: str) -> float:
    """What the field stands at. A slider's range takes in the value that it is given."""
    held(key, value, anew=not field.slides)
    now = float(st.session_state[key])
    if field.most is None:
        now = min(max(now, field.low), field.high)
    if now != st.session_state[key]:
        st.session_state[key], st.session_state[f"{key} was"] = now, (value, now)
    if not field.slides:
        return float(st.number_input(field.words, field.low, field.high, key=key, step=None, format="%.4g"))
    low, high = min(field.low, now), max(field.high, now)
    if low == high:  # nothing to slide
        return low
    typed = f"{key} typed"
    st.session_state[typed] = now

    def take() -> None:
        # A slider that moved while its last step was drawn comes with what the field showed before that step.
        if st.session_state[key] == st.session_state[f"{key} was"][1]:
            st.session_state[key] = float(st.session_state[typed])

    left, right = st.columns([1.4, 1.0], vertical_alignment="bottom")
    least = field.low if field.most is None or field.steps else 0.0
    right.number_input(
        f"{field.words}, typed", least, max(high, field.most or high), key=typed, step=None, format="%.4g",
        on_change=take, label_visibility="collapsed",
    )  # fmt: skip
    if field.steps:  # as the field beside it shows it: 121300, not 1.213e+05
        form = lambda value: f"{float(f'{value:.4g}'):.10g}"  # noqa: E731
        return float(left.select_slider(field.words, sorted({*field.steps, now}), key=key, format_func=form))
    shown = left.slider(field.words, low, high, step=field.step, format=field.form, key=key, help=field.tip or None)
    return float(shown)


def form(kind: Any, values: Mapping[str, Any], key: str, only: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The values of a record as they are set in fields, which follow from its class or schema: numbers within their
    bounds, switches, choices, words, a fold for a block. What no field can show stays as it is.

    only: the fields that are shown, with their words; all of them without.
    """
    schema = kind if isinstance(kind, Mapping) else TypeAdapter(kind).json_schema()
    known, made = schema.get("$defs", {}), dict(values)
    for name, spec in schema.get("properties", {}).items():
        if name not in values or (only is not None and name not in only):
            continue
        options = [known[s["$ref"].rpartition("/")[2]] if "$ref" in s else s for s in spec.get("anyOf", [spec])]
        spec = {**spec, **next((s for s in options if s.get("type") != "null"), {})}
        unit, own, now, kind = unit_of(name), f"{key} {name}", values[name], spec.get("type")
        label = f"{words_of(name).capitalize()} ({unit})" if unit else words_of(name).capitalize()
        label = label if only is None else only[name]
        if spec.get("properties") and isinstance(now, Mapping):
            with st.expander(label):
                made[name] = form(spec | {"$defs": known}, now, own)
        elif len(spec.get("enum", ())) > 1:
            made[name] = st.selectbox(label, spec["enum"], key=held(own, now, spec["enum"]))
        elif kind == "boolean":
            made[name] = st.toggle(label, key=held(own, now))
        elif kind in ("number", "integer"):
            cast, step, shown = (int, 1, "%d") if kind == "integer" else (float, None, "%.6g")
            low, high, start = (None if v is None else cast(v) for v in (spec.get("minimum"), spec.get("maximum"), now))
            # What may be left out is None once it is emptied; anything else is its least value.
            empty: Any = None if len(options) > 1 else "min"
            made[name] = st.number_input(label, low, high, empty, step, shown, key=held(own, start))
        elif kind == "string" and "const" not in spec:
            made[name] = st.text_input(label, key=held(own, now))
    return made
