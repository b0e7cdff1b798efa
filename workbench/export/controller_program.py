"""The speed controller as a short program of named assignments, which is printed as C99 and as structured text.

Each line is Python; `where`, `min`, `max`, `abs`, comparisons, `and` and `or` are all that it takes. The program does
what `workbench.control.pi` does, without what belongs to the drive (encoder, speed filter, delay) and without what is
switched off. Before a step its inputs and its memory are checked; where a check fails, the last torque is held and
`fault` is set with the check's number, until a reset. Every check is a range, and NaN lies in none. `checked` runs the
program beside the compiled step of the studies before anything is printed.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from workbench import __version__
from workbench.control import PiSettings, full_pi, loop_values
from workbench.control.events import BRAKE_TORQUES
from workbench.control.pi import feed_forward, load_inertia, swing_of
from workbench.control.settings import low_pass_gain, notch_coefficients
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.core.yaml_strict import dumps, load, validate
from workbench.engine.stepped import Step
from workbench.machines import HOIST, Hoist
from workbench.references import Limits
from workbench.simulate.loop import torque_limits
from workbench.study.scenario import LimitsBlock

AGREES = 1e-9  # of the torque limit
RECORD_SAMPLES = 400
SPEED_MARGIN = 1.5  # of the largest speed: what is still taken as one
SPEED_NOISE = 0.02  # of the largest speed: what a measured speed may jump beside its motion
STATE_TORQUES = 1e6  # of the torque limit: what a memory or a wanted torque may come to
LOADS = 4.0  # of the load's weight: what a wire may pull whose breaking load is not stated


@dataclass(frozen=True)
class Number:
    """A constant of the program."""

    name: str
    value: float
    meaning: str


@dataclass(frozen=True)
class Check:
    """What has to hold; `reason` is told where it does not."""

    reason: int
    holds: str
    meaning: str


HOLD = Check(1, "abs(torque_hold_nm) <= torque_limit_nm", "the holding torque of a reset is beyond the torque limit")
REFERENCE = Check(2, "abs(reference) <= speed_limit_rad_s", "the speed reference is no number or implausible")
SPEED = Check(3, "abs(speed) <= speed_limit_rad_s", "the measured speed is no number or implausible")
SLOPE = Check(4, "fresh or abs(speed - speed_before) <= speed_step_rad_s",
              "the measured speed changed faster than the inertia allows")  # fmt: skip
STATE = Check(5, "abs({}) <= state_limit", "the memory is no number or implausible")
RESULT = Check(6, "abs(wanted) <= state_limit", "the computed torque is no number or implausible")
CHECKS = (HOLD, REFERENCE, SPEED, SLOPE, STATE, RESULT)


@dataclass(frozen=True)
class Program:
    """numbers: constants. memory: names of what is kept from sample to sample. reset: lines that set the memory from
    `torque_hold_nm`. step: (comment, lines) in blocks, from the inputs to `command` and the memory.

    `fresh`, a truth, and `speed_before` are kept beside the memory: the check of the slope needs them."""

    sample_time_s: float
    numbers: list[Number] = field(default_factory=list)
    memory: list[str] = field(default_factory=list)
    reset: list[str] = field(default_factory=list)
    step: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)

    def number(self, name: str, value: float, meaning: str) -> None:
        self.numbers.append(Number(name, float(value), meaning))

    def keep(self, **memory: str) -> None:
        """What is kept from sample to sample, with what a reset makes of it."""
        self.memory.extend(memory)
        self.reset.extend(f"{name} = {value}" for name, value in memory.items())

    def block(self, title: str, *lines: str) -> None:
        self.step.append((title, lines))

    @property
    def before(self) -> tuple[Check, ...]:
        """The checks before a step."""
        state = " and ".join(STATE.holds.format(name) for name in self.memory)
        return REFERENCE, SPEED, SLOPE, Check(STATE.reason, state, STATE.meaning)

    @property
    def lines(self) -> tuple[str, ...]:
        return tuple(line for _, block in self.step for line in block)

    @property
    def locals(self) -> tuple[str, ...]:
        """What is assigned on the way and is no memory, in order."""
        assigned = (line.partition(" = ")[0] for line in self.lines)
        return tuple(dict.fromkeys(name for name in assigned if name not in self.memory))


@dataclass(frozen=True)
class Record:
    """A test record: inputs at samples, and the torque that the compiled step of the studies gives, all (n,). top: the
    largest speed; fastest: what the speed changes at most from sample to sample."""

    hold_nm: float
    reference_rad_s: Array
    speed_rad_s: Array
    motor_failed: Array
    torque_nm: Array
    largest_nm: float
    top_rad_s: float
    fastest_rad_s: float


TERMS = {  # what the program does; a term that is none of these, and switched on, is refused
    "controller": ("kind", "sample_time_s", "kp_nm_s_per_rad", "ki_nm_per_rad", "set_point_weight", "anti_windup",
                   "tracking_time_s", "torque_rate_limit_nm_per_s", "low_pass_hz", "notch", "feed_forward"),
    "controller.feed_forward": ("inertia", "weight", "friction", "wire"),
}  # fmt: skip


def check_exported(settings: PiSettings) -> None:
    """InputError, in one line, for a term of the controller that is switched on and that no export knows."""
    for block, record in (("controller", settings), ("controller.feed_forward", settings.feed_forward)):
        for name, declared in type(record).model_fields.items():
            off = declared.get_default(call_default_factory=True)
            if name not in TERMS[block] and getattr(record, name) != off:
                raise InputError("is not exported; take it out of the controller block", place=f"{block}.{name}")


def program_of(settings: PiSettings, machine: Hoist, payload_kg: float = 0.0) -> Program:
    """The controller on a machine, with the machine's torque limits and feed-forward. InputError: `check_exported`."""
    check_exported(settings)
    dt, limits, share = settings.sample_time_s, torque_limits(machine), settings.feed_forward.weight
    w = Program(dt)
    w.number("sample_time_s", dt, "time from call to call")
    w.number("kp", settings.kp_nm_s_per_rad, "proportional gain, N m s/rad")
    w.number("ki", settings.ki_nm_per_rad, "integral gain, N m/rad")
    w.number("set_point_weight", settings.set_point_weight, "of the reference in the proportional part")
    w.number("torque_limit_nm", limits["u_all"], "largest torque of all motors together")
    w.number("torque_limit_one_failed_nm", limits["u_one"], "largest torque after one motor failed")
    w.numbers.extend(_plausible(machine, payload_kg, dt))
    w.keep(integral_nm="torque_hold_nm")
    limit = ["largest = where(motor_failed, torque_limit_one_failed_nm, torque_limit_nm)"]
    if machine.drive.field_weakening:
        w.number("weakening_speed_rad_s", limits["w_weak"], "above it the limit falls as 1/speed")
        # No division by zero on either branch: SEL and where compute both.
        limit.append("largest = largest * min(weakening_speed_rad_s / max(abs(speed), 1e-9), 1.0)")
    w.block("largest torque at this speed", *limit)
    w.block("PI", "wanted = kp * (set_point_weight * reference - speed) + integral_nm")
    if share > 0.0:
        w.number("weight_share", share, "of the holding torque that is fed forward")
        w.memory.append("hold_nm")
        w.reset[:] = ["hold_nm = torque_hold_nm", "integral_nm = torque_hold_nm * (1.0 - weight_share)"]
    if settings.notch is not None:
        names, values = ("b0", "b1", "b2", "a1", "a2"), notch_coefficients(settings.notch, dt)
        for name, value in zip(names, values, strict=True):
            w.number(name, value, f"notch at {settings.notch.frequency_hz:g} Hz")
        w.memory.extend(["z1", "z2"])
        w.reset.extend(["z2 = (b2 - a2) * integral_nm", "z1 = (b1 - a1) * integral_nm + z2"])
        w.block(
            "notch, direct form II transposed",
            "cut = b0 * wanted + z1",
            "z1 = b1 * wanted - a1 * cut + z2",
            "z2 = b2 * wanted - a2 * cut",
            "wanted = cut",
        )
    if settings.low_pass_hz is not None:
        gain = low_pass_gain(settings.low_pass_hz, dt)
        w.number("low_pass_gain", gain, f"low-pass at {settings.low_pass_hz:g} Hz")
        w.keep(smooth="integral_nm")
        w.block("low-pass", "smooth = smooth + low_pass_gain * (wanted - smooth)", "wanted = smooth")
    _feed_forward(w, settings, machine, payload_kg)
    torque = ["torque = min(max(wanted, -largest), largest)"]
    if settings.torque_rate_limit_nm_per_s is not None:
        w.number("torque_step_nm", settings.torque_rate_limit_nm_per_s * dt, "largest change from call to call")
        w.keep(torque_before="torque_hold_nm")
        torque += [
            "torque = min(max(torque, torque_before - torque_step_nm), torque_before + torque_step_nm)",
            "torque_before = torque",
            "command = min(max(torque, -largest), largest)",  # a motor that fails lowers the limit at once
        ]
    else:
        torque.append("command = torque")
    w.block("limits", *torque)
    push, gain_of = "reference - speed", "sample_time_s * ki * "
    integral = [f"integral_nm = integral_nm + {gain_of}(reference - speed)"]
    if settings.anti_windup == "conditional":
        push = f"where((wanted - torque) * ({push}) > 0.0, 0.0, {push})"
        integral = [f"push = {push}", f"integral_nm = integral_nm + {gain_of}push"]
    elif settings.anti_windup == "back_calculation":
        rate = settings.tracking_rate_per_s
        w.number("tracking_rate_per_s", rate, "how fast the integral runs back at a limit")
        push = f"ki * ({push}) + tracking_rate_per_s * (torque - wanted)"
        integral = [f"push = {push}", "integral_nm = integral_nm + sample_time_s * push"]
    w.block("integral and anti-windup", *integral)
    return w


