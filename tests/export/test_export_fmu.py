"""A machine as an FMU: the standard's rules, the same motion as here, and what it refuses."""

from __future__ import annotations

import itertools
import re
import subprocess
import zipfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from tests.support.commands import Commands
from tests.support.exported_fmu import Exported, Instance
from workbench.control import FeedForward, Notch, PiSettings, loop_values
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.engine.stepped import observe
from workbench.export import fmu as compiling
from workbench.export.fmu import c_files, write_fmu, write_sources
from workbench.export.model import Model, Start, exponents, meaning_of, model_of, range_of
from workbench.machines import (
    KINDS,
    PLANTS,
    Axis,
    Hoist,
    default_hoist,
    plant_of,
    save_machine,
    with_correction,
    with_values,
)
from workbench.machines.kinds.axis import LinearAxis, LinearFriction, LinearGravity, RotaryFriction, RotaryGravity
from workbench.machines.kinds.two_inertia import (
    Coupling,
    LoadSide,
    MotorSide,
    TwoInertia,
)
from workbench.metrics import observer
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.loop import LoopCase, case_limits, simulate_loop
from workbench.simulate.replay import simulate_replays

HOIST = default_hoist()
NOMINAL = HOIST.motor.nominal_speed_rad_s
LINEAR = LinearAxis(
    mass_kg=95.1,
    friction=LinearFriction(
        coulomb_forward_n=20.4, coulomb_backward_n=18.0, viscous_n_s_per_m=203.5, standstill_speed_m_s=0.001
    ),
    gravity=LinearGravity(constant_n=5.0),
)
TWO = TwoInertia(
    motor=MotorSide(
        inertia_kg_m2=0.3,
        friction=RotaryFriction(
            coulomb_forward_nm=1.0, coulomb_backward_nm=1.2, viscous_nm_s_per_rad=0.5, standstill_speed_rad_s=0.01
        ),
    ),
    coupling=Coupling(stiffness_nm_per_rad=500.0, damping_nm_s_per_rad=0.5, backlash_rad=0.02),
    load=LoadSide(inertia_kg_m2=0.4, gravity=RotaryGravity(sine_nm=3.0, constant_nm=0.5)),
)
PLAIN = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
FULL = PiSettings(
    kp_nm_s_per_rad=31.0,
    ki_nm_per_rad=122.0,
    sample_time_s=0.002,
    low_pass_hz=80.0,
    notch=Notch(frequency_hz=6.0),
    feed_forward=FeedForward(inertia=1.0, weight=1.0, friction=0.5),
    torque_rate_limit_nm_per_s=20000.0,
    set_point_weight=0.7,
    anti_windup="conditional",
)
REAL_DRIVE = with_values(
    HOIST,
    {"drive.torque_lag_s": 0.005, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.0025,
     "drive.encoder_counts_per_turn": 4096},
)  # fmt: skip


