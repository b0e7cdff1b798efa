"""The hoist's record: runs, sensors and log of this kind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from benchmarks.validation.families import Family
from benchmarks.validation.hoist_causes import EVENTS, LISTED, UNLISTED, USUAL, Scales, drawn_pair, scales_of
from benchmarks.validation.hoist_machines import USUAL_S, Drawn, drawn_hoist, rebuilt, reference
from benchmarks.validation.hoist_motion import (
    HEIGHT,
    RECORD_S,
    SPEED,
    TENSION,
    TORQUE,
    Truth,
    ailing,
    simulate,
    true_truth,
)
from benchmarks.validation.kind import TURN, Cause, Kind, Logging, RunPlan, about
from benchmarks.validation.sensors import Columns, Sampled, Sensors

Array = npt.NDArray[np.float64]
CURRENT_NOISE = 1.6e-4  # of the largest torque, each millisecond
ENCODER_NOISE_RAD_S = 0.01  # of the drive's own speed signal
SPEED_NOISE_RAD_S = 0.029  # as measured on the practice logs, and so on
POSITION_NOISE_M = 0.0005
TENSION_NOISE_N = 117.0
TENSION_STEP_N = 10.0
SHARE_STD = 0.008  # by which a motor's share of the torque is off one half, drawn each run
SMALL_NM = 250.0  # of a motor: torque sensors of smaller ones are quieter in proportion
SIX = (("empty", "fast"), ("empty", "steps"), ("half", "fast"), ("half", "slow"), ("full", "steps"), ("full", "fast"))
FEWER = (("empty", "steps"), ("full", "fast"), ("half", "slow"), ("half", "fast"), ("empty", "fast"))
MORE = (*SIX, ("half", "steps"), ("full", "slow"), ("empty", "slow"), ("full", "steps"))
# Of all runs together: few engineers record for longer than the first, none for longer than the second.
USUALLY_S, LONGEST_S, LONG_SHARE = 360.0, 1200.0, 0.1
MOST_SAMPLES = 60_000  # of all runs together: longer campaigns are logged at lower rates


def travel_m(drawn: Drawn, duration_s: float) -> float:
    """How far down a long move goes: by the time there is, and by the wire's length."""
    machine = drawn.machine
    top = machine.motor.nominal_speed_rad_s * machine.lift_m_per_rad
    return float(min(drawn.travel_m, 0.15 * top * min(duration_s, 1.2 * USUAL_S)))


def plan(rng: np.random.Generator, drawn: Drawn, family: Family) -> tuple[tuple[RunPlan, ...], Logging]:
    """Runs of three payloads where there are three, one of them slow; two runs have two payloads."""
    count = int(rng.integers(family.runs[0], family.runs[1] + 1))
    wanted = (FEWER if count < len(SIX) else MORE)[:count]
    low, high = family.lengths_s
    longest = min(high, max(low, (LONGEST_S if rng.random() < LONG_SHARE else USUALLY_S) / count))
    duration = round(about(rng, low, longest), 2) if high > low else low
    payloads = {"empty": 0.0, "half": drawn.full_kg / 2.0, "full": drawn.full_kg}
    if high > low and rng.random() < 0.5:
        payloads["half"] = round(drawn.full_kg * rng.uniform(0.3, 0.7), -1)
    runs: list[RunPlan] = []
    clock = 0.0
    for load, profile in wanted:
        name = f"{load}_{profile}"
        name += "" if name not in {run.name for run in runs} else "_again"
        start = round(0.36 * drawn.machine.wire.segment_length_m + rng.uniform(-0.5, 0.5), 3)
        runs.append(RunPlan(name, profile, payloads[load], start, round(clock, 2), duration))
        clock += duration + rng.uniform(30.0, 82.0)
    logger = family.logger
    logs = [] if rng.random() < 0.4 * logger.plain else ["reference"]
    logs += ["sum"] if rng.random() < logger.plain else []
    logs += ["position", "tension"] if rng.random() < logger.full else []
    rates = [rate for rate in logger.rates_hz if rate * duration * count <= MOST_SAMPLES]
    return tuple(runs), Logging(float(rng.choice(rates)) if rates else min(logger.rates_hz), tuple(logs))


def scales(drawn: Drawn, runs: Sequence[RunPlan], logging: Logging) -> Scales:
    starts = float(np.mean([run.start for run in runs]))
    return scales_of(drawn.machine, drawn.full_kg, starts - travel_m(drawn, runs[0].duration_s), starts)


def truth(drawn: Drawn, family: Family, rng: np.random.Generator) -> Truth:
    return true_truth(drawn.machine, family, rng)


def in_run(truth: Truth, plan: RunPlan, rng: np.random.Generator) -> Truth:
    """In three of ten runs a part of the bristles' bend is left from the last motion."""
    left = rng.uniform(-0.8, 0.8) * (rng.random() < 0.3)
    return truth._replace(
        m_p=truth.mp_scale * plan.payload_kg, x_0=plan.start, start_time_s=plan.start_time_s, z_0=left * truth.bristles
    )


