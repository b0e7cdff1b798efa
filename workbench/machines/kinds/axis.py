"""`kind: axis`: one inertia, driven directly, linear or rotary.

    input = M a + B v + F S(v) + G sin(position) + C

M inertia (kg, kg m^2), B viscous, F Coulomb with a level for each way, G sine load (rotary only), C constant load,
positive against forward motion. Friction values are magnitudes; loads may have either sign. Source: the axis'
equation of docs/formats.md; real logs of such an axis: A. Janot, M. Gautier, M. Brunot, "Data Set and Reference
Models of EMPS", Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from workbench.core import record
from workbench.core.record import Record, by_name, renamed
from workbench.core.run import Array, Run, integrated
from workbench.machines import declare
from workbench.machines.correction import MeasuredCorrection, Numbers
from workbench.machines.declare import ClosedLoop, Kind, Load, Sizes, Value
from workbench.machines.plant import NO_EFFECTS, Effects, Output, Plant
from workbench.symbolic.expr import Scalar, Scalars, Signals, absolute, clip, cos, sin, where

SHORTEST_STEP_S = 1e-4  # of a simulation of fixed steps


class LinearGravity(Record):
    constant_n: record.Offset = 0.0


class RotaryGravity(Record):
    sine_nm: record.Offset = 0.0
    constant_nm: record.Offset = 0.0


class LinearFriction(Record):
    """Below `standstill_speed_m_s` the Coulomb force falls linearly to zero with the speed."""

    coulomb_forward_n: record.Level
    coulomb_backward_n: record.Level
    viscous_n_s_per_m: record.Slope
    standstill_speed_m_s: record.Standstill = 1e-4


class RotaryFriction(Record):
    """Below `standstill_speed_rad_s` the Coulomb torque falls linearly to zero with the speed."""

    coulomb_forward_nm: record.Level
    coulomb_backward_nm: record.Level
    viscous_nm_s_per_rad: record.Slope
    standstill_speed_rad_s: record.Standstill = 1e-4


class AxisTolerances(Record):
    """One standard deviation of each nominal value, relative unless the name carries a unit."""

    inertia: record.Tolerance = 0.02
    coulomb: record.Tolerance = 0.05
    viscous: record.Tolerance = 0.1
    gravity: record.Tolerance = 0.05


OFFSET_TOLERANCE = 0.001  # of the largest measured input, where the file gives none: a transducer of class 0.1


class LinearTolerances(AxisTolerances):
    """`torque_gain` and `torque_offset_nm` are accepted as other names of force_gain and force_offset_n."""

    force_gain: record.Tolerance = 0.005
    force_offset_n: record.Level | None = None

    @model_validator(mode="before")
    @classmethod
    def _other_names(cls, data: object) -> object:
        return renamed(renamed(data, "torque_gain", "force_gain"), "torque_offset_nm", "force_offset_n")


class RotaryTolerances(AxisTolerances):
    """`force_gain` and `force_offset_n` are accepted as other names of torque_gain and torque_offset_nm."""

    torque_gain: record.Tolerance = 0.005
    torque_offset_nm: record.Level | None = None

    @model_validator(mode="before")
    @classmethod
    def _other_names(cls, data: object) -> object:
        return renamed(renamed(data, "force_gain", "torque_gain"), "force_offset_n", "torque_offset_nm")


class LinearSensors(Record):
    """Logged force = gain · true force + offset."""

    force_gain: record.Gain = 1.0
    force_offset_n: record.Offset = 0.0


class RotarySensors(Record):
    """Logged torque = gain · true torque + offset."""

    torque_gain: record.Gain = 1.0
    torque_offset_nm: record.Offset = 0.0


COUNTS = Field(ge=0, le=100_000_000, strict=True)


class AxisDrive(Record):
    """The drive as the speed loop meets it. A missing key has a round figure on the slow side of servo drives;
    docs/formats.md tells what makers state.

    torque_lag_s: first-order lag of the current loop; 0.5 ms rise in 1.1 ms from a tenth to nine tenths.
    speed_filter_s: first-order filter of the measured speed. speed_delay_s: transport delay of the measured speed and
    position; 1 ms is one sample, the computing delay of a controller that acts at its next sample.
    """

    torque_lag_s: record.Lag = 0.0005
    speed_filter_s: record.Lag = 0.001
    speed_delay_s: record.Delay = 0.001

    KEYS: ClassVar[tuple[str, str, str]]  # of the limit, the nominal input and the top speed

    @property
    def limit(self) -> float:
        """N or N m; inf where none is stated."""
        stated = getattr(self, self.KEYS[0])
        return math.inf if stated is None else float(stated)

    @property
    def nominal(self) -> float | None:
        return getattr(self, self.KEYS[1])

    @property
    def top_speed(self) -> float | None:
        return getattr(self, self.KEYS[2])


class LinearDrive(AxisDrive):
    """force_limit_n: the largest force, either way; nominal_force_n: the one that it gives without end. top_speed_m_s:
    what no motion may exceed. encoder_counts_per_m: the resolution of position and counted speed, 0 is ideal."""

    force_limit_n: record.Force | None = None
    nominal_force_n: record.Force | None = None
    top_speed_m_s: record.Speed | None = None
    encoder_counts_per_m: Annotated[int, COUNTS] = 10_000_000

    KEYS: ClassVar[tuple[str, str, str]] = ("force_limit_n", "nominal_force_n", "top_speed_m_s")

    @property
    def encoder_counts_per_turn(self) -> float:
        """Counts over 2 pi of the driven coordinate."""
        return 2.0 * math.pi * self.encoder_counts_per_m


class RotaryDrive(AxisDrive):
    """torque_limit_nm: the largest torque, either way; nominal_torque_nm: the one that it gives without end.
    top_speed_rad_s: what no motion may exceed. encoder_counts_per_turn: the resolution of angle and counted speed, 0 is
    ideal."""

    torque_limit_nm: record.Force | None = None
    nominal_torque_nm: record.Force | None = None
    top_speed_rad_s: record.Speed | None = None
    encoder_counts_per_turn: Annotated[int, COUNTS] = 1_048_576

    KEYS: ClassVar[tuple[str, str, str]] = ("torque_limit_nm", "nominal_torque_nm", "top_speed_rad_s")


_IDEAL = {"torque_lag_s": 0.0, "speed_filter_s": 0.0, "speed_delay_s": 0.0}
# What `drive:` may be by name, in place of a block.
LINEAR_DRIVES = {"standard": LinearDrive(), "ideal": LinearDrive(**_IDEAL, encoder_counts_per_m=0)}
ROTARY_DRIVES = {"standard": RotaryDrive(), "ideal": RotaryDrive(**_IDEAL, encoder_counts_per_turn=0)}


class LinearCorrection(MeasuredCorrection):
    """A force on a linear axis, N."""

    over: Literal["velocity_m_s", "position_m", "time_s", "campaign_time_s"]
    acts_on: Literal["axis"] = "axis"
    forward_n: Numbers
    backward_n: Numbers

    MAGNITUDES: ClassVar[tuple[str, ...]] = ("velocity_m_s",)
    UNITS: ClassVar[Mapping[str, str]] = {"axis": "n"}


class RotaryCorrection(MeasuredCorrection):
    """A torque on a rotary axis, N m. angle_in_turn_rad is periodic, angle_rad goes on and on."""

    over: Literal["speed_rad_s", "angle_rad", "angle_in_turn_rad", "time_s", "campaign_time_s"]
    acts_on: Literal["axis"] = "axis"
    forward_nm: Numbers
    backward_nm: Numbers

    PERIODIC: ClassVar[tuple[str, ...]] = ("angle_in_turn_rad",)
    MAGNITUDES: ClassVar[tuple[str, ...]] = ("speed_rad_s",)
    UNITS: ClassVar[Mapping[str, str]] = {"axis": "nm"}


class Axis(Record):
    """What all axes share. The class attributes name their keys and signals alike."""

    format: Literal[1] = 1
    kind: str = "axis"
    name: str = "axis"
    drive: LinearDrive | RotaryDrive = LinearDrive()
    tolerances: AxisTolerances = AxisTolerances()
    effects: record.EffectValues = Field(default_factory=dict)
    # The small amounts of effects that every machine of the kind has: at work as effects are, and no causes.
    allowances: record.EffectValues = Field(default_factory=dict)
    log: record.LogTraits = record.LogTraits()
    measured_correction: MeasuredCorrection | None = None
    identified: record.Identified = Field(default_factory=dict)

    value_of: ClassVar[dict[str, str]]  # role -> dotted name of the value, the same roles for every axis
    input_signal: ClassVar[str]
    position_signal: ClassVar[str]
    speed_signal: ClassVar[str]
    reference_signal: ClassVar[str]
    CORRECTION: ClassVar[type[MeasuredCorrection]]

    def role(self, name: str) -> float:
        """The value of a role, or the tolerance of the input's gain; 0 of what the axis does not have."""
        if name == "gain_tolerance":
            return float(getattr(self.tolerances, self.value_of["gain"].rpartition(".")[2]))
        dotted = self.value_of[name]
        return float(attrgetter(dotted)(self)) if dotted else 0.0

    def offset_tolerance(self, largest_input: float) -> float:
        """Tolerance of the input's offset, in the input's unit; where missing, 0.1 % of the largest measured input."""
        stated = getattr(self.tolerances, self.value_of["offset"].rpartition(".")[2])
        return OFFSET_TOLERANCE * largest_input if stated is None else float(stated)


