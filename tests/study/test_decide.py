"""The decision: brute force over the runs, the same question at equal time, other weights; lights, damping, bound."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.scenario_text import GOOD, write
from workbench.core.errors import InputError
from workbench.machines import default_hoist, load_of, with_values
from workbench.references import LimitPair, Limits
from workbench.study.beside import QUESTIONS, beside, beyond_its_limits, on_another_damping
from workbench.study.conclude import (
    Answer,
    alarm,
    answer_of,
    from_the_bound,
    read_answer,
    sentences,
    utilisation,
    write_answer,
)
from workbench.study.decide import ALIKE, Candidate, Decision, Given, decisions, take_sentences, weight_that_turns
from workbench.study.grid import RunSpec
from workbench.study.labels import words_of
from workbench.study.load import Study, changed, load_study, plan_study
from workbench.study.rows import Row
from workbench.study.run import StudyResult, peak_limit, run_specs, run_study
from workbench.study.scenario import CriterionBlock

ROOT = Path(__file__).resolve().parents[2]
REFERENCES = ("trapezoid", "ruckig", "ruckig_equal_time", "ruckig_least_peak", "optimal")
WITHIN = tuple(name for name in REFERENCES if name != "ruckig_equal_time")  # the speed limit
TIME, PEAK = "move_time_s", "peak_torque_motor_nm"


@cache
def study(name: str = "payloads", **new: object) -> Study:
    base = load_study(ROOT / "scenarios" / f"{name}.yaml")
    return plan_study(changed(base.scenario, {"outputs": {"signals": "none"}, **new}), base.machine)


@cache
def result(payload_kg: float = 9000.0, references: tuple[str, ...] = REFERENCES) -> StudyResult:
    return run_study(study(payloads_kg=(payload_kg,), references=references))


def row(reference: str, time: float, peak: float, payload: float = 9000.0, **assigned: float) -> Row:
    (one,) = [r for r in result().rows if r.reference == "trapezoid"]
    metrics = {**one.metrics, TIME: time, PEAK: peak}
    return Row(**{**vars(one), "reference": reference, "payload_kg": payload, "metrics": metrics, "assigned": assigned})


def decided(of: Study, rows: list[Row], rivals: Sequence[Row] = (), given: Given | None = None) -> Decision:
    return decisions(rows, of.machine, given or {}, rivals)[-1]


def sum_by_hand(one: Row, payload_kg: float, slowest_s: float, most_j: float) -> float:
    """The weighted sum of shares of a run on the default hoist, written out: limits, scales and weights of the docs."""
    machine = default_hoist()
    static_n = (machine.carriage.mass_kg + payload_kg) * 9.81 / 2.0  # two falls; the wire's own weight is small
    return (
        2.0 * one[PEAK] / (0.9 * machine.motor.nominal_torque_nm * machine.drive.overload)
        + one["thermal_load_percent"] / 100.0
        + 2.0 * one[TIME] / slowest_s
        + 0.5 * one["energy_motoring_j"] / most_j
        + one["wire_tension_swing_n"] / static_n
        + 0.1 * static_n / one["min_wire_tension_n"]
        + one["speed_error_rms_rad_s"] / (0.02 * machine.motor.nominal_speed_rad_s)
        + one["position_error_max_m"] / 0.05
    )


def test_what_is_taken_has_the_least_sum_of_all_runs_by_hand():
    rows = list(result().rows)
    rivals = beside(result().study, rows)
    made = decided(result().study, rows, rivals)
    assert made.taken is not None
    slowest = max(r[TIME] for r in rows)
    everyone = [*rows, *(r for r in rivals if r[TIME] <= slowest + 5e-3)]
    most_j = max(r["energy_motoring_j"] for r in everyone)
    sums = {r.run_id: sum_by_hand(r, 9000.0, slowest, most_j) for r in everyone}
    best = next(r for r in everyone if sums[r.run_id] == min(sums.values()))
    assert made.taken.reference == best.reference
    assert made.taken.values[PEAK] == best[PEAK]
    assert made.taken.total == pytest.approx(min(sums.values()), rel=5e-3)


@pytest.mark.parametrize("payload", [0.0, 9000.0])
def test_no_limits_of_a_grid_within_the_time_are_better_than_what_is_taken(payload):
    """Brute force: 12 accelerations, each with 8 jerks, simulated; nobody's sum is less by more than what is alike."""
    own = study(payloads_kg=(payload,), references=("trapezoid", "ruckig"))
    rows = list(run_study(own).rows)
    rivals = beside(own, rows)
    made = decided(own, rows, rivals)
    assert made.taken is not None
    slowest = max(r[TIME] for r in rows)
    everyone = [*rows, *(r for r in rivals if r[TIME] <= slowest + 5e-3)]
    most_j = max(r["energy_motoring_j"] for r in everyone)
    specs: list[RunSpec] = []
    for base in own.specs:
        for acceleration in np.linspace(0.3, 0.8, 12):
            for jerk in np.geomspace(0.4, 40.0, 8) if base.reference == "ruckig" else (1.0,):
                limits = LimitPair.of(Limits(0.7, float(acceleration), float(jerk)))
                specs.append(replace(base, limits=limits, record_every=0, run_id=f"{base.run_id}{len(specs)}"))
    tried = [r for r, _ in run_specs(specs) if r.ok and r[TIME] <= slowest + 5e-3]
    assert len(tried) > 50
    by_hand = [sum_by_hand(r, payload, slowest, most_j) for r in everyone if r[PEAK] == made.taken.values[PEAK]]
    assert min(sum_by_hand(r, payload, slowest, most_j) for r in tried) > (1.0 - ALIKE) * min(by_hand)


