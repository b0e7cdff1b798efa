"""Scenarios that go on from another: merged key by key, each error in the file where its key stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.scenario_text import GOOD, write
from workbench.core.errors import InputError
from workbench.study.load import LONGEST_CHAIN, load_study


def child(folder: Path, text: str, base: str = GOOD) -> Path:
    write(folder, base, "base.yaml")
    return write(folder, f"extends: base.yaml\nname: child\n{text}", "child.yaml")


def test_blocks_are_merged_and_lists_replaced(tmp_path: Path) -> None:
    study = load_study(child(tmp_path, "limits: {jerk_m_s3: 2}\npayloads_kg: [100]\ncontroller: {ki_nm_per_rad: 60}\n"))
    limits = study.scenario.limits
    assert (limits.speed_m_s, limits.jerk_m_s3) == (0.7, 2.0)
    assert study.scenario.payloads_kg == (100.0,)
    assert (study.scenario.controller.kp_nm_s_per_rad, study.scenario.controller.ki_nm_per_rad) == (31.0, 60.0)
    assert study.scenario.name == "child"


def test_null_takes_a_block_back(tmp_path: Path) -> None:
    base = GOOD + "sweep: {limits.jerk_m_s3: [1, 2]}\n"
    assert len(load_study(child(tmp_path, "", base)).specs) == 8
    assert len(load_study(child(tmp_path, "sweep: null\n", base)).specs) == 4


def test_an_override_goes_over_the_same_one_however_it_is_written(tmp_path: Path) -> None:
    base = GOOD + "machine_overrides: {wire: {segment_length_m: 30, damping_time_s: 0.2}}\n"
    wire = load_study(child(tmp_path, "machine_overrides: {wire.segment_length_m: 28}\n", base)).machine.wire
    assert (wire.segment_length_m, wire.damping_time_s) == (28.0, 0.2)


def test_an_extended_scenario_is_the_same_study_as_one_written_out(tmp_path: Path) -> None:
    split = load_study(child(tmp_path, "settle_s: 5.0\n"))
    whole = load_study(write(tmp_path, GOOD.replace("name: small", "name: child") + "settle_s: 5.0\n"))
    assert split.fingerprint == whole.fingerprint


@pytest.mark.parametrize(
    ("text", "base", "says"),
    [
        ("limits: {jerk_m_s3: 0}\n", GOOD, r"child\.yaml:3: limits.jerk_m_s3: 0, expected"),
        ("", GOOD.replace("jerk_m_s3: 0.8", "jerk_m_s3: 0"), r"base\.yaml:6: limits.jerk_m_s3: 0, expected"),
        ("limits: {speed_m_s: 0.5}\n", GOOD.replace("0.8}", "0.8, jrk: 1}"), r"base\.yaml:6: limits.jrk: unknown key"),
        ("moves:\n  - by_m: 99\n", GOOD, r"child\.yaml:4: moves\[0\]: .* leaves the rail"),
        ("start_position_m: 24\n", GOOD, r"base\.yaml:5: moves\[0\]: goes from 24 m to 28 m"),
        ("sweep: {limits.jrk: [1]}\n", GOOD, r"child\.yaml:3: sweep.limits.jrk: unknown field"),
        ("lead_s: 1\n", GOOD + "sweep:\n  limits.jerk_m_s3: [0]\n", r"base\.yaml:10: sweep.limits.jerk_m_s3\[0\]: 0.0"),
        ("", GOOD + "machine: none.yaml\n", r"base\.yaml:9: machine: no machine file"),
    ],
)
def test_an_error_names_the_file_in_which_its_key_stands(tmp_path: Path, text: str, base: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_study(child(tmp_path, text, base))


def test_a_circle_is_named(tmp_path: Path) -> None:
    write(tmp_path, "extends: b.yaml\n", "a.yaml")
    write(tmp_path, "\nextends: a.yaml\n", "b.yaml")
    with pytest.raises(InputError, match=r"b\.yaml:2: extends: goes in a circle: a.yaml extends b.yaml extends a.yaml"):
        load_study(tmp_path / "a.yaml")


def test_a_chain_has_an_end(tmp_path: Path) -> None:
    write(tmp_path, GOOD, "s0.yaml")
    for k in range(1, LONGEST_CHAIN + 1):
        write(tmp_path, f"extends: s{k - 1}.yaml\n", f"s{k}.yaml")
    load_study(tmp_path / f"s{LONGEST_CHAIN - 1}.yaml")
    with pytest.raises(InputError, match="chain of more than 10 files"):
        load_study(tmp_path / f"s{LONGEST_CHAIN}.yaml")


@pytest.mark.parametrize(
    ("extends", "says"),
    [
        ("none.yaml", "no scenario file"),
        ("3", "3, expected the path"),
        ("[a]", "expected the path"),
        (".", "no scenario file"),
        ('"a\\0b"', "is not a path"),
    ],
)
def test_what_cannot_be_extended_is_named(tmp_path: Path, extends: str, says: str) -> None:
    with pytest.raises(InputError, match=rf"child\.yaml:1: extends: .*{says}"):
        load_study(write(tmp_path, f"extends: {extends}\n", "child.yaml"))
