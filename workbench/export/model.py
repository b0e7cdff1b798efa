"""A machine as an exported model: its variables, with name, unit, range and meaning as machine.yaml declares them, and
its C code.

Units stand at the end of names: `rotor_inertia_kg_m2` is in kg m2. What keys mean is in symbols.yaml.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, cast

import annotated_types as bounds
from pydantic import BaseModel

from workbench.control import NEVER, PI, Controller, PiSettings, delay_weights, full_pi, loop_values
from workbench.control.events import BRAKE_TORQUES, SWITCHED_BRAKE
from workbench.core import names
from workbench.core.errors import InputError
from workbench.core.templates import render
from workbench.core.yaml_strict import load
from workbench.effects import sizes_of
from workbench.effects.active import Active, Alone, Chosen, alone, joined, longest_step_s
from workbench.export.controller_program import check_exported
from workbench.export.physics import Physics
from workbench.machines import STUDIED, Hoist, Machine, kind_of, of_kind, plant_of
from workbench.simulate.loop import PlantModel, torque_limits
from workbench.symbolic.expr import symbol, where

_BASE = {"N": "kg.m/s2", "Pa": "kg/m.s2", "Hz": "1/s"}  # units that FMI does not take as base units


@cache
def symbols() -> dict[str, dict[str, Any]]:
    """The tables of symbols.yaml."""
    data = load(Path(__file__).with_name("symbols.yaml")).data
    assert isinstance(data, dict)
    return data


def unit_of(name: str) -> str:
    """The unit that a name ends with, as FMI writes it: N.m.s/rad; "" for a plain number."""
    return _as_fmi(names.unit_of(f"_{name.rpartition('.')[2]}"))


def _as_fmi(unit: str) -> str:
    return unit.translate(str.maketrans(" ²³", ".23"))


def exponents(unit: str) -> dict[str, int]:
    """Base units with their exponents: {kg: 1, m: 2, s: -2} of N.m."""
    powers: Counter[str] = Counter()
    for sign, side in zip((1, -1), unit.partition("/")[::2], strict=True):
        for factor in (factor for factor in side.split(".") if factor not in ("", "1")):
            name = factor.rstrip("123")
            power = sign * int(factor[len(name) :] or 1)
            for base, inside in (exponents(_BASE[name]) if name in _BASE else {name: 1}).items():
                powers[base] += power * inside
    return {base: powers[base] for base in ("kg", "m", "s", "rad") if powers[base]}


def over_time(unit: str) -> str:
    """The unit of a derivative by time: of rad rad/s, of rad/s rad/s2; "" where there is no name for it."""
    if not unit:
        return ""
    wanted = exponents(f"{unit}.s" if "/" in unit else f"{unit}/s")
    return next((known for known in map(_as_fmi, names.UNITS.values()) if exponents(known) == wanted), "")


def meaning_of(key: str) -> str:
    """What a value of machine.yaml means. KeyError for one that is not described."""
    if key in symbols()["meanings"]:
        return str(symbols()["meanings"][key])
    block, _, last = key.rpartition(".")
    if not block.endswith("friction"):
        raise KeyError(key)
    what = next(meaning for start, meaning in symbols()["friction"].items() if last.startswith(start))
    side = block.removesuffix("friction").removesuffix(".")
    return f"{what}, of the {side}" if side else what


@dataclass(frozen=True)
class Range:
    """What a value may be; above: `lowest` itself is not allowed, below: nor is `highest`."""

    lowest: float = -math.inf
    highest: float = math.inf
    above: bool = False
    below: bool = False
    whole: bool = False


ANY, POSITIVE, NOT_NEGATIVE = Range(), Range(0.0, above=True), Range(0.0)


def range_of(record: type[BaseModel], key: str) -> Range:
    """What machine.yaml allows for a value, from its record's declaration."""
    inside: Any = record
    *blocks, last = key.split(".")
    for block in blocks:
        inside = inside.model_fields[block].annotation
    field = inside.model_fields[last]
    rules = {type(rule): rule for rule in field.metadata}
    above, below = bounds.Gt in rules, bounds.Lt in rules
    low = rules[bounds.Gt].gt if above else rules[bounds.Ge].ge if bounds.Ge in rules else -math.inf
    high = rules[bounds.Lt].lt if below else rules[bounds.Le].le if bounds.Le in rules else math.inf
    return Range(float(low), float(high), above, below, whole=field.annotation is int)


