"""Campaigns whose truth is the multi-body machine, under a rig's own drive, logged and labelled like the others.

python -m benchmarks.campaigns_multibody --out DIR --count N --seed S [--kind ...] [--machines ...] [--processes 2]
"""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
import yaml

from benchmarks.campaigns.campaign import (
    CURRENT_NOISE,
    ENCODER_NOISE_RAD_S,
    Label,
    built,
    csv_text,
    label_of,
    rounded,
    save_nominal,
)
from benchmarks.campaigns.content import KINDS, MACHINES, Content, RunPlan, draw, travel_m
from benchmarks.campaigns.kernel import COLUMNS, HEIGHT, RECORD_S, SPEED, TENSION, TORQUE
from benchmarks.campaigns.listed import USUAL
from benchmarks.campaigns.many import orders
from benchmarks.campaigns.profiles import reference
from benchmarks.campaigns.sensors import log_columns
from benchmarks.campaigns.truth import Truth
from workbench.machine import Hoist, with_values
from workbench.multibody import Driven, Outcome, Shaft, Switches, hang, move, sampled

Array = npt.NDArray[np.float64]
STEP_S = 0.005  # of the engine and of the drive: motor speed converged to 1e-5 of nominal, see docs/multibody.md
KEPT_EVERY = 1
RELEASE_S = 0.2  # a rest of the reference as long as this sets the brake
# Of the unlisted causes those that this machine, or a sensor, has.
UNLISTED = (
    "fan",
    "rail_step",
    "quadratic_drag",
    "roller",
    "gain_by_direction",
    "torque_walk",
    "dead_band",
    "torque_bend",
)


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


