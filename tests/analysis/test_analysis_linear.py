"""The linear loop of a hoist and of an axis: the derivative of the compiled one, margins, effects, closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import control
import numpy as np
import pytest

from tests.support.axes import CASCADE, emps, followed, ideal_axis, two_inertia
from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OUTPUTS, STIFFNESS_BY_LENGTH, LinearPlant, OperatingPoint, linearise
from workbench.analysis.loop import (
    LinearLoop,
    Sampled,
    linear_controller,
    linear_loop,
    load_step,
    position_answer,
    sampled_plant,
)
from workbench.analysis.margins import Margins, family, margins, operating_points, weakest
from workbench.analysis.tune import Goal, tune
from workbench.analysis.usual import usual_cascade
from workbench.control import FeedForward, LinearCascade, Notch, PiSettings
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects import effects_for, sizes_of
from workbench.machines import HOIST, Effects, Hoist, Memory, with_values
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.study.loop_design import loop_case

PAYLOADS = (0.0, 4500.0, 9000.0)


def with_drive(base: Hoist | None = None, **drive: float) -> Hoist:
    return with_values(base or ideal_hoist(), {f"drive.{key}": value for key, value in drive.items()})


def oscillation(plant: LinearPlant) -> tuple[float, float]:
    """(Hz, damping ratio) of the slowest oscillating mode."""
    s = min((e for e in np.linalg.eigvals(plant.A) if e.imag > 0.0), key=abs)
    return abs(s) / (2.0 * np.pi), -s.real / abs(s)


@pytest.mark.parametrize("motion", ["hoisting", "lowering", "at_rest"])
@pytest.mark.parametrize("payload", PAYLOADS)
def test_the_linear_plant_is_the_finite_difference_of_the_plant(payload: float, motion: Any):
    plant = linearise(ideal_hoist(), OperatingPoint(payload, 10.0, motion), height_free=True)
    p = HOIST.plant.values(ideal_hoist(), payload)
    q0, y0, u0 = plant.start
    _, even, _ = HOIST.plant.start_of(10.0, 1.0, p)
    T = np.eye(6)
    T[:2, 2] = np.array(even[:2]) / even[2]  # back from relative positions

    def rates(x: np.ndarray, u: float) -> np.ndarray:
        dx = T @ x
        q, y = list(q0 + dx[:3]), list(y0 + dx[3:])
        shown = HOIST.plant.outputs(0.0, q, y, u, p)
        rest = [shown[name] for name in OUTPUTS]
        return np.array([*np.linalg.solve(T[:3, :3], dx[3:]), *HOIST.plant.accelerations(0.0, q, y, u, p), *rest])

    # Steps of each state's own size; at rest one-sided, to the side the model takes at standstill.
    sizes = np.array([1e-3, 1e-4, 1e-3, 1e-6, 1e-7, -1e-8 if motion == "at_rest" else 1e-6])
    for i, h in enumerate(sizes):
        e = np.zeros(6)
        e[i] = h
        sided = motion == "at_rest" and i == 5
        slope = (rates(e, u0) - rates(-e, u0)) / (2.0 * h) if not sided else (rates(e, u0) - rates(0.0 * e, u0)) / h
        expected = np.concatenate([plant.A[:, i], plant.C[: len(OUTPUTS), i]])
        np.testing.assert_allclose(slope, expected, rtol=2e-4, atol=2e-4 * max(1.0, np.abs(expected).max()))
    gain = (rates(np.zeros(6), u0 + 1.0) - rates(np.zeros(6), u0))[:6]
    np.testing.assert_allclose(gain, plant.B[:, 0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("payload", "hz", "zeta"), [(0.0, 3.10, 0.97), (4500.0, 2.55, 0.80), (9000.0, 2.24, 0.70)])
def test_the_carriage_on_the_wire_with_a_free_motor_is_that_of_the_model_page(payload: float, hz: float, zeta: float):
    hz_and_zeta = oscillation(linearise(ideal_hoist(), OperatingPoint(payload, 10.0)))
    assert hz_and_zeta == pytest.approx((hz, zeta), abs=0.006)


def test_the_height_makes_one_slow_unstable_mode_and_nothing_else_where_a_loop_works():
    point = OperatingPoint(0.0, 10.0)
    free = linearise(ideal_hoist(), point, height_free=True)
    frozen = linearise(ideal_hoist(), point)
    assert np.linalg.eigvals(free.A).real.max() == pytest.approx(0.025, abs=0.001)
    assert np.linalg.eigvals(frozen.A).real.max() < 0.0
    f = np.geomspace(0.1, 400.0, 50)
    a, b = (sampled_plant(plant, 0.001, ideal_hoist().drive).response(f)[:, 0, 0] for plant in (free, frozen))
    np.testing.assert_allclose(a, b, rtol=2.5e-3)
    np.testing.assert_allclose(a[f > 1.0], b[f > 1.0], rtol=3e-5)


def test_a_wire_as_stiff_as_its_free_length_moves_the_mode_by_the_root_of_the_stiffness():
    held = with_values(ideal_hoist(), {"motor.rotor_inertia_kg_m2": 1e6, "wire.damping_time_s": 0.02})
    short = linearise(held, OperatingPoint(9000.0, 15.0), effects=STIFFNESS_BY_LENGTH)
    whole = linearise(held, OperatingPoint(9000.0, 15.0))
    assert oscillation(short)[0] / oscillation(whole)[0] == pytest.approx(np.sqrt(25.0 / 10.0), rel=2e-3)


WEIGHTED = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, set_point_weight=0.4)


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.001, 0.0375, 0.2])
def test_a_delay_is_the_same_as_a_factor_over_frequency_and_as_states(delay_s: float):
    linear = linear_controller(WEIGHTED, with_drive(speed_filter_s=0.003, speed_delay_s=delay_s))
    f = np.geomspace(0.01, 500.0, 7)
    as_states = Sampled(linear.A, linear.B, linear.C, linear.D, linear.dt).response(f)
    np.testing.assert_allclose(linear.response(f), as_states, rtol=1e-9)
    assert len(linear.A) == 2 + math.ceil(delay_s / 0.001)


def test_the_response_on_a_pole_of_the_circle_is_a_large_number_and_no_error():
    """An undamped swing whose frequency is one of the grid's: a study of a pendulum without friction ended there."""
    swing = Sampled(np.array([[1.0]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), 1e-3)
    assert 1e9 < abs(swing.response(np.array([0.0, 10.0]))[0, 0, 0]) < 1e15
    near = swing.response(np.array([10.0]))
    assert swing.response(np.array([0.0, 10.0]))[1] == pytest.approx(near[0], rel=1e-9)


def test_the_design_of_a_loop_refuses_more_samples_of_delay_than_it_can_bear():
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=1e-4)
    with pytest.raises(InputError, match=r"drive.speed_delay_s: 0.05 s are 500 samples of the controller; .* most 200"):
        linear_controller(settings, with_drive(speed_delay_s=0.05))


