"""The multi-body machine in motion: textbook cases, energy, convergence, switches, the wire's swing, bounds."""

from __future__ import annotations

import ast
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from benchmarks.validation.multibody import sampled
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects.registry import find
from workbench.machines import Hoist, default_hoist, with_values
from workbench.machines.multibody import Driven, MotionResult, Outcome, Shaft, Switches, move, switches_of
from workbench.machines.multibody.switches import _EFFECTS, engine

MACHINE = default_hoist()
SMOOTH = with_values(
    MACHINE, {"guide.coulomb_hoisting_n": 0.0, "guide.coulomb_lowering_n": 0.0, "bearing.pin_friction_coefficient": 0.0}
)
# Nothing loses energy; the wire is as stiff as before and weighs next to nothing.
LOSSLESS = with_values(
    SMOOTH,
    {
        "wire.damping_time_s": 0.0,
        "wire.effective_area_m2": MACHINE.wire.youngs_modulus_pa * MACHINE.wire.effective_area_m2 / 1e13,
        "wire.youngs_modulus_pa": 1e13,
        "arm.roller_damping_time_s": 0.0,
        "arm.cylinder_damping_time_s": 0.0,
    },
)


def torque(of_time: Callable[[float], float]) -> Callable[[float], Driven]:
    """The holding torque and so much more at a time."""
    return lambda hold: lambda shaft, until: (hold + of_time(until), 0.0)


def regulated(speed: float, ramp_s: float = 1.0) -> Callable[[float], Driven]:
    """A stiff speed loop, up over a ramp; sampled each 4 ms whatever the step."""

    def start(hold: float) -> Driven:
        integral = hold

        def driven(shaft: Shaft, until: float) -> tuple[float, float]:
            nonlocal integral
            error = speed * min(shaft.time_s / ramp_s, 1.0) - shaft.speed_rad_s
            integral += 200.0 * error * 0.004
            return 50.0 * error + integral, 0.0

        return sampled(driven, 0.004)

    return start


def shaft_inertia(machine: Hoist, payload: float) -> float:
    """Of everything at the motors on a stiff wire; the sheave turns at half the wire's speed over its radius."""
    i = 1.0 / machine.gearbox.ratio
    lever = i * machine.winch.drum_diameter_m / 4.0
    inertia = machine.motor.count * machine.motor.rotor_inertia_kg_m2 + machine.winch.inertia_kg_m2 * i**2
    inertia += machine.sheave.inertia_kg_m2 * (lever / (machine.sheave.diameter_m / 2.0)) ** 2
    return inertia + (machine.carriage.mass_kg + payload) * lever**2


def test_hanging_still_it_stays_where_it_is():
    run = move(MACHINE, 4500.0, 9.0, torque(lambda t: 0.0), 1.0, step_s=0.004).run
    assert np.max(np.abs(run["speed_motor_rad_s"])) < 1e-8
    assert run["position_carriage_m"] == pytest.approx(9.0, abs=1e-9)


@pytest.mark.parametrize("more", [25.0, -40.0])
def test_a_torque_more_than_holds_accelerates_the_inertia_of_the_textbook(more: float):
    machine = with_values(SMOOTH, {"wire.youngs_modulus_pa": 1e13, "wire.effective_area_m2": 1e-6})
    run = move(machine, 4500.0, 9.0, torque(lambda t: more), 2.0, step_s=0.004).run
    speed = np.interp([0.5, 2.0], run.time_s, run["speed_motor_rad_s"])
    assert (speed[1] - speed[0]) / 1.5 == pytest.approx(more / shaft_inertia(machine, 4500.0), rel=2e-3)


