"""Each effect acts at its place with the right sign and size, by closed forms; loop and balance agree on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support.effect_machines import MACHINES, linear_axis
from workbench.control import PiSettings
from workbench.core.run import Array, Run
from workbench.effects import effects_for, of
from workbench.effects.active import Chosen, logged
from workbench.engine import kernels
from workbench.engine.source import parameter_symbols, state_symbols
from workbench.machines import HOIST, PLANTS, Axis, Hoist, default_hoist, kind_of, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.driven import InverseSimulation, pooled_rms
from workbench.simulate.loop import LoopCase, PlantModel, simulate_loop
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import symbol

PAYLOAD, HEIGHT, T, SINCE = 4500.0, 9.0, 3.0, 120.0
MASS, INERTIA, LEVER = 12500.0, 2.0 * 0.8 + 55.0 / 31.0**2, 0.3 / 31.0
G = 9.81


def forces(effects: dict[str, dict[str, float]], v: float, w: float, slack: bool = False) -> SimpleNamespace:
    """Force on carriage (mass times acceleration) and torque on motor (inertia times acceleration) of the hoist.

    4500 kg at 9 m, motor and carriage at speeds w and v, 3 s into a run that began 120 s into its campaign.
    """
    model = PlantModel(HOIST.plant, of(MACHINES["hoist"], effects))
    p = model.values(MACHINES["hoist"], PAYLOAD, SINCE)
    q, hold = HOIST.plant.equilibrium(HEIGHT, p)
    th = q[0] - (2000.0 * slack)
    kept = [m.start(p) for m in model.effects.memory]
    states, speeds = state_symbols(HOIST.plant, model.effects)
    rates = HOIST.plant.rates(symbol("t"), states, speeds, symbol("u"), parameter_symbols(model.names), model.effects)
    at = dict(zip([x.args[0] for x in (*states, *speeds)], [th, q[1], HEIGHT, w, 0.0, v, *kept], strict=True))
    numbers = {f"p_{name}": getattr(p, name) for name in model.names}
    a = evaluate(rates[:3], {"t": T, "u": hold, **at, **numbers})
    return SimpleNamespace(carriage=MASS * a[2], motor=INERTIA * a[0], sheave=a[1], th=th, hold=hold, p=p)


def switch(v: float) -> float:
    return 2.0 / math.pi * math.atan(200.0 * v)


def wire_torque(s: SimpleNamespace, w: float) -> float:
    """Torque that wire and winch pin take at the motor; in equilibrium each fall carries the hold."""
    tension = s.hold / LEVER
    pin = 0.02 * (900.0 * G + tension) * 0.08 * min(1.0, w / 31.0 / 0.01)
    return s.hold + pin / 31.0


# effect -> values, and the force on the carriage at v = 0.2 m/s (hoisting) and at -0.2 m/s that they add
GUIDE: dict[str, tuple[dict[str, float], Callable[[float], float]]] = {
    "friction_viscous": ({"viscous_n_s_per_m": 4000.0}, lambda v: -4000.0 * v),
    "friction_viscous_asymmetric": (
        {"viscous_hoisting_n_s_per_m": 4000.0, "viscous_lowering_n_s_per_m": 1000.0},
        lambda v: -(4000.0 if v > 0.0 else 1000.0) * v,
    ),
    "friction_coulomb": ({"level_n": 1500.0}, lambda v: -1500.0 * switch(v)),
    "friction_coulomb_asymmetric": (
        {"level_hoisting_n": 1500.0, "level_lowering_n": -400.0},
        lambda v: -(1500.0 if v > 0.0 else -400.0) * switch(v),
    ),
    "friction_stribeck": (
        {"peak_hoisting_n": 4000.0, "peak_lowering_n": 5000.0, "stribeck_speed_m_s": 0.15},
        lambda v: -(4000.0 if v > 0.0 else 5000.0) * math.exp(-((v / 0.15) ** 2)) * switch(v),
    ),
    "friction_load_dependent": ({"friction_fraction": 0.06}, lambda v: -0.06 * PAYLOAD * G * switch(v)),
    "friction_position_dependent": (
        {"peak_n": 4000.0, "centre_m": 8.6, "width_m": 0.5},
        lambda v: -4000.0 * math.exp(-0.5 * (0.4 / 0.5) ** 2) * switch(v),
    ),
    "friction_thermal_drift": (
        {"friction_fraction": 0.8, "time_constant_s": 200.0},
        lambda v: -0.8 * math.exp(-(SINCE + T) / 200.0) * (6000.0 if v > 0.0 else 4500.0) * switch(v),
    ),
    "friction_quadratic": ({"drag_n_s2_per_m2": 6000.0}, lambda v: -6000.0 * v * abs(v)),
    "friction_step": ({"level_n": 2000.0, "position_m": 9.05, "width_m": 0.2}, lambda v: -500.0 * switch(v)),
    "friction_periodic": (
        {"amplitude_n": 800.0, "period_m": 0.4, "phase_rad": 0.3},
        lambda v: -400.0 * (1.0 + math.cos(2.0 * math.pi * 9.0 / 0.4 + 0.3)) * switch(v),
    ),
}


@pytest.mark.parametrize("v", [0.2, -0.2])
@pytest.mark.parametrize("name", GUIDE)
def test_an_effect_in_the_guide_pulls_the_carriage_as_it_says(name, v):
    values, expected = GUIDE[name]
    added = forces({name: values}, v, 0.0).carriage - forces({}, v, 0.0).carriage
    assert added == pytest.approx(expected(v), rel=1e-9, abs=1e-6)


# effect -> values, and the torque at the motor that they add at a motor speed w (rad/s)
MOTOR: dict[str, tuple[dict[str, float], Callable[[SimpleNamespace, float], float]]] = {
    "gearbox_efficiency": ({"loss_fraction": 0.03}, lambda s, w: -0.03 * wire_torque(s, w) * np.sign(w)),
    "brake_drag": ({"torque_nm": 70.0, "time_constant_s": 0.9}, lambda s, w: -70.0 * np.sign(w)),
    "torque_ripple": (
        {"amplitude_nm": 17.0, "order_per_turn": 2.0, "phase_rad": 0.4},
        lambda s, w: 17.0 * math.sin(2.0 * s.th + 0.4),
    ),
    "motor_fan": ({"drag_nm_s2": 0.002}, lambda s, w: -0.002 * w * abs(w)),
}


@pytest.mark.parametrize("w", [40.0, -40.0])
@pytest.mark.parametrize("name", MOTOR)
def test_an_effect_in_the_drive_turns_the_motor_as_it_says(name, w):
    # The carriage moves with the motor, so that the wire keeps its equilibrium tension but for its damping.
    values, expected = MOTOR[name]
    v = w * LEVER / 2.0
    with_it, plain = forces({name: values}, v, w), forces({}, v, w)
    if name == "gearbox_efficiency":  # the wire's own share is what the plain plant loses between torque and motion
        load = plain.hold - plain.motor
        assert with_it.motor - plain.motor == pytest.approx(-0.03 * load * np.sign(w), rel=1e-9)
    else:
        assert with_it.motor - plain.motor == pytest.approx(expected(plain, w), rel=1e-6)
    assert with_it.carriage == pytest.approx(plain.carriage)


def test_heave_weighs_by_the_platform_s_acceleration():
    heave = {"heave": {"amplitude_m": 0.2, "frequency_rad_s": 0.8, "phase_rad": 0.5}}
    acceleration = -0.2 * 0.8**2 * math.sin(0.8 * T + 0.5)
    wire = 0.5 * 7850.0 * 0.00034 * (50.0 - 0.3 / 31.0 * forces({}, 0.0, 0.0).th)
    added = forces(heave, 0.0, 0.0).carriage - forces({}, 0.0, 0.0).carriage
    assert added == pytest.approx(-(MASS + wire) * acceleration, rel=1e-6)


def test_hoses_hang_half_at_the_drum():
    plain, heavy = forces({}, 0.0, 0.0), forces({"wire_mass": {"mass_kg_per_m": 6.0}}, 0.0, 0.0)
    assert heavy.motor - plain.motor == pytest.approx(-LEVER * 0.5 * 6.0 * G * (25.0 - HEIGHT), rel=1e-6)
    wound = 0.3 / 31.0 * plain.th
    assert heavy.carriage - plain.carriage == pytest.approx(-0.5 * 6.0 * G * (50.0 - wound), rel=1e-6)


def held(effects: dict[str, dict[str, float]], height: float = HEIGHT) -> tuple[float, float]:
    """Motor angle and torque of a load that hangs still."""
    model = PlantModel(HOIST.plant, of(MACHINES["hoist"], effects))
    start, hold = model.starts([height], [0.0], [0.0], [model.values(MACHINES["hoist"], PAYLOAD, 0.0)])
    return float(start[0, 0]), float(hold[0])


def test_on_the_next_layer_the_load_hangs_on_a_longer_arm():
    step = {"drum_layer_change": {"radius_step_m": 0.009, "drum_angle_rad": 20.0}}
    assert held({})[0] / 31.0 > 55.0  # the drum is well beyond the step
    assert held(step)[1] / held({})[1] == pytest.approx(0.309 / 0.3, rel=1e-3)
    taken = 0.3 * held({})[0] / 31.0
    assert 0.3 * held(step)[0] / 31.0 + 0.009 * (held(step)[0] / 31.0 - 20.0) == pytest.approx(taken, abs=1e-3)


def test_on_an_eccentric_drum_the_arm_goes_with_the_angle():
    e = {"drum_eccentricity": {"amplitude_m": 0.005, "phase_rad": 0.7}}
    angle, hold = held(e)
    assert hold / held({})[1] == pytest.approx((0.3 + 0.005 * math.sin(angle / 31.0 + 0.7)) / 0.3, rel=1e-4)
    wound = 0.3 * angle / 31.0 + 0.005 * (math.cos(0.7) - math.cos(angle / 31.0 + 0.7))
    assert wound == pytest.approx(0.3 * held({})[0] / 31.0, abs=1e-4)


def test_a_shorter_fall_stretches_less():
    share = {"wire_stiffness_length": {"share": 1.0}}
    stretch = 2.0 * (0.3 / 31.0 * held({})[0] / 2.0 - HEIGHT)
    shorter = 2.0 * (0.3 / 31.0 * held(share)[0] / 2.0 - HEIGHT)
    assert shorter / stretch == pytest.approx((25.0 - HEIGHT) / 25.0, rel=2e-3)
    # The strain energy's own derivative pulls the carriage down: half the tension times the relative stretch, per fall.
    strain = shorter / 2.0 / (25.0 - HEIGHT)
    assert held(share)[1] / held({})[1] - 1.0 == pytest.approx(0.5 * strain, rel=0.02)


@pytest.mark.parametrize("seed", range(10))
def test_a_wire_that_stiffens_on_an_uneven_drum_neither_makes_nor_loses_energy(seed):
    """Virtual work: the arm of the wire force is the derivative of the wound length, for wire and weight alike."""
    rng = np.random.default_rng(seed)
    uneven = {"wire_stiffness_length": {"share": 0.8}, "drum_eccentricity": {"amplitude_m": 0.01, "phase_rad": 0.7}}
    model = PlantModel(HOIST.plant, of(MACHINES["hoist"], uneven))
    p = model.values(MACHINES["hoist"], PAYLOAD, 0.0)
    vars(p).update(mu=0.0, F_up=0.0, F_dn=0.0, tau=0.0)
    start, _ = model.starts([HEIGHT], [0.0], [0.0], [p])
    s = start[:6, 0] + np.array([0.5, 0.01, 0.005, 50.0, 1.0, 0.4]) * rng.normal(size=6)
    torque = float(rng.normal(0.0, 500.0))
    states, speeds = state_symbols(HOIST.plant, model.effects)
    names = [x.args[0] for x in (*states, *speeds)]
    program = HOIST.plant.rates(symbol("t"), states, speeds, torque, parameter_symbols(model.names), model.effects)
    numbers = {f"p_{name}": getattr(p, name) for name in model.names}
    a = evaluate(program[:3], {"t": 0.0, **dict(zip(names, [*s, *start[6:, 0]], strict=True)), **numbers})
    rates, line = np.array([*s[3:], *a]), 7850.0 * p.A * p.g

    def energy(at: Array) -> float:
        th, th_s, x, w, w_s, v = at
        wound = LEVER * th + 0.01 * (math.cos(0.7) - math.cos(th / 31.0 + 0.7))
        k = p.E * p.A / (25.0 - 0.8 * x)
        d1, d2 = wound + 0.25 * th_s - x, -0.25 * th_s - x
        kinetic = 0.5 * (INERTIA * w**2 + 3.0 * w_s**2 + MASS * v**2)
        weight = MASS * G * x + line * ((50.0 - wound) * (25.0 + x) / 2.0 + 25.0 * wound)
        return float(kinetic + 0.5 * k * (max(d1, 0.0) ** 2 + max(d2, 0.0) ** 2) + weight)

    h = 1e-5
    rate = (energy(s + h * rates) - energy(s - h * rates)) / (2.0 * h)
    assert rate == pytest.approx(torque * s[3], rel=1e-6, abs=0.05)


def test_play_frees_the_motor_of_the_drum_while_the_wire_is_slack_within_it_and_never_else():
    play = {"backlash": {"play_rad": 0.1}}
    assert forces(play, 0.1, 10.0).motor == forces({}, 0.1, 10.0).motor
    deep = forces(play, 0.1, 10.0, slack=True)  # 19 m of slack wire: far beyond the play
    assert deep.motor == forces({}, 0.1, 10.0, slack=True).motor
    model = PlantModel(HOIST.plant, of(MACHINES["hoist"], play))
    s = SimpleNamespace(slack=0.02, load=33.0)  # 2 cm of slack, 3 cm of play
    p = model.values(MACHINES["hoist"], PAYLOAD, 0.0)
    (piece,) = [effect for effect in effects_for("hoist").values() if effect.id == "backlash"]
    assert piece.function(s, piece.own(p, "hoist"), p) == 33.0


def axis_replay(effects: dict[str, dict[str, float]], force: Array, step: float, **values: float) -> Array:
    """Positions and speeds (n, 2) of a linear axis from rest at 0."""
    at_once = {"friction.standstill_speed_m_s": values.pop("standstill", 1e-4)}
    machine = with_values(linear_axis(**values), at_once)
    model = PlantModel(PLANTS["axis-linear"], of(machine, effects))
    p = [model.values(machine, 0.0, 0.0)]
    start, _ = model.starts([0.0], [0.0], [0.0], p)
    time = np.linspace(0.0, step * (len(force) - 1), len(force))
    out = kernels.replay(
        model.plant, model.table(p), time[:, None], force[:, None], start, model.scales(0.1, p), effects=model.effects
    )
    return out[:, :2, 0]


def test_before_it_slides_an_axis_gives_way_like_a_spring():
    """Dahl's bristle, where friction turns over at once: for small forces the stiffness is level over distance."""
    force, values = np.full(4000, 2.0), {"forward": 20.0, "backward": 20.0, "viscous": 4000.0, "constant": 0.0}
    states = axis_replay({"presliding": {"distance_m": 0.001}}, force, 0.002, **values, standstill=1e-9)
    # z = F_C (1 - exp(-x/d)) = 2 N, so x = -d ln(1 - 2/20); held there by the bristles alone.
    assert states[-1, 0] == pytest.approx(-0.001 * math.log(0.9), rel=1e-3)
    assert axis_replay({}, force, 0.002, **values)[-1, 0] < 1e-4