# Margins against a brute grid, against python-control, and against what they promise: where the loop falls over.


PI = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)


SLOW_DRIVE = with_drive(torque_lag_s=0.004, speed_filter_s=0.003, speed_delay_s=0.0025)
LIGHTLY_DAMPED = with_values(ideal_hoist(), {"wire.damping_time_s": 0.004})
# name -> arguments of `linear_loop`
LOOPS = {
    "ideal drive": (ideal_hoist(), PI, OperatingPoint(0.0, 10.0)),
    "slow drive": (SLOW_DRIVE, PI, OperatingPoint(9000.0, 2.0, "lowering")),
    "fast gains": (
        SLOW_DRIVE,
        PiSettings(sample_time_s=0.002, kp_nm_s_per_rad=90.0, ki_nm_per_rad=900.0),
        OperatingPoint(4500.0, 20.0),
    ),
    "at rest": (SLOW_DRIVE, PI, OperatingPoint(9000.0, 10.0, "at_rest")),
    "light damping": (LIGHTLY_DAMPED, PI, OperatingPoint(9000.0, 10.0)),
    "notch": (
        with_drive(LIGHTLY_DAMPED, speed_delay_s=0.004),
        PiSettings(
            kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, notch=Notch(frequency_hz=2.2, depth=0.3), low_pass_hz=80.0
        ),
        OperatingPoint(9000.0, 10.0),
    ),
}


@cache
def made_loop(name: str) -> LinearLoop:
    return linear_loop(*LOOPS[name])


