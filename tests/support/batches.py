"""A batch for the tests of running one: 1,280 runs in ten chunks, some seconds of work."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

RUNS = 1280
SCENARIO = f"""\
format: 1
name: batch
payloads_kg: [0, 9000]
start_position_m: 4.0
moves: [{{by_m: 6.0}}, {{dwell_s: 3.0}}, {{to_m: 4.0}}]
limits: {{speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}}
references: [trapezoid, ruckig]
controller: {{kind: pi, kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}}
settle_s: 10.0
sweep:
  controller.kp_nm_s_per_rad: {{from: 10.0, to: 40.0, steps: {RUNS // 4}}}
outputs: {{signals: none}}
"""
# Half the work: for tests that count chunks, and do not have to catch a process while it is at them.
SHORT = (
    SCENARIO.replace("by_m: 6.0", "by_m: 3.0")
    .replace("dwell_s: 3.0", "dwell_s: 1.0")
    .replace("settle_s: 10.0", "settle_s: 2.0")
)


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}


def workbench(*words: object) -> subprocess.Popen[str]:
    """The command line in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "workbench", *map(str, words)],
        cwd=ROOT, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def part_of(out: Path) -> Path | None:
    """The hidden folder of an unfinished result."""
    return next(iter(out.parent.glob(f".{out.name}.*.part")), None)


def chunks_of(out: Path) -> list[Path]:
    part = part_of(out)
    return sorted(part.glob("chunks/*.parquet")) if part else []


def wait_for_chunks(out: Path, number: int, process: subprocess.Popen[str]) -> None:
    """Wait until so many chunks are kept; fails where the process ends before, or after a minute."""
    for _ in range(6000):
        if len(chunks_of(out)) >= number:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    raise AssertionError("no chunk within a minute")