def test_under_a_steady_force_an_axis_creeps_as_its_own_friction_says():
    """Whatever the bristles give way by first: 2 of 20 N are a tenth of the standstill speed."""
    force, values = np.full(8000, 2.0), {"forward": 20.0, "backward": 20.0, "viscous": 0.0, "constant": 0.0}
    for effects in ({}, {"presliding": {"distance_m": 0.0002}}):
        speeds = axis_replay(effects, force, 0.002, **values, standstill=0.001)[:, 1]
        assert speeds[-1] == pytest.approx(1e-4, rel=1e-3)


@pytest.mark.parametrize("speed", [2e-4, 1e-3, 0.1])
def test_bristles_too_short_to_show_leave_the_friction_that_the_axis_has(speed):
    """Slower than the standstill speed, at it, and much faster, forth and back."""
    t = np.linspace(0.0, 2.0, 2001)
    x, v, a = speed / np.pi * np.sin(np.pi * t), speed * np.cos(np.pi * t), -speed * np.pi * np.sin(np.pi * t)
    machine = with_values(linear_axis(), {"friction.standstill_speed_m_s": 0.001})
    force = [driven_force(machine, effects, t, x, v, a) for effects in ({}, {"presliding": {"distance_m": 1e-9}})]
    assert force[1][1:] == pytest.approx(force[0][1:], abs=0.2)  # they are straight where a run begins


