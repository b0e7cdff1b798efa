"""What comes again with place or speed is told from what each run has of its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.noisy_runs import hoist_runs
from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.verdict.unknown_cause import lasting_share, loaded_share, repeated_share, sudden_share
from workbench.machines import default_hoist, kind_of


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Three runs over the same stretch, the last two of one payload."""
    return Problem(default_hoist(), hoist_runs(default_hoist()))


def of_rows(problem: Problem, name: str) -> Array:
    parts = [getattr(m, name)[rows] for m, rows in zip(problem.bench.motions, problem.rows, strict=True)]
    return np.concatenate(parts)


def test_friction_that_goes_with_the_speed_comes_again(problem: Problem):
    speed = of_rows(problem, "speed")
    assert repeated_share(problem, np.sign(speed)) > 0.8


def test_what_goes_with_the_place_comes_again_on_another_run_over_it(problem: Problem):
    kind = kind_of(problem.machine)
    runs = zip(problem.runs, problem.bench.motions, problem.rows, strict=True)
    place = np.concatenate(
        [kind.place_of(problem.machine, run.start_position_m, m.position)[rows] for run, m, rows in runs]
    )
    bump = np.exp(-((place - np.median(place)) ** 2))
    assert repeated_share(problem, bump) > 0.4


def test_a_gain_that_differs_between_the_ways_comes_again_with_the_load(problem: Problem):
    measured = np.concatenate([u[rows] for u, rows in zip(problem.bench.measured, problem.rows, strict=True)])
    noise = np.random.default_rng(1).normal(size=problem.samples)
    gain = np.where(of_rows(problem, "speed") > 0.0, 0.05 * (measured - np.mean(measured)), 0.0)
    assert loaded_share(problem, gain) > 0.3 > 0.05 > loaded_share(problem, noise)


def test_noise_does_not(problem: Problem):
    assert repeated_share(problem, np.random.default_rng(1).normal(size=problem.samples)) < 0.05


def test_an_impact_is_sudden_and_noise_is_not(problem: Problem):
    noise = np.random.default_rng(1).normal(size=problem.samples)
    impact = np.where(np.arange(problem.samples) == problem.samples // 3, 100.0, 0.0)
    assert sudden_share(problem, noise) == 0.0
    assert sudden_share(problem, noise + impact) > 0.8


def test_an_impact_near_standstill_is_friction_and_not_sudden():
    """An axis forth and back: the same impact, once at full speed and once while it turns."""
    speed = np.sin(np.linspace(0.0, 4.0 * np.pi, 1001))
    motion, rows = SimpleNamespace(speed=speed), np.arange(len(speed))
    axis: Any = SimpleNamespace(inputs=len(speed), rows=[rows], bench=SimpleNamespace(motions=[motion]))
    noise = np.random.default_rng(1).normal(size=len(speed))
    turning, fast = (np.where(rows == at, 100.0, 0.0) for at in (500, 625))
    assert sudden_share(axis, noise + turning) == 0.0
    assert sudden_share(axis, noise + fast) > 0.8


def test_friction_that_sets_in_during_each_run_lasts(problem: Problem):
    """A stick that jams: friction from some moment of each run on."""
    speed, lengths = of_rows(problem, "speed"), [len(rows) for rows in problem.rows]
    later = np.concatenate([np.arange(n) > 0.6 * n for n in lengths])
    noise = 0.1 * np.random.default_rng(1).normal(size=len(speed))
    assert lasting_share(problem, np.sign(speed) * (later - 0.4) + noise) > 0.8


def test_neither_noise_nor_what_wanders_a_little_lasts(problem: Problem):
    rng = np.random.default_rng(1)
    assert lasting_share(problem, rng.normal(size=problem.samples)) == 0.0
    assert lasting_share(problem, np.zeros(problem.samples)) == 0.0
    wandering = np.convolve(rng.normal(size=problem.samples), np.ones(10) / 10.0, mode="same")
    assert lasting_share(problem, wandering) < 0.1
