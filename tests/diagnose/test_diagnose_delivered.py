"""One machine, one number: what the report says of the delivered machine.yaml, a replay of that file says too."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Commands
from workbench.core.run import Array
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.effects import check
from workbench.logs import read_campaign
from workbench.machines import load_machine, save_machine
from workbench.simulate.replay import ReplayResult, replay_runs
from workbench.view.diagnosis import candidates_table

# Two hoists and three axes: a run of axis 10 reverses often, and the log of axis 15 is 29 ms late. What is marked as
# proof takes a minute or more.
CAMPAIGNS = [
    ("campaigns/05", ("friction_position_dependent",)),
    ("campaigns/31", ("speed_delay",)),
    ("axes/03", None),
    ("axes/10", ("friction_thermal_drift",)),
    ("axes/15", ("speed_delay",)),
    pytest.param("axes/17", ("backlash",), marks=pytest.mark.proof),
    pytest.param("campaigns/14", None, marks=pytest.mark.proof),
    pytest.param("campaigns/44", None, marks=pytest.mark.proof),
    pytest.param("real/geared_pendulum", None, marks=pytest.mark.proof),
]
EVERYWHERE = ("campaigns/05", "campaigns/31", "axes/03", "axes/15")  # alike at each sample that both look at


@pytest.mark.parametrize(("name", "candidates"), CAMPAIGNS)
def test_a_replay_of_the_delivered_machine_gives_the_reports_numbers_and_the_fits(
    shared_data: Path, name: str, candidates: tuple[str, ...] | None, tmp_path: Path
):
    campaign = read_campaign(shared_data / name, check_effects=check)
    d = diagnose(campaign, candidates=candidates, quick=True)
    save_machine(d.corrected, tmp_path / "machine.yaml")
    delivered = load_machine(tmp_path / "machine.yaml", check_effects=check)
    again = replay_runs(delivered, campaign.runs, d.gap.band_hz)
    for row in d.candidates:  # one definition of explained, for what was predicted on held-out runs and nothing else
        left, gap = (max((rms or 0.0) ** 2 - d.shrink.noise**2, 0.0) for rms in (row.held_out_rms, d.shrink.before))
        share = None if row.held_out_rms is None else pytest.approx(max(1.0 - left / max(gap, 1e-300), 0.0), abs=1e-9)
        assert row.explained == share, row.effects
    beyond = [math.sqrt(max(rms**2 - d.shrink.noise**2, 0.0)) for rms in (d.shrink.before, d.shrink.after)]
    if d.verdict.word == "named":
        assert 1.0 - (beyond[1] / beyond[0]) ** 2 == pytest.approx(d.verdict.explained, abs=1e-9)
        assert f"It explains {candidates_table(d).rows[0][2]} of" in d.verdict.sentence
    assert math.hypot(*d.shrink.parts.values()) == pytest.approx(max(d.shrink.before, d.shrink.after))
    said = {run.name: run.after for run in d.delivered.runs}
    assert all(run.after > 0.8 * run.noise for run in d.delivered.runs)  # no model leaves less than its sensors' noise
    assert {run.name: run.residual_rms_moving for run in again.runs} == pytest.approx(said, rel=1e-3)
    assert d.delivered.residual_rms == pytest.approx(again.residual_rms_moving, rel=1e-3)
    # A replay takes the impacts that the delivered inertia has, the fit those of the machine as given.
    as_fitted = replay_runs(delivered, campaign.runs, d.gap.band_hz, d.search.problem.bench.impacts)
    for name_of_run, apart, rms in apart_of(d, as_fitted):
        runs = zip(d.search.problem.runs, d.search.problem.logged, strict=True)
        slow = any(one is not other for one, other in runs)  # friction turns over within a mean of samples: 0.23
        assert float(np.sqrt(np.mean(apart**2))) < (0.3 if slow else 0.005) * rms, name_of_run
        if name in EVERYWHERE and not slow:
            assert float(np.max(np.abs(apart))) < 0.01 * rms, name_of_run


def apart_of(d: Diagnosis, again: ReplayResult) -> Iterator[tuple[str, Array, float]]:
    """Of each run, at the samples of the fit: what a replay leaves less what the fit leaves, and the rms of that."""
    if d.unknown is not None:  # a table is fitted on samples of its own
        return
    problem = d.search.problem
    fit = d.search.fits[d.judged.names] if d.judged.names else d.search.within_tolerances
    left = fit.residual[: problem.inputs]
    for j, run in enumerate(again.runs):
        mine = left[problem.run_of_row[: problem.inputs] == j]
        at, log = problem.runs[j].time_s[problem.rows[j]], run.balance.run.time_s  # of a long log by means of samples
        assert np.mean(np.interp(at, log, run.balance.moving)) > 0.98, run.name
        rms = float(np.sqrt(np.mean(mine**2)))
        yield run.name, np.interp(at, log, run.balance.residual) - mine, rms


def test_the_commands_agree_to_every_digit_they_print(shared_data, tmp_path, capsys):
    workbench, folder, out = Commands(capsys), shared_data / "campaigns/05", tmp_path / "out"
    words = ("--quick", "--candidates", "friction_position_dependent")
    assert workbench("diagnose", folder, *words, "--out", out).status == 0
    said = json.loads((out / "diagnosis.json").read_text())["delivered"]
    replayed = workbench(
        "replay", folder, "--machine", out / "machine.yaml", "--band", said["band_hz"], "--out", tmp_path / "replay"
    )
    assert replayed.status == 0
    runs = json.loads((tmp_path / "replay" / "replay.json").read_text())["runs"]
    assert {run["name"]: run["torque_residual_rms_moving_nm"] for run in runs} == pytest.approx(
        {run["name"]: run["after"] for run in said["runs"]}, rel=1e-3
    )
