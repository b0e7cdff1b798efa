"""One campaign on disk: its machine built with all it hides, its runs simulated, logged and labelled."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from benchmarks.validation.content import Content
from benchmarks.validation.kind import Kind, RunPlan
from benchmarks.validation.sensors import Columns, Sensors, Window, sampled, shown_input
from workbench.blind.seal import Label
from workbench.identify.identify import identify
from workbench.logs import read_campaign
from workbench.machines import save_machine

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Built:
    """A true machine: what the kernel takes, and its sensors."""

    truth: Any
    sensors: Sensors


@dataclass(frozen=True)
class Simulated:
    """A run's record, (n, columns of the kernel), its speed reference, (n,), and when an event works in it."""

    plan: RunPlan
    truth: Any
    record: Array
    reference: Array
    window: Window | None


def built(content: Content, seeds: Sequence[int]) -> Built:
    """The true machine: nominal within its tolerances, with what its family has beside, then what ails it."""
    kind, rng = content.kind, np.random.default_rng([*seeds, 4])
    truth = kind.truth(content.drawn, content.family, rng)
    sensors = kind.sensors(rng, content.drawn, content.family, content.logging)
    own: dict[str, Any] = dict(content.sensors)
    sensors = replace(sensors, **own)
    for cause in content.causes:
        truth = kind.ailing(truth, cause)
        changed: dict[str, Any] = dict(cause.log)
        sensors = replace(sensors, **changed)
    return Built(truth, sensors)


def simulated(content: Content, machine: Built, number: int, seeds: Sequence[int]) -> Simulated:
    """Run `number` of the campaign. Its streams do not depend on what ails the machine."""
    kind, plan = content.kind, content.runs[number]
    of_run, of_causes = (np.random.default_rng([*seeds, k, number]) for k in (5, 6))
    speed, pulses = _excitation(content, plan, of_run)
    drawn = {name: of_causes.uniform(*span) for cause in content.causes for name, span in cause.per_run.items()}
    truth = kind.in_run(machine.truth, plan, of_run)._replace(**drawn)
    window = _window(content, number, speed)
    if window:
        truth = truth._replace(event_t=window.from_s, event_s=window.length_s)
    record = kind.move(of_run, content.drawn, truth, content.family, speed, pulses)
    return Simulated(plan, truth, record, speed, window)


def _excitation(content: Content, plan: RunPlan, rng: np.random.Generator) -> tuple[Array, Array]:
    """The recorded reference where the run has one, else one of its profile."""
    if plan.reference is None:
        return content.kind.excitation(rng, plan, content.drawn)
    speed = np.asarray(plan.reference, dtype=np.float64)
    return speed, np.zeros(len(speed))


def _window(content: Content, number: int, reference: Array) -> Window | None:
    """When the event of this run works: it begins while the reference moves."""
    for event in (cause.event for cause in content.causes if cause.event):
        if number == int(event.run * len(content.runs)):
            moving = np.flatnonzero(reference != 0.0)
            begins = float(moving[int(event.moment * len(moving))]) * content.kind.record_s
            return Window(begins, min(event.length_s, 0.1 * content.runs[number].duration_s))
    return None


def make_campaign(folder: Path, seed: int | Sequence[int], content: Content, machine: Built | None = None) -> Label:
    """Writes machine.yaml, runs.yaml and runs/*.csv under `folder`, whole or not at all; gives the label.

    machine: the true one; that of the seed when None.
    """
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    machine = built(content, seeds) if machine is None else machine
    part = folder.with_name(f".{folder.name}.part-{os.getpid()}")
    shutil.rmtree(part, ignore_errors=True)
    (part / "runs").mkdir(parents=True)
    save_nominal(content.machine, part / "machine.yaml")
    of_log, walk = (np.random.default_rng([*seeds, k]) for k in (7, 8))
    entries: list[dict[str, Any]] = []
    events: list[dict[str, Any]] = []
    wander = 0.0
    for number, plan in enumerate(content.runs):
        run = simulated(content, machine, number, seeds)
        columns, wander = log_columns(content, machine.sensors, run, of_log, walk, wander)
        file = f"runs/{plan.name}.csv"
        (part / file).write_text(csv_text(columns), encoding="utf-8")
        entries.append({"name": plan.name, "file": file, **content.kind.said(plan), "start_time_s": plan.start_time_s})
        if run.window:
            begins, ends = run.window.from_s, run.window.from_s + run.window.length_s
            place = next(cause.subsystem for cause in content.causes if cause.event)
            events.append({"run": plan.name, "from_s": rounded(begins), "to_s": rounded(ends), "subsystem": place})
    (part / "runs.yaml").write_text(yaml.safe_dump({"runs": entries}, sort_keys=False), encoding="utf-8")
    label = label_of(content, machine, seeds, tuple(events))
    os.replace(part, folder)
    return label