def test_the_motion_of_least_peak_is_not_taken_for_its_peak_alone():
    """Its peak is the lowest; its speed error and tension swing are twice the trapezoid's."""
    one = result(references=WITHIN)
    made = decided(one.study, list(one.rows))
    lowest = min(made.candidates, key=lambda c: c.values[PEAK])
    assert lowest.reference == "optimal" and made.taken is not None and made.taken.reference != "optimal"
    peak_alone = {
        c.name: CriterionBlock(weight=0.0) for c in made.criteria if c.name != PEAK
    } | {"torque_reserve_percent": CriterionBlock(weight=1.0)}  # fmt: skip
    assert decided(one.study, list(one.rows), given=peak_alone).taken == replace(
        lowest, shares=lowest.shares, total=lowest.values[PEAK] / (0.9 * peak_limit(default_hoist()))
    )


def test_at_equal_time_a_quicker_reference_is_slowed_down_and_simulated_again():
    """ruckig takes 1.5 s more than the trapezoid, which in that time, planned anew from the sentence, is lower."""
    own = study(payloads_kg=(9000.0,), references=("trapezoid", "ruckig"))
    rows = list(run_study(own).rows)
    said = answer_of(own, rows).sentences[0]
    acceleration = float(re.search(r"Take the trapezoid with acceleration ([\d.]+) m/s²", said)[1])  # type: ignore[index]
    peak, time = (float(x) for x in re.findall(r"torque peak per motor ([\d.]+) N m, move time ([\d.]+) s", said)[0])
    limits = {"speed_m_s": 0.7, "acceleration_m_s2": acceleration, "jerk_m_s3": 0.8}
    (again,) = run_study(study(payloads_kg=(9000.0,), references=("trapezoid",), limits=freeze(limits))).rows
    assert again[PEAK] == pytest.approx(peak, abs=0.6) and again[TIME] == pytest.approx(time, abs=6e-3)
    (ruckig,) = [r for r in rows if r.reference == "ruckig"]
    assert again[TIME] == pytest.approx(ruckig[TIME], abs=6e-3) and again[PEAK] < ruckig[PEAK] - 30.0


