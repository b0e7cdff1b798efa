"""Effects act where they say, by closed forms; switched off they leave the plant bit for bit alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.hoist_replays import HOIST, start, values
from workbench.core.run import Array
from workbench.machines import Effects
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
