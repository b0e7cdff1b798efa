"""A machine as an exported model: its variables and its C code."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

from workbench.control import NEVER, PI, Controller, PiSettings, delay_weights, full_pi, loop_values
from workbench.control.events import BRAKE_SPEED
from workbench.core.errors import InputError
from workbench.effects import Active, Chosen, alone, joined
from workbench.export.physics import Physics
from workbench.export.variables import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Value,
    Variable,
    effect_values,
    machine_value,
)
from workbench.machines import STUDIED, Axis, Effects, Hoist, kind_of, of_kind, plant_of
from workbench.simulate.loop import torque_limits
from workbench.simulate.plant_model import PlantModel
from workbench.symbolic.expr import Scalar, clip, symbol, where

STEP_S = {"hoist": 0.001}  # by kind of plant; a wire is soft beside the sharp standstill of an axis' friction
AXIS_STEP_S = 0.0002
LONGEST_STEP_S = 0.05
BRAKE_TORQUES = 2.0  # of all motors' nominal torque together, where nothing says how strong the brake is

# (smaller, larger): pairs of parameters that machine.yaml refuses the other way round; equal: may be the same.
_ORDERS = {
    "hoist": (
        ("winch.pin_diameter_m", "winch.drum_diameter_m", False),
        ("sheave.pin_diameter_m", "sheave.diameter_m", False),
        ("start.position_carriage_m", "wire.segment_length_m", True),
    )
}
_STATES = {
    "angle_sheave_rad": "sheave angle",
    "speed_sheave_rad_s": "sheave speed",
}


@dataclass(frozen=True)
class Model:
    """name: in words; identifier: as C and file names take it. orders: pairs of names of parameters, the smaller first.

    code: model.c and sizes.h by file name. token: what ties description and binary together. notes: what of the
    machine is not in the model, in sentences. dependencies: by unknown, the variables that its equation reads; none
    with the controller inside.
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
    machine: Hoist | Axis,
    start: Start = Start(),
    effects: Chosen | None = None,
    controller: PiSettings | None = None,
    step_s: float | None = None,
) -> Model:
    """The exported model of a machine.

    effects: in place of or beside the machine's own, as in machine.yaml. controller: the sampled loop around the plant;
    its input is then the speed reference instead of the torque. step_s: the plant's largest step inside; None: 1 ms for
    a hoist, 0.2 ms for an axis.
    InputError for effects that are not known, a controller of another kind of machine, a start out of range.
    """
    plant, kind = plant_of(machine), kind_of(machine)
    step_s = STEP_S.get(plant.kind, AXIS_STEP_S) if step_s is None else step_s
    if not 0.0 < step_s <= LONGEST_STEP_S:
        raise InputError(f"{step_s:g} s, expected more than 0 and at most {LONGEST_STEP_S:g} s", place="step_s")
    _check_payload(machine, start)
    active = alone(machine, effects)
    if controller is not None and not kind.studies:
        raise InputError(f"the machine is {of_kind(machine)}; a controller is exported with {STUDIED} only")
    at = _start_position(machine, start)
    values = [
        machine_value(machine, name, key, start.payload_kg)
        for name, key in plant.parameters.items()
        if isinstance(key, str)
    ]
    for effect in active.chosen:
        values += effect_values(machine, effect, plant.kind, active.values)
    p: dict[str, Any] = {name: key for name, key in plant.parameters.items() if not isinstance(key, str)}
    p |= {name: value for name, value in active.values.items() if name not in {v.symbol for v in values}}
    if active.effects.parameters:
        values.append(Value("start_time_s", "start.campaign_time_s", "what the campaign's clock shows at time 0", 0.0))
    position, speed = plant.positions[plant.placed], plant.speeds[0]
    values += [
        Value("start_at", f"start.{position}", "where the model hangs still at the start", at, _reach(machine)),
        Value("start_speed", f"start.{speed}", "speed at the start, with which it moves evenly", 0.0),
        Value(
            "step", "step_s", "largest step of the integration inside", step_s, Range(0.0, LONGEST_STEP_S, above=True)
        ),
    ]
    inputs: list[tuple[str, str, bool]] = []
    pieces = active.effects
    if controller is None:
        inputs += [
            (
                plant.input,
                f"{kind.drive.quantity} at work on the {_driven(machine)}, forward (hoisting) positive",
                False,
            ),
            (f"{plant.input}_per_s", f"slope of {plant.input} within a communication step; 0 holds it", False),
        ]
    else:
        inputs += [(name, "speed that the motors shall follow, hoisting positive", False) for name in PI.references]
    if kind.payload:
        machine = cast(Hoist, machine)
        inputs.append(("brake_closed", "the brake holds the motor shaft", True))
        strong = BRAKE_TORQUES * machine.motor.count * machine.motor.nominal_torque_nm
        meaning = "friction of the closed brake at the motor shaft"
        values.append(Value("T_brake", "brake.torque_nm", meaning, strong, NOT_NEGATIVE))
        p["brake_closed"] = symbol("w_brake_closed")
        pieces = joined(pieces, _BRAKE)
    loop: Controller | None = None
    if controller is not None:
        inputs.append(("motor_failed", "one motor gives no torque", True))
        loop, own, fixed = _loop(cast(Hoist, machine), controller)
        values += own
        p |= fixed
    p |= {v.symbol: symbol(f"p_{v.symbol}") for v in values}
    if controller is not None:
        p |= _dependent(controller, SimpleNamespace(**p))
    physics = Physics(
        plant,
        pieces,
        tuple(v.symbol for v in values),
        SimpleNamespace(**p),
        tuple(name for name, _, _ in inputs),
        loop,
        0.0 if controller is None else controller.sample_time_s,
        p.get("lag", 0.0),
    )
    return _assembled(
        machine,
        physics,
        values,
        inputs,
        step_s,
        active.sensors_left_out,
        _hold(machine, Active(plant.kind, active.effects, active.values), start, at),
    )


