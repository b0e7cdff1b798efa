"""A run as the moving drawing of the machine needs it; what a log lacks is computed from its measured speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array, Run
from workbench.machines import HOIST, Hoist
from workbench.simulate.driven import InverseSimulation

SIMULATED = ("position_carriage_m", "speed_carriage_m_s", "tension_drum_n", "tension_dead_line_n", "tension_min_n")


@dataclass(frozen=True, eq=False)
class Scene:
    """A run as the drawing needs it; arrays (n,) over rising time_s, up and hoisting positive.

    wound_m: wire taken in by the drum since height 0. torques_nm: one motor each. slack: either fall.
    speed_reference_m_s: of the carriage, where there is one. tension_of, height_of: where these come from.
    """

    name: str
    payload_kg: float
    time_s: Array
    height_m: Array
    speed_m_s: Array
    speed_motor_rad_s: Array
    wound_m: Array
    torques_nm: tuple[Array, ...]
    tension_drum_n: Array
    tension_dead_line_n: Array
    slack: np.ndarray
    speed_reference_m_s: Array | None = None
    tension_of: str = "simulated"
    height_of: str = "simulated"

    def at(self, time_s: Array) -> Scene:
        """The scene at other times. Slack is kept where there was any since the time before."""

        def between(values: Array) -> Array:
            return np.interp(time_s, self.time_s, values)

        edges = np.searchsorted(self.time_s, time_s, side="right")
        before = np.concatenate([[0], edges[:-1]])
        slack = np.array([bool(np.any(self.slack[a : max(b, a + 1)])) for a, b in zip(before, edges, strict=True)])
        reference = self.speed_reference_m_s
        return Scene(
            self.name, self.payload_kg, time_s, between(self.height_m), between(self.speed_m_s),
            between(self.speed_motor_rad_s), between(self.wound_m), tuple(between(t) for t in self.torques_nm),
            between(self.tension_drum_n), between(self.tension_dead_line_n), slack,
            None if reference is None else between(reference), self.tension_of, self.height_of,
        )  # fmt: skip


def scene_of(machine: Hoist, run: Run) -> Scene:
    """InputError for a run whose motion cannot be computed."""
    return _simulated(machine, run) if all(name in run for name in SIMULATED) else _measured(machine, run)


def _simulated(machine: Hoist, run: Run) -> Scene:
    lift = machine.lift_m_per_rad
    reference = run.signals.get("speed_reference_rad_s")
    return Scene(
        run.name, run.payload_kg, run.time_s, run["position_carriage_m"], run["speed_carriage_m_s"],
        run["speed_motor_rad_s"], _wound(machine, run, run.start_position_m), _torques(machine, run),
        run["tension_drum_n"], run["tension_dead_line_n"], run["tension_min_n"] <= 0.0,
        None if reference is None else lift * reference,
    )  # fmt: skip


def _measured(machine: Hoist, run: Run) -> Scene:
    """The nominal wire and carriage driven by the measured motor speed; heights and tensions that are logged stay."""
    plain = machine.model_copy(update={"effects": {}})
    bench = InverseSimulation(plain, [run])
    (balance,) = bench.balances()
    motion, states, n = balance.motion, balance.states, len(HOIST.plant.positions)
    start = HOIST.plant.equilibrium(float(states[0, 1]), bench.base[0])[0][0]
    q = [motion.position - motion.position[0] + start, *states[:, : n - 1].T]
    y = [motion.speed, *states[:, n - 1 :].T]
    computed = HOIST.plant.outputs(run.time_s, q, y, run_torque(machine, run), bench.base[0])
    logged = [name for name in ("position_carriage_m", "tension_dead_line_n") if name in run]

    def either(name: str) -> Array:
        return run[name] if name in run else np.asarray(computed[name], dtype=float)

    reference = run.signals.get("speed_reference_rad_s")
    modelled = "of the model under the measured motor speed"
    return Scene(
        run.name, run.payload_kg, run.time_s, either("position_carriage_m"), np.asarray(computed["speed_carriage_m_s"]),
        motion.speed, _wound(machine, run, run.start_position_m), _torques(machine, run),
        np.asarray(computed["tension_drum_n"], dtype=float), either("tension_dead_line_n"),
        np.asarray(computed["tension_min_n"]) <= 0.0,
        None if reference is None else machine.lift_m_per_rad * reference,
        f"measured at the dead line, {modelled} at the drum" if "tension_dead_line_n" in logged else modelled,
        "measured" if "position_carriage_m" in logged else modelled,
    )  # fmt: skip


def run_torque(machine: Hoist, run: Run) -> Array:
    """All motors' torque."""
    if "torque_motor_nm" in run:
        return run["torque_motor_nm"]
    return np.sum(_torques(machine, run), axis=0)


def _torques(machine: Hoist, run: Run) -> tuple[Array, ...]:
    """One motor each; equal parts of the sum where only that is logged."""
    if "torque_motor1_nm" in run and "torque_motor2_nm" in run and machine.motor.count > 1:
        return run["torque_motor1_nm"], run["torque_motor2_nm"]
    return (run["torque_motor_nm"] / machine.motor.count,)


def _wound(machine: Hoist, run: Run, start_m: float) -> Array:
    """Wire (m) that the drum has taken in, from its motor's speed: two falls, so twice the height to begin with."""
    speed = run["speed_motor_rad_s"]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time_s))])
    return 2.0 * (start_m + machine.lift_m_per_rad * angle)
