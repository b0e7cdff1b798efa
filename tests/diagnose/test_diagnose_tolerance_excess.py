"""A wrong answer that leaves no residual stretches the base parameters' tolerances; a true one does not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.support.noisy_runs import hoist_runs, with_effects
from workbench.diagnose.hypotheses.fit import Fitted, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import FreeParameter, Scalar, base_parameters, effect_parameters
from workbench.diagnose.hypotheses.model_error import ErrorModel
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.verdict.unknown_cause import cancellation, tolerance_excess
from workbench.effects import find, ranges_of
from workbench.machines import default_hoist

ROWS = 400
SIGMA, SHARE = 0.7, 0.8
NONE = np.zeros(ROWS)
WHITE = ErrorModel(np.full(ROWS, SIGMA / math.sqrt(SHARE)), NONE, NONE, np.append(0.0, np.ones(ROWS - 1)))
LINEAR = cast(Problem, SimpleNamespace(errors=WHITE))
KNOWN = (20.0, 5.0, 1.0, 0.3, 0.05, 0.0, 8.0)  # how well the rows know each; the last is an effect's, without tolerance


def linear(random: np.random.Generator, off: float = 1.0) -> Fitted:
    """A linear campaign at its best: six base parameters drawn from `off` times their tolerances, an effect, and white
    noise as strong as in-band noise of SIGMA of which a row is worth 0.8 independent values."""
    columns = random.normal(size=(ROWS, len(KNOWN))) * KNOWN / math.sqrt(ROWS)
    held = np.array([1.0] * 6 + [0.0])
    truth = np.append(off * random.normal(size=6), 4.0)
    measured = columns @ truth + random.normal(scale=SIGMA / math.sqrt(SHARE), size=ROWS)
    weight2 = SHARE / SIGMA**2
    z = np.linalg.solve(weight2 * columns.T @ columns + np.diag(held), weight2 * columns.T @ measured)
    residual = measured - columns @ z
    free: list[FreeParameter] = [Scalar(f"p{k}", 0.0, 1.0, std=1.0 if h else math.inf) for k, h in enumerate(held)]
    chi2 = weight2 * float(residual @ residual)
    return Fitted(("e",), tuple(free), z, residual, -columns, chi2, float(z[:6] @ z[:6]), 1, True)


def test_honest_tolerances_are_stretched_by_chance_alone_however_few_of_them_the_data_determine():
    random = np.random.default_rng(4)
    excesses = [tolerance_excess(LINEAR, linear(random)) for _ in range(400)]
    assert np.mean(excesses) == pytest.approx(0.0, abs=0.2)
    assert np.std(excesses) == pytest.approx(1.0, abs=0.15)


def test_tolerances_that_are_not_kept_are_stretched():
    random = np.random.default_rng(5)
    assert np.median([tolerance_excess(LINEAR, linear(random, off=3.0)) for _ in range(40)]) > 3.0


def test_what_an_inexact_effect_may_bend_is_no_stretch():
    fit = linear(np.random.default_rng(8), off=4.0)
    excesses = [tolerance_excess(LINEAR, fit, allowed) for allowed in (0.0, 1.0, 10.0, 100.0, 1e6)]
    assert excesses[0] == tolerance_excess(LINEAR, fit) > 3.0
    assert all(a > b for a, b in itertools.pairwise(excesses))
    assert excesses[-1] < 0.0


# On a hoist


def answered(
    truth: dict[str, dict[str, float]], named: Sequence[str], begin: dict[str, float]
) -> tuple[Problem, Fitted]:
    """Runs of a hoist with noise and the effects of `truth` in it, and the fit of the effects `named`."""
    problem = Problem(default_hoist(), hoist_runs(with_effects(default_hoist(), truth), seed=4))
    free: list[FreeParameter] = list(base_parameters(problem.machine, problem.runs).values())
    z = [0.0] * len(free)
    for effect in [find(name, "hoist") for name in named]:
        ranges = ranges_of(effect, problem.machine, problem.runs)
        more, start = effect_parameters(effect, ranges, {r.symbol: begin[r.name] for r in ranges})
        free, z = [*free, *more], [*z, *start]
    return problem, fit_hypothesis(problem, named, free, np.array(z), 60)


@pytest.mark.parametrize(
    ("true", "amount", "begin", "instead", "other"),
    [
        ("payload_mass_error", {"payload_scale": 1.06}, 1.03, "torque_scale", {"gain": 1.03}),
        ("gearbox_inertia", {"inertia_kg_m2": 1.0}, 0.8, "friction_viscous", {"viscous_n_s_per_m": 100.0}),
    ],
)
def test_a_stand_in_that_leaves_no_residual_stretches_the_tolerances(
    true: str, amount: dict[str, float], begin: float, instead: str, other: dict[str, float]
):
    problem, own = answered({true: amount}, [true], dict.fromkeys(amount, begin))
    same, wrong = answered({true: amount}, [instead], other)
    floor = math.hypot(problem.noise, float(np.sqrt(np.mean(problem.errors.model_error**2))))
    assert own.rms(problem.inputs) < 1.1 * problem.noise
    assert wrong.rms(same.inputs) < 1.1 * floor
    assert tolerance_excess(problem, own) < 1.0
    assert tolerance_excess(same, wrong) > 3.0


# Two effects


def test_a_pair_that_stands_in_for_one_cause_is_against_itself_and_a_true_pair_is_not():
    pair = ("payload_mass_error", "torque_scale")
    begin = {"payload_scale": 1.01, "gain": 0.99}
    same, instead = answered({"gearbox_inertia": {"inertia_kg_m2": 1.0}}, pair, begin)
    true = {"friction_viscous": {"viscous_n_s_per_m": 2000.0}, "payload_mass_error": {"payload_scale": 1.06}}
    problem, both = answered(true, tuple(true), {"viscous_n_s_per_m": 1500.0, "payload_scale": 1.05})
    base = len(base_parameters(problem.machine, problem.runs))
    assert cancellation(same, instead, base) > 0.5
    assert cancellation(problem, both, base) < 0.1
    assert cancellation(problem, replace(both, effects=both.effects[:1]), base) == 0.0
