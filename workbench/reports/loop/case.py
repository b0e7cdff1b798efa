"""The input of `loop` and `tune`: machine, controller, payloads and heights from the options of the command."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.analysis.usual import usual_controller, usual_heights, usual_settings
from workbench.control import FORMS, SETTINGS, Events, PiSettings, Settings, form_of
from workbench.core.errors import InputError
from workbench.core.yaml_strict import Document, load, validate
from workbench.effects import check
from workbench.machines import LOOPED, AnyKind, Axis, Hoist, default_hoist, kind_of, load_machine, looped, of_kind

if TYPE_CHECKING:
    from workbench.analysis.tune import Trial
    from workbench.study.load import Study

__all__ = [
    "MOST",
    "USUAL_PAYLOADS_KG",
    "LoopCaseFile",
    "load_case",
    "loop_case",
    "numbers",
    "read_controller",
    "read_settings",
    "usual_controller",
    "usual_heights",
]
USUAL_PAYLOADS_KG = (0.0, 4500.0, 9000.0)
MOST = 50  # members of a family


@dataclass(frozen=True, eq=False)
class LoopCaseFile:
    """A machine with its drive, a controller with its source, the family, and the study if there is one."""

    machine: AnyKind
    settings: Settings
    origin: str
    payloads_kg: tuple[float, ...]
    heights_m: tuple[float, ...]
    study: Study | None

    @property
    def events(self) -> Events:
        """The events of the scenario; none without a scenario."""
        return Events() if self.study is None else self.study.scenario.events

    def trial(self) -> Trial:
        """The moves and events of the scenario under this family's payloads, or the usual moves."""
        from workbench.analysis.tune import Trial, usual_trial

        if self.study is None:
            return usual_trial(self.machine, self.payloads_kg, self.settings.sample_time_s)
        from workbench.analysis.tune import motions

        dt, length, first = self.settings.sample_time_s, self.study.duration_s, self.study.specs[0]
        speeds, positions = motions(self.machine, self.study.plans, dt, length)
        start, events, step_s = first.start_position_m, first.events, first.step_s
        return Trial(self.machine, self.payloads_kg, start, speeds, events, step_s, positions)


def load_case(
    machine: Path | None,
    scenario: Path | None,
    controller: Path | None,
    payloads_kg: Sequence[float] | None,
    heights_m: Sequence[float] | None,
) -> LoopCaseFile:
    """InputError with file and place for input that cannot be read or does not fit."""
    known: Hoist | Axis | None = None
    if machine is not None:
        read = load_machine(machine, check_effects=check)
        known = looped(read)
        if known is None:
            raise InputError(f"is {of_kind(read)}; a loop is analysed for {LOOPED}", file=machine)
    given = None if controller is None else (read_settings(controller), f"of {controller}")
    return loop_case(known, given, payloads_kg, heights_m, scenario)


def loop_case(
    machine: Hoist | Axis | None,
    controller: tuple[Settings, str] | None,
    payloads_kg: Sequence[float] | None,
    heights_m: Sequence[float] | None,
    scenario: str | os.PathLike[str] | None,
) -> LoopCaseFile:
    """The case of these values. None: the value of the scenario, otherwise the default.

    controller: the settings, and their source in words.
    """
    study: Study | None = None
    loads: Sequence[float] | None = None
    if scenario is not None:
        from workbench.study.load import load_study

        study = load_study(scenario)
        # What the scenario itself says; a sweep's or a sample's points go their own ways from there.
        controller = controller or (study.scenario.controller, f"of {scenario}")
        machine = study.machine if machine is None else machine
        loads = sorted({spec.payload_kg for spec in study.specs[:200]})
    machine = default_hoist() if machine is None else machine
    settings, origin = controller or usual_settings(machine)
    kind = kind_of(machine)
    if not isinstance(settings, SETTINGS[kind.name]):
        wants = " and ".join(SETTINGS[kind.name].GAINS)
        raise InputError(
            f"the controller {origin} is of kind '{settings.kind}' with {' and '.join(settings.GAINS)}; "
            f"{of_kind(machine)} takes kind '{SETTINGS[kind.name].model_fields['kind'].default}' with {wants}",
            place="controller",
        )
    if loads is None:
        loads = USUAL_PAYLOADS_KG if kind.payload else (0.0,)
    wanted = tuple(loads if payloads_kg is None else payloads_kg)
    places = tuple(usual_heights(machine) if heights_m is None else heights_m)
    if len(wanted) * len(places) > MOST:
        raise InputError(f"{len(wanted)} payloads at {len(places)} heights, expected at most {MOST} loops in all")
    return LoopCaseFile(machine, settings, origin, wanted, places, study)


def read_settings(path: Path) -> Settings:
    """The `controller` block of a file, of any kind of machine: an output of tune, or a scenario."""
    document = load(path)
    block = document.data.get("controller") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        raise InputError("holds no block 'controller'", file=path)
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("controller",)}
    return validate(FORMS[form_of(block)], Document(document.file, block, inside))


def read_controller(path: Path) -> PiSettings:
    """The same of a hoist. InputError where it is an axis'."""
    settings = read_settings(path)
    if not isinstance(settings, PiSettings):
        raise InputError(f"holds an axis' controller, kind {settings.kind!r}; expected a hoist's", file=path)
    return settings


def numbers(text: str, place: str) -> tuple[float, ...]:
    """The numbers of `0,4500,9000` in their order, without repetitions."""
    try:
        values = tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError as error:
        raise InputError(f"'{text}', expected numbers with commas between, such as 0,4500,9000", place=place) from error
    if not all(math.isfinite(x) for x in values):
        raise InputError(f"'{text}', expected finite numbers", place=place)
    return values