class freeze(dict[str, object]):
    """A block of a scenario that a cache can hold."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))


def test_the_weight_from_which_the_gain_is_not_worth_it_turns_the_two_round():
    rows = list(result(references=("trapezoid", "ruckig")).rows)
    made = decided(result().study, rows)
    assert made.taken is not None and made.rival is not None
    turn = weight_that_turns(made, made.taken, made.rival)
    assert turn is not None
    criterion, weight = turn
    assert f"weighs more than {weight:.3g}" in take_sentences([made])[0]
    for factor, wanted in ((0.99, made.taken.reference), (1.01, made.rival.reference)):
        again = decided(result().study, rows, given={criterion.name: CriterionBlock(weight=factor * weight)})
        assert again.taken is not None and again.taken.reference == wanted


def test_who_breaks_a_limit_is_out_and_where_all_do_none_is_taken():
    rows = list(result().rows)
    peaks = sorted(r[PEAK] for r in rows)
    made = decided(
        result().study, rows, given={"peak_torque_motor_nm": CriterionBlock(most=0.5 * (peaks[0] + peaks[1]))}
    )
    assert [c.reference for c in made.left] == [next(r.reference for r in rows if r[PEAK] == peaks[0])]
    assert "Out: " in take_sentences([made])[0]
    (none,) = take_sentences(
        [decided(result().study, rows, given={"peak_torque_motor_nm": CriterionBlock(most=100.0)})]
    )
    assert none.startswith("Take none of these at 9000 kg: ") and "at most 100 N m" in none


@pytest.mark.parametrize(
    ("new", "changes"),
    [
        ({"payloads_kg": (9000.0, 12000.0, 16000.0)}, {}),
        ({"payloads_kg": (9000.0,), "decide": {"torque_reserve_percent": {"least": 0.0}}}, {"drive.overload": 1.1}),
        ({"payloads_kg": (9000.0,)}, {"wire.breaking_load_n": 300e3}),
        ({"payloads_kg": (9000.0,)}, {"drive.field_weakening": False}),
        ({"payloads_kg": (0.0, 9000.0), "controller": {"kp_nm_s_per_rad": 2000.0, "ki_nm_per_rad": 122.0}}, {}),
    ],
    ids=["heavier and heavier", "no reserve asked", "a weak wire", "no field weakening", "a loop that hunts"],
)
def test_no_alarm_of_the_lights_stands_over_what_is_taken_and_every_one_puts_its_motion_out(new, changes):
    """The lights are reckoned apart from the criteria: both have to agree on every motion at every payload."""
    base = load_study(ROOT / "scenarios" / "payloads.yaml")
    machine = with_values(default_hoist(), changes)
    own = plan_study(changed(base.scenario, {"outputs": {"signals": "none"}, **new}), machine)
    rows, alarms = list(run_study(own).rows), 0
    for made in decisions(rows, machine, own.scenario.decide):
        for one in made.candidates:
            here = [r for r in rows if (r.payload_kg, r.reference) == (made.payload_kg, one.reference)]
            stands = alarm(utilisation(here, machine))
            alarms += stands is not None
            assert stands is None or one.broken, (one.reference, stands)
    assert alarms > 0


def test_the_one_that_breaks_least_breaks_no_more_limits_than_any_other_and_none_of_them_further():
    """Of the heaviest load and of a limit of nothing, by the runs' own figures."""
    own = study(payloads_kg=(16000.0,), references=("trapezoid", "ruckig"))
    rows = {r.reference: r for r in run_study(own).rows}
    peaks = {name: r[PEAK] for name, r in rows.items()}
    for given in ({}, {"torque_reserve_percent": CriterionBlock(least=100.0)}):
        (said,) = take_sentences([decided(own, list(rows.values()), given=given)])
        assert said.startswith(f"Take none of these at 16000 kg: {words_of(min(peaks, key=peaks.__getitem__))} breaks")
    broken = [replace(rows["trapezoid"], status="failed", reason="it fell"), rows["ruckig"]]
    assert "ruckig with the same limits breaks least" in take_sentences([decided(own, broken)])[0]
    fallen = [replace(r, status="failed", reason="it fell") for r in rows.values()]
    assert take_sentences([decided(own, fallen)]) == ["Take none of these at 16000 kg: all fail."]


def test_a_run_that_hunts_fails_or_ends_elsewhere_is_never_taken():
    best = row("ruckig", 30.0, 400.0)
    for broken in (
        replace(best, metrics={**best.metrics, "torque_swings": 200.0}),
        replace(best, status="failed", reason="it fell"),
        replace(best, metrics={**best.metrics, "position_error_end_m": -0.2}),
    ):
        made = decided(result().study, [row("trapezoid", 36.0, 560.0), broken])
        assert made.taken is not None and made.taken.reference == "trapezoid"


def test_where_none_passes_the_values_are_named_at_which_one_keeps_every_limit():
    own = study("brake_late", payloads_kg=(9000.0,))
    rows = list(run_study(own).rows)
    (said,) = take_sentences(decisions(rows, own.machine))
    assert said.startswith("Take none of these at 9000 kg: ")
    kept = [float(x) for x in re.findall(r"([\d.]+) s", said.partition("keeps every limit with brake release ")[2])]
    assert kept and max(kept) < 2.5
    for release in (1.5, 2.0, 2.2, 2.5, 3.0):  # each by itself
        here = [r for r in rows if r.assigned["sweep.events.brake_release_s"] == release]
        (least,) = [c for c in decisions(here, own.machine)[0].candidates if c.words in said][:1]
        assert bool(least.broken) == (release not in kept)


