"""An unknown cause: the curve shows it, the table takes it away on runs it has not seen, and files carry it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.fit import Fitted, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import base_parameters, effect_parameters, within
from workbench.diagnose.hypotheses.held_out import folds_by_run, held_out
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import TOLERANCES, TURNED
from workbench.diagnose.location.profiles import spacing, times
from workbench.diagnose.location.where import where_of
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.tables import (
    TURN,
    columns_of,
    hats_of,
    in_no_file,
    points_of,
    rides_of,
    telling_points,
    variables_of,
    with_table,
)
from workbench.diagnose.unknown import Explained, explain, explained_machine, span, with_unknown
from workbench.effects import ranges_of
from workbench.logs import read_campaign
from workbench.machines import Hoist, LinearAxis, kind_of, load_machine, save_machine
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.replay import replay_runs

FAN_NM_S2, STEP_N, STEP_AT_M = 0.00156, 2640.3, 7.043  # of the labels of campaigns 32 and 33

Case = tuple[Problem, Fitted, Explained]


def base_fit(problem: Problem, bounded: bool = False) -> Fitted:
    free = list(base_parameters(problem.machine, problem.runs).values())
    if bounded:
        free = [within(parameter, TURNED if parameter.logarithmic else TOLERANCES) for parameter in free]
    return fit_hypothesis(problem, (), free, np.zeros(len(free)), 40)


def explained(folder: Path, bounded: bool = False, place: str = "") -> Case:
    campaign = read_campaign(folder)
    problem = Problem(campaign.machine, campaign.runs).exact()
    base = base_fit(problem, bounded)
    return problem, base, explain(problem, base, place=place)


@pytest.fixture(scope="module")
def fan(campaigns: Path) -> Case:
    """A drag on the motor that grows with the square of its speed."""
    return explained(campaigns / "32")


@pytest.fixture(scope="module")
def bounded_fan(campaigns: Path) -> Case:
    """The same, base parameters within their tolerances, as a diagnosis has it."""
    return explained(campaigns / "32", True, "motor")


@pytest.fixture(scope="module")
def rail(campaigns: Path) -> Case:
    """Rails that change their friction at one height."""
    return explained(campaigns / "33")


def test_a_fans_drag_is_a_curve_over_the_motors_speed(fan: Case):
    problem, _, explanation = fan
    best = explanation.curves[0]
    assert (best.over, best.acts_on) == ("speed_motor_rad_s", "motor")
    # Beside a level that friction may share, the curve is the fan's parabola.
    for levels in (best.forward, best.backward):
        square = np.stack([best.at**2, np.ones_like(best.at)], axis=1)
        (drag, _), left, *_ = np.linalg.lstsq(square, levels, rcond=None)
        assert drag == pytest.approx(FAN_NM_S2, rel=0.1)
        assert float(np.sqrt(left[0] / len(best.at))) < 0.05 * FAN_NM_S2 * best.at[-1] ** 2
    assert explanation.before > 4.0
    assert explanation.after < 1.2 * problem.noise
    assert explanation.held_out.rms(problem.inputs) < 0.25 * explanation.before


def test_the_stated_share_of_a_place_is_what_the_true_effect_takes_in_its_windows(bounded_fan: Case):
    """Refuted by a fit of the fan itself, base parameters beside it: 0 % were stated beside the right place."""
    problem, base, _ = bounded_fan
    where = where_of(problem, base)
    assert (where.subsystem, where.regime) == ("motor", "speed")
    effect = problem.effect("motor_fan")
    (size,) = ranges_of(effect, problem.machine, problem.runs)
    drag, start = effect_parameters(effect, (size,), {size.symbol: FAN_NM_S2})
    true = fit_hypothesis(problem, ("motor_fan",), [*base.free, *drag], np.append(base.z, start), 40)
    at, run_of = times(problem), problem.run_of_row
    inside = np.zeros(problem.inputs, dtype=bool)
    for window in where.windows:
        j = next(j for j, run in enumerate(problem.runs) if run.name == window.run)
        inside |= (run_of == j) & (window.from_s <= at) & (at <= window.to_s)
    left = np.where(inside, true.residual, base.residual)
    beyond = spacing(problem) @ (base.residual**2 - problem.noise**2)
    assert where.share == pytest.approx(spacing(problem) @ (base.residual**2 - left**2) / beyond, abs=0.05)


def test_what_a_law_takes_is_held_against_the_same_gap_as_all_else(bounded_fan: Case):
    problem, base, explanation = bounded_fan
    alone = held_out(problem, base, folds_by_run(problem)).rms(problem.inputs)
    said = next(sentence for sentence in explanation.sentences if sentence.startswith("As a law"))
    assert f"from {alone:.3g} to {explanation.law.after:.3g} N m" in said
    assert explanation.law.acts_on == explanation.curves[0].acts_on == "motor"
    (square,) = (
        value
        for value, formula in zip(explanation.law.values, explanation.law.formulas, strict=True)
        if "v |v|" in formula
    )
    assert square[1] == pytest.approx(FAN_NM_S2, rel=0.05)


def test_a_step_in_the_rails_is_a_curve_over_the_height(rail: Case):
    problem, _, explanation = rail
    best = explanation.curves[0]
    assert (best.over, best.acts_on) == ("position_carriage_m", "guide")
    for levels in (best.forward, best.backward):
        below, above = (float(np.median(levels[rows])) for rows in (best.at < 6.8, best.at > 7.3))
        assert above - below == pytest.approx(STEP_N, rel=0.1)
        half = best.at[1:][np.argmax(np.diff(levels))], best.at[:-1][np.argmax(np.diff(levels))]
        assert float(np.mean(half)) == pytest.approx(STEP_AT_M, abs=0.1)
    assert explanation.after < 1.2 * problem.noise
    assert explanation.held_out.rms(problem.inputs) < 1.3 * problem.noise
    assert best.explains > 0.98
    assert all(curve.explains < 0.5 for curve in explanation.curves[1:])


def test_the_table_lies_within_what_was_visited(rail: Case):
    problem, _, explanation = rail
    at = explanation.curves[0].at
    low = min(run.start_position_m for run in problem.runs) - 8.0
    assert 9 <= len(at) <= 17
    assert low < at[0] < at[-1] < 11.0


def test_the_base_parameters_go_back_to_where_they_belong(rail: Case):
    """Alone they bend to cover the step, as far as ten tolerances; beside the table they need not."""
    _, base, explanation = rail
    assert np.max(np.abs(base.z)) > 6.0
    assert np.max(np.abs(explanation.fitted.z)) < 3.0


def test_the_corrected_machine_is_a_file_that_replay_takes(rail: Case, tmp_path: Path):
    problem, base, explanation = rail
    save_machine(explained_machine(problem, explanation), tmp_path / "machine.yaml")
    machine = load_machine(tmp_path / "machine.yaml")
    assert isinstance(machine, Hoist) and machine.measured_correction is not None
    assert machine.measured_correction.over == "position_carriage_m"
    replayed = replay_runs(machine, problem.runs, problem.band_hz)
    keys = base_parameters(problem.machine, problem.runs)
    plain = replay_runs(refitted_machine(problem, keys, base), problem.runs, problem.band_hz)
    beside = in_no_file(problem, explanation.fitted.setting)
    (left,) = Problem(machine, problem.runs, problem.band_hz).exact().residuals([beside])
    assert float(np.sqrt(np.mean(left**2))) == pytest.approx(explanation.after, rel=1e-6)
    assert replayed.speed_rmse_percent < 0.5 * plain.speed_rmse_percent


def test_a_diagnosis_of_the_corrected_machine_starts_at_the_noise(rail: Case):
    problem, _, explanation = rail
    again = Problem(explained_machine(problem, explanation), problem.runs)
    (residual,) = again.residuals([{}])
    assert float(np.sqrt(np.mean(residual**2))) == pytest.approx(explanation.after, rel=0.02)


def test_each_fold_has_a_machine_that_has_not_seen_it(rail: Case):
    problem, _, explanation = rail
    assert len(explanation.machines) == len(problem.runs)
    beside = in_no_file(problem, explanation.held_out.settings[2])
    (left,) = Problem(explanation.machines[2], problem.runs, problem.band_hz).exact().residuals([beside])
    rows = np.flatnonzero(problem.run_of_row[: problem.inputs] == 2)
    assert explanation.held_out.residual[rows] == pytest.approx(left[rows], abs=1e-9)
    assert np.any(explanation.held_out.residual[rows] != explanation.fitted.residual[rows])


def test_the_same_campaign_is_explained_the_same_again(rail: Case):
    problem, base, explanation = rail
    again = explain(problem, base)
    assert [c.over for c in again.curves] == [c.over for c in explanation.curves]
    assert np.array_equal(again.curves[0].forward, explanation.curves[0].forward)
    assert again.sentences == explanation.sentences


def test_where_nothing_is_missing_no_table_is_made(campaigns: Path):
    problem, base, explanation = explained(campaigns / "01")
    assert with_unknown(problem.machine, explanation) is problem.machine
    assert explanation.fitted is base
    assert explanation.after == explanation.before
    assert "The corrected machine holds no table." in explanation.sentences[0]


def test_a_table_that_the_driven_machine_does_not_keep_is_dropped(campaigns: Path):
    """A late speed sensor is no force over anything, though a stiff machine's table promises a little."""
    problem, base, explanation = explained(campaigns / "18")
    assert with_unknown(problem.machine, explanation) is problem.machine
    assert explanation.fitted is base
    assert explanation.after == explanation.before


