"""Effects act where they say, by closed forms; switched off they leave the plant bit for bit alone."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.hoist_replays import HOIST, start, values
from workbench.core.run import Array
from workbench.machines import NO_EFFECTS, PLACES, PLANTS, Effects
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import Scalar, cos, sin, symbol

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
    own = set(PLANTS["two_inertia"].places) - set(PLANTS["axis-rotary"].places)  # see test_plants_two_inertia
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


def eccentric(s: Any, p: Any) -> Scalar:
    """An uneven drum with a second harmonic: what it winds beyond radius times angle, m."""
    return 0.01 * sin(s.theta_w) + 0.004 * cos(2.0 * s.theta_w)


@pytest.mark.parametrize("seed", range(20))
def test_an_uneven_drum_neither_makes_nor_loses_energy(seed):
    """Virtual work: the arm of the wire force is the derivative of the wound length, for wire and weight alike."""
    rng = np.random.default_rng(seed)
    p = SimpleNamespace(**{**vars(values()), "mu": 0.0, "F_up": 0.0, "F_dn": 0.0, "tau": 0.0})
    s, _ = start(p)
    s = s + np.array([0.5, 0.01, 0.005, 50.0, 1.0, 0.4]) * rng.normal(size=6)
    torque = float(rng.normal(0.0, 500.0))
    rates = np.array([*s[3:], *traced_rates(s, torque, p, Effects({"wound_length_m": [eccentric]}))])
    k, line = p.E * p.A / p.L, 7850.0 * p.A * p.g

    def energy(at: Array) -> float:
        th, th_s, x, w, w_s, v = at
        wound = 0.3 / 31.0 * th + 0.01 * np.sin(th / 31.0) + 0.004 * np.cos(2.0 * th / 31.0)
        d1, d2 = wound + 0.25 * th_s - x, -0.25 * th_s - x
        kinetic = 0.5 * (reflected_inertia(p) * w**2 + p.J_s * w_s**2 + (p.m_c + p.m_p) * v**2)
        weight = (p.m_c + p.m_p) * p.g * x + line * ((50.0 - wound) * (25.0 + x) / 2.0 + 25.0 * wound)
        return float(kinetic + 0.5 * k * (max(d1, 0.0) ** 2 + max(d2, 0.0) ** 2) + weight)

    h = 1e-5
    rate = (energy(s + h * rates) - energy(s - h * rates)) / (2.0 * h)
    assert rate == pytest.approx(torque * s[3], rel=1e-6, abs=0.05)
