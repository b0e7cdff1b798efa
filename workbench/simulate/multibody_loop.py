"""The multi-body machine under the sampled speed loop: the same compiled step, the same metrics, another plant."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from workbench.control import refuse
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.engine.stepped import Step, observe
from workbench.machines import HOIST, Hoist
from workbench.machines.multibody import Driven, MotionResult, Shaft, engine, move, switches_of
from workbench.machines.multibody import Outcome as MotionOutcome
from workbench.metrics import observer
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, loop_controller, loop_numbers, loop_result


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
        held["p"] = p = SimpleNamespace(**{**vars(plant), **loop_numbers(case, hold_nm, sample_time / substeps)})
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
    controller = loop_controller(case)
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
    made = loop_result(case, time, kept, metrics, end, hold)
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
