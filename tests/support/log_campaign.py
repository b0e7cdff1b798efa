"""Makes small campaign folders for the tests of the log reader."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from workbench.machines import default_hoist, machine_text

Array = npt.NDArray[np.float64]
AXIS = """\
kind: axis
motion: linear
mass_kg: 95.1089
gravity: {constant_n: 0.0}
friction: {coulomb_forward_n: 20.39, coulomb_backward_n: 20.39, viscous_n_s_per_m: 203.5}
"""
RUNS = "runs:\n- {name: lift, file: runs/lift.csv, payload_kg: 4500.0, start_position_m: 9.0, start_time_s: 0.0}\n"


def hoist_columns(samples: int = 500, step_s: float = 0.01) -> dict[str, Array]:
    """A lift and a lowering of the default machine, with sensor noise, rounded as a logger does."""
    noise = np.random.default_rng(7)
    time = np.arange(samples) * step_s
    speed = 60.0 * np.sin(2 * np.pi * time / time[-1])
    torque = 297.0 + 0.15 * np.gradient(speed, time) + 20.0 * np.sign(speed)
    return {
        "time_s": time.round(6),
        "torque_motor1_nm": (torque + noise.normal(scale=3.0, size=samples)).round(1),
        "torque_motor2_nm": (torque + noise.normal(scale=3.0, size=samples)).round(1),
        "speed_motor_rad_s": (speed + noise.normal(scale=0.03, size=samples)).round(2),
        "speed_reference_rad_s": speed.round(3),
    }


def axis_columns(samples: int = 500, step_s: float = 0.002) -> dict[str, Array]:
    noise = np.random.default_rng(8)
    time = np.arange(samples) * step_s
    position = 0.1 * np.sin(2 * np.pi * time)
    return {
        "time_s": time.round(6),
        "force_n": 200.0 * np.cos(2 * np.pi * time) + noise.normal(scale=2.0, size=samples),
        "position_m": position,
        "position_reference_m": position,
    }


def csv_text(columns: Mapping[str, Array]) -> str:
    rows = [",".join(columns)]
    for values in zip(*columns.values(), strict=True):
        rows.append(",".join("" if np.isnan(value) else repr(float(value)) for value in values))
    return "\n".join(rows) + "\n"


@cache
def _default_machine() -> str:
    """Made once: tests write a thousand campaigns."""
    return machine_text(default_hoist())


def write_campaign(
    folder: Path, columns: Mapping[str, Array] | str, *, runs: str = RUNS, machine: str | None = None
) -> Path:
    """A campaign of one CSV run, `lift`, of the default hoist unless a machine's text is given."""
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    (folder / "machine.yaml").write_text(_default_machine() if machine is None else machine)
    (folder / "runs.yaml").write_text(runs)
    text = columns if isinstance(columns, str) else csv_text(columns)
    (folder / "runs" / "lift.csv").write_text(text, encoding="utf-8")
    return folder
