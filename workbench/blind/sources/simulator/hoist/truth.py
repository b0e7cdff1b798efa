"""Every number of one run of a true machine, as the kernel takes it."""

# ruff: noqa: N815 -- labels and textbooks have these symbols

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.blind.sources.simulator.causes import TURN, Cause, about
from workbench.blind.sources.simulator.families import Family
from workbench.blind.sources.simulator.standstill import drawn_standstill
from workbench.machine import Hoist

WIRE_KG_M3 = 7850.0
CLIPPED = 2.5  # standard deviations: what is further off is no machine that was accepted


class Truth(NamedTuple):
    """SI; symbols as in docs/model.md where they are there. What is zero by default is off."""

    # Drive and motors, of all motors together at their common shaft; count_rad: the encoder's step.
    J_m: float
    T_max: float
    kp: float
    ki: float
    lag_tau: float
    seen_tau: float
    count_rad: float
    # Gear and drum; ratio is motor over drum; k_g, c_g of the shaft, at the drum.
    ratio: float
    k_g: float
    c_g: float
    R: float
    r_pw: float
    J_w: float
    m_w: float
    # Sheave, pins, wire.
    r: float
    r_ps: float
    J_s: float
    m_sh: float
    mu: float
    EA: float
    L: float
    wire_tau: float
    rho: float
    # Carriage and guide.
    m_c: float
    F_up: float
    F_dn: float
    # Friction near standstill: bristles of the guide and of the pins, or the tanh's turning speeds.
    bristles: float
    bristle_m: float
    bristle_tau: float
    turn_m_s: float
    pin_rad: float
    pin_turn: float
    peak: float = 0.0
    peak_m_s: float = 1.0
    relax_s: float = 0.0
    # The run.
    mp_scale: float = 1.0
    m_p: float = 0.0
    x_0: float = 9.0
    z_0: float = 0.0
    start_time_s: float = 0.0
    g: float = 9.81
    # Effects.
    B_up: float = 0.0
    B_dn: float = 0.0
    dF_up: float = 0.0
    dF_dn: float = 0.0
    Fs_up: float = 0.0
    Fs_dn: float = 0.0
    v_str: float = 0.05
    a_load: float = 0.0
    bump_A: float = 0.0
    bump_x: float = 0.0
    bump_w: float = 1.0
    drift_a: float = 0.0
    drift_tau: float = 200.0
    eta_loss: float = 0.0
    play: float = 0.0
    brk_T: float = 0.0
    brk_tau: float = 1.0
    layer_dR: float = 0.0
    layer_th: float = 0.0
    ecc_e: float = 0.0
    ecc_ph: float = 0.0
    k_share: float = 0.0
    heave_A: float = 0.0
    heave_w: float = 1.0
    heave_ph: float = 0.0
    ripple_A: float = 0.0
    ripple_n: float = 1.0
    ripple_ph: float = 0.0
    ripple2_A: float = 0.0
    ripple2_n: float = 6.0
    ripple2_ph: float = 0.0
    ripple3_A: float = 0.0
    ripple3_n: float = 1.0
    ripple3_ph: float = 0.0
    # What no list holds.
    motor_visc: float = 0.0
    fan_q: float = 0.0
    drag_c: float = 0.0
    step_A: float = 0.0
    step_x: float = 0.0
    roller_A: float = 0.0
    roller_d: float = 1.0
    roller_ph: float = 0.0
    body_F: float = 0.0
    body_t: float = 0.0
    body_tau: float = 1.0
    hook_share: float = 0.0
    hook_k: float = 1.0
    hook_c: float = 0.0
    swell_A: float = 0.0
    swell_w: float = 1.0
    swell_ph: float = 0.0
    tooth_T: float = 0.0
    tooth_w: float = 0.1
    tooth_ph: float = 0.0
    dent_A: float = 0.0
    dent_th: float = 0.0
    dent_w: float = 1.0
    sheave_e: float = 0.0
    sheave_ph: float = 0.0
    # A brief event: when it begins in this run, how long it lasts, and what works meanwhile. Torques of motor,
    # brake, drum and sheave at the motor; brake, guide and sheave work against the motion.
    event_t: float = 0.0
    event_s: float = 0.0
    event_motor: float = 0.0
    event_brake: float = 0.0
    event_drum: float = 0.0
    event_sheave: float = 0.0
    event_guide: float = 0.0
    event_payload: float = 0.0
    event_platform: float = 0.0