def _hold(machine: Hoist | Axis, active: Active, start: Start, at: float) -> float:
    """The input that holds the machine where it starts."""
    plant = plant_of(machine)
    p = SimpleNamespace(**vars(plant.values(machine, start.payload_kg)), **active.values_of(0.0))
    _, hold = PlantModel(plant, active).starts([at], [0.0], [0.0], [p])
    return float(hold[0])


def _check_payload(machine: Hoist | Axis, start: Start) -> None:
    if not math.isfinite(start.payload_kg) or start.payload_kg < 0.0:
        raise InputError(f"{start.payload_kg:g} kg, expected 0 or more", place="payload_kg")
    if start.payload_kg > 0.0 and not kind_of(machine).payload:
        raise InputError(f"{start.payload_kg:g} kg, but {of_kind(machine)} carries no payload", place="payload_kg")


def _driven(machine: Hoist | Axis) -> str:
    return "motor shaft, of all motors" if kind_of(machine).payload else "axis"


def _start_position(machine: Hoist | Axis, start: Start) -> float:
    if not kind_of(machine).payload:
        return 0.0 if start.position is None else start.position
    machine = cast(Hoist, machine)
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    at = 0.5 * (low + high) if start.position is None else start.position
    if not 0.0 <= at <= machine.wire.segment_length_m:
        top = machine.wire.segment_length_m
        raise InputError(f"{at:g} m, expected 0 to {top:g} m, where the dead anchor is", place="start_position_m")
    return at


def _reach(machine: Hoist | Axis) -> Range:
    return NOT_NEGATIVE if kind_of(machine).payload else ANY


def _brake(s: Any, p: Any) -> Scalar:
    """Friction of the closed brake on the motor shaft, against its motion, linear around standstill."""
    return -(p.brake_closed * p.T_brake * clip(s.w / BRAKE_SPEED, -1.0, 1.0))


_BRAKE = Effects({"motor_torque_nm": [_brake]})


