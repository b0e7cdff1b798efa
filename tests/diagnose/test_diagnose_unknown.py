"""An unknown cause: the curve shows it, the table takes it away on runs it has not seen, and files carry it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from tests.support.driven_campaign import driven, planned
from tests.support.emps_campaign import HELD, emps_in
from workbench.blind.recording import cut
from workbench.core.numbers import figures
from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.fit import Fitted, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import (
    LOG_TIMING,
    FreeParameter,
    base_parameters,
    effect_parameters,
    within,
)
from workbench.diagnose.hypotheses.held_out import folds_by_run, held_out
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import TOLERANCES, TURNED, Search, searched
from workbench.diagnose.law import Law, Term, find_law, solved
from workbench.diagnose.location.places import placed
from workbench.diagnose.location.profiles import spacing, times
from workbench.diagnose.location.where import laws_left, where_of
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.unknown import Explained, explain, explained_machine, with_unknown
from workbench.diagnose.verdict.answer import percent_of
from workbench.effects import find, ranges_of
from workbench.effects.active import logged, of
from workbench.effects.loading import load_effects
from workbench.effects.registry import forget_users
from workbench.logs import read_campaign
from workbench.machines import Hoist, LinearAxis, load_machine, save_machine
from workbench.simulate.replay import replay_runs

FAN_NM_S2, STEP_N, STEP_AT_M = 0.00156, 2640.3, 7.043  # of the labels of campaigns 32 and 33

Case = tuple[Problem, Fitted, Explained]


def base_fit(problem: Problem, bounded: bool = False) -> Fitted:
    free: list[FreeParameter] = list(base_parameters(problem.machine, problem.runs).values())
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
    assert explanation.law is not None
    said = next(sentence for sentence in explanation.sentences if sentence.startswith("As a law"))
    assert f"from {figures(alone)} to {figures(explanation.law.after)} N m" in said
    assert explanation.law.before == alone and f"takes {percent_of(explanation.law.explains)} of the gap's" in said
    assert "; v: speed. On" in said or "; v: speed; " in said  # what stands in the formula is explained
    assert "machine_law.yaml is the machine with it, law.py the effect" in said
    share = (alone**2 - (left := explanation.held_out.rms(problem.inputs)) ** 2) / (alone**2 - problem.noise**2)
    assert f"explains most: {percent_of(share)} of the gap's energy on runs that were left out" in " ".join(
        explanation.sentences
    ), (share, left)
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


def test_the_corrected_machine_is_a_file_that_replay_takes(rail: Case, tmp_path: Path):
    problem, base, explanation = rail
    save_machine(explained_machine(problem, explanation), tmp_path / "machine.yaml")
    machine = load_machine(tmp_path / "machine.yaml")
    assert isinstance(machine, Hoist) and machine.measured_correction is not None
    assert machine.measured_correction.over == "position_carriage_m"
    replayed = replay_runs(machine, problem.runs, problem.band_hz)
    keys = base_parameters(problem.machine, problem.runs)
    plain = replay_runs(refitted_machine(problem, keys, base), problem.runs, problem.band_hz)
    (left,) = Problem(machine, problem.runs, problem.band_hz).exact().residuals([{}])
    assert float(np.sqrt(np.mean(left**2))) == pytest.approx(explanation.after, rel=1e-6)
    assert replayed.speed_rmse_percent < 0.5 * plain.speed_rmse_percent


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


@pytest.mark.parametrize("seed", [5, 6, 7, 14])
def test_a_table_whose_gain_is_chance_is_dropped(seed: int):
    """A sensor that wanders in each run otherwise; of the tables tried one takes 17 to 24 % of it on left-out runs."""
    random = np.random.default_rng(seed)

    def wandering(position: Array, speed: Array) -> Array:
        time = np.arange(len(position)) / 1000.0
        waves = [
            4.0 * random.normal() * np.sin(2.0 * np.pi * f * time + random.uniform(0.0, 6.0)) for f in (0.1, 0.2, 0.35)
        ]
        return np.asarray(np.sum(waves, axis=0))

    problem = Problem(LinearAxis.model_validate(AXIS), axis_runs(wandering, ("a", "b", "c")))
    base = base_fit(problem, bounded=True)
    explanation = explain(problem, base)
    assert explanation.fitted is base and "which may be chance" in explanation.sentences[0]
    assert with_unknown(problem.machine, explanation) is problem.machine


def test_an_unlisted_effect_that_takes_next_to_nothing_is_not_in_the_machine():
    """ "With friction_step, an effect that is not listed, 0.0011 N m are left", of as much: 3 % of the energy."""

    def shaking(position: Array, speed: Array) -> Array:
        step = 0.6 * np.sign(speed) * (position > 0.05)
        return np.asarray(4.0 * np.sin(40.0 * np.arange(len(position)) / 1000.0) + step)

    problem = Problem(LinearAxis.model_validate(AXIS), axis_runs(shaking, ("a", "b", "c")))
    (rival,) = searched(problem, [find("friction_step", "axis-linear")], 1).fits.values()
    found = explain(problem, base_fit(problem, bounded=True), [rival])
    assert not found.effects and "not listed" not in " ".join(found.sentences)
    assert found.held_out.rms(problem.inputs) >= held_out(problem, rival, folds_by_run(problem)).rms(problem.inputs)


def test_a_table_of_a_late_log_is_driven_as_its_file_replays():
    """What machine.yaml says of the lateness counted twice: a table that promised 47 % was stated to take none."""
    machine = LinearAxis.model_validate(AXIS)
    runs = []
    for run in axis_runs(squared, ("a", "b", "c")):
        late = {name: run[name][:-1] for name in ("position_m", "velocity_m_s")}
        runs.append(replace(run, time_s=run.time_s[1:], signals={"force_n": run["force_n"][1:], **late}))
    problem = Problem(machine, runs)
    explanation = explain(problem, base_fit(problem, bounded=True))
    assert 0.0005 < float(np.mean(explanation.fitted.setting[LOG_TIMING])) < 0.002
    (left,) = Problem(explained_machine(problem, explanation), runs, problem.band_hz).exact().residuals([{}])
    assert float(np.sqrt(np.mean(left**2))) == pytest.approx(explanation.after, rel=1e-6)


def struck_at(runs: tuple[Run, ...], moved: bool, begin_s: float = 1.4) -> tuple[Run, ...]:
    """The second run with 30 N for 0.3 s: of a force that moves the axis, which a drive of third order answers at 6 Hz;
    or of the log's sensor, which nothing answers."""
    first, run, *others = runs
    u, step = (run.time_s - begin_s) / 0.3, run.sample_time_s
    force = np.where((u > 0.0) & (u < 1.0), 30.0 * np.sin(np.pi * u) ** 2, 0.0)
    late = lfilter(*butter(3, 2.0 * step * 6.0, "highpass"), force) if moved else 0.0 * force
    speed = run["velocity_m_s"] - np.cumsum(late / 20.0) * step
    signals = {"force_n": run["force_n"] + force - late, "velocity_m_s": speed, "position_m": np.cumsum(speed) * step}
    return (first, replace(run, signals=signals), *others)