def _plausible(machine: Hoist, payload_kg: float, dt: float) -> list[Number]:
    """The ranges of the checks. The slope: motors at their limit, brake and a wire at its breaking load together, on
    what turns with the motors alone: |dw/dt| <= (T_u + T_b + F r/i)/J."""
    motor, top = machine.motor, machine.motor.nominal_speed_rad_s
    most = torque_limits(machine)["u_all"]
    load_kg = machine.carriage.mass_kg + payload_kg
    wire_n = machine.wire.breaking_load_n or LOADS * load_kg * machine.gravity_m_s2
    at_motor = wire_n * 0.5 * machine.winch.drum_diameter_m / machine.gearbox.ratio
    turning = motor.count * motor.rotor_inertia_kg_m2 + machine.winch.inertia_kg_m2 / machine.gearbox.ratio**2
    slope = (most + BRAKE_TORQUES * motor.count * motor.nominal_torque_nm + at_motor) / turning
    counts = machine.drive.encoder_counts_per_turn
    counted = 4.0 * math.pi / (counts * dt) if counts else 0.0
    return [
        Number("speed_limit_rad_s", SPEED_MARGIN * top, "what is taken as a speed: 1.5 of the largest"),
        Number("speed_step_rad_s", slope * dt + SPEED_NOISE * top + counted, "most that it changes from call to call"),
        Number("state_limit", STATE_TORQUES * max(most, top), "what a memory may come to"),
    ]


