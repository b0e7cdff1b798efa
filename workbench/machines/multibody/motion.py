"""The machine in motion under the torque that a drive gives, step by step, to a run."""

from __future__ import annotations

import enum
import math
import time as clock
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.machines import Hoist
from workbench.machines.multibody import assemble
from workbench.machines.multibody.switches import PLAIN, Switches, engine, guide_level, switches_of, wound_m

SPECTRAL_RADIUS = 0.8  # of the generalised-α method: damps what the step cannot resolve
FINER = (1, 2, 4)  # parts of a step, tried in turn
BRISTLE_DAMPING = 0.3  # of critical, of the carriage on its bristles
TOLERANCE = 1e-6  # of the engine's iteration: motor speed within 1e-7 of nominal of that at 1e-8


class Outcome(enum.Enum):
    """How a motion ended, as a sentence for the user."""

    COMPLETED = "completed"
    DIVERGED = "the engine's iteration did not converge"
    NO_EQUILIBRIUM = "the machine does not hang still at its start"


@dataclass(frozen=True)
class Shaft:
    """What a drive is told at the beginning of a step: time, s; motor angle, rad; speed, rad/s."""

    time_s: float
    angle_rad: float
    speed_rad_s: float


# (shaft now, time at the step's end, s) -> (torque of all motors over the step, dry friction of a brake there), N m.
Driven = Callable[[Shaft, float], tuple[float, float]]


@dataclass(frozen=True)
class MotionResult:
    """The run, what it started from, how it ended and what it cost.

    at: time and state of a failure, for the user. cpu_s: of the stepping.
    """

    run: Run
    hanging: assemble.Hanging | None
    outcome: Outcome
    at: str
    cpu_s: float
    steps: int
    switches: Switches = field(repr=False, default_factory=Switches)
    reactions: Run | None = None


