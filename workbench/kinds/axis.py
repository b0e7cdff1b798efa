"""The axes: one inertia, driven directly, linear or rotary."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from workbench.kinds.closed_loop import ClosedLoop, TopSpeed
from workbench.kinds.load import Load
from workbench.kinds.record import (
    TIME,
    BaseValue,
    CrossCheck,
    Directions,
    Discrepancy,
    Drive,
    Friction,
    Kind,
    Moved,
    Port,
    RigidBody,
    SignalSet,
    Table,
    Trace,
    Turning,
)
from workbench.kinds.sizes import Sizes
from workbench.machine.axis import OFFSET_TOLERANCE, Axis, LinearAxis, RotaryAxis
from workbench.plants import Plant
from workbench.plants.axis import AXIS_LINEAR, AXIS_ROTARY, friction
from workbench.run import Array, Run
from workbench.trace.expr import Scalar, absolute, sin, where

DIRECTIONS = Directions(
    ("forward", "backward"), (("go forward", "a way back"), ("go backward", "a way forward")), "Forward"
)


def sizes(kind: str, m: Axis, runs: Sequence[Run]) -> Sizes:
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
    return float(np.ptp(np.cumsum(run[m.speed_signal]) * run.sample_time_s))


def _fastest(m: Axis, run: Run) -> float:
    if m.speed_signal in run:
        return float(np.max(np.abs(run[m.speed_signal])))
    # The mean over a hundredth of the run: one sample's step of a noisy encoder is no speed.
    window = max(1, len(run.time_s) // 100)
    position, time = run[m.position_signal], run.time_s
    return float(np.max(np.abs((position[window:] - position[:-window]) / (time[window:] - time[:-window]))))


def rigid(m: Axis, payload_kg: float) -> RigidBody:
    """It need not hold its load: friction may. A sine load goes with the angle."""
    return RigidBody(m.role("inertia"), 0.0, wave=m.role("gravity_sine") != 0.0)


def cross_checks(
    m: Axis, run: Run, position: Array, smooth: Callable[[Array], Array], slope: Callable[[Array, Array], float]
) -> Iterator[CrossCheck]:
    """Position against speed, where both are logged."""
    at, speed = m.position_signal, m.speed_signal
    if at in run and speed in run:
        ratio = slope(smooth(run[speed]), np.gradient(smooth(run[at]), run.time_s))
        yield CrossCheck(
            ratio,
            f"{at} changes {ratio:.3g} times as fast as {speed} says; is the sign of one of them flipped, "
            "or are they in different units?",
        )


def _transmitted(p: Any, s: Any, u: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    return np.asarray(p.G * np.sin(s.x) + p.C), float(p.M)


def _way(s: Any, p: Any) -> Array:
    return np.clip(s.v / p.v_s, -1.0, 1.0)


def _base(machine: type[Axis], standstill: str) -> tuple[BaseValue, ...]:
    """The dynamics of an axis are what a fit looks for: free there, and held in a diagnosis."""
    key = machine.value_of
    relative = {
        "inertia": "inertia",
        "viscous": "viscous",
        "coulomb_forward": "coulomb",
        "coulomb_backward": "coulomb",
        "gravity_sine": "gravity",
        "gravity_constant": "gravity",
    }
    gain, offset = (key[role].rpartition(".")[2] for role in ("gain", "offset"))
    return (
        *(
            BaseValue(key[role], tolerance, in_fit=False, signed=tolerance == "gravity")
            for role, tolerance in relative.items()
            if key[role]
        ),
        BaseValue(key["gain"], gain),
        BaseValue(key["offset"], offset, spread="absolute", default=OFFSET_TOLERANCE, signed=True),
        BaseValue(standstill, spread="factor", in_fit=False),
    )


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


def _feed_forward_friction(p: Any, v: Scalar) -> Scalar:
    """Of a reference's speed: the Coulomb level of its way, nothing at standstill, and the viscous part."""
    return where(v > 0.0, p.F_f, where(v < 0.0, -p.F_b, 0.0)) + p.B * v