def _feed_forward(w: Program, settings: PiSettings, machine: Hoist, payload_kg: float) -> None:
    """The lines of the feed-forward; its numbers are those of `control.feed_forward` for unit inputs."""
    ff, dt, plant = settings.feed_forward, settings.sample_time_s, vars(HOIST.plant.values(machine, payload_kg))

    def torque(inertia: float, friction: float, reference: float, acceleration: float) -> float:
        p = {**plant, "ff_J": inertia, "ff_w": 0.0, "ff_F": friction, "T_hold": 0.0}
        return float(feed_forward(SimpleNamespace(**p), reference, acceleration))

    parts: list[str] = []
    if ff.inertia > 0.0:
        w.number("inertia_kg_m2", torque(ff.inertia, 0.0, 0.0, 1.0), "fed forward, at the motor shaft")
        w.keep(reference_before="0.0")
        parts += [
            "acceleration = (reference - reference_before) / sample_time_s",
            "wanted = wanted + inertia_kg_m2 * acceleration",
            "reference_before = reference",
        ]
    if ff.through_the_wire:  # as `control.pi.behind_the_wire`: takes off what the load's swing leaves to later
        p = SimpleNamespace(**plant)
        squared, damping = swing_of(p)
        swinging = ff.inertia * ff.wire * float(load_inertia(p))
        slow = float(1.0 + dt * damping / 2.0 + dt * dt * squared / 4.0)
        w.number("swinging_kg_m2", swinging, "carriage and payload as the wire passes them on, at the motor shaft")
        w.number("swing_per_s2", float(squared), "stiffness of the wire over the load's mass")
        w.number("swing_damping_per_s", float(damping), "damping of the wire over the load's mass")
        w.number("swing_slow", slow, "of the midpoint rule")
        w.keep(stretch="0.0", stretch_rate="0.0")
        parts += [
            "push = acceleration - swing_per_s2 * stretch",
            "mean_rate = (stretch_rate + sample_time_s * push / 2.0) / swing_slow",
            "mean_stretch = stretch + sample_time_s * mean_rate / 2.0",
            "carried = swing_per_s2 * mean_stretch + swing_damping_per_s * mean_rate",
            "wanted = wanted - swinging_kg_m2 * (acceleration - carried)",
            "stretch = stretch + sample_time_s * mean_rate",
            "stretch_rate = 2.0 * mean_rate - stretch_rate",
        ]
    if ff.weight > 0.0:
        parts.append("wanted = wanted + weight_share * hold_nm")
    if ff.friction > 0.0:
        for name, way, word in (("hoisting", 1.0, "hoists"), ("lowering", -1.0, "lowers")):
            friction = way * torque(0.0, ff.friction, way, 0.0)
            w.number(f"friction_{name}_nm", friction, f"fed forward while the reference {word}")
        parts.append(
            "wanted = wanted + where(reference > 0.0, friction_hoisting_nm, "
            "where(reference < 0.0, -friction_lowering_nm, 0.0))"
        )
    if parts:
        w.block("feed-forward", *parts)


