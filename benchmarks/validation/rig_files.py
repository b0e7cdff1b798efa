"""A rig read from its owner's files: machine.yaml, and a plan of runs or a campaign that was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, StringConstraints

from benchmarks.validation.axis_causes import LISTED as ON_AXES
from benchmarks.validation.axis_causes import OF_A_LOAD, OF_NO_LOAD
from benchmarks.validation.axis_machines import KINDS as AXIS_PROFILES
from benchmarks.validation.axis_machines import Drawn as DrawnAxis
from benchmarks.validation.axis_machines import excitation
from benchmarks.validation.axis_motion import RECORD_S as AXIS_S
from benchmarks.validation.hoist_causes import USUAL
from benchmarks.validation.hoist_machines import KINDS as HOIST_PROFILES
from benchmarks.validation.hoist_machines import Drawn as DrawnHoist
from benchmarks.validation.hoist_machines import reference
from benchmarks.validation.hoist_motion import RECORD_S as HOIST_S
from benchmarks.validation.kind import Logging, RunPlan
from benchmarks.validation.rig import Rig
from workbench.core.errors import InputError, nearest
from workbench.core.record import Finite, NotNegative, Positive, Record
from workbench.core.run import Array, Run
from workbench.core.yaml_strict import load, validate
from workbench.effects import check
from workbench.logs import Campaign, read_campaign
from workbench.machines import Hoist, kind_of, load_machine

BETWEEN_S = 60.0  # from a planned run to the next one
QUIET = 0.2  # s over which a measured speed is averaged where it stands in for a reference
AT_REST = 0.003  # of the top speed: below it such a speed is at rest
SEED = 20  # of planned references: the same plan gives the same motions
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f/\\]+$")]


class PlannedRun(Record):
    """profile: as the simulators drive; top_speed: of the reference, motor rad/s, m/s or rad/s of an axis."""

    name: Name
    profile: str
    duration_s: Annotated[float, Field(ge=5.0, le=1200.0, allow_inf_nan=False)] = 50.0
    payload_kg: NotNegative = 0.0
    start_position_m: Finite | None = None
    top_speed: Positive | None = None


class Plan(Record):
    """The whole of plan.yaml. noise: one standard deviation a sample; of the input: of each motor's torque."""

    format: Literal[1] = 1
    rate_hz: Annotated[float, Field(ge=10.0, le=5000.0, allow_inf_nan=False)] = 100.0
    input_noise: NotNegative | None = None
    speed_noise: NotNegative | None = None
    signals: tuple[Literal["reference", "position", "speed", "tension"], ...] = ("reference",)
    travel: Positive | None = None
    runs: Annotated[list[PlannedRun], Field(min_length=1, max_length=100)]


PLAYED = ("hoist", "axis-linear", "axis-rotary")  # kinds of machine that a source plays


def rig_of(machine_file: Path | None, runs: Path | None) -> Rig:
    """machine_file: None for the machine of the campaign `runs`; runs: a campaign or a plan.yaml.

    InputError for what does not fit together.
    """
    if runs is None:
        raise InputError("needs runs beside it: a plan.yaml, or a campaign of this machine", place="machine")
    machine = None if machine_file is None else _plain(load_machine(machine_file, check_effects=check), machine_file)
    if runs.is_dir() or runs.name == "runs.yaml":
        campaign = read_campaign(runs)
        nominal = _plain(campaign.machine, runs) if machine is None else machine
        if type(nominal) is not type(campaign.machine):
            raise InputError("is another kind of machine than the campaign's", file=machine_file)
        return _of_campaign(nominal, campaign)
    if machine is None:
        raise InputError("a plan of runs needs a machine beside it", file=runs)
    return _of_plan(machine, runs)


def _plain(machine: Any, file: Path) -> Any:
    """The nominal machine. InputError where it holds effects already, or is of a kind that no source plays."""
    if machine.effects or machine.measured_correction is not None:
        raise InputError("holds effects already; name the nominal machine, whose effects will be withheld", file=file)
    if kind_of(machine).name not in PLAYED:
        raise InputError("is of a kind that no source plays, expected a hoist or an axis", file=file)
    return machine


# A recorded campaign.


def _of_campaign(machine: Any, campaign: Campaign) -> Rig:
    runs = campaign.runs
    rate = round(1.0 / float(np.median([run.sample_time_s for run in runs])), 3)
    if kind_of(machine).payload:
        return _hoist(
            machine,
            [(run, _recorded(run, "speed_reference_rad_s", "speed_motor_rad_s", HOIST_S)) for run in runs],
            Logging(min(rate, 1.0 / HOIST_S), _hoist_logs(machine, runs)),
            {
                "input_noise": _noise_of(runs, ("torque_motor1_nm",), ("torque_motor_nm", 2.0**-0.5)),
                "speed_noise": _noise_of(runs, ("speed_motor_rad_s",)),
                "encoder": False,
                "jitter_s": 0.0,
            },
        )
    return _axis_of_campaign(machine, runs, rate)