@pytest.fixture
def loop(request: pytest.FixtureRequest) -> LinearLoop:
    return made_loop(request.param)


each_loop = pytest.mark.parametrize("loop", LOOPS, indirect=True)


@each_loop
def test_every_margin_agrees_with_a_dense_grid(loop: LinearLoop):
    computed = margins(loop)
    f = np.unique(np.concatenate([np.geomspace(1e-3, loop.nyquist_hz, 60_000), np.linspace(0.3, 4.0, 20_000)]))
    L = np.concatenate([loop.open_response(part) for part in np.array_split(f, 20)])
    S, T = 1.0 / (1.0 + L), L / (1.0 + L)
    assert computed.ms == pytest.approx(np.abs(S).max(), rel=2e-6)
    assert computed.mt == pytest.approx(np.abs(T).max(), rel=2e-6)
    assert computed.disk == pytest.approx(2.0 / np.abs(S - T).max(), rel=2e-6)
    assert computed.bandwidth_hz == pytest.approx(f[np.argmax(np.abs(T) < math.sqrt(0.5))], rel=4e-4)

    over = np.flatnonzero(np.diff(np.sign(np.log(np.abs(L)))) != 0)
    lag = np.degrees(np.angle(-L[over])) % 360.0
    assert computed.phase_deg == pytest.approx(np.minimum(lag, 360.0 - lag).min(), abs=0.05)
    assert computed.delay_s == pytest.approx((lag / 360.0 / f[over]).min(), rel=1e-3)

    axis = np.flatnonzero(np.diff(np.sign(L.imag[:-1])) != 0)
    gains = [-1.0 / L[k].real for k in [*axis, len(f) - 1] if L[k].real < 0.0]
    assert computed.gain_up == pytest.approx(min((g for g in gains if g >= 1.0), default=math.inf), rel=1e-3)
    assert computed.gain_down == pytest.approx(max((g for g in gains if g < 1.0), default=0.0), rel=1e-3)


def with_gain(loop: LinearLoop, factor: float) -> LinearLoop:
    controller = replace(loop.controller, C=loop.controller.C * factor, D=loop.controller.D * factor)
    return replace(loop, controller=controller)


@each_loop
def test_the_loop_falls_over_at_its_gain_margin_and_not_before(loop: LinearLoop):
    computed = margins(loop)
    assert computed.stable
    if math.isfinite(computed.gain_up):
        assert with_gain(loop, 0.999 * computed.gain_up).stable
        assert not with_gain(loop, 1.001 * computed.gain_up).stable
    if computed.gain_down > 0.0:
        assert not with_gain(loop, 0.999 * computed.gain_down).stable
    assert with_gain(loop, max(1.001 * computed.gain_down, 1e-3)).stable


@pytest.mark.parametrize("payload", [0.0, 9000.0])
def test_the_loop_falls_over_at_its_delay_margin_and_not_before(payload: float):
    point = OperatingPoint(payload, 10.0)
    margin = margins(linear_loop(SLOW_DRIVE, PI, point)).delay_s
    more = SLOW_DRIVE.drive.speed_delay_s + margin
    for factor, stable in ((0.985, True), (1.015, False)):
        # Whole samples: between two of them the interpolation takes amplitude too.
        late = round(more * factor, 3)
        assert linear_loop(with_drive(SLOW_DRIVE, speed_delay_s=late), PI, point).stable is stable


def test_a_machine_that_runs_away_has_a_lower_gain_margin_and_falls_over_there():
    pushing = Effects({"guide_force_n": [lambda s, p: 2e5 * s.v]})  # friction of the wrong sign
    loop = linear_loop(SLOW_DRIVE, PI, OperatingPoint(9000.0, 10.0), effects=pushing)
    assert np.abs(loop.plant.poles()).max() > 1.0
    computed = margins(loop)
    assert 0.0 < computed.gain_down < 1.0
    assert with_gain(loop, 1.001 * computed.gain_down).stable
    assert not with_gain(loop, 0.999 * computed.gain_down).stable


