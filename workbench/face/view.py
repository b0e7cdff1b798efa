"""How each kind of result is shown, found by the record's class."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from workbench.core.errors import InputError, nearest
from workbench.core.table import Table
from workbench.core.verb import attribute

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

# The record's class, by its name -> where its view stands. Imported when a record is first shown.
VIEWS = {
    "Campaign": "workbench.face.logs:CAMPAIGN",
    "Comparison": "workbench.face.study:COMPARISON",
    "Diagnosis": "workbench.face.diagnose:VIEW",
    "Identification": "workbench.face.identify:VIEW",
    "LoopAnalysis": "workbench.face.loop:VIEW",
    "LoopResult": "workbench.face.simulate:VIEW",
    "ReplayResult": "workbench.face.replay:VIEW",
    "Run": "workbench.face.logs:RUN",
    "StudyResult": "workbench.face.study:VIEW",
    "Tuning": "workbench.face.tune:VIEW",
}
NO_PANDAS = "to_pandas() needs pandas, which is optional; pip install pandas"


@dataclass(frozen=True)
class View:
    """tables, figures: by name; the first one is meant where no name is given. columns: name -> (n,) values.

    index: the column that is the DataFrame's index, "" for the row's number.
    """

    tables: Mapping[str, Callable[[Any], Table]]
    figures: Mapping[str, Callable[[Any], Figure]]
    columns: Callable[[Any], Mapping[str, Sequence[Any]]]
    index: str = field(default="")

    def table(self, record: object, name: str) -> Table:
        return _chosen(self.tables, name, "table")(record)

    def plot(self, record: object, name: str) -> Figure:
        from workbench.view.page import without_sharing

        without_sharing()
        return _chosen(self.figures, name, "figure")(record)

    def to_pandas(self, record: object) -> DataFrame:
        try:
            import pandas
        except ImportError as error:
            raise InputError(NO_PANDAS) from error
        frame = pandas.DataFrame(dict(self.columns(record)))
        return frame.set_index(self.index) if self.index else frame


def _chosen(known: Mapping[str, Callable[[Any], Any]], name: str, what: str) -> Callable[[Any], Any]:
    if not name:
        return next(iter(known.values()))
    if name not in known:
        raise InputError(f"no {what} '{name}'; {nearest(name, known)}")
    return known[name]


def view_of(record: object) -> View:
    """The view of a record's class, or of the class that it extends."""
    view: View = attribute(next(VIEWS[cls.__name__] for cls in type(record).__mro__ if cls.__name__ in VIEWS))
    return view