@pytest.mark.parametrize(("moved", "place"), [(True, "axis"), (False, "torque_sensor")])
def test_a_blow_moves_an_axis_before_its_drive_answers_and_a_sensors_bump_does_not(moved: bool, place: str):
    """No reference is logged: whether the drive asked for the force is not known."""
    runs = struck_at(axis_runs(lambda position, speed: 0.0 * speed, ("a", "b", "c")), moved)
    where = where_of(problem := Problem(LinearAxis.model_validate(AXIS), runs), base_fit(problem, bounded=True))
    assert (where.subsystem, where.regime) == (place, "event")
    assert where.places[0].probability > 0.9


def test_a_speed_that_is_shown_too_low_for_a_while_lies_in_its_sensor():
    """As of an encoder whose coupling slips: it lay at the axis or the torque's sensor, whose bump is of any shape."""
    first, run, *others = axis_runs(lambda position, speed: 0.0 * speed, ("a", "b", "c"))
    u = (run.time_s - 1.5) / 0.3
    speed = run["velocity_m_s"] * (1.0 - 0.3 * np.where((u > 0.0) & (u < 1.0), np.sin(np.pi * u) ** 2, 0.0))
    shown = {"velocity_m_s": speed, "position_m": run["position_m"][0] + np.cumsum(speed) * run.sample_time_s}
    runs = (first, replace(run, signals={**run.signals, **shown}), *others)
    where = where_of(problem := Problem(LinearAxis.model_validate(AXIS), runs), base_fit(problem, bounded=True))
    assert (where.subsystem, where.regime) == ("speed_sensor", "event")


