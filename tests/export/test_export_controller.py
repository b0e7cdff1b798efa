"""The controller outside: the same torque in C and in structured text, and gains as drives count them."""

from __future__ import annotations

import math
import os
import re
import subprocess
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.structured_text import Block
from workbench.control import FeedForward, Notch, PiSettings
from workbench.core.errors import InputError
from workbench.export.controller_program import checked, controller_files, program_of, record_of
from workbench.export.fmu import host_compiler
from workbench.export.model import model_of
from workbench.machines import default_hoist
from workbench.simulate.loop import torque_limits

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


@each_setting
def test_the_program_is_the_controller_of_the_studies_and_the_record_reaches_its_limits(settings: PiSettings):
    program, record = checked(settings, HOIST, 4500.0)  # asserts that they agree
    most = torque_limits(HOIST)["u_all"]
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
    changed = files["speed_controller.c"].replace(f"ki = {KI!r}", "ki = 122.01")
    assert changed != files["speed_controller.c"]
    assert built_and_run(tmp_path / "c", {**files, "speed_controller.c": changed}) == 1


@cache
def structured(name: str) -> Block:
    """Parsed once: the parser takes seconds."""
    return Block(controller_files("st", SETTINGS[name], HOIST, 4500.0)["speed_controller.st"])


# Standard functions and blocks of IEC 61131-3 and words of the systems that import the text: no variable's name.
TAKEN_WORDS = """
abs sqrt ln log exp sin cos tan asin acos atan add mul sub div mod expt move shl shr ror rol and or xor not sel max min
limit mux gt ge eq le lt ne len left right mid concat insert delete replace find sr rs sema r_trig f_trig ctu ctd ctud
tp ton tof rtc integral derivative pid ramp hysteresis delay average lag1 integer reference ref_to pointer r s ld st by
do of on to at task program type var step action transition time date
"""
TAKEN = frozenset(re.findall(r"\w+", TAKEN_WORDS))


def test_c_and_structured_text_give_the_studies_torque_over_a_hundred_thousand_steps(tmp_path: Path):
    settings, block = SETTINGS["everything"], structured("everything")
    record = record_of(settings, HOIST, 4500.0, samples=100_000)
    block(reset=True, torque_hold_nm=record.hold_nm)
    text = block.run(
        "torque_motor_nm", reset=False, motor_failed=record.motor_failed > 0.5,
        speed_reference_rad_s=record.reference_rad_s, speed_motor_rad_s=record.speed_rad_s,
    )  # fmt: skip
    columns = (record.reference_rad_s, record.speed_rad_s, record.motor_failed)
    (tmp_path / "in").write_bytes(np.column_stack(columns).astype("<f8").tobytes())
    main = (
        """#include <stdio.h>
#include "speed_controller.h"
int main(void) {
    speed_controller m; double x[3], u;
    speed_controller_init(&m); speed_controller_reset(&m, %r);
    while (fread(x, sizeof *x, 3, stdin) == 3) {
        u = speed_controller_step(&m, x[0], x[1], x[2] > 0.5); fwrite(&u, sizeof u, 1, stdout); }
    return m.fault; }"""
        % record.hold_nm
    )
    built = compiled(tmp_path, settings, main)
    with (tmp_path / "in").open() as given:
        done = subprocess.run([built], stdin=given, capture_output=True, check=True)
    c = np.frombuffer(done.stdout)
    single = np.finfo(np.float32).eps * torque_limits(HOIST)["u_all"]
    assert len(c) == len(text) == 100_000 and not block.values["fault"]
    assert np.array_equal(c, np.array(text))  # the same operations in the same order: the same bits
    assert np.max(np.abs(c - record.torque_nm)) < single


