"""The plants' equations against a second writing, closed forms, energy, dissipation: hoist, axis, two inertias."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.special
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.support import by_hand
from workbench.core.run import Array
from workbench.engine import kernels
from workbench.engine.statics import hang_still, of_each
from workbench.machines import PLANTS, Effects, Plant, default_hoist
from workbench.machines.kinds.two_inertia import coupling

HOIST = PLANTS["hoist"]
MACHINE = default_hoist()
PAYLOADS = (0.0, 4500.0, 9000.0)


def values(payload_kg: float = 4500.0) -> SimpleNamespace:
    return HOIST.values(MACHINE, payload_kg)


def rates(s: list[float], T: float, p: SimpleNamespace) -> list[float]:
    """The plant's own equations on a state in one row."""
    return [*s[3:], *HOIST.accelerations(0.0, s[:3], s[3:], T, p)]


def outputs(s: list[float], T: float, p: SimpleNamespace) -> dict[str, float]:
    return dict(HOIST.outputs(0.0, s[:3], s[3:], T, p))


def elongations(s: list[float], p: SimpleNamespace) -> tuple[float, float, float, float]:
    """delta_1, delta_2 and their rates by Eq. 3-6."""
    R, r, i = p.D_w / 2.0, p.D_s / 2.0, 1.0 / p.ratio
    return (R * i * s[0] + r * s[1] - s[2], -r * s[1] - s[2], R * i * s[3] + r * s[4] - s[5], -r * s[4] - s[5])


def machine(data: st.DataObject) -> SimpleNamespace:
    """A machine of another size, every value drawn around the nominal one."""
    p = values(data.draw(st.sampled_from(PAYLOADS)))
    free = [name for name in vars(p) if name not in ("n_m", "m_p", "L")]
    factors = {name: data.draw(st.floats(0.5, 2.0), label=name) for name in free}
    return SimpleNamespace(**{name: value * factors.get(name, 1.0) for name, value in vars(p).items()})


@st.composite
def states(draw: st.DrawFn, p: SimpleNamespace) -> list[float]:
    """A state with both falls tight, released or slack: height, elongations and all speeds drawn apart."""
    x = draw(st.floats(0.0, 24.0))
    d1, d2 = draw(st.floats(-0.1, 0.2)), draw(st.floats(-0.1, 0.2))
    R, r = p.D_w / 2.0, p.D_s / 2.0
    theta_s = -(d2 + x) / r
    theta_m = (d1 + x - r * theta_s) / R * p.ratio
    small = st.sampled_from([1.0, 1e-3])  # also near standstill, where friction turns over
    v = draw(st.floats(-1.0, 1.0)) * draw(small)
    return [theta_m, theta_s, x, draw(st.floats(-200.0, 200.0)) * draw(small), draw(st.floats(-5.0, 5.0)), v]


@given(st.data(), st.floats(-2000.0, 2000.0))
def test_the_equations_are_those_written_by_hand(data, T):
    p = machine(data)
    s = data.draw(states(p))
    ours, theirs = np.array(rates(s, T, p)), np.array(by_hand.rates(s, T, by_hand.table(p)))
    # Round-off of the large forces that nearly cancel, at the three inertias.
    c = p.tau * p.E * p.A / p.L
    force = 1e6 + c * (abs(s[3]) / p.ratio * p.D_w + abs(s[4]) * p.D_s + abs(s[5]))
    bound = 1e-13 * force * np.array([0, 0, 0, p.D_w / p.ratio / (p.n_m * p.J_m), p.D_s / p.J_s, 1.0 / p.m_c])
    assert np.all(np.abs(ours - theirs) <= bound + 1e-15 * np.abs(theirs))


