"""Campaigns whose truth is the multi-body machine, under a rig's own drive, logged and labelled like the others."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.validation.campaign import built, rounded
from benchmarks.validation.content import Content
from benchmarks.validation.families import Family
from benchmarks.validation.hoist import CURRENT_NOISE, ENCODER_NOISE_RAD_S, HOIST
from benchmarks.validation.hoist_machines import Drawn
from benchmarks.validation.hoist_motion import COLUMNS, HEIGHT, RECORD_S, SPEED, TENSION, TORQUE, WIRE_KG_M3, Truth
from benchmarks.validation.kind import Kind
from benchmarks.validation.sources import Source
from workbench.machines import Hoist, with_values
from workbench.machines.multibody import Driven, Outcome, Shaft, Switches, engine, hang, move

Array = npt.NDArray[np.float64]
STEP_S = 0.005  # of the engine and of the drive: motor speed converged to 1e-5 of nominal, see docs/multibody.md
RELEASE_S = 0.2  # a rest of the reference as long as this sets the brake
USUAL = ("hoist_practice", "hoist_double", "hoist_small", "hoist_middle", "hoist_large")
# Of the unlisted causes those that this machine, or a sensor, has.
UNLISTED = (
    "fan", "rail_step", "quadratic_drag", "roller", "gain_by_direction", "torque_walk", "dead_band", "torque_bend",
)  # fmt: skip


def sampled(driven: Driven, sample_time_s: float) -> Driven:
    """A drive that is asked at its own sample times only and holds its torque between them."""
    taken, given = -1, (0.0, 0.0)

    def held(shaft: Shaft, until_s: float) -> tuple[float, float]:
        nonlocal taken, given
        sample = math.floor(shaft.time_s / sample_time_s + 1e-6)
        if sample > taken:
            taken, given = sample, driven(shaft, until_s)
        return given

    return held


@dataclass(frozen=True)
class Drive:
    """A rig's own speed drive, sampled each step: PI with a limit, torque lag, filtered and counted encoder.

    brake_nm, brake_s: of a brake that lets go late at each start. Gains are of all motors together.
    """

    kp: float
    ki: float
    limit_nm: float
    lag_s: float
    filter_s: float
    count_rad: float
    brake_nm: float = 0.0
    brake_s: float = 1.0

    def on(self, speed_reference: Array, current: Array, encoder: Array) -> Any:
        """What `move` asks for: the drive from the torque that holds. Arrays have a value each step."""

        def start(hold_nm: float) -> Driven:
            integral = torque = hold_nm
            seen = 0.0
            counted: float | None = None
            still, since, k = RELEASE_S, 0.0, 0
            left = math.exp(-STEP_S / self.lag_s)

            def driven(shaft: Shaft, until_s: float) -> tuple[float, float]:
                nonlocal integral, torque, seen, counted, still, since, k
                wanted = float(speed_reference[k])
                count = self.count_rad * math.floor(shaft.angle_rad / self.count_rad)
                speed = (count - (count if counted is None else counted)) / STEP_S + float(encoder[k])
                counted = count
                seen += STEP_S / (self.filter_s + STEP_S) * (speed - seen)
                error = wanted - seen
                asked = self.kp * error + integral
                given = min(max(asked, -self.limit_nm), self.limit_nm)
                if given == asked:
                    integral += self.ki * error * STEP_S
                given += float(current[k])
                torque = given + left * (torque - given)
                if wanted == 0.0:
                    still += STEP_S
                else:
                    since = 0.0 if still >= RELEASE_S else since
                    still = 0.0
                since += STEP_S
                k += 1
                return torque, self.brake_nm * math.exp(-since / self.brake_s) if self.brake_nm else 0.0

            return sampled(driven, STEP_S)

        return start


def simulate_run(
    machine: Hoist,
    switches: Switches,
    drive: Drive,
    truth: Truth,
    payload_kg: float,
    speed: Array,
    noise: tuple[Array, Array],
) -> Array:
    """One run, (n, COLUMNS), a row each millisecond as of the other simulator's kernel.

    machine: the true one; payload_kg: the true one; speed: its reference, a value each millisecond; noise: of the
    drive's torque and speed, at its samples. RuntimeError where the engine gives up, with its state.
    """
    steps = len(noise[0])
    at = np.minimum(np.round(np.arange(steps) * STEP_S / RECORD_S).astype(int), len(speed) - 1)
    result = move(
        machine,
        payload_kg,
        truth.x_0,
        drive.on(speed[at], *noise),
        steps * STEP_S,
        step_s=STEP_S,
        record_every=1,
        start_time_s=truth.start_time_s,
        switches=switches,
        reactions_every=0,
    )
    if result.outcome is not Outcome.COMPLETED:
        raise RuntimeError(f"{result.outcome.value} {result.at}")
    return _record(result.run, len(speed))


def moved(rng: np.random.Generator, drawn: Drawn, truth: Truth, family: Family, speed: Array, pulses: Array) -> Array:
    """What `Kind.move` is of the other simulator; a run asked for again, as for its size, is not computed again."""
    steps = round(len(speed) * RECORD_S / STEP_S)
    scale = 0.0 if family.logger.quiet else math.sqrt(RECORD_S / STEP_S)
    current = rng.normal(scale=scale * CURRENT_NOISE * truth.T_max, size=steps)
    encoder = rng.normal(scale=scale * ENCODER_NOISE_RAD_S, size=steps)
    machine, switches, drive = from_truth(drawn, truth)
    return _moved(
        machine.model_dump_json(), switches, drive, truth, speed.tobytes(), current.tobytes(), encoder.tobytes()
    )


@lru_cache(maxsize=12)
def _moved(
    machine: str, switches: Switches, drive: Drive, truth: Truth, speed: bytes, current: bytes, encoder: bytes
) -> Array:
    noise = (np.frombuffer(current), np.frombuffer(encoder))
    hoist = Hoist.model_validate_json(machine)
    return simulate_run(hoist, switches, drive, truth, truth.m_p, np.frombuffer(speed), noise)


MULTIBODY: Kind = replace(HOIST, unlisted=UNLISTED, events=(), move=moved)


class MultibodyContent(Content):
    """A hoist's content, moved by the other machine."""

    @property
    def kind(self) -> Kind:
        return MULTIBODY


