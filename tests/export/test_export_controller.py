"""The controller outside: the same torque in C and in structured text, and gains as drives count them."""

from __future__ import annotations

import math
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.structured_text import Block, parsed
from workbench.control import FeedForward, Notch, PiSettings
from workbench.export.compile import host_compiler
from workbench.export.controller import controller_files, settings_text
from workbench.export.drives import DRIVES, RampLimits, drive_settings
from workbench.export.printed import c_expression, st_expression, st_number, st_test
from workbench.export.program import checked, record_of, tree
from workbench.machine import default_hoist, with_values
from workbench.simulate.loop import torque_limit_nm
from workbench.yaml_strict import loads

HOIST = default_hoist()
KP, KI = 31.0, 122.0
PLAIN = PiSettings(kp_nm_s_per_rad=KP, ki_nm_per_rad=KI)
SETTINGS = {
    "plain": PLAIN,
    "everything": PiSettings(
        kp_nm_s_per_rad=KP,
        ki_nm_per_rad=KI,
        sample_time_s=0.002,
        set_point_weight=0.7,
        anti_windup="conditional",
        torque_rate_limit_nm_per_s=20000.0,
        low_pass_hz=40.0,
        notch=Notch(frequency_hz=6.0),
        feed_forward=FeedForward(inertia=1.0, weight=0.8, friction=0.5),
    ),
    "through the wire": PiSettings(
        kp_nm_s_per_rad=KP, ki_nm_per_rad=KI, sample_time_s=0.005, feed_forward=FeedForward(inertia=0.9, wire=0.8)
    ),
    "no anti-windup": PiSettings(kp_nm_s_per_rad=KP, ki_nm_per_rad=KI, anti_windup="none"),
    "tracking, notch": PiSettings(
        kp_nm_s_per_rad=KP, ki_nm_per_rad=KI, tracking_time_s=0.05, notch=Notch(frequency_hz=4.0, depth=0.0)
    ),
}
each_setting = pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)