def test_a_fit_with_effects_is_refused(rail: Case):
    problem, base, _ = rail
    with pytest.raises(ValueError, match="drum_eccentricity"):
        explain(problem, replace(base, effects=("drum_eccentricity",)))


@pytest.mark.parametrize(
    ("over", "acts_on", "level", "slope"),
    [("position_carriage_m", "guide", 1200.0, 100.0), ("torque_load_nm", "motor", 3.0, 0.02)],
)
def test_the_stiff_machines_columns_are_what_the_driven_one_gains(
    rail: Case, over: str, acts_on: str, level: float, slope: float
):
    """Below the band the wire changes little of a force, and nothing of a torque at the motor."""
    problem, _, _ = rail
    variable = next(table for table in kind_of(problem.machine).tables if table.over == over)
    rides = rides_of(problem, {})
    at = points_of(problem, rides, variable)
    forward, backward = 0.4 * level + slope * at, 1.7 * level - 1.5 * slope * at
    linear = columns_of(problem, rides, variable, at, 1.0) @ np.concatenate([forward, backward])
    curve = replace(rail[2].curves[0], over=over, acts_on=acts_on, at=at, forward=forward, backward=backward)
    benches = [
        InverseSimulation(machine, problem.runs, problem.band_hz).balances()
        for machine in (problem.machine, with_table(problem.machine, curve))
    ]
    gained = np.concatenate(
        [(b.predicted - a.predicted)[rows] for a, b, rows in zip(*benches, problem.rows, strict=True)]
    )
    assert float(np.sqrt(np.mean((gained - linear) ** 2))) < 0.05 * float(np.sqrt(np.mean(linear**2)))


