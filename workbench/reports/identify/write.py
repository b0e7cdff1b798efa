"""What `workbench identify` puts into --out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.identify.identify import Identification
from workbench.machine import save_machine
from workbench.reports.identify import report
from workbench.reports.identify.page import save_identify_page
from workbench.reports.replay import report as replay_report
from workbench.whole_folder import check_free, whole_folder, write_json


def write_identification(run: Callable[[], Identification], folder: Path) -> Identification:
    """Identify, and write machine.yaml, replay.json for that machine, identify.json and identify.html."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        found = run()
        save_machine(found.machine, hidden / "machine.yaml")
        write_json(hidden / "replay.json", replay_report.to_json(report.as_campaign(found), found.after))
        write_json(hidden / "identify.json", report.to_json(found))
        save_identify_page(found, hidden / "identify.html")
    return found
