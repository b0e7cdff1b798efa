"""Where the arm's bodies and joints are, and what they weigh, at one carriage height; then the machine in the engine:
bodies, joints, rollers, cylinders, wire, winch and what acts on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.machines import Hoist
from workbench.machines.multibody.switches import Switches, engine, pin_law, roller_law, switches_of, wound_m

WIRE_DENSITY = 7850.0  # kg/m³, steel; the bare wire hangs in every machine
PIN_SPEED = 0.01  # rad/s, where the pin friction of Eq. 13 is fully developed
GEAR_SPEED = 0.3  # rad/s at the motor, where the gear's loss has turned over
BRAKE_SPEED = 0.05  # rad/s at the motor, where a brake's friction is fully developed


Point = tuple[float, float]
_DOLLY_DEPTH_M = 0.6  # for the dollies' moment of inertia only
_HEAD_SIZE_M = 0.8  # and for the head's


@dataclass(frozen=True)
class Body:
    """mass_kg, inertia_kg_m2 about the centre of mass, which stands at `centre` (x, y in m)."""

    mass_kg: float
    inertia_kg_m2: float
    centre: Point


@dataclass(frozen=True)
class Geometry:
    """bodies and joints by name; a joint is (body, body, point). rollers: name -> (dolly, point on the rail)."""

    bodies: Mapping[str, Body]
    joints: Mapping[str, tuple[str, str, Point]]
    rollers: Mapping[str, tuple[str, Point]]
    cylinder: tuple[Point, Point]
    sheave_x_m: float


def geometry_of(machine: Hoist, payload_kg: float, height_m: float) -> Geometry:
    """Figure 3 of the paper in the plane: x from the rails outwards, y up, the lower pivot at the carriage height.

    The payload is what hangs in the gripper in truth. Without one there is no such body.
    """
    arm, shares = machine.arm, machine.arm.shares
    s, half = arm.dolly_distance_m, arm.roller_spacing_m / 2.0
    x, y = arm.pivot_offset_m, height_m
    low, high = (x, y), (x, y + s)  # the two dollies' pivots
    head, middle = (x + arm.reach_m, y), (x + arm.reach_m / 2.0, y + s / 2.0)
    bar_in, bar_out = (x, y + s + arm.level_bar_offset_m), (x + arm.reach_m, y + arm.level_bar_offset_m)
    pipe = (x + arm.reach_m + arm.pipe_offset_m, y)
    structure = machine.carriage.mass_kg - machine.sheave.mass_kg

    def rod(share: float, length: float, a: Point, b: Point) -> Body:
        mass = share * structure
        return Body(mass, mass * length**2 / 12.0, ((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0))

    def block(share: float, size: Point, centre: Point) -> Body:
        mass = share * structure
        return Body(mass, mass * (size[0] ** 2 + size[1] ** 2) / 12.0, centre)

    dolly = (_DOLLY_DEPTH_M, arm.roller_spacing_m)
    bodies = {
        "lower_dolly": block(shares.lower_dolly, dolly, (x / 2.0, y)),
        "upper_dolly": block(shares.upper_dolly, dolly, (x / 2.0, y + s)),
        "main_arm": rod(shares.main_arm, arm.main_arm_m, high, head),
        "support_link": rod(shares.support_link, arm.main_arm_m / 2.0, low, middle),
        "level_bar": rod(shares.level_bar, arm.main_arm_m, bar_in, bar_out),
        "head": block(shares.head, (_HEAD_SIZE_M, _HEAD_SIZE_M), (x + arm.reach_m + arm.pipe_offset_m / 2.0, y)),
        "sheave": Body(machine.sheave.mass_kg, machine.sheave.inertia_kg_m2, (arm.sheave_offset_m, y)),
    }
    joints = {
        "lower_pivot": ("lower_dolly", "support_link", low),
        "upper_pivot": ("upper_dolly", "main_arm", high),
        "middle_pivot": ("support_link", "main_arm", middle),
        "head_pivot": ("main_arm", "head", head),
        "level_bar_inner": ("upper_dolly", "level_bar", bar_in),
        "level_bar_outer": ("level_bar", "head", bar_out),
        "sheave_pin": ("lower_dolly", "sheave", (arm.sheave_offset_m, y)),
    }
    if payload_kg > 0.0:
        bodies["payload"] = Body(payload_kg, payload_kg * arm.pipe_length_m**2 / 12.0, pipe)
        joints["gripper"] = ("head", "payload", pipe)
    rollers = {
        "lower_dolly_top": ("lower_dolly", (0.0, y + half)),
        "lower_dolly_bottom": ("lower_dolly", (0.0, y - half)),
        "upper_dolly_top": ("upper_dolly", (0.0, y + s + half)),
        "upper_dolly_bottom": ("upper_dolly", (0.0, y + s - half)),
    }
    cylinder = ((arm.cylinder_offset_m, y), (arm.cylinder_offset_m, y + s))
    return Geometry(bodies, joints, rollers, cylinder, arm.sheave_offset_m)


def truth_of(machine: Hoist, switches: Switches, payload_kg: float) -> tuple[Hoist, float]:
    """The machine and the payload as they are behind what is stated."""
    payload = payload_kg * machine.sensors.payload_scale * switches.payload_scale
    if switches.carriage_kg:
        mass = machine.carriage.mass_kg + switches.carriage_kg
        machine = machine.model_copy(update={"carriage": machine.carriage.model_copy(update={"mass_kg": mass})})
    return machine, payload


def line_kg_per_m(machine: Hoist, switches: Switches) -> float:
    return WIRE_DENSITY * machine.wire.effective_area_m2 + switches.hose_kg_per_m


class System:
    """The machine in the engine, at a carriage height, with its drum turned by an angle and locked there.

    machine, payload_kg: the true ones, see `truth_of`. coordinate: indices into the engine's state. ropes, rollers,
    cylinder, joints, gear, lock, pins, gear_loss, brake, bristle, torque, drum_weight, wire_weight: numbers of items.
    """

    def __init__(
        self, machine: Hoist, switches: Switches, payload_kg: float, height_m: float, angle: float, clock_s: float
    ):
        exu = engine()
        from exudyn import itemInterface as items  # noqa: N813 -- a module

        self.exu, self.items = exu, items
        self.machine, self.switches, self.payload_kg = machine, switches, payload_kg
        self.height, self.angle, self.clock_s = height_m, angle, clock_s
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.geometry = geometry_of(machine, payload_kg, height_m)
        self.keep: list[Any] = [self.container]
        self.nodes: dict[str, Any] = {}
        self.objects: dict[str, Any] = {}
        self.gravity: list[tuple[int, float]] = []
        i, m, s = self.items, self.machine, self.switches
        self.ground = self.mbs.AddObject(i.ObjectGround())
        still = self.mbs.AddNode(i.NodePointGround(referenceCoordinates=[0, 0, 0]))
        self.fixed = self.mbs.AddMarker(i.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
        for name in self.geometry.bodies:
            self._body(name)
        self.joints = {name: self._joint(*joint) for name, joint in self.geometry.joints.items()}
        if "payload" in self.geometry.bodies:
            upright = [self._coordinate("head", 2), self._coordinate("payload", 2)]
            self.joints["gripper_moment"] = self.mbs.AddObject(i.ObjectConnectorCoordinate(markerNumbers=upright))
        self.rollers = self._rollers()
        self.cylinder = self._cylinder()
        turning = m.winch.inertia_kg_m2
        if s.wire_inertia:  # what is wound and the fall that moves go with the drum's rim; the dead fall stands still
            turning += (
                line_kg_per_m(m, s) * (m.wire.segment_length_m + self.height) * (m.winch.drum_diameter_m / 2) ** 2
            )
        drum = self._wheel("drum", turning, self.angle)
        rotors = m.motor.count * m.motor.rotor_inertia_kg_m2 + s.gear_inertia
        motor = self._wheel("motor", rotors, self.angle * m.gearbox.ratio)
        self.gear = self.mbs.AddObject(
            i.ObjectConnectorCoordinate(markerNumbers=[motor, drum], factor1=m.gearbox.ratio)
        )
        self.lock = self.mbs.AddObject(i.ObjectConnectorCoordinate(markerNumbers=[self.fixed, drum], offset=self.angle))
        sheave = self._coordinate("sheave", 2)
        R, r = m.winch.drum_diameter_m / 2.0, m.sheave.diameter_m / 2.0
        self.ropes = (self._rope([drum, sheave], [-R, -r]), self._rope([self.fixed, sheave], [0.0, r]))
        self.pins = (
            self._pin(self.fixed, drum, PIN_SPEED),
            self._pin(self._coordinate("lower_dolly", 2), sheave, PIN_SPEED),
        )
        self.gear_loss = self._pin(self.fixed, motor, GEAR_SPEED, pin_law(smooth=True))
        self.brake = self._pin(self.fixed, motor, BRAKE_SPEED, pin_law(smooth=True))
        self.torque = self.mbs.AddLoad(i.LoadCoordinate(markerNumber=motor, load=0.0))
        self.drum_weight = self.mbs.AddLoad(i.LoadCoordinate(markerNumber=drum, load=0.0))
        self.wire_weight = self.mbs.AddLoad(i.LoadForceVector(markerNumber=self._at("sheave"), loadVector=[0, 0, 0]))
        # The bristles between the lower dolly and the rail; `motion` sets their tangent before each step.
        self.bristle = self._between(self.fixed, self._coordinate("lower_dolly", 1)) if s.bristle_m else None
        self.mbs.Assemble()
        names = [(name, c, k) for name in self.geometry.bodies for k, c in enumerate("xya")]
        self.coordinate = {f"{name}.{c}": self.mbs.GetNodeODE2Index(self.nodes[name]) + k for name, c, k in names}
        self.coordinate |= {name: self.mbs.GetNodeODE2Index(self.nodes[name]) for name in ("drum", "motor")}

    def _body(self, name: str) -> None:
        i, body = self.items, self.geometry.bodies[name]
        r = self.machine.sheave.diameter_m / 2.0
        wound, _ = wound_m(self.switches, self.machine.winch.drum_diameter_m / 2.0)(self.angle)
        turned = -wound / (2.0 * r) if name == "sheave" else 0.0
        at = [*body.centre, 0.0]
        node = self.mbs.AddNode(i.NodeRigidBody2D(referenceCoordinates=at, initialCoordinates=[0.0, 0.0, turned]))
        self.nodes[name] = node
        self.objects[name] = self.mbs.AddObject(
            i.ObjectRigidBody2D(mass=body.mass_kg, inertia=body.inertia_kg_m2, nodeNumber=node)
        )
        marker = self.mbs.AddMarker(i.MarkerBodyMass(bodyNumber=self.objects[name]))
        weight = [0.0, -self.machine.gravity_m_s2, 0.0]
        load = self.mbs.AddLoad(i.LoadMassProportional(markerNumber=marker, loadVector=weight))
        self.gravity.append((load, body.mass_kg))

    def _wheel(self, name: str, inertia: float, angle: float) -> Any:
        i = self.items
        self.nodes[name] = self.mbs.AddNode(i.Node1D(referenceCoordinates=[0.0], initialCoordinates=[angle]))
        self.objects[name] = self.mbs.AddObject(i.ObjectMass1D(mass=inertia, nodeNumber=self.nodes[name]))
        return self._coordinate(name, 0)

    def _at(self, name: str, point: Point | None = None) -> Any:
        """A marker on a body, at its centre or where `point` is at the start."""
        centre = self.geometry.bodies[name].centre
        x, y = centre if point is None else point
        local = [x - centre[0], y - centre[1], 0.0]
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=self.objects[name], localPosition=local))

    def _on_ground(self, x: float, y: float) -> Any:
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=self.ground, localPosition=[x, y, 0.0]))

    def _coordinate(self, name: str, which: int) -> Any:
        return self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[name], coordinate=which))

    def _joint(self, a: str, b: str, point: Point) -> Any:
        return self.mbs.AddObject(
            self.items.ObjectJointRevolute2D(markerNumbers=[self._at(a, point), self._at(b, point)])
        )

    def _rollers(self) -> dict[str, int]:
        arm, out = self.machine.arm, {}
        k = arm.roller_stiffness_n_per_m
        weight = self.payload_kg * self.machine.gravity_m_s2
        law = roller_law(self.machine, self.switches, self.height, weight, self.clock_s)
        for name, (dolly, point) in self.geometry.rollers.items():
            out[name] = self.mbs.AddObject(
                self.items.ObjectConnectorCartesianSpringDamper(
                    markerNumbers=[self._on_ground(*point), self._at(dolly, point)],
                    stiffness=[k, 0.0, 0.0],
                    damping=[k * arm.roller_damping_time_s, 0.0, 0.0],
                )
            )
            self._give_law(out[name], law)
        return out

    def _give_law(self, number: Any, law: Any) -> None:
        from exudyn.utilities import CreateSymbolicUserFunction

        function = CreateSymbolicUserFunction(self.mbs, law, "springForceUserFunction", itemIndex=number)
        self.mbs.SetObjectParameter(number, "springForceUserFunction", function)
        self.keep.append(function)

    def _cylinder(self) -> Any:
        arm = self.machine.arm
        low, high = self.geometry.cylinder
        k = arm.cylinder_stiffness_n_per_m
        return self.mbs.AddObject(
            self.items.ObjectConnectorSpringDamper(
                markerNumbers=[self._at("lower_dolly", low), self._at("upper_dolly", high)],
                referenceLength=high[1] - low[1],
                stiffness=k,
                damping=k * arm.cylinder_damping_time_s,
            )
        )

    def _rope(self, coordinates: list[Any], factors: list[float]) -> Any:
        """One fall, from the top over the sheave's pin: its free length changes with drum and sheave."""
        wire = self.machine.wire
        top = self._on_ground(self.geometry.sheave_x_m, wire.segment_length_m)
        EA = wire.youngs_modulus_pa * wire.effective_area_m2
        return self.mbs.AddObject(
            self.items.ObjectConnectorReevingSystemSprings(
                markerNumbers=[top, self._at("sheave"), *coordinates],
                hasCoordinateMarkers=True,
                coordinateFactors=factors,
                stiffnessPerLength=EA,
                dampingPerLength=EA * wire.damping_time_s,
                referenceLength=wire.segment_length_m,
                sheavesAxes=self.exu.Vector3DList([[0, 0, 1]] * 2),
                sheavesRadii=[0, 0],
            )
        )

    def _pin(self, a: Any, b: Any, speed: float, law: Any = None) -> Any:
        """Dry friction between two coordinates; its level is the connector's `offset`."""
        number = self._between(a, b, speed)
        self._give_law(number, law or pin_law())
        return number

    def _between(self, a: Any, b: Any, damping: float = 0.0) -> Any:
        """A connector of two coordinates, without a force."""
        return self.mbs.AddObject(
            self.items.ObjectConnectorCoordinateSpringDamper(markerNumbers=[a, b], stiffness=0.0, damping=damping)
        )


# The machine hanging still at a height: the drum angle that puts it there, tensions, holding torque, reactions.


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