def _top_speed(m: Any) -> TopSpeed:
    top = m.drive.top_speed
    unit = "m/s" if m.input_signal == "force_n" else "rad/s"
    return TopSpeed(
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


def closed_loop(machine: type[Axis], plant: Plant) -> ClosedLoop:
    """A position loop over a sampled PI speed loop, both at the motor's encoder."""
    position, speed = machine.position_signal, machine.speed_signal
    linear = machine.input_signal == "force_n"
    key = machine.value_of
    roles = ("inertia", "viscous", "coulomb_forward", "coulomb_backward", "gravity_sine", "gravity_constant")
    references = (machine.reference_signal, "velocity_reference_m_s" if linear else "speed_reference_rad_s")
    shown = (name for name in (signal.name for signal in plant.signals) if name not in (position, speed))
    return ClosedLoop(
        position=position,
        speed=speed,
        references=references,
        recorded=(machine.input_signal, position, speed, *references, *shown),
        rail=lambda m: (-math.inf, math.inf),
        top=lambda m: math.inf,
        per_way=lambda m: 1.0,
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
        drawn=tuple(key[role] for role in roles if key[role]),
        position_loop=True,
        inertia=lambda p: p.M,
        load=lambda p, x: p.G * sin(x) + p.C,
        friction=_feed_forward_friction,
    )


def axis_kind(
    machine: type[Axis],
    plant: Plant,
    *,
    family: tuple[str, ...],
    drive: Drive,
    moved: Moved,
    standstill: str,
    turning: tuple[Turning, ...] = (),
    more: dict[str, Any] | None = None,
) -> Kind:
    """The record of an axis of one motion. more: further fields, or others in place of an axis' own."""
    key, unit = machine.value_of, drive.suffix
    position, speed = machine.position_signal, machine.speed_signal
    levels = [key[role] for role in ("coulomb_forward", "coulomb_backward", "gravity_sine", "gravity_constant")]
    over = (Table(speed, "axis", lambda s, p: absolute(s.v)), Table(position, "axis", lambda s, p: s.x))
    turns = (Table("angle_in_turn_rad", "axis", lambda s, p: s.x, turn=True),) if turning else ()
    clocks = (
        Table("time_s", "axis", lambda s, p: s.t),
        Table("campaign_time_s", "axis", lambda s, p: s.t + p.start_time_s),
    )
    fields: dict[str, Any] = {
        "name": plant.kind,
        "noun": "axis",
        "plant": plant,
        "family": family,
        "words": {"n": unit, "m": moved.unit, "input": unit, "up": "forward", "dn": "backward"},
        "drive": drive,
        "moved": moved,
        "directions": DIRECTIONS,
        "signals": SignalSet(
            needed=(((TIME,),), ((machine.input_signal,),), ((position,), (speed,))),
            optional=(machine.reference_signal,),
        ),
        "reference": (machine.reference_signal, position),
        "speed_scale": ("the largest measured speed", "largest"),
        "sensor": (key["gain"], key["offset"]),
        "friction": Friction(("F_f", "F_b"), {"B": 0.0}, speed, friction, viscous=True, unit=drive.unit),
        "base": _base(machine, standstill),
        "free": tuple(
            key[role] for role in ("inertia", "viscous", "coulomb_forward", "coulomb_backward", "gravity_constant")
        ),
        "sizes": partial(sizes, plant.kind),
        "rigid": rigid,
        "bridged_blows": True,
        "transmitted": _transmitted,
        "tables": (*over, *turns, *clocks),
        "ports": {"axis": Port("axis_force", drive.unit, "v", lambda s, p: s.switch, _way, levered=False)},
        "floor": "own",
        # Cogging of a few tenths of a per cent of the largest input, and bristles of a thousandth of the travel.
        "traces": (
            Trace("torque_ripple", lambda m, sizes: 0.003 * sizes.force, fitted=False),
            Trace("presliding", lambda m, sizes: 0.0005 * sizes.length),
        ),
        "discrepancy": Discrepancy(load=0.004, inertia=0.004, standstill=0.05, slow=0.05, time_s=0.06, of_largest=True),
        "whole": "axis",
        "sized_by_runs": {
            **{name: "input" for name in (*levels, key["gain"], key["offset"]) if name},
            key["viscous"]: "input/speed",
        },
        # The two Coulomb levels and the constant load show as two levels only: forward + load, backward - load.
        "ties": (((key["coulomb_forward"], key["coulomb_backward"]), key["gravity_constant"]),),
        "turning": turning,
        "cross_checks": cross_checks,
        "load": _load,
        "closed_loop": closed_loop(machine, plant),
    }
    return Kind(**{**fields, **(more or {})})


LINEAR = axis_kind(
    LinearAxis,
    AXIS_LINEAR,
    family=("axis-linear", "axis"),
    drive=Drive("force", "N", "n"),
    moved=Moved("axis", "m", "position of the axis", placed_by_log=True),
    standstill="friction.standstill_speed_m_s",
)
ROTARY = axis_kind(
    RotaryAxis,
    AXIS_ROTARY,
    family=("axis-rotary", "axis"),
    drive=Drive("torque", "N m", "nm"),
    moved=Moved("axis", "rad", "position of the axis", placed_by_log=True),
    standstill="friction.standstill_speed_rad_s",
    turning=(Turning("axis", lambda m: 1.0 / (2.0 * math.pi), ("angle", "angle within a turn")),),
)
