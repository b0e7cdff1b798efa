"""What the controls of the page Study stand at, of any kind of machine, to and from a scenario. No streamlit here.

A `Desk` holds one value for each control, and under them the scenario that carries what no control shows (events,
effects, drive, …). `fields_of` declares the numbers that can be set, with their ranges on a machine: the form, the
names in errors and the tests follow from that declaration.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from workbench.analysis.usual import usual_cascade
from workbench.control import Cascade, PiSettings, Settings
from workbench.control.rigid import bandwidth_and_damping, rigid_gains, shaft_inertia_kg_m2
from workbench.core.errors import InputError
from workbench.core.yaml_strict import Document, dumps, loads
from workbench.dashboard.pages.batches import shipped as shipped_scenarios
from workbench.effects import check
from workbench.machines import (
    LOOPED,
    SHIPPED,
    Axis,
    Hoist,
    default_hoist,
    kind_of,
    looped,
    machine_from,
    of_kind,
    shipped,
    studied,
)
from workbench.machines.files import machine_text
from workbench.references import BASELINE, allowed_carriage_speed_m_s
from workbench.study.load import changed, load_study, read_standalone, standalone_text
from workbench.study.scenario import LimitsBlock, MoveBlock, Scenario, key_in

BANDWIDTH, GAINS = "bandwidth", "gains"
LIMITS = {"speed": "speed_m_s", "acceleration": "acceleration_m_s2", "jerk": "jerk_m_s3"}
CONTROLLER = ("by", "bandwidth", "damping", "kv", "kp", "ki", "weight")  # and "ff …"
ALIKE = 1.5  # times the inertia: another axis to which the same motion and gains still apply
LEAST_MOVE_M, ROOM_M = 0.5, 1.0  # of a hoist; room to move in, that the start leaves
MOST = 1e9
ADDRESS_KEY, PLACE, FILE, BETWEEN = "study", "the address", "machine.yaml", "\0"
LONGEST, MOST_BYTES = 6000, 100_000  # characters of the address; of the YAML in it
AnyMachine = TypeVar("AnyMachine", Hoist, Axis, Hoist | Axis)

# The page's first question, that of scenarios/payloads.yaml.
START = Scenario(
    name="what-if",
    payloads_kg=(0.0, 4500.0, 9000.0),
    start_position_m=4.0,
    moves=(MoveBlock(by_m=12.0), MoveBlock(dwell_s=3.0), MoveBlock(by_m=-12.0)),
    limits=LimitsBlock(speed_m_s=0.7, acceleration_m_s2=0.6, jerk_m_s3=0.8),
    references=("trapezoid", "ruckig", "ruckig_equal_time", "optimal"),
    controller=PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    settle_s=3.0,
)


@dataclass(frozen=True)
class Desk:
    """values: by control. kind, inertia (kg or kg m^2): of the machine that it was set for."""

    kind: str
    inertia: float
    base: Scenario
    values: Mapping[str, Any]

    def having(self, **values: Any) -> Desk:
        return replace(self, values={**self.values, **values})

    def suits(self, machine: Hoist | Axis) -> bool:
        """Whether what is set for one machine is a sensible beginning for this one."""
        kind = kind_of(machine)
        ratio = kind.looped.total_inertia(machine, 0.0) / self.inertia
        return kind.name == self.kind and (bool(kind.payload) or 1.0 / ALIKE < ratio < ALIKE)


@dataclass(frozen=True)
class Field:
    """A number that can be set: by slider from low to high in steps, or typed up to `most`.

    key: what the scenario calls it. form: how it is shown. slides: whether there is a slider.
    """

    name: str
    words: str
    key: str
    low: float
    high: float
    step: float
    form: str = "%.2f"
    tip: str = ""
    most: float | None = None
    slides: bool = True


def fields_of(machine: Hoist | Axis, desk: Desk) -> dict[str, Field]:
    """The numbers of this kind of machine, by name, with their ranges at the desk's other values."""
    v, kind = desk.values, kind_of(machine)
    settings, unit = desk.base.controller, kind.moved.unit
    ahead = type(settings.feed_forward).model_fields
    fields = [
        Field("weight", "Set-point weight (–)", "set_point_weight", 0.0, 1.0, 0.05),
        *(Field(f"ff {name}", _fed_words(name), name, 0.0, 1.0, 0.05) for name in ahead),
    ]
    if (hoist := studied(machine)) is not None and kind.payload:
        low, high, fastest = hoist.rail.lowest_position_m, hoist.highest_position_m, fastest_m_s(hoist)
        fields += [
            Field("start", "Start height (m)", "start_position_m", low, high - ROOM_M, 0.5),
            Field("way", "Up and down by (m)", "moves", LEAST_MOVE_M, high - v["start"], 0.5),
            Field("bandwidth", "Bandwidth (Hz)", "kp_nm_s_per_rad", 0.5, 6.0, 0.1, most=500.0),
            Field("damping", "Damping (–)", "ki_nm_per_rad", 0.4, 2.0, 0.05, tip="1 is ki = kp·ω/4."),
            Field("kp", "kp (N m s/rad)", "kp_nm_s_per_rad", 2.0, 80.0, 0.5, "%.4g", most=1e6),
            Field("ki", "ki (N m/rad)", "ki_nm_per_rad", 0.0, 600.0, 1.0, "%.4g", most=1e6),
        ]
        for before, way in (("", "hoisting " if v["split"] else ""), ("down ", "lowering ")):
            fields += [
                Field(f"{before}speed", f"Limit {way}speed (m/s)", "speed_m_s", 0.1, fastest, 0.01),
                Field(f"{before}acceleration", f"Limit {way}acceleration (m/s²)", "acceleration_m_s2", 0.1, 1.5, 0.05,
                      most=20.0),
                Field(f"{before}jerk", f"Limit {way}jerk (m/s³)", "jerk_m_s3", 0.1, 5.0, 0.1,
                      tip="The trapezoid has none.", most=1e3),
            ]  # fmt: skip
    else:
        given, cascade = desk.base.limits.given(), cast(Cascade, settings)
        top = kind.looped.top_speed(machine).speed

        def wide(name: str, words: str, key: str, began: float, tip: str = "", most: float = MOST) -> Field:
            about = float(f"{began:.1g}") if began > 0.0 else 1.0  # a range of a few times what it began with
            return Field(name, words, key, 0.0, min(4.0 * about, most), about / 50.0, "%.4g", tip, most)

        fields += [
            Field("start", f"Start position ({unit})", key_in(unit, "start_position_m"), -1e6, 1e6, 0.0, "%.4g",
                  slides=False),
            Field("way", f"There and back by ({unit})", "moves", -1e6, 1e6, 0.0, "%.4g", slides=False),
            Field("dwell", "Rest (s)", "dwell_s", 0.0, 600.0, 0.0, "%.4g", slides=False),
            wide("speed", f"Limit speed ({unit}/s)", key_in(unit, LIMITS["speed"]), given.get(LIMITS["speed"], 1.0),
                 most=top if math.isfinite(top) else MOST),
            wide("acceleration", f"Limit acceleration ({unit}/s²)", key_in(unit, LIMITS["acceleration"]),
                 given.get(LIMITS["acceleration"], 1.0)),
            wide("jerk", f"Limit jerk ({unit}/s³)", key_in(unit, LIMITS["jerk"]),
                 given.get(LIMITS["jerk"], v["jerk"]), "The trapezoid has none."),
            wide("kv", "kv (1/s)", "kv_per_s", cascade.kv_per_s or 10.0, "0 is a speed loop alone."),
            wide("kp", f"kp ({cascade.UNITS[0]})", cascade.GAINS[0], cascade.kp),
            wide("ki", f"ki ({cascade.UNITS[1]})", cascade.GAINS[1], cascade.ki or cascade.kp),
        ]  # fmt: skip
    return {field.name: field for field in fields}


