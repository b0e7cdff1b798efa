"""Studies of axes: the same scenario file, in the axis' units, and what does not suit it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Commands
from workbench.core.errors import InputError
from workbench.study.conclude import sentences
from workbench.study.decide import decisions, take_sentences
from workbench.study.load import load_study
from workbench.study.run import StudyResult, peak_limit, run_study
from workbench.view.study import decision_table, run_table

TEXT = """
name: axis
machine: emps_axis
start_position_m: 0.0
moves: [{by_m: 0.2}, {dwell_s: 0.3}, {by_m: -0.2}]
limits: {speed_m_s: 0.25, acceleration_m_s2: 2.0, jerk_m_s3: 40.0}
references: [trapezoid, ruckig]
controller: {kp_n_s_per_m: 6660.0, ki_n_per_m: 116500.0, kv_per_s: 17.5}
lead_s: 0.1
settle_s: 0.6
"""
ROTARY = """
kind: axis
motion: rotary
inertia_kg_m2: 0.005
friction: {coulomb_forward_nm: 0.02, coulomb_backward_nm: 0.02, viscous_nm_s_per_rad: 0.001}
"""
TURN = """
name: turn
machine: machine.yaml
start_position_rad: 0.0
moves: [{by_rad: 2.0}, {to_rad: 0.0}]
limits: {speed_rad_s: 6.0, acceleration_rad_s2: 40.0, jerk_rad_s3: 800.0}
references: [trapezoid, ruckig]
controller: {kp_nm_s_per_rad: 0.35, ki_nm_per_rad: 4.0, kv_per_s: 15.0}
sweep: {limits.acceleration_rad_s2: [20.0, 40.0]}
"""


@cache
def result() -> StudyResult:
    import tempfile

    file = Path(tempfile.mkdtemp()) / "axis.yaml"
    file.write_text(TEXT)
    return run_study(load_study(file))


def written(folder: Path, text: str, machine: str = ROTARY) -> Path:
    (folder / "machine.yaml").write_text(machine)
    (folder / "scenario.yaml").write_text(text)
    return folder / "scenario.yaml"


def test_tables_and_verdict_of_an_axis_are_in_newtons_and_millimetres():
    rows = result().rows
    table = run_table(rows)
    assert [c.unit for c in table.columns[:5]] == ["", "N", "N", "mm", "mm"]
    assert len(table.rows[0]) == len(table.columns)
    assert decision_table(decisions(rows, None)[0]) is not None
    said = " ".join(take_sentences(decisions(rows, result().study.machine)))
    assert said.startswith("Take ") and " N, " in said and "N m" not in said
    text = " ".join(sentences(rows, peak_limit(result().study.machine)))
    assert "kg" not in text and "largest force peak is" in text


def test_a_rotary_axis_moves_in_radians_and_sweeps_them(tmp_path: Path):
    study = load_study(written(tmp_path, TURN))
    rows = run_study(study).rows
    assert all(row.ok for row in rows)
    slow, fast = (
        next(r for r in rows if r.assigned["sweep.limits.acceleration_rad_s2"] == a and r.reference == "trapezoid")
        for a in (20.0, 40.0)
    )
    assert slow["move_time_s"] == pytest.approx(2 * (2.0 / 6.0 + 6.0 / 20.0))
    assert fast["move_time_s"] < slow["move_time_s"]
    inertia = 0.005 * 40.0 + 0.02
    assert inertia < fast["peak_torque_nm"] < 1.9 * inertia


WRONG = {
    "payloads_kg: [0]\n": "payloads_kg: a machine of kind 'axis' carries no payload",
    "start_position_rad: 1.0\n": "moves in m; expected start_position_m",
    "events: {motor_fails_s: 1.0}\n": "events: a machine of kind 'axis' has no events",
    "plant: multibody\n": "plant: 'multibody', expected 'lumped'",
    "drive: {overload: 2.0}\n": "has no 'overload'",
    "sweep: {limits.acceleration_rad_s2: [1.0]}\n": "moves in m; expected acceleration_m_s2",
    "sweep: {payload_kg: [1.0]}\n": "unknown field 'payload_kg'",
}


@pytest.mark.parametrize("more", WRONG)
def test_what_an_axis_does_not_have_is_refused_with_its_place(more: str, tmp_path: Path):
    with pytest.raises(InputError) as error:
        load_study(written(tmp_path, TEXT + more))
    assert WRONG[more] in str(error.value) and "scenario.yaml" in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("kp_n_s_per_m: 6660.0, ki_n_per_m: 116500.0, kv_per_s: 17.5", "kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0",
         "takes kind: cascade with kp_n_s_per_m and ki_n_per_m"),
        ("kv_per_s: 17.5", "kv_per_s: 17.5, kp_nm_s_per_rad: 3.0", "unknown key"),
        ("kv_per_s: 17.5", "kv_per_s: -1.0", "controller.kv_per_s: -1.0, expected"),
        ("kv_per_s: 17.5", "feed_forward: {speed: 0.0}", "nothing asks the axis to move"),
        ("speed_m_s: 0.25", "speed_m_s: 0.7", "0.7 m/s is beyond the drive's top speed, 0.5"),
    ],
)  # fmt: skip
def test_a_controller_or_limit_that_does_not_fit_names_what_would(old: str, new: str, problem: str, tmp_path: Path):
    with pytest.raises(InputError, match=problem.replace("(", r"\(")):
        load_study(written(tmp_path, TEXT.replace(old, new)))


def test_a_reference_that_needs_what_an_axis_has_not_is_refused(tmp_path: Path):
    still = "friction: {coulomb_forward_nm: 0.0, coulomb_backward_nm: 0.0, viscous_nm_s_per_rad: 0.0}"
    swinging = (
        f"kind: two_inertia\nmotor: {{inertia_kg_m2: 0.002, {still}}}\n"
        "coupling: {stiffness_nm_per_rad: 20.0}\nload: {inertia_kg_m2: 0.003}\n"
    )
    text = TURN.replace("[trapezoid, ruckig]", "[trapezoid, optimal]")
    with pytest.raises(InputError, match="no feed-forward of an axis knows its coupling"):
        load_study(written(tmp_path, text, swinging))
    sine = ROTARY + "gravity: {sine_nm: 0.3}\n"
    with pytest.raises(InputError, match="goes with its angle"):
        load_study(written(tmp_path, text, sine))


def test_the_command_prints_stores_and_reports_an_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    commands = Commands(capsys)
    file = written(tmp_path, TEXT.replace("emps_axis", "machine.yaml"), machine_text())
    out = tmp_path / "out"
    done = commands("study", file, "--out", out)
    assert done.status == 0 and "Take " in done.out
    again = commands("report", out)
    assert again.status == 0, again.err
    page = next(out.glob("*.html")).read_text(encoding="utf-8")
    assert "tracking" in page and (out / "report.html").is_file()


def machine_text() -> str:
    from workbench.machines import machine_text as text_of

    return text_of(result().study.machine)


def test_draws_by_tolerance_are_of_what_moves_an_axis(tmp_path: Path):
    text = TEXT + "outputs: {signals: none}\nsample: {count: 3, tolerances: true}\n"
    study = load_study(written(tmp_path, text))
    drawn = {name for spec in study.specs for name in spec.assigned}
    assert "sample.machine.mass_kg" in drawn and not any("sensors" in name for name in drawn)
    rows = run_study(study).rows
    assert len({row["peak_force_n"] for row in rows}) == len(rows) == 6
    assert np.all([row.ok for row in rows])
