"""A scenario file with those that it extends, as one: whose each value is stays known, for errors and for paths."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from workbench import __version__, machines
from workbench.core.errors import InputError, nearest
from workbench.core.shown import Brief
from workbench.core.yaml_strict import Document, Place, checked, dotted, dumps, load, problem_lines, put, together
from workbench.effects import check
from workbench.effects.registry import digests_of
from workbench.machines import Machine
from workbench.metrics import added, set_of
from workbench.references import Plan
from workbench.references.kind import digests_of as digests_of_references
from workbench.study.decide import criteria_for
from workbench.study.grid import Recording, RunList, plan_runs
from workbench.study.scenario import RecordedBlock, Scenario, check_kind

LONGEST_CHAIN = 10
OVERRIDES = "machine_overrides"  # whose values are names with dots in them: written as blocks they mean the same


@dataclass(frozen=True)
class Layered:
    """A scenario after all merging. chain: file and line of each place in it, the outermost first."""

    data: dict[str, Any]
    chain: tuple[tuple[Path, Mapping[Place, int]], ...]

    def at(self, place: Place) -> tuple[Path, int | None]:
        """File and line of a place, or of the nearest block around it."""
        for end in range(len(place), 0, -1):
            for file, lines in self.chain:
                if place[:end] in lines:
                    return file, lines[place[:end]]
        return self.chain[0][0], None if place else 1

    def keys_in_same_file(self, place: Place) -> set[str]:
        """The keys of a place's block that stand in the same file as the place itself."""
        block: Any = self.data
        for part in place[:-1]:
            block = block[part]
        mine, keys = self.at(place)[0], block if isinstance(block, dict) else ()
        return {str(key) for key in keys if self.at((*place[:-1], key))[0] == mine}

    def error(self, problem: str, place: Place) -> InputError:
        file, line = self.at(place)
        return InputError(problem, file=file, line=line, place=dotted(place) or None)


def read_layers(path: str | os.PathLike[str]) -> Layered:
    """A scenario file over what it extends: blocks are merged key by key, everything else is replaced.

    Raises InputError for a file that cannot be read, a circle, a chain of more than ten.
    """
    chain: list[Layered] = []
    seen: list[Path] = []
    file = Path(path)
    while True:
        layer = layer_of(load(file))
        chain.append(layer)
        seen.append(file.resolve())
        extended = layer.data.pop("extends", None)
        if extended is None:
            return merged(chain)
        if not isinstance(extended, str) or not extended:
            raise layer.error(f"{extended!r}, expected the path of a scenario file, seen from this one", ("extends",))
        if "\0" in extended:
            raise layer.error("is not a path", ("extends",))
        file = file.parent / extended
        if not os.path.isfile(file):  # False, too, for a name that no file can have
            raise layer.error(f"no scenario file {file}; expected a path seen from this file", ("extends",))
        if file.resolve() in seen:
            circle = " extends ".join(path.name for path in [*seen, file])
            raise layer.error(f"goes in a circle: {circle}", ("extends",))
        if len(seen) >= LONGEST_CHAIN:
            raise layer.error(f"is a chain of more than {LONGEST_CHAIN} files", ("extends",))


def merged(chain: Sequence[Layered]) -> Layered:
    """Layers as one, the outermost first."""
    data: dict[str, Any] = {}
    for layer in reversed(chain):
        data = _merged(data, layer.data)
    return Layered(data, tuple(one for layer in chain for one in layer.chain))


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    both = {key: _merged(old[key], new[key]) for key in old.keys() & new.keys()
            if isinstance(old[key], dict) and isinstance(new[key], dict)}  # fmt: skip
    return {**old, **new, **both}


