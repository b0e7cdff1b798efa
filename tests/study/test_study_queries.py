"""The queries of docs/studies.md, run on a result."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from workbench.study.load import load_study
from workbench.study.rows import read_rows
from workbench.study.store import place_for, run_batch

ROOT = Path(__file__).resolve().parents[2]
DOCS = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
SCENARIO = """\
format: 1
name: gains
payloads_kg: [0, 60000]
start_position_m: 4.0
moves: [{by_m: 1.5}, {to_m: 4.0}]
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
references: [trapezoid, ruckig]
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
sweep:
  controller.kp_nm_s_per_rad: [20.0, 40.0]
"""


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gains.yaml").write_text(SCENARIO, encoding="utf-8")
    study = load_study("gains.yaml")
    run_batch(study, place_for(study))
    return tmp_path / "results" / "gains"


def test_duckdb_answers_the_query_of_the_docs(results: Path) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    (query,) = re.findall(r"```sql\n(.*?)```", DOCS, re.DOTALL)
    lines = duckdb.sql(query).fetchall()
    rows = [row for row in read_rows(results) if row.ok]
    assert [line[:2] for line in lines] == [(0.0, 20.0), (0.0, 40.0)]  # the loads of 60 t ran off the rail
    for payload, kp, peak, error in lines:
        here = [
            row for row in rows if (row.payload_kg, row.assigned["sweep.controller.kp_nm_s_per_rad"]) == (payload, kp)
        ]
        assert len(here) == 2
        assert peak == max(row["peak_torque_percent"] for row in here)
        assert error == min(row["speed_error_max_rad_s"] for row in here)
