"""What is left of a run is called white where it is noise, and not where anything else is in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.simulated_campaign import TRUTH, simulated_campaign, true_machine
from workbench.diagnose.gap import outliers
from workbench.diagnose.residual_tests import ResidualTest, independent_stride, residual_test, residual_tests
from workbench.logs import read_campaign
from workbench.machines import Hoist, with_values
from workbench.simulate.lowpass import lowpass
from workbench.simulate.replay import replay_runs

TIME = np.arange(0.0, 60.0, 0.01)
BAND_HZ = 1.7
MOVING = (TIME % 20.0) < 15.0


def judged(residual: np.ndarray, variables: dict[str, np.ndarray] | None = None) -> ResidualTest:
    stride = independent_stride(TIME, BAND_HZ)
    left = np.where(MOVING, lowpass(TIME, residual, BAND_HZ), np.nan)[::stride]
    return residual_test("a", left, {k: v[::stride] for k, v in (variables or {}).items()}, stride * 0.01)


def test_low_passed_white_noise_is_white_but_for_one_run_in_a_hundred():
    random = np.random.default_rng(5)
    speed = np.sin(0.3 * TIME)
    tests = [judged(random.normal(size=len(TIME)), {"speed": speed}) for _ in range(300)]
    assert sum(not test.white for test in tests) <= 12  # 3 expected, 12 once in 10,000 times
    assert sum("speed" in test.related for test in tests) <= 12


@pytest.mark.parametrize("name", ["speed", "position"])
def test_what_depends_on_a_variable_is_neither_white_nor_unrelated(name: str):
    random = np.random.default_rng(6)
    variables = {"speed": np.cos(0.7 * TIME), "position": np.sin(0.7 * TIME)}
    test = judged(random.normal(size=len(TIME)) + 0.5 * variables[name], variables)
    assert not test.white
    assert name in test.related


def test_a_first_order_process_is_coloured():
    random = np.random.default_rng(7)
    left, x = np.empty(400), 0.0
    for k, e in enumerate(random.normal(size=400)):
        left[k] = x = 0.5 * x + e
    test = residual_test("a", left, {}, 1.0)
    assert test.autocorrelation[0] == pytest.approx(0.5, abs=0.12)
    assert not test.white


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("left") / "lifts", true_machine())


def test_of_a_machine_that_is_the_true_one_noise_is_left_and_of_a_wrong_one_more(folder: Path):
    campaign = read_campaign(folder)
    true = residual_tests(replay_runs(with_values(campaign.machine, TRUTH), campaign.runs))
    assert [test.run for test in true] == ["empty", "half", "full", "all runs"]
    assert all(test.white for test in true)
    assert isinstance(campaign.machine, Hoist)
    heavier = with_values(campaign.machine, TRUTH | {"carriage.mass_kg": 1.02 * campaign.machine.carriage.mass_kg})
    wrong = residual_tests(replay_runs(heavier, campaign.runs))
    assert not any(test.white for test in wrong)


def test_a_run_unlike_the_others_is_an_outlier_and_scatter_is_none():
    assert outliers(np.array([0.50, 0.55, 0.52, 0.51, 0.54, 1.6]))[-1] < 0.01
    assert min(outliers(np.array([0.50, 0.55, 0.52, 0.51, 0.54, 0.60]))) > 0.05
    assert min(outliers(np.array([0.3, 1.2, 0.5, 0.8, 0.4, 1.6]))) > 0.05  # all differ
    assert list(outliers(np.array([0.5, 5.0]))) == [1.0, 1.0]


def test_as_many_runs_are_called_unlike_by_chance_as_the_test_says():
    random = np.random.default_rng(8)
    called = [bool(np.any(outliers(np.exp(0.3 * random.normal(size=6))) < 0.01)) for _ in range(4000)]
    assert np.mean(called) < 0.015
