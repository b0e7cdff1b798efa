"""Scenario files: what is wrong with one is said with file, line, value and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.core.errors import InputError
from workbench.study.load import load_study

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "scenarios" / "payloads.yaml"

GOOD = """\
format: 1
name: small
payloads_kg: [0, 9000]
start_position_m: 4.0
moves: [{by_m: 1.0}, {dwell_s: 0.5}, {to_m: 4.0}]
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
references: [trapezoid, ruckig]
controller: {kind: pi, kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_shipped_scenario_stays_within_nominal_speed_and_fifty_seconds() -> None:
    study = load_study(SHIPPED)
    assert study.machine.name == "vertical pipe racker gripper-arm winch"
    assert 40.0 <= study.duration_s <= 50.0
    speed = study.scenario.limits.speed_m_s
    assert speed is not None
    assert speed / study.machine.lift_m_per_rad < study.machine.motor.nominal_speed_rad_s


def test_all_runs_of_a_study_are_equally_long(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD))
    assert study.duration_s == study.plans["ruckig"].duration_s > study.plans["trapezoid"].duration_s


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("references:", "referenses:", r":7: referenses: unknown key 'referenses'; did you mean 'references'\?"),
        ("[trapezoid, ruckig]", "[trapezoid, rukig]", r":7: .*unknown reference 'rukig'; did you mean 'ruckig'\?"),
        ("[trapezoid, ruckig]", "[ruckig, ruckig]", r":7: references: reference ruckig stands there twice"),
        ("[trapezoid, ruckig]", "[]", r":7: references: "),
        ("payloads_kg: [0, 9000]\n", "", r"payloads_kg: is missing"),
        ("[0, 9000]", "[0, -9000]", r":3: payloads_kg\[1\]: -9000, expected a number of at least 0"),
        ("[0, 9000]", "[0, 9000, 0]", r":3: payloads_kg: payload 0.0 stands there twice"),
        ("[0, 9000]", "[9e6]", r":3: payloads_kg: payload 9e\+06 kg .* is it in kg\?"),
        ("[0, 9000]", "[.nan]", r":3: payloads_kg\[0\]: nan, expected a finite number"),
        ("[0, 9000]", "9000", r":3: payloads_kg: 9000, expected a list"),
        ("{by_m: 1.0}", "{by_m: 1.0, to_m: 3.0}", r":5: moves\[0\]: by_m and to_m given, expected exactly one"),
        ("{by_m: 1.0}", "{by_m: 30.0}", r":5: moves\[0\]: goes from 4 m to 34 m and leaves the rail, .* to 25 m"),
        ("{to_m: 4.0}", "{to_m: 5.0}", r":5: moves\[2\]: a move of 0 m"),
        ("{to_m: 4.0}", "{too_m: 5.0}", r":5: moves\[2\]\.too_m: unknown key 'too_m'; did you mean 'to_m'\?"),
        ("start_position_m: 4.0", "start_position_m: -1", r":4: start_position_m: -1 m is off the rail"),
        ("speed_m_s: 0.7", "speed_m_s: 0.9", r":6: limits.speed_m_s: 0.9 m/s .* nominal 157.1 rad/s; .* most 0.76 m/s"),
        ("jerk_m_s3: 0.8", "jerk_m_s3: 0", r":6: limits.jerk_m_s3: 0, expected a number greater than 0"),
        ("jerk_m_s3: 0.8", "jerk_m_s3: .inf", r":6: limits.jerk_m_s3: inf, expected a finite number"),
        ("kp_nm_s_per_rad: 31.0", "kp_nm_s_per_rad: -31.0", r":8: controller.kp_nm_s_per_rad: -31.0, expected"),
        ("kind: pi", "kind: pid", r":8: controller.kind: 'pid'"),
        ("name: small", "name: ../small", r":2: name: '../small'"),
        ("format: 1", "format: 2", r":1: format: 2, expected 1"),
        ("name: small", "name: small\nmachine: none.yaml", r":3: machine: no machine file .*none.yaml"),
        (
            "by_m: 1.0}",
            "by_m: 1.0}" + 3 * ", {dwell_s: 3000}",
            r":5: moves: the moves take 90\d\d s, expected at most 36",
        ),
    ],
)
def test_a_scenario_that_cannot_be_run_says_where_and_why(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in GOOD
    with pytest.raises(InputError, match=r"scenario\.yaml.*" + says):
        load_study(write(tmp_path, GOOD.replace(old, new)))


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