def _hoist_logs(machine: Hoist, runs: Sequence[Run]) -> tuple[str, ...]:
    names = {"reference": "speed_reference_rad_s", "position": "position_carriage_m", "tension": "tension_dead_line_n"}
    logs = [name for name, signal in names.items() if all(signal in run for run in runs)]
    split = machine.motor.count == 2 and all("torque_motor2_nm" in run for run in runs)
    return (*logs, *(() if split else ("sum",)))


def _recorded(run: Run, wanted: str, measured: str, step_s: float) -> Array:
    """The reference of a run, a value each step_s; of its measured speed, smoothed, where none is logged."""
    t = np.arange(round(run.duration_s / step_s) + 1) * step_s + float(run.time_s[0])
    if wanted in run:
        return np.interp(t, run.time_s, run[wanted])
    return _smoothed(np.interp(t, run.time_s, run[measured]), step_s)


def _smoothed(speed: Array, step_s: float) -> Array:
    """A measured speed as a reference: averaged, at rest where it hardly moves."""
    width = max(1, round(QUIET / step_s))
    smooth = np.convolve(np.pad(speed, width, mode="edge"), np.full(width, 1.0 / width), "same")[width:-width]
    top = float(np.max(np.abs(smooth), initial=0.0))
    return np.asarray(np.where(np.abs(smooth) < AT_REST * top, 0.0, smooth))


def _noise_of(runs: Sequence[Run], first: tuple[str], other: tuple[str, float] = ("", 1.0)) -> float:
    """One standard deviation a sample, from second differences (see `simulate.lowpass.noise_rms`); median of runs."""
    name, factor = (first[0], 1.0) if first[0] in runs[0] else other
    sigma = [1.4826 * float(np.median(np.abs(np.diff(run[name], 2)))) / 6.0**0.5 for run in runs if name in run]
    return factor * float(np.median(sigma)) if sigma else 0.0


def _hoist(
    machine: Hoist, runs: Sequence[tuple[Run, Array]], logging: Logging, sensors: dict[str, Any], effects: Any = USUAL
) -> Rig:
    plans = tuple(
        RunPlan(
            run.name,
            "recorded",
            run.payload_kg,
            run.start_position_m,
            run.start_time_s,
            (len(speed) - 1) * HOIST_S,
            _tuple(speed),
        )
        for run, speed in runs
    )
    for plan in plans:
        way = np.cumsum(plan.reference or ()) * HOIST_S * machine.lift_m_per_rad
        low, high = plan.start + float(np.min(way)), plan.start + float(np.max(way))
        if low < machine.rail.lowest_position_m or high > machine.highest_position_m:
            raise InputError(
                f"goes from {low:.2f} to {high:.2f} m; the rail reaches from {machine.rail.lowest_position_m:g} to "
                f"{machine.highest_position_m:g} m",
                place=f"run {plan.name}",
            )
    full = max(plan.payload_kg for plan in plans) or 1.0
    return Rig("hoist", DrawnHoist(machine, full), plans, logging, sensors, tuple(effects), "N m")


def _tuple(values: Array) -> tuple[float, ...]:
    return tuple(float(f"{value:.6g}") for value in values)


def _axis_of_campaign(machine: Any, runs: Sequence[Run], rate: float) -> Rig:
    linear = machine.input_signal == "force_n"
    x_, v_, u_ = ("position_m", "velocity_m_s", "force_n") if linear else ("angle_rad", "speed_rad_s", "torque_nm")
    r_ = "position_reference_m" if linear else "angle_reference_rad"
    ways, references = [], []
    for run in runs:
        t = np.arange(round(run.duration_s / AXIS_S) + 1) * AXIS_S + float(run.time_s[0])
        if x_ in run:
            ways.append(run[x_])
        else:
            ways.append(np.concatenate([[0.0], np.cumsum(run[v_][:-1] * np.diff(run.time_s))]))
        wanted = run[r_] if r_ in run else ways[-1]
        speed = _smoothed(np.gradient(np.interp(t, run.time_s, wanted), AXIS_S), AXIS_S)
        references.append(speed if r_ in run or v_ not in run else _recorded(run, "", v_, AXIS_S))
    low, high = min(float(np.min(way)) for way in ways), max(float(np.max(way)) for way in ways)
    top = max(float(np.max(np.abs(speed))) for speed in references)
    if not (top > 0.0 and high > low):
        raise InputError("the axis stands still in every run", place="runs")
    steepest = max(float(np.max(np.abs(np.gradient(speed, AXIS_S)))) for speed in references)
    steps = np.concatenate([np.abs(np.diff(way)) for way in ways])
    drawn = DrawnAxis(
        machine, low, high - low, top, top / steepest, max(float(np.max(np.abs(run[u_]))) for run in runs), 12.0,
        float(np.min(steps[steps > 1e-9 * (high - low)], initial=1e-5 * (high - low))),
    )  # fmt: skip
    plans = tuple(
        RunPlan(
            run.name, "recorded", 0.0, float(way[0]), run.start_time_s, (len(speed) - 1) * AXIS_S, _tuple(speed)
        )
        for run, way, speed in zip(runs, ways, references, strict=True)
    )  # fmt: skip
    logs = {"position": x_, "speed": v_, "reference": r_}
    kept = tuple(name for name, signal in logs.items() if all(signal in run for run in runs))
    sensors = {"input_noise": _noise_of(runs, (u_,)), "encoder": False, "jitter_s": 0.0, "count": drawn.count}
    if v_ in runs[0]:
        sensors["speed_noise"] = _noise_of(runs, (v_,))
    return Rig("axis", drawn, plans, Logging(min(rate, 1.0 / AXIS_S), kept), sensors, _on(drawn), _unit(linear))