def _loop(machine: Hoist, settings: PiSettings) -> tuple[Controller, list[Value], dict[str, Any]]:
    """The controller, its parameters, and what of it stays a number."""
    drive = machine.drive
    plain = settings.plain and not (drive.encoder_counts_per_turn or drive.speed_filter_s or drive.speed_delay_s)
    late = drive.speed_delay_s / settings.sample_time_s
    wire = settings.feed_forward.through_the_wire
    loop = PI if plain else (_late(full_pi(True, wire), late) if late > 0.0 else full_pi(False, wire))
    limits = torque_limits(machine)
    own = [
        Value("kp", "controller.kp_nm_s_per_rad", "proportional gain, torque of all motors over motor speed",
              settings.kp_nm_s_per_rad, POSITIVE, tunable=True),
        Value("ki", "controller.ki_nm_per_rad", "integral gain", settings.ki_nm_per_rad, NOT_NEGATIVE, tunable=True),
        Value("b_set", "controller.set_point_weight", "weight of the reference in the proportional part",
              settings.set_point_weight, Range(0.0, 1.0), tunable=True),
        Value("u_all", "drive.torque_limit_nm", "largest torque of all motors together", limits["u_all"], NOT_NEGATIVE),
        Value("u_one", "drive.torque_limit_one_failed_nm", "largest torque after one motor failed", limits["u_one"],
              NOT_NEGATIVE),
        Value("lag", "drive.torque_lag_s", "first-order lag of the torque", drive.torque_lag_s, NOT_NEGATIVE),
    ]  # fmt: skip
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

    def step(p: Any, memory: Sequence[Scalar], reference: Any, measured: Any, dt: Scalar) -> Any:
        assert loop.sensed is not None
        line = [loop.sensed(p, memory[:n], measured, dt), *memory[n:]]
        arrived = nearer * line[whole] + farther * line[whole + 1]
        command, after = loop.step(p, memory[:n], reference, SimpleNamespace(**vars(measured), late=arrived), dt)
        return command, [*after, *line[:-1]]

    def start(p: Any, hold: float, angle: float) -> list[float]:
        return [*loop.start(p, hold, angle), *[0.0] * (whole + 1)]

    names = (*loop.memory, *(f"late{j}" for j in range(whole + 1)))
    return Controller(loop.parameters, names, loop.references, step, start)


def _dependent(settings: PiSettings, p: Any) -> dict[str, Any]:
    """What follows from parameters: the tracking rate of a back-calculation whose time nobody has said."""
    if settings.anti_windup == "back_calculation" and settings.tracking_time_s is None:
        return {"track": p.ki / p.kp}
    return {}


def _assembled(
    machine: Hoist | Axis,
    physics: Physics,
    values: Sequence[Value],
    inputs: Sequence[tuple[str, str, bool]],
    step_s: float,
    sensors: Sequence[str],
    hold: float,
) -> Model:
    variables = _variables(physics, values, inputs, hold)
    place = {v.name: i for i, v in enumerate(variables)}
    controlled = physics.controller is not None
    knowns = () if controlled else (*physics.states, physics.plant.input)
    unknowns = () if controlled else physics.unknowns
    orders = [(place[small], place[large], equal) for small, large, equal in _ORDERS.get(physics.plant.kind, ())]
    symbols = [v.symbol for v in values]
    sizes = {
        "N_VARIABLES": len(variables), "N_ORDERS": len(orders), "N_PARAMETERS": len(values),
        "N_INPUTS": len(inputs), "N_STATES": len(physics.states), "N_POSITIONS": len(physics.plant.positions),
        "N_SHOWN": len(physics.shown) + 2, "N_MEMORY": len(physics.controller.memory) if physics.controller else 0,
        "N_KNOWNS": len(knowns), "N_UNKNOWNS": len(unknowns), "PLACED": physics.plant.placed,
        "START_AT": symbols.index("start_at"), "START_SPEED": symbols.index("start_speed"),
        "STEP": symbols.index("step"), "RATE_INPUT": 1, "SAMPLE_TIME": repr(physics.sample_time_s),
    }  # fmt: skip
    physics_text = physics.model_text()
    sizes["N_CONSTANTS"] = len(physics.text.rows)
    tables = _tables(variables, orders, [place[n] for n in knowns], [place[n] for n in unknowns])
    text = f'#include "model.h"\n\n{physics_text}\n{tables}'
    token = "{" + hashlib.sha256(repr((sorted(sizes.items()), text)).encode()).hexdigest()[:32] + "}"
    defines = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    identifier = _identifier(machine.name)
    guard = f'#define MODEL_TOKEN "{token}"\n#define MODEL_IDENTIFIER {identifier}\n'
    notes = tuple(
        f"{name} acts on the log's sensors and is not in the model: signals here are the true ones" for name in sensors
    )
    return Model(
        machine.name,
        identifier,
        _description(machine, physics),
        variables,
        physics.states,
        knowns,
        unknowns,
        step_s,
        {"model.c": text, "sizes.h": f"{defines}\n{guard}"},
        token,
        notes,
        {} if controlled else physics.dependencies(),
    )


