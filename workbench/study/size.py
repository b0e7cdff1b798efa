"""Sizing of a hoist's drive: what a duty cycle asks of motor, inverter, brake, resistor, gearbox and wire, and the
smallest drive of a catalogue that gives it.

Every candidate (motor, count, gear ratio) runs the scenario's moves in the same closed loop as a study, with the
torque limit lifted, so that what is asked is not hidden by what is given; where the limit is kept both are the same.
Gains are the scenario's, scaled by the inertia at the motor shaft. The equations are in docs/sizing.md.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field

from workbench.control import Events
from workbench.core.errors import InputError, nearest
from workbench.core.input_file import read_input
from workbench.core.record import Force, NotNegative, Positive, Record
from workbench.core.run import Array, Run
from workbench.core.shown import Brief
from workbench.core.yaml_strict import load, validate
from workbench.machines import Hoist, kind_of, load_of, of_kind, with_values
from workbench.study.grid import RunSpec
from workbench.study.load import Study, load_study
from workbench.study.rows import Row
from workbench.study.run import run_specs

CATALOGUE = Path(__file__).with_name("motors.csv")
# Nominal ratios of gear units as makers list them: preferred numbers R20 of ISO 3.
RATIOS = (
    5.6, 6.3, 7.1, 8.0, 9.0, 10.0, 11.2, 12.5, 14.0, 16.0, 18.0, 20.0, 22.4, 25.0, 28.0, 31.5, 35.5, 40.0, 45.0, 50.0,
    56.0, 63.0, 71.0, 80.0, 90.0, 100.0,
)  # fmt: skip
LIFTED = 100.0  # times nominal torque: no limit
PULL_OUT = 1.3  # breakdown torque over the largest torque that a drive may ask of a motor
AT_ONCE = 64  # runs whose signals are held together
# A rotor's inertia where the maker states none: that of the Sg180L-4, scaled by torque as lengths are, J ~ T^(5/3).
KNOWN_J, KNOWN_NM = 0.155, 143.41
Fraction = Annotated[float, Field(gt=0.0, le=1.0, strict=True, allow_inf_nan=False)]
Factor = Annotated[float, Field(ge=1.0, le=100.0, strict=True, allow_inf_nan=False)]


class Loaded(Record):
    """A payload and its share of all cycles."""

    payload_kg: NotNegative
    share: Fraction


class MotorBlock(Record):
    """A motor that stands in no catalogue. What is missing is reckoned as for a catalogue's blanks."""

    name: str = "own motor"
    frame: str = ""
    poles: Annotated[int, Field(ge=2, le=24, strict=True)] = 4
    power_kw: Positive
    speed_rpm: Positive
    current_a: Positive | None = None
    power_factor: Fraction | None = None
    breakdown_ratio: Factor | None = None
    inertia_kg_m2: Positive | None = None
    source: str = ""

    @property
    def speed_rad_s(self) -> float:
        return self.speed_rpm * math.pi / 30.0

    @property
    def torque_nm(self) -> float:
        return 1000.0 * self.power_kw / self.speed_rad_s

    @property
    def inertia(self) -> float:
        return self.inertia_kg_m2 or KNOWN_J * (self.torque_nm / KNOWN_NM) ** (5.0 / 3.0)

    @property
    def estimated(self) -> tuple[str, ...]:
        """What the maker does not state."""
        fields = {"inertia": self.inertia_kg_m2, "current": self.current_a, "breakdown torque": self.breakdown_ratio}
        return tuple(name for name, value in fields.items() if value is None)


class Thermal(Record):
    """S1 torque over speed of a motor with its own fan: standstill_share of nominal torque at rest, rising to all of it
    at full_from of nominal speed; above nominal speed nominal power. forced: a fan of its own keeps it at 1."""

    standstill_share: Fraction = 0.6
    full_from: Fraction = 0.5
    forced: bool = False


