"""One campaign of an axis on disk: its machine built with all it hides, its runs simulated, logged and labelled."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from benchmarks.campaigns.axis.content import Content, RunPlan
from benchmarks.campaigns.axis.kernel import RECORD_S, simulate
from benchmarks.campaigns.axis.profiles import excitation
from benchmarks.campaigns.axis.sensors import Sensors, log_columns
from benchmarks.campaigns.axis.truth import Truth, coupled, true_truth
from benchmarks.campaigns.campaign import Label, csv_text, rounded
from benchmarks.campaigns.listed import about
from workbench.machine import save_machine

Array = npt.NDArray[np.float64]
CURRENT_NOISE = 2e-3  # of the largest force, each step of the drive


@dataclass(frozen=True)
class Built:
    """A true axis: what the kernel takes, and its sensors."""

    truth: Truth
    sensors: Sensors


def built(content: Content, seeds: Sequence[int]) -> Built:
    """The true axis: nominal within its tolerances, then what ails it."""
    rng, axis = np.random.default_rng([*seeds, 14]), content.axis
    truth, machine = true_truth(axis, rng), axis.machine
    sensors = Sensors(
        force_noise=axis.force * about(rng, 0.003, 0.015),
        speed_noise=axis.speed * about(rng, 1e-4, 6e-4),
        count=axis.count,
        speed_turn=0.005 * axis.speed,
        late_s=rng.uniform(0.0, 0.5) / content.rate_hz,
        gain=1.0 + machine.role("gain_tolerance") * rng.normal(),
        offset=machine.offset_tolerance(axis.force) * rng.normal(),
    )
    beyond = rng.uniform(0.3, 0.7)
    for cause in content.causes:
        put = dict(cause.truth)
        share = 1.0 + put.pop("inertia_fraction", 0.0)
        if "play" in put and truth.M_l <= 0.0:  # play lies between two sides
            truth = coupled(truth, beyond, 150.0, 0.05, put["on_motor"])
        truth = truth._replace(M_m=share * truth.M_m, M_l=share * truth.M_l)._replace(**put)
        sensors = replace(sensors, **dict(cause.log))
    return Built(truth, sensors)


@dataclass(frozen=True)
class Simulated:
    """A run's record, (n, COLUMNS) of the kernel, and its speed reference, a row each RECORD_S."""

    plan: RunPlan
    truth: Truth
    record: Array
    reference: Array


def simulated(content: Content, machine: Built, number: int, seeds: Sequence[int]) -> Simulated:
    """Run `number` of the campaign. Its streams do not depend on what ails the machine."""
    plan = content.runs[number]
    of_run, of_causes = (np.random.default_rng([*seeds, k, number]) for k in (15, 16))
    given = excitation(plan.profile, of_run, content.axis, plan.duration_s)
    drawn = {name: of_causes.uniform(*span) for cause in content.causes for name, span in cause.per_run.items()}
    truth = machine.truth._replace(x_0=plan.start, start_time_s=plan.start_time_s, **drawn)
    noise = of_run.normal(scale=CURRENT_NOISE * content.axis.force, size=len(given.speed))
    return Simulated(plan, truth, simulate(truth, given.speed, given.pulses, noise), given.speed)


def make_campaign(folder: Path, seed: int | Sequence[int], content: Content) -> Label:
    """Writes machine.yaml, runs.yaml and runs/*.csv under `folder`, whole or not at all; gives the label."""
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    machine = built(content, seeds)
    part = folder.with_name(f".{folder.name}.part-{os.getpid()}")
    shutil.rmtree(part, ignore_errors=True)
    (part / "runs").mkdir(parents=True)
    save_nominal(content, part / "machine.yaml")
    of_log, walk = (np.random.default_rng([*seeds, k]) for k in (17, 18))
    entries: list[dict[str, Any]] = []
    wander = 0.0
    for number, plan in enumerate(content.runs):
        run = simulated(content, machine, number, seeds)
        columns, wander = log_columns(
            run.record,
            plan.start + np.cumsum(run.reference) * RECORD_S,
            machine.sensors,
            of_log,
            walk,
            linear=content.axis.linear,
            rate_hz=content.rate_hz,
            logs=content.logs,
            irregular=content.irregular,
            wander=wander,
        )
        file = f"runs/{plan.name}.csv"
        (part / file).write_text(csv_text(columns), encoding="utf-8")
        entries.append({"name": plan.name, "file": file, "start_time_s": plan.start_time_s})
    (part / "runs.yaml").write_text(yaml.safe_dump({"runs": entries}, sort_keys=False), encoding="utf-8")
    os.replace(part, folder)
    return label_of(content, machine, seeds)


def save_nominal(content: Content, path: Path) -> None:
    """machine.yaml as an engineer would have it; tolerances only where they are stated."""
    machine = content.axis.machine
    save_machine(machine, path)
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    for key in ("format", "sensors", "effects", "identified", "measured_correction"):
        data.pop(key, None)
    if "tolerances" not in machine.model_fields_set or not machine.tolerances.model_fields_set:
        data.pop("tolerances", None)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


def label_of(content: Content, machine: Built, seeds: Sequence[int]) -> Label:
    causes = content.causes
    return Label(
        effects=tuple(cause.name for cause in causes),
        events=(),
        values={name: rounded(value) for cause in causes for name, value in cause.values.items()},
        where=tuple({"subsystem": cause.subsystem, "regime": cause.regime} for cause in causes),
        alike=tuple(other for cause in causes for other in cause.alike),
        signals="+".join(content.logs),
        parameters={
            name: {key: rounded(value) for key, value in numbers.items()}
            for cause in causes
            for name, numbers in cause.library.items()
        },
        kind=content.kind,
        machine=f"{content.axis.machine.motion} {content.axis.machine.name}",
        seed=tuple(seeds),
        truth={
            **{name: rounded(value) for name, value in machine.truth._asdict().items()},
            **{f"sensor_{name}": rounded(value) for name, value in asdict(machine.sensors).items()},
            "rate_hz": content.rate_hz,
        },
    )