@each_loop
def test_python_controls_systems_are_the_same_loop(loop: LinearLoop):
    L, S, closed = loop.systems()
    f = np.geomspace(0.05, 0.99 * loop.nyquist_hz, 40)
    z = np.exp(2j * np.pi * f * loop.dt)
    np.testing.assert_allclose(L(z), loop.open_response(f), rtol=1e-6)
    np.testing.assert_allclose(S(z), loop.responses(f).S, rtol=1e-6)
    assert closed.dt == loop.dt
    ours, theirs = np.sort(np.abs(loop.poles())), np.sort(np.abs(closed.poles()))
    np.testing.assert_allclose(ours, theirs, atol=1e-7)


# The linear loop of a machine with effects: closed forms, what is on the log stays out, off is exactly off.


POINT = OperatingPoint(4500.0, 10.0)
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
SENSORS = ("torque_scale", "torque_offset", "torque_filter", "speed_delay")
INERTIA = 1.656  # kg m², drive and drum of the default machine at the motor shaft


def with_effects(**effects: dict[str, float]) -> Hoist:
    return ideal_hoist().model_copy(update={"effects": effects})


def at_start(name: str, *, off: bool) -> Hoist:
    """The default machine with one effect where a fit begins, or exactly off."""
    ranges = effects_for("hoist")[name].ranges(sizes_of(ideal_hoist()))
    gone = {r.name: r.start if r.vanishes_at is None else r.vanishes_at for r in ranges}
    return with_effects(**{name: gone if off else {r.name: r.start for r in ranges}})


def element(plant: LinearPlant, of_state: str, by: str) -> float:
    return float(plant.A[plant.states.index(of_state), plant.states.index(by)])


def margins_of(machine: Hoist, settings: PiSettings = SETTINGS) -> Margins:
    return margins(linear_loop(machine, settings, POINT))


@pytest.mark.parametrize("motion", ["hoisting", "lowering", "at_rest"])
@pytest.mark.parametrize("name", effects_for("hoist"))
def test_an_effect_that_vanishes_leaves_the_linear_plant_bit_for_bit(name: str, motion: Any):
    plain, gone = (
        linearise(machine, OperatingPoint(4500.0, 10.0, motion))
        for machine in (ideal_hoist(), at_start(name, off=True))
    )
    assert gone.states == plain.states
    for matrix in "ABC":
        np.testing.assert_array_equal(getattr(gone, matrix), getattr(plain, matrix))


@pytest.mark.parametrize("name", SENSORS)
def test_an_effect_on_a_sensor_leaves_the_margins_bit_for_bit(name: str):
    assert margins_of(at_start(name, off=False)) == margins_of(ideal_hoist())


@pytest.mark.parametrize("more", [0.2, 0.8])
def test_gearbox_inertia_lowers_the_crossover_in_proportion_to_the_inertia(more: float):
    # Far above the wire's 2.5 Hz the motor turns alone: |L| = kp / (J w), so the crossover is kp / (2 pi J).
    stiff = SETTINGS.model_copy(update={"kp_nm_s_per_rad": 300.0})
    heavier = with_effects(gearbox_inertia={"inertia_kg_m2": more})
    before, after = margins_of(ideal_hoist(), stiff), margins_of(heavier, stiff)
    plain = linearise(ideal_hoist(), POINT)
    assert 1.0 / plain.B[plain.states.index("speed_motor_rad_s"), 0] == pytest.approx(INERTIA, rel=1e-3)
    assert after.crossover_hz == pytest.approx(300.0 / (2.0 * math.pi * (INERTIA + more)), rel=0.01)
    assert before.crossover_hz / after.crossover_hz == pytest.approx(1.0 + more / INERTIA, rel=0.005)


def lagging(tau: float) -> Effects:
    """Friction of 6000 N s/m on a carriage speed that is late by a first-order lag."""
    memory = Memory(
        "late_speed", lambda s, p: (s.speed_carriage_m_s - p.late_speed) / tau, lambda p: 0.0, lambda p: 1.0
    )
    return Effects({"guide_force_n": [lambda s, p: -(6000.0 * p.late_speed)]}, (), [memory])


def test_a_memory_that_the_motion_moves_is_a_state_of_the_loop():
    mass, tau = ideal_hoist().carriage.mass_kg + 4500.0, 0.2
    plant = linearise(ideal_hoist(), POINT, effects=lagging(tau))
    assert plant.states[-1] == "late_speed"
    assert element(plant, "late_speed", "speed_carriage_m_s") == pytest.approx(1.0 / tau)
    assert element(plant, "late_speed", "late_speed") == pytest.approx(-1.0 / tau)
    assert element(plant, "speed_carriage_m_s", "late_speed") == pytest.approx(-6000.0 / mass)
    assert plant.start[1][-1] == pytest.approx(plant.start[1][2])  # settled at the even speed