def test_hats_are_linear_between_points_and_flat_beyond():
    at = np.array([1.0, 2.0, 4.0])
    levels = np.array([10.0, 30.0, -10.0])
    x = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 9.0])
    assert hats_of(x, at, turn=False) @ levels == pytest.approx(np.interp(x, at, levels))


def test_hats_of_a_turn_close():
    at = np.linspace(0.0, TURN, 4, endpoint=False, dtype=np.float64)
    levels = np.array([0.0, 1.0, 2.0, 4.0])
    x = np.array([0.0, 3.5 / 4.0 * TURN, TURN + 0.125 * TURN, -0.125 * TURN])
    assert hats_of(x, at, turn=True) @ levels == pytest.approx([0.0, 2.0, 0.5, 2.0])


def test_telling_points_stand_around_a_step():
    at = np.linspace(0.0, 10.0, 41)
    step = np.where(at < 6.1, 0.0, 5.0)
    points = telling_points(at, np.concatenate([step, -step]), 6)
    assert {6.0, 6.25} <= set(points)
    assert (points[0], points[-1]) == (0.0, 10.0)


AXIS = {
    "kind": "axis", "motion": "linear", "mass_kg": 20.0, "gravity": {"constant_n": 0.0},
    "friction": {"coulomb_forward_n": 12.0, "coulomb_backward_n": 12.0, "viscous_n_s_per_m": 30.0},
}  # fmt: skip