@dataclass(frozen=True)
class Variable:
    """One variable of the model. symbol: of a parameter, as the equations have it; derivative_of: a state's name."""

    name: str
    meaning: str
    causality: Literal["independent", "input", "parameter", "calculatedParameter", "output", "local"]
    start: float | None = None
    range: Range = ANY
    symbol: str = ""
    tunable: bool = False
    boolean: bool = False
    derivative_of: str | None = None

    @property
    def variability(self) -> str:
        if self.causality in ("parameter", "calculatedParameter"):
            return "tunable" if self.tunable else "fixed"
        return "discrete" if self.boolean else "continuous"

    @property
    def array(self) -> str:
        """The array of the C code where its value stands; its variables stand there in their order."""
        return {"independent": "TIME", "input": "INPUT", "parameter": "PARAMETER"}.get(self.causality, "SHOWN")

    @property
    def unit(self) -> str:
        if self.boolean or self.derivative_of is not None:
            return "" if self.boolean else over_time(unit_of(str(self.derivative_of)))
        return "s" if self.causality == "independent" else unit_of(self.name)


STEP_S, AXIS_STEP_S = {"hoist": 0.001}, 0.0002  # a wire is soft beside the sharp standstill of an axis' friction
LONGEST_STEP_S = 0.05
# (smaller, larger): pairs of parameters that machine.yaml refuses the other way round; equal: may be the same.
_ORDERS = {
    "hoist": (
        ("winch.pin_diameter_m", "winch.drum_diameter_m", False),
        ("sheave.pin_diameter_m", "sheave.diameter_m", False),
        ("start.position_carriage_m", "wire.segment_length_m", True),
    )
}
_STATES = {"angle_sheave_rad": "sheave angle", "speed_sheave_rad_s": "sheave speed"}
_DOMAINS = {"any": ANY, "positive": POSITIVE, "not_negative": NOT_NEGATIVE}


@dataclass(frozen=True)
class Model:
    """name: in words; identifier: as C and file names take it. code: model.c and sizes.h by file name.

    token: what ties description and binary together. notes: what of the machine is not in the model, in sentences.
    dependencies: by unknown, the variables that its equation reads; none with the controller inside.
    """

    name: str
    identifier: str
    description: str
    variables: tuple[Variable, ...]
    states: tuple[str, ...]
    knowns: tuple[str, ...]
    unknowns: tuple[str, ...]
    step_s: float
    code: Mapping[str, str]
    token: str
    notes: tuple[str, ...]
    dependencies: Mapping[str, tuple[str, ...]]

    @property
    def controlled(self) -> bool:
        return not self.knowns

    def reference(self, name: str) -> int:
        """The value reference of a variable. KeyError for a name that is none."""
        return {v.name: i for i, v in enumerate(self.variables)}[name]


@dataclass(frozen=True)
class Start:
    """Where and how the model begins; position None: the middle of what the machine may reach, 0 for an axis."""

    payload_kg: float = 0.0
    position: float | None = None