@pytest.mark.parametrize("payload", [0.0, 9000.0])
def test_the_carriage_swings_on_two_falls_at_the_frequency_of_the_textbook(payload: float):
    """A drum that does not turn: mass m on two falls of stiffness k, f = √(2k/m)/2π; a stiff arm, a light sheave."""
    machine = with_values(
        LOSSLESS,
        {
            "motor.rotor_inertia_kg_m2": 1e9,
            "sheave.inertia_kg_m2": 1e-3,
            "arm.cylinder_stiffness_n_per_m": 1e10,
            "arm.roller_stiffness_n_per_m": 1e10,
        },
    )
    wire = machine.wire
    k = wire.youngs_modulus_pa * wire.effective_area_m2 / wire.segment_length_m
    expected = math.sqrt(2.0 * k / (machine.carriage.mass_kg + payload)) / (2.0 * math.pi)
    kick = torque(lambda t: 2e9 if t < 0.1 else (-2e9 if t < 0.2 else 0.0))
    run = move(machine, payload, 9.0, kick, 4.0, step_s=0.004, record_every=1).run
    after = run.time_s > 0.5
    pull = run["tension_drum_n"][after] - np.mean(run["tension_drum_n"][after])
    turns = np.flatnonzero((pull[:-1] < 0.0) & (pull[1:] >= 0.0))
    crossings = run.time_s[after][turns] + 0.004 * pull[turns] / (pull[turns] - pull[turns + 1])
    assert 1.0 / np.mean(np.diff(crossings)) == pytest.approx(expected, rel=2e-3)


def energy(machine: Hoist, payload: float, result: MotionResult) -> Array:
    """Kinetic, of height and elastic energy, J, of a machine whose wire weighs nothing; without the arm's own swing."""
    run, wire = result.run, machine.wire
    m = machine.carriage.mass_kg + payload
    k = wire.youngs_modulus_pa * wire.effective_area_m2 / wire.segment_length_m
    J = machine.motor.count * machine.motor.rotor_inertia_kg_m2 + machine.winch.inertia_kg_m2 / machine.gearbox.ratio**2
    v = run["speed_carriage_m_s"]
    sheave = machine.sheave.inertia_kg_m2 * (2.0 * v / machine.sheave.diameter_m) ** 2
    kinetic = 0.5 * (J * run["speed_motor_rad_s"] ** 2 + m * v**2 + sheave)
    elastic = (run["tension_drum_n"] ** 2 + run["tension_dead_line_n"] ** 2) / (2.0 * k)
    return kinetic + elastic + m * machine.gravity_m_s2 * run["position_carriage_m"]


def work(result: MotionResult) -> Array:
    """Of the motors since the start, J; the torque of a record is that of the step after it."""
    run = result.run
    turned = np.diff(run["angle_motor_rad"])
    return np.concatenate([[0.0], np.cumsum(run["torque_motor_nm"][:-1] * turned)])


def test_without_losses_the_motors_work_is_the_energy():
    result = move(LOSSLESS, 4500.0, 6.0, torque(lambda t: 25.0 * math.sin(1.5 * t)), 4.0, step_s=0.002, record_every=1)
    stored, done = energy(LOSSLESS, 4500.0, result), work(result)
    exchanged = np.max(done) - np.min(done)
    assert exchanged > 1e4
    assert np.max(np.abs(stored - stored[0] - done)) < 2e-3 * exchanged


def test_what_friction_takes_is_missing_from_the_energy():
    rough = with_values(LOSSLESS, {"guide.coulomb_hoisting_n": 6000.0, "guide.coulomb_lowering_n": 4500.0})
    result = move(rough, 4500.0, 6.0, torque(lambda t: 60.0 * math.sin(1.5 * t)), 4.0, step_s=0.002, record_every=1)
    run = result.run
    stored, done = energy(rough, 4500.0, result), work(result)
    lost = np.concatenate(
        [[0.0], np.cumsum(0.5 * np.diff(run.time_s) * _pairs(run["force_guide_n"] * run["speed_carriage_m_s"]))]
    )
    assert lost[-1] > 5e2 and np.min(np.diff(lost)) > -1.0
    assert np.max(np.abs(stored - stored[0] - done + lost)) < 5e-3 * (np.max(done) - np.min(done))


def _pairs(values: Array) -> Array:
    return values[1:] + values[:-1]