def log_columns(
    content: Content, sensors: Sensors, run: Simulated, rng: np.random.Generator, walk: np.random.Generator,
    wander: float,
) -> tuple[Columns, float]:  # fmt: skip
    """Columns of the run's log by signal name, each with its digits, and where the input's sensor has wandered to."""
    kind, logging = content.kind, content.logging
    samples, wander = sampled(
        run.record[:, kind.input], run.record[:, kind.speed], kind.motion(run.record), kind.record_s, sensors, rng,
        walk, rate_hz=logging.rate_hz, uneven=logging.uneven, wander=wander, window=run.window,
    )  # fmt: skip
    own = replace(logging, logs=(*logging.logs, *run.plan.logs))
    columns = kind.columns(samples, run.record, run.reference, sensors, rng, content.drawn, run.plan, own)
    return columns, wander


def save_nominal(machine: Any, path: Path) -> None:
    """machine.yaml as an engineer would have it: tolerances where they are stated; no drive, rail or sensor blocks,
    which nobody measured."""
    save_machine(machine, path)
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    gone = ["format", "drive", "rail", "sensors", "effects", "identified", "measured_correction"]
    gone += ["kind"] if data.get("kind") == "hoist" else []
    for key in gone:
        data.pop(key, None)
    if "kind" in data and not ("tolerances" in machine.model_fields_set and machine.tolerances.model_fields_set):
        data.pop("tolerances", None)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


def label_of(content: Content, machine: Built, seeds: Sequence[int], events: tuple[dict[str, Any], ...]) -> Label:
    causes = content.causes
    alike = () if "tension" in content.logging.logs else tuple(
        other for cause in causes for other in cause.alike if other != cause.name
    )  # fmt: skip
    return Label(
        effects=tuple(cause.name for cause in causes),
        events=events,
        values={name: rounded(value) for cause in causes for name, value in cause.values.items()},
        where=tuple({"subsystem": cause.subsystem, "regime": cause.regime} for cause in causes),
        alike=alike,
        signals="+".join(content.logging.logs),
        parameters={
            name: {key: rounded(value) for key, value in numbers.items()}
            for cause in causes
            for name, numbers in cause.library.items()
        },
        case=content.case,
        kind=content.kind.name,
        family=content.family.name,
        machine=content.machine.name,
        seed=tuple(seeds),
        truth={
            **{name: rounded(value) for name, value in machine.truth._asdict().items()},
            **{f"sensor_{name}": rounded(float(value)) for name, value in asdict(machine.sensors).items()},
            "rate_hz": content.logging.rate_hz,
        },
    )


def rounded(value: float) -> float:
    return float(f"{value:.7g}")


def csv_text(columns: Columns) -> str:
    header = ",".join(columns)
    texts = [np.char.mod(f"%.{digits}f", values) for values, digits in columns.values()]
    return header + "\n" + "\n".join(map(",".join, zip(*texts, strict=True))) + "\n"


BOX = 0.32  # two boxes of this over f lose 3 dB at f


@dataclass(frozen=True)
class Change:
    """rms_nm: of the input, noise apart, low-passed, while the reference moves, over all runs; N on a linear axis.
    by_second_nm: run -> its rms in each second, standing included."""

    rms_nm: float
    by_second_nm: dict[str, list[float]]