def axis_runs(extra: Callable[[Array, Array], Array], names: tuple[str, ...]) -> tuple[Run, ...]:
    """Runs of 4 s at 1 kHz; extra(position, speed): the force against the motion that the machine does not know."""
    runs, random, time = [], np.random.default_rng(11), np.arange(4000) / 1000.0
    for k, name in enumerate(names):
        a, w = 0.2 + 0.02 * k, 2.0 * np.pi * (0.5 + 0.1 * k)
        position, speed = a * np.sin(w * time), a * w * np.cos(w * time)
        force = -20.0 * w**2 * position + 12.0 * np.sign(speed) + 30.0 * speed + extra(position, speed)
        signals = {
            "force_n": force + random.normal(scale=0.5, size=len(time)),
            "velocity_m_s": speed,
            "position_m": position,
        }
        runs.append(Run(name, time, signals, start_time_s=10.0 * k))
    return tuple(runs)


@pytest.mark.parametrize("names", [("a", "b", "c"), ("a",)])
def test_an_axis_is_explained_over_its_position_by_one_run_too(names: tuple[str, ...]):
    machine = LinearAxis.model_validate(AXIS)

    def rough(position: Array, speed: Array) -> Array:
        return np.asarray(15.0 * np.sign(speed) * np.exp(-(((position - 0.08) / 0.03) ** 2)))

    problem = Problem(machine, axis_runs(rough, names))
    explanation = explain(problem, base_fit(problem))
    best = explanation.curves[0]
    assert (best.over, best.acts_on) == ("position_m", "axis")
    assert best.at[np.argmax(best.forward)] == pytest.approx(0.08, abs=0.03)
    assert np.max(best.forward) - np.median(best.forward) == pytest.approx(15.0, rel=0.15 if len(names) > 1 else 0.3)
    assert explanation.after < 0.3 * explanation.before
    corrected = explained_machine(problem, explanation)
    assert corrected.measured_correction is not None


def test_tables_skip_what_the_runs_do_not_vary(rail: Case):
    problem = rail[0]
    alone = Problem(problem.machine, [problem.runs[0]])
    assert {"payload_kg", "campaign_time_s"} <= {variable.over for variable in variables_of(problem)}
    assert not {"payload_kg", "campaign_time_s"} & {variable.over for variable in variables_of(alone)}


def test_the_curve_is_said_in_words_with_units(rail: Case):
    _, _, explanation = rail
    said = " ".join(explanation.sentences)
    assert "A force at the guide that depends on the height of the carriage explains it best: 100 % of" in said
    assert re.search(r"It lies between −0\.\d and 2\.\d kN against the motion", said)
    assert re.search(r"where the runs have been, 2\.\d to 9\.\d m, and", said)
    assert "_" not in said and "e+0" not in said


@pytest.mark.parametrize(
    ("low", "high", "unit", "said"),
    [
        (-788.0, 2410.0, "N", "−0.8 to 2.4 kN"),
        (3.14, 9.81, "N m", "3.1 to 9.8 N m"),
        (-12345.0, -20.0, "N", "−12 to 0 kN"),
        (0.012, 0.134, "m/s", "0.01 to 0.13 m/s"),
        (0.0, 9000.0, "kg", "0 to 9000 kg"),
        (0.0, 0.0, "N", "0 to 0 N"),
    ],
)
def test_levels_are_said_to_the_second_digit_of_the_larger_one(low: float, high: float, unit: str, said: str):
    assert span(low, high, unit) == said