def test_the_motor_speed_converges_with_the_step():
    """Towards that at 1 ms; at the step that studies use it is there within 1e-3 of nominal."""

    def run(step: float) -> Array:
        drive = torque(lambda t: 60.0 * math.sin(1.2 * t))
        return move(MACHINE, 4500.0, 9.0, drive, 2.0, step_s=step, record_every=round(0.04 / step)).run[
            "speed_motor_rad_s"
        ]

    finest = run(0.001)
    off = {
        step: float(np.max(np.abs(run(step) - finest))) / MACHINE.motor.nominal_speed_rad_s
        for step in (0.008, 0.004, 0.002)
    }
    assert off[0.002] < off[0.004] < off[0.008]
    assert off[0.002] < 1e-5 and off[0.008] < 1e-3


def test_roller_friction_grows_with_payload_and_reach():
    def friction(payload: float, reach: float) -> tuple[float, float]:
        machine = with_values(SMOOTH, {"arm.reach_m": reach})
        run = move(
            machine, payload, 6.0, regulated(30.0), 3.0, step_s=0.004, switches=Switches(roller_friction=0.01)
        ).run
        normal = np.sum([np.abs(run[name]) for name in run.signals if name.startswith("force_roller")], axis=0)
        late = run.time_s > 2.0
        v = run["speed_carriage_m_s"][late]
        switch = 2.0 / math.pi * np.arctan(MACHINE.guide.atan_slope_s_per_m * v)
        assert run["force_guide_n"][late] == pytest.approx(0.01 * normal[late] * switch, rel=1e-3)
        return float(np.mean(run["force_guide_n"][late])), float(np.mean(normal[late]))

    near, far, heavy = friction(4500.0, 1.5), friction(4500.0, 3.0), friction(9000.0, 3.0)
    assert near[0] < far[0] < heavy[0]
    assert near[1] < far[1] < heavy[1]


@pytest.mark.parametrize("bristle", [0.0, 3e-4])
def test_in_motion_the_guides_friction_is_its_coulomb_level(bristle: float):
    run = move(MACHINE, 4500.0, 6.0, regulated(60.0), 4.0, step_s=0.004, switches=Switches(bristle_m=bristle)).run
    assert run["force_guide_n"][-1] == pytest.approx(MACHINE.guide.coulomb_hoisting_n, rel=0.02)


@pytest.mark.parametrize(
    ("effect", "more_n"),
    [
        ({"friction_step": {"level_n": 900.0, "position_m": 6.2, "width_m": 0.01}}, lambda v: 900.0),
        ({"friction_step": {"level_n": 900.0, "position_m": 16.0, "width_m": 0.01}}, lambda v: 0.0),
        ({"friction_periodic": {"amplitude_n": 800.0, "period_m": 1e6, "phase_rad": math.pi / 2.0}}, lambda v: 400.0),
        ({"friction_quadratic": {"drag_n_s2_per_m2": 5000.0}}, lambda v: 5000.0 * v * v),
    ],
)
def test_an_effect_of_the_guide_acts_as_the_library_says(effect: dict[str, Any], more_n: Callable[[float], float]):
    machine = MACHINE.model_copy(update={"effects": effect})
    run = move(machine, 4500.0, 6.0, regulated(60.0), 4.0, step_s=0.004).run
    v = float(run["speed_carriage_m_s"][-1])
    expected = machine.guide.coulomb_hoisting_n * 2.0 / math.pi * math.atan(machine.guide.atan_slope_s_per_m * v)
    assert run["force_guide_n"][-1] == pytest.approx(expected + more_n(v), rel=2e-3)


def test_bristles_hold_the_load_where_it_rests():
    """A little torque more bends them and moves nothing; without bristles the carriage creeps off."""

    def crept(switches: Switches) -> float:
        run = move(MACHINE, 4500.0, 6.0, torque(lambda t: 8.0 * min(t, 1.0)), 4.0, step_s=0.004, switches=switches).run
        half, end = np.interp([2.0, 4.0], run.time_s, run["position_carriage_m"])
        return float(abs(end - half))

    assert crept(Switches(bristle_m=3e-4)) < 0.05 * crept(Switches())


