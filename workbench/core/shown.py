"""Results that show themselves: `table()`, `plot()`, `to_pandas()` and a repr of a few lines.

`workbench.face`, above reports and figures, has the tables and figures of each record. A record finds them by name
when it is asked, as pandas finds its plotting backend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.verb import attribute

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

    from workbench.core.table import Table

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

    def table(self, name: str = "") -> Table:
        """As a table of text, with the units and digits of the reports."""
        table: Table = attribute(_FIND_VIEW)(self).table(self, name)
        return table

    def plot(self, name: str = "") -> Figure:
        """As a Plotly figure, the same as in the reports."""
        return attribute(_FIND_VIEW)(self).plot(self, name)

    def to_pandas(self) -> DataFrame:
        """As a pandas DataFrame of plain numbers, SI. pandas is optional: InputError where it is missing."""
        return attribute(_FIND_VIEW)(self).to_pandas(self)


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
