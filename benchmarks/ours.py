"""The workbench, called the way its own commands call it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.control import PiSettings
from workbench.core.run import Array, Run
from workbench.effects.active import true_input
from workbench.engine import kernels
from workbench.identify.fit import Fit, fit
from workbench.identify.model import Free, free_parameters, values_of
from workbench.machines import DRIVES, default_hoist
from workbench.machines.multibody import Driven, move
from workbench.simulate.driven import InverseSimulation, start_point
from workbench.simulate.loop import LoopCase, LoopResult, simulate_loop
from workbench.simulate.lowpass import noise_rms
from workbench.simulate.replay import simulate_replays

from .case import FITTED, HEIGHT_M, PAYLOAD_KG, Loop, Replay
from .hoist import Floats


def log_of(case: Replay) -> Run:
    """The case as a measured run: torque, and the reference's speed as the measured one."""
    signals = {"torque_motor_nm": case.torque_nm, "speed_motor_rad_s": case.speed_rad_s}
    return Run("benchmark", case.time_s, signals, PAYLOAD_KG, HEIGHT_M)


def read(case: Replay) -> InverseSimulation:
    """The log made ready, as after reading a campaign; not part of a replay's time."""
    return InverseSimulation(default_hoist(), [log_of(case)])


def replay(bench: InverseSimulation) -> Floats:
    """Motor speed at the log's samples, rad/s."""
    states = simulate_replays(bench)[0]
    return np.asarray(states[:, len(bench.plant.positions)])


def multibody_replay(case: Replay) -> Floats:
    """Motor speed of the multi-body machine at the log's samples, rad/s."""

    def drive(hold_nm: float) -> Driven:
        return lambda shaft, until_s: (float(np.interp(until_s, case.time_s, case.torque_nm)), 0.0)

    end_s = float(case.time_s[-1])
    run = move(default_hoist(), PAYLOAD_KG, HEIGHT_M, drive, end_s, step_s=0.004, record_every=1, reactions_every=0).run
    return np.interp(case.time_s, run.time_s, run["speed_motor_rad_s"])


def loop_cases(loops: Sequence[Loop]) -> list[LoopCase]:
    machine = default_hoist().model_copy(update={"drive": DRIVES["ideal"]})
    return [
        LoopCase(
            f"benchmark {j}",
            machine,
            case.payload_kg,
            HEIGHT_M,
            PiSettings(kp_nm_s_per_rad=case.loop.kp, ki_nm_per_rad=case.loop.ki, sample_time_s=case.loop.interval_s),
            case.wanted_rad_s,
        )
        for j, case in enumerate(loops)
    ]


def closed_loops(cases: Sequence[LoopCase], record_every: int) -> list[LoopResult]:
    """All cases on one core, every metric taken; record_every = 0 keeps no signals."""
    return simulate_loop(cases, record_every=record_every, threads=1)


def speed_of(result: LoopResult) -> Floats:
    return result.run["speed_motor_rad_s"]


TRUSTED = 1e-5  # of the speed scale: what a replay is believed to
NYQUIST = math.inf  # the whole band


class SpeedModel:
    """Simulated minus measured speed under the measured input, from the first sample of each run."""

    def __init__(self, bench: InverseSimulation, tolerance: float = kernels.TOLERANCE) -> None:
        self.bench, self.tolerance = bench, tolerance
        speeds = [noise_rms(r.time_s, m.speed, NYQUIST) for r, m in zip(bench.runs, bench.motions, strict=True)]
        self.noise = max(float(np.sqrt(np.mean(np.square(speeds)))), TRUSTED * bench.scale)
        self.run_lengths = tuple(len(run.time_s) for run in bench.runs)
        self.lags = max(1, int(1.0 / bench.runs[0].sample_time_s))

    def residuals(self, free: Sequence[Free], sets: Sequence[Array]) -> Array:
        """(sets, samples), in the speed's unit."""
        plant, model = self.bench.plant, self.bench.model
        chosen = [values_of(self.bench, free, z) for z in sets]
        out = []
        for j, run in enumerate(self.bench.runs):
            parameters = [values[j] for values, _, _ in chosen]
            at, speed = start_point(plant, run, self.bench.motions[j])
            many = len(parameters)
            start, _ = model.starts([at] * many, [speed] * many, [float(run.time_s[0])] * many, parameters)
            logged = [(self.bench.inputs[j] - offset) / gain for _, gain, offset in chosen]
            inputs = np.stack([true_input(model.active, run.time_s, u) for u in logged], axis=-1)
            states = kernels.replay(
                plant,
                model.table(parameters),
                run.time_s[:, None],
                inputs,
                start,
                model.scales(self.bench.scale, parameters),
                effects=model.effects,
                tolerance=self.tolerance,
            )
            out.append(states[:, len(plant.positions), :] - self.bench.motions[j].speed[:, None])
        return np.concatenate(out).T


def friction_fit(bench: InverseSimulation) -> Fit:
    """The guide's two levels and its slope, by output error of the motor speed."""
    return fit(SpeedModel(bench), free_parameters(bench.machine, bench.runs, list(FITTED)))
