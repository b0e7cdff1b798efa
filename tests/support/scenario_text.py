"""A small scenario that the tests of scenarios bend."""

from __future__ import annotations

from pathlib import Path

from workbench.study.load import Study, load_study

GOOD = """\
format: 1
name: small
payloads_kg: [0, 9000]
start_position_m: 4.0
moves: [{by_m: 4.0}, {dwell_s: 0.5}, {to_m: 4.0}]
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
references: [trapezoid, ruckig]
controller: {kind: pi, kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
"""


def write(folder: Path, text: str, name: str = "scenario.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def study_of(folder: Path, more: str = "", old: str = "", new: str = "") -> Study:
    """The study of GOOD with `old` replaced and `more` at its end."""
    assert old in GOOD
    return load_study(write(folder, (GOOD.replace(old, new) if old else GOOD) + more))