@given(st.data(), st.floats(-2000.0, 2000.0))
def test_power_in_is_the_rate_of_energy_plus_dissipation_at_every_state(data, T):
    p = machine(data)
    s = data.draw(states(p))
    d1, d2, rate1, rate2 = elongations(s, p)
    assume(min(abs(d1), abs(d2)) > 1e-4)  # the elastic energy has a kink in its second derivative at 0
    direction = np.array(rates(s, T, p))
    size = min(1e-3, 5e-5 / max(abs(rate1), abs(rate2), 1e-9))  # does not reach that kink

    def energy(at: np.ndarray) -> float:
        return float(HOIST.energy(list(at[:3]), list(at[3:]), p))

    # Of degree two between the kinks, so its central difference is exact but for round-off.
    ahead, behind = energy(np.array(s) + size * direction), energy(np.array(s) - size * direction)
    lost = float(HOIST.dissipation(0.0, s[:3], s[3:], 0.0, p))
    assert lost >= 0.0, "friction and wire take energy in every branch"
    round_off = 1e-14 * (abs(ahead) + abs(behind) + 1e6) / size
    assert (ahead - behind) / (2.0 * size) == pytest.approx(
        T * s[3] - lost, abs=round_off + 1e-9 * (lost + abs(T * s[3]))
    )


@pytest.mark.parametrize("payload", PAYLOADS)
def test_a_hanging_load_settles_at_weight_over_stiffness(payload):
    p = values(payload)
    k, line = p.E * p.A / p.L, 7850.0 * p.A * p.g
    q, hold = HOIST.equilibrium(10.0, p)
    d1, d2, _, _ = elongations([*q, 0.0, 0.0, 0.0], p)
    m = p.m_c + payload
    assert d1 == pytest.approx(d2, rel=1e-9)
    assert 2.0 * k * d1 == pytest.approx(m * p.g + 0.5 * line * (2.0 * p.L - p.D_w / 2.0 / p.ratio * q[0]), rel=1e-9)
    assert d1 == pytest.approx((m * p.g + line * 15.0) / (2.0 * k + line), rel=1e-9)
    assert hold == pytest.approx(p.D_w / 2.0 / p.ratio * (k * d1 + 0.5 * line * 15.0), rel=1e-9)


def even(speed_motor: float, payload: float = 4500.0, height: float = 10.0) -> list[float]:
    q, y, _ = HOIST.start_of(height, speed_motor, values(payload))
    return [*q, *y]


@given(st.floats(0.0, 24.0), st.sampled_from(PAYLOADS), st.floats(-100.0, 100.0))
def test_top_and_bottom_of_a_fall_differ_by_the_weight_of_its_free_length(height, payload, speed):
    p = values(payload)
    s = even(speed, payload, height)
    shown = outputs(s, 0.0, p)
    line = 7850.0 * p.A * p.g
    # The carriage is carried by both bottoms: m (a + g) + friction (Eq. 16).
    carried = (p.m_c + payload) * (shown["acceleration_carriage_m_s2"] + p.g) + shown["force_guide_n"]
    hanging = shown["tension_drum_n"] + shown["tension_dead_line_n"] - carried
    stretch = sum(elongations(s, p)[:2])
    assert hanging == pytest.approx(2.0 * line * (p.L - height) - 0.5 * line * stretch, abs=1e-6)
    assert 0.5 * line * stretch / 2.0 < 0.85  # N a fall: nothing


def test_a_slack_fall_shows_no_elastic_tension_and_only_its_own_weight_at_the_top():
    p = values()
    s = even(0.0)
    slack = [s[0] - 3.0 * p.ratio, *s[1:]]  # three radians of drum paid out: fall 1 is slack
    shown = outputs(slack, 0.0, p)
    assert shown["tension_min_n"] == 0.0
    assert shown["tension_drum_n"] == pytest.approx(0.5 * 7850.0 * p.A * p.g * (p.L - 10.0))


# The axis, linear and rotary, against closed forms of mechanics.


LINEAR, ROTARY = PLANTS["axis-linear"], PLANTS["axis-rotary"]
BOTH = pytest.mark.parametrize("plant", [LINEAR, ROTARY], ids=["linear", "rotary"])
FREE = {"M": 95.0, "B": 0.0, "F_f": 0.0, "F_b": 0.0, "v_s": 1e-4, "G": 0.0, "C": 0.0}