def test_gear_loss_and_brake_take_their_torque():
    def held(switches: Switches, brake: float = 0.0) -> float:
        def start(hold: float) -> Driven:
            inner = regulated(40.0)(hold)
            return lambda shaft, until: (inner(shaft, until)[0], brake)

        return float(move(SMOOTH, 4500.0, 6.0, start, 4.0, step_s=0.004, switches=switches).run["torque_motor_nm"][-1])

    plain = held(Switches())
    assert held(Switches(gear_loss=0.05)) == pytest.approx(1.05 * plain, rel=2e-3)
    assert held(Switches(), 30.0) == pytest.approx(plain + 30.0, rel=2e-3)


def test_a_wire_pulls_and_never_pushes():
    run = move(MACHINE, 0.0, 9.0, torque(lambda t: -20000.0), 0.5, step_s=0.002).run
    assert np.min(run["tension_min_n"]) < 100.0  # the drum outruns the carriage
    assert np.min(run["tension_min_n"]) > -1.0
    fallen = 9.0 - run["position_carriage_m"]
    assert np.all(fallen <= 0.5 * MACHINE.gravity_m_s2 * run.time_s**2 * 1.001 + 1e-9)  # falls, and is not thrown


def test_a_motion_that_does_not_converge_ends_with_time_and_state():
    result = move(MACHINE, 4500.0, 9.0, torque(lambda t: math.nan if t > 0.1 else 0.0), 0.2, step_s=0.004)
    assert result.outcome is Outcome.DIVERGED
    assert "height 9.000 m" in result.at and "motor speed" in result.at


def test_an_arm_too_soft_for_its_load_ends_at_once_with_height_and_payload():
    soft = with_values(MACHINE, {"arm.roller_stiffness_n_per_m": 2e4})
    result = move(soft, 4500.0, 8.0, torque(lambda t: 0.0), 1.0)
    assert result.outcome is Outcome.NO_EQUILIBRIUM and len(result.run.time_s) == 0
    assert "at height 8.000 m with 4500 kg" in result.at


def test_heave_weighs_on_the_wire():
    """At rest under a stiff loop the tension swings with the platform's acceleration A w²."""
    heave = Switches(heave_m=0.3, heave_rad_s=1.0)
    run = move(MACHINE, 9000.0, 9.0, regulated(0.0), 13.0, step_s=0.005, switches=heave).run
    swing = np.ptp(run["tension_dead_line_n"][run.time_s > 6.5]) / 2.0
    mass = (MACHINE.carriage.mass_kg + 9000.0) / 2.0
    assert swing == pytest.approx(mass * 0.3, rel=0.15)


# What becomes of the wire's swing without any friction or damping: nothing is lost but to the speed controller.


UNDAMPED = {
    "wire.damping_time_s": 0.0, "bearing.pin_friction_coefficient": 0.0, "guide.coulomb_hoisting_n": 0.0,
    "guide.coulomb_lowering_n": 0.0, "arm.roller_damping_time_s": 0.0, "arm.cylinder_damping_time_s": 0.0,
}  # fmt: skip
SWINGING = wb.with_values(wb.default_hoist(), UNDAMPED)
KP, KI, PAYLOAD, HEIGHT, STEP = 31.0, 122.0, 9000.0, 10.0, 0.001


def kept_per_cycle(gains: tuple[float, float], push_nm: float) -> np.ndarray:
    """From one turning point of the drum's tension to the next but one, after a push of the motors for 0.1 s.

    The sheave's own swing at 37.9 Hz is averaged out; the wire's is at 2.1 Hz, 2.2 Hz with the motor free.
    """

    def drive(hold_nm: float) -> Driven:
        integral = 0.0

        def torque(shaft: Shaft, until_s: float) -> tuple[float, float]:
            nonlocal integral
            integral -= gains[1] * STEP * shaft.speed_rad_s
            push = push_nm if shaft.time_s < 0.1 else -push_nm if shaft.time_s < 0.2 and gains[0] == 0.0 else 0.0
            return hold_nm - gains[0] * shaft.speed_rad_s + integral + push, 0.0

        return torque

    run = move(SWINGING, PAYLOAD, HEIGHT, drive, 4.0, step_s=STEP, record_every=1, reactions_every=0).run
    width = round(1.0 / 37.9 / STEP)
    smooth = np.convolve(run.signals["tension_drum_n"], np.ones(width) / width, "same")
    smooth = smooth[(run.time_s > 0.4) & (run.time_s < 3.9)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(smooth)))) + 1
    swings = np.abs(np.diff(smooth[turns]))
    swings = swings[swings > 0.02 * swings.max()]
    return swings[2:] / swings[:-2]