def test_bristles_give_back_no_more_than_they_have_taken():
    """Bent at once and let back slowly, by much more than they were bent. A bristle that follows S over the way alone,
    z' = |v| (S - z)/d, gives back six times what it took."""
    t = np.linspace(0.0, 10.0, 100001)
    v = np.where(t < 0.004, 0.05, -1e-4)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    machine = linear_axis(forward=20.0, backward=20.0, viscous=0.0, constant=0.0)
    machine = with_values(machine, {"friction.standstill_speed_m_s": 0.01})
    force = driven_force(machine, {"presliding": {"distance_m": 0.001}}, t, x, v, np.zeros_like(t))
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x))
    assert np.max(work) > 3e-4 and np.min(work) >= 0.0


@pytest.mark.parametrize(
    ("distance", "standstill", "swing"), [(1e-3, 1e-4, 0.3), (1e-5, 1e-2, 0.02), (2e-4, 1e-3, 1e-4)]
)
def test_between_samples_bristles_bend_as_their_equation_says(distance, standstill, swing):
    """Speeds that cross standstill between any two samples, as the noise of a log at rest does; LSODA in fine steps."""
    t, rng = np.linspace(0.0, 0.1, 101), np.random.default_rng(1)
    v = swing * rng.normal(size=len(t)) * np.minimum(np.arange(len(t)) / 50.0, 1.0)
    machine = linear_axis(forward=20.0, backward=20.0, viscous=0.0, constant=0.0)
    machine = with_values(machine, {"friction.standstill_speed_m_s": standstill})
    force = driven_force(machine, {"presliding": {"distance_m": distance}}, t, 0.0 * t, v, 0.0 * t)

    def rate(time: float, z: Array) -> list[float]:
        now = float(np.interp(time, t, v))
        over = max(abs(now), standstill)
        return [(now - over * z[0]) / (distance + 2e-5 * over)]

    exact = solve_ivp(rate, (0.0, 0.1), [0.0], "LSODA", t, rtol=1e-8, atol=1e-9, max_step=1e-5).y[0]
    assert force / 20.0 == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize(
    "more",
    [
        {"friction_coulomb": {"level_n": 10.0}},
        {"friction_coulomb_asymmetric": {"level_forward_n": 10.0, "level_backward_n": 3.0}},
        {"friction_load_dependent": {"friction_fraction": 2.0}},
    ],
)
def test_all_dry_friction_builds_up_over_the_bristles_distance(more):
    """z = 2 N / (20 + 10) N, so x = -d ln(1 - z): what an effect adds to the friction gives way with it."""
    force = np.full(4000, 2.0 + 5.0)
    states = axis_replay(
        {"presliding": {"distance_m": 0.001}, **more}, force, 0.002,
        forward=20.0, backward=20.0, viscous=4000.0, constant=5.0, standstill=1e-9,
    )  # fmt: skip
    assert states[-1, 0] == pytest.approx(-0.001 * math.log(1.0 - 2.0 / 30.0), rel=1e-3)


