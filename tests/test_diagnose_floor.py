"""What an axis leaves itself: how long it hangs together, and what that makes of the evidence."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.diagnose.verdict.structure import correlation_time


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