def test_a_sample_is_judged_by_its_worst_draw():
    own = study("tolerances", sample=freeze(count=8, tolerances=True))
    rows = list(run_study(own).rows)
    made = decided(own, rows)
    assert made.taken is not None and made.taken.runs == 8
    assert made.taken.values[PEAK] == max(r[PEAK] for r in rows if r.reference == made.taken.reference)
    assert "the worst of 8 runs" in take_sentences([made])[0]


def test_a_sweep_of_jerk_is_held_against_the_trapezoid_and_a_knee_at_its_edge_widens_it():
    """Brute force over the wider range: the knee is said to be where the deepest point below the chord is."""
    own = study("jerk_pareto")
    rows = list(run_study(own).rows)
    rivals = beside(own, rows)
    trapezoids = [r for r in rivals if r.reference == "trapezoid"]
    assert len(trapezoids) == 7  # an acceleration each
    assert {c.reference for c in decided(own, rows, rivals).candidates} == {"ruckig", "trapezoid"}
    (inside,) = [text for text in sentences(rows, peak_limit(own.machine)) if "knee" in text]
    assert "jerk 6.4 m/s³" in inside and "lies at the edge of jerk: widen that range" in inside
    every = [*rows, *(r for r in rivals if r.reference == "ruckig")]
    assert max(float(r.assigned["sweep.limits.jerk_m_s3"]) for r in every) > 5.0 * 6.4
    (said,) = [text for text in answer_of(own, rows).sentences if "knee" in text]
    time, peak = (np.array([r[name] for r in every]) for name in (TIME, PEAK))
    beaten = (time <= time[:, None]) & (peak <= peak[:, None]) & ((time < time[:, None]) | (peak < peak[:, None]))
    front = np.flatnonzero(~beaten.any(axis=1))
    x, y = ((v[front] - v[front].min()) / np.ptp(v[front]) for v in (time, peak))
    deepest = every[front[int(np.argmin(x + y))]]
    jerk = float(deepest.assigned["sweep.limits.jerk_m_s3"])
    assert f"jerk {jerk:.4g} m/s³: {deepest[TIME]:.4g} s" in said and "beyond the jerk that was swept" in said