def model_of(
    machine: Machine,
    start: Start = Start(),
    effects: Chosen | None = None,
    controller: PiSettings | None = None,
    step_s: float | None = None,
) -> Model:
    """The exported model of a machine.

    effects: in place of or beside the machine's own, as in machine.yaml. controller: the sampled loop around the plant;
    its input is then the speed reference instead of the torque. step_s: the plant's largest step inside; None: 1 ms for
    a hoist, 0.2 ms for an axis, less where its friction or presliding asks for it.
    InputError for effects that are not known, a controller of another kind of machine, a start out of range.
    """
    plant, kind = plant_of(machine), kind_of(machine)
    usual_s = min(STEP_S.get(plant.kind, AXIS_STEP_S), longest_step_s(machine, effects))
    step_s = usual_s if step_s is None else step_s
    if not 0.0 < step_s <= LONGEST_STEP_S:
        raise InputError(f"{step_s:g} s, expected more than 0 and at most {LONGEST_STEP_S:g} s", place="step_s")
    at, active = _start_position(machine, start), alone(machine, effects)
    if controller is not None and not kind.studies:
        raise InputError(f"the machine is {of_kind(machine)}; a controller is exported with {STUDIED} only")
    parameters = _plant_parameters(machine, active, start.payload_kg)
    p: dict[str, Any] = {name: key for name, key in plant.parameters.items() if not isinstance(key, str)}
    p |= {name: value for name, value in active.values.items() if name not in {v.symbol for v in parameters}}
    parameters += _start_parameters(machine, active, at, step_s)
    pieces, loop, sample_time_s = active.effects, None, 0.0
    if controller is None:
        driven = "motor shaft, of all motors" if kind.payload else "axis"
        at_work = f"{kind.drive.quantity} at work on the {driven}, forward (hoisting) positive"
        slope = f"slope of {plant.input} within a communication step; 0 holds it"
        inputs = [
            Variable(plant.input, at_work, "input", _hold(machine, active, start, at)),
            Variable(f"{plant.input}_per_s", slope, "input", 0.0),
        ]
    else:
        followed = "speed that the motors shall follow, hoisting positive"
        inputs = [Variable(name, followed, "input", 0.0) for name in PI.references]
    if kind.payload:
        hoist = cast(Hoist, machine)
        inputs.append(Variable("brake_closed", "the brake holds the motor shaft", "input", 0.0, boolean=True))
        strong = BRAKE_TORQUES * hoist.motor.count * hoist.motor.nominal_torque_nm
        meaning = "friction of the closed brake at the motor shaft"
        parameters.append(Variable("brake.torque_nm", meaning, "parameter", strong, NOT_NEGATIVE, "T_brake"))
        p["brake_closed"] = symbol("w_brake_closed")
        pieces = joined(pieces, SWITCHED_BRAKE)
    if controller is not None:
        check_exported(controller)
        inputs.append(Variable("motor_failed", "one motor gives no torque", "input", 0.0, boolean=True))
        loop, own, fixed = _loop(cast(Hoist, machine), controller)
        sample_time_s = controller.sample_time_s
        parameters += own
        p |= fixed
    p |= {v.symbol: symbol(f"p_{v.symbol}") for v in parameters}
    # The tracking rate of a back-calculation whose time nobody has said follows from the gains.
    if controller and controller.anti_windup == "back_calculation" and controller.tracking_time_s is None:
        p["track"] = p["ki"] / p["kp"]
    names = tuple(v.symbol for v in parameters), tuple(v.name for v in inputs)
    physics = Physics(plant, pieces, names[0], SimpleNamespace(**p), names[1], loop, sample_time_s, p.get("lag", 0.0))
    return _assembled(machine, physics, inputs, parameters, step_s, active)


def _start_position(machine: Machine, start: Start) -> float:
    """InputError for a payload or a position that cannot be."""
    payload = start.payload_kg
    if not 0.0 <= payload < math.inf:
        raise InputError(f"{payload:g} kg, expected 0 or more", place="payload_kg")
    if not kind_of(machine).payload:
        if payload > 0.0:
            raise InputError(f"{payload:g} kg, but {of_kind(machine)} carries no payload", place="payload_kg")
        return 0.0 if start.position is None else start.position
    hoist = cast(Hoist, machine)
    low, high, top = hoist.rail.lowest_position_m, hoist.highest_position_m, hoist.wire.segment_length_m
    at = 0.5 * (low + high) if start.position is None else start.position
    if not 0.0 <= at <= top:
        raise InputError(f"{at:g} m, expected 0 to {top:g} m, where the dead anchor is", place="start_position_m")
    return at


def _plant_parameters(machine: Machine, active: Alone, payload_kg: float) -> list[Variable]:
    """The values of machine.yaml that stand in the equations, with the ranges that machine.yaml has, then those of the
    effects at work."""
    plant, made = plant_of(machine), list[Variable]()
    for name, key in plant.parameters.items():
        if key == "payload_kg":
            made.append(Variable(key, meaning_of(key), "parameter", payload_kg, NOT_NEGATIVE, name, tunable=True))
        elif isinstance(key, str):
            value, limits = float(attrgetter(key)(machine)), range_of(type(machine), key)
            made.append(Variable(key, meaning_of(key), "parameter", value, limits, name))
    for effect in active.chosen:
        names = {ranged.symbol: ranged.name for ranged in effect.ranges(sizes_of(machine))}
        for parameter in effect.parameters:
            own = effect.symbol(parameter, plant.kind)
            meaning = f"{effect.id.replace('_', ' ')}: {parameter.meaning}"
            name, limits = f"effects.{effect.id}.{names[own]}", _DOMAINS[parameter.domain]
            made.append(Variable(name, meaning, "parameter", float(active.values[own]), limits, own))
    return made