@pytest.fixture
def commands(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@each_setting
def test_the_program_is_the_controller_of_the_studies_and_the_record_reaches_its_limits(settings: PiSettings):
    program, record = checked(settings, HOIST, 4500.0)  # asserts that they agree
    most = torque_limit_nm(HOIST)
    assert np.max(record.torque_nm) > 0.99 * most
    assert np.min(record.torque_nm) < -0.2 * most
    assert 0 < np.sum(record.motor_failed) < len(record.torque_nm)
    assert ("z1" in program.memory) == (settings.notch is not None)


def built_and_run(folder: Path, files: dict[str, str]) -> int:
    """Exit status of the self-test."""
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    words = [host_compiler() or "cc", "-std=c99", "-Wall", "-Wextra", "-Werror"]
    sources = ["speed_controller_test.c", "speed_controller.c"]
    built = subprocess.run([*words, *sources, "-o", "test", "-lm"], cwd=folder, check=False)
    assert built.returncode == 0
    return subprocess.run([folder / "test"], check=False, capture_output=True).returncode


@each_setting
def test_the_c_code_passes_its_own_test(settings: PiSettings, tmp_path: Path):
    assert built_and_run(tmp_path / "c", controller_files("c", settings, HOIST, 4500.0)) == 0


def test_the_c_code_fails_its_own_test_with_another_gain(tmp_path: Path):
    files = controller_files("c", PLAIN, HOIST, 4500.0)
    changed = files["speed_controller.c"].replace(f"m->ki = {KI!r}", "m->ki = 122.01")
    assert changed != files["speed_controller.c"]
    assert built_and_run(tmp_path / "c", {**files, "speed_controller.c": changed}) == 1


@cache
def structured(name: str) -> Block:
    """Parsed once: the parser takes seconds."""
    return Block(controller_files("st", SETTINGS[name], HOIST, 4500.0)["speed_controller.st"])


@pytest.mark.parametrize("name", ["plain", "everything"])
def test_the_structured_text_is_parsed_and_gives_the_record(name: str):
    record, block = record_of(SETTINGS[name], HOIST, 4500.0), structured(name)
    block(reset=True, torque_hold_nm=record.hold_nm)
    assert block.values["torque_motor_nm"] == record.hold_nm
    torque = []
    for reference, speed, failed in zip(record.reference_rad_s, record.speed_rad_s, record.motor_failed, strict=True):
        given = {"speed_reference_rad_s": float(reference), "speed_motor_rad_s": float(speed)}
        block(reset=False, motor_failed=bool(failed > 0.5), **given)
        torque.append(block.values["torque_motor_nm"])
    assert np.max(np.abs(np.array(torque) - record.torque_nm)) < 1e-9 * torque_limit_nm(HOIST)


def test_the_self_test_in_structured_text_is_parsed():
    record = record_of(PLAIN, HOIST)
    few = {name: getattr(record, name)[:5] for name in ("reference_rad_s", "speed_rad_s", "motor_failed", "torque_nm")}
    assert parsed(st_test(replace(record, **few), "a few samples")).name == "SpeedControllerTest"


def test_the_record_on_disk_is_the_record():
    text = controller_files("st", PLAIN, HOIST)["test_record.csv"]
    rows = np.array([line.split(",") for line in text.splitlines()[2:]], dtype=float)
    record = record_of(PLAIN, HOIST)
    assert np.array_equal(rows[:, 0], record.reference_rad_s)
    assert np.array_equal(rows[:, 3], record.torque_nm)


def test_an_input_that_is_no_number_holds_the_last_torque_and_says_so():
    block = structured("plain")
    block(reset=True, torque_hold_nm=400.0)
    block(reset=False, speed_reference_rad_s=1.0, speed_motor_rad_s=0.5)
    before = block.values["torque_motor_nm"], block.values["integral"]
    for bad in (math.nan, math.inf):
        block(reset=False, speed_reference_rad_s=1.0, speed_motor_rad_s=bad)
        assert block.values["fault"] and (block.values["torque_motor_nm"], block.values["integral"]) == before
    block(reset=False, speed_reference_rad_s=1.0, speed_motor_rad_s=0.5)
    assert not block.values["fault"]


@pytest.mark.parametrize(
    ("line", "c", "text"),
    [
        ("a - (b - c)", "a - (b - c)", "a - (b - c)"),
        ("a * (b + c) / d", "a * (b + c) / d", "a * (b + c) / d"),
        ("a / (b * c)", "a / (b * c)", "a / (b * c)"),
        ("where(a > 0.0, b, c)", "(a > 0.0 ? b : c)", "SEL(a > 0.0, c, b)"),
        ("min(max(a, -b), b)", "fmin(fmax(a, -b), b)", "MIN(MAX(a, -b), b)"),
    ],
)
def test_an_expression_keeps_its_value_in_both_languages(line: str, c: str, text: str):
    assert c_expression(tree(line)) == c
    assert st_expression(tree(line)) == text


@pytest.mark.parametrize(("value", "text"), [(1e30, "1.0E+30"), (5e-05, "5.0E-5"), (0.25, "0.25"), (-3.0, "-3.0")])
def test_a_number_of_structured_text_has_digits_on_both_sides_of_its_point(value: float, text: str):
    assert st_number(value) == text
    assert float(text) == value


def test_siemens_takes_newton_metres_and_milliseconds_of_one_motor():
    made = {s.number: s for s in drive_settings("siemens-s120", PLAIN, HOIST).settings}
    assert made["p1460"].value == pytest.approx(KP / 2.0) and made["p1460"].unit == "Nms/rad"
    assert made["p1462"].value == pytest.approx(1000.0 * KP / KI) and made["p1462"].unit == "ms"
    assert made["p1520"].value == pytest.approx(480.0 * 1.6)


def test_abb_takes_parts_of_nominal_torque_per_part_of_nominal_speed():
    """10 % speed error on the drive's own scale gives the torque that kp gives in SI."""
    made = {s.number: s for s in drive_settings("abb-acs880", PLAIN, HOIST).settings}
    motor = HOIST.motor
    of_drive = made["25.02"].value * 0.1 * motor.nominal_torque_nm
    assert of_drive == pytest.approx(KP / motor.count * 0.1 * motor.nominal_speed_rad_s)
    assert made["25.03"].value == pytest.approx(KP / KI)


def test_a_ramp_with_rounding_takes_as_long_as_the_jerk_limited_reference():
    """MM440's t = (P1130 + P1131)/2 + step/P1082 P1120 against v/a + a/j, for a step that reaches full acceleration."""
    ramp = RampLimits(0.7, 0.6, 0.8)
    made = {s.number: s.value for s in drive_settings("siemens-s120", PLAIN, HOIST, ramp=ramp).settings}
    step_rpm = ramp.speed_m_s / HOIST.lift_m_per_rad * 60.0 / (2.0 * math.pi)
    takes = 0.5 * (made["p1130"] + made["p1131"]) + step_rpm / made["p1082"] * made["p1120"]
    assert takes == pytest.approx(0.7 / 0.6 + 0.6 / 0.8)


def test_inertia_fed_forward_is_the_torque_of_the_machine():
    settings = PiSettings(kp_nm_s_per_rad=KP, ki_nm_per_rad=KI, feed_forward=FeedForward(inertia=1.0))
    made = {s.number: s.value for s in drive_settings("siemens-s120", settings, HOIST, 4500.0).settings}
    turning = 2 * 0.8 + 55.0 / 31.0**2 + 12500.0 * HOIST.lift_m_per_rad**2
    assert made["p0341"] * made["p0342"] * 2 == pytest.approx(turning)


def test_a_weight_of_zero_is_a_set_point_filter_of_the_integral_time():
    settings = PiSettings(kp_nm_s_per_rad=KP, ki_nm_per_rad=KI, set_point_weight=0.0)
    made = {s.number: s.value for s in drive_settings("siemens-s120", settings, HOIST).settings}
    assert made["p1416"] == pytest.approx(made["p1462"])


@pytest.mark.parametrize("drive", DRIVES)
def test_what_a_drive_does_otherwise_is_said(drive: str):
    text = settings_text(drive_settings(drive, SETTINGS["everything"], HOIST, ramp=RampLimits(0.7, 0.6, 0.8)))
    said = loads(text, "drive_parameters.yaml").data
    assert isinstance(said, dict)
    words = " ".join(said["differs"])
    for missing in ("set-point weight 0.7", "low-pass", "rate limit", "weight and friction"):
        assert missing in words, missing
    assert ("notch" in words.lower()) == (drive != "siemens-s120")
    plain = " ".join(drive_settings(drive, PLAIN, with_values(HOIST, {"motor.count": 1})).differs)
    assert "low-pass" not in plain and "one of" not in plain


@pytest.mark.parametrize("form", ["st", "c", "yaml"])
def test_the_command_writes_a_folder_once(form: str, tmp_path: Path, commands: Commands):
    scenario = Path(__file__).resolve().parents[2] / "scenarios" / "payloads.yaml"
    words = ("export-controller", scenario, "--as", form, "--drive", "siemens-s120", "--out", tmp_path / "out")
    done = commands(*words)
    assert done.status == 0, done.err
    made = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "out").iterdir()}
    assert len(made) == {"st": 3, "c": 4, "yaml": 1}[form]
    if form == "yaml":
        assert "p1130" in made["drive_parameters.yaml"]
    again = commands(*words)
    assert again.status == 2 and "nothing is overwritten" in again.err


def test_a_file_without_a_controller_is_refused_in_one_line(tmp_path: Path, commands: Commands):
    (tmp_path / "c.yaml").write_text("controler: {}\n", encoding="utf-8")
    done = commands("export-controller", tmp_path / "c.yaml", "--as", "st", "--out", tmp_path / "out")
    assert done.status == 2 and "holds no block 'controller'" in done.err
    assert not (tmp_path / "out").exists()