def _record(run: Any, n: int) -> Array:
    time = np.arange(n) * RECORD_S
    out = np.zeros((n, COLUMNS))
    names = {TORQUE: "torque_motor_nm", SPEED: "speed_motor_rad_s", HEIGHT: "position_carriage_m"}
    for column, name in (names | {TENSION: "tension_dead_line_n"}).items():
        out[:, column] = np.interp(time, run.time_s, run[name])
    return out


def drawn_arm(machine: Hoist, rng: np.random.Generator) -> dict[str, float]:
    """Lengths and stiffnesses of an arm that no log says anything about, under machine.yaml's names."""
    size = machine.carriage.mass_kg / 8000.0
    return {
        "arm.reach_m": rng.uniform(1.2, 3.1),
        "arm.pivot_offset_m": rng.uniform(0.35, 0.6),
        "arm.pipe_offset_m": rng.uniform(0.3, 0.7),
        "arm.roller_spacing_m": rng.uniform(0.9, 1.3),
        "arm.sheave_offset_m": rng.uniform(0.1, 0.35),
        "arm.cylinder_offset_m": rng.uniform(0.1, 0.3),
        "arm.roller_stiffness_n_per_m": 1e8 * size * rng.uniform(0.4, 2.0),
        "arm.cylinder_stiffness_n_per_m": 3e7 * size * rng.uniform(0.3, 1.5),
        "arm.switches.roller_clearance_m": rng.uniform(1e-4, 8e-4) * (rng.random() < 0.5),
    }


def arm_of(drawn: Drawn, p: Truth) -> tuple[dict[str, float], float]:
    """The arm of one machine, and a trace of roller friction; a stream of its own, which no cause changes."""
    numbers = struct.pack("4d", p.kp, p.ki, p.mu, p.EA)
    rng = np.random.default_rng(np.frombuffer(numbers, dtype=np.uint32))
    return drawn_arm(drawn.machine, rng), float(rng.uniform(0.0, 0.001))


