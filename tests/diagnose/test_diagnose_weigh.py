"""What a diagnosis concludes from fits: merits, held-out runs, standard errors, probabilities, shrink."""

from __future__ import annotations

import math
import types
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from tests.support.axes import emps
from tests.support.driven_campaign import driven
from tests.support.effect_machines import linear_axis, rotary_axis
from tests.support.fitted_runs import fitted_to, made_by
from tests.support.noisy_runs import axis_runs, hoist_runs, with_effects
from workbench.core.run import Array, Run
from workbench.diagnose.diagnose import sentence_of
from workbench.diagnose.gap import folds_of, shrink_of, stretch_of, worst_tolerance
from workbench.diagnose.hypotheses import evidence
from workbench.diagnose.hypotheses import held_out as held_out_module
from workbench.diagnose.hypotheses.evidence import Score, Weighed, cost, freedom, inexact, nested, weigh
from workbench.diagnose.hypotheses.fit import Fitted, estimates, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import (
    LOG_TIMING,
    FreeParameter,
    Names,
    Scalar,
    base_parameters,
    bounds_of,
    effect_parameters,
    setting_of,
)
from workbench.diagnose.hypotheses.held_out import (
    SETTLED,
    fitted_without,
    folds_by_run,
    held_out,
    in_parts,
    significance,
)
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.settings import LAW, calibration
from workbench.diagnose.verdict import judge
from workbench.diagnose.verdict.answer import Hypothesis, none_missed, rank
from workbench.diagnose.verdict.judge import Judged, alike, alternatives, groups_of, runners_up
from workbench.effects import effects_for, find, ranges_of
from workbench.machines import default_hoist, get_value, with_values
from workbench.references import Limits, Step, plan_motion

TORQUE = "torque_motor_nm"
AS_DECIDED = {"missed_no_gap": 0.0, "missed_unknown": 0.0}  # and so stated
NUMBERS = {
    **calibration(), "unknown_bias": -6.0, **AS_DECIDED
}  # fmt: skip


# Held-out runs


@pytest.fixture(scope="module")
def tight() -> tuple[Problem, Fitted]:
    """Runs of a hoist with a tight stretch, and the fit of it."""
    truth = {"friction_position_dependent": {"peak_n": 4500.0, "centre_m": 8.2, "width_m": 0.5}}
    return fitted_to(truth, {"peak_n": 3000.0, "centre_m": 8.5, "width_m": 0.6})


def test_what_was_not_seen_is_met_no_better_than_what_was(tight: tuple[Problem, Fitted]):
    problem, fit = tight
    unseen = held_out(problem, fit, folds_by_run(problem))
    assert fit.rms(problem.inputs) <= unseen.rms(problem.inputs) < 1.3 * problem.noise


def test_a_value_on_its_upper_bound_has_the_slope_and_the_standard_error_that_it_has_without_one(
    tight: tuple[Problem, Fitted],
):
    """Differenced over the bound, where no value changes, it was a slope of 0: the value was known exactly, to the data
    it was none, and a fit that had come to the bound never left it."""
    problem, fit = tight
    width = fit.free[-1]
    assert isinstance(width, Scalar)
    bounded = (*fit.free[:-1], replace(width, most=float(np.mean(fit.setting[width.symbol]))))
    at = np.minimum(fit.z, bounds_of(bounded)[1])
    held = replace(fit, free=bounded, z=at, jacobian=problem.evaluate(bounded, at)[1])
    slopes, free = held.jacobian[:, -1], problem.evaluate(fit.free, at)[1][:, -1]
    assert float(np.linalg.norm(slopes - free)) < 0.01 * float(np.linalg.norm(free))
    (*_, mine), (*_, its) = (estimates(problem, one)["friction_position_dependent"] for one in (held, fit))
    assert mine.std_error == pytest.approx(its.std_error, rel=0.05)


def test_what_a_fit_of_a_play_leaves_is_what_its_machine_leaves_alone():
    """Beside other values a simulation takes other steps, and parts that bounce meet at other times: what an axis left
    of a run was 1.3 % off that of the delivered machine."""
    play = {"backlash": {"play_rad": 0.06, "load_share": 0.5, "friction_over_load_share": 0.0}}
    problem = Problem(rotary_axis(), axis_runs(with_effects(rotary_axis(), play)))
    ranges = ranges_of(problem.effect("backlash"), problem.machine, problem.runs)
    more, start = effect_parameters(problem.effect("backlash"), ranges, {r.symbol: r.start for r in ranges})
    base = list(base_parameters(problem.machine, problem.runs).values())
    z = np.concatenate([np.zeros(len(base)), start])
    fit = fit_hypothesis(problem, ("backlash",), [*base, *more], z, 3, len(base))
    assert fit.residual == pytest.approx(problem.residuals([fit.setting])[0], abs=1e-9)
    assert fit.chi2 == pytest.approx(float(np.sum(problem.errors.whiten(fit.residual) ** 2)))


