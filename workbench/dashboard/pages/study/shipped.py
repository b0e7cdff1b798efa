"""The scenarios that ship, as the page Study loads them: with what they extend, without what makes a batch of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from workbench.dashboard.machines import AXIS, DEFAULT
from workbench.dashboard.pages.batches.choose import shipped
from workbench.dashboard.pages.study.axis.desk import AxisDesk, axis_desk_of
from workbench.dashboard.pages.study.controls import START, Desk, desk_of
from workbench.errors import InputError
from workbench.kinds import of_kind, studied
from workbench.machine import SHIPPED, Axis, Hoist, default_hoist
from workbench.machine import shipped as shipped_machine
from workbench.study.load import changed, load_study, read_standalone, standalone_text
from workbench.yaml_strict import loads

SHIPPED_NONE = "choose one"


def shipped_names() -> list[str]:
    return list(shipped())


def shipped_files() -> Mapping[str, Path]:
    """What an uploaded scenario may extend: file name -> file."""
    return {file.name: file for file in shipped().values()}


def shipped_desk(name: str, machine: Hoist | Axis) -> tuple[Desk | AxisDesk, str]:
    """The controls as a shipped scenario sets them: on its own machine where it names one, at its base values where
    it sweeps or draws some. Beside them the name of the machine to go over to, "" for the one that is chosen.
    InputError for one that no control shows."""
    study = load_study(shipped()[name])
    scenario = study.scenario
    if (hoist := studied(study.machine)) is None:
        axis = shipped_machine(scenario.machine) if scenario.machine in SHIPPED else None
        if axis is None or studied(axis) is not None:
            raise InputError(f"is a study of {of_kind(study.machine)} in a file of its own; run it as a batch")
        return axis_desk_of(changed(scenario, {"sweep": None, "sample": None}), cast(Axis, axis)), AXIS
    other = "" if studied(machine) is not None else DEFAULT
    machine = studied(machine) or default_hoist()
    if scenario.machine != "default":  # its values as overrides: the page's machine is another choice
        scenario = read_standalone(loads(standalone_text(scenario, hoist), f"{name}.yaml"))
    payloads = scenario.payloads_kg or START.payloads_kg  # those of a sweep go with it
    return desk_of(changed(scenario, {"sweep": None, "sample": None, "payloads_kg": payloads}), machine), other
