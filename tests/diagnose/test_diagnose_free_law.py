"""A cause that a law of one variable does without is none: the law's likelihood, and the verdict."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.diagnose.test_diagnose_established import EMPS, emps_in
from workbench.blind.recorded import bent, write_case
from workbench.blind.recording import recording
from workbench.core.run import Array
from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import Search
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.verdict.free_law import LENGTHS, SIZES, score
from workbench.diagnose.verdict.judge import judged_to_help
from workbench.effects import find
from workbench.logs import read_campaign


def test_a_law_gains_what_the_density_of_all_samples_gains_by_a_gaussian_process():
    """Against the matrix of them all, the parameters as likely as their tolerances."""
    rng, n = np.random.default_rng(4), 60
    at, knots = np.sort(rng.uniform(0.0, 1.0, n)), np.linspace(0.0, 1.0, 7)
    hats = np.maximum(1.0 - np.abs(at[:, None] - knots) * 6.0, 0.0)
    slope, std, residual = rng.normal(size=(n, 1)), 0.3, np.sin(4.0 * at) + rng.normal(size=n)
    parameter = SimpleNamespace(lowest=(-9.0,), highest=(9.0,), prior_std=(std,), size=1, logarithmic=False)
    fit = SimpleNamespace(free=(parameter,), z=np.array([0.1]), jacobian=slope, residual=residual)
    correlations = [np.exp(-0.5 * ((knots[:, None] - knots) / length) ** 2) for length in LENGTHS]
    roots = [np.asarray(np.linalg.cholesky(k + 1e-12 * np.eye(7)), dtype=float) for k in correlations]

    def surprise(law: Array) -> float:
        spread = np.eye(n) + law + std**2 * slope @ slope.T
        return float(-2.0 * multivariate_normal(cov=spread).logpdf(residual - 0.1 * slope[:, 0]))

    best = min(surprise(size**2 * hats @ k @ hats.T) for k in correlations for size in SIZES)
    white = SimpleNamespace(errors=SimpleNamespace(whiten=lambda rows: rows))
    fitted = Projection.of(cast(Any, white), cast(Any, fit))
    gained = float(fitted.residual @ fitted.residual) - score(fitted.clean(hats), fitted.residual, roots, 1.0)
    assert gained == pytest.approx(surprise(np.zeros((n, n))) - best, abs=1e-6) and gained > 5.0


FRICTIONS = ("friction_coulomb_asymmetric", "friction_coulomb", "friction_thermal_drift")


@pytest.mark.parametrize(
    ("bend", "word", "names"), [("gain_by_direction", "unknown", ()), ("drift", "named", ("friction_thermal_drift",))]
)
def test_friction_is_named_where_it_is_and_not_for_a_gain_of_one_direction(
    bend: str, word: str, names: tuple[str, ...], shared_data: Path
):
    """An unequal friction takes torque on one way, too. The gain's goes with the load, whose law does without it."""
    known = recording(shared_data / "campaigns" / "28")
    made = bent(bend, (9901, 6), known)
    assert made is not None
    machine, runs = made[0].machine, made[0].runs
    effects = [find(name, "hoist") for name in FRICTIONS]
    search = Search(Problem(machine, runs), effects, base=base_parameters(machine, runs))
    found = judged_to_help(search.exact(search.singles()))
    assert (found.word, found.names) == (word, names)


def test_a_drift_does_not_answer_for_what_an_axis_leaves_over_its_speed(shared_data: Path, tmp_path: Path):
    """EMPS leaves 2.5 N of that by itself, a third of what the drift takes."""
    emps_in(tmp_path, shared_data, EMPS.replace("mass_kg: 80.0", "mass_kg: 95.1089"))
    known = recording(tmp_path)
    made = bent("drift", (9901, 6), known)
    assert made is not None
    write_case(tmp_path / "drift", known, made[0], (9901, 6))
    campaign = read_campaign(tmp_path / "drift")
    found = diagnose(campaign, candidates=["friction_thermal_drift", "friction_coulomb"], most_effects=2, study=False)
    assert found.verdict.effects == ("friction_thermal_drift",)
