"""Both models of one machine on one torque record: the paper's Table 1 and Figure 8, and where the two part."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from workbench.control.settings import refuse
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.engine.stepped import Step, observe
from workbench.machines import HOIST, STUDIED, Hoist, of_kind, studied
from workbench.machines.multibody import Driven, MotionResult, Shaft, engine, move, switches_of
from workbench.machines.multibody import Outcome as MotionOutcome
from workbench.metrics import observer
from workbench.simulate import loop
from workbench.simulate.driven import InverseSimulation, start_point
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop
from workbench.simulate.replay import simulate_replays, simulated_run


def simulate_multibody_loop(case: LoopCase, *, record_every: int = 10, step_s: float = 0.001) -> LoopResult:
    """One closed-loop run on the multi-body machine, as `simulate_loop` does it on the lumped one.

    InputError where the extra is missing or the machine has an effect that this model does not know.
    """
    sample_time, n = case.controller.sample_time_s, len(case.speed_reference_rad_s)
    machine = cast(Hoist, case.machine)
    substeps = max(1, math.ceil(sample_time / step_s - 1e-9))
    held: dict[str, Any] = {}

    def drive(hold_nm: float) -> Driven:
        plant = HOIST.plant.values(case.machine, case.payload_kg)
        held["p"] = p = SimpleNamespace(**{**vars(plant), **loop.loop_numbers(case, hold_nm, sample_time / substeps)})
        return _drive(case, p, hold_nm)

    result = move(
        machine,
        case.payload_kg,
        case.start_position_m,
        drive,
        (n - 1) * sample_time,
        name=case.name,
        step_s=sample_time / substeps,
        record_every=substeps,
        reactions_every=substeps * record_every,
        start_time_s=case.start_time_s,
        reach_m=case.events.reach_m(machine.arm.reach_m),
    )
    if result.hanging is None:
        run = replace(result.run, time_s=np.zeros(0), signals={})
        return LoopResult(case, run, {}, Outcome.NOT_SOLVED, said(result), case.start_position_m, 0.0)
    return _result(case, result, held["p"], record_every)


def _drive(case: LoopCase, p: SimpleNamespace, hold_nm: float) -> Driven:
    """The sampled controller, its torque held between samples or behind a lag, and the brake of the events."""
    refuse(case.controller, "the multi-body machine runs", "load_damping", "input_shaper")
    sample_time = case.controller.sample_time_s
    controller = loop.loop_controller(case)
    references = case.speed_reference_rad_s
    torque, command, taken = hold_nm, hold_nm, -1
    step: Step | None = None

    def driven(shaft: Shaft, until_s: float) -> tuple[float, float]:
        nonlocal torque, command, taken, step
        if step is None:  # the encoder counts from where the machine hangs
            step = Step(controller, p, controller.start(p, hold_nm, shaft.angle_rad), sample_time)
        sample = math.floor(shaft.time_s / sample_time + 1e-6)
        if sample > taken:
            taken = sample
            reference = float(references[min(sample, len(references) - 1)])
            if controller.left is not None:
                torque *= float(controller.left(p, sample * sample_time, sample_time))
            command = step(reference, shaft.time_s, shaft.speed_rad_s, shaft.angle_rad)
        gap = torque - command
        torque = command + gap * p.lag_left
        closed = shaft.time_s < p.t_release or shaft.time_s >= p.t_close
        return command + gap * p.lag_mean, p.T_brake if closed and case.events.brakes else 0.0

    return driven


def _result(case: LoopCase, result: MotionResult, p: Any, record_every: int) -> LoopResult:
    samples, sample_time = result.run, case.controller.sample_time_s
    n = len(samples.time_s)
    signals: dict[str, Array] = dict(samples.signals)
    signals["speed_reference_rad_s"] = np.asarray(case.speed_reference_rad_s, dtype=float)[:n]
    seen = {**signals, "time_s": samples.time_s}
    metrics = observer().finish(observe(observer(), p, seen, sample_time), p, n * sample_time)
    time = samples.time_s[::record_every] if record_every else samples.time_s[:0]
    kept: dict[str, Array] = {}
    if record_every:
        kept = {name: values[::record_every].copy() for name, values in signals.items()}
        kept |= dict(result.reactions.signals) if result.reactions is not None else {}
    hold = result.hanging.hold_torque_nm if result.hanging is not None else 0.0
    end = np.array([signals["angle_motor_rad"][-1], 0.0, signals["position_carriage_m"][-1]])
    made = loop.loop_result(case, time, kept, metrics, end, hold)
    if result.outcome is not MotionOutcome.COMPLETED:
        return replace(made, outcome=Outcome.NOT_SOLVED, at=said(result))
    return made


def said(result: MotionResult) -> str:
    """Why a motion ended early, with time and state."""
    return f"{result.outcome.value}, {result.at}"


def check_multibody(machine: Hoist, reach_m: float | None = None) -> None:
    """InputError where the extra is missing, for a machine that this model does not take, a reach beyond its arm."""
    engine()
    switches_of(machine)
    arm = machine.arm
    if reach_m is not None and not arm.shortest_reach_m <= reach_m <= arm.longest_reach_m:
        expected = f"{arm.shortest_reach_m:g} to {arm.longest_reach_m:g} m, as machine.yaml's arm allows"
        raise InputError(f"{reach_m:g} m, expected {expected}", place="events.arm_reach_m")


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
        seen = replace(run, signals={**run.signals, _SPEED: measured})
        out.append(_compared(seen, measured, lumped, multibody, lumped_s, multibody_s, bench.scale))
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
        if multibody.outcome is Outcome.NOT_SOLVED:
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
    if result.outcome is not MotionOutcome.COMPLETED:
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
