"""One campaign on disk: its machine built with all it hides, its runs simulated, logged and labelled."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from benchmarks.campaigns.content import Content, RunPlan, travel_m
from benchmarks.campaigns.kernel import simulate
from benchmarks.campaigns.profiles import reference
from benchmarks.campaigns.sensors import Sensors, log_columns
from benchmarks.campaigns.truth import Truth, true_truth
from workbench.machine import save_machine

Array = npt.NDArray[np.float64]
CURRENT_NOISE = 1.6e-4  # of the largest torque, each millisecond
ENCODER_NOISE_RAD_S = 0.01  # of the drive's own speed signal


@dataclass(frozen=True)
class Label:
    """What a campaign holds: keys of the practice labels first, then the truth under the workbench's names."""

    effects: tuple[str, ...]
    events: tuple[str, ...]
    values: dict[str, float]
    where: tuple[dict[str, str], ...]
    alike: tuple[str, ...]
    signals: str
    parameters: dict[str, dict[str, float]]
    kind: str
    machine: str
    seed: tuple[int, ...]
    truth: dict[str, float]
    torque_change_rms_nm: float = 0.0
    torque_change_by_second_nm: dict[str, list[float]] = field(default_factory=dict)

    def text(self) -> str:
        return json.dumps(asdict(self), indent=1) + "\n"


@dataclass(frozen=True)
class Built:
    """A true machine: what the kernel takes, its sensors, and true over stated payload."""

    truth: Truth
    sensors: Sensors
    payload_scale: float


def built(content: Content, seeds: Sequence[int]) -> Built:
    """The true machine: nominal within its tolerances, then what ails it."""
    rng, tol, motor = np.random.default_rng([*seeds, 4]), content.machine.tolerances, content.machine.motor
    truth = true_truth(content.machine, rng)
    sensors = Sensors(
        gain=1.0 + tol.torque_gain * rng.normal(),
        offset_nm=tol.torque_offset_nm * rng.normal(),
        # Both practice machines, of 250 and 480 N m, show the same.
        torque_noise_nm=1.95 * min(1.0, motor.nominal_torque_nm / 250.0) * max(1.0, motor.nominal_torque_nm / 500.0),
    )
    scale = 1.0 + tol.payload * rng.normal()
    for cause in content.causes:
        put = dict(cause.truth)
        scale = put.pop("mp_scale", scale)
        truth = truth._replace(
            J_m=truth.J_m + put.pop("Jg", 0.0),
            m_c=truth.m_c + put.pop("dm_c", 0.0),
            rho=truth.rho + put.pop("rho_extra", 0.0),
        )
        truth = truth._replace(**put)
        sensors = replace(sensors, **dict(cause.log))
    return Built(truth, sensors, scale)


@dataclass(frozen=True)
class Simulated:
    """A run's record, (n, COLUMNS) of the kernel, and its speed reference, a row each millisecond."""

    plan: RunPlan
    truth: Truth
    record: Array
    reference: Array


def simulated(content: Content, machine: Built, number: int, seeds: Sequence[int]) -> Simulated:
    """Run `number` of the campaign. Its streams do not depend on what ails the machine."""
    plan, nominal = content.runs[number], content.machine
    of_run, of_causes = (np.random.default_rng([*seeds, k, number]) for k in (5, 6))
    speed = reference(
        plan.profile,
        of_run,
        duration_s=content.duration_s,
        speed_rad_s=nominal.motor.nominal_speed_rad_s,
        room_rad=travel_m(nominal, content.duration_s) / nominal.lift_m_per_rad,
    )
    # The last motion left some of the friction in the bristles; most operators let it go before they log.
    left = of_run.uniform(-0.8, 0.8) * (of_run.random() < 0.3)
    truth = machine.truth._replace(
        m_p=machine.payload_scale * plan.payload_kg,
        x_0=plan.start_position_m,
        start_time_s=plan.start_time_s,
        z_0=left * machine.truth.bristles,
        **{name: of_causes.uniform(*span) for cause in content.causes for name, span in cause.per_run.items()},
    )
    current = of_run.normal(scale=CURRENT_NOISE * truth.T_max, size=len(speed))
    encoder = of_run.normal(scale=ENCODER_NOISE_RAD_S, size=len(speed))
    return Simulated(plan, truth, simulate(truth, speed, current, encoder), speed)


def make_campaign(folder: Path, seed: int | Sequence[int], content: Content) -> Label:
    """Writes machine.yaml, runs.yaml and runs/*.csv under `folder`, whole or not at all; gives the label."""
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    machine = built(content, seeds)
    part = folder.with_name(f".{folder.name}.part-{os.getpid()}")
    shutil.rmtree(part, ignore_errors=True)
    (part / "runs").mkdir(parents=True)
    save_nominal(content, part / "machine.yaml")
    of_log, walk = (np.random.default_rng([*seeds, k]) for k in (7, 8))
    entries: list[dict[str, Any]] = []
    wander = 0.0
    for number, plan in enumerate(content.runs):
        run = simulated(content, machine, number, seeds)
        columns, wander = log_columns(
            run.record,
            run.reference,
            machine.sensors,
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
    label = label_of(content, machine, seeds)
    os.replace(part, folder)
    return label


def save_nominal(content: Content, path: Path) -> None:
    """machine.yaml as an engineer would have it: no drive, rail or sensor blocks, which nobody measured."""
    save_machine(content.machine, path)
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    for key in ("format", "kind", "drive", "rail", "sensors"):
        data.pop(key, None)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


def label_of(content: Content, machine: Built, seeds: Sequence[int]) -> Label:
    causes = content.causes
    alike = () if content.full_signals else tuple(a for c in causes for a in c.alike if a not in {c.name})
    return Label(
        effects=tuple(cause.name for cause in causes),
        events=(),
        values={name: rounded(value) for cause in causes for name, value in cause.values.items()},
        where=tuple({"subsystem": cause.subsystem, "regime": cause.regime} for cause in causes),
        alike=alike,
        signals="full" if content.full_signals else "basic",
        parameters={
            name: {key: rounded(value) for key, value in numbers.items()}
            for cause in causes
            for name, numbers in cause.library.items()
        },
        kind=content.kind,
        machine=content.machine.name,
        seed=tuple(seeds),
        truth={
            **{name: rounded(value) for name, value in machine.truth._asdict().items()},
            **{f"sensor_{name}": value for name, value in asdict(machine.sensors).items()},
            "payload_scale": machine.payload_scale,
        },
    )


def rounded(value: float) -> float:
    return float(f"{value:.7g}")


def csv_text(columns: dict[str, tuple[Array, int]]) -> str:
    header = ",".join(columns)
    texts = [np.char.mod(f"%.{digits}f", values) for values, digits in columns.values()]
    return header + "\n" + "\n".join(map(",".join, zip(*texts, strict=True))) + "\n"
