"""Every number of one run of a true axis, and its motion: motor, coupling, load and the servo drive that moves them."""

# ruff: noqa: N815 -- labels and textbooks have these symbols

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from benchmarks.validation.families import Family
from benchmarks.validation.kind import TURN, Cause, about
from benchmarks.validation.standstill import bend, drawn_standstill, own_cache, rise

if TYPE_CHECKING:
    from benchmarks.validation.axis_machines import Drawn

STEP_S = 5e-5  # of the kernel
LEAST_PER_TURN = 4.0  # steps within which friction may turn over at standstill: the method is explicit in it
CLIPPED = 2.5  # standard deviations: what is further off is no machine that was accepted


class Truth(NamedTuple):
    """SI, of a linear axis in N and m, of a rotary one in N m and rad. What is zero by default is off."""

    # Inertia of the motor's side and, over an elastic coupling, of the load's; M_l = 0 is rigid.
    M_m: float
    M_l: float
    k_c: float
    c_c: float
    on_motor: float  # share of the friction that acts on the motor's side
    # Drive: position and speed loop, share of the acceleration fed forward, lag of the current, encoder's step.
    F_max: float
    kv: float
    kp: float
    ki: float
    ahead: float
    lag_tau: float
    seen_tau: float
    quantum: float
    # Friction and load.
    F_f: float
    F_b: float
    B: float
    G: float
    C: float
    bristles: float
    bristle: float
    bristle_tau: float
    turn: float
    peak: float = 0.0
    peak_v: float = 1.0
    relax_s: float = 0.0
    # What all motors have: cogging, two waves over the way.
    cog1_A: float = 0.0
    cog1_k: float = 1.0
    cog1_ph: float = 0.0
    cog2_A: float = 0.0
    cog2_k: float = 1.0
    cog2_ph: float = 0.0
    # The run.
    x_0: float = 0.0
    start_time_s: float = 0.0
    # Effects.
    B_f: float = 0.0
    B_b: float = 0.0
    dF_f: float = 0.0
    dF_b: float = 0.0
    Fs_f: float = 0.0
    Fs_b: float = 0.0
    v_str: float = 1.0
    a_load: float = 0.0
    bump_A: float = 0.0
    bump_x: float = 0.0
    bump_w: float = 1.0
    drift_a: float = 0.0
    drift_tau: float = 100.0
    ripple_A: float = 0.0
    ripple_n: float = 1.0
    ripple_ph: float = 0.0
    play: float = 0.0
    # What no list holds.
    drag_c: float = 0.0
    step_A: float = 0.0
    step_x: float = 0.0
    step_w: float = 1.0
    wave_A: float = 0.0
    wave_d: float = 1.0
    wave_ph: float = 0.0
    body_F: float = 0.0
    body_t: float = 0.0
    body_tau: float = 1.0
    spring_k: float = 0.0
    spring_x: float = 0.0
    soft_share: float = 0.0
    soft_w: float = 1.0
    soft_zeta: float = 0.0
    chain_k: float = 0.0
    chain_x: float = 0.0
    # A brief event: when it begins in this run, how long it lasts; a force at the load, and added friction.
    event_t: float = 0.0
    event_s: float = 0.0
    event_F: float = 0.0
    event_rub: float = 0.0


def nominal_truth(drawn: Drawn) -> Truth:
    """The nominal axis: rigid, hardly any width of standstill, no cogging."""
    machine = drawn.machine
    M, F_f, F_b, B, G, C = map(
        machine.role, ("inertia", "coulomb_forward", "coulomb_backward", "viscous", "gravity_sine", "gravity_constant")
    )
    loop = TURN * 12.0  # rad/s of the speed loop
    return Truth(
        M_m=M, M_l=0.0, k_c=0.0, c_c=0.0, on_motor=1.0, F_max=2.5 * drawn.force,
        kv=loop / 5.0, kp=M * loop, ki=M * loop * loop / 6.0, ahead=1.0, lag_tau=4e-4, seen_tau=5e-4,
        quantum=1e-7 * drawn.travel, F_f=F_f, F_b=F_b, B=B, G=G, C=C, bristles=0.0, bristle=1e-4 * drawn.travel,
        bristle_tau=0.01, turn=max(1e-3 * drawn.speed, LEAST_PER_TURN * STEP_S * max(F_f, F_b) / M),
    )  # fmt: skip


