"""What the multi-body machine can have beside its geometry; each is off at its default."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from workbench.core.errors import InputError, check_known, nearest
from workbench.machines import Hoist

PINNED = "1.13.6"


@cache
def engine() -> Any:
    """The module exudyn. InputError that says how to install it where it is missing or of another series."""
    try:
        import exudyn
    except ImportError as error:
        raise InputError("the multi-body machine needs exudyn; pip install '.[multibody]'") from error
    version = str(exudyn.__version__)
    if version.split(".")[:2] != PINNED.split(".")[:2]:  # it renames arguments at every minor version
        raise InputError(f"the multi-body machine needs exudyn {PINNED}, not {version}; pip install '.[multibody]'")
    exudyn.config.printToConsole = False  # what matters comes back as an outcome
    return exudyn


@dataclass(frozen=True)
class Switches:
    """SI; up and hoisting positive. From machine.yaml's arm.switches and, under the names there, from its effects.

    Guide: roller_friction (of the normal forces), clearance_m, bristle_m, viscous up and down (N s/m), extra
    Coulomb levels (N), Stribeck peaks (N) with their speed, load_fraction (of the payload's weight), a bell
    (N, m, m), a step of the rail (N, m, over m), a roller's flat (N, period m, rad), quadratic drag, drift
    (relative, s).
    Wire: follows_length (the share of the free length's change that the stiffness follows), wire_inertia,
    hose_kg_per_m beyond the bare wire. Drum: layer, eccentricity. Drive: gear_loss, gear_inertia, two ripples,
    motor_viscous and fan (N m s, N m s²). Platform: heave.
    """

    roller_friction: float = 0.0
    clearance_m: float = 0.0
    bristle_m: float = 0.0
    viscous_up: float = 0.0
    viscous_down: float = 0.0
    level_up_n: float = 0.0
    level_down_n: float = 0.0
    peak_up_n: float = 0.0
    peak_down_n: float = 0.0
    stribeck_m_s: float = 0.05
    load_fraction: float = 0.0
    bell_n: float = 0.0
    bell_m: float = 0.0
    bell_width_m: float = 1.0
    rail_step_n: float = 0.0
    rail_step_m: float = 0.0
    rail_step_width_m: float = 0.05
    flat_n: float = 0.0
    flat_period_m: float = 1.0
    flat_rad: float = 0.0
    drag_n_s2_per_m2: float = 0.0
    drift: float = 0.0
    drift_s: float = 200.0
    follows_length: float = 0.0
    wire_inertia: bool = False
    hose_kg_per_m: float = 0.0
    layer_m: float = 0.0
    layer_rad: float = 0.0
    eccentricity_m: float = 0.0
    eccentricity_rad: float = 0.0
    gear_loss: float = 0.0
    gear_inertia: float = 0.0
    ripple_nm: float = 0.0
    ripple_order: float = 1.0
    ripple_rad: float = 0.0
    ripple2_nm: float = 0.0
    ripple2_order: float = 6.0
    ripple2_rad: float = 0.0
    motor_viscous: float = 0.0
    fan_nm_s2: float = 0.0
    heave_m: float = 0.0
    heave_rad_s: float = 1.0
    heave_rad: float = 0.0
    carriage_kg: float = 0.0
    payload_scale: float = 1.0


# Effect of machine.yaml -> its parameters -> the switches that they are.
_EFFECTS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "friction_viscous": {"viscous_n_s_per_m": ("viscous_up", "viscous_down")},
    "friction_viscous_asymmetric": {
        "viscous_hoisting_n_s_per_m": ("viscous_up",),
        "viscous_lowering_n_s_per_m": ("viscous_down",),
    },
    "friction_coulomb": {"level_n": ("level_up_n", "level_down_n")},
    "friction_coulomb_asymmetric": {"level_hoisting_n": ("level_up_n",), "level_lowering_n": ("level_down_n",)},
    "friction_stribeck": {
        "peak_hoisting_n": ("peak_up_n",),
        "peak_lowering_n": ("peak_down_n",),
        "stribeck_speed_m_s": ("stribeck_m_s",),
    },
    "friction_load_dependent": {"friction_fraction": ("load_fraction",)},
    "friction_position_dependent": {"peak_n": ("bell_n",), "centre_m": ("bell_m",), "width_m": ("bell_width_m",)},
    "friction_quadratic": {"drag_n_s2_per_m2": ("drag_n_s2_per_m2",)},
    "friction_step": {"level_n": ("rail_step_n",), "position_m": ("rail_step_m",), "width_m": ("rail_step_width_m",)},
    "friction_periodic": {"amplitude_n": ("flat_n",), "period_m": ("flat_period_m",), "phase_rad": ("flat_rad",)},
    "motor_fan": {"drag_nm_s2": ("fan_nm_s2",)},
    "friction_thermal_drift": {"friction_fraction": ("drift",), "time_constant_s": ("drift_s",)},
    "gearbox_efficiency": {"loss_fraction": ("gear_loss",)},
    "gearbox_inertia": {"inertia_kg_m2": ("gear_inertia",)},
    "drum_layer_change": {"radius_step_m": ("layer_m",), "drum_angle_rad": ("layer_rad",)},
    "drum_eccentricity": {"amplitude_m": ("eccentricity_m",), "phase_rad": ("eccentricity_rad",)},
    "wire_mass": {"mass_kg_per_m": ("hose_kg_per_m",)},
    "wire_stiffness_length": {"share": ("follows_length",)},
    "heave": {"amplitude_m": ("heave_m",), "frequency_rad_s": ("heave_rad_s",), "phase_rad": ("heave_rad",)},
    "carriage_mass_error": {"mass_kg": ("carriage_kg",)},
    "payload_mass_error": {"payload_scale": ("payload_scale",)},
    "torque_ripple": {
        "amplitude_nm": ("ripple_nm",),
        "order_per_turn": ("ripple_order",),
        "phase_rad": ("ripple_rad",),
    },
}
# They are of the log, not of the machine that moves.
_SENSORS = ("torque_scale", "torque_offset", "torque_filter", "speed_delay")
_ADDED = ("level_up_n", "level_down_n", "viscous_up", "viscous_down")


def switches_of(machine: Hoist) -> Switches:
    """arm.switches and effects of machine.yaml. InputError for an effect that this machine does not know."""
    own = machine.arm.switches
    switches = Switches(
        roller_friction=own.roller_friction_coefficient,
        clearance_m=own.roller_clearance_m,
        bristle_m=own.bristle_m,
        follows_length=1.0 if own.wire_stiffness_follows_length else 0.0,
        wire_inertia=own.wire_inertia,
        layer_m=own.layer_step_m,
        layer_rad=own.layer_angle_rad,
    )
    if machine.measured_correction is not None:
        raise InputError("the multi-body machine takes no measured correction", place="measured_correction")
    for name, parameters in machine.effects.items():
        if name in _SENSORS:
            continue
        check_known("the multi-body machine has no effect", name, _EFFECTS, place="effects")
        for parameter, value in parameters.items():
            fields = _EFFECTS[name].get(parameter, ())
            if not fields:
                said = f"the multi-body machine has no '{parameter}'; {nearest(parameter, _EFFECTS[name])}"
                raise InputError(said, place=f"effects.{name}")
            for field in fields:
                before = getattr(switches, field) if field in _ADDED else 0.0
                changes: dict[str, Any] = {field: before + value}
                switches = replace(switches, **changes)
    return switches


def wound_m(switches: Switches, radius_m: float) -> Callable[[float], tuple[float, float]]:
    """Drum angle (rad) -> wire on the drum (m) and its derivative, the arm of the wire force (m).

    A layer more makes the radius larger from an angle on; the wire climbs onto it over 0.3 rad.
    """
    climb = 0.3
    s = switches

    def wound(angle: float) -> tuple[float, float]:
        length, arm = radius_m * angle, radius_m
        if s.layer_m:
            a = angle - s.layer_rad
            length += s.layer_m * (0.0 if a <= 0.0 else 0.5 * a * a / climb if a < climb else a - 0.5 * climb)
            arm += s.layer_m * min(max(a / climb, 0.0), 1.0)
        if s.eccentricity_m:
            length += s.eccentricity_m * (math.cos(s.eccentricity_rad) - math.cos(angle + s.eccentricity_rad))
            arm += s.eccentricity_m * math.sin(angle + s.eccentricity_rad)
        return length, arm

    return wound


# Force laws of rollers and bearings, recorded as expressions that the engine evaluates within its own iteration.
# The engine's convention: a connector's force acts on what moves, against a positive displacement or speed.


_SEAL = 1e-3  # of the roller's stiffness, which centres it within its play
_TOUCH_M = 2e-5  # of contact over which the damping grows: a force that jumps would stop the engine's iteration
ROLLERS = 4


@dataclass(frozen=True)
class Operations:
    """exp, cos, max and the choice between two numbers: of expressions or of plain floats."""

    exp: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    largest: Callable[[Any, Any], Any]
    choose: Callable[[Any, float, float], Any]


def _symbolic() -> Operations:
    es = engine().symbolic
    return Operations(
        es.exp,
        es.cos,
        lambda a, b: es.max(es.Real(a), b),
        lambda v, up, down: es.Real(up) if up == down else es.IfThenElse(v > 0, es.Real(up), es.Real(down)),
    )


_LARGEST = 700.0  # that exp of a float can take
PLAIN = Operations(lambda v: math.exp(min(v, _LARGEST)), math.cos, max, lambda v, up, down: up if v > 0.0 else down)


def guide_level(o: Operations, machine: Hoist, s: Switches, payload_n: float) -> Callable[[Any, Any, Any], Any]:
    """The guide's Coulomb level, N, of (speed m/s, carriage height m, campaign time s); roller friction apart."""
    guide = machine.guide

    def level(v: Any, x: Any, t: Any) -> Any:
        F = o.choose(v, guide.coulomb_hoisting_n, guide.coulomb_lowering_n)
        if s.drift:
            F = F * (1.0 + s.drift * o.exp(-t / s.drift_s))
        if s.level_up_n or s.level_down_n:
            F = F + o.choose(v, s.level_up_n, s.level_down_n)
        if s.peak_up_n or s.peak_down_n:
            F = F + o.choose(v, s.peak_up_n, s.peak_down_n) * o.exp(-(v * v) / s.stribeck_m_s**2)
        if s.load_fraction:
            F = F + s.load_fraction * payload_n
        if s.bell_n:
            off = (x - s.bell_m) / s.bell_width_m
            F = F + s.bell_n * o.exp(-0.5 * off * off)
        if s.rail_step_n:  # as steep in its middle as a ramp of its width
            F = F + s.rail_step_n / (1.0 + o.exp((s.rail_step_m - x) * (4.0 / s.rail_step_width_m)))
        if s.flat_n:
            F = F + 0.5 * s.flat_n * (1.0 + o.cos(x * (2.0 * math.pi / s.flat_period_m) + s.flat_rad))
        return o.largest(0.0, F)

    return level


def pin_law(smooth: bool = False) -> Any:
    """Coulomb friction of level `offset`, linear in speed within +-`damping` (Eq. 13 of the paper); smooth: by a tanh,
    for on the quick shaft the corners would stop the engine's iteration."""
    es = engine().symbolic

    def law(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):  # type: ignore[no-untyped-def]
        turned = velocity / damping
        return offset * (es.tanh(turned) if smooth else es.max(es.Real(-1.0), es.min(es.Real(1.0), turned)))

    return law


def roller_law(machine: Hoist, s: Switches, height_m: float, payload_n: float, clock_s: float) -> Any:
    """One roller in its rail: its normal force along x, and its share of the guide's friction along y.

    N = k δ + c δ' (with play: of what exceeds it, c growing over the first 20 µm of contact);
    friction = (Coulomb level/4 + μ |N|) (2/π) atan(slope v) + B v/4, the turn at standstill as in Eq. 17 of the
    paper. height_m: where displacement y is 0; clock_s: the campaign's time at t = 0. Bristles act on the dolly
    instead of the Coulomb part.
    """
    es, o = engine().symbolic, _symbolic()
    level_of = guide_level(o, machine, s, payload_n)

    def law(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):  # type: ignore[no-untyped-def]
        gap, v = displacement[0], velocity[1]
        k, c = stiffness[0], damping[0]
        N = k * gap + c * velocity[0]
        if s.clearance_m:
            play = offset[0]  # clearance_m, once the machine hangs
            beyond = es.max(gap - play, es.Real(0.0)) + es.min(gap + play, es.Real(0.0))
            touches = _SEAL + es.min(es.Real(1.0), es.abs(beyond) * (1.0 / _TOUCH_M))
            N = k * (beyond + _SEAL * gap) + c * touches * velocity[0]
        along = es.Real(0.0)
        if not s.bristle_m:
            level = level_of(v, displacement[1] + height_m, t + clock_s) * (1.0 / ROLLERS)
            if s.roller_friction:
                level = level + s.roller_friction * es.abs(N)
            along = level * (2.0 / math.pi) * es.atan(machine.guide.atan_slope_s_per_m * v)
        if s.viscous_up or s.viscous_down:
            along = along + o.choose(v, s.viscous_up / ROLLERS, s.viscous_down / ROLLERS) * v
        if s.drag_n_s2_per_m2:
            along = along + (s.drag_n_s2_per_m2 / ROLLERS) * es.abs(v) * v
        return [N, along, es.Real(0.0)]

    return law