@pytest.fixture(scope="module")
def plant3(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return Exported(model_of(HOIST, Start(4500.0, 9.0)), tmp_path_factory.mktemp("plant3"))


@pytest.fixture(scope="module")
def plant2(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return Exported(model_of(HOIST, Start(4500.0, 9.0)), tmp_path_factory.mktemp("plant2"), "2.0")


@pytest.fixture(scope="module")
def loop3(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return Exported(model_of(HOIST, Start(4500.0, 9.0), controller=PLAIN), tmp_path_factory.mktemp("loop3"))


@pytest.fixture(scope="module")
def full_loop2(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    model = model_of(REAL_DRIVE, Start(4500.0, 9.0), controller=FULL)
    return Exported(model, tmp_path_factory.mktemp("loop2"), "2.0")


@pytest.fixture
def one(plant3: Exported) -> Instance:
    return plant3.instance()


@cache
def described() -> dict[str, Model]:
    """A model of every kind, with effects that keep a memory, with a table, with either loop."""
    table = with_correction(
        HOIST, "position_carriage_m", "guide", [1.0, 9.0, 20.0], [10.0, 300.0, 0.0], [0.0, 200.0, 0.0]
    )
    drag = {"brake_drag": {"torque_nm": 40.0}, "drum_eccentricity": {"amplitude_m": 0.002}}
    return {
        "hoist": model_of(HOIST),
        "effects": model_of(HOIST, effects=drag),
        "table": model_of(table),
        "linear": model_of(LINEAR),
        "two": model_of(TWO),
        "loop": model_of(HOIST, controller=PLAIN),
        "full loop": model_of(REAL_DRIVE, controller=FULL),
    }


def replayed(machine: Hoist | Axis, run: Run, start_speed: float = 0.0) -> Array:
    """What `workbench replay` makes of a run: states (n, states)."""
    return simulate_replays(InverseSimulation(machine, [run], band_hz=1.0))[0]


def torque_run(machine: Hoist, duration_s: float = 8.0) -> Run:
    """A hoist that is pushed up, brakes, goes down and stops: torque with ramps, its own motion from a replay."""
    t: Array = np.asarray(0.01 * np.arange(round(duration_s / 0.01)), dtype=float)
    hoist = PLANTS["hoist"]
    _, hold = hoist.equilibrium(9.0, hoist.values(machine, 4500.0))
    push = np.interp(t, [0.0, 0.5, 1.0, 3.0, 3.5, 5.0, 5.6, 8.0], [0.0, 0.0, 160.0, 30.0, -160.0, -150.0, 120.0, 0.0])
    zero = np.zeros_like(t)
    return Run("made", t, {"torque_motor_nm": hold + push, "speed_motor_rad_s": zero}, 4500.0, 9.0, 0.0)


@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("name", ["hoist", "effects", "table", "linear", "two", "loop", "full loop"])
def test_the_description_keeps_to_the_standard(name: str, version: str, tmp_path: Path):
    """Schema, model structure, start values, units: FMPy's validation finds nothing."""
    file = tmp_path / "model.fmu"
    write_fmu(described()[name], file, version, platforms=())  # type: ignore[arg-type]
    assert validate_fmu(str(file)) == []


@pytest.mark.parametrize("fixture", ["plant3", "plant2"])
def test_a_recorded_torque_moves_the_fmu_as_it_moves_the_replay(fixture: str, request: pytest.FixtureRequest):
    exported: Exported = request.getfixturevalue(fixture)
    run = torque_run(HOIST)
    states = replayed(HOIST, run)
    shown = ["speed_motor_rad_s", "position_carriage_m", "speed_carriage_m_s"]
    out = exported.instance().start().replay(run.time_s, run["torque_motor_nm"], "torque_motor_nm", shown)
    assert np.max(np.abs(states[:, 3])) > 0.3 * NOMINAL  # it moves, both ways
    assert np.min(states[:, 3]) < -5.0
    assert np.max(np.abs(out[:, 0] - states[:, 3])) < 1e-6 * NOMINAL
    assert np.max(np.abs(out[:, 1] - states[:, 2])) < 1e-5
    assert np.max(np.abs(out[:, 2] - states[:, 5])) < 1e-6 * NOMINAL * HOIST.lift_m_per_rad


def test_effects_move_the_fmu_as_they_move_the_replay(tmp_path: Path):
    machine = HOIST.model_copy(
        update={
            "effects": {
                "friction_viscous": {"viscous_n_s_per_m": 4000.0},
                "drum_eccentricity": {"amplitude_m": 0.004},
                "gearbox_efficiency": {"loss_fraction": 0.03},
            }
        }
    )
    run = torque_run(machine, 4.0)
    states = replayed(machine, run)
    exported = Exported(model_of(machine, Start(4500.0, 9.0)), tmp_path)
    # The gearbox' loss turns over with the torque it transmits: at 1 ms steps this is 3e-6.
    instance = exported.instance().start({"step_s": 0.0002})
    out = instance.replay(run.time_s, run["torque_motor_nm"], "torque_motor_nm", ["speed_motor_rad_s"])
    assert np.max(np.abs(out[:, 0] - states[:, 3])) < 1e-6 * NOMINAL


@pytest.mark.parametrize("machine", [LINEAR, TWO], ids=["linear", "two_inertia"])
def test_an_axis_rests_where_its_plant_says_and_moves_as_the_replay(machine: Axis, tmp_path: Path):
    plant = plant_of(machine)
    p = plant.values(machine)
    exported = Exported(model_of(machine, Start(0.0, 0.3)), tmp_path)
    one = exported.instance().start()
    q, hold = plant.equilibrium(0.3, p)
    assert one.get(*plant.positions) == pytest.approx(q, abs=1e-9)
    unit = plant.input.rpartition("_")[2]
    assert one.get(f"{plant.input.removesuffix(unit)}hold_{unit}") == pytest.approx([hold], abs=1e-8)
    t: Array = np.asarray(0.002 * np.arange(1000), dtype=float)
    u: Array = hold + (60.0 if machine is LINEAR else 6.0) * np.sin(2.0 * np.pi * 0.5 * t)
    # Of the logged motion a replay takes the start, and the largest speed, which its steps are judged by.
    logged = {plant.speeds[0]: np.where(t > 1.0, 0.1, 0.0), plant.positions[0]: np.full_like(t, 0.3)}
    states = replayed(machine, Run("made", t, {plant.input: u, **logged}, 0.0, 0.3, 0.0))
    speed = states[:, len(plant.positions)]
    out = one.replay(t, u, plant.input, [plant.speeds[0]])[:, 0]
    # The blow of a flank is sharper than any step; without play the standstill alone is.
    assert np.max(np.abs(out - speed)) < (2e-6 if machine is LINEAR else 1e-3) * np.max(np.abs(speed))


@pytest.mark.parametrize(
    ("fixture", "machine", "settings"),
    [("loop3", HOIST, PLAIN), ("full_loop2", REAL_DRIVE, FULL)],
    ids=["plain", "full"],
)
def test_the_loop_inside_gives_the_metrics_of_a_study(fixture, machine, settings, request):
    dt = settings.sample_time_s
    plan = plan_motion("ruckig", [Step(by_m=0.4)], 9.0, Limits(0.5, 0.6, 2.0), (0.0, 25.0), lead_s=0.2)
    speed = motor_speed_rad_s(plan.sample(dt, 2.0).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    case = LoopCase("made", machine, 4500.0, 9.0, settings, speed)
    (result,) = simulate_loop([case], record_every=0)
    exported: Exported = request.getfixturevalue(fixture)
    one = exported.instance().start()
    names = [v.name for v in exported.model.variables if v.causality == "output"]
    torque, lagged = names.index("torque_motor_nm"), machine.drive.torque_lag_s > 0.0
    rows = np.empty((len(speed), len(names)))
    for k, reference in enumerate(speed):
        rows[k] = one.get(*names)
        one.set({"speed_reference_rad_s": float(reference)})
        one.step(k * dt, dt)
        if not lagged:  # the torque of this sample is at work from here on
            rows[k, torque] = one.get("torque_motor_nm")[0]
    shown = dict(zip(names, rows.T, strict=True))
    time = np.asarray(dt * np.arange(len(speed)), dtype=float)
    signals: dict[str, Array] = {**shown, "time_s": time, "speed_reference_rad_s": speed}
    hold = one.get("torque_motor_hold_nm")[0]
    values = {**vars(PLANTS["hoist"].values(machine, 4500.0)), **loop_values(settings, machine.drive, hold)}
    p = SimpleNamespace(**values, **case_limits(case))
    metrics = observer().finish(observe(observer(), p, signals, dt), p, len(speed) * dt)
    assert metrics.keys() == result.metrics.keys()
    assert metrics == pytest.approx(result.metrics, rel=1e-6, abs=1e-9)


def test_the_motion_does_not_depend_on_the_communication_step(plant3: Exported):
    def after(lengths: list[float]) -> float:
        instance = plant3.instance().start({"torque_motor_nm": 640.0})
        now = 0.0
        for length in itertools.cycle(lengths):
            length = min(length, 1.0 - now)
            instance.step(now, length)
            now += length
            if now >= 1.0 - 1e-9:
                return instance.get("speed_motor_rad_s")[0]
        return 0.0

    assert after([0.05]) == pytest.approx(after([0.0013, 0.0101, 0.037]), abs=1e-6 * NOMINAL)


def test_samples_of_the_controller_do_not_depend_on_the_communication_step(loop3: Exported, tmp_path: Path):
    # An exact speed: of two angles that differ by a rounding, a counting encoder may see one count more in one.
    machine = with_values(HOIST, {"drive.encoder_counts_per_turn": 0})
    exact = Exported(model_of(machine, Start(4500.0, 9.0), controller=PLAIN), tmp_path)

    def after(length: float) -> list[float]:
        instance = exact.instance().start({"speed_reference_rad_s": 20.0})
        for k in range(round(0.3 / length)):
            instance.step(k * length, length)
        return instance.get("speed_motor_rad_s", "torque_motor_nm")

    assert after(0.0004) == pytest.approx(after(0.1), rel=1e-6)
    failed = loop3.instance().start({"speed_reference_rad_s": 150.0, "motor_failed": True})
    failed.step(0.0, 0.2)
    assert failed.get("torque_motor_nm")[0] == pytest.approx(768.0)  # one motor's 480 N m times 1.6


def test_a_stored_state_goes_back_exactly_also_through_bytes(one: Instance):
    one.start({"torque_motor_nm": 650.0})
    one.step(0.0, 0.1)
    state = one.slave.getFMUState()
    data = one.slave.serializeFMUState(state)
    one.step(0.1, 0.2)
    once = one.get("speed_motor_rad_s", "tension_drum_n")
    one.slave.setFMUState(one.slave.deSerializeFMUState(data) if hasattr(one.slave, "deSerializeFMUState") else
                          one.slave.deserializeFMUState(data))  # fmt: skip
    assert one.get("time") == [0.1]
    one.step(0.1, 0.2)
    assert one.get("speed_motor_rad_s", "tension_drum_n") == once
    one.slave.freeFMUState(state)


def test_derivatives_are_those_of_the_plant(one: Instance):
    """The motor's acceleration by the torque is 1/J, and the wire's stiffness is what small moves show."""
    one.start()
    reference = one.exported.reference
    by_torque = one.slave.getDirectionalDerivative(
        [reference["der(speed_motor_rad_s)"]], [reference["torque_motor_nm"]], [1.0]
    )
    J = HOIST.motor.count * HOIST.motor.rotor_inertia_kg_m2 + HOIST.winch.inertia_kg_m2 / HOIST.gearbox.ratio**2
    assert list(by_torque) == pytest.approx([1.0 / J])
    by_height = one.slave.getDirectionalDerivative(
        [reference["tension_dead_line_n"]], [reference["position_carriage_m"]], [1.0]
    )
    w = HOIST.wire
    k = w.youngs_modulus_pa * w.effective_area_m2 / w.segment_length_m
    line = 7850.0 * w.effective_area_m2 * HOIST.gravity_m_s2
    assert list(by_height) == pytest.approx([-k - line / 2.0])


def test_a_closed_brake_holds_the_load_and_an_open_one_lets_it_fall(one: Instance):
    one.start({"torque_motor_nm": 0.0, "brake_closed": True})
    one.step(0.0, 1.0)
    assert abs(one.get("speed_motor_rad_s")[0]) < 0.05
    one.set({"brake_closed": False})
    one.step(1.0, 0.5)
    assert one.get("speed_motor_rad_s")[0] < -20.0


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"carriage.mass_kg": -1.0}, "'carriage.mass_kg' was given -1, expected at least 1e-06"),
        ({"guide.coulomb_hoisting_n": float("nan")}, "expected a finite number"),
        ({"bearing.pin_friction_coefficient": 1.0}, "expected less than 1"),
        ({"motor.count": 1.5}, "expected a whole number"),
        ({"payload_kg": -3.0}, "expected at least 0"),
        ({"torque_motor_nm": float("inf")}, "expected a finite number"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_an_impossible_value_is_refused_through_the_logger_and_changes_nothing(one: Instance, values, said: str):
    (name,) = values
    before = one.get(name)
    with pytest.raises(FMICallException):
        one.set(values)
    assert any(said in line for line in one.said), one.said
    assert one.get(name) == before


@pytest.mark.parametrize(
    ("begin", "length", "said"),
    [
        (0.0, 0.1, "restore a stored state to go back"),
        (0.1, -0.1, "time only goes forward"),
        (0.1, 0.0, "time only goes forward"),
        (float("nan"), 0.1, "expected finite numbers"),
        (0.1, float("inf"), "expected finite numbers"),
        (0.1, 1e9, "expected at most"),
    ],
)
@pytest.mark.parametrize("fixture", ["plant3", "plant2"])
def test_a_step_that_cannot_be_is_refused_and_the_next_one_goes_on(fixture, begin, length, said, request):
    instance = request.getfixturevalue(fixture).instance().start({"torque_motor_nm": 600.0})
    instance.step(0.0, 0.1)
    before = instance.get("speed_motor_rad_s")
    with pytest.raises(FMICallException):
        instance.step(begin, length)
    assert any(said in line for line in instance.said), instance.said
    assert instance.get("speed_motor_rad_s") == before
    instance.step(0.1, 0.1)


def test_a_load_that_runs_away_ends_the_step_where_it_does_and_not_in_nan(one: Instance):
    one.start({"torque_motor_nm": 1e12})
    with pytest.raises(FMICallException):
        one.step(0.0, 3600.0)
    (said,) = (line for line in one.said if "grew without bound" in line)
    assert 0.0 < float(said.split(" at ")[1].split()[0]) < 1.0
    assert one.get("time", "speed_motor_rad_s") == [0.0, 0.0]


@pytest.mark.parametrize("fixture", ["plant3", "plant2"])
def test_a_plant_whose_torque_nobody_sets_holds_its_load(fixture: str, request: pytest.FixtureRequest):
    """With the brake open; also at another payload than that of the description."""
    exported: Exported = request.getfixturevalue(fixture)
    torque = next(v for v in exported.description.modelVariables if v.name == "torque_motor_nm")
    for payload in (4500.0, 9000.0):
        one = exported.instance().start({"payload_kg": payload})
        assert one.get("torque_motor_nm") == one.get("torque_motor_hold_nm")
        if payload == 4500.0:
            assert one.get("torque_motor_nm") == pytest.approx([float(torque.start)], rel=1e-9)
        one.step(0.0, 2.0)
        assert abs(one.get("speed_motor_rad_s")[0]) < 1e-6 and one.get("position_carriage_m") == pytest.approx([9.0])


def test_dependencies_agree_with_the_derivatives_of_the_binary(one: Instance):
    """A known that is not listed has no slope, at a moving and at a resting point."""
    model, reference = one.exported.model, one.exported.reference
    one.start({"torque_motor_nm": 900.0})
    for begin in (0.0, 0.1, 0.2):
        for unknown in model.unknowns:
            for known in set(model.knowns) - set(model.dependencies[unknown]):
                (slope,) = one.slave.getDirectionalDerivative([reference[unknown]], [reference[known]], [1.0])
                assert slope == 0.0, (unknown, known)
        one.step(begin, 0.1)


def test_the_sources_compile_without_a_warning_and_take_no_memory_in_a_step(tmp_path: Path):
    for number, (model, version) in enumerate(itertools.product(described().values(), ("3.0", "2.0"))):
        if model.name and number not in (0, 3, 10):  # one of each interface, one with the loop
            continue
        folder = tmp_path / str(number)
        write_sources(model, folder, version)  # type: ignore[arg-type]
        words = [compiling.host_compiler() or "cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only",
                 f"-I{compiling.HEADERS}", *c_files(version)]  # type: ignore[arg-type]  # fmt: skip
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        for name in ("core.c", "model.c"):
            assert not re.search(r"\b(malloc|calloc|realloc|alloca|free)\s*\(", (folder / name).read_text())


def test_every_parameter_has_a_meaning_a_range_and_a_known_unit():
    for kind in KINDS.values():
        for key in kind.plant.parameters.values():
            if isinstance(key, str):
                assert meaning_of(key)
    assert range_of(Hoist, "bearing.pin_friction_coefficient").below
    for model in described().values():
        for v in model.variables:
            assert v.meaning, v.name
            assert v.unit == "" or exponents(v.unit), v.name


def test_the_command_writes_sources_for_any_compiler(tmp_path: Path, commands: Commands):
    save_machine(HOIST, tmp_path / "machine.yaml")
    done = commands("export-fmu", tmp_path / "machine.yaml", "--out", tmp_path / "hoist.fmu", "--platforms", "none",
                     "--effect", "friction_viscous.viscous_n_s_per_m=4210", "--payload", "4500")  # fmt: skip
    assert done.status == 0, done.err
    with zipfile.ZipFile(tmp_path / "hoist.fmu") as archive:
        names = set(archive.namelist())
        description = archive.read("modelDescription.xml").decode()
    assert {"sources/fmi3.c", "sources/core.c", "sources/model.c", "sources/buildDescription.xml"} <= names
    assert 'name="effects.friction_viscous.viscous_n_s_per_m"' in description and 'start="4210.0"' in description
    again = commands("export-fmu", tmp_path / "machine.yaml", "--out", tmp_path / "hoist.fmu")
    assert again.status == 2 and "nothing is overwritten" in again.err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"start": Start(-1.0)}, "expected 0 or more"),
        ({"start": Start(0.0, 99.0)}, "where the dead anchor is"),
        ({"effects": {"friction_viscos": {"viscous_n_s_per_m": 1.0}}}, "did you mean 'friction_viscous'"),
        ({"step_s": 0.0}, "expected more than 0"),
    ],
)
def test_what_cannot_be_exported_is_one_sentence(change, said: str):
    with pytest.raises(InputError, match=said):
        model_of(HOIST, **change)
    with pytest.raises(InputError, match="a controller is exported with"):
        model_of(LINEAR, controller=PLAIN)
    with pytest.raises(InputError, match="carries no payload"):
        model_of(LINEAR, Start(5.0))
