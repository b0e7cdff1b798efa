"""What effects change in the control study: figures by closed forms and by the closed loop itself, words by figures."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.margins import family, operating_points, weakest
from workbench.core.numbers import figures
from workbench.core.run import Run
from workbench.machines import ROTARY, Hoist, default_hoist, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.study.consequences import (
    Consequences,
    _sentences,
    as_json,
    consequences_of,
    consequences_table,
    small_study,
)
from workbench.study.load import load_study
from workbench.study.run import run_specs, run_study

ROOT = Path(__file__).resolve().parents[2]
PAYLOADS = (0.0, 9000.0)


def with_effects(**effects: dict[str, float]) -> Hoist:
    return default_hoist().model_copy(update={"effects": effects})


def consequences_for(corrected: Hoist, nominal: Hoist | None = None, **how: object) -> Consequences:
    changes, why = consequences_of(nominal or default_hoist(), corrected, payloads_kg=PAYLOADS, **how)  # type: ignore[arg-type]
    assert changes is not None, why
    return changes


HEAVIER = ideal_hoist().model_copy(update={"effects": {"gearbox_inertia": {"inertia_kg_m2": 0.3}}})


@pytest.fixture(scope="module")
def heavier() -> Consequences:
    """Behind an ideal drive: margins and gains that the shaft's inertia alone decides."""
    return consequences_for(HEAVIER, ideal_hoist())


@pytest.fixture(scope="module")
def overloaded() -> Consequences:
    return consequences_for(with_effects(payload_mass_error={"payload_scale": 4.0}))


def said(changes: Consequences, start: str) -> str:
    (one,) = [sentence for sentence in changes.sentences if sentence.startswith(start)]
    return one


def test_the_same_machine_twice_changes_nothing_and_says_so():
    changes = consequences_for(default_hoist())
    assert changes.effects == ()
    assert all(row.before == row.after for row in changes.rows)
    assert changes.loop_before == changes.loop_after
    assert changes.gains_before == changes.gains_after
    assert not any(choice.changed for choice in changes.choices)
    text = " ".join(changes.sentences)
    assert "before and after its correction" in text
    for unchanged in ("torque peak per motor does not change", "margins do not change", "as before"):
        assert unchanged in text


def test_gearbox_inertia_adds_its_torque_to_the_peak(heavier: Consequences):
    # Both motors together carry dJ · alpha; a jerk-limited ramp overshoots little.
    alpha = heavier.study.limits.acceleration_m_s2 / default_hoist().lift_m_per_rad
    for row in (row for row in heavier.rows if row.reference == "ruckig"):
        more = row.after["peak_torque_motor_nm"] - row.before["peak_torque_motor_nm"]
        assert more == pytest.approx(0.3 * alpha / 2.0, rel=0.15)
        assert row.percent("peak_torque_motor_nm") == pytest.approx(100.0 * more / row.before["peak_torque_motor_nm"])


def test_what_was_nothing_goes_from_nothing_and_no_percentage_is_told_of_it(heavier: Consequences):
    name = "peak_torque_motor_nm"
    first, *others = heavier.rows
    idle = replace(first, before=replace(first.before, metrics={**first.before.metrics, name: 0.0}))
    sentences = _sentences(replace(heavier, rows=(idle, *others)), HEAVIER)
    (of_peak,) = [sentence for sentence in sentences if "goes from 0 to" in sentence]
    assert f"{first.after[name]:.3g} N m at" in of_peak
    assert not any("nan" in sentence for sentence in sentences)