def move(
    plant: Plant, changes: dict[str, float], end_s: float, start: tuple[float, float] = (0.0, 0.0), u: float = 0.0
) -> tuple[Array, Array, Array]:
    """Time, position and speed of an axis under a constant input."""
    p = {**FREE, **changes}
    times = np.linspace(0.0, end_s, 1001)
    out = kernels.replay(
        plant,
        np.array([[p[name]] for name in plant.parameters]),
        times[:, None],
        np.full((1001, 1), u),
        np.array(start)[:, None],
        np.array([[1.0]]),
    )[:, :, 0]
    return times, out[:, 0], out[:, 1]


@BOTH
def test_an_axis_falls_freely_under_its_constant_load(plant):
    t, x, v = move(plant, {"C": 300.0}, 2.0)
    assert v == pytest.approx(-300.0 / 95.0 * t, abs=1e-9)
    assert x == pytest.approx(-300.0 / 95.0 * t**2 / 2.0, abs=1e-9)


@BOTH
def test_viscous_friction_lets_the_speed_decay_with_inertia_over_friction(plant):
    t, x, v = move(plant, {"B": 203.5}, 2.0, start=(0.0, 1.0))
    tau = 95.0 / 203.5
    assert v == pytest.approx(np.exp(-t / tau), abs=2e-6)
    assert x == pytest.approx(tau * (1.0 - np.exp(-t / tau)), abs=2e-6)


@BOTH
@pytest.mark.parametrize("way", [1.0, -1.0], ids=["forward", "backward"])
def test_a_driven_axis_ends_at_its_terminal_speed(plant, way):
    changes = {"B": 200.0, "F_f": 20.0, "F_b": 35.0, "C": 10.0}
    _, _, v = move(plant, changes, 10.0, u=way * 250.0)
    assert v[-1] == pytest.approx(
        (250.0 - 20.0 - 10.0) / 200.0 if way > 0 else -(250.0 - 35.0 + 10.0) / 200.0, abs=1e-6
    )