def layer_of(document: Document) -> Layered:
    """One document by itself, what it extends aside. InputError where it is no block of keys."""
    if not isinstance(document.data, dict):
        line = document.line(())
        raise InputError("is not a block of keys; expected a scenario", file=document.file, line=line)
    lines = {place: line for place, line in document.lines.items() if place}
    layer = Layered(dict(document.data), ((document.file, lines),))
    if isinstance(block := layer.data.get(OVERRIDES), dict):
        layer.data[OVERRIDES] = flat = dict[str, Any]()
        for place, value in _values(block, (OVERRIDES,)):
            name = ".".join(map(str, place[1:]))
            if name in flat:
                raise layer.error(f"'{name}' is set twice, in a block and by its dotted name", place)
            flat[name] = value
            lines[OVERRIDES, name] = layer.at(place)[1] or 1
    return layer


def _values(block: Mapping[str, Any], place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """What is no block, with its place."""
    for key, value in block.items():
        yield from _values(value, (*place, key)) if isinstance(value, Mapping) else [((*place, key), value)]


def _dotted_values(block: Mapping[str, Any]) -> dict[str, Any]:
    return {".".join(map(str, place)): value for place, value in _values(block)}


# What decides a study's numbers: an edit of any of it makes another study.
_PHYSICS = ("control", "effects", "engine", "machines", "metrics", "references", "simulate", "study", "symbolic")


@dataclass(frozen=True, repr=False)
class Study(Brief):
    """A scenario on its machine (overrides, drive and effects in it). recordings: of its recorded references."""

    scenario: Scenario
    machine: machines.AnyKind
    recordings: Mapping[str, Recording] = field(default_factory=dict)

    @cached_property
    def specs(self) -> RunList:
        """All runs, made when asked for."""
        return plan_runs(self.scenario, self.machine, self.recordings)

    @cached_property
    def plans(self) -> dict[str, Plan]:
        """Each reference's motion at the first point of sweep and sample."""
        first = self.specs[: len(self.scenario.kinds)]
        return {spec.reference: spec.plan() for spec in first}

    @property
    def duration_s(self) -> float:
        """All runs of a study are equally long, so that their root mean squares compare."""
        return self.specs.duration_s

    @cached_property
    def scenario_hash(self) -> str:
        """Of what the scenario says, not of where its machine and its campaigns are kept."""
        said = self.scenario.model_dump(mode="json", exclude={"machine", "extends"})
        for reference in said["references"]:
            if isinstance(reference, dict):
                del reference["campaign"]
        return _digest([said, {label: recording.digest for label, recording in sorted(self.recordings.items())}])

    @cached_property
    def machine_hash(self) -> str:
        return _digest(self.machine.model_dump(mode="json"))

    @property
    def effects_digests(self) -> dict[str, str]:
        """Effect -> digest of the text that declares it, of effects that are a user's own, as they are known now."""
        return digests_of(self.machine.effects, machines.kind_of(self.machine).name)

    @cached_property
    def fingerprint(self) -> str:
        """Equal for two studies that must give equal numbers: scenario, machine, program, added effects, metrics."""
        parts = [self.scenario_hash, self.machine_hash, __version__, _program_hash(), self.effects_digests]
        own_metrics = [[metric.name, metric.definition] for metric in added()]
        own = [part for part in (digests_of_references(self.scenario.planned_kinds), own_metrics) if part]
        return _digest([*parts, *own])


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study a scenario file describes, with what it extends.

    Raises InputError with file, line, place, value and remedy for a file that is not there, a key or value
    that does not fit, a machine that is no hoist, a move that leaves the rail, a speed the motor cannot reach.
    """
    layers = read_layers(path)
    scenario = scenario_of(layers)
    machine = _machine(scenario, layers)
    return planned(scenario, machine, _recordings(scenario, layers), layers)


def planned(scenario: Scenario, machine: Machine, recordings: Mapping[str, Recording], layers: Layered) -> Study:
    """`plan_study`, with file and line of what does not fit."""
    try:
        return plan_study(scenario, machine, recordings)
    except InputError as error:
        if error.file is not None:
            raise
        place, shown = _place_of(error.place or "", layers.data)
        file, line = layers.at(place)
        raise InputError(error.problem, file=file, line=line, place=shown or None) from error


def plan_study(scenario: Scenario, machine: Machine, recordings: Mapping[str, Recording] | None = None) -> Study:
    """A scenario on a machine; InputError where what it needs is missing or its motion is not possible."""
    sweep, sample = scenario.sweep, scenario.sample
    swept = set() if sweep is None else {*sweep.grid, *sweep.zip}
    varied = swept | (set() if sample is None else set(sample.values))
    check_kind(scenario, machine, varied)
    kind, listed, planned = machines.kind_of(machine), scenario.payloads_kg is not None, bool(scenario.planned_kinds)
    start = f"start_position_{kind.moved.unit}"
    no_limits = not scenario.limits.model_fields_set and not any(name.startswith("limits.") for name in varied)
    for is_so, problem, place in (
        (kind.payload and not listed and "payload_kg" not in varied, "is missing; expected a list of numbers, in kg",
         "payloads_kg"),
        (listed and "payload_kg" in swept, "is listed while sweep names payload_kg; give one of them", "payloads_kg"),
        (planned and not scenario.moves, "is missing; expected a list of moves", "moves"),
        (planned and no_limits, "is missing; expected a block of limits", "limits"),
        (planned and scenario.start is None and start not in varied,
         f"is missing; expected {kind.looped.start}, a number", start),
        (scenario.plant != "multibody" and scenario.events.arm_moves_s is not None,
         "moves the arm, which only the multi-body machine has; expected plant: multibody", "events"),
    ):  # fmt: skip
        if is_so:
            raise InputError(problem, place=place)
    study = Study(scenario, _machine_as_run(scenario, machine), recordings or {})
    if scenario.plant == "multibody":
        from workbench.simulate.models import check_multibody

        try:
            check_multibody(study.machine, scenario.events.arm_reach_m)
        except InputError as error:
            place = error.place if error.place == "events.arm_reach_m" else "plant"
            raise InputError(error.problem, place=place) from error
    assert study.specs.duration_s > 0.0  # made here, so that what is wrong is said now
    study.plans  # noqa: B018
    criteria_for(set_of(kind.name), study.machine, 0.0, scenario.decide)
    return study


def scenario_of(layers: Layered) -> Scenario:
    """InputError for up to five problems, each with its own file and line."""
    try:
        return Scenario.model_validate(layers.data)
    except ValidationError as error:
        raise together(
            layers.error(*_clearer(text, place, layers.data))
            for place, text in problem_lines(Scenario, error, layers.data, layers.keys_in_same_file)
        ) from error


def _clearer(text: str, place: Place, data: Any) -> tuple[str, Place]:
    """Without the names of a union's members, and with the keys of a range where one is misspelt."""
    if place[:1] in (("sweep",), ("references",)) and place[-1] in ("list", "range", "recorded", "kind"):
        for part in place[:-1]:
            data = data[part]
        place = place if isinstance(data, dict) and place[-1] in data else place[:-1]
    if place[:1] == ("sweep",) and len(place) > 2 and text.startswith("unknown key"):
        text = f"unknown key '{place[-1]}'; {nearest(str(place[-1]), ('from', 'to', 'steps', 'step', 'scale'))}"
    return text, place


def _machine(scenario: Scenario, layers: Layered) -> Machine:
    """The machine a scenario names, as its file has it."""
    if scenario.machine in machines.SHIPPED:
        return machines.shipped(scenario.machine)
    path = layers.at(("machine",))[0].parent / scenario.machine
    if "\0" in scenario.machine or not os.path.exists(path):
        known = " or ".join(map(repr, machines.SHIPPED))
        raise layers.error(
            f"no machine file {str(path)!r}; expected a path beside the scenario, or {known}", ("machine",)
        )
    read = machines.load_machine(path, check_effects=check)
    machine = machines.looped(read)
    if machine is None:
        raise layers.error(f"{path} is {machines.of_kind(read)}; a study expects {machines.LOOPED}", ("machine",))
    return machine


def _machine_as_run(scenario: Scenario, machine: Machine) -> Machine:
    """The machine with overrides, drive and effects of the scenario. InputError names the place in the scenario."""
    data = machine.model_dump()
    known = _dotted_values({k: v for k, v in data.items() if k not in ("effects", "identified", "format", "kind")})
    for name, value in scenario.machine_overrides.items():
        if name not in known or isinstance(value, list):
            hint = nearest(name, known)
            hint = hint if hint.startswith("did") else "expected a dotted name such as wire.segment_length_m"
            raise InputError(f"the machine has no value '{name}'; {hint}", place=f"machine_overrides.{name}")
        put(data, tuple(name.split(".")), value)
    changes = {} if scenario.drive is None else scenario.drive.model_dump(exclude_none=True)
    if wrong := [key for key in changes if key not in data["drive"]]:
        keys = type(machine.drive).model_fields
        raise InputError(f"{machines.of_kind(machine)} has no '{wrong[0]}'; {nearest(wrong[0], keys)}", place="drive")
    data["drive"] |= changes
    data["effects"] = {name: dict(values) for name, values in machine.effects.items()} | scenario.effects
    try:
        as_run = checked(type(machine), data)
    except InputError as error:
        name = error.place or "?"
        named = next((override for override in scenario.machine_overrides if override.startswith(name)), None)
        where = name if name.startswith(("drive", "effects")) else "machine_overrides"
        raise InputError(error.problem, place=f"machine_overrides.{named}" if named else where) from error
    check(as_run)
    return as_run


def _recordings(scenario: Scenario, layers: Layered) -> dict[str, Recording]:
    """The recorded references, read from their campaigns."""
    recordings: dict[str, Recording] = {}
    for number, reference in enumerate(scenario.references):
        if not isinstance(reference, str):
            place: Place = ("references", number, "campaign")
            recordings[reference.label] = read_recording(reference, layers.at(place)[0].parent, layers, place)
    return recordings


def _place_of(place: str, data: Mapping[str, Any]) -> tuple[Place, str]:
    """A place that planning and expanding name, as keys of the file: fields that are swept have dots in them."""
    for head in ("sweep.zip.", "sweep.", "sample.values.", "machine_overrides."):
        if place.startswith(head):
            name, number = place[len(head) :], None
            if (indexed := re.fullmatch(r"(.*)\[(\d+)\]", name)) and head.startswith("sweep"):
                name, number = indexed[1], int(indexed[2])
            keys: Place = (*head[:-1].split("."), name)
            if number is not None:
                keys = (*keys, number)
            return keys, place
    words = re.findall(r"[A-Za-z_]\w*|\d+", place)
    keys = tuple(int(word) if word.isdigit() else word for word in words)
    if keys[:1] and keys[0] in ("speed_m_s", "acceleration_m_s2", "jerk_m_s3"):
        keys, place = ("limits", *keys), f"limits.{place}"
    # A direction's limit may stand beside the directions, for both.
    if len(keys) == 3 and keys[0] == "limits" and keys[2] not in (data.get("limits") or {}).get(keys[1], {}):
        keys = ("limits", keys[2])
    return keys, place


def _digest(data: object) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _program_hash() -> str:
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for part in _PHYSICS:
        entry = package / part
        for file in [entry] if entry.is_file() else sorted(entry.rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def read_recording(block: RecordedBlock, folder: Path, layers: Layered, place: Place) -> Recording:
    """The run that a reference names. Its motor speed becomes the carriage's by its own machine's drum and gearbox.

    folder: of the file that names it. place: of the campaign there, for errors. InputError where the campaign
    cannot be read or is of no hoist.
    """
    path = folder / block.campaign
    if "\0" in block.campaign or not os.path.exists(path):
        raise layers.error(f"no campaign {str(path)!r}; expected a folder, seen from this file", place)
    try:
        from workbench.logs import read_campaign

        campaign = read_campaign(path, select=[block.run])
    except InputError as error:
        if error.file is not None:
            raise
        raise layers.error(str(error), place) from error
    machine = machines.studied(campaign.machine)
    if machine is None:
        raise layers.error(
            f"{path} holds runs of {machines.of_kind(campaign.machine)}; a study expects {machines.STUDIED}", place
        )
    run = campaign.runs[0]
    signal = "speed_reference_rad_s" if "speed_reference_rad_s" in run else "speed_motor_rad_s"
    speed = run[signal] * machine.lift_m_per_rad
    if len(run.time_s) < 2 or not np.all(np.isfinite(speed)):
        raise layers.error(f"run '{block.run}' has gaps in {signal}; choose another run", place)
    # Its number is kept short by what it is: two references that differ in any sample differ here.
    digest = hashlib.sha256(run.time_s.tobytes() + speed.tobytes()).hexdigest()[:16]
    return Recording(block.label, run.time_s, speed, run.start_position_m, block.smoothing_s or 0.0, digest)


_NOT_VALUES = ("format", "kind", "drive", "effects", "allowances", "log", "identified")


def read_standalone(
    document: Document, machine: Machine | None = None, known: Mapping[str, Path] | None = None
) -> Scenario:
    """The scenario of a document, checked on its machine as `workbench study` checks it.

    machine: stands for the machine that the scenario names. known: file name -> scenario that it may extend, those
    that ship. InputError, with the line, for whatever is wrong with it, and for what it takes from other files:
    `extends`, recorded references, a machine where none is given.
    """
    layers = layer_of(document)
    if (extended := layers.data.pop("extends", None)) is not None:
        base = (known or {}).get(str(extended).rpartition("/")[2])
        if base is None:
            there = f"one that stands alone or extends one of {', '.join(known)}" if known else "one that stands alone"
            raise layers.error(f"another file, which is not here; expected a scenario, {there}", ("extends",))
        layers = merged([layers, read_layers(base)])
    scenario = scenario_of(layers)
    for number, reference in enumerate(scenario.references):
        if not isinstance(reference, str):
            raise layers.error("a recorded campaign, which is not here", ("references", number))
    if scenario.machine not in machines.SHIPPED and machine is None:
        said = f"{scenario.machine!r} is another file, which is not here; choose that machine first, or write 'default'"
        raise layers.error(said, ("machine",))
    planned(scenario, machine or machines.shipped(scenario.machine), {}, layers)
    return scenario


def changed(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """The scenario with other values at its top level, checked like a file. InputError names the key."""
    return checked(Scenario, scenario.model_dump() | dict(changes))


def standalone_text(scenario: Scenario, machine: Machine, called: str = "default") -> str:
    """The scenario on this machine as YAML that needs no other file: a hoist's own values are overrides; any other
    machine is named as it is `called`.

    Reading it gives the same runs. What an empty block or a missing value says is left out.
    """
    data = scenario.model_dump(mode="json", exclude={"extends"}, exclude_none=True)
    data["machine"] = called
    data["limits"] = {key: value for key, value in data["limits"].items() if value != {}}
    if not isinstance(machine, machines.Hoist):
        return dumps({key: value for key, value in data.items() if value not in ({}, "")})
    default, own = (
        _dotted_values(one.model_dump(exclude=set(_NOT_VALUES))) for one in (machines.default_hoist(), machine)
    )
    differing = {name: value for name, value in own.items() if value != default[name]}
    data["machine_overrides"] = differing | dict(scenario.machine_overrides)
    usual = machines.default_hoist().drive.model_dump()
    drive = {key: value for key, value in machine.drive.model_dump().items() if value != usual[key]}
    data["drive"] = drive | (data.get("drive") or {})
    effects = {**machine.allowances, **machine.effects}  # a scenario has one block for both
    data["effects"] = {name: dict(values) for name, values in effects.items()} | scenario.effects
    return dumps({key: value for key, value in data.items() if value not in ({}, "")})