def driven_force(machine: Axis, effects: dict[str, dict[str, float]], t: Array, x: Array, v: Array, a: Array) -> Array:
    """(n,) of a linear axis that moves so, N."""
    model = PlantModel(PLANTS["axis-linear"], of(machine, effects))
    p = [model.values(machine, 0.0, 0.0)]
    start, _ = model.starts([x[0]], [v[0]], [0.0], p)
    out = kernels.driven(
        model.plant, model.table(p), t[:, None], x[:, None], v[:, None], a[:, None], start[2:], model.scales(0.1, p),
        effects=model.effects,
    )  # fmt: skip
    return out[:, 0, 0]


def driven_through_play(
    t: Array, v: Array, play: float, shares: tuple[float, float], more: Chosen | None = None, /, **values: float
) -> Array:
    """Force and the motor's lead over what lies behind the play, (n, 2), of a linear axis that moves so. more: effects
    beside the play."""
    machine = linear_axis(**values)
    own = {"play_m": play, "load_share": shares[0], "friction_over_load_share": shares[1]}
    model = PlantModel(PLANTS["axis-linear"], of(machine, {"backlash": own, **(more or {})}))
    p = [model.values(machine, 0.0, 0.0)]
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    start, _ = model.starts([0.0], [0.0], [0.0], p)
    out = kernels.driven(
        model.plant, model.table(p), t[:, None], x[:, None], v[:, None], np.gradient(v, t)[:, None], start[2:],
        model.scales(0.01, p), effects=model.effects,
    )  # fmt: skip
    return out[:, [0, 2], 0]  # behind the input: presliding's state, then this one's two