def _roles(inertia: str, quantity: str, n: str, m: str, sine: str) -> dict[str, str]:
    """Role -> dotted name of the value, of an axis in these units."""
    return {
        "inertia": inertia,
        "viscous": f"friction.viscous_{n}_s_per_{m}",
        "coulomb_forward": f"friction.coulomb_forward_{n}",
        "coulomb_backward": f"friction.coulomb_backward_{n}",
        "standstill": f"friction.standstill_speed_{m}_s",
        "gravity_sine": sine,
        "gravity_constant": f"gravity.constant_{n}",
        "gain": f"sensors.{quantity}_gain",
        "offset": f"sensors.{quantity}_offset_{n}",
    }


class LinearAxis(Axis):
    """`motion: linear`: kg, N, m."""

    kind: Literal["axis"] = "axis"
    motion: Literal["linear"] = "linear"
    name: str = "linear axis"
    mass_kg: record.Mass
    gravity: LinearGravity = LinearGravity()
    friction: LinearFriction
    drive: Annotated[LinearDrive, *by_name(LINEAR_DRIVES)] = LinearDrive()
    sensors: LinearSensors = LinearSensors()
    tolerances: LinearTolerances = LinearTolerances()
    measured_correction: LinearCorrection | None = None

    value_of: ClassVar[dict[str, str]] = _roles("mass_kg", "force", "n", "m", "")
    input_signal: ClassVar[str] = "force_n"
    position_signal: ClassVar[str] = "position_m"
    speed_signal: ClassVar[str] = "velocity_m_s"
    reference_signal: ClassVar[str] = "position_reference_m"
    CORRECTION: ClassVar[type[MeasuredCorrection]] = LinearCorrection


