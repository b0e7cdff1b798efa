"""What is wrong with a sweep, a sample, an override or an event is said with file, line, value and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.scenario_text import GOOD, study_of, write
from workbench.core.errors import InputError
from workbench.study.load import load_study

ROOT = Path(__file__).resolve().parents[2]
KP, KI = "controller.kp_nm_s_per_rad", "controller.ki_nm_per_rad"
COULOMB = "machine.guide.coulomb_hoisting_n"
RELATIVE = "{distribution: normal, mean: 1, std: 0.5, relative: true}"


def range_of(steps: int) -> str:
    return f"{{from: 1, to: 2, steps: {steps}}}"


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            "sweep: {limits.jerk: [1]}",
            r":9: sweep.limits.jerk: unknown field 'limits.jerk'; did you mean 'limits.jerk_m_s3",
        ),
        ("sweep: {jerk_m_s3: [1]}", r":9: .*unknown field 'jerk_m_s3'; did you mean 'limits.jerk_m_s3'"),
        ("sweep: {wobble: [1]}", r":9: .*unknown field 'wobble'; fields are payload_kg, .* machine"),
        ("sweep: {machine.wire.segment_lenght_m: [30]}", r"did you mean 'machine.wire.segment_length_m'"),
        ("sweep:\n  moves[3].by_m: [1]", r"unknown field 'moves\[3\].by_m'"),
        (
            "sweep:\n  limits.jerk_m_s3:\n    - 1\n    - 0",
            r":12: sweep.limits.jerk_m_s3\[1\]: 0.0, expected a number greater",
        ),
        ("sweep:\n  limits.speed_m_s: [0.7, 0.9]", r":10: sweep.limits.speed_m_s\[1\]: .*most 0.76 m/s"),
        ("sweep:\n  moves[0].by_m: [1, 50]", r":10: sweep.moves\[0\].by_m\[1\]: .*leaves the rail, .* to 25 m"),
        ("sweep:\n  start_position_m: [1, 99]", r":10: sweep.start_position_m\[1\]: 99 m is off the rail"),
        ("sweep: {lead_s: [-1]}", r"sweep.lead_s\[0\]: -1.0, expected a number of at least 0"),
        ("sweep: {lead_s: [soon]}", r"sweep.lead_s\[0\]: 'soon', expected a number"),
        (
            "sweep: {controller.anti_windup: [none, conditonal]}",
            r"anti_windup\[1\]: 'conditonal'; did you mean 'conditional'",
        ),
        ("sweep: {machine.wire.damping_time_s: [-1]}", r"damping_time_s\[0\]: -1.0, expected a number of at least 0"),
        ("sweep: {events.brake_release_s: [1]}", "brake_torque_nm is missing"),
        ("sweep: {payloads_kg: [1]}", "payloads_kg: 'payloads_kg' is a list already, .*; sweep payload_kg"),
        ("sweep: {payload_kg: [1]}", r":3: payloads_kg: is listed while sweep names payload_kg"),
        (f"sweep: {{{KP}: []}}", r"kp_nm_s_per_rad: holds 0 values, expected 1 to 100000"),
        (f"sweep: {{{KP}: 3}}", "kp_nm_s_per_rad: 3, expected a list"),
        (f"sweep: {{{KP}: [3, 3]}}", "kp_nm_s_per_rad: 3 stands there twice"),
        (f"sweep: {{{KP}: [3, null]}}", r"kp_nm_s_per_rad\[1\]: None, expected a finite number, a word"),
        (f"sweep: {{{KP}: [.inf]}}", r"kp_nm_s_per_rad\[0\]: inf, expected a finite number"),
        (
            f"sweep:\n  zip:\n    {KP}: [1, 2]\n    {KI}: [1, 2, 3]",
            rf":10: sweep.zip: .*unequal length.*{KP} 2, {KI} 3",
        ),
        (f"sweep: {{{KP}: [1], zip: {{{KP}: [2]}}}}", f"sweep.zip.{KP}: is swept by itself too"),
        (
            f"sweep: {{{KP}: {range_of(1000)}, {KI}: {range_of(1000)}}}",
            "makes 4,000,000 runs, expected at most 1,000,000",
        ),
        (f"sweep: {{{KP}: {{from: 1, to: 2, stps: 3}}}}", "unknown key 'stps'; did you mean 'steps'"),
        (f"sweep: {{{KP}: {{from: 1, to: 2}}}}", "rad: expected either steps"),
        (f"sweep: {{{KP}: {{from: 1, to: 2, step: 0.3}}}}", "rad: steps of 0.3 from 1 do not meet 2; .*steps: 4"),
        (f"sweep: {{{KP}: {{from: 1, to: 1, steps: 3}}}}", "from and to are both 1"),
        (f"sweep: {{{KP}: {{from: 0, to: 1, steps: 3, scale: log}}}}", "expected numbers above 0"),
        (f"sweep: {{{KP}: {{from: 1, to: 2, steps: 1}}}}", "steps: 1, expected a number of at least 2"),
        ("sample: {count: 0, tolerances: true}", r":9: sample.count: 0, expected a number of at least 1"),
        ("sample: {count: -5, tolerances: true}", r":9: sample.count: -5, expected"),
        ("sample: {count: 10}", "sample: draws nothing"),
        ("sample: {count: 100, method: sobol, tolerances: true}", "expected a power of two, 64 or 128"),
        ("sample: {count: 8, method: sobool, tolerances: true}", "'sobool'; did you mean 'sobol'"),
        (f"sample: {{count: 8, values: {{{COULOMB}: {{distribution: norml}}}}}}", "'norml'; did you mean 'normal'"),
        (
            f"sample: {{count: 8, values: {{{COULOMB}: {{distribution: normal, mean: 1}}}}}}",
            "needs mean and std; missing: std",
        ),
        (
            f"sample: {{count: 8, values: {{{COULOMB}: {{distribution: uniform, low: 2, high: 1}}}}}}",
            "low <= high, got 2, 1",
        ),
        (
            f"sample: {{count: 8, values: {{{COULOMB}: {{distribution: uniform, mean: 2}}}}}}",
            "has no mean; valid: high, low",
        ),
        (
            "sample: {count: 8, values: {guide.coulomb_hoisting_n: {distribution: uniform, low: 1, high: 2}}}",
            "did you mean 'machine.guide.coulomb_hoisting_n'",
        ),
        (
            f"sample: {{count: 999, values: {{{COULOMB}: {RELATIVE}}}}}",
            r"-\d+.*, expected a number of at least 0 \(draw \d+\)",
        ),
        (
            "sample: {count: 8, values: {payload_kg: {distribution: uniform, low: 1, high: 2}}}",
            "payloads_kg lists payloads",
        ),
        (
            f"sweep: {{{KP}: [2]}}\nsample: {{count: 8, values: {{{KP}: {{distribution: uniform, low: 1, high: 2}}}}}}",
            "is swept too; .* relative: true",
        ),
        (
            f"sample: {{count: 8, values: {{machine.rail.highest_position_m: {RELATIVE}}}}}",
            "has no value of its own to be multiplied",
        ),
        (
            "machine_overrides: {wire.segment_lenght_m: 30}",
            r":9: .*no value 'wire.segment_lenght_m'; did you mean 'wire.segment_length_m'",
        ),
        (
            "machine_overrides:\n  wire:\n    segment_length_m: long",
            r":11: machine_overrides.wire.segment_length_m: 'long', expected a number",
        ),
        ("machine_overrides: {wire: {segment_length_m: 3}, wire.segment_length_m: 4}", "is set twice"),
        ("machine_overrides: {drive.overload: -1}", "machine_overrides.drive.overload: -1, expected a number greater"),
        ("machine_overrides: {wobble: 1}", "no value 'wobble'; expected a dotted name such as"),
        ("drive: {overlod: 2}", "drive.overlod: unknown key 'overlod'; did you mean 'overload'"),
        ("drive: {overload: 0}", "drive.overload: 0, expected a number greater than 0"),
        ("events: {brake_release_s: 1}", "events: brake_torque_nm is missing"),
        ("events: {emergency_stop_s: 1}", "emergency_deceleration_m_s2 is missing"),
        ("outputs: {signals: some}", "outputs.signals: 'some', expected 'none', 'thinned' or 'full'"),
        ("solver: {step_s: 1}", "solver.step_s: 1, expected a number of at most 0.01"),
        ("seed: -1", "seed: -1, expected a number of at least 0"),
        ("effects: {no_such_effect: {a: 1.0}}", r":9: effects.no_such_effect: unknown effect 'no_such_effect'"),
    ],
)
def test_what_a_scenario_varies_is_checked_before_anything_runs(tmp_path: Path, more: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        study_of(tmp_path, more + "\n")
    assert str(caught.value).startswith(f"{tmp_path}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "[trapezoid, ruckig]",
            "[recorded]",
            r":7: references\[0\]: 'recorded'; it takes a block with campaign and run",
        ),
        (
            "[trapezoid, ruckig]",
            "[{kind: recorded, campaign: none, run: a}]",
            r":7: references\[0\].campaign: no campaign",
        ),
        (
            "[trapezoid, ruckig]",
            "[{kind: s_curve, campaign: none, run: a}]",
            r":7: references\[0\]: smoothing_s belongs to",
        ),
        (
            "[trapezoid, ruckig]",
            "[{kind: recorded, campain: none, run: a}]",
            "unknown key 'campain'; did you mean 'campaign'",
        ),
        (
            "[trapezoid, ruckig]",
            "[{kind: ruckig, campaign: a, run: a}]",
            r"references\[0\].kind: 'ruckig', expected 'rec",
        ),
        (
            "jerk_m_s3: 0.8",
            "jerk_m_s3: 0.8, lowering: {jerk_m_s3: 0}",
            ":6: limits.lowering.jerk_m_s3: 0, expected a number",
        ),
        (
            "jerk_m_s3: 0.8",
            "jerk_m_s3: 0.8, lowering: {speed_m_s: 0.9}",
            ":6: limits.lowering.speed_m_s: 0.9 m/s turns",
        ),
        ("jerk_m_s3: 0.8", "jerk_m_s3: 0.8, lowerin: {speed_m_s: 0.9}", "did you mean 'lowering'"),
        (", jerk_m_s3: 0.8", "", ":6: limits.jerk_m_s3: 'ruckig' needs a finite jerk limit"),
        ("speed_m_s: 0.7, ", "", ":6: limits: has no speed_m_s for hoisting"),
        (
            "limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}\n",
            "",
            "limits: is missing; expected a block",
        ),
        ("moves: [{by_m: 4.0}, {dwell_s: 0.5}, {to_m: 4.0}]\n", "", "moves: is missing; expected a list of moves"),
        ("start_position_m: 4.0\n", "", "start_position_m: is missing"),
        ("{by_m: 4.0}", "{speed_m_s: 0.3}", r":5: moves\[0\]: speed_m_s and for_s belong together"),
        ("{by_m: 4.0}", "{speed_m_s: 0.3, for_s: 5}", r":5: moves\[1\]: comes while the carriage goes at 0.3 m/s"),
        ("references:", "referenses:", r":7: referenses: unknown key 'referenses'; did you mean 'references'\?"),
        ("[trapezoid, ruckig]", "[trapezoid, rukig]", r":7: .*unknown reference 'rukig'; did you mean 'ruckig'\?"),
        ("[trapezoid, ruckig]", "[ruckig, ruckig]", r":7: references: reference ruckig stands there twice"),
        ("payloads_kg: [0, 9000]\n", "", r"payloads_kg: is missing"),
        ("[0, 9000]", "[0, -9000]", r":3: payloads_kg\[1\]: -9000, expected a number of at least 0"),
        ("[0, 9000]", "[0, 9000, 0]", r":3: payloads_kg: payload 0.0 stands there twice"),
        ("[0, 9000]", "[9e6]", r":3: payloads_kg: payload 9e\+06 kg .* is it in kg\?"),
        ("[0, 9000]", "[.nan]", r":3: payloads_kg\[0\]: nan, expected a finite number"),
        ("[0, 9000]", "9000", r":3: payloads_kg: 9000, expected a list"),
        ("{by_m: 4.0}", "{by_m: 4.0, to_m: 3.0}", r":5: moves\[0\]: by_m and to_m given, expected exactly one"),
        ("{to_m: 4.0}", "{too_m: 5.0}", r":5: moves\[2\]\.too_m: unknown key 'too_m'; did you mean 'to_m'\?"),
        ("start_position_m: 4.0", "start_position_m: -1", r":4: start_position_m: -1 m is off the rail"),
        ("speed_m_s: 0.7", "speed_m_s: 0.9", r":6: limits.speed_m_s: 0.9 m/s .* nominal 157.1 rad/s; .* most 0.76 m/s"),
        ("jerk_m_s3: 0.8", "jerk_m_s3: .inf", r":6: limits.jerk_m_s3: inf, expected a finite number"),
        ("kp_nm_s_per_rad: 31.0", "kp_nm_s_per_rad: -31.0", r":8: controller.kp_nm_s_per_rad: -31.0, expected"),
        ("kind: pi", "kind: pid", r":8: controller.kind: 'pid'"),
        ("name: small", "name: ../small", r":2: name: '../small'"),
        ("format: 1", "format: 2", r":1: format: 2, expected 1"),
        (
            "by_m: 4.0}",
            "by_m: 4.0}" + 3 * ", {dwell_s: 3000}",
            r":5: moves: the moves take 90\d\d s, expected at most 36",
        ),
        ("[trapezoid, ruckig]", "[]", r":7: references: "),
        ("{to_m: 4.0}", "{to_m: 8.0}", r":5: moves\[2\]: a move of 0 m"),
    ],
)
def test_a_scenario_that_cannot_be_run_says_where_and_why(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in GOOD
    with pytest.raises(InputError, match=says):
        study_of(tmp_path, "", old, new)


def test_a_trapezoid_alone_needs_no_jerk_limit(tmp_path: Path) -> None:
    study = study_of(tmp_path, "", ", jerk_m_s3: 0.8}\nreferences: [trapezoid, ruckig]", "}\nreferences: [trapezoid]")
    assert len(study.specs) == 2


def test_what_is_swept_need_not_stand_there_besides(tmp_path: Path) -> None:
    study = study_of(
        tmp_path, "sweep: {start_position_m: [4, 5], limits.jerk_m_s3: [1]}\n", "start_position_m: 4.0\n", ""
    )
    assert {spec.start_position_m for spec in study.specs} == {4.0, 5.0}


def test_shipped_scenario_stays_within_nominal_speed_and_fifty_seconds() -> None:
    study = load_study(ROOT / "scenarios" / "payloads.yaml")
    assert study.machine.name == "vertical pipe racker gripper-arm winch"
    assert 40.0 <= study.duration_s <= 50.0
    speed = study.scenario.limits.speed_m_s
    assert speed is not None
    assert speed / study.machine.lift_m_per_rad < study.machine.motor.nominal_speed_rad_s


def test_all_runs_of_a_study_are_equally_long(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD))
    assert study.duration_s == study.plans["ruckig"].duration_s > study.plans["trapezoid"].duration_s


def test_a_scenario_that_is_not_there_or_is_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: no such file"):
        load_study(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder; expected a file"):
        load_study(tmp_path)


def test_a_machine_of_the_scenario_is_sought_beside_it_and_its_errors_name_its_own_file(tmp_path: Path) -> None:
    shipped = (ROOT / "workbench" / "machines" / "default_hoist.yaml").read_text(encoding="utf-8")
    path = write(tmp_path, GOOD.replace("name: small", "name: small\nmachine: mine.yaml"))
    mine = tmp_path / "mine.yaml"
    mine.write_text(shipped.replace("mass_kg: 8000.0", "mass_kg: 7000.0"), encoding="utf-8")
    assert load_study(path).machine.carriage.mass_kg == 7000.0
    mine.write_text(shipped.replace("mass_kg: 8000.0", "mass_kg: -8000.0"), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml:\d+: carriage.mass_kg: -8000.0"):
        load_study(path)
    mine.write_text("kind: axis\nmotion: linear\nmass_kg: 95.0\n", encoding="utf-8")
    with pytest.raises(InputError):
        load_study(path)


def test_fingerprint_follows_what_the_scenario_says_and_not_how_it_is_written(tmp_path: Path) -> None:
    one = load_study(write(tmp_path, GOOD)).fingerprint
    assert load_study(write(tmp_path, "# a remark\n" + GOOD.replace("0.7,", "0.70,"))).fingerprint == one
    assert load_study(write(tmp_path, GOOD.replace("9000", "9001"))).fingerprint != one
