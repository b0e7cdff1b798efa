"""One run that is not like the others is named: a wrong payload, swapped signals; and sound runs are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.diagnose.gap import UNLIKELY, alike_of, outliers
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Scalar
from workbench.diagnose.hypotheses.held_out import folds_by_run, held_out
from workbench.logs import Campaign, read_campaign
from workbench.machines import default_hoist

VISCOUS = {"friction_viscous": {"viscous_n_s_per_m": 4210.0}}


@cache
def six_runs() -> Campaign:
    """Three payloads, twice, with noise of their own."""
    machine = default_hoist().model_copy(update={"effects": VISCOUS})
    with TemporaryDirectory() as folder:
        first, second = (read_campaign(simulated_campaign(Path(folder) / str(k), machine, seed=k)) for k in (3, 4))
    again = tuple(replace(run, name=f"{run.name} again") for run in second.runs)
    return replace(first, runs=(*first.runs, *again))


def changed(name: str, **fields: object) -> Campaign:
    campaign = six_runs()
    runs = tuple(replace(run, **fields) if run.name == name else run for run in campaign.runs)  # type: ignore[arg-type]
    return replace(campaign, runs=runs)


def diagnosed(campaign: Campaign) -> Diagnosis:
    return diagnose(campaign, candidates=("friction_viscous",), quick=True)


def run_of(name: str) -> Run:
    return next(run for run in six_runs().runs if run.name == name)


def test_of_sound_runs_none_is_named_and_of_a_wrong_payload_that_run_is():
    sound = diagnosed(six_runs())
    assert not any("runs agree" in warning for warning in sound.warnings)
    assert not any(run.differs for run in sound.delivered.runs)
    wrong = diagnosed(changed("full again", payload_kg=0.85 * run_of("full again").payload_kg))
    (said,) = [warning for warning in wrong.warnings if "runs agree" in warning]
    assert said.startswith("5 runs agree; full again holds")
    assert [run.name for run in wrong.delivered.runs if run.differs] == ["full again"]


def test_swapped_motors_change_nothing_for_their_sum_drives_the_machine():
    signals = dict(run_of("half").signals)
    one, two = signals["torque_motor1_nm"], signals["torque_motor2_nm"]
    swapped = changed("half", signals=signals | {"torque_motor1_nm": two, "torque_motor2_nm": one})
    assert diagnosed(swapped).delivered == diagnosed(six_runs()).delivered


def test_torque_and_speed_in_each_others_column_are_refused_with_the_run():
    signals = dict(run_of("half").signals)
    torque, speed = signals["torque_motor_nm"], signals["speed_motor_rad_s"]
    swapped = signals | {"torque_motor_nm": speed, "speed_motor_rad_s": torque}
    with pytest.raises(InputError, match="half"):
        diagnosed(changed("half", signals=swapped))


def linear_runs(wrong: float, seed: int, last: float = 1.0) -> tuple[Any, Fitted, Fitted]:
    """Six runs, two a load, of friction, weight and inertia with noise of 1; the load of the last is off by `wrong`
    noises; last: its load. The problem, its fit without the term that is quadratic in speed, and that with it."""
    random, n = np.random.default_rng(seed), 100
    of = np.repeat(np.arange(6), n)
    speed = np.concatenate([v * np.sin(np.linspace(0.0, 12.0, n)) for v in (1.0, 0.6, 1.0, 0.3, 0.6, 1.0)])
    load, change = np.repeat([0.0, 0.0, 0.5, 0.5, 1.0, last], n), np.gradient(speed)
    x = np.column_stack([np.sign(speed), speed, load, load * np.sign(speed), change, load * change, speed * abs(speed)])
    y = x @ np.array([5.0, 8.0, 200.0, 3.0, 60.0, 40.0, 20.0]) + random.normal(size=len(of)) - wrong * (of == 5)

    def residuals(settings: Any) -> Any:
        return np.array([y - x @ np.array([setting.get(f"v{k}", 0.0) for k in range(7)]) for setting in settings])

    def fit(terms: int) -> Fitted:
        z = np.linalg.lstsq(x[:, :terms], y, rcond=None)[0]
        left = y - x[:, :terms] @ z
        free = tuple(Scalar(f"v{k}", 0.0, 1.0) for k in range(terms))
        return Fitted((), free, z, left, -x[:, :terms], float(left @ left), 0.0, 0, True)

    errors = SimpleNamespace(whiten=lambda rows: rows, sizes=(1.0, 1.0))
    problem = SimpleNamespace(
        runs=range(6), run_of_row=of, inputs=len(of), samples=len(of), errors=errors, kept={}, residuals=residuals
    )
    return problem, fit(6), fit(7)


def test_a_run_that_bends_the_fits_of_the_others_is_named_all_the_same():
    """Compared with fits that have the wrong run among theirs, one of 100 noises has a probability of 0.16."""
    problem, _, fit = linear_runs(100.0, 0)
    of, left = problem.run_of_row, problem.residuals(held_out(problem, fit, folds_by_run(problem)).settings)
    bent = [np.mean(row[of == j] ** 2) / np.mean(row[of != j] ** 2) for j, row in enumerate(left)]
    assert min(outliers(np.sqrt(bent))) > 0.1
    for wrong in (5.0, 20.0, 100.0):
        problem, poor, fit = linear_runs(wrong, 0)
        for fits in ([fit], [poor, fit]):  # it may have hidden what the others have in common
            p = alike_of(problem, fits)
            assert list(p < UNLIKELY) == [False] * 5 + [True]


@pytest.mark.parametrize("last", [1.0, 40.0])  # a load far from the others': what they foretell badly is no stranger
def test_of_runs_that_are_alike_one_is_named_in_a_hundred_campaigns_or_fewer(last: float):
    made = (linear_runs(0.0, seed, last) for seed in range(60))
    assert sum(np.any(alike_of(problem, [fit]) < UNLIKELY) for problem, _, fit in made) <= 2
