"""What the multi-body machine can have beside its geometry; each is off at its default."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from workbench.core.errors import InputError, nearest
from workbench.machines import Hoist


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


NO_SWITCHES = Switches()

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
    "friction_step": {
        "level_n": ("rail_step_n",),
        "position_m": ("rail_step_m",),
        "width_m": ("rail_step_width_m",),
    },
    "friction_periodic": {
        "amplitude_n": ("flat_n",),
        "period_m": ("flat_period_m",),
        "phase_rad": ("flat_rad",),
    },
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
        if name not in _EFFECTS:
            raise InputError(
                f"the multi-body machine has no effect '{name}'; {nearest(name, _EFFECTS)}", place="effects"
            )
        for parameter, value in parameters.items():
            fields = _EFFECTS[name].get(parameter, ())
            if not fields:
                raise InputError(
                    f"the multi-body machine has no '{parameter}'; {nearest(parameter, _EFFECTS[name])}",
                    place=f"effects.{name}",
                )
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