# The reference of a record, of the largest speed: until which part of it, level, slope from 0.05 on.
PROFILE = ((0.05, 0.0, 0.0), (0.3, 0.0, 2.0), (0.5, 0.5, 0.0), (0.6, -0.3, 0.0), (0.8, 1.2, 0.0), (1.0, -0.1, 0.0))
FOLLOWS, RIPPLE, RIPPLES, FAILS_FROM = 0.03, 0.01, 7.0, 0.7


def record_of(settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, samples: int = RECORD_SAMPLES) -> Record:
    """What the compiled step gives for a reference with steps, ramps and rests, a speed that follows it late with a
    ripple, and a motor that fails; long enough to reach the limits and come back."""
    dt, n = settings.sample_time_s, samples
    t, top = dt * np.arange(n), machine.motor.nominal_speed_rad_s
    part = np.arange(n) / n
    shapes = [level + slope * (part - 0.05) for _, level, slope in PROFILE]
    reference = top * np.select([part < until for until, _, _ in PROFILE], shapes)
    fastest = 0.5 * next(x.value for x in _plausible(machine, payload_kg, dt) if x.name == "speed_step_rad_s")
    follows = np.zeros(n)
    for k in range(1, n):
        follows[k] = follows[k - 1] + min(max(FOLLOWS * (reference[k - 1] - follows[k - 1]), -fastest), fastest)
    speed = follows + RIPPLE * top * np.sin(2.0 * math.pi * RIPPLES * part)
    limits = torque_limits(machine)
    hold = 0.3 * limits["u_all"]
    # Without what the drive does to the speed before the controller sees it.
    ideal = {"encoder_counts_per_turn": 0, "speed_filter_s": 0.0, "speed_delay_s": 0.0}
    values: dict[str, Any] = {
        **vars(HOIST.plant.values(machine, payload_kg)),
        **loop_values(settings, machine.drive.model_copy(update=ideal), hold),
        **limits,
        "t_fail": t[round(FAILS_FROM * n)] - 0.5 * dt,
    }
    p = SimpleNamespace(**values)
    controller = full_pi(False, settings.feed_forward.through_the_wire)
    step = Step(controller, p, controller.start(p, hold, 0.0), dt)
    torque = np.array([step(float(r), float(at), float(w), 0.0) for r, at, w in zip(reference, t, speed, strict=True)])
    failed = t >= values["t_fail"]
    # A limited slope leaves the torque beyond one motor's limit for a while; the drive gives no more than the limit.
    largest = np.where(failed, limits["u_one"], limits["u_all"])
    largest = largest * np.minimum(limits["w_weak"] / np.maximum(np.abs(speed), 1e-9), 1.0)
    torque = np.clip(torque, -largest, largest)
    return Record(hold, reference, speed, failed.astype(float), torque, limits["u_all"], top, fastest)


