"""Every number of one run of a true hoist, and its motion with an integrator, friction and drive of its own."""

# ruff: noqa: N815 -- labels and textbooks have these symbols

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from benchmarks.validation.families import Family
from benchmarks.validation.kind import TURN, Cause, about
from benchmarks.validation.standstill import bend, drawn_standstill, own_cache, rise
from workbench.machines import Hoist

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


STEP_S = 1e-4
STEPS_PER_RECORD = 10
RECORD_S = STEP_S * STEPS_PER_RECORD  # the drive's sampling, and that of the record
MOVING_RAD_S = 0.3  # motor speed at which losses of gear and brake have turned over
CLIMB_RAD = 0.3  # of drum angle, within which the wire climbs onto the next layer
RELEASE_S = 0.2  # a rest of the reference as long as this sets the brake
SETTLE_S = 1.5  # of standing before the record begins

# Columns of the record.
TORQUE, SPEED, HEIGHT, TENSION, DRUM, CARRIAGE_SPEED, FRICTION, SHAFT, DEAD = range(9)
COLUMNS = 9

with own_cache():

    @numba.njit(cache=True)
    def _switch(p: Truth, z: float, v: float, v_turn: float) -> float:
        """What stands for the sign of the speed: the bristles' bend, or a tanh."""
        return z if p.bristles > 0.5 else math.tanh(v / v_turn)

    @numba.njit(cache=True)
    def _pulse(p: Truth, t: float) -> float:
        """How much of the event works at time t of the run, 0 to 1: a smooth rise and fall."""
        u = (t - p.event_t) / p.event_s if p.event_s > 0.0 else -1.0
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * u)) if 0.0 < u < 1.0 else 0.0

    @numba.njit(cache=True)
    def _guide_level(p: Truth, up: bool, x: float, v: float, t: float) -> float:
        """The friction level of the rollers in the rails, N, at height x, speed v, time t of the run."""
        own = p.F_up if up else p.F_dn
        level = own * (1.0 + p.drift_a * math.exp(-(t + p.start_time_s) / p.drift_tau))
        level += (p.dF_up if up else p.dF_dn) + p.a_load * p.m_p * p.g
        level += (p.Fs_up if up else p.Fs_dn) * math.exp(-((v / p.v_str) ** 2))
        level += p.bump_A * math.exp(-0.5 * ((x - p.bump_x) / p.bump_w) ** 2)
        level += p.step_A * min(max((x - p.step_x) / 0.05 + 0.5, 0.0), 1.0)
        level += 0.5 * p.roller_A * (1.0 + math.cos(2.0 * math.pi * x / p.roller_d + p.roller_ph))
        if t > p.body_t:
            level += p.body_F * (1.0 - math.exp(-(t - p.body_t) / p.body_tau))
        return max(level, 0.0)

    @numba.njit(cache=True)
    def wound(p: Truth, th: float) -> float:
        """Wire on the drum at drum angle th, m."""
        a = th - p.layer_th
        climbed = 0.0 if a <= 0.0 else (0.5 * a * a / CLIMB_RAD if a < CLIMB_RAD else a - 0.5 * CLIMB_RAD)
        length = p.R * th + p.layer_dR * climbed + p.ecc_e * (math.cos(p.ecc_ph) - math.cos(th + p.ecc_ph))
        if p.dent_A > 0.0:
            far = math.erf((th - p.dent_th) / p.dent_w) + math.erf(p.dent_th / p.dent_w)
            length += 0.5 * math.sqrt(math.pi) * p.dent_A * p.dent_w * far
        return length

    @numba.njit(cache=True)
    def radius(p: Truth, th: float) -> float:
        """The arm of the wire at drum angle th, m: the derivative of `wound`."""
        climbed = min(max((th - p.layer_th) / CLIMB_RAD, 0.0), 1.0)
        arm = p.R + p.layer_dR * climbed + p.ecc_e * math.sin(th + p.ecc_ph)
        return arm + p.dent_A * math.exp(-(((th - p.dent_th) / p.dent_w) ** 2)) if p.dent_A > 0.0 else arm

    @numba.njit(cache=True)
    def stiffness(p: Truth, x: float) -> float:
        """Of one fall, N/m."""
        return p.EA / (p.L - p.k_share * min(x, 0.95 * p.L))

    @numba.njit(cache=True)
    def _sagging(p: Truth, play: float) -> float:
        """The shaft's torque over its stiffness: nothing within the play, which a hanging load keeps on one flank."""
        half = 0.5 * p.play
        return play - half if play > half else (play + half if play < -half else 0.0)

    @numba.njit(cache=True)
    def simulate(p: Truth, reference: np.ndarray, current_noise: np.ndarray, encoder_noise: np.ndarray) -> np.ndarray:
        """The record of one run, a row each millisecond; the three inputs have a value each millisecond too.

        reference: motor speed, rad/s. current_noise: N m. encoder_noise: rad/s, of the drive's own speed signal.
        """
        n = len(reference)
        out = np.empty((n, COLUMNS))
        h, ratio = STEP_S, p.ratio
        settle = int(SETTLE_S / RECORD_S)
        m_hook = p.hook_share * p.m_p
        m = p.m_c + p.m_p - m_hook
        # Hanging still at the start height, the friction at the share that the last motion left.
        x = p.x_0
        w_line = p.rho * p.g * (p.L - x)
        z = p.z_0
        rest = p.z_0 * (_guide_level(p, p.z_0 > 0.0, x, 0.0, 0.0) if p.bristles > 0.5 else 0.0)
        pull = 0.5 * ((p.m_c + p.m_p) * p.g + rest)
        target = 2.0 * (x + pull / stiffness(p, x))
        low, high = -10.0, 4.0 * p.L / p.R
        for _ in range(60):
            middle = 0.5 * (low + high)
            if wound(p, middle) < target:
                low = middle
            else:
                high = middle
        th_d = 0.5 * (low + high)
        th_s = -0.5 * wound(p, th_d) / p.r
        shaft = radius(p, th_d) * (pull + w_line)
        th_m = ratio * (th_d + shaft / p.k_g + 0.5 * p.play)
        w_m = w_d = w_s = v = 0.0
        z_d = z_s = 0.0
        hook, v_hook = (m_hook * p.g / p.hook_k if m_hook > 0.0 else 0.0), 0.0
        torque = shaft / ratio
        integral = torque
        w_seen, still, since = 0.0, RELEASE_S, 0.0
        counted_before = p.count_rad * math.floor(th_m / p.count_rad)
        for j in range(-settle, n):
            i = max(j, 0)
            t = j * RECORD_S
            w_ref = reference[i] if j >= 0 else 0.0
            # The drive: filtered encoder, PI with a limit, torque lag, once a millisecond.
            counted = p.count_rad * math.floor(th_m / p.count_rad)
            seen = (counted - counted_before) / RECORD_S + encoder_noise[i]
            counted_before = counted
            w_seen += (RECORD_S / (p.seen_tau + RECORD_S)) * (seen - w_seen)
            error = w_ref - w_seen
            asked = p.kp * error + integral
            given = min(max(asked, -p.T_max), p.T_max)
            if given == asked:
                integral += p.ki * error * RECORD_S
            given += current_noise[i]
            if w_ref == 0.0:
                still += RECORD_S
            else:
                if still >= RELEASE_S:
                    since = 0.0
                still = 0.0
            since += RECORD_S
            grip = p.brk_T * math.exp(-since / p.brk_tau)
            if j >= 0:
                out[i, TORQUE] = torque
                out[i, SPEED] = w_m
                out[i, HEIGHT] = x
                out[i, DRUM] = th_d
                out[i, CARRIAGE_SPEED] = v
            tension_2 = friction = 0.0
            for _ in range(STEPS_PER_RECORD):
                torque += (h / p.lag_tau) * (given - torque)
                pulse = _pulse(p, t)
                g = p.g - p.heave_A * p.heave_w * p.heave_w * math.sin(p.heave_w * t + p.heave_ph)
                g -= p.swell_A * p.swell_w * p.swell_w * math.sin(p.swell_w * t + p.swell_ph)
                g += p.event_platform * pulse
                # Wire.
                arm = radius(p, th_d)
                k = stiffness(p, x)
                c = p.wire_tau * k
                d_1 = wound(p, th_d) + p.r * th_s - x
                d_2 = -p.r * th_s - x
                W_1 = max(k * d_1 + c * (arm * w_d + p.r * w_s - v), 0.0) if d_1 > 0.0 else 0.0
                W_2 = max(k * d_2 + c * (-p.r * w_s - v), 0.0) if d_2 > 0.0 else 0.0
                hanging = p.rho * g * (p.L - x)
                tension_2 = W_2 + hanging
                # Motor and gear.
                twist = th_m / ratio - th_d
                sag = _sagging(p, twist)
                shaft = p.k_g * sag + (p.c_g * (w_m / ratio - w_d) if sag != 0.0 else 0.0)
                turning = math.tanh(w_m / MOVING_RAD_S)
                drag = p.eta_loss * abs(shaft) / ratio * turning + grip * turning
                drag += p.motor_visc * w_m + p.fan_q * w_m * abs(w_m) + p.event_motor * pulse
                drag += p.event_brake * pulse * turning
                if p.tooth_T > 0.0:
                    near = (math.cos(th_d + p.tooth_ph) - 1.0) / (p.tooth_w * p.tooth_w)
                    drag += p.tooth_T * turning * math.exp(near)
                ripple = p.ripple_A * math.sin(p.ripple_n * th_m + p.ripple_ph)
                ripple += p.ripple2_A * math.sin(p.ripple2_n * th_m + p.ripple2_ph)
                ripple += p.ripple3_A * math.sin(p.ripple3_n * th_m + p.ripple3_ph)
                w_m += h / p.J_m * (torque + ripple - drag - shaft / ratio)
                # Drum.
                z_d = bend(z_d, w_d, p.pin_rad, 1.0, p.relax_s, h)
                pin = p.mu * abs(p.m_w * g + W_1 + hanging) * p.r_pw * _switch(p, z_d, w_d, p.pin_turn)
                w_d += h / p.J_w * (shaft - arm * (W_1 + hanging) - pin - ratio * p.event_drum * pulse)
                # Sheave: its wire damping is stiff, so that part is taken at the step's end.
                z_s = bend(z_s, w_s, p.pin_rad, 1.0, p.relax_s, h)
                pin_s = p.mu * abs(W_1 + W_2 - p.m_sh * g) * p.r_ps * _switch(p, z_s, w_s, p.pin_turn)
                pin_s += ratio * p.event_sheave * pulse * math.tanh(w_s / MOVING_RAD_S)
                pin_s += p.sheave_e * (W_1 + W_2) * math.sin(th_s + p.sheave_ph)
                damping = 2.0 * c * p.r * p.r
                w_s += h / (p.J_s + h * damping) * (p.r * (W_2 - W_1) - pin_s)
                # Carriage, and what hangs on it.
                z_before = z
                top = rise(v, p.peak, p.peak_m_s)
                z = bend(z, v, p.bristle_m, top, p.relax_s, h)
                s = _switch(p, z + (p.bristle_tau / h) * (z - z_before), v, p.turn_m_s)
                friction = (_guide_level(p, s > 0.0, x, v, t) + p.event_guide * pulse) * s
                if p.bristles < 0.5:
                    friction *= top
                friction += (p.B_up if v > 0.0 else p.B_dn) * v + p.drag_c * v * abs(v)
                on_hook = 0.0
                if m_hook > 0.0:
                    on_hook = p.hook_k * hook + p.hook_c * (v - v_hook)
                    v_hook += h * (on_hook / m_hook - g)
                v += h / m * (W_1 + W_2 - m * g - on_hook - friction - p.event_payload * pulse)
                th_m += h * w_m
                th_d += h * w_d
                th_s += h * w_s
                x += h * v
                hook += h * (v - v_hook)
                t += h
            if j >= 0:
                out[i, TENSION] = tension_2
                out[i, FRICTION] = friction
                out[i, SHAFT] = shaft
                out[i, DEAD] = d_2
        return out
