"""The controller and its reference in the parameters of drives with a speed controller of their own: drives.yaml."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from jinja2 import Environment, StrictUndefined

from workbench.control import PiSettings, feed_forward
from workbench.core.yaml_strict import Document, dumps, load, validate
from workbench.export.controller_program import check_exported
from workbench.machines import HOIST, Hoist
from workbench.references import Limits
from workbench.study.scenario import LimitsBlock

DRIVES = ("siemens-s120", "abb-acs880", "generic")
_JINJA = Environment(undefined=StrictUndefined)


def ramp_of(path: Path) -> Limits | None:
    """The limits of a scenario's motion, both ways alike; None for a file without them."""
    document = load(path)
    block = document.data.get("limits") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        return None
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("limits",)}
    given = validate(LimitsBlock, Document(document.file, block, inside)).given()
    return Limits(**given) if {"speed_m_s", "acceleration_m_s2"} <= given.keys() else None


@cache
def _table() -> dict[str, Any]:
    data = load(Path(__file__).with_name("drives.yaml")).data
    assert isinstance(data, dict) and tuple(data["drives"]) == DRIVES
    return data


def drive_settings(
    drive: str, settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, ramp: Limits | None = None
) -> dict[str, Any]:
    """The parameters of one drive, each motor on its own: gains and inertia are divided by the number of motors; and
    what that drive's controller does not do as the exported one. KeyError for a drive that is not among DRIVES."""
    check_exported(settings)
    motor, p = machine.motor, vars(HOIST.plant.values(machine, payload_kg))
    fed = {**p, "ff_J": 1.0, "ff_w": 0.0, "ff_F": 0.0, "T_hold": 0.0}
    ki, top = settings.ki_nm_per_rad, motor.nominal_speed_rad_s
    names = {
        "drive": drive, "s": settings, "ramp": ramp, "motors": motor.count, "rpm": 60.0 / (2.0 * math.pi), "top": top,
        "kp": settings.kp_nm_s_per_rad / motor.count, "ki": ki / motor.count, "rotor": motor.rotor_inertia_kg_m2,
        "integral_time_s": settings.kp_nm_s_per_rad / ki if ki > 0.0 else 0.0, "nominal": motor.nominal_torque_nm,
        "inertia": float(feed_forward(SimpleNamespace(**fed), 0.0, 1.0)) / motor.count,
        "overload": machine.drive.overload, "filtered_s": machine.drive.speed_filter_s,
    }  # fmt: skip
    if ramp is not None:
        names["ramp_time_s"] = top * machine.lift_m_per_rad / ramp.acceleration_m_s2
        names["rounding_time_s"] = ramp.acceleration_m_s2 / ramp.jerk_m_s3

    def value(text: Any) -> Any:
        return _JINJA.compile_expression(str(text), undefined_to_none=False)(names)

    table = _table()
    parameters = {
        row["number"]: {
            "name": row["name"], "value": float(value(row["value"])), "unit": row.get("unit", ""), "why": row["why"],
            **({"source": table["sources"][row["source"]]} if "source" in row else {}),
        }
        for row in table["drives"][drive]["parameters"] if value(row.get("when", True))
    }  # fmt: skip
    differs = [_JINJA.from_string(row["say"]).render(names) for row in table["differs"] if value(row["when"])]
    head = {"drive": drive, "manual": table["drives"][drive]["manual"], "drives": motor.count}
    return {**head, "parameters": parameters, "differs": differs}


def settings_text(made: dict[str, Any]) -> str:
    """The parameters as YAML, with what differs; values of six digits."""
    rounded = {n: {**row, "value": float(f"{row['value']:.6g}")} for n, row in made["parameters"].items()}
    return dumps({**made, "parameters": rounded})
