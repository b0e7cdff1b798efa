"""Results that show themselves: `table()`, `plot()`, `to_pandas()` and a repr of a few lines.

`workbench.view`, above the tasks, has the tables and figures of each record. A record finds them by name when it is
asked, as pandas finds its plotting backend.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.errors import InputError, check_known
from workbench.core.verb import attribute

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

    from workbench.core.table import Table

LONGEST = 72  # characters of one field in a repr
MOST_LISTED = 4


# The record's class, by its name -> where its view stands. Imported when a record is first shown.
VIEWS = {
    "Campaign": "workbench.view.logs:CAMPAIGN",
    "Comparison": "workbench.view.compare:VIEW",
    "Diagnosis": "workbench.view.diagnosis:VIEW",
    "Identification": "workbench.view.identify:VIEW",
    "LoopAnalysis": "workbench.view.loop:VIEW",
    "LoopResult": "workbench.view.logs:LOOP",
    "ReplayResult": "workbench.view.replay:VIEW",
    "Run": "workbench.view.logs:RUN",
    "StudyResult": "workbench.view.study:VIEW",
    "Tuning": "workbench.view.tune:VIEW",
}
NO_PANDAS = "to_pandas() needs pandas, which is optional; pip install pandas"


@dataclass(frozen=True)
class View:
    """tables, figures: by name; the first one is meant where no name is given. columns: name -> (n,) values.

    index: the column that is the DataFrame's index, "" for the row's number. frames: further columns, by name.
    """

    tables: Mapping[str, Callable[[Any], Table]]
    figures: Mapping[str, Callable[[Any], Figure]]
    columns: Callable[[Any], Mapping[str, Sequence[Any]]]
    index: str = field(default="")
    frames: Mapping[str, Callable[[Any], Mapping[str, Sequence[Any]]]] = field(default_factory=dict)

    def table(self, record: object, name: str) -> Table:
        return _chosen(self.tables, name, "table")(record)

    def plot(self, record: object, name: str) -> Figure:
        attribute("workbench.view.page:without_sharing")()
        return _chosen(self.figures, name, "figure")(record)

    def to_pandas(self, record: object, name: str = "") -> DataFrame:
        columns = _chosen(self.frames, name, "DataFrame") if name else self.columns
        try:
            import pandas
        except ImportError as error:
            raise InputError(NO_PANDAS) from error
        frame = pandas.DataFrame(dict(columns(record)))
        return frame.set_index(self.index) if self.index and not name else frame


def _chosen(known: Mapping[str, Callable[[Any], Any]], name: str, what: str) -> Callable[[Any], Any]:
    if not name:
        return next(iter(known.values()))
    check_known(f"no {what}", name, known)
    return known[name]


def view_of(record: object) -> View:
    """The view of a record's class, or of the class that it extends."""
    view: View = attribute(next(VIEWS[cls.__name__] for cls in type(record).__mro__ if cls.__name__ in VIEWS))
    return view


class Brief:
    """A frozen record whose repr takes a line a field: arrays and lists are counted, nested records are named."""

    __slots__ = ()

    def __repr__(self) -> str:
        lines = []
        for one in fields(self):  # type: ignore[arg-type]
            if one.repr:
                lines.append(f"  {one.name}: {brief(getattr(self, one.name))}")
        return "\n".join([f"{type(self).__name__}", *lines])


class Shown(Brief):
    """A record with tables, figures and columns. `name` chooses one of several; a wrong name lists them."""

    __slots__ = ()

    def table(self, name: str = "") -> Table:
        """As a table of text, with the units and digits of the reports."""
        return view_of(self).table(self, name)

    def plot(self, name: str = "") -> Figure:
        """As a Plotly figure, the same as in the reports."""
        return view_of(self).plot(self, name)

    def to_pandas(self, name: str = "") -> DataFrame:
        """As a pandas DataFrame of plain numbers, SI. pandas is optional: InputError where it is missing."""
        return view_of(self).to_pandas(self, name)

    def _repr_html_(self) -> str:
        """In a notebook: its few lines, and its first table."""
        return f"<pre>{html.escape(repr(self))}</pre>{self.table().html()}"


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