def from_truth(drawn: Drawn, p: Truth) -> tuple[Hoist, Switches, Drive]:
    """The multi-body machine with the numbers of a `Truth`, its arm drawn; load-dependent friction comes from rollers.

    Friction in proportion to the rollers' forces takes a_load of the full payload's weight more with it than without.
    The Coulomb levels include what the empty machine's rollers give, as whoever measured them found.
    """
    nominal, full_kg = drawn.machine, drawn.full_kg
    wire, count = nominal.wire, nominal.motor.count
    arm, trace = arm_of(drawn, p)
    base = with_values(nominal, arm)
    empty, full = (sum(abs(N) for N in hang(base, m, 9.0).normal_n.values()) for m in (0.0, full_kg))
    mu = trace + p.a_load * full_kg * p.g / (full - empty)
    slope = nominal.guide.atan_slope_s_per_m if p.bristles > 0.5 else 1.5 / p.turn_m_s
    machine = with_values(
        base,
        {
            "motor.rotor_inertia_kg_m2": p.J_m / count,
            "carriage.mass_kg": p.m_c,
            "bearing.pin_friction_coefficient": p.mu,
            "wire.youngs_modulus_pa": p.EA / wire.effective_area_m2,
            "wire.damping_time_s": p.wire_tau,
            "guide.coulomb_hoisting_n": max(p.F_up - mu * empty, 0.05 * p.F_up),
            "guide.coulomb_lowering_n": max(p.F_dn - mu * empty, 0.05 * p.F_dn),
            "guide.atan_slope_s_per_m": slope,
        },
    )
    switches = Switches(
        roller_friction=mu,
        clearance_m=arm["arm.switches.roller_clearance_m"],
        bristle_m=p.bristle_m if p.bristles > 0.5 else 0.0,
        viscous_up=p.B_up,
        viscous_down=p.B_dn,
        level_up_n=p.dF_up,
        level_down_n=p.dF_dn,
        peak_up_n=p.Fs_up,
        peak_down_n=p.Fs_dn,
        stribeck_m_s=p.v_str,
        bell_n=p.bump_A,
        bell_m=p.bump_x,
        bell_width_m=p.bump_w,
        rail_step_n=p.step_A,
        rail_step_m=p.step_x,
        flat_n=p.roller_A,
        flat_period_m=p.roller_d,
        flat_rad=p.roller_ph,
        drag_n_s2_per_m2=p.drag_c,
        drift=p.drift_a,
        drift_s=p.drift_tau,
        follows_length=p.k_share,
        wire_inertia=True,
        hose_kg_per_m=p.rho - WIRE_KG_M3 * wire.effective_area_m2,
        layer_m=p.layer_dR,
        layer_rad=p.layer_th,
        eccentricity_m=p.ecc_e,
        eccentricity_rad=p.ecc_ph,
        gear_loss=p.eta_loss,
        ripple_nm=p.ripple_A,
        ripple_order=p.ripple_n,
        ripple_rad=p.ripple_ph,
        ripple2_nm=p.ripple2_A,
        ripple2_order=p.ripple2_n,
        ripple2_rad=p.ripple2_ph,
        motor_viscous=p.motor_visc,
        fan_nm_s2=p.fan_q,
        heave_m=p.heave_A,
        heave_rad_s=p.heave_w,
        heave_rad=p.heave_ph,
    )
    drive = Drive(p.kp, p.ki, p.T_max, p.lag_tau, p.seen_tau, p.count_rad, p.brk_T, p.brk_tau)
    return machine, switches, drive


def more_truth(content: Content, seeds: Sequence[int]) -> dict[str, float]:
    """The arm and the switches, for the label."""
    arm, trace = arm_of(content.drawn, built(content, seeds).truth)
    return {f"multibody_{name}": rounded(float(value)) for name, value in {**arm, "trace": trace}.items()}


SOURCE = Source(
    "multibody", USUAL, lambda family: MULTIBODY, lambda content: MultibodyContent(**vars(content)), more_truth, engine
)