def test_under_an_even_torque_no_swing_is_lost():
    """The integrator and the rails take nothing: 14 J of swing, which an energy balance over kilojoules would not see.
    The swing of the pipe on the arm beats with it, some 2 % to and fro."""
    kept = kept_per_cycle((0.0, 0.0), 60.0)
    assert len(kept) >= 8
    assert np.all(np.abs(kept - 1.0) < 0.03)
    assert np.exp(np.mean(np.log(kept))) == pytest.approx(1.0, abs=0.005)


def test_under_the_speed_controller_it_loses_what_the_linear_loop_says():
    loop = wb.loop(
        SWINGING, wb.PiSettings(kp_nm_s_per_rad=KP, ki_nm_per_rad=KI), payloads_kg=[PAYLOAD], heights_m=[HEIGHT]
    )
    s = np.log(loop.closed.poles().astype(complex)) / STEP
    (swing,) = (pole for pole in s if 8.0 < pole.imag < 20.0)
    predicted = math.exp(2.0 * math.pi * swing.real / swing.imag)
    kept = kept_per_cycle((KP, KI), 200.0)[:4]
    assert predicted == pytest.approx(0.595, abs=0.005)
    assert np.mean(kept) == pytest.approx(predicted, abs=0.03)


# What the multi-body package may know, and what it says where it cannot work.


OWN = ("workbench.core.", "workbench.machines.multibody.")
PACKAGE = Path(__file__).resolve().parents[2] / "workbench" / "machines" / "multibody"


def test_it_shares_no_equation_with_the_lumped_plant():
    allowed = {
        "workbench.core.errors.InputError",
        "workbench.core.run.Array",
        "workbench.core.run.Run",
        "workbench.machines.Hoist",
    }
    for module in sorted(PACKAGE.glob("*.py")):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            names = [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                if name.startswith("workbench") and not name.startswith(OWN):
                    assert name in allowed, f"{module.name}: {name}"


def test_importing_it_does_not_load_the_engine():
    code = "import sys, workbench.machines.multibody; print([m for m in sys.modules if m == 'exudyn'])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PACKAGE.parents[2], capture_output=True, text=True, check=True
    )
    assert ast.literal_eval(done.stdout) == []


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    engine.cache_clear()
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(InputError, match=r"pip install '\.\[multibody\]'"):
        engine()
    engine.cache_clear()


@pytest.mark.parametrize("name", sorted(_EFFECTS))
def test_an_effect_is_taken_under_the_librarys_names(name: str):
    parameters = {parameter.named("hoist") for parameter in find(name, "hoist").parameters}
    assert set(_EFFECTS[name]) == parameters
    values = dict.fromkeys(parameters, 0.125)
    changed = switches_of(MACHINE.model_copy(update={"effects": {name: values}}))
    fields = {field for parameter in parameters for field in _EFFECTS[name][parameter]}
    assert all(getattr(changed, field) == 0.125 for field in fields)


@pytest.mark.parametrize(
    ("update", "said"),
    [
        ({"effects": {"friction_viscos": {}}}, "did you mean 'friction_viscous'"),
        ({"effects": {"backlash": {"play_rad": 0.01}}}, "has no effect 'backlash'"),
        ({"effects": {"heave": {"amplitude": 0.1}}}, "did you mean 'amplitude_m'"),
        ({"measured_correction": object()}, "no measured correction"),
    ],
)
def test_what_it_does_not_know_is_one_clear_error(update: dict[str, object], said: str):
    with pytest.raises(InputError, match=said):
        switches_of(MACHINE.model_copy(update=update))
