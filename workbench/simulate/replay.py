"""The paper's validation: measured torque in, simulated speed out, against the measured speed.

An open-loop replay integrates every bias, so two measures that drift cannot fool stand
beside it: the replay restarted every 2 s, and the rms of the torque (force) balance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.run import Array, Run
from workbench.core.shown import Brief, Shown
from workbench.effects.active import logged
from workbench.engine import kernels
from workbench.machines import Machine, Plant
from workbench.simulate.driven import Balance, InverseSimulation, pooled_rms
from workbench.simulate.loop import Values
from workbench.simulate.motion import own_impacts

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
    """All runs, the figures over the time of all runs, and the machine that was replayed."""

    runs: tuple[Replay, ...]
    speed_rmse_percent: float
    speed_rmse_percent_restarted_2s: float
    residual_rms: float
    residual_rms_moving: float
    residual_percent: float
    noise_rms: float
    band_hz: float
    machine: Machine


def replay_runs(
    machine: Machine, runs: Sequence[Run], band_hz: float | None = None, impacts: Sequence[Array] | None = None
) -> ReplayResult:
    """Replay the measured input of every run on the machine; see `ReplayResult`.

    impacts: times of each run, s, beside which no residual is judged; those of the machine's own play without it.
    """
    given = own_impacts(machine, runs) if impacts is None else impacts
    bench = InverseSimulation(machine, runs, band_hz, impacts=given)
    balances, states, starts = bench.balances(), simulate_replays(bench), bench.starts()
    replays, driven = [], bench.plant.speeds[0]

    def percent(errors: Sequence[Array], steps_s: Sequence[float] = ()) -> float:
        return 100.0 * pooled_rms(errors, steps_s) / bench.scale

    for j, (run, balance) in enumerate(zip(bench.runs, balances, strict=True)):
        simulated = simulated_run(bench.plant, run, states[j])
        restarted = _restarted(bench, j, balance, float(starts[0, j]))
        measured = balance.motion.speed
        replays.append(
            Replay(
                simulated,
                restarted,
                balance,
                bench.scale,
                percent([simulated[driven] - measured]),
                percent([restarted - measured]),
                pooled_rms([balance.residual[balance.inside]]),
                pooled_rms([balance.residual[balance.moving]]),
            )
        )
    steps = [run.sample_time_s for run in bench.runs]
    residual = pooled_rms([b.residual[b.inside] for b in balances], steps)
    return ReplayResult(
        tuple(replays),
        percent([r.simulated[driven] - r.balance.motion.speed for r in replays], steps),
        percent([r.restarted - r.balance.motion.speed for r in replays], steps),
        residual,
        pooled_rms([b.residual[b.moving] for b in balances], steps),
        100.0 * residual / pooled_rms([b.measured[b.inside] for b in balances], steps),
        float(np.sqrt(np.mean([b.noise_rms**2 for b in balances]))),
        bench.band_hz,
        machine,
    )


def simulate_replays(*benches: InverseSimulation) -> list[Array]:
    """States (n, states), positions first, of every run under its measured input, from its first sample; machines with
    the same effects side by side."""
    if len({bench.model.effects for bench in benches}) != 1:
        return [states for bench in benches for states in simulate_replays(bench)]
    given = [each for bench in benches for each in zip(bench.runs, bench.true_inputs(), strict=True)]
    n = max(len(run.time_s) for run, _ in given)
    times, inputs = np.empty((2, n, len(given)))
    for j, (run, true) in enumerate(given):  # a shorter run goes on beside the longest, unlooked at
        more = np.arange(1, n - len(true) + 1)
        times[:, j] = np.append(run.time_s, run.time_s[-1] + run.sample_time_s * more)
        inputs[:, j] = np.pad(true, (0, len(more)), mode="edge")
    starts = np.hstack([bench.starts() for bench in benches])
    scales = np.hstack([bench.model.scales(bench.scale, bench.base) for bench in benches])
    plant, model = benches[0].plant, benches[0].model
    table = model.table([values for bench in benches for values in bench.base])
    out = kernels.replay(plant, table, times, inputs, starts, scales, effects=model.effects)
    return [out[: len(run.time_s), : 2 * len(plant.positions), j] for j, (run, _) in enumerate(given)]


def _replayed(bench: InverseSimulation, values: Values, times: Array, inputs: Array, start: Array) -> Array:
    """In the kernel that takes the bench's runs: another one for a run's parts would take longer to compile."""
    model, scales = bench.model, bench.model.scales(bench.scale, values)
    return kernels.replay(
        bench.plant, model.table(values), times, inputs, start, scales, effects=model.effects,
        lanes=kernels.lanes_for(len(bench.runs), model.effects),
    )  # fmt: skip


def own_log(machine: Machine, runs: Sequence[Run]) -> list[Run]:
    """The runs as this machine would have logged them under the same logged input, at the same times, without noise."""
    bench = InverseSimulation(machine, runs)
    states = simulate_replays(bench)
    made = []
    for run, of_run in zip(bench.runs, states, strict=True):
        moved = simulated_run(bench.plant, run, of_run)
        shown = logged(replace(run, signals={n: moved[n] for n in run.signals if n in moved}), bench.model.active)
        made.append(replace(shown, signals={**shown.signals, bench.plant.input: run[bench.plant.input]}))
    return made


def simulated_run(plant: Plant, run: Run, states: Array) -> Run:
    """The replayed states as a run beside the measured one."""
    names = (*plant.positions, *plant.speeds)
    signals: dict[str, Array] = {**dict(zip(names, states.T, strict=True)), plant.input: run[plant.input]}
    return Run(run.name, run.time_s, signals, run.payload_kg, run.start_position_m, run.start_time_s)


def _restarted(bench: InverseSimulation, j: int, balance: Balance, first_position: float) -> Array:
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
    inputs = bench.true_inputs()[j][rows]
    rest_positions = len(plant.positions) - 1
    angle = motion.position - motion.position[0] + first_position
    # The mean of five samples, so that the noise of one sample matters less.
    speed = np.convolve(np.pad(motion.speed, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    rest = balance.states[first]
    start = np.column_stack([angle[first], rest[:, :rest_positions], speed[first], rest[:, rest_positions:]])
    out = _replayed(bench, [bench.base[j]] * len(first), times.T, inputs.T, start.T)[:, len(plant.positions), :]
    restarted = np.empty(n)
    for w, (a, b) in enumerate(zip(first, last, strict=True)):
        restarted[a : b + 1] = out[: b - a + 1, w]
    return restarted