@pytest.mark.parametrize(("speed", "level"), [(0.8, "F_f"), (-0.8, "F_b")])
@BOTH
def test_coulomb_friction_stops_a_coasting_axis_within_its_closed_form(plant, speed, level):
    levels = {"F_f": 20.0, "F_b": 35.0}
    _, x, v = move(plant, levels, 6.0, start=(0.0, speed))
    # Within the standstill speed the force is linear: 1e-4 m/s covers v_s^2 M / F more.
    assert x[-1] == pytest.approx(math.copysign(speed**2 * 95.0 / (2.0 * levels[level]), speed), rel=1e-5)
    assert v[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("amplitude_rad", [0.01, 1.0, 2.5])
def test_a_sine_load_swings_with_the_period_of_a_pendulum(amplitude_rad):
    t, x, _ = move(ROTARY, {"M": 2.0, "G": 30.0}, 8.0, start=(amplitude_rad, 0.0))
    crossings = np.flatnonzero(np.diff(np.sign(x)))
    at = t[crossings] - x[crossings] * (t[crossings + 1] - t[crossings]) / (x[crossings + 1] - x[crossings])
    period = 4.0 * math.sqrt(2.0 / 30.0) * scipy.special.ellipk(math.sin(amplitude_rad / 2.0) ** 2)
    assert 2.0 * np.diff(at) == pytest.approx(period, rel=1e-4)
    assert np.max(np.abs(x)) <= amplitude_rad * (1.0 + 1e-6)  # no energy comes in


# The axis of two inertias against closed forms: frequencies, energy, play, and the stiff axis it ends in.


PLANT, STIFF = PLANTS["two_inertia"], PLANTS["axis-rotary"]
FREE_PLANTS = {
    "M": 0.02, "B": 0.0, "F_f": 0.0, "F_b": 0.0, "v_s": 1e-3, "k": 900.0, "c": 0.0, "b": 0.0,
    "M_l": 0.05, "B_l": 0.0, "F_lf": 0.0, "F_lb": 0.0, "v_ls": 1e-3, "G": 0.0, "C": 0.0,
}  # fmt: skip
RESONANCE_HZ = math.sqrt(900.0 * (1.0 / 0.02 + 1.0 / 0.05)) / (2.0 * math.pi)
LOAD_HZ = math.sqrt(900.0 / 0.05) / (2.0 * math.pi)  # with the motor held: the anti-resonance

positive = st.floats(0.01, 10.0)
levels = st.floats(0.0, 5.0)
parameters_plants = st.builds(
    lambda *v: SimpleNamespace(**dict(zip(FREE_PLANTS, v, strict=True))),
    positive, levels, levels, levels, st.floats(1e-3, 0.1), st.floats(10.0, 1e4), st.floats(0.0, 5.0),
    st.one_of(st.just(0.0), st.floats(1e-3, 0.1)),
    positive, levels, levels, levels, st.floats(1e-3, 0.1), levels, st.floats(-5.0, 5.0),
)  # fmt: skip
angles, speeds = st.floats(-0.2, 0.2), st.floats(-2.0, 2.0)


def move_plants(
    changes: dict[str, float], end_s: float, start: tuple[float, ...], u: float = 0.0
) -> tuple[Array, Array]:
    """Times, and states (n, 4): both angles, both speeds, under a constant torque."""
    p = {**FREE_PLANTS, **changes}
    times = np.linspace(0.0, end_s, 2001)
    out = kernels.replay(
        PLANT,
        np.array([[p[name]] for name in PLANT.parameters]),
        times[:, None],
        np.full((2001, 1), u),
        np.array(start)[:, None],
        np.array([[1.0], [1.0]]),
    )
    return times, out[:, :4, 0]


def driven(changes: dict[str, float], time: Array, angle: Array, speed: Array, acceleration: Array) -> Array:
    """Torque (n,) that a motion of the motor takes, the load at its even swing."""
    p = SimpleNamespace(**{**FREE_PLANTS, **changes})
    gain = p.k / (p.k - p.M_l * (2.0 * math.pi * changes["hz"]) ** 2) if "hz" in changes else 1.0
    out = kernels.driven(
        PLANT,
        np.array([[getattr(p, name)] for name in PLANT.parameters]),
        time[:, None],
        angle[:, None],
        speed[:, None],
        acceleration[:, None],
        np.array([[gain * angle[0]], [gain * speed[0]]]),
        np.array([[1.0], [1.0]]),
        tolerance=1e-8,
        threads=1,
    )
    return np.asarray(out[:, 0, 0])


def test_a_twisted_axis_swings_at_the_resonance_of_both_inertias_against_each_other():
    t, s = move_plants({}, 0.5, (0.01, 0.0, 0.0, 0.0))
    twist = s[:, 0] - s[:, 1]
    assert twist == pytest.approx(0.01 * np.cos(2.0 * math.pi * RESONANCE_HZ * t), abs=2e-5)
    assert 0.02 * s[:, 2] + 0.05 * s[:, 3] == pytest.approx(np.zeros(len(t)), abs=1e-6)  # nothing from outside


@pytest.mark.parametrize("share", [0.3, 0.8, 1.25])
def test_the_torque_of_a_sine_is_that_of_the_closed_form(share):
    """T = -w^2 (M + M_l/(1 - (f/f_a)^2)) theta."""
    hz = share * LOAD_HZ
    t = np.linspace(0.0, 5.0 / hz, 4001)
    w = 2.0 * math.pi * hz
    angle = 0.01 * np.sin(w * t)
    torque = driven({"hz": hz}, t, angle, 0.01 * w * np.cos(w * t), -(w**2) * angle)
    felt = 0.02 + 0.05 / (1.0 - share**2)
    assert torque == pytest.approx(-(w**2) * felt * angle, abs=2e-3 * w**2 * abs(felt) * 0.01)


@given(p=parameters_plants, x=angles)
def test_the_holding_input_holds_with_play_and_without(p, x):
    q, hold = PLANT.equilibrium(x, p)
    a, a_l = PLANT.accelerations(0.0, q, [0.0, 0.0], hold, p)
    assert q[0] == x
    assert a * p.M == pytest.approx(0.0, abs=1e-6 * max(1.0, p.k * abs(q[1] - x)))
    assert a_l * p.M_l == pytest.approx(0.0, abs=1e-3 if 0.3 * p.k < p.G else 1e-6)


def test_within_the_play_the_motor_turns_alone():
    """From one flank to the other: b = u t^2 / (2 M); the load does not feel it."""
    b, u = 0.02, 0.5
    crossing = math.sqrt(2.0 * b * 0.02 / u)
    t, s = move_plants({"b": b}, 2.0 * crossing, (-b / 2.0, 0.0, 0.0, 0.0), u=u)
    free = t < 0.98 * crossing
    assert s[free, 0] + b / 2.0 == pytest.approx(u * t[free] ** 2 / (2.0 * 0.02), rel=1e-3, abs=1e-6)
    assert np.max(np.abs(s[free, 3])) < 1e-3
    assert np.max(s[~free, 3]) > 0.1  # the impact


def test_a_flank_pushes_and_never_pulls():
    p = SimpleNamespace(**{**FREE_PLANTS, "b": 0.01, "c": 50.0})
    parting = PLANT.outputs(0.0, [0.006, 0.0], [-1.0, 1.0], 0.0, p)["torque_coupling_nm"]
    assert 0.0 <= parting < 1e-4  # but for the grease


def test_a_stiff_coupling_is_an_axis_of_both_inertias():
    changes = {"k": 1e6, "c": 30.0, "B": 0.1, "F_f": 0.4, "F_b": 0.3, "C": 0.2}
    _, s = move_plants(changes, 1.0, (0.0, 0.0, 0.0, 0.0), u=2.0)
    p = {"M": 0.07, "B": 0.1, "F_f": 0.4, "F_b": 0.3, "v_s": 1e-3, "G": 0.0, "C": 0.2}
    times = np.linspace(0.0, 1.0, 2001)
    one = kernels.replay(
        STIFF, np.array([[p[name]] for name in STIFF.parameters]), times[:, None], np.full((2001, 1), 2.0),
        np.zeros((2, 1)), np.array([[1.0]]),
    )  # fmt: skip
    assert s[:, 2] == pytest.approx(one[:, 1, 0], abs=2e-3 * float(np.max(one[:, 1, 0])))


@pytest.mark.parametrize(
    ("place", "added", "expected"),
    [
        ("axis_force", 3.0, (7.0 + 3.0 - 900.0 * 0.01) / 0.02),
        ("axis_inertia", 0.02, (7.0 - 900.0 * 0.01) / 0.04),
        ("coupling_compliance", 1.0, (7.0 - 450.0 * 0.01) / 0.02),
        ("coupling_torque_nm", 4.0, (7.0 - 900.0 * 0.01 - 4.0) / 0.02),
        ("load_inertia_kg_m2", 0.05, 900.0 * 0.01 / 0.1),
    ],
)
def test_what_is_added_at_a_place_does_what_the_place_says(place, added, expected):
    effects = Effects({place: [lambda s, p: added]})
    rates = PLANT.accelerations(0.0, [0.01, 0.0], [0.0, 0.0], 7.0, SimpleNamespace(**FREE_PLANTS), effects)
    assert rates[place == "load_inertia_kg_m2"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("load", [-2.0, 0.0, 2.0])
def test_a_load_finds_its_place_behind_play_that_an_effect_adds(load):
    """The plain place lies within the play: it is left for the flank that the load lies on."""
    effects = Effects({"coupling_torque_nm": [lambda s, p: coupling(s.twist, s.rate, s.k, s.c, 0.02)[0] - s.torque]})
    table = np.array([[{**FREE_PLANTS, "C": load}[name]] for name in PLANT.parameters])
    q, u = hang_still(PLANT, effects, table, [0.3], [0.0])
    assert u[0] == pytest.approx(load, abs=1e-6)
    assert q[0, 0] - q[1, 0] == pytest.approx(load / 900.0 + math.copysign(0.01, load) * bool(load), abs=1e-6)


def test_parameters_of_all_scenarios_go_through_a_function_at_once_and_one_by_one_where_it_has_branches():
    calls = []

    def plain(p):
        calls.append(p)
        return 2.0 * p.a

    table = np.array([[0.0, 1.0, 2.0]])
    assert of_each(plain, ["a"], table) == pytest.approx(2.0 * table)
    assert len(calls) == 1
    assert of_each(lambda p: p.a or 5.0, ["a"], table) == pytest.approx(np.array([[5.0, 1.0, 2.0]]))
