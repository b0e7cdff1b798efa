"""The compiled replay: accuracy, order, energy, slack, lanes; effects act where they say."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support import by_hand
from tests.support.hoist_replays import HOIST, NOMINAL_SPEED, replay, start, values
from workbench.core.run import Array
from workbench.engine import kernels
from workbench.machines import NO_EFFECTS, PLACES, PLANTS, Effects
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import symbol

FIXED = 1e9  # a tolerance that is always met: one step between two samples


def lift_and_reverse(times: Array, hold: float) -> Array:
    """A torque that hangs still, hoists, lowers and hoists again: friction turns over four times."""
    wave = 200.0 * np.cos(2.0 * math.pi * 0.8 * (times - 0.3))
    return hold + np.where(times > 0.3, wave, 0.0)


@pytest.mark.parametrize("payload", [0.0, 4500.0, 9000.0])
def test_a_replay_is_within_1e_6_of_the_reference_in_every_speed(payload):
    p = values(payload)
    s, hold = start(p)
    times = np.arange(0.0, 3.0, 0.01)
    torques = lift_and_reverse(times, hold)
    exact = by_hand.reference(p, s, times, torques)
    ours = replay([p], times, torques, [s])[:, :, 0]
    speeds = np.abs(HOIST.start_of(0.0, NOMINAL_SPEED, p)[1])
    assert np.ptp(exact[:, 3]) > 20.0  # it moves,
    assert np.min(exact[:, 3]) < -1.0 < 1.0 < np.max(exact[:, 3])  # and both ways
    assert np.max(np.abs(ours[:, 3:] - exact[:, 3:]) / speeds) < 1e-6
    assert np.max(np.abs(ours[:, 2] - exact[:, 2])) < 1e-6  # m of height


def test_a_load_that_creeps_through_standstill_again_and_again_is_replayed_within_1e_6():
    """The hardest case: friction turns over within a step all the time."""
    p = values(2700.0)
    s, hold = start(p)
    times = np.arange(0.0, 2.0, 0.01)
    torques = hold + 72.0 * np.sin(7.0 * times + 9.0)
    exact = by_hand.reference(p, s, times, torques)
    ours = replay([p], times, torques, [s])[:, :, 0]
    assert np.max(np.abs(ours[:, 3] - exact[:, 3])) < 1e-6 * NOMINAL_SPEED


def observed_order(errors: list[float]) -> float:
    """The mean order over halvings of the step."""
    return float(np.mean(np.log2(np.array(errors[:-1]) / np.array(errors[1:]))))


def test_the_step_is_of_order_three_on_a_moving_hoist():
    p = values()
    s, hold = start(p, speed_motor_rad_s=60.0)

    def speeds(n: int) -> Array:
        times = np.linspace(0.0, 0.64, n + 1)
        out = replay([p], times, hold + 35.0 + 100.0 * times, [s], tolerance=FIXED)
        return out[:: n // 16, 3, 0]

    times = np.linspace(0.0, 0.64, 17)
    exact = by_hand.reference(p, s, times, hold + 35.0 + 100.0 * times)[:, 3]
    errors = [float(np.max(np.abs(speeds(n) - exact))) for n in (32, 64, 128, 256)]
    assert 2.7 < observed_order(errors) < 3.4


def energy_gap(step_s: float) -> float:
    """|power in - stored - lost|, integrated over a smooth second of motion, relative to the energy put in."""
    p = values()
    s, hold = start(p, speed_motor_rad_s=40.0)
    settled = round(0.8 / step_s)  # the fast modes have gone
    times = step_s * np.arange(settled + round(0.96 / step_s) + 1, dtype=np.float64)
    torques = hold + 36.0 + 60.0 * times
    states = replay([p], times, torques, [s], tolerance=FIXED)[settled:, :, 0]
    times, torques = times[settled:], torques[settled:]
    power = np.array(
        [T * x[3] - HOIST.dissipation(t, x[:3], x[3:], T, p) for t, x, T in zip(times, states, torques, strict=True)]
    )
    stored = [HOIST.energy(x[:3], x[3:], p) for x in states[[0, -1]]]
    simpson = step_s / 3.0 * (power[0] + power[-1] + 4.0 * power[1:-1:2].sum() + 2.0 * power[2:-1:2].sum())
    return abs(simpson - (stored[1] - stored[0])) / float(np.sum(np.abs(torques * states[:, 3])) * step_s)


def test_the_energy_balance_of_a_run_closes_and_converges_with_the_step():
    gaps = [energy_gap(h) for h in (0.01, 0.005, 0.0025, 0.00125)]
    assert gaps[-1] < 1e-7
    assert observed_order(gaps) > 2.0


def slack_case(times: Array) -> tuple[Array, Array]:
    """The drum pays out faster than the load falls, then jerks back: start state and torque."""
    s, hold = start(values())
    return s, np.where(times < 0.2, hold, np.where(times < 0.35, -4500.0, np.where(times < 0.85, 1500.0, hold)))


def test_slack_and_retightening_are_crossed_without_energy_from_nowhere():
    p = values()
    times = np.arange(0.0, 2.5, 0.0005)
    s, torques = slack_case(times)
    states = replay([p], times, torques, [s])[:, :, 0]
    shown = [HOIST.outputs(t, x[:3], x[3:], T, p) for t, x, T in zip(times, states, torques, strict=True)]
    tension = np.array([signals["tension_min_n"] for signals in shown])
    first = int(np.argmax(tension == 0.0))
    assert 0.2 < times[first] < 0.35
    assert np.any(tension[first:] > 2e4)  # it came tight again
    assert np.all(np.isfinite(states))
    # What is stored beyond what the motors gave never rises: friction and wire only take.
    work = np.concatenate([[0.0], np.cumsum(np.diff(states[:, 0]) * 0.5 * (torques[1:] + torques[:-1]))])
    lost = work - np.array([HOIST.energy(x[:3], x[3:], p) for x in states])
    assert np.min(np.diff(lost)) > -0.5  # J a sample, beside 200 kJ stored: the error of the quadrature
    assert lost[-1] - lost[0] > 1e3


def test_slack_and_retightening_go_as_in_the_reference():
    p = values()
    times = np.arange(0.0, 1.5, 0.01)
    s, torques = slack_case(times)
    exact = by_hand.reference(p, s, times, torques)
    ours = replay([p], times, torques, [s])[:, :, 0]
    # The force jumps when a fall comes tight, and an error estimate does not see where within a step it does.
    assert np.max(np.abs(ours[:, 3] - exact[:, 3])) < 3e-4 * NOMINAL_SPEED


def scenarios(n: int) -> tuple[list[SimpleNamespace], Array, Array, list[Array]]:
    """n different machines in different motion, three at rest."""
    times = np.arange(0.0, 1.0, 0.01)
    p, torques, starts = [], [], []
    for j in range(n):
        one = values(300.0 * j)
        one.F_up, one.m_c = one.F_up * (1.0 + 0.01 * j), one.m_c * (1.0 + 0.003 * j)
        s, hold = start(one, 5.0 + 0.3 * j, 0.0 if j % 7 < 3 else 10.0 * (-1) ** j)
        p.append(one)
        torques.append(hold + 8.0 * j * np.sin(7.0 * times + j))
        starts.append(s)
    return p, times, np.array(torques).T, starts


@pytest.mark.parametrize("n", [7, 16, 17, 33])
def test_on_the_same_steps_every_lane_is_bit_for_bit_the_run_alone(n):
    p, times, torques, starts = scenarios(n)
    together = replay(p, times, torques, starts, tolerance=FIXED)
    assert together.shape == (len(times), 6, n)
    for j in range(n):
        alone = replay([p[j]], times, torques[:, j], [starts[j]], tolerance=FIXED)
        assert np.array_equal(together[:, :, j], alone[:, :, 0])


def test_a_lane_that_fails_does_not_spoil_its_neighbours():
    p, times, torques, starts = scenarios(16)
    whole = replay(p, times, torques, starts, tolerance=FIXED)
    broken = torques.copy()
    broken[50:, 3] = np.nan
    spoilt = replay(p, times, broken, starts, tolerance=FIXED)
    assert np.isnan(spoilt[-1, 3, 3])
    others = [j for j in range(16) if j != 3]
    assert np.array_equal(spoilt[:, :, others], whole[:, :, others])


def test_what_has_all_but_vanished_is_zero_and_not_a_number_that_processors_are_slow_with():
    plant = PLANTS["axis-rotary"]
    p = {"M": 1.0, "B": 300.0, "F_f": 0.0, "F_b": 0.0, "v_s": 1e-4, "G": 0.0, "C": 0.0}
    times = np.linspace(0.0, 2.0, 201)[:, None]
    parameters = np.array([[p[name]] for name in plant.parameters])
    out = kernels.replay(plant, parameters, times, 0.0 * times, np.array([[0.0], [1.0]]), np.array([[1.0]]))
    speed = np.abs(out[:, 1, 0])
    assert np.all((speed == 0.0) | (speed > 1e-140))
    assert 0.0 < speed[20] < 1e-3
    assert speed[-1] == 0.0


def test_parameters_of_another_number_of_rows_are_refused():
    """Compiled code would read beyond them."""
    p = values()
    s, hold = start(p)
    times = np.arange(0.0, 0.1, 0.01)
    rows = np.array([[getattr(p, name)] for name in HOIST.parameters])
    with pytest.raises(ValueError, match="22 rows of parameters, the kernel takes 23"):
        kernels.replay(HOIST, rows[:-1], times[:, None], 0.0 * times[:, None] + hold, s[:, None], np.ones((3, 1)))


# Effects act where they say, by closed forms; switched off they leave the plant bit for bit alone.


STATE = [symbol(name) for name in ("th", "th_s", "x", "w", "w_s", "v")]
NAMES = [e.args[0] for e in STATE]


def constant_at(place: str, value: float) -> Effects:
    return Effects({place: [lambda s, p: value]})


def traced_rates(s: Array, torque: float, p: SimpleNamespace, effects: Effects) -> list[float]:
    """Motor, sheave and carriage acceleration of the traced plant."""
    program = HOIST.accelerations(symbol("t"), STATE[:3], STATE[3:], torque, p, effects)
    return evaluate(list(program), {"t": 0.0, **dict(zip(NAMES, s, strict=True))})


def hanging() -> tuple[Array, float, SimpleNamespace]:
    p = values()
    s, hold = start(p)
    return s, hold, p


def reflected_inertia(p: SimpleNamespace) -> float:
    return float(p.n_m * p.J_m + p.J_w / p.ratio**2)


# place -> what is added there, and what that does to (motor, carriage) acceleration of a load that hangs still
ACTS: dict[str, tuple[float, Callable[[SimpleNamespace, float], tuple[float, float]]]] = {
    "guide_force_n": (500.0, lambda p, hold: (0.0, 500.0 / 12500.0)),
    "payload_kg": (250.0, lambda p, hold: (0.0, -250.0 * 9.81 / 12750.0)),
    "carriage_mass_kg": (250.0, lambda p, hold: (0.0, -250.0 * 9.81 / 12750.0)),
    "wound_length_m": (
        0.001,  # fall 1 is 1 mm shorter: k mm more tension, and the wound wire no longer hangs
        lambda p, hold: (
            -0.3 / 31.0 * 1360.0 / reflected_inertia(p),
            (1360.0 + 0.5 * 7850.0 * p.A * 9.81 * 0.001) / 12500.0,
        ),
    ),
    "motor_torque_nm": (20.0, lambda p, hold: (20.0 / reflected_inertia(p), 0.0)),
    "motor_inertia_kg_m2": (0.3, lambda p, hold: (0.0, 0.0)),
    "platform_acceleration_m_s2": (
        0.5,  # all weights grow: payload, carriage, the wire below the drum and the wire above the carriage
        lambda p, hold: (
            -0.3 / 31.0 * 0.5 * 7850.0 * p.A * 0.5 * 15.0 / reflected_inertia(p),
            -0.5 - 0.5 * 7850.0 * p.A * 0.5 * (50.0 - 0.3 / 31.0 * start(p)[0][0]) / 12500.0,
        ),
    ),
    "line_mass_kg_per_m": (
        1.2,
        lambda p, hold: (
            -0.3 / 31.0 * 0.5 * 1.2 * 9.81 * 15.0 / reflected_inertia(p),
            -0.5 * 1.2 * 9.81 * (50.0 - 0.3 / 31.0 * start(p)[0][0]) / 12500.0,
        ),
    ),
}


@pytest.mark.parametrize("place", ACTS)
def test_what_is_added_at_a_place_of_the_hoist_does_what_the_place_says(place):
    s, hold, p = hanging()
    added, expected = ACTS[place]
    plain = traced_rates(s, hold, p, NO_EFFECTS)
    changed = traced_rates(s, hold, p, constant_at(place, added))
    motor, carriage = expected(p, hold)
    assert changed[0] - plain[0] == pytest.approx(motor, rel=1e-9, abs=1e-9)
    assert changed[2] - plain[2] == pytest.approx(carriage, rel=1e-9, abs=1e-9)


def test_a_more_compliant_wire_pulls_less_at_the_same_stretch():
    s, hold, p = hanging()
    k = p.E * p.A / p.L
    plain = HOIST.outputs(0.0, s[:3], s[3:], hold, p)["tension_min_n"]
    more = constant_at("wire_compliance_m_per_n", 0.25 / k)
    (soft,) = evaluate(
        [HOIST.outputs(0.0, STATE[:3], STATE[3:], hold, p, more)["tension_min_n"]], dict(zip(NAMES, s, strict=True))
    )
    assert soft == pytest.approx(plain / 1.25)


@pytest.mark.parametrize(("place", "expected"), [("axis_force", (7.0 + 3.0) / 2.0), ("axis_inertia", 7.0 / 5.0)])
def test_what_is_added_at_a_place_of_the_axis_does_what_the_place_says(place, expected):
    axis = PLANTS["axis-linear"]
    p = SimpleNamespace(M=2.0, B=0.0, F_f=0.0, F_b=0.0, v_s=1e-4, G=0.0, C=0.0)
    assert axis.accelerations(0.0, [0.1], [0.2], 7.0, p, constant_at(place, 3.0)) == [pytest.approx(expected)]


def test_what_an_effect_makes_of_the_switch_scales_the_coulomb_level_of_that_way():
    axis = PLANTS["axis-linear"]
    p = SimpleNamespace(M=2.0, B=0.5, F_f=3.0, F_b=4.0, v_s=1e-4, G=0.0, C=0.0)
    for added, friction in ((0.0, 3.0), (-0.5, 0.5 * 3.0), (-1.5, -0.5 * 4.0)):
        effects = constant_at("axis_switch", added)
        expected = (7.0 - friction - 0.5 * 0.2) / 2.0
        assert axis.accelerations(0.0, [0.1], [0.2], 7.0, p, effects) == [pytest.approx(expected)]


def test_every_place_is_tested():
    own = set(PLANTS["two_inertia"].places) - set(PLANTS["axis-rotary"].places)  # see test_plants.py
    assert {*ACTS, "wire_compliance_m_per_n", "axis_force", "axis_inertia", "axis_switch"} == set(PLACES) - own


def test_an_effect_at_no_place_is_refused_with_the_list_of_places():
    s, hold, p = hanging()
    with pytest.raises(ValueError, match=r"no place 'guide_force'.*guide_force_n"):
        HOIST.rates(0.0, list(s[:3]), list(s[3:]), hold, p, constant_at("guide_force", 1.0))


def test_effects_at_one_place_are_summed():
    s, hold, p = hanging()
    both = Effects({"motor_torque_nm": [lambda s, p: 20.0, lambda s, p: -5.0]})
    one = constant_at("motor_torque_nm", 15.0)
    assert traced_rates(s, hold, p, both) == pytest.approx(traced_rates(s, hold, p, one), abs=1e-12)
