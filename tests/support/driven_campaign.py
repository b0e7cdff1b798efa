"""A campaign of any kind of machine, made by driving it along planned motions: no drive, no simulator of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.core.run import Array, Run
from workbench.effects import of
from workbench.machines import Axis, Hoist, kind_of, save_machine
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.driven import InverseSimulation

RATE_HZ = 500.0


def planned(machine: Hoist | Axis, name: str, way: float, speed: float, rate_hz: float = RATE_HZ) -> Run:
    """To and fro three times over `way` (m or rad) at `speed`, with rests, as an encoder shows it; no input yet."""
    plant = kind_of(machine).plant
    steps = [step for by in (way, -way, way / 2, -way, way / 2) for step in (Step(by_m=by), Step(dwell_s=0.3))]
    limits = Limits(speed, 8.0 * speed, 200.0 * speed)
    plan = plan_motion("ruckig", steps, 0.0, limits, (-2.0 * way, 2.0 * way), 0.5, 0.5)
    profile = plan.sample(1.0 / rate_hz)
    signals: dict[str, Array] = {
        plant.input: np.zeros(len(profile.time_s)),
        plant.positions[0]: profile.position_m,
        plant.speeds[0]: profile.speed_m_s,
    }
    return Run(name, profile.time_s, signals)


def driven(machine: Hoist | Axis, runs: Sequence[Run], noise: Mapping[str, float], seed: int = 1) -> list[Run]:
    """The runs with the input that they take on the machine, its effects at work, and white noise on each signal."""
    rng = np.random.default_rng(seed)
    bench = InverseSimulation(machine, runs, active=of(machine))
    driven_runs = []
    for run, (taken, _) in zip(runs, bench.predict([bench.base])[0], strict=True):
        signals = {**run.signals, bench.plant.input: taken}
        noisy = {name: value + noise.get(name, 0.0) * rng.normal(size=len(value)) for name, value in signals.items()}
        driven_runs.append(replace(run, signals=noisy))
    return driven_runs


def write(folder: Path, nominal: Hoist | Axis, runs: Sequence[Run]) -> Path:
    """The campaign's folder: machine.yaml, runs.yaml, a CSV file for each run."""
    (folder / "runs").mkdir(parents=True)
    save_machine(nominal, folder / "machine.yaml")
    lines = ["runs:"]
    for run in runs:
        names = ["time_s", *run.signals]
        columns = np.column_stack([run.time_s, *run.signals.values()])
        file = folder / "runs" / f"{run.name}.csv"
        np.savetxt(file, columns, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
        lines.append(f"- {{name: {run.name}, file: runs/{run.name}.csv}}")
    (folder / "runs.yaml").write_text("\n".join(lines) + "\n")
    return folder
