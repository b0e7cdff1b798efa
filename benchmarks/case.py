"""The signal that every benchmark runs on: 49.76 s of hoisting and lowering, made here."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import NamedTuple

import numpy as np

from .hoist import Floats, Hoist, SpeedLoop, State, hanging, load_hoist, reference_loop, reference_replay

DURATION_S = 49.76
LOG_INTERVAL_S = 0.01
PAYLOAD_KG = 4500.0
HEIGHT_M = 6.0
# Two motors of 480 N m with an overload of 1.6, as the default machine has.
LOOP = SpeedLoop(kp=20.0, ki=40.0, limit_nm=2 * 480.0 * 1.6, interval_s=0.001)
# Carriage speed against time, m/s: stand, up at 0.7, stand, down at 0.7, stand, a short slow move up.
PROFILE_S = (0.0, 2.0, 3.0, 13.0, 14.0, 20.0, 21.0, 31.0, 32.0, 37.0, 37.5, 44.5, 45.0, DURATION_S)
PROFILE_M_S = (0.0, 0.0, 0.7, 0.7, 0.0, 0.0, -0.7, -0.7, 0.0, 0.0, 0.3, 0.3, 0.0, 0.0)
# What the fit has to find, and where the log's machine had it; it starts at the default machine's.
FITTED = {"guide.coulomb_hoisting_n": 6900.0, "guide.coulomb_lowering_n": 3900.0, "guide.atan_slope_s_per_m": 150.0}


class Replay(NamedTuple):
    """A torque log, where it starts, and the solution to be met."""

    hoist: Hoist
    start: State
    time_s: Floats
    torque_nm: Floats
    speed_rad_s: Floats  # the reference's, at the samples


class Loop(NamedTuple):
    """A closed-loop run and where it starts."""

    hoist: Hoist
    payload_kg: float
    loop: SpeedLoop
    start: State
    hold_nm: float
    wanted_rad_s: Floats


def wanted_speed(p: Hoist, ramp: float = 1.0) -> Floats:
    """The motor-speed set-point at each controller sample, rad/s; two falls halve the wire's speed.

    ramp: how long speeding up and slowing down take, relative to the profile's own; the middle stays.
    """
    middle = np.array(PROFILE_S)
    for k in range(1, len(PROFILE_S) - 1, 2):
        centre, half = (PROFILE_S[k] + PROFILE_S[k + 1]) / 2.0, (PROFILE_S[k + 1] - PROFILE_S[k]) / 2.0
        middle[k], middle[k + 1] = centre - ramp * half, centre + ramp * half
    time = np.arange(round(DURATION_S / LOOP.interval_s)) * LOOP.interval_s
    return np.interp(time, middle, PROFILE_M_S) * (2.0 / p.arm)


def make_loop(payload_kg: float = PAYLOAD_KG, loop: SpeedLoop = LOOP, ramp: float = 1.0) -> Loop:
    p = load_hoist(payload_kg)
    start, hold = hanging(p, HEIGHT_M)
    return Loop(p, payload_kg, loop, start, hold, wanted_speed(p, ramp))


def solve_loop(case: Loop) -> tuple[Floats, Floats]:
    """The reference's motor speed, rad/s, and torque, N m, at the controller's samples."""
    states, torque = reference_loop(case.hoist, case.start, case.hold_nm, case.loop, case.wanted_rad_s)
    return states[:-1, 1], torque


def make_batch() -> list[Loop]:
    """64 runs: payload by gain by steepness of the ramps."""
    gains: Iterable[float] = (14.0, 18.0, 22.0, 26.0)
    return [
        make_loop(payload, LOOP._replace(kp=kp, ki=2.0 * kp), ramp)
        for payload, kp, ramp in product((0.0, 3000.0, 6000.0, 9000.0), gains, (0.8, 1.0, 1.2, 1.4))
    ]


def make_replay(p: Hoist, torque_nm: Floats) -> Replay:
    """The log that a recorder at 100 Hz would make of a loop's torque, replayed by the reference."""
    every = round(LOG_INTERVAL_S / LOOP.interval_s)
    samples = np.append(torque_nm[::every], torque_nm[-1])
    time = np.asarray(np.arange(samples.size) * LOG_INTERVAL_S, dtype=np.float64)
    start, _ = hanging(p, HEIGHT_M)
    states = reference_replay(p, start, samples, LOG_INTERVAL_S)
    return Replay(p, start, time, samples, states[:, 1])


def make_fit_log() -> Replay:
    """A log of a machine whose friction is as FITTED says."""
    up, down, slope = FITTED.values()
    p = load_hoist(PAYLOAD_KG)._replace(up=up, down=down, slope=slope)
    return make_replay(p, solve_loop(make_loop()._replace(hoist=p))[1])