def test_within_the_play_the_motor_feels_its_own_share_and_behind_it_all_of_the_axis():
    """Slow forth and back: after the reversal friction's share is gone while the play is crossed, then it is back."""
    t = np.linspace(0.0, 10.0, 20001)
    v = np.where(t < 5.0, 0.01, -0.01) * np.minimum(np.abs(t - 5.0) / 0.05, 1.0)
    rubbing = {"forward": 20.0, "backward": 20.0, "viscous": 0.0, "constant": 0.0}
    force, lead = driven_through_play(t, v, 0.01, (0.4, 1.0), **rubbing).T
    before, within, behind = (t > 2.0) & (t < 4.9), (t > 5.3) & (t < 5.9), t > 7.0
    assert force[before] == pytest.approx(20.0, abs=0.05) and lead[before] == pytest.approx(0.005, abs=2e-5)
    assert force[within] == pytest.approx(-20.0 * 0.6, abs=0.05)
    assert force[behind] == pytest.approx(-20.0, abs=0.05) and lead[behind] == pytest.approx(-0.005, abs=2e-5)


def test_what_lies_behind_a_play_runs_on_through_it_while_the_motor_brakes():
    """Without friction it keeps its speed, and a little that the flank's spring gave it; the motor brakes alone."""
    t = np.linspace(0.0, 4.0, 40001)
    v = np.where(t < 1.0, 0.2 * t, np.where(t < 3.0, 0.2, np.maximum(0.2 - 2.0 * (t - 3.0), 0.0)))
    bare = {"forward": 0.0, "backward": 0.0, "viscous": 0.0, "constant": 0.0}
    share, play, mass = 0.3, 0.002, kind_of(linear_axis(**bare)).rigid(linear_axis(**bare), 0.0).inertia
    force, lead = driven_through_play(t, v, play, (share, 0.0), **bare).T
    crossing = (t > 3.001) & (t < 3.0 + 0.9 * math.sqrt(play - 2.5e-4))
    assert force[crossing] == pytest.approx(-2.0 * mass * (1.0 - share), rel=1e-3)
    assert lead[crossing] == pytest.approx(lead[30000] - (t[crossing] - 3.0) ** 2, abs=2e-5)
    assert lead[30000] == pytest.approx(0.5 * play, abs=0.15 * play)
    assert force[(t > 0.5) & (t < 0.9)] == pytest.approx(0.2 * mass, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "forward", "backward", "viscous"),
    [
        ({"friction_coulomb": {"level_n": 15.0}}, 20.0, 20.0, 30.0),
        ({"friction_coulomb_asymmetric": {"level_forward_n": 15.0, "level_backward_n": 2.0}}, 20.0, 7.0, 30.0),
        ({"friction_viscous": {"viscous_n_s_per_m": 70.0}}, 5.0, 5.0, 100.0),
        ({"friction_thermal_drift": {"friction_fraction": 1.0, "time_constant_s": 1e6}}, 10.0, 10.0, 60.0),
    ],
)
def test_what_an_effect_adds_to_an_axis_friction_rubs_behind_its_play_too(
    more: Chosen, forward: float, backward: float, viscous: float
):
    """As its own friction does: what lies behind runs on through the play until it has lost its speed. Taken for the
    axis' own alone the teeth met a third of a flight too early or too late, beside any cause that is a friction."""
    t, play, shares = np.linspace(0.0, 4.0, 20001), 0.01, (0.6, 1.1)
    v, one = 0.1 * np.sin(2.0 * math.pi * 0.5 * t), {"forward": 5.0, "backward": 5.0, "viscous": 30.0, "constant": 0.0}
    as_its_own = {"forward": forward, "backward": backward, "viscous": viscous, "constant": 0.0}
    beside = driven_through_play(t, v, play, shares, more, **one)
    assert beside == pytest.approx(driven_through_play(t, v, play, shares, **as_its_own), rel=1e-3, abs=1e-3)


