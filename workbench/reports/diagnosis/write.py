"""What `workbench diagnose` puts into --out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.diagnose.records import Diagnosis
from workbench.machine import save_machine
from workbench.reports.diagnosis.as_json import to_json
from workbench.reports.diagnosis.page import save_diagnosis_page
from workbench.whole_folder import check_free, whole_folder, write_json


def write_diagnosis(run: Callable[[], Diagnosis], folder: Path, say: Callable[[str], None] | None = None) -> Diagnosis:
    """Diagnose, and write diagnosis.json, machine.yaml (the corrected one) and diagnose.html: all of them or none.

    say: told what is done once the diagnosis itself is over.
    """
    check_free(folder)
    with whole_folder(folder) as hidden:
        found = run()
        if say is not None:
            say("writing the report")
        write_json(hidden / "diagnosis.json", to_json(found))
        save_machine(found.corrected, hidden / "machine.yaml")
        save_diagnosis_page(found, hidden / "diagnose.html")
    return found
