"""The axis' record: runs, sensors and log of this kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchmarks.validation.axis_causes import (
    EVENTS,
    LISTED,
    OF_A_LOAD,
    OF_NO_LOAD,
    UNLISTED,
    USUAL,
    Scales,
    drawn_pair,
    scales_of,
)
from benchmarks.validation.axis_machines import KINDS as PROFILES
from benchmarks.validation.axis_machines import MOTIONS, Drawn, drawn_axis, rebuilt
from benchmarks.validation.axis_machines import excitation as excited
from benchmarks.validation.axis_motion import FORCE, POSITION, RECORD_S, SPEED, Truth, ailing, simulate, true_truth
from benchmarks.validation.families import Family
from benchmarks.validation.kind import Cause, Kind, Logging, RunPlan, about
from benchmarks.validation.sensors import Columns, Sampled, Sensors, digits

Array = npt.NDArray[np.float64]
CURRENT_NOISE = 2e-3  # of the largest force, each step of the drive
MOST_SAMPLES = 100_000  # of all runs together: quicker logs are shorter
SHORTEST_S = 4.0
HIGHEST_HZ, OF_THE_RATE = 90.0, 0.09  # about where logs of a rate are compared
OF_A_PLACE = ("position", "periodic")  # regimes that a log of the speed alone does not show


def drawn(rng: np.random.Generator, family: Family, names: Sequence[str]) -> Drawn:
    """Of either motion; some effects ask for a turning axis, for a load or for none."""
    motion = str(rng.choice(MOTIONS))
    if set(names) & {*OF_A_LOAD}:  # a load that never changes tells little of what depends on it
        motion = "rotary"
    loaded = True if set(names) & set(OF_A_LOAD) else False if set(names) & set(OF_NO_LOAD) else None
    return drawn_axis(rng, motion, loaded)


def plan(rng: np.random.Generator, drawn: Drawn, family: Family) -> tuple[tuple[RunPlan, ...], Logging]:
    """The family's profiles, or drawn ones of which one is quick and one is slow or goes in steps of speed."""
    logger = family.logger
    rate_hz = float(rng.choice(logger.rates_hz))
    count = int(rng.integers(family.runs[0], family.runs[1] + 1))
    if family.profiles:
        profiles = [*family.profiles][:count]
    else:
        profiles = [str(rng.choice(["moves", "shuttle", "pulses"])), str(rng.choice(["slow", "steps"]))]
        others = [profile for profile in PROFILES if profile not in profiles]
        profiles += [others[k % len(others)] for k in rng.permutation(count - 2)]
    longest = max(SHORTEST_S, MOST_SAMPLES / rate_hz / count)
    runs: list[RunPlan] = []
    clock = 0.0
    for number, profile in enumerate(profiles, start=1):
        duration = round(min(rng.uniform(*family.lengths_s), longest), 1)
        start = drawn.low + 0.05 * drawn.travel * rng.random()
        runs.append(RunPlan(f"run{number}_{profile}", profile, 0.0, start, round(clock, 2), duration))
        clock += duration + rng.uniform(15.0, 60.0)
    logs = logger.logs[int(rng.integers(len(logger.logs)))]
    uneven = bool(rng.random() < logger.uneven and rate_hz <= 500.0)
    return tuple(runs), Logging(rate_hz, logs, uneven)


def shown_by(logging: Logging, drawn: Drawn, causes: Sequence[Cause]) -> Logging:
    """A position is logged where the load or a cause depends on it."""
    if drawn.machine.role("gravity_sine") or any(cause.regime in OF_A_PLACE for cause in causes):
        return replace(logging, logs=("position", *(name for name in logging.logs if name != "position")))
    return logging


def scales(drawn: Drawn, runs: Sequence[RunPlan], logging: Logging) -> Scales:
    return scales_of(drawn, logging.rate_hz)


def in_run(truth: Truth, plan: RunPlan, rng: np.random.Generator) -> Truth:
    return truth._replace(x_0=plan.start, start_time_s=plan.start_time_s)