@pytest.mark.parametrize("lasting", [True, False])
def test_a_fit_goes_on_where_the_simulation_breaks_down_beside_its_point(
    lasting: bool, tight: tuple[Problem, Fitted], monkeypatch: pytest.MonkeyPatch
):
    """A hoist without noise bent base values by a hundred tolerances; a slope there was not finite, and it ended in a
    traceback. One with a damaged tooth was refused: the slope by friction near standstill was not finite on the way."""
    problem, _ = tight
    free = list(base_parameters(problem.machine, problem.runs).values())
    plain = fit_hypothesis(problem, (), free, np.zeros(len(free)), base=len(free))
    evaluate, broken = Problem.evaluate, list[int]()

    def breaks(self: Problem, free: Any, z: Array, only: Any = None, known: Any = None) -> tuple[Array, Array]:
        residual, jacobian = evaluate(self, free, z, only, known)
        # The slopes that last, or those that are differenced at each step, at a point beyond.
        if only is not None and np.any(z) and jacobian.size and (jacobian.shape[1] > 3) == lasting:
            broken.append(1)
            jacobian[::7, -1] = np.nan
        return residual, jacobian

    monkeypatch.setattr(Problem, "evaluate", breaks)
    found = fit_hypothesis(problem, (), free, np.zeros(len(free)), base=len(free))
    assert broken and np.all(np.isfinite(found.jacobian))
    assert found.objective == pytest.approx(plain.objective, rel=1e-3)


@given(st.integers(0, 10**6))
def test_a_refit_to_the_other_rows_is_the_best_one_within_bounds(seed: int):
    """A Newton step that was cut at the bounds led uphill, did not serve, and ended the refit where it had begun: of a
    linear hypothesis scipy's bounded least squares leave as much."""
    draw = np.random.default_rng(seed)
    count, inside = 12, np.arange(60) % 3 == 0
    common = draw.normal(size=(60, 1))  # columns that are alike share what they take
    slopes, target = draw.normal(size=(60, count)) + 10.0 * common, 4.0 * draw.normal(size=60)
    free = tuple(
        Scalar(f"x{k}", 0.0, 1.0, min(end, 0.0), max(end, 0.0), std=float(draw.choice([0.5, 3.0])))
        for k, end in enumerate(draw.choice([-1.5, 1.5], count))
    )
    begin = np.array([draw.uniform(low, high) for one in free for low, high in [(one.least, one.most)]])
    begin = np.where(draw.random(count) < 0.5, [one.least for one in free], begin)

    def rows(setting: Mapping[str, Any]) -> Array:
        return np.asarray(target + slopes @ [setting[one.symbol] for one in free])

    def differences(_: Any, settings: Sequence[Mapping[str, Any]], known: Array) -> tuple[Array, Array]:
        return known, np.array([rows(one) - known for one in settings])

    errors = types.SimpleNamespace(whiten=lambda white: white, sizes=(1.0, 1.0))
    posed = cast("Problem", types.SimpleNamespace(errors=errors, differences=differences))
    first = Fitted((), free, begin, target + slopes @ begin, slopes, 1.0, 1.0, 0, True)
    (found,) = fitted_without(posed, first, [inside])
    matrix = np.vstack([slopes[~inside], np.diag([1.0 / one.std for one in free])])
    right = np.concatenate([-target[~inside], np.zeros(count)])
    best = lsq_linear(matrix, right, ([one.least for one in free], [one.most for one in free]), tol=1e-12)
    assert found.objective == pytest.approx(2.0 * best.cost, abs=2.0 * SETTLED)


def test_a_phase_that_is_a_runs_own_is_taken_from_that_run():
    truth = {"heave": {"amplitude_m": 0.2, "frequency_rad_s": 0.9, "phase_rad": 1.0}}
    problem, fit = fitted_to(truth, {"amplitude_m": 0.15, "frequency_rad_s": 0.88, "phase_rad": (0.7, 1.2, 1.0)})
    (phases,) = [v for k, v in fit.setting.items() if k.endswith("phase_rad")]
    assert phases == pytest.approx((1.0, 1.0, 1.0), abs=0.15)
    unseen = held_out(problem, fit, folds_by_run(problem))
    assert unseen.rms(problem.inputs) < 1.3 * problem.noise
    for j, setting in enumerate(unseen.settings):
        (held,) = [v for k, v in setting.items() if k.endswith("phase_rad")]
        assert held[j] == pytest.approx(1.0, abs=0.25)  # type: ignore[index]
    rounding = 1e-12 * np.random.default_rng(1).normal(size=fit.jacobian.shape) * np.max(np.abs(fit.jacobian), axis=0)
    rounded = held_out(problem, replace(fit, jacobian=fit.jacobian + rounding), folds_by_run(problem))
    assert rounded.rms(problem.inputs) == pytest.approx(unseen.rms(problem.inputs), rel=1e-3)


