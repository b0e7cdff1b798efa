"""Noise and discrepancy in the likelihood: the filter whitens what the dense covariance says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.noisy_runs import hoist_runs
from workbench.diagnose.hypotheses.model_error import ErrorModel, model_error_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import default_hoist, kind_of


def dense(errors: ErrorModel) -> np.ndarray:
    """The covariance of all rows, term by term."""
    n = len(errors.white)
    covariance = np.diag(errors.white**2)
    for i in range(n):
        along = 1.0
        for j in range(i, n):
            if j > i:
                along *= errors.carry[j]
            both = errors.model_error[i] * errors.model_error[j] * along
            covariance[i, j] += both
            covariance[j, i] += both if j > i else 0.0
    return covariance


@st.composite
def models(draw: st.DrawFn) -> ErrorModel:
    """Runs of a few rows each."""
    lengths = draw(st.lists(st.integers(1, 7), min_size=1, max_size=4))
    n = sum(lengths)
    seed = draw(st.integers(0, 10_000))
    random = np.random.default_rng(seed)
    carry = random.uniform(0.01, 0.999, n)
    carry[np.cumsum([0, *lengths[:-1]])] = 0.0
    moving, standstill = random.uniform(0.0, 5.0, (2, n))
    return ErrorModel(random.uniform(0.1, 2.0, n), moving, standstill, carry)


@given(models(), st.sampled_from([0.5, 1.0, 4.0, 64.0]), st.sampled_from([1.0, 8.0]))
@settings(max_examples=60, deadline=None)
def test_whitened_rows_are_independent_and_of_variance_one(default: ErrorModel, size: float, near: float):
    errors = default.sized((size, near))
    n = len(errors.white)
    whitening = errors.whiten(np.eye(n))
    assert whitening @ dense(errors) @ whitening.T == pytest.approx(np.eye(n), abs=1e-8)
    assert errors.log_det() == pytest.approx(np.linalg.slogdet(dense(errors))[1], abs=1e-8)


def test_a_constant_residual_of_a_long_correlation_counts_as_few_values():
    """One bias held through a run is one observation of the discrepancy, however many samples show it."""
    carry = np.full(400, 0.999)
    carry[0] = 0.0
    errors = ErrorModel(np.full(400, 0.01), np.ones(400), np.zeros(400), carry)
    white = errors.whiten(np.ones(400))
    assert float(white @ white) < 5.0


@pytest.fixture(scope="module")
def problem() -> Problem:
    machine = default_hoist()
    return Problem(machine, hoist_runs(machine))


def test_the_discrepancy_of_a_hoist_grows_with_the_torque_and_near_standstill(problem: Problem):
    d = np.hypot(*model_error_of(problem.bench, problem.rows))
    speed = np.concatenate([np.abs(m.speed[r]) for m, r in zip(problem.bench.motions, problem.rows, strict=True)])
    torque = np.concatenate([np.abs(u[r]) for u, r in zip(problem.bench.measured, problem.rows, strict=True)])
    assert np.all(d >= kind_of(problem.machine).model_error.load * torque - 1e-9)
    slow, fast = speed < 0.02 * problem.bench.scale, speed > 0.5 * problem.bench.scale
    if np.any(slow) and np.any(fast):
        assert np.mean(d[slow]) > np.mean(d[fast])