def test_a_row_is_the_run_of_the_closed_loop(heavier: Consequences):
    s, machine = heavier.study, HEAVIER
    steps = [Step(by_m=s.travel_m), Step(dwell_s=2.0), Step(by_m=-s.travel_m)]
    plan = plan_motion("trapezoid", steps, s.start_position_m, s.limits, (0.0, 25.0), 1.0, 2.0)
    speed = motor_speed_rad_s(plan.sample(0.001).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    (run,) = simulate_loop([LoopCase("", machine, 9000.0, s.start_position_m, s.controller, speed)])
    (row,) = [r for r in heavier.rows if (r.payload_kg, r.reference) == (9000.0, "trapezoid")]
    for metric in ("peak_torque_motor_nm", "speed_error_max_rad_s", "min_wire_tension_n"):
        assert row.after[metric] == pytest.approx(run.metrics[metric], rel=1e-9)
    assert row.after["move_time_s"] == pytest.approx(sum(end - start for start, end in plan.move_windows))


def test_at_equal_limits_the_smoother_reference_is_said_to_take_longer_and_by_how_much(heavier: Consequences):
    s = heavier.study
    steps = [Step(by_m=s.travel_m), Step(dwell_s=2.0), Step(by_m=-s.travel_m)]
    text = said(heavier, "At equal limits is not at equal time")
    for name in ("trapezoid", "ruckig"):
        plan = plan_motion(name, steps, s.start_position_m, s.limits, (0.0, 25.0), 1.0, 2.0)
        assert f"{name} takes at most {figures(sum(b - a for a, b in plan.move_windows))} s" in text
    assert "not at equal time" not in " ".join(_sentences(replace(heavier, rows=heavier.rows[:1]), HEAVIER))


def test_the_loop_is_the_weakest_of_the_family_of_each_machine(heavier: Consequences):
    s = heavier.study
    points = operating_points(default_hoist(), PAYLOADS, s.heights_m)
    worst = weakest(family(HEAVIER, s.controller, points))
    assert heavier.loop_after.ms == worst.margins.ms
    assert heavier.loop_after.phase_margin_deg == worst.margins.phase_deg
    assert heavier.loop_after.gain_margin_db == pytest.approx(20.0 * math.log10(worst.margins.gain_up))
    before = weakest(family(ideal_hoist(), s.controller, points))
    assert heavier.loop_before.phase_margin_deg == before.margins.phase_deg
    # The crossover falls with the inertia: the integral turns the phase further there, and so does the wire.
    corner_hz = s.controller.ki_nm_per_rad / s.controller.kp_nm_s_per_rad / (2.0 * math.pi)
    lags = [
        math.degrees(math.atan(corner_hz / loop.crossover_hz)) for loop in (heavier.loop_before, heavier.loop_after)
    ]
    assert heavier.loop_before.phase_margin_deg - heavier.loop_after.phase_margin_deg > lags[1] - lags[0] > 1.5
    assert "the least phase margin goes from" in said(heavier, "Over loads and heights")


def test_an_effect_on_a_sensor_changes_no_run_and_no_loop_and_the_sentence_says_why():
    changes = consequences_for(with_effects(torque_scale={"gain": 1.1}))
    assert all(row.before == row.after for row in changes.rows)
    assert changes.loop_before == changes.loop_after
    assert "torque_scale" in said(changes, "On the log alone")


def test_heave_counts_with_the_worst_of_four_phases_figure_by_figure():
    wave = {"amplitude_m": 1.0, "frequency_rad_s": 1.1}
    changes = consequences_for(with_effects(heave=wave))
    by_phase = [_at_phase(wave, k * math.pi / 2.0, changes) for k in range(4)]
    for i, row in enumerate(changes.rows):
        assert row.after["peak_torque_motor_nm"] == max(figures[i]["peak_torque_motor_nm"] for figures in by_phase)
        assert row.after["min_wire_tension_n"] == min(figures[i]["min_wire_tension_n"] for figures in by_phase)
    peaks = [figures[0]["peak_torque_motor_nm"] for figures in by_phase]
    assert max(peaks) > 1.01 * min(peaks)
    assert "4 phases" in said(changes, "heave: the phase")


@pytest.mark.parametrize("placed", [True, False])
def test_a_phase_that_the_runs_tell_is_kept_and_one_of_each_run_counts_with_its_worst(placed: bool):
    """A ripple of an axis that logs where it is has one phase: with and without it is that machine's own study."""
    axis, t = ROTARY.example(), np.arange(0.0, 6.0, 0.01)
    logs = {"speed_rad_s": np.cos(t), "torque_nm": np.cos(t)}
    run = Run("there_and_back", t, logs | ({"angle_rad": np.sin(t)} if placed else {}))
    rippled = axis.model_copy(update={"effects": {"torque_ripple": {
        "amplitude_nm": 0.05, "order_per_turn": 3.0, "phase_rad": 1.0,
    }}})  # fmt: skip
    changes, why = consequences_of(axis, rippled, runs=[run])
    assert changes is not None, why
    own = [row["peak_torque_nm"] for row, _ in run_specs(changes.study.specs(rippled))]
    assert ([row.after["peak_torque_nm"] for row in changes.rows] == own) == placed
    assert ("4 phases" in " ".join(changes.sentences)) != placed


def _at_phase(wave: dict[str, float], phase: float, changes: Consequences) -> list[dict[str, float]]:
    machine, s = with_effects(heave=wave | {"phase_rad": phase}), changes.study
    steps = [Step(by_m=s.travel_m), Step(dwell_s=2.0), Step(by_m=-s.travel_m)]
    cases = []
    for row in changes.rows:
        plan = plan_motion(row.reference, steps, s.start_position_m, s.limits, (0.0, 25.0), 1.0, 2.0)
        slowest = plan_motion("ruckig", steps, s.start_position_m, s.limits, (0.0, 25.0), 1.0, 2.0).duration_s
        speed = plan.sample(0.001, slowest).speed_m_s
        motor = motor_speed_rad_s(speed, machine.gearbox.ratio, machine.winch.drum_diameter_m)
        cases.append(LoopCase("", machine, row.payload_kg, s.start_position_m, s.controller, motor))
    return [result.metrics for result in simulate_loop(cases, record_every=0)]


def test_a_load_that_the_motors_no_longer_hold_is_a_row_with_its_reason_and_a_sentence(overloaded: Consequences):
    failed = [row for row in overloaded.rows if row.payload_kg == 9000.0]
    assert all(row.before.ok and not row.after.ok and "the motors give at most" in row.after.reason for row in failed)
    assert all(math.isnan(row.percent("peak_torque_motor_nm")) for row in failed)
    assert "holding the load takes" in said(overloaded, "Possible no longer at 9000 kg with ruckig")
    assert "not known, a run failed at 9000 kg" in said(overloaded, "The better reference by torque peak")


def measured(payload: float, start_m: float, by_m: float, seed: int, irregular: bool = False) -> Run:
    """A log of one move up and down, 0.5 m/s and 0.4 m/s², with a sensor's noise."""
    machine, rng = default_hoist(), np.random.default_rng(seed)
    plan = plan_motion(
        "trapezoid", [Step(by_m=by_m), Step(by_m=-by_m)], start_m, Limits(0.5, 0.4), (0.0, 25.0), 1.0, 1.0
    )
    t = np.arange(0.0, plan.duration_s, 0.01)
    if irregular:
        t = np.sort(rng.uniform(0.0, plan.duration_s, len(t)))
    speed = motor_speed_rad_s(plan.at(t)[1], machine.gearbox.ratio, machine.winch.drum_diameter_m)
    return Run(f"run{seed}", t, {"speed_motor_rad_s": speed + rng.normal(scale=0.1, size=len(t))}, payload, start_m)


@pytest.mark.parametrize("irregular", [False, True], ids=["even time", "irregular time"])
def test_the_small_study_is_that_of_the_campaigns_runs(irregular: bool):
    loads = (0.0, 3000.0, 5000.0, 9000.0)
    runs = [measured(load, 8.0 - k, 2.5 + k, k, irregular) for k, load in enumerate(loads)]
    study = small_study(default_hoist(), runs)
    assert study.from_runs
    assert study.payloads_kg == (0.0, 5000.0, 9000.0)
    assert study.limits.speed_m_s == pytest.approx(0.5, rel=0.02)
    assert study.limits.acceleration_m_s2 == pytest.approx(0.4, rel=0.05)
    assert study.start_position_m == pytest.approx(5.0, abs=0.05)
    assert study.travel_m == pytest.approx(5.5, abs=0.1)
    limits = study.limits
    assert limits.acceleration_m_s2 / limits.jerk_m_s3 == pytest.approx(
        limits.speed_m_s / limits.acceleration_m_s2 / 1.5, rel=0.01
    )


def test_the_effects_own_consequence_leaves_out_what_the_refit_moved():
    """The refit's 5 % of carriage mass is in both; what is taken out and put back is the viscous friction alone."""
    heavier = with_values(default_hoist(), {"carriage.mass_kg": 1.05 * default_hoist().carriage.mass_kg})
    refitted = with_values(default_hoist(), {"guide.coulomb_hoisting_n": 4000.0})
    corrected = heavier.model_copy(update={"effects": {"friction_viscous": {"viscous_n_s_per_m": 4000.0}}})
    controller = small_study(default_hoist()).controller  # by rule it would follow the given machine's mass
    changes = consequences_for(corrected, refitted=refitted, controller=controller)
    alone = consequences_for(corrected, nominal=heavier, controller=controller)
    assert [row.before for row in changes.rows] == [row.given for row in alone.rows]
    for row, own in zip(changes.rows, alone.rows, strict=True):
        assert row.percent("peak_torque_motor_nm") == own.percent("peak_torque_motor_nm")
        assert row.given["peak_torque_motor_nm"] != row.before["peak_torque_motor_nm"]
        assert row.refitted is not None
    table = consequences_table(changes)
    heads = [column.head.replace("\n", " ") for column in table.columns]
    assert heads[2:6] == ["peak given", "peak refitted", "peak corrected", "peak effects"]
    assert all(row["refitted"]["peak_torque_motor_nm"] for row in as_json(changes)["rows"])


def test_a_users_scenario_lends_its_moves_controller_payloads_and_references():
    own = load_study(ROOT / "scenarios" / "payloads.yaml")
    corrected = with_effects(friction_viscous={"viscous_n_s_per_m": 4000.0})
    changes, _ = consequences_of(default_hoist(), corrected, scenario=own)
    assert changes is not None
    assert {(row.payload_kg, row.reference) for row in changes.rows} == {
        (load, kind) for load in own.scenario.payloads_kg or () for kind in own.scenario.kinds
    }
    assert changes.study.controller == own.scenario.controller and changes.study.travel_m == pytest.approx(12.0)
    rows = {(row.payload_kg, row.reference): row for row in run_study(own).rows}
    for row in changes.rows:  # as given: the user's own study, to the digit
        mine = rows[row.payload_kg, row.reference]
        assert row.given["peak_torque_motor_nm"] == mine["peak_torque_motor_nm"]
    assert "in the scenario payloads" in changes.sentences[0]


def test_no_number_of_the_sentences_has_an_exponent_or_a_zero_with_a_sign(heavier: Consequences):
    """A stiff drive's gains, a change of 0.02 per cent below and 4 above."""
    first, *others = heavier.rows
    low = replace(first, before=first.after, after=replace(first.after, metrics={
        name: value if value is None else 0.9998 * value for name, value in first.after.metrics.items()
    }))  # fmt: skip
    stiff = replace(heavier.gains_after, kp=7013.0, ki=123456.0)
    text = " ".join([*_sentences(replace(heavier, rows=(low, *others), gains_after=stiff), HEAVIER)])
    assert "kp 7013 N m s/rad, ki 123456 N m/rad" in text
    table = consequences_table(replace(heavier, rows=(low, *others))).rows
    for said in (text, *(cell for row in table for cell in row)):
        assert not re.search(r"[-+]0(\.0*)?(?![.\d])|\de[+-]\d", said), said


def test_a_better_reference_that_is_the_same_at_every_payload_is_said_once(heavier: Consequences):
    alike = tuple(replace(one, before="trapezoid", after="ruckig") for one in heavier.choices)
    text = " ".join(_sentences(replace(heavier, choices=alike), HEAVIER))
    assert text.count("ruckig instead of trapezoid at every payload.") == 2 and "ruckig at " not in text
    other = tuple(replace(one, after="alike" if one.payload_kg == 0.0 else one.after) for one in alike)
    text = " ".join(_sentences(replace(heavier, choices=other), HEAVIER))
    assert "neither instead of trapezoid at 0 kg and ruckig instead of trapezoid at 9000 kg." in text