@pytest.mark.parametrize(
    ("moves", "parts"),
    [
        ([(2.0, 0.4), (1.2, 0.4)], [0, 1]),
        ([(2.0, 0.4), (1.2, 0.4), (0.8, 0.4)], []),
        ([(2.0, 0.4), (0.6, 0.05), (0.4, 0.05)], [0]),
    ],
)
def test_a_run_that_no_others_can_foretell_is_held_out_in_parts(moves: list[tuple[float, float]], parts: list[int]):
    """A run with another load was foretold from one run by tolerances alone: the errors were a hundred times the gain,
    and the right cause, named of the first run, was none any longer with the one that was to settle it. And a servo's
    viscous friction was unknown, for slow runs foretold 1.7 times as much of the one fast run."""
    runs = []
    for name, (way, speed) in zip("abc", moves, strict=False):
        steps = [Step(by_m=way), Step(by_m=-way)]
        limits = Limits(speed, 1.0, 20.0)
        plan = plan_motion("ruckig", steps, 0.0, limits, (-np.inf, np.inf), 0.5, 0.5).sample(0.002)
        moved = {"position_m": plan.position_m, "speed_m_s": plan.speed_m_s}
        runs.append(Run(name, plan.time_s, {"force_n": 0.0 * plan.time_s, **moved}))
    problem = Problem(emps(), driven(emps(), runs, {"force_n": 2.0, "speed_m_s": 0.002}))
    folds = folds_by_run(problem)
    assert in_parts(problem) == parts
    assert len(np.unique(folds)) == len(runs) + 3 * len(parts)
    assert all(np.ptp(problem.run_of_row[folds[: problem.inputs] == fold]) == 0 for fold in np.unique(folds))


@pytest.mark.parametrize("missing", ["forward", "backward"])
def test_an_amount_that_the_other_runs_do_not_show_is_none_there(missing: str):
    """Half of the friction one way is missing, and one run alone goes backward. Without that run its level was told by
    noise at rest, and the right cause was barred for what a level thousands of deviations off leaves there."""
    runs, limits = [], Limits(0.4, 1.0, 20.0)
    for name, way in (("a", 2.0), ("b", 1.2), ("c", -2.0)):
        plan = plan_motion("ruckig", [Step(by_m=way)], 0.0, limits, (-np.inf, np.inf), 0.5, 0.5).sample(0.002)
        moved = {"position_m": plan.position_m, "speed_m_s": plan.speed_m_s}
        runs.append(Run(name, plan.time_s, {"force_n": 0.0 * plan.time_s, **moved}))
    runs = driven(emps(), runs, {"force_n": 2.0, "speed_m_s": 0.002})
    half = f"friction.coulomb_{missing}_n"
    problem = Problem(with_values(emps(), {half: 0.5 * get_value(emps(), half)}), runs)
    effect = find("friction_coulomb_asymmetric", problem.active.kind)
    ranges = ranges_of(effect, problem.machine, runs)
    more, start = effect_parameters(effect, ranges, {r.symbol: 5.0 for r in ranges})
    base = [*base_parameters(problem.machine, runs).values()]
    near = fit_hypothesis(problem, (), base, np.zeros(len(base)), 60)
    fit = fit_hypothesis(problem, (effect.id,), [*base, *more], np.concatenate([np.zeros(len(base)), start]), 60)
    whole, parts = (held_out(problem, fit, folds) for folds in (problem.run_of_row, folds_by_run(problem)))
    (level,) = [v for k, v in whole.settings[2].items() if k.endswith("level_backward_n")]
    assert level == pytest.approx(0.0, abs=2.0)
    assert significance(problem, near, fit) > 5.0
    # So the run is held out in parts: of the way that it goes alone no other run tells anything.
    assert in_parts(problem) == [2] and len(parts.settings) == 6
    assert list(np.unique(parts.fold_of_row[problem.run_of_row == 2])) == [2, 3, 4, 5]
    assert parts.rms(problem.inputs) < 1.2 * problem.noise
    assert (whole.rms(problem.inputs) > 2.0 * problem.noise) == (missing == "backward")


def told_by(
    left: Array,
    apart: Array,
    known: float,
    monkeypatch: pytest.MonkeyPatch,
    strain: float = 5.5,
    size: float = 1.0,
    by_runs_alone: bool = False,
) -> float:
    """The significance of an effect that a base parameter can stand in for, `strain` tolerances off nominal.

    left: (runs, rows) the remainder; apart: by how much left-out rows are predicted otherwise without the effect.
    known: a row's change by one tolerance of the parameter. size: of the model error that the machine needs.
    """
    column, remainder = np.full(left.size, known), left.ravel()
    problem = types.SimpleNamespace(
        errors=types.SimpleNamespace(whiten=lambda rows: rows, sizes=(size, 1.0)),
        runs=list(left),
        run_of_row=np.repeat(np.arange(len(left)), left.shape[1]),
        pulled=np.zeros(0, dtype=int),
        samples=left.size,
        inputs=left.size,
        ways=np.ones((2, len(left))),
        squares=np.ones(len(left)),
    )
    base, effect = Scalar("base", 0.0, 1.0, std=1.0), Scalar("effect", 0.0, 1.0)
    bent = float(column @ (column * strain - remainder)) / float(column @ column + 1.0)
    without, fit = (
        types.SimpleNamespace(
            free=free,
            z=np.array(z),
            prior=z[0] ** 2,
            jacobian=np.column_stack([column] * len(free)),
            residual=residual,
            held=held,
        )
        for free, z, residual, held in (
            ((base,), [bent], remainder + column * (bent - strain), remainder + apart.ravel()),
            ((base, effect), [0.0, strain], remainder, remainder),
        )
    )
    monkeypatch.setattr(held_out_module, "held_out", lambda _, fit, folds: types.SimpleNamespace(residual=fit.held))
    return significance(cast(Any, problem), *cast(Any, (without, fit)), by_runs_alone=by_runs_alone)