class Inverter(Record):
    """One inverter a motor. rated_current_a: continuous; overload times that for overload_time_s out of every
    overload_period_s. power_factor, efficiency: of motors that state none."""

    rated_current_a: Positive | None = None
    overload: Factor = 1.5
    overload_time_s: Positive = 60.0
    overload_period_s: Positive = 600.0
    voltage_v: Positive = 400.0
    power_factor: Fraction = 0.86
    efficiency: Fraction = 0.93


class Brake(Record):
    """torque_nm: of one motor's brake. hold_s: at rest the motors hold before the brake has set and after it has been
    released. delay_s: from torque off (STO) until it acts. safety: its torque over the heaviest load's. work_j: what it
    bears in one emergency stop."""

    torque_nm: Force | None = None
    hold_s: NotNegative = 0.3
    delay_s: NotNegative = 0.15
    safety: Factor = 2.0
    work_j: Positive | None = None


class Emergency(Record):
    """deceleration_m_s2: of the ramp that the drive stops with. overspeed: largest speed after STO, over nominal."""

    deceleration_m_s2: Positive = 1.0
    overspeed: Factor = 1.2


class Resistor(Record):
    """peak_kw, continuous_kw: what it bears. efficiency: of motor and inverter, between shaft and resistor."""

    peak_kw: Positive | None = None
    continuous_kw: Positive | None = None
    efficiency: Fraction = 0.9


class GearboxBlock(Record):
    """rated_torque_nm: at the drum. service_factor: that over the thermally equivalent torque; peak: largest torque
    over the rated one. efficiency: of the gear unit, where the machine's own friction does not hold it."""

    rated_torque_nm: Force | None = None
    service_factor: Factor = 1.4
    peak: Factor = 2.0
    efficiency: Fraction = 1.0


class WireBlock(Record):
    """breaking_load_n: the machine's when missing. bends_per_cycle over drum and sheaves; bends_to_discard: of its
    maker."""

    breaking_load_n: Force | None = None
    safety_factor: Factor = 4.5
    bends_per_cycle: Annotated[int, Field(ge=1, le=1000, strict=True)] = 6
    bends_to_discard: Positive | None = None


class SizeFile(Record):
    """A file of `workbench size`. scenario: moves, limits, machine and controller, beside the file. reference: one of
    the scenario's, its first when missing. payloads: their shares add up to 1; the scenario's, alike, when missing.
    rest_s: at rest with the brake set, after each cycle. motors: `catalogue`, `machine`, or a CSV file with its
    columns, beside this one. motor: one more. count, ratios: to choose from; the machine's when missing, `all` the R20
    series.
    """

    format: Literal[1] = 1
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    scenario: Annotated[str, Field(min_length=1)]
    reference: str | None = None
    payloads: tuple[Loaded, ...] = ()
    rest_s: NotNegative = 0.0
    motors: Annotated[str, Field(min_length=1)] = "catalogue"
    motor: MotorBlock | None = None
    count: tuple[Annotated[int, Field(ge=1, le=16, strict=True)], ...] = ()
    ratios: tuple[Positive, ...] | Literal["all"] = ()
    thermal: Thermal = Thermal()
    inverter: Inverter = Inverter()
    brake: Brake = Brake()
    emergency: Emergency = Emergency()
    resistor: Resistor = Resistor()
    gearbox: GearboxBlock = GearboxBlock()
    wire: WireBlock = WireBlock()


@dataclass(frozen=True)
class Check:
    """What is asked and what is given, None where that is not known: then the figure is a demand and breaks nothing.

    at_least: the figure has to reach its bound, as a safety factor.
    """

    name: str
    asked: float
    given: float | None
    unit: str
    at_least: bool = False

    @property
    def used(self) -> float:
        """Asked over given, 0 where nothing is known; above 1 the drive does not pass."""
        if self.given is None or not self.given:
            return 0.0
        return self.given / max(self.asked, 1e-12) if self.at_least else self.asked / self.given

    @property
    def ok(self) -> bool:
        return self.used <= 1.0