def compiled(folder: Path, settings: PiSettings, main: str) -> Path:
    """A program around the C code, with every warning an error."""
    for file, text in controller_files("c", settings, HOIST, 4500.0).items():
        (folder / file).write_text(text, encoding="utf-8")
    (folder / "main.c").write_text(main, encoding="utf-8")
    words = [host_compiler() or "cc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([*words, "main.c", "speed_controller.c", "-o", "main", "-lm"], cwd=folder, check=True)
    return folder / "main"


def attacked(folder: Path, settings: PiSettings) -> Path:
    """controller_attack.c around the C code of a controller."""
    numbers = {number.name: number.value for number in program_of(settings, HOIST, 4500.0).numbers}
    names = {"LIMIT": "torque_limit_nm", "ONE": "torque_limit_one_failed_nm", "WEAK": "weakening_speed_rad_s",
             "SPEED": "speed_limit_rad_s", "STEP": "speed_step_rad_s"}  # fmt: skip
    defined = "".join(f"#define {short} {numbers[name]!r}\n" for short, name in names.items())
    attack = Path(__file__).with_name("controller_attack.c").read_text(encoding="utf-8")
    return compiled(folder, settings, defined + attack)


@each_setting
def test_a_million_random_and_extreme_calls_in_c_break_no_promise(settings: PiSettings, tmp_path: Path):
    """Torque within its limits, never NaN; no cause without a fault, no fault without a cause; left by reset alone."""
    done = subprocess.run([attacked(tmp_path, settings)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_attack_finds_a_controller_without_a_check(tmp_path: Path):
    """The same attack on the code with one check taken away, each in turn."""
    built = attacked(tmp_path, PLAIN)
    whole = (tmp_path / "speed_controller.c").read_text()
    for line in ("reference) <= speed_limit_rad_s", "speed) <= speed_limit_rad_s", "<= speed_step_rad_s"):
        (place,) = [row for row in whole.splitlines() if row.strip().startswith(("if", "else")) and line in row]
        reason = int(place.split("= ")[-1].strip(";"))
        (tmp_path / "speed_controller.c").write_text(whole.replace(f"fault_reason = {reason};", "fault_reason = 0;"))
        words = [host_compiler() or "cc", "-std=c99", "-O2", "main.c", "speed_controller.c", "-o", "main", "-lm"]
        subprocess.run(words, cwd=tmp_path, check=True)
        assert subprocess.run([built], capture_output=True, check=False).returncode == 1, line


def test_the_text_holds_its_torque_as_the_c_code_does(tmp_path: Path):
    """Random and extreme calls through both, fault and reason too."""
    chance = np.random.default_rng(22)
    settings, block = SETTINGS["everything"], structured("everything")
    calls = []
    for _ in range(20_000):
        odd = [math.nan, math.inf, -math.inf, 1e308, -1e308, 0.0, float(chance.normal(scale=100.0))]
        wild = chance.random() < 0.02
        calls.append((
            float(chance.random() < 0.03),
            float(chance.choice(odd)) if wild else float(chance.uniform(-1500.0, 1500.0)),
            float(chance.choice(odd)) if chance.random() < 0.01 else float(chance.uniform(-50.0, 50.0)),
            float(chance.choice(odd)) if chance.random() < 0.01 else float(chance.uniform(-3.0, 3.0)),
            float(chance.random() < 0.1),
        ))  # fmt: skip
    (tmp_path / "in").write_bytes(np.array(calls, dtype="<f8").tobytes())
    main = """#include <stdio.h>
#include "speed_controller.h"
int main(void) {
    speed_controller m; double x[5], y[3];
    speed_controller_init(&m);
    while (fread(x, sizeof *x, 5, stdin) == 5) {
        if (x[0] > 0.5) speed_controller_reset(&m, x[1]); else speed_controller_step(&m, x[2], x[3], x[4] > 0.5);
        y[0] = m.torque_motor_nm; y[1] = m.fault_reason; y[2] = m.limited; fwrite(y, sizeof *y, 3, stdout); }
    return 0; }"""
    with (tmp_path / "in").open() as given:
        done = subprocess.run([compiled(tmp_path, settings, main)], stdin=given, capture_output=True, check=True)
    c = np.frombuffer(done.stdout).reshape(-1, 3)
    block(reset=True, torque_hold_nm=0.0)
    for row, (reset, hold, reference, speed, failed) in zip(c, calls, strict=True):
        block(reset=reset > 0.5, torque_hold_nm=hold, speed_reference_rad_s=reference, speed_motor_rad_s=speed,
              motor_failed=failed > 0.5)  # fmt: skip
        text = [block.values[name] for name in ("torque_motor_nm", "fault_reason", "limited")]
        assert row.tolist() == text and block.values["fault"] == (row[1] != 0.0)
    assert {0.0, 1.0, 2.0, 3.0, 4.0} <= set(c[:, 1])


@each_setting
def test_no_variable_has_the_name_of_a_standard_function_or_block(settings: PiSettings):
    files = controller_files("st", settings, HOIST, 4500.0)
    for name in ("speed_controller.st", "speed_controller_test.st"):
        declared = {line.split(" : ")[0].strip().lower() for line in files[name].splitlines() if " : " in line}
        assert len(declared) > 5 and not declared & TAKEN
        assert not re.search(r"END_IF(?!;)", files[name])


MATIEC = """#include "iec_std_lib.h"
#include "POUS.h"
#include "POUS.c"
#include <stdio.h>
TIME __CURRENT_TIME; BOOL __DEBUG;
int main(void) {
    static SPEEDCONTROLLERTEST p;
    SPEEDCONTROLLERTEST_init__(&p, 0);
    for (int k = 0; k < 500; k++) SPEEDCONTROLLERTEST_body__(&p);
    return !(p.DONE.value && p.PASSED.value);
}
"""


@pytest.mark.skipif("MATIEC" not in os.environ, reason="allowed: MATIEC names no folder with matiec's iec2c and lib")
@pytest.mark.parametrize("name", SETTINGS)
def test_the_self_test_passes_through_the_c_that_matiec_makes_of_it(name: str, tmp_path: Path):
    files, matiec = controller_files("st", SETTINGS[name], HOIST, 4500.0), Path(os.environ["MATIEC"])
    (tmp_path / "all.st").write_text(files["speed_controller.st"] + files["speed_controller_test.st"])
    (tmp_path / "main.c").write_text(MATIEC)
    words = list(map(str, [matiec / "iec2c", "-I", matiec / "lib", "-T", tmp_path, "all.st"]))
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    words = [host_compiler() or "cc", "-w", "-ffp-contract=off", f"-I{matiec}/lib/C", "main.c", "-o", "main", "-lm"]
    subprocess.run(words, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "main"], check=False).returncode == 0


def test_the_plcopen_xml_holds_the_block_of_the_text():
    files = controller_files("st", SETTINGS["everything"], HOIST, 4500.0)
    tc6, xhtml = "{http://www.plcopen.org/xml/tc6_0201}", "{http://www.w3.org/1999/xhtml}"
    root = ElementTree.fromstring(files["speed_controller.xml"])
    assert root.tag == f"{tc6}project"
    body = root.find(f".//{tc6}body/{tc6}ST/{xhtml}p")
    assert body is not None and body.text is not None and body.text in files["speed_controller.st"]
    names = [variable.get("name") for variable in root.iter(f"{tc6}variable")]
    assert names == [
        line.split(" : ")[0].strip() for line in files["speed_controller.st"].splitlines() if line[:4] == "    "
        and re.match(r" {4}\w+ : [A-Z]", line)
    ]  # fmt: skip
    if "TC6_SCHEMA" in os.environ:  # PLCopen's own tc6_xml_v201.xsd, which may not be given away
        etree = pytest.importorskip("lxml.etree")
        etree.XMLSchema(etree.parse(os.environ["TC6_SCHEMA"])).assertValid(
            etree.fromstring(files["speed_controller.xml"].encode())
        )


class Later(PiSettings):
    """With a term that an export has not learned yet."""

    later_term: float = 0.0


NOT_EXPORTED = {
    "later_term": 0.3,
    "kv_per_s": 4.0,
    "load_damping": {"signal": "tension", "time_s": 0.2, "filter_hz": 5.0},
    "gain_schedule": [{"payload_kg": 0.0, "kp_nm_s_per_rad": 20.0, "ki_nm_per_rad": 80.0}],
}


@pytest.mark.parametrize("name", NOT_EXPORTED)
def test_a_term_that_is_not_exported_is_refused_in_one_line_and_not_left_out(name: str):
    later = Later.model_validate({**PLAIN.model_dump(), name: NOT_EXPORTED[name]}, strict=False)
    for form in ("c", "st", "yaml"):
        with pytest.raises(InputError, match=f"controller.{name}: is not exported; take it out"):
            controller_files(form, later, HOIST)
    with pytest.raises(InputError, match="is not exported"):
        model_of(HOIST, controller=later)
    off = Later.model_validate(PLAIN.model_dump())
    assert controller_files("c", off, HOIST) == controller_files("c", PLAIN, HOIST)


@pytest.mark.parametrize("form", ["st", "c", "yaml"])
def test_the_command_writes_a_folder_once(form: str, tmp_path: Path, commands: Commands):
    scenario = Path(__file__).resolve().parents[2] / "scenarios" / "payloads.yaml"
    words = ("export-controller", scenario, "--as", form, "--drive", "siemens-s120", "--out", tmp_path / "out")
    done = commands(*words)
    assert done.status == 0, done.err
    made = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "out").iterdir()}
    assert len(made) == {"st": 4, "c": 4, "yaml": 1}[form]
    if form == "yaml":
        assert "p1130" in made["drive_parameters.yaml"]
    again = commands(*words)
    assert again.status == 2 and "nothing is overwritten" in again.err
