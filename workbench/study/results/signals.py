"""The runs of a study, labelled for a file of their signals."""

from __future__ import annotations

from workbench.logs.signal_files import Labelled
from workbench.study.execute.run import StudyResult


def labelled_runs(result: StudyResult) -> list[Labelled]:
    """Each run that kept its signals, with its payload and reference."""
    return [
        Labelled(
            f"run_{row.reference}_{row.payload_kg:g}kg",
            {"run": row.run_id, "payload_kg": row.payload_kg, "reference": row.reference},
            result.runs[row.run_id],
        )
        for row in result.rows
        if row.run_id in result.runs
    ]