def test_rows_that_repeat_others_tell_no_more_beside_a_tolerance(monkeypatch: pytest.MonkeyPatch):
    """A payload's mass that relieved a tolerance by 5.8 deviations was none, for left-out rows that hang together spoke
    neither for it nor against it."""
    seen = np.repeat(np.random.default_rng(7).normal(size=(2, 4, 8)), 6, axis=2)
    seen[0] -= np.mean(seen[0])

    def told(times: int, size: float = 1.0) -> float:
        left, apart = np.repeat(seen, times, axis=2)
        return told_by(left, 0.2 * apart, 20.0, monkeypatch, size=size)

    assert [told(3), told(30)] == pytest.approx([told(1)] * 2, rel=0.02)
    assert told(1) > 4.0
    assert told(30, size=4.0) < 2.5  # what a machine leaves beyond its own model error may be another cause's


def test_a_strain_that_a_remainder_with_structure_can_make_is_no_cause(monkeypatch: pytest.MonkeyPatch):
    """A log's dead band bent an axis' inertia by six tolerances, all of them by rows that hang together."""
    left, apart = np.repeat(np.random.default_rng(7).normal(size=(2, 4, 8)), 50, axis=2)
    left -= np.mean(left)
    assert told_by(left, 0.2 * apart, 20.0, monkeypatch) > 4.0
    assert told_by(left, 0.2 * apart, 0.1, monkeypatch) < 1.7


def test_what_left_out_rows_lose_by_is_told_whatever_the_tolerances_gain(monkeypatch: pytest.MonkeyPatch):
    """A bent sensor of a motor bench came as an offset by its tolerances, 2.3 deviations against its left-out runs."""
    form = np.full((5, 400), 0.1118)
    noise = np.random.default_rng(8).normal(size=form.shape)
    left = noise - np.mean(noise) - form  # with the effect; without it less by the form
    assert told_by(left, form, 20.0, monkeypatch, 6.0) > 1.645
    assert told_by(left, form, 20.0, monkeypatch, 6.0, by_runs_alone=True) < -1.645


def test_some_samples_in_which_friction_turns_over_elsewhere_do_not_outweigh_the_runs(monkeypatch: pytest.MonkeyPatch):
    """Six of 7,500 held-out samples of an axis hid viscous friction that left 0.6 for 1.6 N in each run: unknown."""
    form = np.full((5, 400), 0.5)
    left = np.random.default_rng(8).normal(size=form.shape)
    assert told_by(left, form, 20.0, monkeypatch, 0.0) > 8.0
    left[4, 100:106], form[4, 100:106] = -12.0, 9.0
    assert told_by(left, form, 20.0, monkeypatch, 0.0) > 8.0


def test_rows_of_white_noise_count_as_they_are(monkeypatch: pytest.MonkeyPatch):
    """An effect of energy 25 is 2.5 deviations off by the rows alone, and a tolerance that it relieves adds to it; one
    that takes nothing and relieves nothing is as rarely significant as by chance."""
    rng, form = np.random.default_rng(8), np.full((5, 400), 0.1118)
    noises = [rng.normal(size=form.shape) for _ in range(300)]
    for strain, mean in ((0.0, 2.5), (3.3, 36.0 / math.sqrt(111.0))):
        told = [told_by(noise - np.mean(noise), form, 20.0, monkeypatch, strain) for noise in noises]
        assert float(np.mean(told)) == pytest.approx(mean, abs=0.4)
    idle = [told_by(noise - form, form, 20.0, monkeypatch, 0.0) for noise in noises]
    assert np.mean(np.array(idle) > 1.645) < 0.05


# Standard errors


def test_standard_errors_are_the_scatter_of_many_campaigns():
    """Torque noise drawn anew, base parameters drawn within their tolerances, as the fit believes they are."""
    hoist = Problem(default_hoist(), hoist_runs(default_hoist()))
    effect = find("friction_viscous", "hoist")
    (r,) = ranges_of(effect, hoist.machine, hoist.runs)
    base = list(base_parameters(hoist.machine, hoist.runs).values())
    more, start = effect_parameters(effect, (r,), {r.symbol: 3000.0})
    free: list[FreeParameter] = [*base, *more]
    held = np.array([not parameter.logarithmic for parameter in base])
    random, values, said = np.random.default_rng(8), [], []
    for _ in range(50):
        truth = np.concatenate([random.normal(size=len(base)) * held, start])
        clean = made_by(hoist, setting_of(free, truth))
        runs = [
            replace(run, signals={**run.signals, TORQUE: run[TORQUE] + random.normal(scale=4.0, size=len(run.time_s))})
            for run in clean.runs
        ]
        problem = Problem(hoist.machine, runs, hoist.band_hz)
        none = np.zeros(problem.samples)
        problem.errors = replace(problem.errors, moving=none, standstill=none)  # these runs have no discrepancy
        z = np.concatenate([np.zeros(len(base)), start])
        fit = fit_hypothesis(problem, (effect.id,), free, z, 30)
        (estimate,) = estimates(problem, fit)[effect.id]
        assert isinstance(estimate.value, float) and isinstance(estimate.std_error, float)
        values.append(estimate.value)
        said.append(estimate.std_error)
    assert np.mean(values) == pytest.approx(3000.0, abs=4.0 * float(np.std(values)) / math.sqrt(50))
    assert np.mean(said) == pytest.approx(np.std(values), rel=0.3)