def move(
    machine: Hoist,
    payload_kg: float,
    start_position_m: float,
    drive: Callable[[float], Driven],
    duration_s: float,
    *,
    name: str = "run",
    step_s: float = 0.002,
    record_every: int = 5,
    start_speed_rad_s: float = 0.0,
    start_time_s: float = 0.0,
    switches: Switches | None = None,
    reactions_every: int | None = None,
    reach_m: Callable[[float], float] | None = None,
) -> MotionResult:
    """Simulate one run from hanging still (or moving evenly with the motors) at a carriage height.

    drive: called with the torque (N m) that holds the load, gives what is called before every step. payload_kg:
    as stated. step_s: of the generalised-α method;
    a record is kept every `record_every`-th. reactions_every: the forces of rollers and joints beside it, with every
    record when None, never when 0; at a multiple of record_every they come as a run of their own.
    reach_m: of time, s; the cylinders follow it. Without it the reach stays that of machine.yaml.
    """
    switches = switches_of(machine) if switches is None else switches
    truth, payload = assemble.truth_of(machine, switches, payload_kg)
    empty = Run(name, np.zeros(0), {}, payload_kg, start_position_m, start_time_s)
    try:
        system, q, hanging = assemble.settle(truth, switches, payload, start_position_m, start_time_s)
    except assemble.DidNotConvergeError as error:
        return MotionResult(empty, None, Outcome.NO_EQUILIBRIUM, str(error), 0.0, 0, switches)
    cpu, done = 0.0, False
    every = record_every if reactions_every is None else reactions_every
    for finer in FINER:  # where friction turns over too steeply for the step, all is done again in finer ones
        steps = max(1, round(duration_s / step_s)) * finer
        motion = _Motion(system, step_s / finer)
        motion.every, motion.reactions_every, motion.reach = record_every * finer, every * finer, reach_m
        motion.begin(q, start_speed_rad_s, hanging.hold_torque_nm)
        began = clock.process_time()
        done = motion.run(drive(hanging.hold_torque_nm), steps)
        cpu += clock.process_time() - began
        if done:
            break
    signals = _columns(motion.kept)
    time = signals.pop("time_s", np.zeros(0))
    reactions: Run | None = None
    if every == record_every:
        signals |= _columns(motion.reactions)
    elif every:
        reactions = replace(empty, time_s=time[:: every // record_every], signals=_columns(motion.reactions))
    outcome = Outcome.COMPLETED if done else Outcome.DIVERGED
    run = replace(empty, time_s=time, signals=signals)
    return MotionResult(run, hanging, outcome, "" if done else motion.place(), cpu, steps, switches, reactions)


def _columns(rows: list[dict[str, float]]) -> dict[str, Array]:
    return {name: np.array([row[name] for row in rows], dtype=float) for name in (rows[0] if rows else ())}


class _Motion:
    """One simulation: what is set before each step, what is kept of it."""

    def __init__(self, system: assemble.System, h: float):
        machine, switches = system.machine, system.switches
        self.machine, self.s, self.system, self.h = machine, switches, system, h
        self.height, self.clock_s = system.height, system.clock_s
        self.mbs = system.mbs
        self.wound = wound_m(switches, machine.winch.drum_diameter_m / 2.0)
        self.level = guide_level(PLAIN, machine, switches, system.payload_kg * machine.gravity_m_s2)
        self.kept: list[dict[str, float]] = []
        self.step = 0
        self.torque = 0.0
        self.z, self.bristle_y = 0.0, 0.0
        self.reactions: list[dict[str, float]] = []
        self.every, self.reactions_every = 1, 0
        self.reach: Callable[[float], float] | None = None

    def begin(self, q: Array, speed: float, hold_nm: float) -> None:
        """Positions at rest under the torque that holds; every point moves with the motor, half as fast as the wire."""
        exu, c = engine(), self.system.coordinate
        self.mbs.SetObjectParameter(self.system.lock, "activeConnector", False)
        self.mbs.Assemble()
        self.mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)
        self.mbs.SetLoadParameter(self.system.torque, "load", hold_nm)  # the first acceleration is taken under it
        self.bristle_y = float(q[c["lower_dolly.y"]])
        rates = np.zeros_like(q)
        if speed:
            rates[c["motor"]], rates[c["drum"]] = speed, speed / self.machine.gearbox.ratio
            lift = rates[c["drum"]] * self.wound(float(q[c["drum"]]))[1] / 2.0
            for name in self.system.geometry.bodies:
                rates[c[f"{name}.y"]] = lift
            rates[c["sheave.a"]] = -2.0 * lift / self.machine.sheave.diameter_m
        self.mbs.systemData.SetODE2Coordinates_t(rates, exu.ConfigurationType.Initial)

    braked = False

    def run(self, driven: Driven, steps: int) -> bool:
        """Takes the steps; whether the engine converged in all of them."""
        exu = engine()
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.endTime = steps * self.h
        settings.timeIntegration.adaptiveStep = False
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.relativeTolerance = TOLERANCE
        settings.timeIntegration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        self.raised: BaseException | None = None

        def before_step(mbs: Any, t: float) -> bool:
            try:
                self._before_step(driven)
            except BaseException as error:  # the engine would turn it into its own
                self.raised = error
                return False
            return True

        self.mbs.SetPreStepUserFunction(before_step)
        try:
            done = bool(self.mbs.SolveDynamic(settings))
        except RuntimeError:
            done = False
        finally:
            self.mbs.SetPreStepUserFunction(0)  # the engine's hold on this object would outlive the run
        if self.raised is not None:
            raise self.raised
        if done and self.step % self.every == 0:
            self._keep(*self._state())
        return done

    def _state(self) -> tuple[Any, Any]:
        data = self.mbs.systemData
        return data.GetODE2Coordinates(), data.GetODE2Coordinates_t()

    def _before_step(self, driven: Driven) -> None:
        """What acts over the step that begins: torque, levels of friction by the last forces, wire, weights."""
        mbs, system, machine, s, h = self.mbs, self.system, self.machine, self.s, self.h
        c = system.coordinate
        q, v = self._state()
        t = self.step * h
        angle, speed = float(q[c["motor"]]), float(v[c["motor"]])
        W1, W2 = self._tensions()
        drum, sheave = float(q[c["drum"]]), float(q[c["sheave.a"]])
        drum_next, sheave_next = drum + h * float(v[c["drum"]]), sheave + h * float(v[c["sheave.a"]])
        g = machine.gravity_m_s2 + self._heave(t + h)
        if s.heave_m:
            for load, _ in system.gravity:
                mbs.SetLoadParameter(load, "loadVector", [0.0, -g, 0.0])
        assemble.set_wire(machine, s, system, g, drum_next, sheave_next)
        weights = assemble.wire_weight_n(machine, s, g, drum, sheave)
        W1_top = W1 + weights[0] / 2.0
        mu = machine.bearing.pin_friction_coefficient
        drum_pin = mu * (machine.winch.mass_kg * g + W1_top) * machine.winch.pin_diameter_m / 2.0
        on_pin = abs(W1 + W2 - (weights[0] + weights[1]) / 2.0 - machine.sheave.mass_kg * g)
        mbs.SetObjectParameter(system.pins[0], "offset", drum_pin)
        mbs.SetObjectParameter(system.pins[1], "offset", mu * on_pin * machine.sheave.pin_diameter_m / 2.0)
        if s.gear_loss:
            carried = abs(self.wound(drum)[1] * W1_top + drum_pin * (1.0 if speed > 0.0 else -1.0))
            mbs.SetObjectParameter(system.gear_loss, "offset", s.gear_loss * carried / machine.gearbox.ratio)
        if system.bristle is not None:
            self._bend(
                float(q[c["lower_dolly.y"]]), float(v[c["lower_dolly.y"]]), self.height + float(q[c["sheave.y"]]), t
            )
        if self.reach is not None:
            stroke, before = self._stroke(t + h), self._stroke(t)
            mbs.SetObjectParameter(system.cylinder, "referenceLength", stroke)
            mbs.SetObjectParameter(system.cylinder, "velocityOffset", (stroke - before) / h)
        torque, brake = driven(Shaft(t, angle, speed), t + h)
        self.torque = torque
        if brake or self.step == 0 or self.braked:
            mbs.SetObjectParameter(system.brake, "offset", brake)
        self.braked = bool(brake)
        if s.ripple_nm:
            torque += s.ripple_nm * math.sin(s.ripple_order * (angle + h * speed) + s.ripple_rad)
        if s.ripple2_nm:
            torque += s.ripple2_nm * math.sin(s.ripple2_order * (angle + h * speed) + s.ripple2_rad)
        torque -= (s.motor_viscous + s.fan_nm_s2 * abs(speed)) * speed
        mbs.SetLoadParameter(system.torque, "load", torque)
        self.now = (W1, W2, g, *weights)
        if self.step % self.every == 0:
            self._keep(q, v)
        self.step += 1

    def _bend(self, y: float, v: float, height: float, t: float) -> None:
        """Dahl's bristles: F = level z, dz/dy = (1 - z sign v)/δ, damped before they slide.

        Over the coming step the engine has their tangent, so that it stays implicit; z follows what it found. The level
        is that at this carriage height and speed, of the direction in which the bristles are bent.
        """
        s = self.s
        r = (y - self.bristle_y) / s.bristle_m
        z = (self.z + r) / (1.0 + abs(r))
        self.bristle_y, self.z = y, z
        level = self.level(math.copysign(v, z), height, self.clock_s + t) + s.roller_friction * self._normal()
        k = level / s.bristle_m
        tangent = k * max(1.0 - math.copysign(z, z * v), 1e-4)
        damping = 2.0 * BRISTLE_DAMPING * math.sqrt(k * self.machine.carriage.mass_kg) * (1.0 - abs(z))
        bristle = self.system.bristle
        self.mbs.SetObjectParameter(bristle, "stiffness", tangent)
        self.mbs.SetObjectParameter(bristle, "offset", y - level * z / tangent)
        self.mbs.SetObjectParameter(bristle, "damping", damping)

    def _stroke(self, t: float) -> float:
        """The dollies' distance at the asked reach, m. InputError beyond what the arm allows."""
        arm, reach = self.machine.arm, float(self.reach(t)) if self.reach is not None else self.machine.arm.reach_m
        if not arm.shortest_reach_m <= reach <= arm.longest_reach_m:
            expected = f"{arm.shortest_reach_m:g} to {arm.longest_reach_m:g} m"
            raise InputError(f"{reach:g} m at {t:.3g} s, expected {expected}", place="reach_m")
        return math.sqrt(arm.main_arm_m**2 - reach**2)

    def _heave(self, t: float) -> float:
        """Acceleration of the platform: what hangs on it weighs so much more."""
        s = self.s
        if not s.heave_m:
            return 0.0
        return -s.heave_m * s.heave_rad_s**2 * math.sin(s.heave_rad_s * t + s.heave_rad)

    def _tensions(self) -> tuple[float, float]:
        kind = engine().OutputVariableType.ForceLocal
        W1, W2 = (float(self.mbs.GetObjectOutput(rope, kind)) for rope in self.system.ropes)
        return W1, W2

    def _normal(self) -> float:
        kind = engine().OutputVariableType.Force
        return float(sum(abs(self.mbs.GetObjectOutput(r, kind)[0]) for r in self.system.rollers.values()))

    def _keep(self, q: Any, v: Any) -> None:
        """One record, and the reactions beside it where they are due. Friction of the rollers in the rails is positive
        against an upward motion, a cylinder's and a wire's force in tension; pitch is out of the column's line."""
        mbs, system, kinds, c = self.mbs, self.system, engine().OutputVariableType, self.system.coordinate
        W1, W2, _, w1, w2 = self.now
        rollers = {name: mbs.GetObjectOutput(number, kinds.Force) for name, number in system.rollers.items()}
        friction = sum((float(force[1]) for force in rollers.values()), 0.0)
        if system.bristle is not None:
            friction += float(mbs.GetObjectOutput(system.bristle, kinds.Force))
        self.kept.append({
            "time_s": self.step * self.h,
            "torque_motor_nm": self.torque,
            "speed_motor_rad_s": v[c["motor"]],
            "angle_motor_rad": q[c["motor"]],
            "position_carriage_m": self.height + q[c["sheave.y"]],
            "speed_carriage_m_s": v[c["sheave.y"]],
            "acceleration_carriage_m_s2": mbs.systemData.GetODE2Coordinates_tt()[c["sheave.y"]],
            "tension_drum_n": W1 + w1 / 2.0,
            "tension_dead_line_n": W2 + w2 / 2.0,
            "tension_min_n": min(W1, W2),  # of the two falls' elastic ones
            "force_guide_n": friction,
        })  # fmt: skip
        if self.reactions_every and self.step % self.reactions_every == 0:
            joints = {name: joint for name, joint in system.joints.items() if name != "gripper_moment"}
            self.reactions.append({
                "force_cylinder_n": float(mbs.GetObjectOutput(system.cylinder, kinds.ForceLocal)),
                "pitch_lower_dolly_rad": q[c["lower_dolly.a"]],
                "pitch_upper_dolly_rad": q[c["upper_dolly.a"]],
                "torque_gear_nm": -float(np.atleast_1d(mbs.GetObjectOutput(system.gear, kinds.Force))[0]),
                **{f"force_roller_{name}_n": float(force[0]) for name, force in rollers.items()},
                **{f"force_{n}_n": math.hypot(*mbs.GetObjectOutput(j, kinds.Force)[:2]) for n, j in joints.items()},
            })  # fmt: skip

    def place(self) -> str:
        last: Mapping[str, float] = self.kept[-1] if self.kept else Counter[str]()
        return (
            f"at {self.step * self.h:.3f} s; last kept at {last['time_s']:.3f} s: height "
            f"{last['position_carriage_m']:.3f} m, motor speed {last['speed_motor_rad_s']:.2f} rad/s, torque "
            f"{last['torque_motor_nm']:.1f} N m"
        )
