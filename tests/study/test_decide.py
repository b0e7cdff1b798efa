"""The table that decides, the verdict that agrees with it, the lights, and what the answer hangs on."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from tests.support import axes
from workbench.dashboard.pages.study_desk import scenario_of, usual_desk
from workbench.machine import default_hoist, shipped_hoist
from workbench.metrics import View, shown_in
from workbench.study.conclude.bound import from_the_bound
from workbench.study.conclude.damping import ELASTOMER, RINGING, damping_sentence, on_another_damping
from workbench.study.conclude.decide import BEST, Choice, choices, decision_table, verdict
from workbench.study.conclude.price import DEAR, price_sentence
from workbench.study.conclude.utilisation import alarm, utilisation
from workbench.study.execute.run import StudyResult, run_study
from workbench.study.results.row import Row
from workbench.study.scenario.load import load_study, plan_study
from workbench.study.scenario.standalone import changed
from workbench.study.variations.varying import run_in_words

ROOT = Path(__file__).resolve().parents[2]
REFERENCES = ("trapezoid", "ruckig", "ruckig_equal_time", "ruckig_least_peak", "optimal")


@cache
def result(payload_kg: float = 9000.0, references: tuple[str, ...] = REFERENCES) -> StudyResult:
    base = load_study(ROOT / "scenarios" / "payloads.yaml")
    new = {"payloads_kg": (payload_kg,), "references": references, "outputs": {"signals": "none"}}
    return run_study(plan_study(changed(base.scenario, new), default_hoist()))


def row(reference: str, time: float, peak: float, payload: float = 9000.0, **assigned: float) -> Row:
    (one,) = [r for r in result().rows if r.reference == "trapezoid"]
    metrics = {**one.metrics, "move_time_s": time, "peak_torque_motor_nm": peak}
    return Row(**{**vars(one), "reference": reference, "payload_kg": payload, "metrics": metrics, "assigned": assigned})


def test_the_table_has_a_row_a_reference_and_marks_the_best_of_each_column():
    table = decision_table(result().rows)
    assert table is not None
    assert [line[0] for line in table.rows] == list(REFERENCES)
    for number, metric in enumerate(shown_in(View.DECISION), start=1):
        marked = {line[0] for line in table.rows if BEST in line[number]}
        values = {c.reference: c.values[metric.name] for c in choices(result().rows)}
        assert min(values, key=values.__getitem__) in marked, metric.name


def test_one_that_is_no_slower_and_lowest_is_taken():
    said = verdict([row("trapezoid", 36.0, 560.0), row("ruckig", 39.0, 550.0), row("optimal", 36.0, 520.0)])
    assert said is not None
    assert said.startswith("Take the motion of least torque peak: none is quicker")
    assert "are neither quicker nor lower" in said


def test_a_front_of_two_is_said_with_its_price():
    said = verdict([row("trapezoid", 36.0, 560.0), row("ruckig", 39.0, 532.0)])
    assert said is not None
    assert "where time counts" in said and "5.0 % less" in said and "for 3.0 s more" in said


def test_the_verdict_says_where_other_limits_are_quicker_and_lower():
    beside = [row("trapezoid", 37.0, 540.0, **{"limits.acceleration_m_s2": 0.42}), row("trapezoid", 60.0, 500.0)]
    said = verdict([row("trapezoid", 36.0, 560.0), row("ruckig", 39.0, 550.0)], beside)
    assert said is not None
    assert "the trapezoid would do better than ruckig with the same limits at acceleration 0.42 m/s²: 2.0 s q" in said
    assert said.count("would do better") == 1
    own = [row("ruckig", 38.0, 540.0, **{"limits.acceleration_m_s2": 0.42})]
    said = verdict([row("trapezoid", 36.0, 560.0), row("ruckig", 39.0, 550.0)], own)
    assert said is not None
    assert said.endswith("ruckig with the same limits would do better at acceleration 0.42 m/s²: "
                         "1.0 s quicker, 10 N m per motor lower.")  # fmt: skip


def test_the_lowest_peak_is_told_with_its_price():
    said = price_sentence(result().rows)
    values = {c.reference: c.values["wire_tension_swing_n"] for c in choices(result().rows)}
    assert values["optimal"] > DEAR * min(values.values())
    assert said is not None and said.startswith("The lowest peak, by the motion of least torque peak, has its price: ")
    assert f"{values['optimal'] / 1000.0:.1f} kN against {min(values.values()) / 1000.0:.1f}" in said
    assert price_sentence([row("trapezoid", 36.0, 560.0), row("ruckig", 39.0, 532.0)]) is None  # alike but for these


def test_nothing_is_chosen_among_one():
    assert verdict([row("trapezoid", 36.0, 560.0)]) is None
    assert decision_table([row("trapezoid", 36.0, 560.0)]) is None


def test_a_choice_beats_another_only_by_more_than_what_decides_nothing():
    a, b = (Choice("x", {"move_time_s": t, "peak_torque_motor_nm": p}) for t, p in ((36.0, 560.0), (36.001, 560.1)))
    assert not a.beats(b) and not b.beats(a)


def test_the_optimum_is_lowest_of_its_time_in_the_closed_loop_too():
    peaks = {c.reference: c.values["peak_torque_motor_nm"] for c in choices(result().rows)}
    assert peaks["optimal"] < min(peaks["trapezoid"], peaks["ruckig_equal_time"], peaks["ruckig_least_peak"])
    assert peaks["ruckig_least_peak"] < peaks["ruckig_equal_time"]


def test_overload_is_red_and_said_first():
    heavy = result(20000.0, REFERENCES[:2])
    uses = {use.what: use for use in utilisation(heavy.rows, heavy.study.machine)}
    assert uses["torque peak"].light == "red" and uses["rms torque"].light == "red"
    said = alarm(list(uses.values()))
    assert said is not None and said.startswith("Overload: torque peak 100 % of the limit")


def test_the_default_study_is_within_what_the_machine_bears():
    uses = utilisation(result().rows, default_hoist())
    assert {use.what for use in uses} >= {"torque peak", "rms torque", "overload", "motor speed", "wire"}
    assert alarm(uses) is None
    factor = min(r["wire_safety_factor"] for r in result().rows)
    assert next(use.percent for use in uses if use.what == "wire") == pytest.approx(450.0 / factor)


def test_the_sentence_on_damping_compares_the_wire_assumed_with_one_that_rings():
    scenario = load_study(ROOT / "scenarios" / "payloads.yaml").scenario
    said = damping_sentence(scenario, default_hoist())
    assert said is not None
    assert "at 9000 kg and the damping ratio assumed, 0.63" in said and "at 0.02, a wire that rings" in said
    ringing = damping_sentence(scenario, shipped_hoist("lightly_damped"))
    assert ringing is not None
    assert "the damping ratio assumed, 0.016" in ringing and "at 0.63, the paper's assumption of c/k = 0.1 s" in ringing
    savings = [re.findall(r"(\d+) %", text) for text in (said, ringing)]
    assert savings[0][:2] == savings[1][2:] and int(savings[1][1]) > int(savings[0][1])  # a jerk limit buys more there


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "scenarios").glob("*.yaml")))
def test_every_study_says_how_far_its_answer_hangs_on_the_damping(name):
    study = load_study(ROOT / "scenarios" / f"{name}.yaml")
    said = on_another_damping(study)
    assert said is not None
    swings = study.machine.kind == "hoist"
    assert bool(re.search(r"the damping ratio assumed, 0\.\d+, .*; at 0\.\d+, ", said)) == swings
    assert said.startswith("The answer hangs" if swings else "No damping is assumed: the axis is one stiff inertia")


def test_two_inertias_say_how_far_their_answer_hangs_on_the_damping_of_the_coupling():
    stiff = axes.two_inertia()
    own = stiff.coupling.damping_nm_s_per_rad * (stiff.coupling.stiffness_nm_per_rad * stiff.load.inertia_kg_m2) ** -0.5
    said = {
        damping: damping_sentence(scenario_of(usual_desk(machine), machine), machine)
        for damping in (stiff.coupling.damping_nm_s_per_rad, 0.05)
        for machine in (axes.two_inertia(coupling__damping_nm_s_per_rad=damping),)
    }
    for damping, (ratio, other) in {
        stiff.coupling.damping_nm_s_per_rad: (0.5 * own, f"at {ELASTOMER:.2g}, a coupling with an elastomer spider"),
        0.05: (0.5 * own * 12.5, f"at {RINGING:.2g}, a coupling that rings"),
    }.items():
        text = said[damping]
        assert text is not None and "on the coupling's damping: " in text and other in text
        assert f"the damping ratio assumed, {ratio:.2g}, " in text and "settling time" in text


def test_the_bound_is_below_every_motion_of_its_time_and_names_the_pair_that_is_free():
    said, free = from_the_bound(load_study(ROOT / "scenarios" / "references_at_their_best.yaml"))
    (least,) = (float(peak) for peak in re.findall(r"below ([\d.]+) N m per motor", said))
    above = {words: int(percent) for words, percent in re.findall(r"(?:are|,|and) ([a-zA-Z' ]+) by (\d+) %", said)}
    in_its_time = above["ruckig in the trapezoid's time"]
    assert above["the motion of least torque peak"] == 1 < above["the trapezoid"] < in_its_time
    equal, best = (float(peak) for peak in re.findall(r"\(([\d.]+) N m per motor\)", free))
    assert least < best < equal == pytest.approx(least * (1.0 + in_its_time / 100.0), rel=6e-3)


def test_a_load_too_heavy_for_the_time_has_no_bound_and_that_is_said():
    study = load_study(ROOT / "scenarios" / "payloads.yaml")
    heavy = plan_study(changed(study.scenario, {"payloads_kg": (26000.0,)}), study.machine)
    expected = "No motion in the trapezoid's time at 26000 kg keeps to torque, speed and a taut wire."
    assert from_the_bound(heavy) == [expected]


def test_the_lightly_damped_machine_is_the_default_one_but_for_its_wire():
    ringing, default = shipped_hoist("lightly_damped"), default_hoist()
    assert ringing.wire.damping_time_s == 0.0025
    assert ringing.model_copy(update={"wire": default.wire, "name": default.name}) == default


def test_a_run_in_words_calls_its_reference_as_sentences_do():
    assert run_in_words(row("ruckig_equal_time", 36.0, 560.0), ()) == "9000 kg, ruckig in the trapezoid's time"