# The verdict

NO_EVIDENCE = {"left": 0.0, "prior": 0.0}
merits = st.lists(st.floats(-20.0, 500.0), max_size=8)


@given(merits, st.floats(0.0, 3.0), st.booleans())
def test_probabilities_sum_to_one_and_the_answer_stands_first(values: list[float], open_left: float, rival: bool):
    rows = rank(named(values, rival), {**NO_EVIDENCE, "left": open_left}, NUMBERS, 6.0)
    assert sum(row.probability for row in rows) == pytest.approx(1.0)
    assert all(row.probability >= 0.0 for row in rows)
    total = {w: sum(r.probability for r in rows if r.verdict == w) for w in ("named", "no_gap", "unknown")}
    assert total[rows[0].verdict] == pytest.approx(max(total.values()))
    of_word = [row.probability for row in rows if row.verdict == rows[0].verdict]
    assert rows[0].probability == max(of_word)


def named(values: Sequence[float], rival: bool = False) -> list[tuple[Names, float]]:
    return [(() if rival and k == 0 else (f"e{k}",), value) for k, value in enumerate(values)]


@given(st.lists(st.floats(-20.0, 500.0), min_size=1, max_size=8), st.floats(0.0, 100.0))
def test_a_larger_merit_is_never_less_likely(values: list[float], more: float):
    def of_first(rows: Sequence[float]) -> float:
        return next(r.probability for r in rank(named(rows), NO_EVIDENCE, NUMBERS, 6.0) if r.effects == ("e0",))

    assert of_first([values[0] + more, *values[1:]]) >= of_first(values) - 1e-12


@pytest.mark.parametrize("numbers", [NUMBERS, calibration()])
def test_a_large_merit_without_evidence_against_it_is_named(numbers: dict[str, float]):
    rows = rank(named([20.0, 400.0, -5.0]), NO_EVIDENCE, numbers, 6.0)
    assert (rows[0].verdict, rows[0].effects) == ("named", ("e1",))
    assert rows[0].probability > 0.75


@pytest.mark.parametrize("numbers", [NUMBERS, calibration()])
def test_structure_that_the_best_leaves_makes_the_cause_unknown(numbers: dict[str, float]):
    left = {**NO_EVIDENCE, "left": 2.0}
    rows = rank(named([400.0]), left, numbers, 6.0)
    assert (rows[0].verdict, rows[0].effects) == ("unknown", ())


def test_an_unknown_cause_is_surer_of_a_machine_that_leaves_nothing_itself():
    """Of 22 hoists whose answer was unknown all had an unlisted cause, and 0.64 was stated."""
    left, numbers = {**NO_EVIDENCE, "left": 2.0}, calibration()
    alone, other = (rank(named([20.0]), left, these, 6.0)[0] for these in (none_missed(left, False, numbers), numbers))
    assert alone.verdict == other.verdict == "unknown"
    assert other.probability < 0.7 < 0.9 < alone.probability


def test_what_may_not_be_named_speaks_for_an_unknown_cause():
    rows = rank([((), 400.0), (("known",), 300.0)], NO_EVIDENCE, NUMBERS, 6.0)
    assert rows[0].verdict == "unknown"
    assert rows[0].probability > 0.9


@given(merits, st.floats(0.0, 3.0), st.booleans())
def test_what_is_stated_sums_to_one_changes_no_answer_and_makes_no_other_likelier(
    values: list[float], open_left: float, rival: bool
):
    told, evidence = named(values, rival), {**NO_EVIDENCE, "left": open_left}
    stated = rank(told, evidence, calibration(), 6.0)
    assert sum(row.probability for row in stated) == pytest.approx(1.0)
    decided = rank(told, evidence, {**calibration(), **AS_DECIDED}, 6.0)
    assert (stated[0].verdict, stated[0].effects) == (decided[0].verdict, decided[0].effects)
    assert {row.effects for row in stated} == {row.effects for row in decided}
    if stated[0].verdict == "named":
        total = {w: sum(r.probability for r in stated if r.verdict == w) for w in ("named", "no_gap", "unknown")}
        assert total["named"] == pytest.approx(max(total.values()))
    else:  # an unknown cause of 33 % once stood beside 42 % for no gap
        assert stated[0].probability == pytest.approx(max(row.probability for row in stated))
    assert [row.probability for row in stated[1:]] == sorted((row.probability for row in stated[1:]), reverse=True)


def search_of(problem: Problem, fit: Fitted) -> SearchResult:
    base = types.SimpleNamespace(z=fit.z[: len(base_parameters(problem.machine, problem.runs))])
    return cast(SearchResult, types.SimpleNamespace(problem=problem, base=base))


