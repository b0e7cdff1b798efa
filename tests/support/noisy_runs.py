"""Runs of machines with effects at work, made by the library's own plant, with noise as sensors have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from workbench.control import PiSettings
from workbench.core.run import Run
from workbench.effects import of
from workbench.effects.active import logged
from workbench.machines import Axis, Hoist
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.loop import LoopCase, simulate_loop

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)
Chosen = Mapping[str, Mapping[str, float]]
SAMPLE_TIME_S = 0.02
TORQUE_NOISE_NM, SPEED_NOISE_RAD_S = 4.0, 0.02
FORCE_NOISE_N, AXIS_NOISE_NM, POSITION_NOISE, SPEED_NOISE = 0.3, 0.02, 1e-6, 1e-5  # of an axis, in m or rad

# name, payload, height and time at which it starts, speed; then how far each of its moves goes
MOVES = (
    ("empty_fast", 0.0, 5.0, 0.0, 0.9, (5.0, -4.0, 1.5)),
    ("full_slow", 9000.0, 10.0, 100.0, 0.25, (-1.0, 1.5, -0.5)),
    ("full_fast", 9000.0, 11.0, 200.0, 0.6, (-4.0, 2.0, -3.0)),
)
DURATION_S = 20.0


def with_effects(machine: AnyMachine, effects: Chosen) -> AnyMachine:
    return cast(AnyMachine, type(machine).model_validate(machine.model_dump() | {"effects": effects}))


def hoist_runs(machine: Hoist, seed: int = 1, noise: float = 1.0) -> tuple[Run, ...]:
    """Three runs of 20 s at 50 Hz with two payloads, as the machine's log shows them. noise: of the usual."""
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
    cases = []
    for name, payload, height, start, fastest, moves in MOVES:
        limits = Limits(speed_m_s=fastest, acceleration_m_s2=0.5, jerk_m_s3=2.0)
        steps = [step for by in moves for step in (Step(by_m=by), Step(dwell_s=0.6))]
        plan = plan_motion("ruckig", steps, height, limits, (0.0, 25.0), lead_s=1.0)
        wanted = motor_speed_rad_s(
            plan.sample(0.001, DURATION_S).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
        )
        cases.append(LoopCase(name, machine, payload, height, settings, wanted, start_time_s=start))
    random = np.random.default_rng(seed)
    runs = []
    for result in simulate_loop(cases, record_every=round(SAMPLE_TIME_S / 0.001)):
        run = logged(result.run, of(machine))
        torque = run["torque_motor_nm"] + noise * TORQUE_NOISE_NM * random.normal(size=len(run.time_s))
        speed = run["speed_motor_rad_s"] + noise * SPEED_NOISE_RAD_S * random.normal(size=len(run.time_s))
        runs.append(replace(run, signals={"torque_motor_nm": torque, "speed_motor_rad_s": speed}))
    return tuple(runs)


# name, when it starts, and amplitude (m; rad in units of TURNS) and circular frequency of each wave of its position
WAVES = (
    ("wide", 0.0, ((0.4, 0.7), (0.05, 2.9))),
    ("slow", 60.0, ((0.5, 0.23), (0.02, 1.1))),
    ("quick", 120.0, ((0.1, 2.3), (0.2, 0.9))),
)
TURNS = 6.0


def axis_runs(machine: Axis, seed: int = 1, noise: float = 1.0) -> tuple[Run, ...]:
    """Three runs of 20 s at 50 Hz: the input that a given motion takes, as the machine's log shows both."""
    random = np.random.default_rng(seed)
    time = np.arange(round(DURATION_S / SAMPLE_TIME_S), dtype=np.float64) * SAMPLE_TIME_S
    names = machine.input_signal, machine.position_signal, machine.speed_signal
    linear = machine.input_signal == "force_n"
    sizes = (FORCE_NOISE_N if linear else AXIS_NOISE_NM), POSITION_NOISE, SPEED_NOISE
    # The motion given is the true one: what a sensor does to it comes after.
    true = with_effects(machine, {k: v for k, v in machine.effects.items() if k != "speed_delay"})
    runs = []
    for name, start, waves in WAVES:
        position, speed = np.zeros_like(time), np.zeros_like(time)
        for a, w in waves:
            position += (1.0 if linear else TURNS) * a * np.sin(w * time)
            speed += (1.0 if linear else TURNS) * a * w * np.cos(w * time)
        still = Run(
            name, time, dict(zip(names, (np.zeros_like(time), position, speed), strict=True)), start_time_s=start
        )
        bench = InverseSimulation(true, [still])
        taken = bench.predict([bench.base])[0][0][0]
        run = logged(replace(still, signals={**still.signals, names[0]: taken}), of(machine))
        signals = {
            signal: run[signal] + noise * size * random.normal(size=len(time))
            for signal, size in zip(names, sizes, strict=True)
        }
        runs.append(replace(run, signals=signals))
    return tuple(runs)
