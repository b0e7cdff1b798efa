"""The paper's validation: measured torque in, simulated speed out, against the measured speed.

An open-loop replay integrates every bias, so two measures that drift cannot fool stand
beside it: the replay restarted every 2 s, and the rms of the torque (force) balance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.run import Array, Run
from workbench.core.shown import Brief, Shown
from workbench.effects import logged, true_input
from workbench.engine import kernels
from workbench.machines import Axis, Hoist, Plant
from workbench.simulate.driven import Balance, InverseSimulation, pooled_rms, sensor, start_point
from workbench.simulate.impacts import own_impacts

RESTART_S = 2.0


@dataclass(frozen=True, repr=False)
class Replay(Brief):
    """One run's replay; errors in per cent of `speed_scale`.

    simulated: the run as the model moves under the measured input. restarted: (n,)
    simulated speed, set back to the measured motion every 2 s.
    """

    simulated: Run
    restarted: Array
    balance: Balance
    speed_scale: float
    speed_rmse_percent: float
    speed_rmse_percent_restarted_2s: float
    residual_rms: float
    residual_rms_moving: float

    @property
    def name(self) -> str:
        return self.simulated.name


@dataclass(frozen=True, repr=False)
class ReplayResult(Shown):
    """All runs, the figures over all samples of all runs, and the machine that was replayed."""

    runs: tuple[Replay, ...]
    speed_rmse_percent: float
    speed_rmse_percent_restarted_2s: float
    residual_rms: float
    residual_rms_moving: float
    residual_percent: float
    noise_rms: float
    band_hz: float
    machine: Hoist | Axis


def replay_runs(
    machine: Hoist | Axis, runs: Sequence[Run], band_hz: float | None = None, impacts: Sequence[Array] | None = None
) -> ReplayResult:
    """Replay the measured input of every run on the machine; see `ReplayResult`.

    impacts: times of each run, s, beside which no residual is judged; those of the machine's own play without it.
    """
    bench = InverseSimulation(
        machine, runs, band_hz, impacts=own_impacts(machine, runs) if impacts is None else impacts
    )
    balances = bench.balances()
    states = simulate_replays(machine, bench)
    replays = []
    for j, (run, balance) in enumerate(zip(bench.runs, balances, strict=True)):
        restarted = _restarted(machine, bench, j, balance)
        speed = balance.motion.speed
        simulated = simulated_run(bench.plant, run, states[j])
        open_loop = simulated[bench.plant.speeds[0]] - speed
        replays.append(
            Replay(
                simulated,
                restarted,
                balance,
                bench.scale,
                100.0 * pooled_rms([open_loop]) / bench.scale,
                100.0 * pooled_rms([restarted - speed]) / bench.scale,
                pooled_rms([balance.residual[balance.inside]]),
                pooled_rms([balance.residual[balance.moving]]),
            )
        )
    return _together(bench, replays)


def _together(bench: InverseSimulation, replays: Sequence[Replay]) -> ReplayResult:
    balances = [r.balance for r in replays]
    open_loop = [r.simulated[bench.plant.speeds[0]] - r.balance.motion.speed for r in replays]
    residual = pooled_rms([b.residual[b.inside] for b in balances])
    return ReplayResult(
        tuple(replays),
        100.0 * pooled_rms(open_loop) / bench.scale,
        100.0 * pooled_rms([r.restarted - r.balance.motion.speed for r in replays]) / bench.scale,
        residual,
        pooled_rms([b.residual[b.moving] for b in balances]),
        100.0 * residual / pooled_rms([b.measured[b.inside] for b in balances]),
        float(np.sqrt(np.mean([b.noise_rms**2 for b in balances]))),
        bench.band_hz,
        bench.machine,
    )


def simulate_replays(machine: Hoist | Axis, bench: InverseSimulation) -> list[Array]:
    """States (n, states), positions first, of every run under its measured input, from its first sample."""
    plant, m = bench.plant, len(bench.runs)
    n = max(len(run.time_s) for run in bench.runs)
    times = np.empty((n, m))
    inputs = np.empty((n, m))
    for j, run in enumerate(bench.runs):
        k = len(run.time_s)
        times[:k, j], inputs[:k, j] = run.time_s, _true_input(machine, bench, j)
        if k < n:  # a shorter run goes on beside the longest, unlooked at
            times[k:, j] = run.time_s[-1] + run.sample_time_s * np.arange(1, n - k + 1)
            inputs[k:, j] = inputs[k - 1, j]
    start, _ = _starts(bench)
    out = kernels.replay(
        plant,
        bench.model.table(bench.base),
        times,
        inputs,
        start,
        bench.model.scales(bench.scale, bench.base),
        effects=bench.model.effects,
    )
    return [out[: len(run.time_s), : 2 * len(plant.positions), j] for j, run in enumerate(bench.runs)]


def own_log(machine: Hoist | Axis, runs: Sequence[Run]) -> list[Run]:
    """The runs as this machine would have logged them under the same logged input, at the same times, without noise."""
    bench = InverseSimulation(machine, runs)
    states = simulate_replays(machine, bench)
    made = []
    for run, of_run in zip(bench.runs, states, strict=True):
        moved = simulated_run(bench.plant, run, of_run)
        shown = logged(
            replace(run, signals={name: moved[name] for name in run.signals if name in moved}), bench.model.active
        )
        made.append(replace(shown, signals={**shown.signals, bench.plant.input: run[bench.plant.input]}))
    return made


def _starts(bench: InverseSimulation) -> tuple[Array, Array]:
    points = [start_point(bench.plant, run, motion) for run, motion in zip(bench.runs, bench.motions, strict=True)]
    clocks = [float(run.time_s[0]) for run in bench.runs]
    return bench.model.starts([x for x, _ in points], [w for _, w in points], clocks, bench.base)


def _true_input(machine: Hoist | Axis, bench: InverseSimulation, j: int) -> Array:
    """The true input (n,) of run j, recovered from the logged one."""
    gain, offset = sensor(machine)
    return true_input(bench.model.active, bench.runs[j].time_s, (bench.inputs[j] - offset) / gain)


def simulated_run(plant: Plant, run: Run, states: Array) -> Run:
    """The replayed states as a run beside the measured one."""
    names = (*plant.positions, *plant.speeds)
    signals: Mapping[str, Array] = dict(zip(names, states.T, strict=True))
    return Run(
        run.name,
        run.time_s,
        {**signals, plant.input: run[plant.input]},
        run.payload_kg,
        run.start_position_m,
        run.start_time_s,
    )


def _restarted(machine: Hoist | Axis, bench: InverseSimulation, j: int, balance: Balance) -> Array:
    """Simulated speed (n,) of run j, restarted every 2 s from the measured motion and the states that belong to it."""
    run, motion, plant = bench.runs[j], balance.motion, bench.plant
    n = len(run.time_s)
    first = np.searchsorted(run.time_s, np.arange(run.time_s[0], run.time_s[-1], RESTART_S) - 1e-9)
    first = np.unique(np.minimum(first, n - 2))
    last = np.append(first[1:], n - 1)  # a window ends where the next begins
    length = int(np.max(last - first)) + 1
    rows = first[:, None] + np.arange(length)
    beyond = np.maximum(rows - (n - 1), 0)
    rows = np.minimum(rows, n - 1)
    times = run.time_s[rows] + beyond * run.sample_time_s
    inputs = _true_input(machine, bench, j)[rows]
    rest_positions = len(plant.positions) - 1
    angle = motion.position - motion.position[0] + _first_position(bench, j)
    start = np.column_stack(
        [
            angle[first],
            balance.states[first][:, :rest_positions],
            _smooth_speed(bench, j)[first],
            balance.states[first][:, rest_positions:],
        ]
    )
    p = [bench.base[j]] * len(first)
    out = kernels.replay(
        plant,
        bench.model.table(p),
        times.T,
        inputs.T,
        start.T,
        bench.model.scales(bench.scale, p),
        effects=bench.model.effects,
    )
    speed = out[:, len(plant.positions), :]
    restarted = np.empty(n)
    for w, (a, b) in enumerate(zip(first, last, strict=True)):
        restarted[a : b + 1] = speed[: b - a + 1, w]
    return restarted


def _first_position(bench: InverseSimulation, j: int) -> float:
    return float(_starts(bench)[0][0, j])


def _smooth_speed(bench: InverseSimulation, j: int) -> Array:
    """The measured speed as a start value: the mean of five samples, so that the noise of one sample matters less."""
    speed = bench.motions[j].speed
    padded = np.pad(speed, 2, mode="edge")
    return np.convolve(padded, np.full(5, 0.2), mode="valid")