def simulate_runs(
    machine: Hoist, plan: Sequence[RunPlan], switches: Switches | Sequence[Switches], seed: int | Sequence[int],
    *, drive: Drive, duration_s: float, nominal: Hoist | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Every run of a plan, as name, `reference` and `record`: (n, COLUMNS), a row each millisecond as of the kernel.

    machine: the true one, its sensors.payload_scale is true over stated payload. switches: of all runs or of each.
    nominal: whose speeds and travel set the references. RuntimeError where the engine gives up, with its state.
    """
    nominal, seeds = nominal or machine, [seed] if isinstance(seed, int) else list(seed)
    of_each = [switches] * len(plan) if isinstance(switches, Switches) else list(switches)
    out = []
    for number, (run, own) in enumerate(zip(plan, of_each, strict=True)):
        rng = np.random.default_rng([*seeds, 5, number])
        speed = reference(
            run.profile,
            rng,
            duration_s=duration_s,
            speed_rad_s=nominal.motor.nominal_speed_rad_s,
            room_rad=travel_m(nominal, duration_s) / nominal.lift_m_per_rad,
        )
        steps = round(duration_s / STEP_S)
        at = np.minimum(np.round(np.arange(steps) * STEP_S / RECORD_S).astype(int), len(speed) - 1)
        current = rng.normal(scale=CURRENT_NOISE * drive.limit_nm * math.sqrt(RECORD_S / STEP_S), size=steps)
        encoder = rng.normal(scale=ENCODER_NOISE_RAD_S * math.sqrt(RECORD_S / STEP_S), size=steps)
        result = move(
            machine,
            run.payload_kg,
            run.start_position_m,
            drive.on(speed[at], current, encoder),
            steps * STEP_S,
            name=run.name,
            step_s=STEP_S,
            record_every=KEPT_EVERY,
            start_time_s=run.start_time_s,
            switches=own,
            reactions_every=0,
        )
        if result.outcome is not Outcome.COMPLETED:
            raise RuntimeError(f"run {run.name}: {result.outcome.value} {result.at}")
        out.append(
            {"name": run.name, "reference": speed, "record": _record(result.run, len(speed)), "cpu_s": result.cpu_s}
        )
    return out


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


def from_truth(
    nominal: Hoist, p: Truth, full_kg: float, payload_scale: float, rng: np.random.Generator
) -> tuple[Hoist, Switches, Drive]:
    """The multi-body machine with the numbers of a `Truth`, its arm drawn; load-dependent friction comes from rollers.

    Friction in proportion to the rollers' forces takes a_load of the full payload's weight more with it than without.
    The Coulomb levels include what the empty machine's rollers give, as whoever measured them found.
    """
    wire, count = nominal.wire, nominal.motor.count
    arm = drawn_arm(nominal, rng)
    base = with_values(nominal, arm)
    empty, full = (sum(abs(N) for N in hang(base, m, 9.0).normal_n.values()) for m in (0.0, full_kg))
    mu = rng.uniform(0.0, 0.001) + p.a_load * full_kg * p.g / (full - empty)
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
            "sensors.payload_scale": payload_scale,
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
        hose_kg_per_m=p.rho - 7850.0 * wire.effective_area_m2,
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
    )
    drive = Drive(p.kp, p.ki, p.T_max, p.lag_tau, p.seen_tau, p.count_rad, p.brk_T, p.brk_tau)
    return machine, switches, drive


def make_campaign(folder: Path, seeds: Sequence[int], content: Content) -> Label:
    """Writes machine.yaml, runs.yaml and runs/*.csv under `folder`, whole or not at all; gives the label."""
    truth = built(content, seeds)
    machine, switches, drive = from_truth(
        content.machine, truth.truth, content.full_kg, truth.payload_scale, np.random.default_rng([*seeds, 9])
    )
    each = []
    for number in range(len(content.runs)):
        of_causes = np.random.default_rng([*seeds, 6, number])
        drawn = {name: of_causes.uniform(*span) for cause in content.causes for name, span in cause.per_run.items()}
        if set(drawn) - {"heave_ph"}:
            raise ValueError(f"the multi-body machine has no {sorted(drawn)}")
        each.append(replace(switches, heave_rad=drawn.get("heave_ph", 0.0)))
    runs = simulate_runs(
        machine, content.runs, each, seeds, drive=drive, duration_s=content.duration_s, nominal=content.machine
    )
    part = folder.with_name(f".{folder.name}.part-{os.getpid()}")
    shutil.rmtree(part, ignore_errors=True)
    (part / "runs").mkdir(parents=True)
    save_nominal(content, part / "machine.yaml")
    _without_arm(part / "machine.yaml")
    of_log, walk = (np.random.default_rng([*seeds, k]) for k in (7, 8))
    entries: list[dict[str, Any]] = []
    wander = 0.0
    for plan, run in zip(content.runs, runs, strict=True):
        columns, wander = log_columns(
            run["record"],
            run["reference"],
            truth.sensors,
            of_log,
            walk,
            rate_hz=content.rate_hz,
            wander_nm=wander,
            full=content.full_signals,
            sum_only=content.sum_only,
            with_reference=content.with_reference,
        )
        file = f"runs/{plan.name}.csv"
        (part / file).write_text(csv_text(columns), encoding="utf-8")
        said = {"payload_kg": plan.payload_kg, "start_position_m": plan.start_position_m}
        entries.append({"name": plan.name, "file": file, **said, "start_time_s": plan.start_time_s})
    (part / "runs.yaml").write_text(yaml.safe_dump({"runs": entries}, sort_keys=False), encoding="utf-8")
    label = label_of(content, truth, seeds)
    own = {name: rounded(float(value)) for name, value in vars(switches).items()}
    arm = {
        name.removeprefix("arm."): rounded(float(v))
        for name, v in drawn_arm(content.machine, np.random.default_rng([*seeds, 9])).items()
    }
    os.replace(part, folder)
    return replace(label, truth={**label.truth, **{f"multibody_{k}": v for k, v in (own | arm).items()}})


def _without_arm(path: Path) -> None:
    """The engineer who wrote machine.yaml drew no arm."""
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    data.pop("arm", None)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


@dataclass(frozen=True)
class Order:
    out: Path
    number: int
    seeds: tuple[int, int]
    kind: str
    names: tuple[str, ...]
    machines: str


def make(order: Order) -> str:
    """Makes one campaign unless its folder and label are there; says what it did."""
    name = f"{order.number:03d}"
    folder, label_file = order.out / name, order.out / "labels" / f"{name}.json"
    if folder.exists() and label_file.exists():
        return f"{name} is there"
    shutil.rmtree(folder, ignore_errors=True)
    label_file.parent.mkdir(parents=True, exist_ok=True)
    content = draw(order.seeds, order.kind, names=order.names, machines=order.machines)
    try:
        label = make_campaign(folder, order.seeds, content)
    except RuntimeError as error:
        return f"{name} not made: {error}"
    label_file.write_text(label.text(), encoding="utf-8")
    return f"{name} {order.kind}: {', '.join(label.effects) or 'no gap'}"


def all_orders(out: Path, count: int, seed: int, kind: str, machines: str) -> list[Order]:
    """As of the other simulator; unlisted causes that this machine does not have give way to some that it has."""
    wanted, spare = [], 0
    for order in orders(out, count, seed, kind, machines):
        names = order.names
        if order.kind == "unknown" and names[0] not in UNLISTED:
            names = (UNLISTED[spare % len(UNLISTED)],)
            spare += 1
        wanted.append(Order(out, order.number, (seed, order.number), order.kind, names, machines))
    assert all(name in USUAL or name in UNLISTED for order in wanted for name in order.names)
    return wanted


@click.command(help="Make campaigns of multi-body hoists whose truth is known; what is in DIR already stays.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--count", type=click.IntRange(min=1), required=True)
@click.option("--seed", type=int, required=True)
@click.option("--kind", type=click.Choice([*KINDS, "mixed"]), default="mixed", show_default=True)
@click.option("--machines", type=click.Choice(MACHINES), default="mixed", show_default=True)
@click.option("--processes", type=click.IntRange(1, 8), default=2, show_default=True)
def main(out: Path, count: int, seed: int, kind: str, machines: str, processes: int) -> None:
    wanted = all_orders(out, count, seed, kind, machines)
    if processes == 1:
        for order in wanted:
            print(make(order), flush=True)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for said in pool.imap_unordered(make, wanted):
            print(said, flush=True)


if __name__ == "__main__":
    main()
