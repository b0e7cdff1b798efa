"""The EMPS records, a real ball-screw axis, as a campaign.

A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, Eindhoven, 2019.
"""

from __future__ import annotations

from pathlib import Path

PUBLISHED = {"mass": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
HELD = "tolerances: {inertia: 0.01, coulomb: 0.05, viscous: 0.05, force_gain: 0.005, force_offset_n: 0.3}\n"
RUNS = """\
columns: {time_s: t, position_m: qm, position_reference_m: qg, force_n: {column: vir, scale: 35.1507}}
runs:
- {name: train, file: runs/DATA_EMPS.mat, start_time_s: 0.0}
- {name: pulses, file: runs/DATA_EMPS_PULSES.mat, start_time_s: 60.0}
"""


def emps_in(
    folder: Path, shared_data: Path, more: str = "", *, mass: float = PUBLISHED["mass"],
    coulomb: float = PUBLISHED["coulomb"], forward: float | None = None, viscous: float = PUBLISHED["viscous"],
    offset: float = PUBLISHED["offset"],
) -> Path:  # fmt: skip
    """What is stated of the machine; the force's offset is the sensor's. forward: of its own; more: lines."""
    folder.mkdir(exist_ok=True)
    (folder / "machine.yaml").write_text(
        f"kind: axis\nmotion: linear\nmass_kg: {mass}\ngravity: {{constant_n: 0.0}}\n"
        f"friction: {{coulomb_forward_n: {coulomb if forward is None else forward}, coulomb_backward_n: {coulomb}, "
        f"viscous_n_s_per_m: {viscous}}}\nsensors: {{force_offset_n: {offset}}}\n{more}"
    )
    (folder / "runs.yaml").write_text(RUNS)
    (folder / "runs").symlink_to(shared_data / "emps")
    return folder
