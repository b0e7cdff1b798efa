"""A scenario file with its machine, checked as a whole before anything is run."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from workbench import __version__
from workbench.errors import InputError
from workbench.machine import Hoist, default_hoist, load_machine
from workbench.references import MotionPlan, allowed_carriage_speed_m_s, plan_motion
from workbench.study.scenario import Scenario
from workbench.yaml_strict import Document, load, validate

# Where plans and limits speak of a value by its own name, the file has it inside a block.
_INSIDE = {name: ("limits", name) for name in ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")}
# What decides a study's numbers: an edit of any of it makes another study.
_PHYSICS = ("control", "engine", "machine", "plants", "references", "simulate", "study", "trace", "metrics.py")


@dataclass(frozen=True)
class Study:
    """A scenario on its machine, with each reference's motion planned."""

    scenario: Scenario
    machine: Hoist
    plans: dict[str, MotionPlan]

    @property
    def duration_s(self) -> float:
        """All runs of a study are equally long, so that their root mean squares compare."""
        return max(plan.duration_s for plan in self.plans.values())

    @cached_property
    def scenario_hash(self) -> str:
        """Of what the scenario says, not of where its machine is kept."""
        return _digest(self.scenario.model_dump(mode="json", exclude={"machine"}))

    @cached_property
    def machine_hash(self) -> str:
        return _digest(self.machine.model_dump(mode="json"))

    @cached_property
    def fingerprint(self) -> str:
        """Equal for two studies that must give equal numbers: scenario, machine, program."""
        return _digest([self.scenario_hash, self.machine_hash, __version__, _program_hash()])


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study a scenario file describes.

    Raises InputError with file, line, place, value and remedy for a file that is not there, a key or value
    that does not fit, a machine that is no hoist, a move that leaves the rail, a speed the motor cannot reach.
    """
    document = load(path)
    scenario = validate(Scenario, document)
    machine = _machine(scenario, document)
    try:
        return plan_study(scenario, machine)
    except InputError as error:
        if error.file is not None:
            raise
        raise _located(error, document) from error


def plan_study(scenario: Scenario, machine: Hoist) -> Study:
    """A scenario on a machine; InputError where its motion is not possible on it."""
    limits = scenario.limits.limits()
    nominal = machine.motor.nominal_speed_rad_s
    allowed = allowed_carriage_speed_m_s(nominal, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    if limits.speed_m_s > allowed * (1.0 + 1e-9):
        raise InputError(
            f"{limits.speed_m_s:g} m/s turns the motor faster than its nominal {nominal:g} rad/s; "
            f"expected at most {_rounded_down(allowed):g} m/s",
            place="speed_m_s",
        )
    rail = (machine.rail.lowest_position_m, machine.highest_position_m)
    steps = [move.step() for move in scenario.moves]
    plans = {
        kind: plan_motion(kind, steps, scenario.start_position_m, limits, rail, scenario.lead_s, scenario.settle_s)
        for kind in scenario.references
    }
    study = Study(scenario, machine, plans)
    # A slip of a zero would fill the memory: the longest sensible duty cycle is an hour.
    if study.duration_s > 3600.0:
        raise InputError(f"the moves take {study.duration_s:.0f} s, expected at most 3600 s", place="moves")
    return study


def _machine(scenario: Scenario, document: Document) -> Hoist:
    if scenario.machine == "default":
        return default_hoist()
    path = document.file.parent / scenario.machine
    if not path.exists():
        raise InputError(
            f"no machine file {path}; expected a path beside the scenario, or 'default'",
            file=document.file,
            line=document.line(("machine",)),
            place="machine",
        )
    machine = load_machine(path)
    if not isinstance(machine, Hoist):
        raise InputError(
            f"{path} is a machine of kind 'axis'; a study expects kind 'hoist'",
            file=document.file,
            line=document.line(("machine",)),
            place="machine",
        )
    return machine


def _located(error: InputError, document: Document) -> InputError:
    """The error with the file and the line of its place."""
    place = _INSIDE.get(error.place or "", ())
    if not place and error.place:
        words = re.findall(r"[A-Za-z_]\w*|\d+", error.place)
        place = tuple(int(word) if word.isdigit() else word for word in words)  # type: ignore[assignment]
    shown = ".".join(place) if error.place in _INSIDE else error.place
    return InputError(error.problem, file=document.file, line=document.line(place), place=shown)


def _rounded_down(value: float) -> float:
    return int(value * 1000.0) / 1000.0


def _digest(data: object) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _program_hash() -> str:
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for part in _PHYSICS:
        entry = package / part
        for file in [entry] if entry.is_file() else sorted(entry.rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
