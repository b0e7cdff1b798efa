"""Damaged results, files that must not be overwritten, links that lead nowhere: one sentence each."""

from __future__ import annotations

import errno
import json
import math
from dataclasses import replace
from typing import Any

import pytest

from benchmarks.attack.mangle import finished_result
from workbench.core.errors import InputError
from workbench.core.whole_folder import replace_json
from workbench.machines import default_hoist
from workbench.study.conclude import alarm, sentences, utilisation
from workbench.study.rows import INDEX, Row, check_whole, read_manifest, read_rows


def test_a_result_knows_its_own_bytes(tmp_path):
    whole = finished_result()
    manifest = read_manifest(whole)
    assert manifest is not None
    assert set(manifest["files"]) == {"index.parquet", "scenario.yaml", "machine.yaml"}
    for name in (INDEX, "manifest.json"):
        (tmp_path / name).write_bytes((whole / name).read_bytes())
    assert [row.status for row in read_rows(tmp_path)] == ["ok"] * len(read_rows(whole))
    (tmp_path / INDEX).write_bytes((whole / INDEX).read_bytes() + b"x")
    with pytest.raises(InputError, match=r"index\.parquet: is not what was written, as manifest\.json says"):
        check_whole(tmp_path, INDEX)


@pytest.mark.parametrize("content", ["name: my scenario\n", '{"other": 1}', "[1]", '"newly_failed"'])
def test_json_replaces_nothing_that_it_did_not_write(tmp_path, content):
    path = tmp_path / "precious.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match="was not written by this command; nothing is overwritten"):
        replace_json(path, {"newly_failed": []}, "newly_failed")
    assert path.read_text() == content


def test_json_is_written_whole_or_not_at_all_and_knows_no_nan(tmp_path, monkeypatch):
    path = tmp_path / "compared.json"
    replace_json(path, {"newly_failed": [], "x": math.nan, "inner": {"y": [math.inf, 1.0]}}, "newly_failed")
    said: dict[str, Any] = {"newly_failed": [], "x": None, "inner": {"y": [None, 1.0]}}
    assert json.loads(path.read_text()) == said

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        replace_json(path, {"newly_failed": [1]}, "newly_failed")
    assert json.loads(path.read_text()) == said
    assert [file.name for file in tmp_path.iterdir()] == ["compared.json"]


def at_the_limit(rms_nm: float) -> Row:
    metrics = {"peak_torque_motor_nm": 800.0, "peak_torque_percent": 160.0, "rms_torque_motor_nm": rms_nm}
    metrics |= {"slack_time_s": 0.0, "slack_events": 0.0, "position_error_end_m": 0.0}
    return Row("a", "s", "ok", "", 4500.0, "trapezoid", metrics)


def hunting(swings: float) -> Row:
    row = at_the_limit(400.0)
    return replace(
        row, metrics={**row.metrics, "torque_swings": swings, "move_time_s": 7.0, "peak_speed_percent": 50.0}
    )


def test_a_loop_that_hunts_below_its_limits_is_pointed_out_where_runs_are_judged():
    assert any(
        "The loop hunts" in said and "50 times a second of motion" in said
        for said in sentences([hunting(350.0)], 1000.0)
    )
    assert not any("hunts" in said for said in sentences([hunting(14.0)], 1000.0))
    lights = {use.what: use.light for use in utilisation([hunting(350.0)], default_hoist())}
    assert lights["torque swings"] == "red"
    assert "torque swings 25 times 2 a second" in str(alarm(utilisation([hunting(350.0)], default_hoist())))
    assert "torque swings" not in {use.what for use in utilisation([hunting(14.0)], default_hoist())}
