"""The signals of several runs as one file: CSV, Parquet or MAT."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.core.run import Run

LONGEST_NAME = 63  # of a variable in a MAT file


@dataclass(frozen=True)
class Labelled:
    """A run with what tells it apart. name: of its variable in a MAT file; labels: columns that hold one value."""

    name: str
    labels: Mapping[str, str | float]
    run: Run


def as_csv(runs: Sequence[Labelled]) -> bytes:
    """A line a sample: the labels, the time, then every signal under its name with its unit."""
    from pyarrow.csv import write_csv

    out = io.BytesIO()
    write_csv(_table(runs), out)
    return out.getvalue()


def as_parquet(runs: Sequence[Labelled]) -> bytes:
    """The same columns."""
    from pyarrow.parquet import write_table

    out = io.BytesIO()
    write_table(_table(runs), out)
    return out.getvalue()


def as_mat(runs: Sequence[Labelled]) -> bytes:
    """A structure a run, with its labels, time_s and every signal as a column; MATLAB 5."""
    from scipy.io import savemat

    variables: dict[str, dict[str, Any]] = {}
    for labelled in runs:
        plain = re.sub(r"\W", "_", labelled.name)
        plain = plain if plain[:1].isalpha() else f"run_{plain}"
        name, number = plain[:LONGEST_NAME], 2
        while name in variables:
            name, number = f"{plain[: LONGEST_NAME - 4]}_{number}", number + 1
        variables[name] = {**labelled.labels, "time_s": labelled.run.time_s, **labelled.run.signals}
    out = io.BytesIO()
    savemat(out, variables, long_field_names=True, oned_as="column", do_compression=True)
    return out.getvalue()


# Ending -> (what writes it, its type for a browser).
FORMS: Mapping[str, tuple[Callable[[Sequence[Labelled]], bytes], str]] = {
    "csv": (as_csv, "text/csv"),
    "mat": (as_mat, "application/x-matlab-data"),
    "parquet": (as_parquet, "application/vnd.apache.parquet"),
}


def _table(runs: Sequence[Labelled]) -> Any:
    import pyarrow as pa

    tables = []
    for labelled in runs:
        n = len(labelled.run.time_s)
        labels = {name: [value] * n for name, value in labelled.labels.items()}
        tables.append(pa.table(labels | {"time_s": labelled.run.time_s} | dict(labelled.run.signals)))
    return pa.concat_tables(tables, promote_options="default") if tables else pa.table({"time_s": []})