# The linear loop against the compiled one: a small step on top of a slow even motion, and how it dies out.


HEIGHT, EVEN, STEP = 6.0, 78.55, 0.4  # m, rad/s: half of nominal, and a step far below every limit
RAMP, BEFORE, AFTER = 4.0, 8.0, 1.5  # s


CASES = {
    "ideal drive": (with_drive(), PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)),
    "set-point weight": (with_drive(), PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=250.0, set_point_weight=0.5)),
    "torque lag": (with_drive(torque_lag_s=0.004), PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)),
    "counted speed": (
        # So finely that what is seen is the mean over a sample and not the counts.
        with_drive(encoder_counts_per_turn=100_000_000, torque_lag_s=0.002),
        PiSettings(sample_time_s=0.002, kp_nm_s_per_rad=60.0, ki_nm_per_rad=500.0),
    ),
    "effects": (
        with_effects(
            gearbox_inertia={"inertia_kg_m2": 0.4},
            gearbox_efficiency={"loss_fraction": 0.05},
            friction_viscous={"viscous_n_s_per_m": 8000.0},
            carriage_mass_error={"mass_kg": 900.0},
            wire_mass={"mass_kg_per_m": 8.0},
            torque_scale={"gain": 1.2},  # on the log alone
            speed_delay={"delay_s": 0.05},
        ),
        PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    ),
    "another layer of wire": (
        # Passed long ago: the arm is larger by an eighth throughout.
        with_effects(drum_layer_change={"radius_step_m": 0.0375, "drum_angle_rad": -400.0}),
        PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    ),
    "everything": (
        with_drive(torque_lag_s=0.004, speed_filter_s=0.003, speed_delay_s=0.0035),
        PiSettings(
            sample_time_s=0.002,
            kp_nm_s_per_rad=45.0,
            ki_nm_per_rad=300.0,
            set_point_weight=0.8,
            low_pass_hz=60.0,
            notch=Notch(frequency_hz=3.0, depth=0.4),
            feed_forward=FeedForward(inertia=0.5, weight=1.0),
        ),
    ),
}


def deviation(machine: Hoist, settings: PiSettings, payload: float) -> dict[str, Array]:
    """What the step adds to the run: the difference of two compiled runs, from the step on, per rad/s."""
    t = np.arange(round((BEFORE + AFTER) / settings.sample_time_s)) * settings.sample_time_s
    even = EVEN * np.clip(t / RAMP, 0.0, 1.0)
    begun = t >= BEFORE - 1e-9
    runs = [
        result.run
        for result in simulate_loop(
            [
                LoopCase(name, machine, payload, HEIGHT - 1.0, settings, even + size * begun)
                for name, size in (("without", 0.0), ("with", STEP))
            ],
            record_every=1,
        )
    ]
    names = ("speed_motor_rad_s", "speed_carriage_m_s", "tension_drum_n")
    return {name: (runs[1][name] - runs[0][name])[begun] / STEP for name in names}


def by_the_linear_loop(loop: LinearLoop, n: int) -> Array:
    inputs = np.zeros((n, 3))
    inputs[:, 0] = 1.0
    return loop.closed.run(inputs)


@pytest.mark.parametrize("payload", [0.0, 9000.0])
@pytest.mark.parametrize(("machine", "settings"), CASES.values(), ids=CASES)
def test_a_small_step_of_the_compiled_loop_is_that_of_the_linear_one(machine, settings, payload):
    compiled = deviation(machine, settings, payload)
    loop = linear_loop(machine, settings, OperatingPoint(payload, HEIGHT), height_free=True)
    linear = by_the_linear_loop(loop, len(compiled["speed_motor_rad_s"]))
    for i, (name, values) in enumerate(compiled.items()):
        error = np.abs(values - linear[:, i]).max() / np.abs(linear[:, i]).max()
        assert error < 2e-3, (name, error)  # measured: at most 1.2e-3, in the tension


# The linear loop of an axis against closed forms and against python-control built by itself.


ORIGIN = OperatingPoint(0.0, 0.0)
DT = 0.001