def run(program: Program, record: Record) -> Array:
    """The program's torque for the inputs of a record, (n,). AssertionError where a check fails on the way."""
    scope: dict[str, Any] = {"where": lambda c, a, b: a if c else b, "min": min, "max": max, "abs": abs}
    scope |= {number.name: number.value for number in program.numbers}
    scope |= {"torque_hold_nm": record.hold_nm, "fresh": True, "speed_before": 0.0}
    checks = [(check, compile(check.holds, "<check>", "eval")) for check in program.before]
    code = compile("\n".join(program.lines), "<program>", "exec")
    assert eval(HOLD.holds, scope), HOLD.meaning
    exec("\n".join(program.reset), scope)
    out = np.empty(len(record.torque_nm))
    for k in range(len(out)):
        scope |= {"reference": float(record.reference_rad_s[k]), "speed": float(record.speed_rad_s[k])}
        scope["motor_failed"] = record.motor_failed[k] > 0.5
        for check, holds in checks:
            assert eval(holds, scope), f"sample {k}: {check.meaning}"
        exec(code, scope)
        scope |= {"fresh": False, "speed_before": scope["speed"]}
        out[k] = scope["command"]
    return out


def checked(settings: PiSettings, machine: Hoist, payload_kg: float = 0.0) -> tuple[Program, Record]:
    """The program and its test record. AssertionError where the two differ: then one of them is wrong."""
    program, record = program_of(settings, machine, payload_kg), record_of(settings, machine, payload_kg)
    worst = float(np.max(np.abs(run(program, record) - record.torque_nm)))
    assert worst <= AGREES * record.largest_nm, f"the program is {worst:g} N m off the controller of the studies"
    return program, record


# ---- Its files: C99, structured text and PLCopen XML with self-tests on the record; the parameters of drives ---------


DRIVES = ("siemens-s120", "abb-acs880", "generic")
_JINJA = Environment(undefined=StrictUndefined)


def ramp_of(path: Path) -> Limits | None:
    """The limits of a scenario's motion, both ways alike; None for a file without them."""
    block = load(path).block("limits")
    if block is None:
        return None
    given = validate(LimitsBlock, block).given()
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


COMPARED = 20  # samples between two torques that the self-test in structured text compares
INPUTS = ("speed_reference_rad_s", "speed_motor_rad_s", "motor_failed")
_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
}  # fmt: skip
_C_CALLS = {"abs": "fabs", "min": "fmin", "max": "fmax"}


@dataclass(frozen=True)
class Language:
    """How a language writes calls, names, numbers, and joins truths."""

    call: Callable[[str, list[str]], str]
    name: Callable[[str], str]
    number: Callable[[float], str]
    both: str
    either: str


def expression(text: str, language: Language) -> str:
    """An expression of the program in a language. TypeError for what the program does not take."""

    def show(x: ast.expr) -> str:
        match x:
            case ast.BinOp(left, op, right):
                a, b = show(left), show(right)
                # Left to right in all three languages; brackets wherever that is not plain.
                if isinstance(op, ast.Mult | ast.Div):
                    a = f"({a})" if isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add | ast.Sub) else a
                    b = f"({b})" if isinstance(right, ast.BinOp | ast.UnaryOp) else b
                else:
                    b = f"({b})" if isinstance(right, ast.BinOp) and isinstance(right.op, ast.Add | ast.Sub) else b
                return f"{a} {_OPERATORS[type(op)]} {b}"
            case ast.BoolOp(op, values):
                joint = language.both if isinstance(op, ast.And) else language.either
                return f" {joint} ".join(f"({show(value)})" for value in values)
            case ast.UnaryOp(ast.USub(), operand):
                return f"-{show(operand)}"
            case ast.Compare(left, [op], [right]):
                return f"{show(left)} {_OPERATORS[type(op)]} {show(right)}"
            case ast.Call(ast.Name(function), arguments):
                return language.call(function, [show(a) for a in arguments])
            case ast.Name(word):
                return language.name(word)
            case ast.Constant(int() | float() as value):
                return language.number(float(value))
        raise TypeError(f"the program does not take {ast.unparse(x)}")

    return show(ast.parse(text, mode="eval").body)


def assignment(line: str, language: Language, sign: str) -> str:
    name, _, right = line.partition(" = ")
    return f"{language.name(name)} {sign} {expression(right, language)};"


def c_of(program: Program) -> Language:
    """C99; what is kept stands in the structure `m`."""
    kept = {*program.memory, "fresh", "speed_before"}

    def call(function: str, arguments: list[str]) -> str:
        if function == "where":
            condition, a, b = arguments
            return f"({condition} ? {a} : {b})"
        return f"{_C_CALLS[function]}({', '.join(arguments)})"

    return Language(call, lambda word: f"m->{word}" if word in kept else word, repr, "&&", "||")


