"""What a batch's worker does: run the study, write what is downloaded."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from workbench.dashboard.jobs.progress import Teller
from workbench.reports.study import write_study_report
from workbench.study.batch import Progress, run_batch
from workbench.study.load import load_study
from workbench.study.rows import INDEX, read_table
from workbench.study.store import place_for, read_finished

RUNNING, WRITING = "runs", "report"
CSV, REPORT = "index.csv", "report.html"


def run(out: Path, tell: Teller, scenario: str) -> None:
    """Run the scenario of that file into `out`, beside which its index as CSV and its report come to lie.

    Goes on where an earlier call was stopped. InputError for a scenario that cannot be run.
    """
    from pyarrow.csv import write_csv

    study = load_study(scenario)
    place = place_for(study, out)
    if not place.finished:
        run_batch(study, place, tell=_telling(tell))
    runs = len(study.specs)
    failed = read_finished(out).manifest["runs"]["failed"]
    tell(WRITING, 0, 1, failed)
    write_csv(read_table(out / INDEX), out.parent / CSV)
    write_study_report(read_finished(out), out.parent / REPORT)
    tell(RUNNING, runs, runs, failed)


def _telling(tell: Teller) -> Callable[[Progress], None]:
    begun = time.monotonic()

    def told(progress: Progress) -> None:
        seconds = time.monotonic() - begun
        made = progress.done - progress.kept
        tell(RUNNING, progress.done, progress.runs, progress.failed, made / seconds if seconds > 0.1 else 0.0)

    return told