def input_change(content: Content, seed: int | Sequence[int]) -> Change:
    """With the causes less without them, all else alike: the same machine, runs and noise of the drive.

    A late speed is counted as the input's change over that delay, a speed that is shown too low as the torque of the
    inertia that its change would take. What a refit within the tolerances would take up
    is still in it; so is what the machine then does differently.
    """
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    well, kind = replace(content, causes=()), content.kind
    ill_machine, well_machine = built(content, seeds), built(well, seeds)
    width = max(1, round(BOX / kind.band_hz(content.logging.rate_hz) / kind.record_s))
    wander = 0.0
    walk = np.random.default_rng([*seeds, 8])
    pairs = []
    for number, plan in enumerate(content.runs):
        ill, sound = simulated(content, ill_machine, number, seeds), simulated(well, well_machine, number, seeds)
        shown, wander = _shown(kind, ill, ill_machine, walk, wander)
        pairs.append((plan.name, shown - _shown(kind, sound, well_machine, walk, 0.0)[0], ill.reference != 0.0))
    return change_of(pairs, width, kind.record_s)


def change_of(runs: Sequence[tuple[str, Array, npt.NDArray[np.bool_]]], width: int, step_s: float) -> Change:
    """runs: each one's name, what is shown more with the causes than without, and where it moves; a row each step.
    width: of the two boxes that smooth it, in steps."""
    squares, count = 0.0, 0
    by_second: dict[str, list[float]] = {}
    for name, difference, moving in runs:
        change = _smooth(difference, width)
        squares += float(np.sum(change[moving] ** 2))
        count += int(np.sum(moving))
        by_second[name] = _each_second(change, round(1.0 / step_s))
    return Change(float(f"{np.sqrt(squares / max(count, 1)):.4g}"), by_second)


def _shown(kind: Kind, run: Simulated, machine: Built, walk: np.random.Generator, wander: float) -> tuple[Array, float]:
    speed = run.record[:, kind.speed]
    shown, wander = shown_input(
        run.record[:, kind.input], speed, kind.record_s, machine.sensors, walk, wander, run.window
    )
    time = np.arange(len(shown), dtype=np.float64) * kind.record_s
    if run.window is not None and machine.sensors.slip:
        missed = machine.sensors.slip * run.window.pulse(time) * speed
        shown = shown + kind.inertia(run.truth) * np.gradient(missed, kind.record_s)
    return np.interp(time + machine.sensors.delay_s, time, shown), wander


def _smooth(values: Array, width: int) -> Array:
    box = np.full(width, 1.0 / width)
    padded = np.pad(values, width, mode="edge")
    out: Array = np.convolve(np.convolve(padded, box, "same"), box, "same")[width:-width]
    return out


def _each_second(values: Array, every: int) -> list[float]:
    whole = len(values) // every
    return [float(f"{rms:.3g}") for rms in np.sqrt(np.mean(values[: whole * every].reshape(whole, every) ** 2, axis=1))]


_PLAIN = 0x1D  # a stream of its own: the noise of the plain runs is not that of the campaign


def identify_first(folder: Path, seeds: Sequence[int], content: Content) -> None:
    """Replaces the nominal machine.yaml of the campaign in `folder` by the one that `workbench identify` makes of two
    runs of the same true machine without its causes. RuntimeError where the engine gives up.
    """
    plain = replace(content, causes=(), runs=plain_runs(content.runs))
    with tempfile.TemporaryDirectory(prefix="workbench-plain-") as temporary:
        campaign = Path(temporary) / "plain"
        make_campaign(campaign, (*seeds, _PLAIN), plain, built(plain, seeds))
        machine = identify(read_campaign(campaign)).machine
    save_machine(machine, folder / "machine.yaml")


def plain_runs(runs: Sequence[RunPlan]) -> tuple[RunPlan, ...]:
    """Those of the lightest and of the heaviest payload; the first two where all carry the same."""
    loads = [run.payload_kg for run in runs]
    if min(loads) == max(loads):
        return tuple(runs[:2])
    return runs[loads.index(min(loads))], runs[loads.index(max(loads))]
