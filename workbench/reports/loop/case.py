"""The input of `loop` and `tune`: machine, controller, payloads and heights from the options of the command."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.analysis.usual import USUAL_CROSSOVER_HZ, usual_controller, usual_heights
from workbench.control import Events, PiSettings
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import STUDIED, of_kind, studied
from workbench.machine import Hoist, default_hoist, load_machine
from workbench.yaml_strict import Document, load, validate

if TYPE_CHECKING:
    from workbench.analysis.trial import Trial
    from workbench.study.scenario.load import Study

USUAL_PAYLOADS_KG = (0.0, 4500.0, 9000.0)
MOST = 50  # members of a family


@dataclass(frozen=True, eq=False)
class LoopCaseFile:
    """A machine with its drive, a controller with its source, the family, and the study if there is one."""

    machine: Hoist
    settings: PiSettings
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
        from workbench.analysis.trial import Trial, usual_trial

        if self.study is None:
            return usual_trial(self.machine, self.payloads_kg, self.settings.sample_time_s)
        from workbench.references import motor_speed_rad_s

        ratio, drum = self.machine.gearbox.ratio, self.machine.winch.drum_diameter_m
        dt, length = self.settings.sample_time_s, self.study.duration_s
        speeds = {
            kind: motor_speed_rad_s(plan.sample(dt, length).speed_m_s, ratio, drum)
            for kind, plan in self.study.plans.items()
        }
        n = min(len(speed) for speed in speeds.values())
        first = self.study.specs[0]
        references = {kind: speed[:n] for kind, speed in speeds.items()}
        return Trial(self.machine, self.payloads_kg, first.start_position_m, references, first.events, first.step_s)


def load_case(
    machine: Path | None,
    scenario: Path | None,
    controller: Path | None,
    payloads_kg: Sequence[float] | None,
    heights_m: Sequence[float] | None,
) -> LoopCaseFile:
    """InputError with file and place for input that cannot be read or does not fit."""
    hoist: Hoist | None = None
    if machine is not None:
        read = load_machine(machine, check_effects=check)
        hoist = studied(read)
        if hoist is None:
            raise InputError(f"is {of_kind(read)}; a speed loop is analysed for {STUDIED}", file=machine)
    given = None if controller is None else (read_controller(controller), f"of {controller}")
    return loop_case(hoist, given, payloads_kg, heights_m, scenario)


def loop_case(
    machine: Hoist | None,
    controller: tuple[PiSettings, str] | None,
    payloads_kg: Sequence[float] | None,
    heights_m: Sequence[float] | None,
    scenario: str | os.PathLike[str] | None,
) -> LoopCaseFile:
    """The case of these values. None: the value of the scenario, otherwise the default.

    controller: the settings, and their source in words.
    """
    study: Study | None = None
    loads: Sequence[float] = USUAL_PAYLOADS_KG
    if scenario is not None:
        from workbench.study.scenario.load import load_study

        study = load_study(scenario)
        # What the scenario itself says; a sweep's or a sample's points go their own ways from there.
        controller = controller or (study.scenario.controller, f"of {scenario}")
        machine = study.machine if machine is None else machine
        loads = sorted({spec.payload_kg for spec in study.specs[:200]})
    machine = default_hoist() if machine is None else machine
    settings, origin = controller or (usual_controller(machine), f"by rule: crossover about {USUAL_CROSSOVER_HZ:g} Hz")
    wanted = tuple(loads if payloads_kg is None else payloads_kg)
    places = tuple(usual_heights(machine) if heights_m is None else heights_m)
    if len(wanted) * len(places) > MOST:
        raise InputError(f"{len(wanted)} payloads at {len(places)} heights, expected at most {MOST} loops in all")
    return LoopCaseFile(machine, settings, origin, wanted, places, study)


def read_controller(path: Path) -> PiSettings:
    """The `controller` block of a file: an output of tune, or a scenario."""
    document = load(path)
    block = document.data.get("controller") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        raise InputError("holds no block 'controller'", file=path)
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("controller",)}
    return validate(PiSettings, Document(document.file, block, inside))


def numbers(text: str, place: str) -> tuple[float, ...]:
    """The numbers of `0,4500,9000` in their order, without repetitions."""
    try:
        values = tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError as error:
        raise InputError(f"'{text}', expected numbers with commas between, such as 0,4500,9000", place=place) from error
    if not all(math.isfinite(x) for x in values):
        raise InputError(f"'{text}', expected finite numbers", place=place)
    return values