def inertia(truth: Truth) -> float:
    """Of motors, drum, carriage and payload, kg m², at the motors."""
    lift = 0.5 * truth.R / truth.ratio  # of the carriage, m per rad of the motors
    return truth.J_m + truth.J_w / truth.ratio**2 + (truth.m_c + truth.m_p) * lift**2


def sensors(rng: np.random.Generator, drawn: Drawn, family: Family, logging: Logging) -> Sensors:
    tol, motor, logger = drawn.machine.tolerances, drawn.machine.motor, family.logger
    low, high = logger.noise
    noise = about(rng, low, high) if low > 0.0 else high * float(rng.integers(2))
    lines, window = 2 ** int(rng.integers(10, 16)), about(rng, 0.3, 1.0) / logging.rate_hz
    return Sensors(
        input_noise=noise * min(1.0, motor.nominal_torque_nm / SMALL_NM),
        speed_noise=0.0 if logger.quiet else SPEED_NOISE_RAD_S,
        speed_turn=1.0,
        count=TURN / lines,
        encoder=bool(rng.random() < logger.encoder),
        window_s=window,
        jitter_s=0.05 / logging.rate_hz if rng.random() < logger.jitter else 0.0,
        gain=1.0 + tol.torque_gain * rng.normal(),
        offset=tol.torque_offset_nm * rng.normal(),
    )


def excitation(rng: np.random.Generator, plan: RunPlan, drawn: Drawn) -> tuple[Array, Array]:
    """Reference of the motors' speed, rad/s, and no pulses."""
    machine = drawn.machine
    speed = reference(
        plan.profile,
        rng,
        duration_s=plan.duration_s,
        speed_rad_s=machine.motor.nominal_speed_rad_s,
        room_rad=travel_m(drawn, plan.duration_s) / machine.lift_m_per_rad,
    )
    return speed, np.zeros(0)


def move(rng: np.random.Generator, drawn: Drawn, truth: Truth, family: Family, speed: Array, pulses: Array) -> Array:
    noisy = 0.0 if family.logger.quiet else 1.0
    current = rng.normal(scale=noisy * CURRENT_NOISE * truth.T_max, size=len(speed))
    encoder = rng.normal(scale=noisy * ENCODER_NOISE_RAD_S, size=len(speed))
    return np.asarray(simulate(truth, speed, current, encoder))


def motor_angle(record: Array) -> Array:
    """Of the encoder, rad, from the start of the record on."""
    return np.asarray(np.cumsum(record[:, SPEED]) * RECORD_S)


def columns(
    samples: Sampled, record: Array, reference: Array, s: Sensors, rng: np.random.Generator, drawn: Drawn,
    plan: RunPlan, logging: Logging,
) -> Columns:  # fmt: skip
    """Torque of each motor or their sum, speed, and what else is logged."""
    n, rows = len(samples.rows), samples.rows
    share = 0.5 + (SHARE_STD * rng.normal() if s.speed_noise > 0.0 else 0.0)
    noise = rng.normal(scale=s.input_noise, size=(2, n))
    first, second = share * samples.input + noise[0], (1.0 - share) * samples.input + noise[1]
    written = 1 if s.input_noise > 0.2 else 4
    out: Columns = {"time_s": (samples.time_s, 3 if logging.rate_hz > 100.0 or logging.uneven else 2)}
    if "sum" in logging.logs:
        out["torque_motor_nm"] = (first + second, written)
    else:
        out |= {"torque_motor1_nm": (first, written), "torque_motor2_nm": (second, written)}
    out["speed_motor_rad_s"] = (samples.speed, 2 if s.speed_noise > 0.0 and not s.encoder else 5)
    if "reference" in logging.logs:
        out["speed_reference_rad_s"] = (reference[rows], 3)
    if "position" in logging.logs:
        out["position_carriage_m"] = (record[rows, HEIGHT] + rng.normal(scale=POSITION_NOISE_M, size=n), 4)
    if "tension" in logging.logs:
        tension = record[rows, TENSION] + rng.normal(scale=TENSION_NOISE_N, size=n)
        out["tension_dead_line_n"] = (TENSION_STEP_N * np.round(tension / TENSION_STEP_N), 0)
    return out


def _band_hz(rate_hz: float) -> float:
    """Below the carriage's swing on its wire."""
    return 1.28


def _said(plan: RunPlan) -> dict[str, float]:
    return {"payload_kg": plan.payload_kg, "start_position_m": plan.start}


def _shown_by(logging: Logging, drawn: Drawn, causes: Sequence[Cause]) -> Logging:
    return logging


HOIST = Kind(
    name="hoist",
    record_s=RECORD_S,
    input=TORQUE,
    speed=SPEED,
    listed=tuple(LISTED),
    unlisted=tuple(UNLISTED),
    events=tuple(EVENTS),
    usual=USUAL,
    pair=drawn_pair,
    drawn=lambda rng, family, names: drawn_hoist(rng, family),
    rebuilt=rebuilt,
    plan=plan,
    shown_by=_shown_by,
    scales=scales,
    causes={**LISTED, **UNLISTED},
    truth=truth,
    ailing=ailing,
    in_run=in_run,
    sensors=sensors,
    excitation=excitation,
    inertia=inertia,
    move=move,
    motion=motor_angle,
    columns=columns,
    band_hz=_band_hz,
    said=_said,
)