@pytest.mark.parametrize(("name", "metric"), [("motor_failure", "thermal_load_percent"), ("emergency_stop", PEAK)])
def test_the_number_asked_for_keeps_every_limit_and_a_little_more_breaks_one(name, metric):
    own = study(name)
    question = QUESTIONS[own.scenario.ask or ""]
    made = answer_of(own, list(run_study(own).rows))
    first = made.asked[0]
    assert first.value is not None and made.sentences[0].startswith(f"The {own.scenario.ask} with ruckig")
    bound = {"thermal_load_percent": 100.0, PEAK: 0.9 * peak_limit(own.machine)}[metric]
    worst = []
    for factor in (0.5, 0.995, 1.005):
        specs = [replace(question.at(spec, factor * first.value), assigned={}) for spec in own.specs]
        worst.append(max(r[metric] for r, _ in run_specs(specs)))
    assert worst[0] < worst[1] <= bound < worst[2]
    assert [one.value for one in made.asked] == sorted(one.value or 0.0 for one in made.asked)  # fewer limits, farther


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("decide: {peak_torque: {most: 500}}", "unknown criterion 'peak_torque'; did you mean 'peak_torque"),
        ("decide: {move_time_s: {weigth: 2}}", "unknown key 'weigth'"),
        ("decide: {move_time_s: {weight: -1}}", "weight"),
        ("ask: heaviest payload", "largest payload"),
    ],
)
def test_a_criterion_or_a_question_that_is_none_is_one_error_with_its_line(tmp_path, lines, said):
    file = tmp_path / "wrong.yaml"
    file.write_text(f"extends: {ROOT / 'scenarios' / 'payloads.yaml'}\nname: wrong\n{lines}\n", encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_study(file)
    assert said in str(error.value) and f"{file}:3" in str(error.value)


def test_a_result_keeps_its_answer_and_reads_it_back(tmp_path):
    of = result(references=("trapezoid", "ruckig"))
    write_answer(of, tmp_path / "answer.json")
    kept = read_answer(tmp_path)
    assert kept == answer_of(of.study, list(of.rows)) and isinstance(kept, Answer)
    (tmp_path / "answer.json").write_text("{}", encoding="utf-8")
    assert read_answer(tmp_path) is None


def test_who_is_said_to_be_beaten_in_every_criterion_is():
    rows = list(run_study(study("jerk_pareto")).rows)
    made = decided(study("jerk_pareto"), rows)

    def beats(a: Candidate, b: Candidate) -> bool:
        """By the metrics themselves: in none worse, in one better by a thousandth."""
        worse = [
            c.metric.worse_by(b.values[c.name], a.values[c.name]) / (abs(b.values[c.name]) or 1.0)
            for c in made.criteria
        ]
        return max(worse) <= 0.0 and min(worse) < -1.0e-3

    beaten = {a.setting for a in made.left if any(beats(b, a) for b in made.left)}
    assert beaten == {c.setting for c in made.dominated} and made.taken is not None
    assert made.taken.setting not in beaten and 0 < len(beaten) < len(made.left)
    assert f"Beaten or equalled in every criterion: {made.dominated[0].words}" in take_sentences([made])[0]


def test_what_a_swept_value_does_is_told_at_the_setting_that_is_taken():
    """By the runs themselves: everything but the swept value as it is recommended."""
    own = study("ringing_wire")
    rows = list(run_study(own).rows)
    made = decisions(rows, own.machine)[-1]
    assert made.taken is not None
    (said,) = [text for text in answer_of(own, rows).sentences if text.startswith("Wire damping time from")]
    column = "sweep.machine.wire.damping_time_s"
    alike = [
        r for r in rows
        if r.reference == made.taken.reference and made.taken.assigned.items() <= r.assigned.items()
    ]  # fmt: skip
    ends = [min(alike, key=lambda r: r.assigned[column]), max(alike, key=lambda r: r.assigned[column])]
    swings = [float(x) for x in re.findall(r"swing goes from ([\d.]+) to ([\d.]+) kN", said)[0]]
    assert swings == pytest.approx([r["wire_tension_swing_n"] / 1000.0 for r in ends], rel=0.01)
    assert made.taken.setting in said


@pytest.mark.parametrize("references", [("trapezoid", "ruckig"), ("ruckig", "optimal"), ("trapezoid", "optimal")])
def test_what_is_said_to_come_at_no_cost_is_worse_in_no_criterion_and_what_costs_is(references):
    """By the runs' own metrics: nothing is worse by more than a reader sees, or the worst of what is stands there."""
    own = study(payloads_kg=(9000.0,), references=references)
    rows = list(run_study(own).rows)
    made = decided(own, rows, beside(own, rows))
    (said,) = take_sentences([made])
    taken, rival = made.taken, made.rival
    assert taken is not None and rival is not None
    worse = {
        c.metric.label for c in made.criteria
        if c.metric.worse_by(rival.values[c.name], taken.values[c.name])
        > max(c.metric.visible, 0.01 * abs(rival.values[c.name]))
    }  # fmt: skip
    assert not worse or "at no cost" not in said
    costs = said.partition(" and costs ")[2].partition("; ")[0]
    assert len([label for label in worse if label in costs]) >= min(len(worse), 3), (worse, costs)


def test_the_optimum_is_lowest_of_its_time_and_speed_in_the_closed_loop_too():
    peaks = {row.reference: row[PEAK] for row in result().rows}
    assert peaks["optimal"] < min(peaks["trapezoid"], peaks["ruckig_least_peak"])
    assert peaks["ruckig_equal_time"] < peaks["ruckig_least_peak"]


def test_what_lies_below_the_bound_runs_faster_in_the_closed_loop_than_the_bound_allows():
    said = from_the_bound(result().study)[0]
    below = said.partition(" Below ")[2]
    nominal = result().study.machine.motor.nominal_speed_rad_s
    # The set point's speed, from the simulation: the largest one less what the motor overshoots it by.
    speeds = {
        r.reference: r["peak_speed_percent"] - 100.0 * r["speed_overshoot_rad_s"] / nominal for r in result().rows
    }
    for name in REFERENCES:
        faster = speeds[name] > 1.005 * speeds["trapezoid"]
        assert f"{words_of(name)} by" in said
        assert (f"{words_of(name)} by" in below) == faster, name
    assert below.count("(beyond the speed limit)") == 1 and "(beyond" not in said.partition(" Below ")[0]


def test_overload_is_red_and_said_first():
    heavy = result(20000.0, REFERENCES[:2])
    uses = {use.what: use for use in utilisation(heavy.rows, heavy.study.machine)}
    assert uses["torque peak"].light == "red" and uses["rms torque"].light == "red"
    said = alarm(list(uses.values()))
    assert said is not None and said.startswith("Overload: torque peak 100 % of the limit")


def test_the_bound_is_below_every_motion_of_its_time_and_the_limit_that_equal_time_exceeds_is_named():
    study = load_study(ROOT / "scenarios" / "references_at_their_best.yaml")
    (said,), (equal,) = from_the_bound(study), beyond_its_limits(study)
    of_all, least, again = (float(peak) for peak in re.findall(r"(?:below|Above) ([\d.]+) N m per motor", said))
    (found,) = (float(peak) for peak in re.findall(r"one with ([\d.]+) N m per motor", said))
    assert of_all <= least == again <= found <= 1.005 * least
    above = {words: int(percent) for words, percent in re.findall(r"(?:are|,|and) ([a-zA-Z' ]+) by (\d+) %", said)}
    assert above["the motion of least torque peak"] <= 2 < above["the trapezoid"]
    assert "goes beyond the limits to keep that time: speed from 0.7 to 0.76 m/s (100 % of the drive's top" in equal


@pytest.mark.parametrize("lowering", [{}, {"speed_m_s": 0.5, "acceleration_m_s2": 0.3, "jerk_m_s3": 0.8}])
def test_what_goes_beyond_a_limit_that_is_set_is_what_its_set_point_does_in_the_simulation(lowering: dict[str, float]):
    """The set point's speed up and down, in m/s at the carriage, against the limits of either way."""
    limits = {"speed_m_s": 0.7, "acceleration_m_s2": 0.6, "jerk_m_s3": 0.8, "lowering": lowering}
    wanted = {"payloads_kg": (9000.0,), "references": REFERENCES, "limits": limits, "outputs": {"signals": "full"}}
    own = study.__wrapped__(**wanted)
    per = 0.25 * own.machine.winch.drum_diameter_m / own.machine.gearbox.ratio  # m of the carriage a rad of the motor
    beyond = set()
    for name, run in run_study(own).runs.items():
        reached = per * run["speed_reference_rad_s"]
        for limit, speed in ((0.7, reached.max()), (lowering.get("speed_m_s", 0.7), -reached.min())):
            if speed > 1.001 * limit:
                beyond.add((name, limit, round(float(speed), 3)))
    (said,) = beyond_its_limits(own)
    told = [tuple(map(float, pair)) for pair in re.findall(r"speed from ([\d.]+) to ([\d.]+) m/s", said)]
    assert {("9000kg_ruckig_equal_time", *pair) for pair in told} == beyond


def test_figures_on_another_wire_are_said_to_be_of_the_file_s_own_values_where_it_sweeps_some(tmp_path: Path):
    """The gain to take is another one of the sweep: figures without it looked like those of the one taken."""
    sweep = "sweep: {controller.kp_nm_s_per_rad: [20.0, 45.0]}\n"
    for text, where in ((GOOD, "at 9000 kg, "), (GOOD + sweep, "at 9000 kg and the file's own values, ")):
        assert where in (on_another_damping(load_study(write(tmp_path, text))) or "")


@pytest.mark.parametrize("payload", [0.0, 9000.0])
def test_which_motion_to_take_on_a_wire_that_rings_is_what_a_study_on_that_machine_takes(payload: float):
    own = study(payloads_kg=(payload,), references=REFERENCES)
    load = load_of(own.machine, payload)
    assert load is not None
    ringing = with_values(own.machine, {"wire.damping_time_s": 2.0 * 0.02 / load.angular_frequency_rad_s})
    first, then = (
        decided(own, list(run_study(plan_study(own.scenario, machine)).rows)).candidates[0].words
        for machine in (own.machine, ringing)
    )
    said = on_another_damping(own)
    assert said is not None
    wanted = "on either wire" if first == then else f"on this wire, {then} on that"
    assert said.endswith(f" Of the study's references {first} is the one to take {wanted}.")
    assert f"; {first} has " in said  # with its own figures
    assert not re.search(r"([\d.]+) instead of \1 ", said)  # two figures that read alike are no change