@pytest.mark.parametrize("moved", [True, False])
def test_an_event_beside_an_axis_own_ripple_is_the_cause(moved: bool):
    """The ripple is likelier by itself, for it is everywhere; no law of the motion foretells what is left."""
    runs = struck_at(axis_runs(lambda position, speed: 1.0 * np.sin(220.0 * position), ("a", "b", "c")), moved)
    where = where_of(problem := Problem(LinearAxis.model_validate(AXIS), runs), base_fit(problem, bounded=True))
    (event,) = where.events
    assert where.regime == "event" and event.run == "b" and event.from_s < 1.55 < event.to_s


def squared(position: Array, speed: Array) -> Array:
    return 40.0 * speed * np.abs(speed)


def rail_over_the_way(position: Array, speed: Array) -> Array:
    return 6.0 * np.sign(speed) * np.clip((position - 0.05) / 0.01, 0.0, 1.0)


@pytest.mark.parametrize(("extra", "regime"), [(squared, "speed"), (rail_over_the_way, "position")])
def test_a_force_on_an_axis_is_placed_there_over_what_it_depends_on(
    extra: Callable[[Array, Array], Array], regime: str
):
    problem = Problem(LinearAxis.model_validate(AXIS), axis_runs(extra, ("a", "b", "c")))
    where = where_of(problem, base_fit(problem, bounded=True))
    assert (where.subsystem, where.regime) == ("axis", regime)
    assert where.places[0].probability > 0.9 and where.share > 0.7


def test_what_a_real_axis_leaves_over_its_speed_lies_at_the_axis(shared_data: Path, tmp_path: Path):
    """By likelihood it lay in a sensor that takes a fifth of the energy at most, beside a law of the speed that takes
    half on runs it was not fitted to."""
    campaign = read_campaign(emps_in(tmp_path / "emps", shared_data, HELD))
    runs = [cut(campaign.machine, run, 3)[1] for run in campaign.runs]
    problem = Problem(campaign.machine, runs).with_model_error((2.0, 16.0))
    near = base_fit(problem, bounded=True)
    assert placed(problem, near).places[0].subsystem.endswith("sensor")
    where = where_of(problem, near)
    (speed,) = (profile for profile in where.profiles if profile.variable == "speed")
    assert where.subsystem == "axis" and where.share > 0.5 * speed.explains > 0.2


# A law in a formula: the form that made the data is found, its file gives what it promises, and noise has no law.


AXIS_LAW = LinearAxis.model_validate(
    {
        "kind": "axis",
        "motion": "linear",
        "mass_kg": 95.0,
        "friction": {"coulomb_forward_n": 20.0, "coulomb_backward_n": 20.0, "viscous_n_s_per_m": 200.0},
        "tolerances": {"inertia": 0.01, "coulomb": 0.05, "viscous": 0.05, "force_gain": 0.005, "force_offset_n": 0.3},
    }
)
NOISE = {"force_n": 0.3, "velocity_m_s": 1e-5}
SPEEDS = (0.08, 0.15, 0.3)


def still() -> list[Run]:
    return [planned(AXIS_LAW, f"at_{speed:g}", 0.2, speed, 250.0) for speed in SPEEDS]


def fitted(runs: list[Run]) -> tuple[Problem, Fitted]:
    problem = Problem(AXIS_LAW, runs)
    search = Search(problem, [], base=base_parameters(AXIS_LAW, runs))
    return problem, search._within_tolerances(search.base_fit())


def law_of(force: dict[str, dict[str, float]]) -> tuple[Law | None, list[Run]]:
    runs = driven(AXIS_LAW.model_copy(update={"effects": force}), still(), NOISE)
    return find_law(*fitted(runs), "axis"), runs


@pytest.fixture(scope="module")
def drag() -> tuple[Law | None, list[Run]]:
    return law_of({"friction_quadratic": {"drag_n_s2_per_m2": 150.0}})


def test_a_drag_is_found_as_the_square_of_the_speed(drag: tuple[Law | None, list[Run]]):
    law, _ = drag
    assert law is not None
    assert law.formulas == ["v |v|"]
    (name, value, error, unit), *_ = law.values
    assert (name, unit) == ("c1", "N s²/m²")
    assert value == pytest.approx(150.0, abs=max(4.0 * error, 8.0))
    assert law.explains > 0.9


