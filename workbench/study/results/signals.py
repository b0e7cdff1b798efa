"""The signals of a study's runs as one file: CSV, Parquet or MAT."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from typing import Any

from workbench.study.execute.run import StudyResult

LONGEST_NAME = 63  # of a variable in a MAT file


def signals_csv(result: StudyResult) -> bytes:
    """A line a sample: run, payload, reference, time, then every signal under its name with its unit."""
    from pyarrow.csv import write_csv

    out = io.BytesIO()
    write_csv(_table(result), out)
    return out.getvalue()


def signals_parquet(result: StudyResult) -> bytes:
    """The same columns."""
    from pyarrow.parquet import write_table

    out = io.BytesIO()
    write_table(_table(result), out)
    return out.getvalue()


def signals_mat(result: StudyResult) -> bytes:
    """A structure a run, with payload_kg, reference, time_s and every signal as a column; MATLAB 5."""
    from scipy.io import savemat

    runs: dict[str, dict[str, Any]] = {}
    for row in _rows(result):
        run = result.runs[row.run_id]
        name = re.sub(r"\W", "_", f"run_{row.reference}_{row.payload_kg:g}kg")[:LONGEST_NAME]
        if name in runs:
            name = re.sub(r"\W", "_", f"run_{row.run_id}")[:LONGEST_NAME]
        values = {"payload_kg": row.payload_kg, "reference": row.reference, "time_s": run.time_s}
        runs[name] = values | dict(run.signals)
    out = io.BytesIO()
    savemat(out, runs, long_field_names=True, oned_as="column", do_compression=True)
    return out.getvalue()


# Ending -> (what writes it, its type for a browser).
FORMS: Mapping[str, tuple[Callable[[StudyResult], bytes], str]] = {
    "csv": (signals_csv, "text/csv"),
    "mat": (signals_mat, "application/x-matlab-data"),
    "parquet": (signals_parquet, "application/vnd.apache.parquet"),
}


def _rows(result: StudyResult) -> list[Any]:
    return [row for row in result.rows if row.run_id in result.runs]


def _table(result: StudyResult) -> Any:
    import pyarrow as pa

    tables = []
    for row in _rows(result):
        run = result.runs[row.run_id]
        n = len(run.time_s)
        said = {"run": [row.run_id] * n, "payload_kg": [row.payload_kg] * n, "reference": [row.reference] * n}
        tables.append(pa.table(said | {"time_s": run.time_s} | dict(run.signals)))
    return pa.concat_tables(tables, promote_options="default") if tables else pa.table({"time_s": []})