class Rotary(Axis):
    """What all axes in N m and rad share, whatever turns."""

    drive: Annotated[RotaryDrive, *by_name(ROTARY_DRIVES)] = RotaryDrive()
    sensors: RotarySensors = RotarySensors()
    tolerances: RotaryTolerances = RotaryTolerances()
    measured_correction: RotaryCorrection | None = None

    value_of: ClassVar[dict[str, str]] = _roles("inertia_kg_m2", "torque", "nm", "rad", "gravity.sine_nm")
    input_signal: ClassVar[str] = "torque_nm"
    position_signal: ClassVar[str] = "angle_rad"
    speed_signal: ClassVar[str] = "speed_rad_s"
    reference_signal: ClassVar[str] = "angle_reference_rad"
    CORRECTION: ClassVar[type[MeasuredCorrection]] = RotaryCorrection


class RotaryAxis(Rotary):
    """`motion: rotary`: kg m², N m, rad."""

    kind: Literal["axis"] = "axis"
    motion: Literal["rotary"] = "rotary"
    name: str = "rotary axis"
    inertia_kg_m2: record.Inertia
    gravity: RotaryGravity = RotaryGravity()
    friction: RotaryFriction


PLACES = {
    "axis_force": "force (torque) on an axis, forward positive",
    "axis_inertia": "inertia of an axis",
    "axis_switch": "what dry friction follows beyond the sign of the speed, -1 to 1",
}


def switch(v: Scalar, p: Any) -> Scalar:
    """The sign of a speed, linear within the standstill speed."""
    return clip(v / p.v_s, -1.0, 1.0)


def switch_at(t: Scalar, v: Scalar, p: Any, effects: Effects) -> Scalar:
    """What all dry friction of the axis follows, -1 to 1: the sign of the speed, or what an effect makes of it."""
    sign = switch(v, p)
    return sign + effects.at("axis_switch", p, t=t, v=v, switch=sign)