def test_what_predicts_the_same_input_is_a_twin(tight: tuple[Problem, Fitted]):
    problem, fit = tight

    def weighed(names: Names, merit: float, off: float = 0.0, strain: float = 0.0) -> Weighed:
        moved = replace(fit, residual=fit.residual + off * problem.noise, prior=fit.prior + strain)
        return Weighed(names, moved, 0.0, merit, Score(0.0, (1.0, 1.0), 1.0))

    told = [weighed(("a",), 40.0), weighed(("b",), 40.0), weighed(("c",), 40.0, 1.0), weighed(("d",), 39.0, strain=1.0)]
    assert groups_of(problem, told) == ((("a",), ("b",)),)
    # Of two exact twins one was named at 0.99: what is ordinary of its friction had been taken off the other alone.
    less = [weighed(("a",), 4337.5), weighed(("b",), 4282.6)]
    assert groups_of(problem, less) == ((("a",), ("b",)),)
    own = {"word": "named", "names": ("torque_offset",), "groups": ((("torque_offset",), ("carriage_mass_error",)),)}
    said = [weighed(("torque_offset",), 4337.5), weighed(("carriage_mass_error",), 4282.6)]
    judged = cast(Judged, types.SimpleNamespace(**own, weighed=said))
    assert alternatives(search_of(problem, fit), judged) == (("carriage_mass_error",),)
    pairs = [weighed(("a", "e"), 50.0), weighed(("b", "e"), 50.0), weighed(("b", "c"), 50.0), *told]
    assert groups_of(problem, pairs)[0] == (("a", "e"), ("b", "e"))
    assert groups_of(problem, [weighed(("a",), -1.0), weighed(("b",), -1.0)]) == ()


def test_what_is_alike_may_stand_in_for_one_effect_of_several(tight: tuple[Problem, Fitted]):
    fit, search = tight[1], search_of(*tight)

    def judged(names: Names, merits: Mapping[Any, float], worse_prior: float = 0.0) -> Judged:
        weighed = [
            Weighed(n, replace(fit, prior=worse_prior * (n != names)), 0.0, m, Score(0.0, (1.0, 1.0), 1.0))
            for n, m in merits.items()
        ]
        return cast(Judged, types.SimpleNamespace(word="named", names=names, weighed=weighed, groups=()))

    viscous, offset, mass = "friction_viscous", "torque_offset", "carriage_mass_error"
    pair = {(viscous, offset): 100.0, (mass, viscous): 95.0, ("heave", viscous): 80.0, (offset, "heave"): 40.0}
    assert alternatives(search, judged((viscous, offset), pair)) == ((mass, viscous),)
    assert alike(search, judged((viscous, offset), pair)) == (mass,)
    assert alike(search, judged((viscous, offset), pair, 10.0)) == ()  # it stretches the tolerances
    # A run that tells this mass from an offset leaves open what is as good as the mass.
    assert alternatives(search, judged((viscous, offset), pair), ("heave", viscous)) == (
        (viscous, offset),
        (mass, viscous),
    )
    single = {(offset,): 100.0, (mass,): 95.0, ("heave",): 80.0, (viscous, offset): 99.0}
    assert alike(search, judged((offset,), single)) == (mass,)
    # The simpler law of the same place and regime: alike where it leaves little more, as the only cause.
    freer = "friction_viscous_asymmetric"
    assert alike(search, judged((freer,), {(freer,): 1000.0, (viscous,): 960.0})) == (viscous,)
    assert alike(search, judged((freer, offset), {(freer, offset): 1000.0, (viscous, offset): 999.0})) == ()
    # The freer law: alike where it explains more than by chance (10 %); what it lacks of the threshold is taken off.
    # Levels of 321 and 7,984 N were called one level of both ways at 0.69; of 1,745 and 10,185 N at 0.55.
    assert alike(search, judged((viscous,), {(viscous,): 90.7, (freer,): 89.1})) == (freer,)
    assert alike(search, judged((viscous,), {(viscous,): 90.7, (freer,): 81.3})) == (freer,)
    assert alike(search, judged((viscous,), {(viscous,): 90.7, (freer,): 81.1})) == ()
    # A further run is asked for against a rival that the runs leave open only.
    assert runners_up(judged((viscous,), {(viscous,): 109.0, (freer,): 98.0, (mass,): 83.0}), "hoist") == ((mass,),)
    assert runners_up(judged((viscous,), {(viscous,): 539.0, (mass,): 117.0}), "hoist") == ()


def test_what_an_inexact_law_leaves_does_not_tell_the_causes_beside_it_apart(
    tight: tuple[Problem, Fitted], monkeypatch: pytest.MonkeyPatch
):
    """A carriage's mass beside another layer on the drum was an offset, 0.96: better by 31 of evidence, where the layer
    took 2,380 and left 8 N m of model error for 1."""
    monkeypatch.setattr(judge, "own_energy", lambda problem, w, names, base: 2380.0 * ("drum_layer_change" in names))
    layer, offset, mass = "drum_layer_change", "torque_offset", "carriage_mass_error"

    def told(excess: float, strain: float = 0.0) -> Names:
        score, strained = Score(0.0, (1.0, 1.0), excess), replace(tight[1], prior=tight[1].prior + strain)
        weighed = [
            Weighed((layer, offset), tight[1], 0.0, 2507.0, score),
            Weighed((mass, layer), strained, 0.0, 2476.0 - strain, score),
        ]
        judged = types.SimpleNamespace(word="named", names=(layer, offset), weighed=weighed, groups=())
        return alike(search_of(*tight), cast(Judged, judged))

    assert told(8.0) == (mass,)
    assert told(0.5) == ()  # exact laws: what is left is noise
    assert told(8.0, strain=13.0) == ()  # what tolerances tell no law is off