def _st_call(function: str, arguments: list[str]) -> str:
    if function == "where":  # SEL gives the third where the first is TRUE
        condition, a, b = arguments
        return f"SEL({condition}, {b}, {a})"
    return f"{function.upper()}({', '.join(arguments)})"


def st_number(value: float) -> str:
    """A literal of structured text: digits on both sides of the point, E for the exponent."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}E{int(exponent):+d}" if exponent else mantissa


ST = Language(
    _st_call, lambda word: {"reference": INPUTS[0], "speed": INPUTS[1]}.get(word, word), st_number, "AND", "OR"
)


def _sections(program: Program) -> dict[str, list[dict[str, str]]]:
    """The variables of the function block by section: name, type, meaning and first value of each."""
    reasons = "; ".join(f"{check.reason} {check.meaning}" for check in CHECKS)
    takes_over = "takes over a load that torque_hold_nm holds, without a bump, ends a fault; TRUE in the first call"
    held = "a check failed: the last torque is held until a reset; wire it to the brake"
    rows: dict[str, list[tuple[str, ...]]] = {
        "VAR_INPUT": [
            ("reset", "BOOL", takes_over), ("torque_hold_nm", "LREAL"), (INPUTS[0], "LREAL"), (INPUTS[1], "LREAL"),
            (INPUTS[2], "BOOL", "one motor gives no torque"),
        ],
        "VAR_OUTPUT": [
            ("torque_motor_nm", "LREAL"), ("limited", "BOOL", "the command is at a limit"), ("fault", "BOOL", held),
            ("fault_reason", "INT", f"0 none; {reasons}"),
        ],
        "VAR CONSTANT": [(n.name, "LREAL", n.meaning, st_number(n.value)) for n in program.numbers],
        "VAR": [
            *((name, "LREAL") for name in (*program.memory, "speed_before", *program.locals, "most_nm")),
            ("fresh", "BOOL"),
        ],
    }  # fmt: skip
    columns = ("name", "kind", "meaning", "start")
    return {
        section: [dict(zip(columns, (*row, "", "")[:4], strict=True)) for row in variables]
        for section, variables in rows.items()
    }


def controller_files(
    form: Literal["st", "c", "yaml"],
    settings: PiSettings,
    machine: Hoist,
    payload_kg: float = 0.0,
    drive: str = "generic",
    ramp: Limits | None = None,
) -> dict[str, str]:
    """File name -> text. InputError for a term of the controller that is not exported."""
    if form == "yaml":
        return {"drive_parameters.yaml": settings_text(drive_settings(drive, settings, machine, payload_kg, ramp))}
    program, record = checked(settings, machine, payload_kg)
    name = machine.name.replace("*", " ").replace("\n", " ")  # ends no comment
    title = f"Sampled PI speed controller for {name}, by workbench {__version__}"
    columns = (record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm)
    rows = list(zip(*(map(float, column) for column in columns), strict=True))
    c = c_of(program)
    environment = Environment(
        loader=PackageLoader("workbench", "export/controller_templates"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {
        "c": lambda text: expression(text, c), "c_line": lambda line: assignment(line, c, "="),
        "st": lambda text: expression(text, ST), "st_line": lambda line: assignment(line, ST, ":="),
        "lreal": st_number, "repr": repr,
    }  # fmt: skip
    values: dict[str, Any] = {
        "title": title, "version": __version__, "program": program, "record": record, "rows": rows,
        "checks": CHECKS, "hold": HOLD, "result": RESULT, "sections": _sections(program), "profile": PROFILE,
        "follows": FOLLOWS, "ripple": RIPPLE, "turn": 2.0 * math.pi * RIPPLES, "compared": COMPARED,
        "expected": record.torque_nm[COMPARED - 1 :: COMPARED].tolist(), "tolerance_nm": AGREES * record.largest_nm,
        "inputs": INPUTS,
    }  # fmt: skip
    values["body"] = environment.get_template("body.st").render(values)
    endings = {"c": (".h", ".c", "_test.c"), "st": (".st", ".xml", "_test.st")}[form]
    names = [f"speed_controller{ending}" for ending in endings]
    return {name: environment.get_template(name).render(values) for name in ("test_record.csv", *names)}