def _start_parameters(machine: Machine, active: Alone, at: float, step_s: float) -> list[Variable]:
    plant = plant_of(machine)
    reach = NOT_NEGATIVE if kind_of(machine).payload else ANY
    rows: list[tuple[str, str, float, Range, str]] = [
        (f"start.{plant.positions[plant.placed]}", "where the model hangs still at the start", at, reach, "start_at"),
        (f"start.{plant.speeds[0]}", "speed at the start, with which it moves evenly", 0.0, ANY, "start_speed"),
        ("step_s", "largest step of the integration inside", step_s, Range(0.0, LONGEST_STEP_S, above=True), "step"),
    ]
    if active.effects.parameters:
        clock = "what the campaign's clock shows at time 0"
        rows.insert(0, ("start.campaign_time_s", clock, 0.0, ANY, "start_time_s"))
    return [Variable(name, meaning, "parameter", value, limits, own) for name, meaning, value, limits, own in rows]


def _hold(machine: Machine, active: Alone, start: Start, at: float) -> float:
    """The input that holds the machine where it starts."""
    plant, at_work = plant_of(machine), Active(plant_of(machine).kind, active.effects, active.values)
    p = SimpleNamespace(**vars(plant.values(machine, start.payload_kg)), **at_work.values_of(0.0))
    return float(PlantModel(plant, at_work).starts([at], [0.0], [0.0], [p])[1][0])


def _loop(machine: Hoist, settings: PiSettings) -> tuple[Controller, list[Variable], dict[str, Any]]:
    """The controller, its parameters, and what of it stays a number."""
    drive, limits = machine.drive, torque_limits(machine)
    plain = settings.plain and not (drive.encoder_counts_per_turn or drive.speed_filter_s or drive.speed_delay_s)
    late = drive.speed_delay_s / settings.sample_time_s
    wire = settings.feed_forward.through_the_wire
    loop = PI if plain else (_late(full_pi(True, wire), late) if late > 0.0 else full_pi(False, wire))
    gain = "proportional gain, torque of all motors over motor speed"
    rows: list[tuple[str, str, str, float, Range]] = [
        ("kp", "controller.kp_nm_s_per_rad", gain, settings.kp_nm_s_per_rad, POSITIVE),
        ("ki", "controller.ki_nm_per_rad", "integral gain", settings.ki_nm_per_rad, NOT_NEGATIVE),
        ("b_set", "controller.set_point_weight", "weight of the reference in the proportional part",
         settings.set_point_weight, Range(0.0, 1.0)),
        ("u_all", "drive.torque_limit_nm", "largest torque of all motors together", limits["u_all"], NOT_NEGATIVE),
        ("u_one", "drive.torque_limit_one_failed_nm", "largest torque after one motor failed", limits["u_one"],
         NOT_NEGATIVE),
        ("lag", "drive.torque_lag_s", "first-order lag of the torque", drive.torque_lag_s, NOT_NEGATIVE),
    ]  # fmt: skip
    own = [Variable(name, meaning, "parameter", value, limits, sign, tunable=name.startswith("controller."))
           for sign, name, meaning, value, limits in rows]  # fmt: skip
    fixed: dict[str, Any] = {
        **loop_values(settings, drive, 0.0),
        "w_weak": limits["w_weak"],
        "t_fail": where(symbol("w_motor_failed") > 0.5, -NEVER, NEVER),
        "T_hold": symbol("hold"),
    }
    return loop, own, {name: value for name, value in fixed.items() if name not in {v.symbol for v in own}}


def _late(loop: Controller, late: float) -> Controller:
    """The controller with the samples of a late speed in its own memory, newest first, zero before the start."""
    whole, nearer, farther = delay_weights(late)
    n = len(loop.memory)

    def step(p: Any, memory: Sequence[Any], reference: Any, measured: Any, dt: Any) -> Any:
        assert loop.sensed is not None
        line = [loop.sensed(p, memory[:n], measured, dt), *memory[n:]]
        arrived = nearer * line[whole] + farther * line[whole + 1]
        command, after = loop.step(p, memory[:n], reference, SimpleNamespace(**vars(measured), late=arrived), dt)
        return command, [*after, *line[:-1]]

    def start(p: Any, hold: float, angle: float) -> list[float]:
        return [*loop.start(p, hold, angle), *[0.0] * (whole + 1)]

    names = (*loop.memory, *(f"late{j}" for j in range(whole + 1)))
    return Controller(loop.parameters, names, loop.references, step, start)


