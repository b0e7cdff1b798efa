"""Both models of one machine on one torque record: the paper's Table 1 and Figure 8, and where the two part."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.machines import STUDIED, Hoist, of_kind, studied
from workbench.machines.multibody import Outcome, Shaft, move
from workbench.simulate.driven import InverseSimulation, start_point
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.simulate.loop import Outcome as LoopOutcome
from workbench.simulate.multibody_loop import simulate_multibody_loop
from workbench.simulate.replay import simulate_replays, simulated_run

STEP_S = 0.004  # motor speed within 1e-5 of nominal of that at a fraction of it
_ROLLER, _SPEED = "force_roller_", "speed_motor_rad_s"


@dataclass(frozen=True)
class ModelsRun:
    """One run. measured: what was given; lumped, multibody: both models under its torque, at its own samples.

    Errors are rms, in per cent of nominal motor speed. cpu_s: of each model's own simulation. parted_*: where their
    difference grows fastest, over a second: an error once made is carried on.
    """

    measured: Run
    lumped: Run
    multibody: Run
    lumped_rmse_percent: float
    multibody_rmse_percent: float
    apart_percent: float
    lumped_cpu_s: float
    multibody_cpu_s: float
    parted_s: float
    parted_percent: float
    parted_height_m: float
    parted_force: str
    parted_force_n: float

    @property
    def name(self) -> str:
        return self.measured.name


@dataclass(frozen=True)
class ModelsCompared:
    """All runs, on one machine. against: what the errors are of. ratio: of compute time, multi-body over lumped."""

    machine: Hoist
    runs: tuple[ModelsRun, ...]
    scale_rad_s: float
    against: str = "the measured one"

    @property
    def simulated_s(self) -> float:
        return float(sum(run.measured.duration_s for run in self.runs))

    @property
    def cpu_s(self) -> tuple[float, float]:
        """Of the lumped and of the multi-body model."""
        return sum(run.lumped_cpu_s for run in self.runs), sum(run.multibody_cpu_s for run in self.runs)

    @property
    def ratio(self) -> float:
        lumped, multibody = self.cpu_s
        return multibody / lumped

    def pooled(self, name: str) -> float:
        """An rms figure over all samples of all runs."""
        n = np.array([len(run.measured.time_s) for run in self.runs], dtype=float)
        values = np.array([getattr(run, name) for run in self.runs])
        return float(np.sqrt(np.sum(n * values**2) / np.sum(n)))


def compare_models(
    machine: Hoist, runs: Sequence[Run], *, step_s: float = STEP_S, progress: Callable[[str], None] = lambda name: None
) -> ModelsCompared:
    """Replay the torque of every run, open loop from its first sample, on the lumped and on the multi-body machine.

    InputError where the extra is missing, where the machine has an effect that this model does not know, and where
    the engine does not converge, with time and state.
    """
    if studied(machine) is None:
        raise InputError(f"is {of_kind(machine)}; the multi-body machine is of {STUDIED}", place="kind")
    bench = InverseSimulation(machine, runs)
    simulate_replays(InverseSimulation(machine, runs[:1]))  # compiles: no model's time
    out = []
    for j, run in enumerate(bench.runs):
        progress(run.name)
        alone = InverseSimulation(machine, [run])
        began = time.process_time()
        (states,) = simulate_replays(alone)
        lumped_s = time.process_time() - began
        lumped = simulated_run(bench.plant, run, states)
        given = alone.true_inputs()[0]
        multibody, multibody_s = _replayed(machine, run, given, start_point(bench.plant, run, bench.motions[j]), step_s)
        measured = bench.motions[j].speed
        out.append(
            _compared(
                replace(run, signals={**run.signals, _SPEED: measured}),
                measured,
                lumped,
                multibody,
                lumped_s,
                multibody_s,
                bench.scale,
            )
        )
    return ModelsCompared(machine, tuple(out), bench.scale)


def compare_loops(cases: Sequence[LoopCase], *, step_s: float = STEP_S) -> ModelsCompared:
    """The same closed loops on both machines; errors are of the motor speed against its reference.

    step_s: of the multi-body model, at most; a step ends at every sample of the controller. InputError as above.
    """
    simulate_loop(cases[:1], record_every=1)  # compiles: no model's time
    out = []
    for case in cases:
        began = time.process_time()
        (lumped,) = simulate_loop([case], record_every=1)
        between = time.process_time()
        multibody = simulate_multibody_loop(case, record_every=1, step_s=step_s)
        ended = time.process_time()
        if multibody.outcome is LoopOutcome.NOT_SOLVED:
            raise InputError(f"{multibody.outcome.value}, {multibody.at}", place=f"run {case.name}")
        n = min(len(lumped.run.time_s), len(multibody.run.time_s))
        reference = np.asarray(case.speed_reference_rad_s, dtype=float)[:n]
        asked = Run(case.name, lumped.run.time_s[:n], {_SPEED: reference}, case.payload_kg, case.start_position_m)
        ours, other = _first(lumped.run, n), _first(multibody.run, n)
        scale = case.machine.motor.nominal_speed_rad_s
        out.append(_compared(asked, reference, ours, other, between - began, ended - between, scale))
    machine = cases[0].machine
    return ModelsCompared(machine, tuple(out), machine.motor.nominal_speed_rad_s, "its reference")


def _first(run: Run, n: int) -> Run:
    """Its first n samples."""
    return replace(run, time_s=run.time_s[:n], signals={name: values[:n] for name, values in run.signals.items()})


def _replayed(machine: Hoist, run: Run, torque: Array, start: tuple[float, float], step_s: float) -> tuple[Run, float]:
    """The multi-body run at the log's own samples, and its compute time, s."""
    time_s = run.time_s - run.time_s[0]

    def drive(hold_nm: float) -> Callable[[Shaft, float], tuple[float, float]]:
        return lambda shaft, until: (float(np.interp(until, time_s, torque)), 0.0)

    height, speed = start
    result = move(
        machine,
        run.payload_kg,
        height,
        drive,
        float(time_s[-1]),
        name=run.name,
        step_s=step_s,
        record_every=max(1, round(run.sample_time_s / step_s)),
        start_speed_rad_s=speed,
        start_time_s=run.start_time_s + float(run.time_s[0]),
    )
    if result.outcome is not Outcome.COMPLETED:
        raise InputError(f"{result.outcome.value}, {result.at}", place=f"run {run.name}")
    kept = result.run
    signals = {name: np.interp(time_s, kept.time_s, values) for name, values in kept.signals.items()}
    return replace(kept, time_s=run.time_s, signals=signals), result.cpu_s


def _compared(
    run: Run, measured: Array, lumped: Run, multibody: Run, lumped_s: float, multibody_s: float, scale: float
) -> ModelsRun:
    w1, w2 = lumped[_SPEED], multibody[_SPEED]

    def percent(difference: Array) -> float:
        return 100.0 * float(np.sqrt(np.mean(difference**2))) / scale

    apart = w2 - w1
    width = max(1, round(1.0 / run.sample_time_s))
    growth = np.abs(apart[width:] - apart[:-width]) if len(apart) > width else np.abs(apart)
    k = min(int(np.argmax(growth)) + width // 2, len(apart) - 1)
    rollers = {name: abs(float(multibody[name][k])) for name in multibody.signals if name.startswith(_ROLLER)}
    most = max(rollers, key=lambda name: rollers[name])
    return ModelsRun(
        run,
        lumped,
        multibody,
        percent(w1 - measured),
        percent(w2 - measured),
        percent(apart),
        lumped_s,
        multibody_s,
        float(run.time_s[k]),
        100.0 * float(np.max(growth)) / scale,
        float(multibody["position_carriage_m"][k]),
        most.removeprefix(_ROLLER).removesuffix("_n"),
        rollers[most],
    )