def test_the_file_of_a_law_replays_to_the_residual_that_was_stated(drag: tuple[Law | None, list[Run]], tmp_path: Path):
    law, runs = drag
    assert law is not None
    (tmp_path / "law.py").write_text(law.source)
    (tmp_path / "machine.yaml").write_text(law.machine)
    try:
        load_effects(tmp_path / "law.py")
        replayed = replay_runs(load_machine(tmp_path / "machine.yaml"), runs)
        without = replay_runs(AXIS_LAW, runs)
    finally:
        forget_users()
    assert replayed.residual_rms_moving < without.residual_rms_moving
    assert replayed.residual_rms_moving == pytest.approx(law.rms, rel=0.03)  # all samples, thinned samples
    assert law.after < 1.5 * law.rms


def test_a_term_that_the_runs_never_show_ends_no_search_for_a_law():
    """A column of zeros, or two that are one: the others are solved for as without it."""
    x = np.random.default_rng(3).normal(size=(40, 3))
    twice, never = np.column_stack([x, x[:, 0]]), np.column_stack([x, np.zeros(40)])
    amounts = solved(
        np.stack([a.T @ a for a in (twice, never)]), np.stack([a.T @ x @ [4.0, 2.0, 1.0] for a in (twice, never)])
    )
    np.testing.assert_allclose(amounts, [[2.0, 2.0, 1.0, 2.0], [4.0, 2.0, 1.0, 0.0]], atol=1e-9)


def test_a_speed_that_is_logged_late_lies_in_its_sensor_and_follows_no_law():
    late = of(AXIS_LAW, {"speed_delay": {"delay_s": 0.005}})
    problem, near = fitted([logged(run, late) for run in driven(AXIS_LAW, still(), NOISE)])
    where = where_of(problem, near)
    assert where.subsystem == "speed_sensor" and where.share > 0.7
    assert max(law.interval[0] for law in laws_left(problem, near)) < 0.1


def test_a_place_below_zero_stands_in_a_formula_with_one_sign():
    step = Term(("s.x - {x_0}",), ("step(x − {x_0})",), "", "force", {"x_0": -0.41})
    assert step.texts(step.formula) == ["step(x + 0.41)"]
    assert step.texts(step.code) == ["s.x - -0.41"]


def test_noise_has_no_law():
    law, _ = law_of({})
    assert law is None or law.before - law.after < 0.1 * law.before


def test_a_step_over_place_is_found_where_it_lies():
    runs = driven(AXIS_LAW, still(), NOISE)
    where = 0.03
    forced = []
    for run in runs:
        position, velocity = run["position_m"], run["velocity_m_s"]
        extra = 12.0 * np.clip((position - where) / 0.004 + 0.5, 0.0, 1.0) * np.tanh(velocity / 0.002)
        forced.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + extra}))
    law = find_law(*fitted(forced), "axis")
    assert law is not None
    steps = [term for term in law.terms if "step" in term.formula[0] and "sign v" in term.formula[0]]
    assert steps
    assert steps[0].shape["x_0"] == pytest.approx(where, abs=0.01)


def test_a_mean_that_no_tolerance_holds_is_a_level_of_the_law():
    """Friction of 8 N on average, that comes and goes along the way, where the stated level holds to 1 N."""
    forced = []
    for run in driven(AXIS_LAW, still(), NOISE):
        extra = 8.0 * (1.0 + np.cos(2.0 * np.pi * run["position_m"] / 0.05)) * np.tanh(run["velocity_m_s"] / 0.002)
        forced.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + extra}))
    law = find_law(*fitted(forced), "axis")
    assert law is not None
    assert "sign v" in law.formulas
    (wave,) = [term for term in law.terms if "d" in term.shape]
    assert wave.shape["d"] == pytest.approx(0.05, rel=0.01)
    assert max(law.amplitudes) == pytest.approx(8.0, rel=0.02) == law.amplitudes[law.formulas.index("sign v")]
    assert law.explains > 0.99


def test_a_friction_that_grows_along_the_way_has_an_amount_with_one_power_of_the_metre():
    """It was in N s/m m."""
    forced = []
    for run in driven(AXIS_LAW, still(), NOISE):
        extra = 300.0 * run["position_m"] * run["velocity_m_s"]
        forced.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + extra}))
    law = find_law(*fitted(forced), "axis")
    assert law is not None
    units = {formula: unit for formula, (_, _, _, unit) in zip(law.formulas, law.values, strict=True)}
    assert units["x v"] == "N s/m²"