def test_an_axis_heavier_than_stated_asks_more_force_to_accelerate():
    force = np.full(200, 60.0)
    bare = {"forward": 0.0, "backward": 0.0, "viscous": 0.0, "constant": 0.0}
    heavy = axis_replay({"inertia_error": {"inertia_fraction": 0.2}}, force, 0.001, **bare)
    assert heavy[-1, 1] == pytest.approx(60.0 * 0.199 / (95.0 * 1.2), rel=1e-6)


# What a closed loop runs with: large enough to be seen.
LARGE: dict[str, dict[str, float]] = {name: values for name, (values, _) in {**GUIDE, **MOTOR}.items()} | {
    "gearbox_inertia": {"inertia_kg_m2": 0.4},
    "carriage_mass_error": {"mass_kg": 200.0},
    "payload_mass_error": {"payload_scale": 0.94},
    "heave": {"amplitude_m": 0.2, "frequency_rad_s": 0.8},
    "wire_mass": {"mass_kg_per_m": 6.0},
    "wire_stiffness_length": {"share": 1.0},
    "drum_layer_change": {"radius_step_m": 0.009, "drum_angle_rad": 61.0},
    "drum_eccentricity": {"amplitude_m": 0.005, "phase_rad": 0.7},
    "torque_scale": {"gain": 1.06},
    "torque_offset": {"offset_nm": 30.0},
    "torque_filter": {"time_constant_s": 0.15},
    "speed_delay": {"delay_s": 0.15},
    "backlash": {"play_rad": 0.05},
}
INVISIBLE = {"backlash"}  # while a load hangs
SMALL = {"wire_stiffness_length": 0.5}  # of the plain residual; the others make it several times larger