def _fed_words(name: str) -> str:
    return "… that knows the wire (–)" if name == "wire" else f"Feed-forward of {name} (–)"


def named(error: InputError, machine: Hoist | Axis, desk: Desk) -> InputError:
    """The error under the name of the control that set the value."""
    by_gains = desk.values.get("by", GAINS) == GAINS
    shown = [
        field for name, field in fields_of(machine, desk).items()
        if name not in (("bandwidth", "damping") if by_gains else ("kp", "ki"))
    ]  # fmt: skip
    called = {field.key: field.words for field in reversed(shown)} | {
        "name": "Name of the study", "payloads_kg": "Payloads (kg)", "references": f"Against the {BASELINE}",
        "plant": "Model",
    }  # fmt: skip
    parts = [part.partition("[")[0] for part in (error.place or "").split(".")]
    name = next((called[part] for part in reversed(parts) if part in called), error.place)
    return InputError(error.problem, file=error.file, line=error.line, place=name)


def fastest_m_s(machine: Hoist) -> float:
    """What the motor's nominal speed allows, rounded down to what the slider shows."""
    motor = machine.motor.nominal_speed_rad_s
    allowed = allowed_carriage_speed_m_s(motor, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    return max(int(allowed * 100.0) / 100.0, min(allowed, 0.1))


def usual_desk(machine: Hoist | Axis) -> Desk:
    """What the page begins with. Hoist: `START`, the loop by bandwidth.

    Axis: there and back at six tenths of the top speed, a third of the drive's limit for the ramps, the controller by
    rule; for a top speed that is nowhere stated a fifth of a metre or two radians a second serve.
    """
    kind = kind_of(machine)
    if kind.payload:
        return desk_of(START, machine).having(by=BANDWIDTH, bandwidth=2.5, damping=1.0)

    def short(value: float) -> float:
        return float(f"{value:.2g}")

    inertia, unit = kind.looped.total_inertia(machine, 0.0), kind.moved.unit
    speed = 0.6 * kind.looped.speed_scale(machine)
    ramp = max(0.2, 3.0 * speed * inertia / kind.looped.input_limit(machine))
    limits = (short(speed), short(speed / ramp), short(1.5 * speed / ramp**2))
    base = Scenario.model_validate(
        {
            "name": START.name,
            key_in(unit, "start_position_m"): 0.0,
            "moves": _there_and_back(unit, short(3.0 * speed * ramp), 0.5),
            "limits": {key_in(unit, name): value for name, value in zip(LIMITS.values(), limits, strict=True)},
            "references": (BASELINE, "ruckig", "ruckig_equal_time"),
            "controller": usual_cascade(cast(Axis, machine)).model_dump(),
            "lead_s": 0.2,
            "settle_s": 0.8,
            "outputs": {"signals": "thinned", "every_s": 0.002},
        }
    )
    return desk_of(base, machine)


def _there_and_back(unit: str, way: float, dwell_s: float) -> tuple[dict[str, float], ...]:
    by = key_in(unit, "by_m")
    return {by: way}, {"dwell_s": dwell_s}, {by: -way}


def there_and_back(moves: Sequence[MoveBlock]) -> tuple[float, float] | None:
    """Way (m or rad) and dwell (s) of moves that go one way, wait and come back; None for any others."""
    if len(moves) != 3:
        return None
    there, rest, back = (block.step() for block in moves)
    if there.by_m is None or rest.dwell_s is None or back.by_m is None or there.by_m != -back.by_m:
        return None
    return there.by_m, rest.dwell_s


def desk_of(scenario: Scenario, machine: Hoist | Axis) -> Desk:
    """The controls set as a scenario says. InputError for one that the page cannot show: a sweep, a sample."""
    for key in ("sweep", "sample"):
        if getattr(scenario, key) is not None:
            raise InputError("is a batch of runs; run it on the page Batches, or take it out", place=key)
    kind = kind_of(machine)
    unit = kind.moved.unit
    if not kind.payload and not isinstance(scenario.controller, Cascade):
        raise InputError(f"is a hoist's; {of_kind(machine)} takes kind: cascade", place="controller")
    if scenario.start is None or not scenario.moves or (kind.payload and scenario.payloads_kg is None):
        raise InputError(f"expected {'payloads_kg, ' * bool(kind.payload)}{key_in(unit, 'start_position_m')} and moves")
    shape = there_and_back(scenario.moves)
    if kind.payload and shape is not None and shape[0] <= 0.0:
        shape = None
    jerk = 0.8 if kind.payload else None
    up, down = (_limits(scenario.limits, direction, unit, jerk) for direction in ("hoisting", "lowering"))
    values: dict[str, Any] = {
        "name": scenario.name,
        "references": tuple(name for name in scenario.kinds if name != BASELINE),
        "start": scenario.start,
        "way": shape[0] if shape else 12.0,
        "dwell": shape[1] if shape else 3.0,
        "own_moves": shape is None,
        **up,
    }
    if kind.payload:
        values |= {"payloads": tuple(scenario.payloads_kg or ()), "plant": scenario.plant, "split": up != down}
        values |= {f"down {name}": value for name, value in down.items()}
    desk = Desk(kind.name, kind.looped.total_inertia(machine, 0.0), scenario, values)
    return with_controller(desk, scenario.controller, machine)


def _limits(block: LimitsBlock, way: str, unit: str, jerk: float | None) -> dict[str, float]:
    """Of one direction. jerk: where a scenario of trapezoids gives none; else one and a half ramps' worth."""
    given = block.given() | getattr(block, way).given()
    for name in ("speed", "acceleration"):
        if LIMITS[name] not in given:
            place = f"limits.{key_in(unit, LIMITS[name])}"
            raise InputError("is missing; expected a positive number", place=place)
    speed, acceleration = given[LIMITS["speed"]], given[LIMITS["acceleration"]]
    usual = jerk or float(f"{1.5 * acceleration**2 / speed:.2g}")
    return {"speed": speed, "acceleration": acceleration, "jerk": given.get(LIMITS["jerk"], usual)}


def with_controller(desk: Desk, settings: Settings, machine: Hoist | Axis) -> Desk:
    """The desk with another controller, set by its gains."""
    values = {
        "kp": settings.kp,
        "ki": settings.ki,
        "weight": settings.set_point_weight,
        **{f"ff {name}": value for name, value in settings.feed_forward.model_dump().items()},
    }
    if isinstance(settings, Cascade):
        values["kv"] = settings.kv_per_s
    else:
        bandwidth, damping = bandwidth_and_damping(shaft_inertia_kg_m2(cast(Hoist, machine)), settings.kp, settings.ki)
        values |= {"by": GAINS, "bandwidth": round(bandwidth, 2)}
        values["damping"] = round(damping, 2) if math.isfinite(damping) else 1.0
    return replace(desk.having(**values), base=desk.base.model_copy(update={"controller": settings}))


def gains(desk: Desk, machine: Hoist | Axis) -> tuple[float, float]:
    """kp and ki, as set or from bandwidth and damping with the empty carriage."""
    v = desk.values
    if v.get("by", GAINS) == GAINS:
        return v["kp"], v["ki"]
    return rigid_gains(shaft_inertia_kg_m2(cast(Hoist, machine)), v["bandwidth"], v["damping"])


def controller_of(desk: Desk, machine: Hoist | Axis) -> Settings:
    """The controller that the controls ask for. InputError names the value."""
    settings, v = desk.base.controller, desk.values
    ahead = {name: v[f"ff {name}"] for name in type(settings.feed_forward).model_fields}
    values = dict(zip(settings.GAINS, gains(desk, machine), strict=True))
    outer = {"kv_per_s": v["kv"]} if isinstance(settings, Cascade) else {}
    return with_gains(settings, {**values, **outer, "set_point_weight": v["weight"], "feed_forward": ahead})


def with_gains(controller: Settings, values: Mapping[str, Any]) -> Settings:
    """The controller with other values, checked like a file. InputError names the value."""
    try:
        return type(controller).model_validate(controller.model_dump() | dict(values))
    except ValidationError as error:
        said = error.errors()[0]
        place = ".".join(str(part) for part in said["loc"]) or "controller"
        raise InputError(str(said["msg"]).removeprefix("Value error, "), place=place) from error


def scenario_of(desk: Desk, machine: Hoist | Axis) -> Scenario:
    """The scenario that the controls ask for. InputError names what does not fit."""
    v, kind = desk.values, kind_of(machine)
    unit = kind.moved.unit
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", v["name"]) is None:
        raise InputError(f"'{v['name']}', expected up to 64 letters, digits, '.', '_' or '-'", place="name")
    if kind.payload and not v["payloads"]:
        raise InputError("choose at least one payload", place="payloads_kg")
    changes: dict[str, Any] = {
        "name": v["name"],
        "references": (BASELINE, *v["references"]),
        key_in(unit, "start_position_m"): v["start"],
        "limits": {key_in(unit, key): v[name] for name, key in LIMITS.items()},
        "controller": controller_of(desk, machine).model_dump(),
    }
    if desk.base.outputs.signals == "none":
        changes["outputs"] = START.outputs if kind.payload else {"signals": "thinned", "every_s": 0.002}
    if not v["own_moves"]:
        changes["moves"] = _there_and_back(unit, v["way"], v["dwell"])
    if kind.payload:
        changes |= {"payloads_kg": tuple(sorted(v["payloads"])), "plant": v["plant"]}
        if v["split"]:
            changes["limits"]["lowering"] = {key: v[f"down {name}"] for name, key in LIMITS.items()}
    return changed(desk.base, changes)


def within(desk: Desk, machine: Hoist | Axis) -> Desk:
    """The controls moved inside what this machine allows, where another machine allowed more."""
    v = desk.values
    hoist = studied(machine) if kind_of(machine).payload else None
    if hoist is None:
        return desk.having(speed=min(v["speed"], kind_of(machine).looped.top_speed(machine).speed))
    high, fastest = hoist.highest_position_m, fastest_m_s(hoist)
    start = min(max(v["start"], hoist.rail.lowest_position_m), high - ROOM_M)
    speeds = {name: min(v[name], fastest) for name in ("speed", "down speed")}
    return desk.having(start=start, way=min(v["way"], high - start), **speeds)


def shipped_as(machine: Hoist | Axis) -> str | None:
    """What a scenario calls the machine; None for one that does not ship."""
    return next((name for name in SHIPPED if shipped(name) == machine), None)


def scenario_file(scenario: Scenario, machine: Hoist | Axis, file: str = "") -> str:
    """The scenario as YAML. A hoist's own values are in it; an axis is named, by `file` where it does not ship."""
    if kind_of(machine).payload:
        return standalone_text(scenario, cast(Hoist, machine))
    data: dict[str, Any] = scenario.model_dump(mode="json", exclude={"extends"}, exclude_none=True)
    data["machine"] = shipped_as(machine) or file or f"{scenario.name}_machine.yaml"
    data["limits"] = {key: value for key, value in data["limits"].items() if value != {}}
    return dumps({key: value for key, value in data.items() if value not in ({}, "")})


def files_of(scenario: Scenario, machine: Hoist | Axis) -> dict[str, tuple[str, str]]:
    """Button -> (file name, text): the scenario, and the axis that it names where that does not ship."""
    files = {"Save scenario": (f"{scenario.name}.yaml", scenario_file(scenario, machine))}
    if kind_of(machine).payload or shipped_as(machine):
        return files
    return files | {"Save machine": (f"{scenario.name}_machine.yaml", machine_text(machine))}


def shipped_files() -> dict[str, Path]:
    """What an uploaded scenario may extend: file name -> file."""
    return {file.name: file for file in shipped_scenarios().values()}


def read_desk(document: Document, machine: Hoist | Axis) -> Desk:
    """The controls as an uploaded scenario sets them. A machine that it names by file is the chosen one."""
    own = None if machine == default_hoist() else machine
    return desk_of(read_standalone(document, own, shipped_files()), machine)


def shipped_desk(name: str, machine: Hoist | Axis) -> tuple[Desk, Hoist | Axis | None]:
    """The controls as a shipped scenario sets them: on its own machine where it names one, at its base values where
    it sweeps or draws some. Beside them the machine to go over to, None for the one that is chosen.

    InputError for one that no control shows.
    """
    study = load_study(shipped_scenarios()[name])
    scenario, own = study.scenario, studied(study.machine)
    if own is None:
        axis = shipped(scenario.machine) if scenario.machine in SHIPPED else None
        if axis is None or studied(axis) is not None:
            raise InputError(f"is a study of {of_kind(study.machine)} in a file of its own; run it as a batch")
        return desk_of(changed(scenario, {"sweep": None, "sample": None}), axis), axis
    hoist = studied(machine)
    if scenario.machine != "default":  # its values as overrides: the page's machine is another choice
        scenario = read_standalone(loads(standalone_text(scenario, own), f"{name}.yaml"))
    payloads = scenario.payloads_kg or START.payloads_kg  # those of a sweep go with it
    scenario = changed(scenario, {"sweep": None, "sample": None, "payloads_kg": payloads})
    return desk_of(scenario, hoist or default_hoist()), None if hoist is not None else default_hoist()


def in_address(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """What the address holds, compressed: the scenario, and behind it an axis that does not ship. None for the study
    that the page begins with, and for one too long for an address."""
    text = scenario_file(scenario, machine, FILE)
    if kind_of(machine).payload:
        if machine == default_hoist() and scenario == scenario_of(usual_desk(machine), machine):
            return None
    elif not shipped_as(machine):
        text += BETWEEN + machine_text(machine)
    packed = base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")
    return packed if len(packed) <= LONGEST else None


def from_address(text: str) -> tuple[Desk, Hoist | Axis]:
    """The controls as a link sets them and the machine that they are of; a hoist's own values are in its scenario.

    InputError for an address that was cut or changed.
    """
    wrong = InputError("is damaged; the address has to be copied whole", place=ADDRESS_KEY)
    try:
        unpacking = zlib.decompressobj()
        plain = unpacking.decompress(base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)), MOST_BYTES).decode()
    except (binascii.Error, zlib.error, ValueError) as error:
        raise wrong from error
    if not unpacking.eof:
        raise wrong
    scenario, _, machine_yaml = plain.partition(BETWEEN)
    machine = machine_from(loads(machine_yaml, PLACE), check_effects=check) if machine_yaml else None
    axis = None if machine is None or studied(machine) is not None else machine
    read = read_standalone(loads(scenario, PLACE), axis)
    own = axis or shipped(read.machine)
    if looped(own) is None:
        raise InputError(f"is of {of_kind(own)}; expected {LOOPED}", place=ADDRESS_KEY)
    own = default_hoist() if studied(own) is not None else own
    return desk_of(read, own), own
