"""What the worker of a comparison of both models does: compare, write what is downloaded, and what the page shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workbench.dashboard.jobs.progress import Teller
from workbench.dashboard.section_file import write_section
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import of_kind, studied
from workbench.logs import read_campaign
from workbench.machine import load_machine
from workbench.reports.models.report import section_of, write_models
from workbench.simulate.models import ModelsCompared, compare_models

SHOWN = "models_section.json"


def run(
    out: Path, tell: Teller, *, folder: str, name: str, runs: Sequence[str], machine: str, source: str = ""
) -> None:
    """Compare both models on the chosen runs of the campaign in `folder`, called `name`, into `out`.

    machine: the text of a machine.yaml; source: what the page knows the campaign by. InputError for what cannot be
    compared, without the folder's path, which is the server's own.
    """
    given = out.parent / "machine.yaml"
    given.write_text(machine, encoding="utf-8")

    def compared() -> ModelsCompared:
        hoist = studied(load_machine(given, check_effects=check))
        campaign = read_campaign(folder, confined=True, check_effects=check)
        if hoist is None:
            raise InputError(f"is {of_kind(campaign.machine)}; the multi-body machine is a hoist")
        chosen = [run for run in campaign.runs if run.name in runs]
        told = iter(range(len(chosen)))
        return compare_models(
            hoist, chosen, progress=lambda of: tell(f"run {of} on both models", next(told), len(chosen))
        )

    try:
        result = write_models(compared, name, out)
    except InputError as error:
        file = None if error.file is None else Path(error.file).name
        problem = error.problem.replace(f"{folder}/", "")
        raise InputError(problem, file=file, line=error.line, place=error.place) from error
    write_section(section_of(result), out.parent / SHOWN)