def by_hand(
    mass: float, viscous: float, settings: LinearCascade, lag_s: float = 0.0, filter_s: float = 0.0, late: int = 0
):
    """The loop opened at the drive, from python-control alone: plant under a held force, filtered speed plus kv times
    position, both late, PI with the integral a sample behind."""
    continuous = control.ss([[-viscous / mass, 0.0], [1.0, 0.0]], [[1.0 / mass], [0.0]], np.eye(2), np.zeros((2, 1)))
    if lag_s:
        continuous = continuous * control.tf([1.0], [lag_s, 1.0])
    plant = control.c2d(control.ss(continuous), DT, "zoh")
    alpha = 1.0 - math.exp(-DT / filter_s) if filter_s else 1.0
    z = control.tf([1.0, 0.0], [1.0], DT)
    smooth = control.tf([alpha, 0.0], [1.0, alpha - 1.0], DT)
    pi = settings.kp + control.tf([settings.ki * DT], [1.0, -1.0], DT)
    speed, position = (control.tf(plant[i, 0]) for i in range(2))
    return pi * (smooth * speed + settings.kv_per_s * position) * z ** (-late)


@pytest.mark.parametrize("kv", [0.0, 17.5, 60.0])
def test_the_poles_are_those_of_python_control(kv: float):
    settings = CASCADE.model_copy(update={"kv_per_s": kv})
    loop = linear_loop(ideal_axis(friction__viscous_n_s_per_m=203.5), settings, ORIGIN)
    expected = control.feedback(control.minreal(by_hand(95.1089, 203.5, settings), verbose=False)).poles()
    found = np.array(sorted(loop.poles(), key=lambda p: (abs(p), p.imag)))
    cancelled = (1.0, math.exp(-203.5 / 95.1089 * DT))  # the plant's own, in each of the sum's two fractions
    expected = [p for p in expected if min(abs(p - c) for c in cancelled) > 1e-6]
    expected = np.array(sorted(expected, key=lambda p: (abs(p), p.imag)))
    assert len(expected) == (3 if kv else 2)
    np.testing.assert_allclose(found[-len(expected) :], expected, atol=1e-6)


def test_the_margins_are_those_of_python_control():
    """A drive with lag, filter and two samples of delay; an ideal encoder, which counts no mean."""
    drive = emps().drive.model_copy(update={"encoder_counts_per_m": 0, "speed_delay_s": 2 * DT, "torque_lag_s": 0.0008})
    machine = ideal_axis(friction__viscous_n_s_per_m=203.5).model_copy(update={"drive": drive})
    m = margins(linear_loop(machine, CASCADE, ORIGIN))
    L = by_hand(95.1089, 203.5, CASCADE, lag_s=0.0008, filter_s=0.001, late=2)
    f = np.geomspace(0.5, 499.0, 4_000)
    response = L(np.exp(2j * np.pi * f * DT))
    # On a grid: by the polynomials' roots rounding decides which crossings there are, another one on each processor.
    gain, phase, _, at_phase, at_gain, _ = control.stability_margins(control.frd(response, 2.0 * np.pi * f))
    assert m.stable
    assert m.gain_up == pytest.approx(gain, rel=1e-3)
    assert m.phase_deg == pytest.approx(phase, rel=1e-3)
    assert m.crossover_hz == pytest.approx(at_gain / (2.0 * np.pi), rel=1e-3)
    assert m.gain_up_hz == pytest.approx(at_phase / (2.0 * np.pi), rel=1e-3)
    assert m.ms == pytest.approx(np.max(np.abs(1.0 / (1.0 + response))), rel=1e-4)
    assert m.mt == pytest.approx(np.max(np.abs(response / (1.0 + response))), rel=1e-4)


def test_a_load_step_leaves_no_speed_and_no_place_with_an_integral():
    loop = linear_loop(emps(), CASCADE, ORIGIN)
    answer, speed = position_answer(loop), load_step(loop)
    assert answer is not None and answer.left < 1e-3 * answer.peak
    assert speed.peak_rad_s > 0.0 and speed.recovery_s < 1.0


def test_a_load_step_without_an_integral_leaves_the_load_over_kp_kv():
    settings = CASCADE.model_copy(update={"ki_n_per_m": 0.0})
    answer = position_answer(linear_loop(ideal_axis(), settings, ORIGIN))
    assert answer is not None
    assert answer.left == pytest.approx(1.0 / (settings.kp * settings.kv_per_s), rel=1e-3)