def test_a_law_of_each_direction_holds_that_of_both_and_no_other_kind_of_law():
    for kind in ("hoist", "slew_boom", "two_inertia"):
        names = effects_for(kind)
        pairs = {frozenset({one, other}) for one, other in combinations(names, 2) if nested(one, other, kind)}
        assert pairs == {
            frozenset({"friction_viscous", "friction_viscous_asymmetric"}),
            frozenset({"friction_coulomb", "friction_coulomb_asymmetric"}),
        }
        assert all(nested(max(pair), min(pair), kind) for pair in pairs)


def test_no_gap_beside_a_residual_that_noise_does_not_explain_states_it():
    answer = types.SimpleNamespace(word="no_gap", ranking=[Hypothesis("no_gap", (), 0.84)])
    for after, relevant in ((0.14, False), (2.7, False), (2.7, True)):
        shrink = types.SimpleNamespace(unit="N", before=after, after=after, noise=0.13)
        rest = types.SimpleNamespace(rms=after, percent_of_input=4.6, relevant=relevant, regime="speed")
        said = sentence_of(cast(Any, answer), cast(Any, shrink), cast(Any, rest), ())
        assert ("the model explains these runs" in said) == (after < 0.2)
        # 0.84 is that of no gap; that none of the library's effects explains it has an unknown cause's besides.
        assert ("No gap stands out (probability 0.84), and no effect of the library is named" in said) == (after > 0.2)
        assert ("leaves 2.7 N rms on runs held out, 21 times the noise and 4.6 % of the input" in said) == (after > 0.2)
        assert ("mostly with speed, enough to change a conclusion" in said) == relevant


def test_no_gap_is_not_credited_to_tolerances_that_the_refit_breaks():
    """The stated chance is that of a brute force over honest machines, and only an improbable value is stated."""
    parameters = {f"p{k}": types.SimpleNamespace(std=0.1, logarithmic=False) for k in range(6)}
    honest = np.abs(np.random.default_rng(4).standard_normal((200_000, len(parameters)))).max(axis=1)
    shrink = types.SimpleNamespace(unit="N m", before=0.1, after=0.1, noise=0.07)
    answer = types.SimpleNamespace(word="no_gap", ranking=[Hypothesis("no_gap", (), 0.76)])
    for count in (-3.5, -1.5, 2.9, 3.2):
        base = types.SimpleNamespace(z=np.array([0.0, 0.1 * count, 0.01, 0.0, -0.02, 0.0]))
        key, tolerances, chance = worst_tolerance(cast(Any, parameters), cast(Any, base))
        assert key == "p1"
        assert tolerances == pytest.approx(count)
        seen = float(np.mean(honest > abs(count)))
        assert chance == pytest.approx(seen, rel=0.02, abs=4.0 * math.sqrt(seen / honest.size))
        gap = types.SimpleNamespace(worst_tolerance=(key, tolerances), by_chance=chance)
        said = sentence_of(cast(Any, answer), cast(Any, shrink), cast(Any, None), (), gap=cast(Any, gap))
        assert ("within its tolerances" in said) == (chance >= 0.01)
        assert ("put p1 3.5 tolerances below its value" in said) == (count == -3.5)
        # A cause that these values could stand in for has not made the residual smaller.
        rest = types.SimpleNamespace(share=0.0, rms=0.0)
        cause = types.SimpleNamespace(word="named", names=("a",), ranking=[Hypothesis("named", ("a",), 0.7)])
        said = sentence_of(cast(Any, cause), cast(Any, shrink), cast(Any, rest), (), gap=cast(Any, gap))
        assert "shrinks" not in said  # 0.1 to 0.1
        assert f"put p1 {abs(count)} tolerances {'below' if count < 0.0 else 'above'} its value" in said
        assert ("as one machine in" in said) == (chance < 0.01)
    timing = {LOG_TIMING: types.SimpleNamespace(std=0.1, logarithmic=False)}
    late = types.SimpleNamespace(z=np.array([0.7]))
    assert worst_tolerance(cast(Any, timing), cast(Any, late))[0] == "log.speed_late_s"  # a key that a user can check
    base = types.SimpleNamespace(z=np.array([6.0, 0.0, 0.0, 0.0, 0.0, 0.0]))  # 60 tolerances: never by chance
    *worst, chance = worst_tolerance(cast(Any, parameters), cast(Any, base))
    gap = types.SimpleNamespace(worst_tolerance=tuple(worst), by_chance=chance)
    assert (
        stretch_of(cast(Any, gap))
        == "p0 60.0 tolerances above its value, as one machine in over a million would by chance"
    )


# The shrink


@pytest.fixture(scope="module")
def tight_search(tight: tuple[Problem, Fitted]) -> SearchResult:
    problem, fit = tight
    free = list(base_parameters(problem.machine, problem.runs).values())
    base = fit_hypothesis(problem, (), free, np.zeros(len(free)))
    return SearchResult(problem, base, base, {fit.effects: fit}, {}, ())