def level(sign: Scalar, p: Any) -> Scalar:
    """The Coulomb level of the way that `sign` says, a speed or a switch; N or N m."""
    return where(sign > 0.0, p.F_f, p.F_b)


def friction(v: Scalar, p: Any, sign: Scalar | None = None) -> Scalar:
    """Coulomb and viscous friction along v; N or N m. sign: what the dry part follows, else the sign of v."""
    s = switch(v, p) if sign is None else sign
    return level(s, p) * s + p.B * v


def equilibrium(position: float, p: Any) -> tuple[list[float], float]:
    """Standing still at a position, and the input that holds it without friction's help."""
    return [position], p.G * sin(position) + p.C


def start_of(position: float, speed: float, p: Any) -> tuple[list[float], list[float], float]:
    q, hold = equilibrium(position, p)
    return q, [speed], hold


def band_hz(p: Any) -> float:
    """90 Hz: beyond, the noise of a twice differentiated encoder outweighs what drives and friction do."""
    return 90.0


def dissipation(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any) -> Scalar:
    """Power lost in friction, W; never negative."""
    return friction(y[0], p) * y[0]


def axis_values(machine: type[Axis]) -> tuple[Value, ...]:
    """The values that all axes have. The dynamics are what a fit looks for: free there, and held in a diagnosis."""
    key = machine.value_of
    rows: tuple[tuple[str, str, str, str], ...] = (
        ("inertia", "M", "inertia", ""),
        ("viscous", "B", "viscous", "input/speed"),
        ("coulomb_forward", "F_f", "coulomb", "input"),
        ("coulomb_backward", "F_b", "coulomb", "input"),
        ("gravity_sine", "G", "gravity", "input"),
        ("gravity_constant", "C", "gravity", "input"),
    )
    gain, offset = (key[role].rpartition(".")[2] for role in ("gain", "offset"))
    return (
        *(
            Value(
                key[role], symbol, tolerance, in_fit=False, free=role != "gravity_sine", signed=tolerance == "gravity",
                scale=scale,
            )
            for role, symbol, tolerance, scale in rows
            if key[role]
        ),
        Value(key["gain"], tolerance=gain, scale="input"),
        Value(key["offset"], "", offset, "absolute", OFFSET_TOLERANCE, signed=True, scale="input"),
        Value(key["standstill"], "v_s", spread="factor", in_fit=False),
    )  # fmt: skip


