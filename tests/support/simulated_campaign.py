"""Makes campaigns of runs that the project's own closed loop simulated, with noise as sensors have it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.support.log_campaign import csv_text
from workbench.control import PiSettings
from workbench.machines import Hoist, default_hoist, save_machine, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop

# What the nominal machine does not know: the levels, within three tolerances of the nominal 6000 and 4500 N.
TRUTH = {"guide.coulomb_hoisting_n": 7200.0, "guide.coulomb_lowering_n": 5400.0}
TORQUE_NOISE_NM, SPEED_NOISE_RAD_S, TENSION_NOISE_N = 2.0, 0.03, 200.0
PAYLOADS = {"empty": 0.0, "half": 4500.0, "full": 9000.0}


def true_machine(values: Mapping[str, float] = TRUTH) -> Hoist:
    return with_values(default_hoist(), values)


def simulated_campaign(
    folder: Path, truth: Hoist | None = None, seed: int = 3, reference: bool = False, tension: bool = False
) -> Path:
    """Three runs of 16 s at 100 Hz, one a payload, of the machine `truth`; machine.yaml is the nominal one.

    reference, tension: whether the speed reference, the dead line's tension is logged."""
    machine = true_machine() if truth is None else truth
    noise = np.random.default_rng(seed)
    limits = Limits(speed_m_s=0.5, acceleration_m_s2=0.5, jerk_m_s3=2.0)
    steps = [Step(by_m=1.5), Step(dwell_s=1.0), Step(by_m=-2.0), Step(by_m=0.5)]
    plan = plan_motion("ruckig", steps, 9.0, limits, (0.0, 25.0), lead_s=1.0)
    speed = motor_speed_rad_s(plan.sample(0.001, 16.0).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
    cases = [LoopCase(name, machine, payload, 9.0, settings, speed) for name, payload in PAYLOADS.items()]
    (folder / "runs").mkdir(parents=True)
    save_machine(default_hoist(), folder / "machine.yaml")
    entries: list[str] = []
    for result in simulate_loop(cases, record_every=10):
        run = result.run
        n = len(run.time_s)
        columns = {
            "time_s": run.time_s.round(6),
            "torque_motor1_nm": run["torque_motor1_nm"] + noise.normal(scale=TORQUE_NOISE_NM, size=n),
            "torque_motor2_nm": run["torque_motor2_nm"] + noise.normal(scale=TORQUE_NOISE_NM, size=n),
            "speed_motor_rad_s": run["speed_motor_rad_s"] + noise.normal(scale=SPEED_NOISE_RAD_S, size=n),
        }
        if reference:
            columns["speed_reference_rad_s"] = np.interp(run.time_s, 0.001 * np.arange(len(speed)), speed)
        if tension:
            columns["tension_dead_line_n"] = run["tension_dead_line_n"] + noise.normal(scale=TENSION_NOISE_N, size=n)
        (folder / "runs" / f"{run.name}.csv").write_text(csv_text(columns), encoding="utf-8")
        entries.append(
            f"- {{name: {run.name}, file: runs/{run.name}.csv, payload_kg: {run.payload_kg}, "
            f"start_position_m: 9.0, start_time_s: {40.0 * len(entries)}}}\n"
        )
    (folder / "runs.yaml").write_text("runs:\n" + "".join(entries), encoding="utf-8")
    return folder
