"""A controller's files: C99, structured text with PLCopen XML, or a drive's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from workbench import __version__
from workbench.control import PiSettings
from workbench.core.whole_folder import check_free, whole_folder
from workbench.core.yaml_strict import Document, dumps, load, validate
from workbench.export.controller_program import checked
from workbench.export.controller_text import controller_texts, record_csv
from workbench.export.drives import DriveSettings, RampLimits, drive_settings
from workbench.machines import Hoist
from workbench.study.scenario import LimitsBlock

Form = Literal["st", "c", "yaml"]


def controller_files(
    form: Form,
    settings: PiSettings,
    machine: Hoist,
    payload_kg: float = 0.0,
    drive: str = "generic",
    ramp: RampLimits | None = None,
) -> dict[str, str]:
    """File name -> text."""
    if form == "yaml":
        return {"drive_parameters.yaml": settings_text(drive_settings(drive, settings, machine, payload_kg, ramp))}
    program, record = checked(settings, machine, payload_kg)
    name = machine.name.replace("*", " ").replace("\n", " ")  # ends no comment
    title = f"Sampled PI speed controller for {name}, by workbench {__version__}"
    return {"test_record.csv": record_csv(record), **controller_texts(form, title, program, record, __version__)}


def settings_text(made: DriveSettings) -> str:
    """The parameters as YAML, with what differs."""
    parameters = {
        s.number: {
            "name": s.name, "value": float(f"{s.value:.6g}"), "unit": s.unit, "why": s.why,
            **({"source": s.source} if s.source else {}),
        }
        for s in made.settings
    }  # fmt: skip
    data = {"drive": made.drive, "manual": made.manual, "drives": made.drives, "parameters": parameters}
    return dumps({**data, "differs": list(made.differs)})


def write_controller(files: Mapping[str, str], out: Path) -> None:
    """A new folder with the files, whole or not at all. InputError where it is not free."""
    check_free(out)
    with whole_folder(out) as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")


def ramp_of(path: Path) -> RampLimits | None:
    """The limits of a scenario's motion, both ways alike; None for a file without them."""
    document = load(path)
    block = document.data.get("limits") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        return None
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("limits",)}
    limits = validate(LimitsBlock, Document(document.file, block, inside))
    if limits.speed_m_s is None or limits.acceleration_m_s2 is None:
        return None
    return RampLimits(limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
