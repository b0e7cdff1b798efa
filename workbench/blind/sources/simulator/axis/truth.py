"""Every number of one run of a true axis, as the kernel takes it."""

# ruff: noqa: N815 -- labels and textbooks have these symbols

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.blind.sources.simulator.axis.machines import Drawn
from workbench.blind.sources.simulator.causes import TURN, Cause, about
from workbench.blind.sources.simulator.families import Family
from workbench.blind.sources.simulator.standstill import drawn_standstill

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