def true_truth(drawn: Drawn, family: Family, rng: np.random.Generator) -> Truth:
    """An axis built after the nominal one: its tolerances drawn, and what every axis has beside its equation."""
    p, tol = nominal_truth(drawn), drawn.machine.tolerances
    elastic, nuisances = rng.random() < family.elastic, family.nuisances
    law = drawn_standstill(family.laws, rng)

    def off(std: float) -> float:
        return 1.0 + std * float(np.clip(rng.normal(), -CLIPPED, CLIPPED))

    M, F_f, F_b = p.M_m * off(tol.inertia), p.F_f * off(tol.coulomb), p.F_b * off(tol.coulomb)
    load_share, resonance_hz, zeta = rng.uniform(0.25, 0.75), about(rng, *family.resonance_hz), about(rng, 0.03, 0.1)
    on_motor = rng.uniform(0.2, 0.8)
    loop = TURN * about(rng, 8.0, 20.0)
    deflection = drawn.travel * about(rng, 2e-5, 2e-4)
    p = p._replace(
        M_m=M,
        F_f=F_f,
        F_b=F_b,
        B=p.B * off(tol.viscous),
        G=p.G * off(tol.gravity),
        C=p.C * off(tol.gravity),
        kv=loop / rng.uniform(4.0, 7.0),
        kp=M * loop,
        ki=M * loop * loop / rng.uniform(5.0, 10.0),
        ahead=rng.uniform(0.6, 1.0),
        lag_tau=about(rng, 2e-4, 8e-4),
        seen_tau=about(rng, 3e-4, 1e-3),
        quantum=drawn.count,
        bristles=law.bristles,
        bristle=deflection,
        bristle_tau=0.6 * math.sqrt(M * deflection / (0.5 * (F_f + F_b))),  # some 0.3 of critical damping
        turn=max(drawn.speed * about(rng, 5e-4, 4e-3), p.turn),
        peak=law.peak,
        peak_v=law.peak_speed * drawn.speed,
        relax_s=law.relax_s,
        a_load=nuisances.gear_loss * rng.uniform(0.0, 1.0),
        cog1_A=drawn.force * nuisances.ripple * about(rng, 0.2, 1.0),
        cog1_k=TURN * drawn.poles / drawn.travel,
        cog1_ph=rng.uniform(0.0, TURN),
        cog2_A=drawn.force * nuisances.ripple * about(rng, 0.15, 0.7),
        cog2_k=TURN * drawn.poles * 6.0 / drawn.travel,
        cog2_ph=rng.uniform(0.0, TURN),
    )
    return coupled(p, load_share, resonance_hz, zeta, on_motor) if elastic else p


def coupled(p: Truth, load_share: float, resonance_hz: float, zeta: float, on_motor: float) -> Truth:
    """The same axis with `load_share` of its inertia behind an elastic coupling."""
    M = p.M_m + p.M_l
    M_l, M_m = load_share * M, (1.0 - load_share) * M
    reduced, w = M_l * M_m / M, TURN * resonance_hz
    return p._replace(
        M_m=M_m, M_l=M_l, k_c=reduced * w * w, c_c=2.0 * zeta * reduced * w, on_motor=on_motor,
        turn=max(p.turn, LEAST_PER_TURN * STEP_S * max(p.F_f, p.F_b) / min(M_l, M_m)),
    )  # fmt: skip


def ailing(truth: Truth, cause: Cause) -> Truth:
    """With the cause at work. inertia_fraction scales both inertias; play lies between two sides, of which a rigid
    axis then has `beyond` of its inertia behind it."""
    put = dict(cause.truth)
    share, beyond = 1.0 + put.pop("inertia_fraction", 0.0), put.pop("beyond", 0.5)
    if "play" in put:
        hz, zeta = put.pop("contact_hz"), put.pop("contact_zeta")
        truth = coupled(truth, beyond, hz, zeta, put["on_motor"])
    return truth._replace(M_m=share * truth.M_m, M_l=share * truth.M_l)._replace(**put)


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