def test_the_interval_of_the_shrink_holds_its_factor_and_is_the_same_for_one_seed(tight_search: SearchResult):
    problem, names = tight_search.problem, ("friction_position_dependent",)
    keys = base_parameters(problem.machine, problem.runs)
    folds = folds_of(tight_search, names)
    first, again, other = (shrink_of(tight_search, keys, names, folds, seed) for seed in (7, 7, 8))
    assert first == again
    assert first.ci95[0] <= first.factor <= first.ci95[1]
    assert first.ci95[0] < first.ci95[1]
    assert other.ci95 == pytest.approx(first.ci95, rel=0.2)
    assert first.factor == first.before / first.after > 3.0
    assert first.after < 1.3 * first.noise
    assert set(first.by_run) == {run.name for run in problem.runs}
    squares = [b**2 * n for (_, b), n in zip(first.by_run.values(), problem.run_lengths, strict=True)]
    assert math.sqrt(sum(squares) / problem.inputs) == pytest.approx(first.after)
    assert first.speed_rmse_percent_after < first.speed_rmse_percent_before


def test_what_a_play_may_be_off_is_a_share_of_what_it_explains_itself(monkeypatch: pytest.MonkeyPatch):
    """And not of what base values took up beside it: a friction level that takes 16 tolerances of them had to take
    1,530 beyond, which is as much as there was."""
    monkeypatch.setattr(Problem, "struck", True)
    play = {"backlash": {"play_rad": 0.06, "load_share": 0.5, "friction_over_load_share": 0.8}}
    problem = Problem(rotary_axis(), axis_runs(with_effects(rotary_axis(), play)))
    effect, base = problem.effect("backlash"), base_parameters(problem.machine, problem.runs)
    ranges = ranges_of(effect, problem.machine, problem.runs)
    more, start = effect_parameters(effect, ranges, {r.symbol: play["backlash"][r.name] for r in ranges})
    z, free = np.concatenate([np.zeros(len(base)), start]), (*base.values(), *more)
    found = list[float]()
    for level in (0.0, 20.0):
        z[list(base).index("friction.coulomb_forward_nm")] = level
        fit = fit_hypothesis(problem, ("backlash",), free, z, 1, len(base))
        w = Weighed(("backlash",), fit, 0.0, 0.0, Score(0.0, (1.0, 1.0), 1.0))
        found.append(inexact(problem, w, len(base)))
    assert found[1] == pytest.approx(found[0], rel=0.3)
    nothing = problem.errors.whiten(problem.residuals([{}])[0])
    assert 0.0 < found[0] < LAW**2 * float(nothing @ nothing)


def test_a_cause_beside_a_play_counts_with_all_the_tolerances_that_it_relieves(monkeypatch: pytest.MonkeyPatch):
    """A friction level took off 24 of 27 of them beside a play whose law explains 2,400, of which 54 may be off: it was
    worth nothing."""
    names = {"inexact": 54.0, "cost": 6.0, "price": 5.7, "only_mends": False}
    for name, value in names.items():
        monkeypatch.setattr(evidence, name, lambda *_, value=value: value)
    monkeypatch.setattr(evidence, "beyond_model_error", lambda *_: 24.0)
    monkeypatch.setattr(evidence, "beyond_nuisance", lambda problem, fit, name, worth: worth)
    problem = cast(Any, types.SimpleNamespace(struck=True, active=types.SimpleNamespace(kind="two_inertia")))
    alone, both = (
        types.SimpleNamespace(effects=some, prior=p, z=())
        for some, p in ((("backlash",), 27.0), (("backlash", "friction_coulomb"), 3.0))
    )
    first = Weighed(("backlash",), cast(Any, alone), 0.0, 0.0, Score(0.0, (1.0, 1.0), 1.0))
    added = evidence._added(problem, cast(Any, alone), first, cast(Any, both), Score(-24.0, (1.0, 1.0), 1.0))
    assert added == pytest.approx(24.0 - 6.0 - 5.7)


def test_a_drift_that_is_as_good_as_constant_has_no_more_evidence_than_a_constant():
    """What a campaign's runs have alike of the machine's own counted against half of a winch's friction, and not
    against a drift of 4,000 s that foretold the same: neither was named."""
    machine = with_values(linear_axis(), {"friction.viscous_n_s_per_m": 4.0})
    runs = []
    for k, run in enumerate(axis_runs(with_effects(machine, {"friction_coulomb": {"level_n": 12.0}}))):
        own = 6.0 * np.sin(2.0 * math.pi * run["position_m"] / 0.1)
        runs.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + own}, start_time_s=25.0 * k))
    problem = Problem(machine, runs).with_model_error((3.0, 1.0))
    values = list(base_parameters(machine, runs).values())
    base = fit_hypothesis(problem, (), values, np.zeros(sum(one.size for one in values)))
    fits: dict[Names, Fitted] = {}
    for name, *begin in (("friction_coulomb", 12.0), ("friction_thermal_drift", 0.5, 4000.0)):
        ranges = ranges_of(find(name, "axis-linear"), machine, runs)
        at = {r.symbol: value for r, value in zip(ranges, begin, strict=True)}
        more, start = effect_parameters(find(name, "axis-linear"), ranges, at)
        fits[name,] = fit_hypothesis(problem, (name,), [*values, *more], np.append(base.z, start), base=len(base.z))
    constant, drift = weigh(problem, base, base, fits)
    better = constant.score.value - drift.score.value - cost(problem, 1)
    assert drift.evidence <= constant.evidence + better - float(freedom(better)) + 1e-9