def _on(drawn: DrawnAxis) -> tuple[str, ...]:
    gone = OF_NO_LOAD if drawn.loaded else OF_A_LOAD
    return tuple(name for name in ON_AXES if name not in gone)


def _unit(linear: bool) -> str:
    return "N" if linear else "N m"


# A plan.


def _of_plan(machine: Any, file: Path) -> Rig:
    document = load(file)
    plan = validate(Plan, document)
    profiles = HOIST_PROFILES if kind_of(machine).payload else AXIS_PROFILES
    seen: set[str] = set()
    for k, run in enumerate(plan.runs):
        if run.profile not in profiles:
            problem = f"unknown profile '{run.profile}'; {nearest(run.profile, profiles)}"
            raise InputError(problem, file=file, line=document.line(("runs", k, "profile")), place=f"runs.{k}.profile")
        if run.name in seen:
            raise InputError(f"run '{run.name}' is there twice", file=file, line=document.line(("runs", k, "name")))
        seen.add(run.name)
    sensors: dict[str, Any] = {"encoder": False, "jitter_s": 0.0}
    given = {"input_noise": plan.input_noise, "speed_noise": plan.speed_noise}
    sensors |= {name: value for name, value in given.items() if value is not None}
    try:
        return _hoist_plan(machine, plan, sensors) if kind_of(machine).payload else _axis_plan(machine, plan, sensors)
    except InputError as error:
        raise InputError(error.problem, file=file, place=error.place) from error


def _hoist_plan(machine: Hoist, plan: Plan, sensors: dict[str, Any]) -> Rig:
    runs = []
    clock = 0.0
    for k, run in enumerate(plan.runs):
        start = 0.36 * machine.wire.segment_length_m if run.start_position_m is None else run.start_position_m
        top = run.top_speed or machine.motor.nominal_speed_rad_s
        room = 0.24 * machine.wire.segment_length_m / machine.lift_m_per_rad
        rng = np.random.default_rng([SEED, k])
        speed = reference(run.profile, rng, duration_s=run.duration_s, speed_rad_s=top, room_rad=room)
        runs.append((Run(run.name, np.zeros(0), {}, run.payload_kg, start, clock), speed))
        clock += run.duration_s + BETWEEN_S
    logs = tuple(name for name in plan.signals if name != "speed")
    split = () if machine.motor.count == 2 else ("sum",)
    return _hoist(machine, runs, Logging(min(plan.rate_hz, 1.0 / HOIST_S), (*logs, *split)), sensors)


def _axis_plan(machine: Any, plan: Plan, sensors: dict[str, Any]) -> Rig:
    top = max((run.top_speed or 0.0 for run in plan.runs), default=0.0)
    if plan.travel is None or not top:
        raise InputError("the plan of an axis needs travel (m or rad) and top_speed of a run", place="travel")
    ramp = min(0.2, 0.35 * plan.travel / top)
    role = machine.role
    load = abs(role("gravity_constant")) + abs(role("gravity_sine"))
    force = (
        role("inertia") * top / ramp
        + max(role("coulomb_forward"), role("coulomb_backward"))
        + role("viscous") * top
        + load
    )
    low = min((run.start_position_m or 0.0 for run in plan.runs), default=0.0)
    drawn = DrawnAxis(machine, low, plan.travel, top, ramp, float(force), 12.0, 1e-6 * plan.travel)
    plans, clock = [], 0.0
    for k, run in enumerate(plan.runs):
        excited = excitation(run.profile, np.random.default_rng([SEED, k]), drawn, run.duration_s)
        speed = excited.speed * ((run.top_speed or top) / top)
        start = low if run.start_position_m is None else run.start_position_m
        plans.append(RunPlan(run.name, run.profile, 0.0, start, clock, run.duration_s, _tuple(speed)))
        clock += run.duration_s + BETWEEN_S
    logs = tuple(dict.fromkeys(["position", *(name for name in plan.signals if name != "tension")]))
    rate = min(plan.rate_hz, 1.0 / AXIS_S)
    linear = machine.input_signal == "force_n"
    return Rig("axis", drawn, tuple(plans), Logging(rate, logs), sensors, _on(drawn), _unit(linear))