def nominal_truth(machine: Hoist) -> Truth:
    """The nominal machine, with a plain drive and hardly any width of standstill."""
    motor, winch, sheave, wire = machine.motor, machine.winch, machine.sheave, machine.wire
    J_m = motor.count * motor.rotor_inertia_kg_m2
    J = J_m + winch.inertia_kg_m2 / machine.gearbox.ratio**2
    k_g = winch.inertia_kg_m2 * (2.0 * math.pi * 50.0) ** 2  # the drum swings on its shaft at some 50 Hz
    return Truth(
        J_m=J_m,
        T_max=1.6 * motor.count * motor.nominal_torque_nm,
        kp=15.0 * J,
        ki=60.0 * J,
        lag_tau=0.008,
        seen_tau=0.005,
        count_rad=1e-5,
        ratio=machine.gearbox.ratio,
        k_g=k_g,
        c_g=0.1 * math.sqrt(k_g * winch.inertia_kg_m2),
        R=winch.drum_diameter_m / 2.0,
        r_pw=winch.pin_diameter_m / 2.0,
        J_w=winch.inertia_kg_m2,
        m_w=winch.mass_kg,
        r=sheave.diameter_m / 2.0,
        r_ps=sheave.pin_diameter_m / 2.0,
        J_s=sheave.inertia_kg_m2,
        m_sh=sheave.mass_kg,
        mu=machine.bearing.pin_friction_coefficient,
        EA=wire.youngs_modulus_pa * wire.effective_area_m2,
        L=wire.segment_length_m,
        wire_tau=wire.damping_time_s,
        rho=WIRE_KG_M3 * wire.effective_area_m2,
        m_c=machine.carriage.mass_kg,
        F_up=machine.guide.coulomb_hoisting_n,
        F_dn=machine.guide.coulomb_lowering_n,
        bristles=0.0,
        bristle_m=1e-3,
        bristle_tau=0.005,
        turn_m_s=1e-3,
        pin_rad=0.01,
        pin_turn=0.01,
        g=machine.gravity_m_s2,
    )


def true_truth(machine: Hoist, family: Family, rng: np.random.Generator) -> Truth:
    """A machine built after the nominal one: its tolerances drawn, and what machines of its family have beside."""
    p, tol, nuisances = nominal_truth(machine), machine.tolerances, family.nuisances
    motors = machine.motor.count * machine.motor.nominal_torque_nm
    speed = machine.motor.nominal_speed_rad_s * machine.lift_m_per_rad
    law = drawn_standstill(family.laws, rng)

    def off(std: float) -> float:
        return 1.0 + std * float(np.clip(rng.normal(), -CLIPPED, CLIPPED))

    def some(most: float) -> float:
        return most * rng.uniform(0.0, 1.0)

    J = p.J_m + p.J_w / p.ratio**2
    kp = J * rng.uniform(11.0, 19.0)
    deflection = about(rng, 1e-4, 6e-4)
    F = 0.5 * (p.F_up + p.F_dn)
    viscous = some(nuisances.viscous) * F / speed
    return p._replace(
        J_m=p.J_m * off(tol.rotor_inertia),
        m_c=p.m_c * off(tol.carriage_mass),
        F_up=p.F_up * off(tol.coulomb),
        F_dn=p.F_dn * off(tol.coulomb),
        mu=p.mu * off(tol.pin_friction),
        EA=p.EA * off(tol.wire_stiffness),
        wire_tau=p.wire_tau * off(0.05),
        kp=kp,
        ki=kp * rng.uniform(3.0, 5.0),
        lag_tau=rng.uniform(0.004, 0.012),
        seen_tau=rng.uniform(0.004, 0.01),
        count_rad=float(rng.choice([2.0, 10.0, 40.0])) * 1e-5,
        bristles=law.bristles,
        bristle_m=deflection,
        bristle_tau=0.6 * math.sqrt(p.m_c * deflection / F),  # some 0.3 of critical damping with the empty carriage
        turn_m_s=about(rng, 5e-4, 4e-3),
        pin_rad=rng.uniform(0.003, 0.02),
        pin_turn=rng.uniform(0.004, 0.02),
        peak=law.peak,
        peak_m_s=law.peak_speed * speed,
        relax_s=law.relax_s,
        mp_scale=off(tol.payload),
        B_up=viscous,
        B_dn=viscous,
        eta_loss=some(nuisances.gear_loss),
        ecc_e=some(nuisances.eccentricity) * p.R,
        ecc_ph=rng.uniform(0.0, TURN),
        ripple2_A=some(nuisances.ripple) * motors,
        ripple2_n=6.0,
        ripple2_ph=rng.uniform(0.0, TURN),
        ripple3_A=some(nuisances.ripple) * motors,
        ripple3_n=float(rng.choice([1.0, 2.0])),
        ripple3_ph=rng.uniform(0.0, TURN),
        k_share=rng.uniform(0.0, 0.2),
    )


def ailing(truth: Truth, cause: Cause) -> Truth:
    """With the cause at work: J_g, dm_c and rho_extra are added, all else takes the place of what was there."""
    put = dict(cause.truth)
    added = {"J_m": put.pop("Jg", 0.0), "m_c": put.pop("dm_c", 0.0), "rho": put.pop("rho_extra", 0.0)}
    truth = truth._replace(**{name: getattr(truth, name) + more for name, more in added.items()})
    return truth._replace(**put)