@pytest.fixture(scope="module")
def campaigns() -> dict[str, tuple[Hoist, Run]]:
    """One closed-loop run of the machine with each effect, as its log shows it; '' is the plain machine."""
    plain = default_hoist()
    limits = Limits(speed_m_s=0.7, acceleration_m_s2=0.4, jerk_m_s3=1.5)
    steps = [Step(by_m=1.5), Step(dwell_s=1.0), Step(by_m=-2.0), Step(by_m=0.5)]
    plan = plan_motion("ruckig", steps, 9.0, limits, (0.0, 25.0), lead_s=2.0, settle_s=2.0)
    speed = motor_speed_rad_s(plan.sample(0.001, plan.duration_s).speed_m_s, plain.gearbox.ratio, 0.6)
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
    machines = {"": plain} | {name: plain.model_copy(update={"effects": {name: v}}) for name, v in LARGE.items()}
    cases = [
        LoopCase(name, machine, PAYLOAD, 9.0, settings, speed, start_time_s=60.0) for name, machine in machines.items()
    ]
    return {
        name: (machine, logged(result.run, of(machine)))
        for (name, machine), result in zip(machines.items(), simulate_loop(cases, record_every=5), strict=True)
    }


def residual_rms(machine: Hoist, run: Run) -> float:
    (balance,) = InverseSimulation(machine, [run]).balances()
    return pooled_rms([balance.residual[balance.inside]])


@pytest.mark.parametrize("name", LARGE)
def test_the_balance_with_an_effect_explains_the_loop_with_it_and_without_it_does_not(campaigns, name):
    plain, level_run = campaigns[""]
    level = residual_rms(plain, level_run)
    assert level < 0.2
    machine, run = campaigns[name]
    with_it, without = residual_rms(machine, run), residual_rms(plain, run)
    limit = {"torque_filter": 0.5, "speed_delay": 0.5, "brake_drag": 1.0}.get(name, level + 0.1)
    assert with_it < limit
    if name not in INVISIBLE:
        assert without > SMALL.get(name, 1.5) and without > 2.0 * with_it