def axis_plant(
    kind: str, machine: type[Axis], values: Sequence[Value], inertia: Callable[[Any], Scalar] = lambda p: p.M
) -> Plant:
    """An axis' plant. inertia(p): all that moves, kg or kg m^2; p.M is what effects on the inertia are a share of."""
    position, speed = machine.position_signal, machine.speed_signal
    acceleration = "acceleration_m_s2" if machine.input_signal == "force_n" else "acceleration_rad_s2"

    def accelerations(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Scalars:
        """Acceleration of the axis under the input u (N or N m)."""
        (x,), (v,) = q, y
        M = inertia(p) + effects.at("axis_inertia", p, t=t, x=x)
        load = p.G * sin(x) + p.C
        sign = switch_at(t, v, p, effects)
        own = friction(v, p, sign)
        extra = effects.at("axis_force", p, t=t, v=v, x=x, angle=x, switch=sign, load=load, friction=own)
        return [(u - own - load + extra) / M]

    def outputs(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Signals:
        (a,) = accelerations(t, q, y, u, p, effects)
        return {position: q[0], speed: y[0], acceleration: a}

    def energy(q: Scalars, y: Scalars, p: Any) -> Scalar:
        """Kinetic and load energy, J, the sine load's zero at angle 0."""
        return inertia(p) * (y[0] * y[0]) / 2.0 + p.G * (1.0 - cos(q[0])) + p.C * q[0]

    return Plant(
        kind=kind,
        positions=(position,),
        speeds=(speed,),
        input=machine.input_signal,
        parameters={"G": 0.0, **declare.parameters_of(values)},
        places=PLACES,
        signals=(Output(position, "position"), Output(speed, "speed"), Output(acceleration, "acceleration")),
        accelerations=accelerations,
        outputs=outputs,
        equilibrium=equilibrium,
        energy=energy,
        dissipation=dissipation,
        start_of=start_of,
        band_hz=band_hz,
    )


def _sizes(kind: str, m: Axis, runs: Sequence[Run]) -> Sizes:
    """An axis says little about its own sizes, so its runs are asked where there are any."""
    inertia = m.role("inertia")
    force = max([float(np.max(np.abs(run[m.input_signal]))) for run in runs], default=0.0)
    coulomb = 0.5 * (m.role("coulomb_forward") + m.role("coulomb_backward"))
    said = coulomb + abs(m.role("gravity_sine")) + abs(m.role("gravity_constant"))
    length = max([_travel(m, run) for run in runs], default=0.0) or (1.0 if m.input_signal == "force_n" else math.pi)
    speed = max([_fastest(m, run) for run in runs], default=0.0) or length  # once through it in a second
    force = force or said or inertia * length
    return Sizes(
        kind=kind,
        force=force,
        torque=force,
        speed=speed,
        motor_speed=speed,
        length=length,
        radius=length,
        drum_angle=length,
        mass=inertia,
        inertia=inertia,
    )


def _travel(m: Axis, run: Run) -> float:
    if m.position_signal in run:
        return float(np.ptp(run[m.position_signal]))
    return float(np.ptp(integrated(run[m.speed_signal], run.time_s)))


def _fastest(m: Axis, run: Run) -> float:
    if m.speed_signal in run:
        return float(np.max(np.abs(run[m.speed_signal])))
    # The mean over a hundredth of the run: one sample's step of a noisy encoder is no speed.
    window = max(1, len(run.time_s) // 100)
    position, time = run[m.position_signal], run.time_s
    return float(np.max(np.abs((position[window:] - position[:-window]) / (time[window:] - time[:-window]))))


def rigid(m: Axis, payload_kg: float) -> declare.RigidBody:
    """It need not hold its load: friction may. A sine load goes with the angle."""
    return declare.RigidBody(m.role("inertia"), 0.0, wave=m.role("gravity_sine") != 0.0)


def cross_checks(
    m: Axis, run: Run, position: Array, smooth: Callable[[Array], Array], slope: Callable[[Array, Array], float]
) -> Iterator[declare.CrossCheck]:
    """Position against the way that the speed makes, where both are logged: at an even speed what either shows beside
    that is its noise. An offset of the speed adds up to any way: there the speeds are compared, if they are alike."""
    at, speed = m.position_signal, m.speed_signal
    if at in run and speed in run:
        way = integrated(run[speed], run.time_s)
        ratios = [slope(way, run[at]), slope(smooth(run[speed]), smooth(np.gradient(run[at], run.time_s)))]
        ratio = min(ratios, key=lambda one: (one == 0.0, abs(one - 1.0)))
        said = (
            f"{at} does not change as {speed} says; are both of one motion and clock, or does the log hold old values?"
        )
        if ratio != 0.0:
            said = f"{at} changes {ratio:.3g} times as fast as {speed} says; is the sign of one of them flipped, "
            said += "or are they in different units?"
        yield declare.CrossCheck(ratio, said, way=max(float(np.ptp(way)), float(np.ptp(run[at]))))


def _transmitted(p: Any, s: Any, u: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    return np.asarray(p.G * np.sin(s.x) + p.C), float(p.M)


def _level(m: Axis) -> float:
    return 0.5 * float(m.role("coulomb_forward") + m.role("coulomb_backward"))


def _way(s: Any, p: Any) -> Array:
    return np.clip(s.v / p.v_s, -1.0, 1.0)


def _load(m: Any, payload_kg: float) -> Load | None:
    """One stiff mass; None under a load that goes with the angle. Viscous friction is left out."""
    if m.role("gravity_sine") != 0.0:
        return None
    return Load(
        drive_kg=m.role("inertia"),
        mass_kg=0.0,
        stiffness_n_per_m=math.inf,
        damping_time_s=0.0,
        hold_n=m.role("gravity_constant"),
        friction_up_n=m.role("coulomb_forward"),
        friction_down_n=m.role("coulomb_backward"),
        force_limit_n=m.drive.limit,
        hangs=False,
    )


def _top_speed(m: Any) -> declare.TopSpeed:
    top = m.drive.top_speed
    unit = "m/s" if m.input_signal == "force_n" else "rad/s"
    return declare.TopSpeed(
        math.inf if top is None else top, f"{{limit:g}} {unit} is beyond the drive's top speed, {top:g}" if top else ""
    )


def _even_speed(m: Any) -> float:
    """Half of the top speed; where none is stated a tenth of a metre or one radian a second."""
    usual = 0.1 if m.input_signal == "force_n" else 1.0
    return 0.5 * m.drive.top_speed if m.drive.top_speed else usual


def _input_scale(m: Any) -> float:
    """What the drive gives without end, else at most; where neither is stated what friction and load take."""
    limit = m.drive.limit
    stated = m.drive.nominal or (limit if math.isfinite(limit) else 0.0)
    said = 0.5 * (m.role("coulomb_forward") + m.role("coulomb_backward"))
    said += abs(m.role("gravity_sine")) + abs(m.role("gravity_constant"))
    return float(stated or said or m.role("inertia"))


def _drive_words(m: Any) -> str:
    drive, unit = m.drive, "N" if m.input_signal == "force_n" else "N m"
    speed = "m/s" if m.input_signal == "force_n" else "rad/s"
    stated = [f"nominal {drive.nominal:g} {unit}"] if drive.nominal is not None else []
    stated += [f"limit {drive.limit:g} {unit}"] if math.isfinite(drive.limit) else ["no limit stated"]
    stated += [f"top speed {drive.top_speed:g} {speed}"] if drive.top_speed is not None else []
    lags = (("lag", drive.torque_lag_s), ("speed filter", drive.speed_filter_s), ("delay", drive.speed_delay_s))
    stated += [f"{name} {1e3 * value:g} ms" for name, value in lags if value > 0.0]
    return ", ".join(stated)


def _longest_step_s(m: Axis) -> float:
    """Friction turns over within the standstill speed as a lag of M v_s/F does. Three lags a step leave a thousandth;
    below a tenth of a millisecond no shorter step tells of more."""
    level = max(m.role("coulomb_forward"), m.role("coulomb_backward"))
    return max(SHORTEST_STEP_S, 3.0 * m.role("inertia") * m.role("standstill") / level) if level else math.inf


def _closed_loop(machine: type[Axis], plant: Plant, values: Sequence[Value]) -> ClosedLoop:
    """A position loop over a sampled PI speed loop, both at the motor's encoder."""
    position, speed = machine.position_signal, machine.speed_signal
    linear = machine.input_signal == "force_n"
    references = (machine.reference_signal, "velocity_reference_m_s" if linear else "speed_reference_rad_s")
    shown = (name for name in (signal.name for signal in plant.signals) if name not in (position, speed))
    return ClosedLoop(
        position=position,
        speed=speed,
        references=references,
        recorded=(machine.input_signal, position, speed, *references, *shown),
        rail=lambda m: (-math.inf, math.inf),
        top=lambda m: math.inf,
        per_displacement=lambda m: 1.0,
        top_speed=_top_speed,
        speed_scale=lambda m: 2.0 * _even_speed(m),
        input_scale=_input_scale,
        total_inertia=lambda m, payload_kg: float(m.role("inertia")),
        even_speed=_even_speed,
        # A sine load pulls, pushes and springs: at its top, on its way, at its bottom.
        places=lambda m: (0.0,) if m.role("gravity_sine") == 0.0 else (0.0, 0.5 * math.pi, math.pi),
        start="the axis' position",
        input_limit=lambda m: float(m.drive.limit),
        peak_limit=lambda m: float(m.drive.limit),
        nominal=lambda m: m.drive.nominal,
        drive_words=_drive_words,
        giver="the drive gives",
        swing="the load swings on its coupling while the motor stands",
        where=lambda payload_kg, place: f"{place:g} {'m' if linear else 'rad'}",
        motion_words={"hoisting": "forward", "lowering": "backward", "at_rest": "at_rest"},
        more_often=("at every position", "position"),
        drawn=tuple(value.key for value in values if value.symbol and not value.exact and value.spread == "relative"),
        position_loop=True,
        inertia=lambda p: p.M,
        load=lambda p, x: p.G * sin(x) + p.C,
        # Of a reference's speed: the Coulomb level of its way, nothing at standstill, and the viscous part.
        friction=lambda p, v: where(v > 0.0, p.F_f, where(v < 0.0, -p.F_b, 0.0)) + p.B * v,
    )


def axis_kind(
    machine: type[Axis], plant: Plant, values: tuple[Value, ...], example: Mapping[str, Any], noun: str = "axis"
) -> Kind:
    """The declaration of an axis; noun: of what its encoder shows."""
    key, position, speed = machine.value_of, machine.position_signal, machine.speed_signal
    linear = machine.input_signal == "force_n"
    drive = declare.Input("force", "N", "n") if linear else declare.Input("torque", "N m", "nm")
    unit, family = ("m", "axis-linear") if linear else ("rad", "axis-rotary")
    tables = [
        declare.Table(speed, "axis", lambda s, p: absolute(s.v)),
        declare.Table(position, "axis", lambda s, p: s.x),
        declare.Table("angle_in_turn_rad", "axis", lambda s, p: s.x, turn=True),
        declare.Table("time_s", "axis", lambda s, p: s.t),
        declare.Table("campaign_time_s", "axis", lambda s, p: s.t + p.start_time_s),
    ]
    angle = "motor's angle within a turn" if noun == "motor" else "angle within a turn"
    return Kind(
        name=plant.kind,
        record=machine,
        noun="axis",
        plant=plant,
        values=values,
        example=lambda: machine.model_validate(example),
        family=tuple(dict.fromkeys((plant.kind, family, "axis"))),
        words={"n": drive.suffix, "m": unit, "input": drive.suffix, "up": "forward", "dn": "backward"},
        drive=drive,
        moved=declare.Moved(
            noun, unit, f"{'position' if noun == 'axis' else 'angle'} of the {noun}", placed_by_log=True
        ),
        directions=declare.Directions(
            ("forward", "backward"), (("go forward", "a way back"), ("go backward", "a way forward")), "Forward"
        ),
        signals=declare.SignalSet(
            needed=(((declare.TIME,),), ((machine.input_signal,),), ((position,), (speed,))),
            optional=(machine.reference_signal,),
        ),
        reference=(machine.reference_signal, position),
        speed_scale=("the largest measured speed", "largest"),
        sensor=(key["gain"], key["offset"]),
        friction=declare.Friction(("F_f", "F_b"), {"B": 0.0}, speed, friction, viscous=True, unit=drive.unit),
        sizes=partial(_sizes, plant.kind),
        rigid=rigid,
        bridged_impacts=True,
        transmitted=_transmitted,
        tables=tuple(table for table in tables if not (linear and table.turn)),
        ports={"axis": declare.Port("axis_force", drive.unit, "v", lambda s, p: s.switch, _way, on_moved=False)},
        floor="own",
        # Cogging of a few tenths of a per cent of the largest input, and bristles of a thousandth of the travel.
        nuisances=(
            declare.NuisancePrior("torque_ripple", lambda m, sizes: 0.003 * sizes.force, fitted=False),
            declare.NuisancePrior("presliding", lambda m, sizes: 0.0005 * sizes.length),
            declare.NuisancePrior("friction_stribeck", lambda m, sizes: 0.05 * _level(m), fitted=False),
        ),
        model_error=declare.ModelError(0.004, 0.004, standstill=0.05, slow=0.05, time_s=0.06, of_largest=True),
        whole="axis",
        # The two Coulomb levels and the constant load show as two levels only: forward + load, backward - load.
        ties=(((key["coulomb_forward"], key["coulomb_backward"]), key["gravity_constant"]),),
        turning=() if linear else (declare.Turning("axis", lambda m: 1.0 / (2.0 * math.pi), ("angle", angle)),),
        cross_checks=cross_checks,
        load=_load,
        closed_loop=_closed_loop(machine, plant, values),
        longest_step_s=_longest_step_s,
    )


def _simple(name: str, machine: type[Axis], example: Mapping[str, Any]) -> Kind:
    values = axis_values(machine)
    return axis_kind(machine, axis_plant(name, machine, values), values, example)


LINEAR = _simple(
    "axis-linear",
    LinearAxis,
    {
        "mass_kg": 95.0,
        "gravity": {"constant_n": 3.0},
        "friction": {"coulomb_forward_n": 20.0, "coulomb_backward_n": 18.0, "viscous_n_s_per_m": 200.0},
    },
)
ROTARY = _simple(
    "axis-rotary",
    RotaryAxis,
    {
        "inertia_kg_m2": 0.4,
        "gravity": {"sine_nm": 6.0, "constant_nm": 0.5},
        "friction": {"coulomb_forward_nm": 1.5, "coulomb_backward_nm": 1.2, "viscous_nm_s_per_rad": 0.1},
    },
)