def _assembled(
    machine: Machine, physics: Physics, inputs: list[Variable], parameters: list[Variable], step_s: float, active: Alone
) -> Model:
    plant, controlled = physics.plant, physics.controller is not None
    time = Variable("time", "time", "independent")
    variables = (time, *inputs, *parameters, *_shown(physics))
    place = {v.name: i for i, v in enumerate(variables)}
    knowns = () if controlled else (*physics.states, plant.input)
    unknowns = () if controlled else physics.unknowns
    orders = [(place[small], place[large], int(equal)) for small, large, equal in _ORDERS.get(plant.kind, ())]
    symbols = [v.symbol for v in parameters]
    text = physics.model_text()
    sizes = {
        "N_VARIABLES": len(variables), "N_ORDERS": len(orders), "N_PARAMETERS": len(parameters),
        "N_INPUTS": len(inputs), "N_STATES": len(physics.states), "N_POSITIONS": len(plant.positions),
        "N_SHOWN": len(physics.shown) + 2, "N_MEMORY": len(physics.controller.memory) if physics.controller else 0,
        "N_KNOWNS": len(knowns), "N_UNKNOWNS": len(unknowns), "PLACED": plant.placed,
        "START_AT": symbols.index("start_at"), "START_SPEED": symbols.index("start_speed"),
        "STEP": symbols.index("step"), "RATE_INPUT": 1, "SAMPLE_TIME": repr(physics.sample_time_s),
        "N_CONSTANTS": len(physics.text.rows),
    }  # fmt: skip
    seen: Counter[str] = Counter()
    rows = []
    for v in variables:
        low, high = _c_number(v.range.lowest), _c_number(v.range.highest)
        flags = [v.boolean, v.tunable, v.range.whole, v.range.above, v.range.below]
        rows.append((v, seen[v.array], _c_number(v.start or 0.0), low, high, *map(int, flags)))
        seen[v.array] += 1
    references = [[place[name] for name in names] for names in (knowns, unknowns)]
    text = str(render("export/c/model.c.j2", physics=text, rows=rows, orders=orders, references=references))
    token = "{" + hashlib.sha256(repr((sorted(sizes.items()), text)).encode()).hexdigest()[:32] + "}"
    word = re.sub(r"\W+", "_", machine.name, flags=re.ASCII).strip("_")[:50] or "machine"
    identifier = word if word[0].isalpha() else f"m_{word}"
    defines = {**sizes, "MODEL_TOKEN": f'"{token}"', "MODEL_IDENTIFIER": identifier}
    noun = kind_of(machine).noun
    return Model(
        machine.name,
        identifier,
        f"{noun} under its sampled speed loop" if controlled else f"plant of a {noun}",
        variables,
        physics.states,
        knowns,
        unknowns,
        step_s,
        {"model.c": text, "sizes.h": "".join(f"#define {name} {value}\n" for name, value in defines.items())},
        token,
        tuple(f"{name} acts on the log's sensors and is not in the model: signals here are the true ones"
              for name in active.sensors_left_out),
        {} if controlled else physics.dependencies(),
    )  # fmt: skip


def _shown(physics: Physics) -> list[Variable]:
    """What the model computes: signals, states, their derivatives, the holding input, the controller's torque."""
    plant, made = physics.plant, list[Variable]()
    meanings = {signal.name: signal.meaning for signal in plant.signals}
    for name in physics.shown:
        if name.startswith("der("):
            made.append(Variable(name, f"derivative of {name[4:-1]}", "local", derivative_of=name[4:-1]))
        elif name in meanings:
            made.append(Variable(name, meanings[name], "output"))
        else:
            of_effect = f"{name.replace('__', ': ').replace('_', ' ')} of an effect"
            made.append(Variable(name, _STATES.get(name, of_effect), "local"))
    quantity, _, unit = plant.input.rpartition("_")
    held = "input that holds the load at the start"
    made.append(Variable(f"{quantity}_hold_{unit}", held, "calculatedParameter"))
    if physics.controller is not None:
        at_work = "torque at work on the motor shaft, of all motors, hoisting positive"
        made.append(Variable(plant.input, at_work, "output"))
    return made


def _c_number(value: float) -> str:
    """A number as C reads it, the infinite ones too."""
    return repr(float(value)) if math.isfinite(value) else "INFINITY" if value > 0.0 else "-INFINITY"