@dataclass(frozen=True)
class Candidate:
    """A drive with its checks, of one that is too small without a run that one check. reason: why its runs failed."""

    motor: MotorBlock
    count: int
    ratio: float
    checks: tuple[Check, ...] = ()
    reason: str = ""

    @property
    def ran(self) -> bool:
        return len(self.checks) > 1

    @property
    def passes(self) -> bool:
        return not self.reason and all(check.ok for check in self.checks)

    @property
    def limiting(self) -> Check | None:
        """The check that is used most."""
        return max(self.checks, key=lambda check: check.used, default=None)

    @property
    def power_kw(self) -> float:
        return self.count * self.motor.power_kw


@dataclass(frozen=True, repr=False)
class Sizing(Brief):
    """candidates: by installed power, of each motor and count the ratio that is used least first."""

    file: SizeFile
    study: Study
    candidates: tuple[Candidate, ...]

    @cached_property
    def taken(self) -> Candidate | None:
        """The smallest that passes: of the least installed power the one whose most used check is used least."""
        passing = [candidate for candidate in self.candidates if candidate.passes]
        return min(passing, key=lambda c: (c.power_kw, c.limiting.used if c.limiting else 0.0), default=None)

    @cached_property
    def smaller(self) -> tuple[Candidate, ...]:
        """Of each motor and count of less power its best ratio, the largest first."""
        most = math.inf if self.taken is None else self.taken.power_kw
        best: dict[tuple[str, int], Candidate] = {}
        for candidate in self.candidates:
            if candidate.power_kw < most:
                best.setdefault((candidate.motor.name, candidate.count), candidate)
        return tuple(sorted(best.values(), key=lambda candidate: -candidate.power_kw))


def size(path: str | os.PathLike[str]) -> Sizing:
    """The drives that a file lets choose from, each with its checks.

    InputError with file and place for what cannot be read, a machine that is no hoist, and shares that do not add up.
    """
    file = Path(path)
    document = load(file)
    asked = validate(SizeFile, document)
    study = load_study(file.parent / asked.scenario)
    if not kind_of(study.machine).payload:
        raise InputError(f"{of_kind(study.machine)}; expected a hoist", file=file, place="scenario")
    if asked.payloads and abs(sum(one.share for one in asked.payloads) - 1.0) > 1e-6:
        raise InputError("the shares do not add up to 1", file=file, line=document.line(("payloads",)),
                         place="payloads")  # fmt: skip
    if asked.reference not in (None, *study.scenario.kinds):
        hint = nearest(str(asked.reference), study.scenario.kinds)
        raise InputError(f"'{asked.reference}' is no reference of the scenario; {hint}", file=file, place="reference")
    motors = _motors(asked, file.parent, cast(Hoist, study.machine))
    return sized(asked, study, motors)