def inertia(truth: Truth) -> float:
    """Of both sides, kg (kg m²)."""
    return truth.M_m + truth.M_l


def sensors(rng: np.random.Generator, drawn: Drawn, family: Family, logging: Logging) -> Sensors:
    logger, machine = family.logger, drawn.machine
    return Sensors(
        input_noise=drawn.force * about(rng, *logger.noise),
        speed_noise=drawn.speed * about(rng, 1e-4, 1.5e-3),
        speed_turn=0.005 * drawn.speed,
        count=drawn.count,
        encoder=bool(rng.random() < logger.encoder),
        window_s=about(rng, 0.3, 1.0) / logging.rate_hz,
        jitter_s=0.05 / logging.rate_hz if rng.random() < logger.jitter else 0.0,
        late_s=rng.uniform(0.0, 0.5) / logging.rate_hz,
        gain=1.0 + machine.role("gain_tolerance") * rng.normal(),
        offset=machine.offset_tolerance(drawn.force) * rng.normal(),
    )


def excitation(rng: np.random.Generator, plan: RunPlan, drawn: Drawn) -> tuple[Array, Array]:
    """Reference of the speed, m/s (rad/s), and pulses of force, N (N m)."""
    given = excited(plan.profile, rng, drawn, plan.duration_s)
    return given.speed, given.pulses


def move(rng: np.random.Generator, drawn: Drawn, truth: Truth, family: Family, speed: Array, pulses: Array) -> Array:
    noise = rng.normal(scale=CURRENT_NOISE * drawn.force, size=len(speed))
    return np.asarray(simulate(truth, speed, pulses, noise))


def encoder_position(record: Array) -> Array:
    """The motor's side, where the encoder sits."""
    return np.asarray(record[:, POSITION])


def columns(
    samples: Sampled, record: Array, reference: Array, s: Sensors, rng: np.random.Generator, drawn: Drawn,
    plan: RunPlan, logging: Logging,
) -> Columns:  # fmt: skip
    """Force or torque, and of position, speed and reference those that are logged."""
    n_, m_, x_, v_ = (
        ("force_n", "position", "m", "velocity_m_s") if drawn.linear else ("torque_nm", "angle", "rad", "speed_rad_s")
    )
    force = samples.input + rng.normal(scale=s.input_noise, size=len(samples.rows))
    out: Columns = {"time_s": (samples.time_s, 4), n_: (force, digits(s.input_noise / 10.0))}
    fine = digits(s.count / 10.0)
    if "position" in logging.logs:
        out[f"{m_}_{x_}"] = (s.count * np.floor(samples.position / s.count), fine)
    if "speed" in logging.logs:
        out[v_] = (samples.speed, digits(s.speed_noise / 10.0))
    if "reference" in logging.logs:
        asked = plan.start + np.cumsum(reference) * RECORD_S
        out[f"{m_}_reference_{x_}"] = (asked[samples.rows], fine)
    return out


def _band_hz(rate_hz: float) -> float:
    return min(HIGHEST_HZ, OF_THE_RATE * rate_hz)


def _said(plan: RunPlan) -> dict[str, float]:
    return {}


AXIS = Kind(
    name="axis",
    record_s=RECORD_S,
    input=FORCE,
    speed=SPEED,
    listed=tuple(LISTED),
    unlisted=tuple(UNLISTED),
    events=tuple(EVENTS),
    usual=USUAL,
    pair=drawn_pair,
    drawn=drawn,
    rebuilt=rebuilt,
    plan=plan,
    shown_by=shown_by,
    scales=scales,
    causes={**LISTED, **UNLISTED},
    truth=true_truth,
    ailing=ailing,
    in_run=in_run,
    sensors=sensors,
    excitation=excitation,
    inertia=inertia,
    move=move,
    motion=encoder_position,
    columns=columns,
    band_hz=_band_hz,
    said=_said,
)
