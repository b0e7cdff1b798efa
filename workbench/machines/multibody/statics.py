"""The machine hanging still at a height: the drum angle that puts it there, tensions, holding torque, reactions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.machines import Hoist
from workbench.machines.multibody.assemble import System, line_kg_per_m, truth_of
from workbench.machines.multibody.exudyn_import import engine
from workbench.machines.multibody.switches import Switches, switches_of, wound_m

_EXACT_M = 1e-10
_MOST_ROUNDS = 30
_PLAY_STEP_M = 5e-5
_LEAST_LOAD_STEP = 1e-3  # of the load: an arm too soft to carry it is given up in a second, not in an hour


class DidNotConvergeError(Exception):
    """The engine found no equilibrium; says at what height and with what payload."""


@dataclass(frozen=True)
class Hanging:
    """At rest, held by the motors.

    tension_drum_n, tension_dead_line_n: at the top of each fall. forces: rollers' normal forces (against the
    rail, outwards positive), joint reactions (x, y on the second body) and the cylinders' (tension positive), N.
    """

    height_m: float
    drum_angle_rad: float
    hold_torque_nm: float
    tension_drum_n: float
    tension_dead_line_n: float
    normal_n: dict[str, float]
    joint_n: dict[str, tuple[float, float]]
    cylinder_n: float


def hang(machine: Hoist, payload_kg: float, height_m: float, switches: Switches | None = None) -> Hanging:
    """Statics by the engine. payload_kg: as stated. InputError where the extra is missing."""
    switches = switches_of(machine) if switches is None else switches
    truth, payload = truth_of(machine, switches, payload_kg)
    return settle(truth, switches, payload, height_m)[2]


def settle(
    machine: Hoist, switches: Switches, payload_kg: float, height_m: float, clock_s: float = 0.0
) -> tuple[System, Array, Hanging]:
    """The system at rest (its drum still locked), its coordinates, and what it carries.

    machine, payload_kg: the true ones.
    """
    radius = machine.winch.drum_diameter_m / 2.0
    wound = wound_m(switches, radius)
    stiffness = machine.wire.youngs_modulus_pa * machine.wire.effective_area_m2 / machine.wire.segment_length_m
    stretch = (machine.carriage.mass_kg + payload_kg) * machine.gravity_m_s2 / (2.0 * stiffness)
    angle = 2.0 * height_m / radius
    for _ in range(_MOST_ROUNDS):  # a first guess on a taut wire: a slack one gives the iteration no direction
        length, arm = wound(angle)
        angle += (2.0 * (height_m + stretch) - length) / arm
    system = System(machine, switches, payload_kg, height_m, angle, clock_s)
    opening = np.arange(0.0, switches.clearance_m, _PLAY_STEP_M)
    for clearance in [*opening, switches.clearance_m]:  # opened bit by bit: rollers that lost touch give no direction
        for roller in system.rollers.values():
            system.mbs.SetObjectParameter(roller, "offset", [float(clearance), 0.0, 0.0])
        q = _rest(machine, switches, system, angle)
    for _ in range(_MOST_ROUNDS):
        if q is None:
            break
        off = -float(q[system.coordinate["sheave.y"]])
        if abs(off) < _EXACT_M:
            return system, q, _hanging(machine, switches, system, q, height_m, angle)
        angle += 2.0 * off / wound(angle)[1]
        q = _rest(machine, switches, system, angle)
    raise DidNotConvergeError(f"no equilibrium at height {height_m:.3f} m with {payload_kg:.0f} kg in the gripper")


def wire_weight_n(machine: Hoist, switches: Switches, g: float, angle: float, sheave_rad: float) -> tuple[float, float]:
    """Weight of each fall's free, unstretched wire, N."""
    line = line_kg_per_m(machine, switches) * g
    over_sheave = machine.sheave.diameter_m / 2.0 * sheave_rad
    wound = wound_m(switches, machine.winch.drum_diameter_m / 2.0)(angle)[0]
    L = machine.wire.segment_length_m
    return line * (L - wound - over_sheave), line * (L + over_sheave)


