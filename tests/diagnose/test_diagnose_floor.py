"""What an axis leaves itself: how long it hangs together, and what that makes of the evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.effect_machines import linear_axis
from tests.support.noisy_runs import axis_runs
from workbench.diagnose.hypotheses.base import base_knobs
from workbench.diagnose.hypotheses.fits import Fitted, fit_knobs
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.verdict.structure import (
    OWN,
    RIPPLE,
    Reducible,
    correlation_time,
    floor_of,
    independent_share,
    weigh_against,
)
from workbench.effects import find, ranges_of


def filtered(count: int, memory: float) -> np.ndarray:
    """Noise of which each value keeps `memory` of the one before: a first-order autoregression."""
    noise = np.random.default_rng(1).normal(size=count)
    values = np.empty(count)
    last = 0.0
    for k, each in enumerate(noise):
        values[k] = last = memory * last + each
    return values


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9, 0.98])
def test_the_correlation_time_of_an_autoregression_is_its_closed_form(memory: float):
    values = filtered(400_000, memory)
    assert correlation_time(values) == pytest.approx((1.0 + memory) / (1.0 - memory), rel=0.1)


def test_the_correlation_time_is_of_values_as_they_are_with_their_mean():
    assert correlation_time(1.0 + 0.01 * filtered(2000, 0.0)) > 300.0


def test_what_swings_to_and_fro_counts_no_more_than_once_a_sample():
    assert correlation_time(np.cos(np.pi * np.arange(1000))) == 1.0


@pytest.fixture(scope="module")
def axis() -> tuple[Problem, Fitted]:
    """An axis that its model knows, and the fit of its base parameters."""
    machine = linear_axis()
    problem = Problem(machine, axis_runs(machine))
    knobs = list(base_knobs(machine, problem.runs).values())
    return problem, fit_knobs(problem, (), knobs, np.zeros(len(knobs)), problem.noise)


def leaving(axis: tuple[Problem, Fitted], rms: float) -> Fitted:
    """The fit with a residual that swings once a run, of so many of the largest input, rms."""
    problem, fit = axis
    once = np.concatenate([np.sin(np.linspace(0.0, 2.0 * np.pi, n)) for n in problem.run_lengths])
    return replace(fit, residual=rms * largest(problem) * once / np.sqrt(np.mean(once**2)))


def largest(problem: Problem) -> float:
    return max(float(np.max(np.abs(run["force_n"]))) for run in problem.runs)


NOTHING = Reducible(0.0, along=False)


def test_what_nothing_explains_is_the_axis_own_up_to_what_a_real_one_leaves(axis: tuple[Problem, Fitted]):
    problem, _ = axis
    of = largest(problem)
    assert floor_of(problem, leaving(axis, 0.013), NOTHING) == pytest.approx(0.013 * of)
    assert floor_of(problem, leaving(axis, 0.2), NOTHING) == pytest.approx(OWN * of)
    assert floor_of(problem, leaving(axis, 1e-9), NOTHING) == problem.sensor_noise


def test_cogging_is_the_axis_own_and_what_speed_or_time_explains_is_not(axis: tuple[Problem, Fitted]):
    problem, _ = axis
    left = leaving(axis, 0.05)
    assert floor_of(problem, left, Reducible(1.0, along=True)) == pytest.approx(RIPPLE * largest(problem))
    assert floor_of(problem, left, Reducible(1.0, along=False)) == problem.sensor_noise


def test_a_floor_that_swings_over_seconds_counts_as_few_values_and_noise_as_many(axis: tuple[Problem, Fitted]):
    problem, fit = axis
    slow = leaving(axis, 0.013)
    assert independent_share(problem, slow) * problem.inputs < 20.0 * len(problem.runs)
    assert independent_share(problem, fit) > 0.5 * problem.band_share
    before = problem.noise, problem.share
    try:
        weigh_against(problem, slow, NOTHING, fit)
        assert problem.noise == pytest.approx(0.013 * largest(problem))
        assert problem.share > 0.5 * problem.band_share
    finally:
        problem.noise, problem.share = before


def test_a_tight_place_is_looked_for_where_the_axis_has_been(axis: tuple[Problem, Fitted]):
    problem, _ = axis
    away = [replace(run, signals={**run.signals, "position_m": run["position_m"] + 7.0}) for run in problem.runs]
    effect = find("friction_position_dependent", problem.active.kind)
    (centre,) = (r for r in ranges_of(effect, problem.machine, away) if r.scan == "position")
    places = np.concatenate([run["position_m"] for run in away])
    assert centre.lowest < places.min() < places.max() < centre.highest
    assert centre.highest - centre.lowest < 1.3 * np.ptp(places)