def test_the_linear_loop_is_the_compiled_one_for_a_small_motion():
    """Without friction all is linear: the exact linear loop driven by the same references gives the same force."""
    plan = plan_motion("ruckig", [Step(by_m=1e-3)], 0.0, Limits(0.01, 0.5, 20.0), (-np.inf, np.inf), 0.05, 0.3)
    drive = emps().drive.model_copy(update={"encoder_counts_per_m": 0})
    machine = ideal_axis().model_copy(update={"drive": drive})
    run, profile = followed(machine, CASCADE, plan).run, plan.sample(DT)
    loop = linear_loop(machine, CASCADE, ORIGIN)
    zeros = np.zeros((len(profile.time_s), 2))
    out = loop.closed.run(np.column_stack([profile.position_m, profile.speed_m_s, zeros]))
    shown = dict(zip(loop.shown, out.T, strict=True))
    np.testing.assert_allclose(run["position_m"], shown["position_m"], atol=1e-9)
    np.testing.assert_allclose(run["velocity_m_s"], shown["velocity_m_s"], atol=1e-8)


def test_moving_an_axis_shows_its_viscous_friction_at_rest_its_standstill_slope():
    moving, still = (linearise(emps(), OperatingPoint(0.0, 0.0, way)) for way in ("hoisting", "at_rest"))
    M, B = emps().mass_kg, emps().friction.viscous_n_s_per_m
    assert moving.A[-1, -1] == pytest.approx(-B / M)
    slope = emps().friction.coulomb_forward_n / emps().friction.standstill_speed_m_s
    assert still.A[-1, -1] == pytest.approx(-(B + slope) / M)


def test_a_sine_load_is_a_spring_that_changes_its_sign_over_half_a_turn():
    axis = two_inertia(load__gravity__sine_nm=1.5)
    stiff = [linearise(axis, OperatingPoint(0.0, at), height_free=True).A[-1, 0] for at in (0.0, np.pi)]
    assert stiff[0] == pytest.approx(-1.5 / 0.003, rel=1e-6) == -stiff[1]


def test_a_coupling_s_resonance_and_anti_resonance_are_the_plant_s():
    plant = linearise(two_inertia(), ORIGIN)
    f = np.abs(np.linalg.eigvals(plant.A).imag).max() / (2.0 * np.pi)
    assert f == pytest.approx(math.sqrt(20.0 * (1 / 0.002 + 1 / 0.003)) / (2.0 * np.pi), rel=1e-3)
    case = loop_case(two_inertia(), None, None, None, None)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    with pytest.raises(InputError, match=r"anti-resonance at 13 Hz .* swings on its coupling"):
        tune(case.machine, case.settings, points, case.trial(), Goal(40.0))


def test_the_controller_by_rule_is_stable_on_every_axis_with_a_sound_ms():
    for machine in (emps(), ideal_axis(), two_inertia(), two_inertia(coupling__stiffness_nm_per_rad=2.0)):
        points = operating_points(machine, (0.0,), (0.0,))
        worst = weakest(family(machine, usual_cascade(machine), points)).margins
        assert worst.stable and worst.ms < 2.0


def test_a_tuned_axis_has_the_bandwidth_asked_for_and_names_what_forbids_more():
    case = loop_case(emps(), CASCADE, None, None, None)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    tuned = tune(case.machine, case.settings, points, case.trial(), Goal(15.0))
    assert isinstance(tuned.winner.settings, LinearCascade)
    assert 14.9 < tuned.winner.bandwidth_hz < 15.8 and tuned.winner.ms < 1.4
    assert tuned.winner.settings.kv_per_s == CASCADE.kv_per_s
    with pytest.raises(InputError, match=r"200 Hz is out of reach.*phase is lost to the speed delay"):
        tune(case.machine, case.settings, points, case.trial(), Goal(200.0))
    # Where friction holds the speed as firmly as so slow a loop, there is a gap between the slowest and the next.
    with pytest.raises(InputError, match=r"the nearest that can be had is about 4\.\d Hz, the widest is 34\.\d Hz"):
        tune(case.machine, case.settings, points, case.trial(), Goal(4.0))
