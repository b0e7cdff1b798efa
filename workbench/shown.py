"""Results that show themselves: `table()`, `plot()`, `to_pandas()` and a repr of a few lines.

How a record is worded and drawn stands in `workbench.face`, above reports and figures. A record does not know
them: it asks by name, at the time of the call, as pandas asks its plotting backend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.verb import attribute

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

LONGEST = 72  # characters of one field in a repr
MOST_LISTED = 4
_FIND_VIEW = "workbench.face.view:view_of"


class Brief:
    """A frozen record whose repr takes a line a field: arrays and lists are counted, nested records are named."""

    __slots__ = ()

    def __repr__(self) -> str:
        lines = []
        for field in fields(self):  # type: ignore[arg-type]
            if field.repr:
                lines.append(f"  {field.name}: {brief(getattr(self, field.name))}")
        return "\n".join([f"{type(self).__name__}", *lines])


class Shown(Brief):
    """A record with tables, figures and columns. `name` chooses one of several; a wrong name lists them."""

    __slots__ = ()

    def table(self, name: str = "") -> TextTable:
        """As a table of text, with the units and digits of the reports."""
        table: TextTable = attribute(_FIND_VIEW)(self).table(self, name)
        return table

    def plot(self, name: str = "") -> Figure:
        """As a Plotly figure, the same as in the reports."""
        return attribute(_FIND_VIEW)(self).plot(self, name)

    def to_pandas(self) -> DataFrame:
        """As a pandas DataFrame of plain numbers, SI. pandas is optional: InputError where it is missing."""
        return attribute(_FIND_VIEW)(self).to_pandas(self)


@dataclass(frozen=True)
class TextTable:
    """A table of ready text. head: a name a column, lines of one name parted by a line break. rows: (n, columns).

    words: numbers of the columns that hold words and are set left. Shows itself on a terminal and in a notebook.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: frozenset[int] = frozenset()
    caption: str = ""

    @classmethod
    def of(cls, head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> TextTable:
        """From a report's table, in which the head of a column of words begins with a blank."""
        words = frozenset(i for i, name in enumerate(head) if name.startswith(" "))
        return cls(tuple(name.strip() for name in head), tuple(map(tuple, rows)), words, caption)

    def __str__(self) -> str:
        return "\n".join(self._lines())

    __repr__ = __str__

    def _lines(self) -> list[str]:
        heads = [name.split("\n") for name in self.head]
        tall = max(map(len, heads), default=0)
        above = [[([""] * (tall - len(h)) + h)[line] for h in heads] for line in range(tall)]
        body = [parts for row in self.rows for parts in _unfolded(row)]
        widths = [max((len(line[i]) for line in [*above, *body]), default=0) for i in range(len(self.head))]
        pad = [str.ljust if i in self.words else str.rjust for i in range(len(self.head))]
        return [
            "  ".join(p(cell, w) for p, cell, w in zip(pad, line, widths, strict=True)).rstrip()
            for line in [*above, *body]
        ]

    def _repr_html_(self) -> str:
        def line(cells: Sequence[str], tag: str) -> str:
            side = ["left" if i in self.words else "right" for i in range(len(cells))]
            inner = "".join(
                f'<{tag} style="text-align:{s}">{escape(c).replace(chr(10), "<br>")}</{tag}>'
                for c, s in zip(cells, side, strict=True)
            )
            return f"<tr>{inner}</tr>"

        body = "".join(line(row, "td") for row in self.rows)
        note = f"<p>{escape(self.caption)}</p>" if self.caption else ""
        return f"<table><thead>{line(self.head, 'th')}</thead><tbody>{body}</tbody></table>{note}"


def _unfolded(row: Sequence[str]) -> list[list[str]]:
    """A row whose cells may have several lines, as lines."""
    cells = [cell.split("\n") for cell in row]
    return [[cell[i] if i < len(cell) else "" for cell in cells] for i in range(max(map(len, cells), default=1))]


def brief(value: Any) -> str:
    """A value on one line of at most LONGEST characters."""
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return _cut(value)
    if isinstance(value, Mapping):
        return _cut(f"{len(value)}: {', '.join(map(str, value))}") if value else "none"
    if isinstance(value, Sequence | Set) and not isinstance(value, bytes):
        return _listed(list(value))
    if is_dataclass(value) or hasattr(type(value), "model_fields"):
        return _cut(_named(value))
    return _cut(repr(value))


def _listed(values: list[Any]) -> str:
    if not values:
        return "none"
    plain = all(isinstance(v, str | int | float) for v in values)
    if plain and len(values) <= MOST_LISTED:
        return _cut(", ".join(map(brief, values)))
    names = [str(v.name) for v in values if isinstance(getattr(v, "name", None), str)]
    what = "" if plain else f" {type(values[0]).__name__}"
    return _cut(f"{len(values)}{what}: {', '.join(names)}") if len(names) == len(values) else f"{len(values)}{what}"


def _named(record: Any) -> str:
    name = getattr(record, "name", None)
    return f"{type(record).__name__} '{name}'" if isinstance(name, str) and name else type(record).__name__


def _cut(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 2]} …"