def _description(machine: Hoist | Axis, physics: Physics) -> str:
    what = kind_of(machine).noun
    return f"{what} under its sampled speed loop" if physics.controller else f"plant of a {what}"


def _identifier(name: str) -> str:
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:50] or "machine"
    return word if word[0].isalpha() else f"m_{word}"


def _variables(
    physics: Physics, values: Sequence[Value], inputs: Sequence[tuple[str, str, bool]], hold_input: float
) -> tuple[Variable, ...]:
    plant = physics.plant
    made = [Variable("time", "time", "independent", "continuous", "TIME", 0, given_unit="s")]
    for i, (name, meaning, boolean) in enumerate(inputs):
        variability = "discrete" if boolean else "continuous"
        start = hold_input if name == plant.input else 0.0
        made.append(Variable(name, meaning, "input", variability, "INPUT", i, start, boolean=boolean))  # type: ignore[arg-type]
    for i, v in enumerate(values):
        variability = "tunable" if v.tunable else "fixed"
        made.append(Variable(v.name, v.meaning, "parameter", variability, "PARAMETER", i, v.start, v.range))  # type: ignore[arg-type]
    meanings = {signal.name: signal.meaning for signal in plant.signals}
    for i, name in enumerate(physics.shown):
        of = name[4:-1] if name.startswith("der(") else None
        if of is not None:
            made.append(Variable(name, f"derivative of {of}", "local", "continuous", "SHOWN", i, derivative_of=of))
        elif name in meanings:
            made.append(Variable(name, meanings[name], "output", "continuous", "SHOWN", i))
        else:
            meaning = _STATES.get(name, f"{name.replace('__', ': ').replace('_', ' ')} of an effect")
            made.append(Variable(name, meaning, "local", "continuous", "SHOWN", i))
    hold = f"{plant.input.rpartition('_')[0]}_hold_{plant.input.rpartition('_')[2]}"
    meaning, n = "input that holds the load at the start", len(physics.shown)
    made.append(Variable(hold, meaning, "calculatedParameter", "fixed", "SHOWN", n))
    if physics.controller is not None:
        meaning = "torque at work on the motor shaft, of all motors, hoisting positive"
        made.append(Variable(plant.input, meaning, "output", "continuous", "SHOWN", n + 1))
    return tuple(made)


def _tables(
    variables: Sequence[Variable],
    orders: Sequence[tuple[int, int, bool]],
    knowns: Sequence[int],
    unknowns: Sequence[int],
) -> str:
    rows = [
        "    {" + ", ".join([
            f'"{v.name}"', f"KIND_{v.kind}", str(v.index), "TYPE_BOOLEAN" if v.boolean else "TYPE_REAL",
            str(int(v.variability == "tunable")), str(int(v.range.whole)), c_number(v.start or 0.0),
            c_number(v.range.lowest), c_number(v.range.highest), str(int(v.range.above)), str(int(v.range.below)),
        ]) + "}"
        for v in variables
    ]  # fmt: skip
    pairs = [f"{{{a}, {b}, {int(equal)}}}" for a, b, equal in orders]
    return "\n".join(
        [
            "const Variable model_variables[N_VARIABLES] = {", ",\n".join(rows), "};",
            f"const Order model_orders[N_ORDERS + 1] = {{{', '.join([*pairs, '{0, 0, 0}'])}}};",
            f"const int model_knowns[N_KNOWNS + 1] = {{{', '.join(map(str, [*knowns, -1]))}}};",
            f"const int model_unknowns[N_UNKNOWNS + 1] = {{{', '.join(map(str, [*unknowns, -1]))}}};",
            "",
        ]
    )  # fmt: skip


def c_number(value: float) -> str:
    """A number as C reads it, the infinite ones too."""
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value))