def sized(asked: SizeFile, study: Study, motors: Sequence[MotorBlock]) -> Sizing:
    """All motors, counts and ratios, checked."""
    machine = cast(Hoist, study.machine)
    counts = asked.count or (machine.motor.count,)
    ratios = RATIOS if asked.ratios == "all" else asked.ratios or (machine.gearbox.ratio,)
    drives = [Candidate(motor, count, ratio) for motor in motors for count in counts for ratio in ratios]
    done: list[Candidate] = []
    waiting: list[tuple[Candidate, list[RunSpec]]] = []
    for drive in drives:
        if (check := _too_small(drive, asked, study)) is not None:
            done.append(replace(drive, checks=(check,)))
            continue
        waiting.append((drive, _specs(drive, asked, study)))
    size_of = len(waiting[0][1]) if waiting else 1
    for start in range(0, len(waiting), max(1, AT_ONCE // size_of)):
        some = waiting[start : start + max(1, AT_ONCE // size_of)]
        results = run_specs([spec for _, specs in some for spec in specs])
        for k, (drive, specs) in enumerate(some):
            own = results[k * size_of : (k + 1) * size_of]
            failed = next((row.reason for row, _ in own if not row.ok), None)
            checks = () if failed is not None else tuple(_checks(drive, asked, study, specs, own))
            done.append(replace(drive, checks=checks, reason=failed or ""))
    done.sort(key=lambda c: (c.power_kw, not c.ran, c.limiting.used if c.limiting else math.inf))
    return Sizing(asked, study, tuple(done))


def _motors(asked: SizeFile, folder: Path, machine: Hoist) -> list[MotorBlock]:
    own = machine.motor
    if asked.motors == "machine":
        rpm = own.nominal_speed_rad_s * 30.0 / math.pi
        power = own.nominal_torque_nm * own.nominal_speed_rad_s / 1000.0
        inertia = own.rotor_inertia_kg_m2
        motors = [MotorBlock(name="the machine's", power_kw=power, speed_rpm=rpm, inertia_kg_m2=inertia)]
    else:
        motors = read_catalogue(CATALOGUE if asked.motors == "catalogue" else folder / asked.motors)
    return [*motors, *([asked.motor] if asked.motor is not None else [])]


def read_catalogue(path: Path) -> list[MotorBlock]:
    """A table of motors, a row each; empty cells are not known. InputError with the line of what does not fit."""
    motors = []
    reader = csv.DictReader(io.StringIO(read_input(path, "table").decode("utf-8-sig")))
    numbers = {"power_kw", "speed_rpm", "current_a", "power_factor", "breakdown_ratio", "inertia_kg_m2"}
    needed = {"name", "power_kw", "speed_rpm"}
    if missing := needed - set(reader.fieldnames or ()):
        raise InputError(f"has no column '{sorted(missing)[0]}'", file=path, line=1)
    for line, cells in enumerate(reader, start=2):
        values: dict[str, Any] = {}
        try:
            for name, text in cells.items():
                if text and name in MotorBlock.model_fields:
                    values[name] = float(text) if name in numbers else int(text) if name == "poles" else text
            motors.append(MotorBlock.model_validate(values))
        except ValueError as error:
            raise InputError(f"is no motor: {str(error).splitlines()[0]}", file=path, line=line) from error
    return motors


def _machine(drive: Candidate, study: Study, overload: float) -> Hoist:
    motor = drive.motor
    values = {
        "motor.count": float(drive.count), "motor.nominal_torque_nm": motor.torque_nm,
        "motor.nominal_speed_rad_s": motor.speed_rad_s, "motor.rotor_inertia_kg_m2": motor.inertia,
        "gearbox.ratio": drive.ratio, "drive.overload": overload,
    }  # fmt: skip
    return with_values(cast(Hoist, study.machine), values)


def _distribution(asked: SizeFile, study: Study) -> list[Loaded]:
    if asked.payloads:
        return sorted(asked.payloads, key=lambda one: one.payload_kg)
    loads = sorted(study.scenario.payloads_kg or (0.0,))
    return [Loaded(payload_kg=load, share=1.0 / len(loads)) for load in loads]


def _too_small(drive: Candidate, asked: SizeFile, study: Study) -> Check | None:
    """What is known without a run: the motor's speed, and whether it holds the load; the one that is missed by more."""
    machine = _machine(drive, study, 1.0)
    limits = study.specs[0].bounds
    fastest = max(limits.hoisting.speed_m_s, limits.lowering.speed_m_s) / machine.lift_m_per_rad
    hold = hold_torque_nm(machine, _distribution(asked, study)[-1].payload_kg) / drive.count
    turns = Check("speed", fastest, drive.motor.speed_rad_s, "rad/s")
    holds = Check("holding the load", hold, largest_torque_nm(drive.motor, study), "N m")
    worse = max(turns, holds, key=lambda check: check.used)
    return None if worse.ok else worse


def hold_torque_nm(machine: Hoist, payload_kg: float) -> float:
    """T = m g d / (4 i): of all motors together, the load at rest on two falls without friction."""
    load = load_of(machine, payload_kg)
    assert load is not None
    return load.hold_n * machine.lift_m_per_rad


def largest_torque_nm(motor: MotorBlock, study: Study) -> float:
    """What the drive may ask of a motor: its overload, and what breakdown torque leaves."""
    overload = cast(Hoist, study.machine).drive.overload
    known = motor.breakdown_ratio
    return motor.torque_nm * (overload if known is None else min(overload, known / PULL_OUT))


def _specs(drive: Candidate, asked: SizeFile, study: Study) -> list[RunSpec]:
    """A run for each payload, then the drive's emergency stop of the heaviest from full speed down."""
    machine = _machine(drive, study, LIFTED)
    loads = _distribution(asked, study)
    own = cast(Any, study.scenario.controller)
    inertia = kind_of(machine).looped.total_inertia
    share = inertia(machine, loads[-1].payload_kg) / inertia(study.machine, loads[-1].payload_kg)
    controller = own.model_copy(update={name: float(getattr(own, name)) * share for name in own.GAINS})
    reference = asked.reference or study.scenario.kinds[0]
    base = next(spec for spec in study.specs if spec.reference == reference)
    specs = [
        replace(base, run_id=f"{one.payload_kg:g}kg", machine=machine, payload_kg=one.payload_kg, controller=controller,
                record_every=10, assigned={})
        for one in loads
    ]  # fmt: skip
    t = np.arange(0.0, base.duration_s, 0.01)
    speed = specs[-1].plan().at(t)[1]
    down = np.flatnonzero(speed <= 0.999 * speed.min()) if speed.min() < 0.0 else np.flatnonzero(speed >= speed.max())
    events = Events(emergency_stop_s=float(t[down[len(down) // 2]]),
                    emergency_deceleration_m_s2=asked.emergency.deceleration_m_s2)  # fmt: skip
    return [*specs, replace(specs[-1], run_id=f"{specs[-1].run_id}_stop", events=events)]


def s1_share(speed: Array, nominal: float, thermal: Thermal) -> Array:
    """Torque that a motor bears without end, over its nominal one, at (n,) speeds."""
    relative = np.abs(speed) / nominal
    rising = thermal.standstill_share + (1.0 - thermal.standstill_share) * np.minimum(relative / thermal.full_from, 1.0)
    cooled = np.ones_like(relative) if thermal.forced else rising
    return np.minimum(cooled, 1.0 / np.maximum(relative, 1.0))


def rated_current(motor: MotorBlock, inverter: Inverter) -> tuple[float, float]:
    """(rated, magnetising) current of a motor: I_N = P/(sqrt 3 U cos phi eta), I_m = I_N sin phi."""
    factor = motor.power_factor or inverter.power_factor
    usual = 1000.0 * motor.power_kw / (math.sqrt(3.0) * inverter.voltage_v * factor * inverter.efficiency)
    rated = motor.current_a or usual
    return rated, rated * math.sqrt(1.0 - factor**2)


def current_a(torque: Array, speed: Array, motor: MotorBlock, inverter: Inverter) -> Array:
    """I = sqrt(I_m^2 + (I_q T/T_N)^2); above nominal speed the field falls and the active part grows by the speed."""
    rated, field = rated_current(motor, inverter)
    weaker = np.maximum(np.abs(speed) / motor.speed_rad_s, 1.0)
    active = math.sqrt(rated**2 - field**2) * np.abs(torque) / motor.torque_nm
    return np.hypot(field / weaker, active * weaker)


def overload_use(current: Array, dt_s: float, inverter: Inverter, rated_a: float) -> float:
    """The largest integral of I^2 - I_c^2 above I_c in any period, over what the inverter bears there."""
    above = np.maximum(current**2 - rated_a**2, 0.0) * dt_s
    total = np.concatenate([[0.0], np.cumsum(above)])
    window = min(round(inverter.overload_period_s / dt_s), len(above))
    most = float(np.max(total[window:] - total[:-window])) if len(above) else 0.0
    return most / (rated_a**2 * (inverter.overload**2 - 1.0) * inverter.overload_time_s)


@dataclass(frozen=True)
class StoStop:
    """After torque off while lowering: largest speed (rad/s), time to rest (s), way (rad), work of the brakes (J)."""

    speed_rad_s: float
    time_s: float
    way_rad: float
    work_j: float


def sto_stop(inertia: float, load_nm: float, brake_nm: float, speed_rad_s: float, delay_s: float) -> StoStop | None:
    """w1 = w0 + T_L t_d/J; t_b = J w1/(T_B - T_L); W = T_B w1 t_b/2. None where the brakes do not hold the load."""
    if brake_nm <= load_nm:
        return None
    fastest = speed_rad_s + load_nm * delay_s / inertia
    braking = inertia * fastest / (brake_nm - load_nm)
    way = 0.5 * (speed_rad_s + fastest) * delay_s + 0.5 * fastest * braking
    return StoStop(fastest, delay_s + braking, way, 0.5 * brake_nm * fastest * braking)


@dataclass(frozen=True)
class _Cycle:
    """One run, brake and gear unit in it: torque of the harder-worked motor, of all (N m), speed (rad/s), step (s)."""

    motor: Array
    every: Array
    speed: Array
    step_s: float

    @property
    def length_s(self) -> float:
        return len(self.speed) * self.step_s


def _cycle(spec: RunSpec, run: Run, asked: SizeFile) -> _Cycle:
    """At rest the motors hold for hold_s on either side of a move; for the remainder the brakes are set, torque off."""
    t, speed, hold, eta = run.time_s, run["speed_motor_rad_s"], asked.brake.hold_s, asked.gearbox.efficiency
    held = np.zeros(len(t), dtype=bool)
    for start, end in spec.plan().move_windows:
        held |= (t >= start - hold) & (t <= end + hold)
    every = run["torque_motor_nm"] * held
    loss = np.where(every * speed >= 0.0, 1.0 / eta, eta)
    one, two = (run.signals.get(f"torque_motor{k}_nm", run["torque_motor_nm"] / 2.0) for k in (1, 2))
    harder = np.maximum(np.abs(one), np.abs(two)) * (2.0 / cast(Hoist, spec.machine).motor.count)
    return _Cycle(harder * held * loss, every * loss, speed, float(t[1] - t[0]))


def _checks(
    drive: Candidate, asked: SizeFile, study: Study, specs: Sequence[RunSpec], results: Sequence[tuple[Row, Run | None]]
) -> Iterator[Check]:
    motor, machine, thermal, inverter = drive.motor, cast(Hoist, specs[0].machine), asked.thermal, asked.inverter
    cycles = [_cycle(spec, cast(Run, run), asked) for spec, (_, run) in zip(specs, results, strict=True)]
    duty, stop, heaviest = cycles[:-1], cycles[-1], specs[-1].payload_kg
    shares = [one.share for one in _distribution(asked, study)]
    length = sum(w * (c.length_s + asked.rest_s) for w, c in zip(shares, duty, strict=True))

    def mean(values: Sequence[Array]) -> float:
        """Over all cycles and the rest after them."""
        return sum(w * float(np.sum(v)) * c.step_s for w, v, c in zip(shares, values, duty, strict=True)) / length

    def peak(some: Sequence[_Cycle]) -> float:
        """At nominal flux: above nominal speed the same current gives less torque."""
        return max(float(np.max(c.motor * np.maximum(np.abs(c.speed) / motor.speed_rad_s, 1.0))) for c in some)

    most = largest_torque_nm(motor, study)
    yield Check("speed", max(float(np.max(np.abs(c.speed))) for c in cycles),
                motor.speed_rad_s * asked.emergency.overspeed, "rad/s")  # fmt: skip
    yield Check("peak torque", peak(duty), most, "N m")
    yield Check("peak torque of the emergency ramp", peak([stop]), most, "N m")
    borne = [(c.motor / s1_share(c.speed, motor.speed_rad_s, thermal)) ** 2 for c in duty]
    yield Check("thermal torque", math.sqrt(mean(borne)), motor.torque_nm, "N m")

    rated = inverter.rated_current_a
    currents = [current_a(c.motor, c.speed, motor, inverter) for c in duty]
    yield Check("inverter current, peak", max(float(np.max(i)) for i in currents),
                None if rated is None else rated * inverter.overload, "A")  # fmt: skip
    yield Check("inverter current, rms", math.sqrt(mean([i**2 for i in currents])), rated, "A")
    if rated is not None:
        use = max(overload_use(i, c.step_s, inverter, rated) for i, c in zip(currents, duty, strict=True))
        yield Check("inverter overload (I²t)", 100.0 * use, 100.0, "%")

    hold = hold_torque_nm(machine, heaviest)
    brakes = drive.count * asked.brake.torque_nm if asked.brake.torque_nm is not None else asked.brake.safety * hold
    if asked.brake.torque_nm is None:
        yield Check("brake torque per motor", brakes / drive.count, None, "N m")
    else:
        yield Check("brake torque over the load's", brakes / hold, asked.brake.safety, "", at_least=True)
    limits = specs[-1].bounds
    inertia = kind_of(machine).looped.total_inertia(machine, heaviest)
    sto = sto_stop(inertia, hold, brakes, limits.lowering.speed_m_s / machine.lift_m_per_rad, asked.brake.delay_s)
    if sto is not None:
        yield Check("speed after STO", sto.speed_rad_s, motor.speed_rad_s * asked.emergency.overspeed, "rad/s")
        yield Check("work of a brake after STO", sto.work_j / drive.count / 1000.0,
                    None if asked.brake.work_j is None else asked.brake.work_j / 1000.0, "kJ")  # fmt: skip
        yield Check("way to rest after STO", sto.way_rad * machine.lift_m_per_rad, None, "m")

    back = [np.maximum(-c.every * c.speed, 0.0) * asked.resistor.efficiency / 1000.0 for c in cycles]
    yield Check("resistor power, peak", max(float(np.max(p)) for p in back), asked.resistor.peak_kw, "kW")
    yield Check("resistor power, continuous", mean(back[:-1]), asked.resistor.continuous_kw, "kW")

    gear = asked.gearbox
    drum = max(float(np.max(np.abs(c.every))) for c in cycles) * drive.ratio
    if gear.rated_torque_nm is None:
        yield Check("rated torque of the gear unit", gear.service_factor * hold * drive.ratio / 1000.0, None, "kN m")
    else:
        factor = gear.rated_torque_nm / (hold * drive.ratio)
        yield Check("service factor of the gear unit", factor, gear.service_factor, "", at_least=True)
    borne_nm = None if gear.rated_torque_nm is None else gear.peak * gear.rated_torque_nm / 1000.0
    yield Check("peak torque at the drum", drum / 1000.0, borne_nm, "kN m")

    breaking = asked.wire.breaking_load_n or machine.wire.breaking_load_n
    tension = max(row["max_wire_tension_n"] for row, _ in results)
    if breaking is not None:
        yield Check("safety factor of the wire", breaking / tension, asked.wire.safety_factor, "", at_least=True)
    if asked.wire.bends_to_discard is not None:
        hours = asked.wire.bends_to_discard / asked.wire.bends_per_cycle * length / 3600.0
        yield Check("life of the wire by bends", hours, None, "h")