def set_wire(machine: Hoist, switches: Switches, system: System, g: float, angle: float, sheave_rad: float) -> None:
    """Free lengths, stiffnesses and weights of both falls as they are at a drum and a sheave angle."""
    mbs, wire = system.mbs, machine.wire
    R, r, L = machine.winch.drum_diameter_m / 2.0, machine.sheave.diameter_m / 2.0, wire.segment_length_m
    wound, arm = wound_m(switches, R)(angle)
    if switches.layer_m or switches.eccentricity_m:
        mbs.SetObjectParameter(system.ropes[0], "coordinateFactors", [-arm, -r])
        mbs.SetObjectParameter(system.ropes[0], "referenceLength", L - (wound - arm * angle))
    EA = wire.youngs_modulus_pa * wire.effective_area_m2
    for rope, free in zip(system.ropes, (L - wound - r * sheave_rad, L + r * sheave_rad), strict=True):
        # The engine divides by the free length; a stiffness that does not follow it (Eq. 7) is multiplied by it.
        per_length = EA * free / (L + switches.follows_length * (free - L))
        mbs.SetObjectParameter(rope, "stiffnessPerLength", per_length)
        mbs.SetObjectParameter(rope, "dampingPerLength", per_length * wire.damping_time_s)
    first, second = wire_weight_n(machine, switches, g, angle, sheave_rad)
    # Half of a fall hangs from its top, half from its bottom.
    mbs.SetLoadParameter(system.drum_weight, "load", -arm * first / 2.0)
    mbs.SetLoadParameter(system.wire_weight, "loadVector", [0.0, -(first + second) / 2.0, 0.0])


def _rest(machine: Hoist, switches: Switches, system: System, angle: float) -> Array | None:
    """The coordinates at rest; None where the engine finds none. The wire's numbers follow the sheave's angle."""
    exu = engine()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    settings.staticSolver.minimumStepSize = _LEAST_LOAD_STEP
    settings.staticSolver.newton.relativeTolerance = 1e-9
    settings.staticSolver.newton.absoluteTolerance = 1e-6
    sheave = system.coordinate["sheave.a"]
    system.mbs.SetObjectParameter(system.lock, "offset", angle)
    turned = float(system.mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial)[sheave])
    for _ in range(_MOST_ROUNDS):
        set_wire(machine, switches, system, machine.gravity_m_s2, angle, turned)
        try:
            if not system.mbs.SolveStatic(settings):
                return None
        except RuntimeError:
            return None
        q = np.array(system.mbs.systemData.GetODE2Coordinates())
        system.mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)
        if abs(q[sheave] - turned) < 1e-12 * max(1.0, abs(turned)):
            return q
        turned = float(q[sheave])
    return q


def _hanging(machine: Hoist, switches: Switches, system: System, q: Array, height_m: float, angle: float) -> Hanging:
    mbs = system.mbs
    kinds = engine().OutputVariableType
    weights = wire_weight_n(machine, switches, machine.gravity_m_s2, angle, float(q[system.coordinate["sheave.a"]]))
    first, second = (float(mbs.GetObjectOutput(rope, kinds.ForceLocal)) for rope in system.ropes)
    held = float(np.atleast_1d(mbs.GetObjectOutput(system.lock, kinds.Force))[0])
    return Hanging(
        height_m,
        angle,
        abs(held) / machine.gearbox.ratio,
        first + weights[0] / 2.0,
        second + weights[1] / 2.0,
        {name: float(mbs.GetObjectOutput(number, kinds.Force)[0]) for name, number in system.rollers.items()},
        {name: _joint(mbs, number) for name, number in system.joints.items() if name != "gripper_moment"},
        float(mbs.GetObjectOutput(system.cylinder, kinds.ForceLocal)),
    )


def _joint(mbs: object, number: int) -> tuple[float, float]:
    force = mbs.GetObjectOutput(number, engine().OutputVariableType.Force)  # type: ignore[attr-defined]
    return float(force[0]), float(force[1])
