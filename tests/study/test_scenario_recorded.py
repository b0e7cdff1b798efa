"""References out of a campaign: the same motion again, as it was or smoothed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.scenario_text import write
from workbench.core.errors import InputError
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.machines.files import machine_text
from workbench.references import Step, motor_speed_rad_s, plan_motion
from workbench.references.limits import Limits
from workbench.study.load import Study, load_study
from workbench.study.run import run_specs

SCENARIO = """\
name: again
payloads_kg: [4500]
references:
  - {kind: recorded, campaign: logs, run: up}
  - {kind: s_curve, campaign: logs, run: up, smoothing_s: 0.5}
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario beside a campaign of one run: 4 m up by trapezoid, from 6 m, its set-point logged at 50 Hz."""
    machine = default_hoist()
    profile = plan_motion("trapezoid", (Step(by_m=4.0),), 6.0, Limits(0.6, 0.5), (0.0, 25.0), 1.0, 2.0).sample(0.02)
    speed = motor_speed_rad_s(profile.speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    logs = tmp_path / "logs"
    logs.mkdir()
    rows = [f"{t},{300.0 + 0.1 * k},{w},{w}" for k, (t, w) in enumerate(zip(profile.time_s, speed, strict=True))]
    write(logs, "time_s,torque_motor_nm,speed_motor_rad_s,speed_reference_rad_s\n" + "\n".join(rows) + "\n", "up.csv")
    write(logs, machine_text(machine), "machine.yaml")
    write(logs, "runs: [{name: up, file: up.csv, payload_kg: 4500.0, start_position_m: 6.0}]\n", "runs.yaml")
    write(tmp_path, SCENARIO)
    return tmp_path


def study_in(folder: Path) -> Study:
    return load_study(folder / "scenario.yaml")


def test_a_recorded_set_point_is_run_again_from_its_own_height(folder: Path) -> None:
    study = study_in(folder)
    spec = study.specs[0]
    assert (spec.run_id, spec.start_position_m) == ("4500kg_recorded", 6.0)
    ((row, run),) = run_specs([spec])
    recorded = read_campaign(folder / "logs").run("up")
    assert run is not None and row.ok
    reference = np.interp(run.time_s - spec.lead_s, recorded.time_s, recorded["speed_reference_rad_s"])
    np.testing.assert_allclose(run["speed_reference_rad_s"], reference, atol=1e-6)
    assert run["position_carriage_m"][-1] == pytest.approx(10.0, abs=0.02)
    assert row["moves"] == 1.0


def test_the_smoothed_set_point_asks_for_a_lower_torque_peak(folder: Path) -> None:
    hard, smooth = (row for row, _ in run_specs(study_in(folder).specs))
    assert smooth["peak_torque_above_static_nm"] < 0.97 * hard["peak_torque_above_static_nm"]
    assert smooth["speed_error_max_rad_s"] < 0.7 * hard["speed_error_max_rad_s"]
    assert smooth["move_time_s"] == pytest.approx(hard["move_time_s"] + 0.5)


def test_another_recording_under_the_same_name_is_another_study(folder: Path) -> None:
    before = study_in(folder).fingerprint
    log = folder / "logs" / "up.csv"
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[200] = ",".join([*lines[200].split(",")[:3], str(float(lines[200].split(",")[3]) + 0.5)])
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert study_in(folder).fingerprint != before


def test_a_recording_where_the_rail_ends_is_refused(folder: Path) -> None:
    write(folder, SCENARIO + "machine_overrides: {rail.highest_position_m: 8.0}\n")
    with pytest.raises(
        InputError, match=r"scenario\.yaml:3: references: .*leaves the rail, which reaches from 0 m to 8 m"
    ):
        study_in(folder)


def test_a_measured_campaign_gives_its_references(campaigns: Path, tmp_path: Path) -> None:
    campaign = read_campaign(campaigns / "01")
    name = campaign.runs[0].name
    text = SCENARIO.replace("campaign: logs", f"campaign: {campaigns / '01'}").replace("run: up", f"run: {name}")
    write(tmp_path, text)
    rows = [row for row, _ in run_specs(study_in(tmp_path).specs)]
    assert all(row.ok and row["move_time_s"] > 1.0 for row in rows)
