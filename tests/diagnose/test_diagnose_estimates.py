"""Intervals of fitted parameters: what noise and discrepancy scatter, and what a simple law cannot know."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import covariance
from workbench.diagnose.hypotheses.free_parameters import Scalar
from workbench.diagnose.hypotheses.model_error import ErrorModel
from workbench.effects import Effect, library_effects

SIMPLIFIED = [
    pytest.param(effect, parameter, id=f"{effect.id}.{parameter.symbol}")
    for effect in library_effects()
    for parameter in effect.parameters
    if parameter.simplified is not None
]


def of(effect: Effect, **values: float) -> dict[str, float]:
    """symbol -> by how much the law simplifies it, of an effect with these values."""
    e = SimpleNamespace(**{p.symbol: p.start for p in effect.parameters} | values)
    return {p.symbol: p.simplified(e) for p in effect.parameters if p.simplified is not None}


def named(name: str, *symbols: str) -> Effect:
    return next(e for e in library_effects() if e.id == name and {*symbols} <= {p.symbol for p in e.parameters})


@pytest.mark.parametrize("carry", [0.0, 0.5, 0.95])
def test_correlated_noise_widens_the_interval_of_a_level_as_theory_says(carry: float):
    """The mean of n values of a first-order process: 1ᵀC⁻¹1 = (n − (n − 2) ρ)/(σ² (1 + ρ)): U. Grenander, M. Rosenblatt
    (Statistical Analysis of Stationary Time Series, 1957)."""
    n, sigma = 400, 3.0
    rho = np.full(n, carry)
    rho[0] = 0.0
    errors = ErrorModel(np.full(n, 1e-6), np.full(n, sigma), np.zeros(n), rho)
    free = (Scalar("level", 0.0, 1.0),)
    problem = SimpleNamespace(errors=errors, share=1.0, samples=n)

    def variance(residual: Array) -> float:
        fit = SimpleNamespace(free=free, z=np.zeros(1), jacobian=np.ones((n, 1)), residual=residual, chi2=float(n))
        return float(covariance(cast(Any, problem), cast(Any, fit))[0, 0])

    theory = sigma**2 * (1.0 + carry) / (n - (n - 2) * carry)
    assert variance(np.zeros(n)) == pytest.approx(theory, rel=1e-3)
    ramp = np.linspace(0.0, 1.0, n) ** 3
    ones, rows = (errors.whiten(one) for one in (np.ones(n), ramp))
    at_the_fit = ramp - (ones @ rows) / (ones @ ones)
    assert variance(at_the_fit) == pytest.approx(theory + np.mean(at_the_fit) ** 2, rel=1e-3)


@pytest.mark.parametrize(("effect", "parameter"), SIMPLIFIED)
def test_what_a_law_simplifies_is_no_more_than_the_value_may_be(effect: Effect, parameter: Any):
    s = of(effect)[parameter.symbol]
    assert 0.0 <= s < math.inf
    assert s <= parameter.highest - parameter.lowest or parameter.scan == "drum_angle"  # that one is in rad already
    if parameter.vanishes_at is not None:
        assert of(effect, **{parameter.symbol: parameter.vanishes_at})[parameter.symbol] == 0.0


@pytest.mark.parametrize("tau", [0.3, 0.7, 1.5])
def test_a_brake_that_lets_go_before_the_motor_turns_stays_within_the_interval(tau: float):
    """Its torque has fallen to T exp(−0.2 s/τ) when the log first shows it."""
    torque = 100.0
    seen = torque * math.exp(-0.2 / tau)
    assert torque - seen < 1.6449 * of(named("brake_drag", "T"), T=seen, tau=tau)["T"]


@pytest.mark.parametrize("climb", [0.05, 0.3, 0.6])
def test_a_layer_that_is_climbed_at_once_or_slowly_begins_within_the_interval(climb: float):
    """What is fitted is the middle of the climb, in rad of the drum; it begins half of it earlier."""
    assert 0.5 * climb < 1.6449 * of(named("drum_layer_change", "th_0"))["th_0"]
