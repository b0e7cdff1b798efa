"""The motion of one run of an axis, fixed steps: motor, coupling, load and the servo drive that moves them.

Kept apart from the workbench's plant on purpose: a semi-implicit Euler method of 0.05 ms, friction of standstill.py on
both sides of an elastic coupling with or without play, cogging, and a drive with position and speed loop that sees a
quantised encoder. Forward is positive.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from workbench.blind.sources.simulator.axis.truth import STEP_S, Truth
from workbench.blind.sources.simulator.compiled import own_cache
from workbench.blind.sources.simulator.standstill import bend, rise

STEPS_PER_RECORD = 4
RECORD_S = STEP_S * STEPS_PER_RECORD  # the drive's sampling, and that of the record
SETTLE_S = 0.4  # of standing before the record begins

# Columns of the record. POSITION, SPEED: the motor's side, where the encoder sits.
FORCE, POSITION, SPEED, ACCELERATION, LOAD_POSITION, LOAD_SPEED, FRICTION = range(7)
COLUMNS = 7

with own_cache():

    @numba.njit(cache=True)
    def _gravity(p: Truth, x: float) -> float:
        return p.G * math.sin(x) + p.C

    @numba.njit(cache=True)
    def _beyond(p: Truth, x: float) -> float:
        """All that pulls at the load at position x: gravity, and cable chains."""
        bent = max(x - p.chain_x, 0.0)
        return _gravity(p, x) + p.spring_k * (x - p.spring_x) + p.chain_k * bent * bent

    @numba.njit(cache=True)
    def _pulse(p: Truth, t: float) -> float:
        """How much of the event works at time t of the run, 0 to 1: a smooth rise and fall."""
        u = (t - p.event_t) / p.event_s if p.event_s > 0.0 else -1.0
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * u)) if 0.0 < u < 1.0 else 0.0

    @numba.njit(cache=True)
    def _warm(p: Truth, t: float) -> float:
        """By how much all friction is larger while the machine is cold."""
        return 1.0 + p.drift_a * math.exp(-(t + p.start_time_s) / p.drift_tau)

    @numba.njit(cache=True)
    def _level(p: Truth, forward: bool, x: float, v: float, t: float) -> float:
        """The Coulomb level at position x, speed v, time t of the run."""
        level = (p.F_f if forward else p.F_b) * _warm(p, t)
        level += (p.dF_f if forward else p.dF_b) + p.a_load * abs(_gravity(p, x))
        level += (p.Fs_f if forward else p.Fs_b) * math.exp(-((v / p.v_str) ** 2))
        level += p.bump_A * math.exp(-0.5 * ((x - p.bump_x) / p.bump_w) ** 2)
        level += p.step_A * min(max((x - p.step_x) / p.step_w + 0.5, 0.0), 1.0)
        level += 0.5 * p.wave_A * (1.0 + math.cos(2.0 * math.pi * x / p.wave_d + p.wave_ph))
        level += p.event_rub * _pulse(p, t)
        if p.body_F > 0.0 and t > p.body_t:
            level += p.body_F * (1.0 - math.exp(-(t - p.body_t) / p.body_tau))
        return max(level, 0.0)

    @numba.njit(cache=True)
    def _friction(p: Truth, z: float, z_before: float, x: float, v: float, t: float) -> float:
        """All friction at one side of the coupling, were it all there."""
        if p.bristles > 0.5:
            s = z + (p.bristle_tau / STEP_S) * (z - z_before)
        else:
            s = math.tanh(v / p.turn) * rise(v, p.peak, p.peak_v)
        slope = p.B * _warm(p, t) + (p.B_f if v > 0.0 else p.B_b)
        return _level(p, s > 0.0, x, v, t) * s + slope * v + p.drag_c * v * abs(v)

    @numba.njit(cache=True)
    def _motor(p: Truth, x: float) -> float:
        """Force that the motor makes by itself: cogging, and a ripple where one ails it."""
        cogging = p.cog1_A * math.sin(p.cog1_k * x + p.cog1_ph) + p.cog2_A * math.sin(p.cog2_k * x + p.cog2_ph)
        return cogging + p.ripple_A * math.sin(p.ripple_n * x + p.ripple_ph)

    @numba.njit(cache=True)
    def simulate(p: Truth, reference: np.ndarray, pulses: np.ndarray, current_noise: np.ndarray) -> np.ndarray:
        """The record of one run, a row each RECORD_S; the three inputs have a value each RECORD_S too.

        reference: speed, m/s (rad/s). pulses: force that is added to the drive's own, N (N m). current_noise: N (N m).
        """
        n, h = len(reference), STEP_S
        out = np.empty((n, COLUMNS))
        settle = int(SETTLE_S / RECORD_S)
        rigid = p.M_l <= 0.0
        M = p.M_m + p.M_l
        m_soft = p.soft_share * (p.M_m if rigid else p.M_l)
        body = p.M_m - m_soft if rigid else p.M_l - m_soft  # what carries the soft part
        on_motor = 1.0 if rigid else p.on_motor
        load = _beyond(p, p.x_0)
        half = 0.5 * p.play
        x = x_ref = p.x_0
        x_l = x if rigid else x - load / p.k_c - (half if load > 0.0 else -half)
        v = v_l = 0.0
        z = z_l = 0.0
        soft, v_soft = x_l, 0.0
        force = integral = load
        v_seen, v_before = 0.0, 0.0
        counted_before = p.quantum * math.floor(x / p.quantum)
        for j in range(-settle, n):
            i = max(j, 0)
            t = j * RECORD_S
            v_ref = reference[i] if j >= 0 else 0.0
            a_ref = (v_ref - v_before) / RECORD_S
            v_before = v_ref
            # The drive: position loop, speed loop with a limit, current's lag; once a record's step.
            counted = p.quantum * math.floor(x / p.quantum)
            v_seen += (RECORD_S / (p.seen_tau + RECORD_S)) * ((counted - counted_before) / RECORD_S - v_seen)
            counted_before = counted
            error = v_ref + p.kv * (x_ref - counted) - v_seen
            asked = p.kp * error + integral + p.ahead * M * a_ref
            given = min(max(asked, -p.F_max), p.F_max)
            if given == asked:
                integral += p.ki * error * RECORD_S
            if j >= 0:
                given += current_noise[i] + pulses[i]
                out[i, FORCE] = force
                out[i, POSITION] = x
                out[i, SPEED] = v
                out[i, LOAD_POSITION] = x_l
                out[i, LOAD_SPEED] = v_l
            x_ref += v_ref * RECORD_S
            friction, began = 0.0, v
            for _ in range(STEPS_PER_RECORD):
                force += (h / p.lag_tau) * (given - force)
                z_before, z_l_before = z, z_l
                z = bend(z, v, p.bristle, rise(v, p.peak, p.peak_v), p.relax_s, h)
                rubbing = on_motor * _friction(p, z, z_before, x, v, t)
                beyond = _beyond(p, x_l) + p.event_F * _pulse(p, t)
                on_soft = 0.0
                if m_soft > 0.0:
                    w = p.soft_w
                    on_soft = m_soft * (w * w * (x_l - soft) + 2.0 * p.soft_zeta * w * (v_l - v_soft))
                    v_soft += h * on_soft / m_soft
                    soft += h * v_soft
                if rigid:
                    v += h / body * (force + _motor(p, x) - rubbing - beyond - on_soft)
                    x += h * v
                    x_l, v_l = x, v
                    friction = rubbing
                else:
                    stretch = x - x_l
                    sag = stretch - half if stretch > half else (stretch + half if stretch < -half else 0.0)
                    through = p.k_c * sag + p.c_c * (v - v_l) if sag != 0.0 else 0.0
                    z_l = bend(z_l, v_l, p.bristle, rise(v_l, p.peak, p.peak_v), p.relax_s, h)
                    rubbing_l = (1.0 - on_motor) * _friction(p, z_l, z_l_before, x_l, v_l, t)
                    v += h / p.M_m * (force + _motor(p, x) - rubbing - through)
                    v_l += h / body * (through - rubbing_l - beyond - on_soft)
                    x += h * v
                    x_l += h * v_l
                    friction = rubbing + rubbing_l
                t += h
            if j >= 0:
                out[i, ACCELERATION] = (v - began) / RECORD_S
                out[i, FRICTION] = friction
        return out
