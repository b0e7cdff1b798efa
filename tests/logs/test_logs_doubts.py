"""Wrong logs that can be read: each kind of edit of one run leaves a note that names it, and sound runs leave none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attack.edits import EDITS, edited
from workbench.core.run import Run
from workbench.logs import Campaign, read_campaign
from workbench.logs.doubts import doubts_of


@cache
def read(folder: Path) -> Campaign:
    return read_campaign(folder)


HOISTS = ("17", "40")  # torque filtered, twice as large
AXES = ("09", "14")  # neither as rigid as the law that they are compared with

# What an axis' other runs, or the physics, cannot tell.
HIDDEN = {"start position 3 m off"}


@pytest.mark.parametrize("name", HOISTS)
def test_sound_runs_of_hoists_leave_no_note_whatever_effect_they_show(campaigns: Path, name: str):
    campaign = read(campaigns / name)
    assert doubts_of(campaign.machine, campaign.runs) == []


@pytest.mark.parametrize("name", AXES)
def test_sound_runs_of_axes_leave_no_note(shared_data: Path, name: str):
    campaign = read_campaign(shared_data / "axes" / name)
    assert doubts_of(campaign.machine, campaign.runs) == []


@pytest.mark.proof
def test_no_sound_run_of_all_recordings_leaves_a_note(shared_data: Path):
    runs = 0
    for runs_yaml in sorted(shared_data.glob("*/*/runs.yaml")):
        campaign = read_campaign(runs_yaml)
        runs += len(campaign.runs)
        assert doubts_of(campaign.machine, campaign.runs) == [], runs_yaml
    assert runs > 300


@pytest.mark.parametrize("edit", sorted(set(EDITS) - HIDDEN))
def test_an_edited_run_is_named_and_no_other(campaigns: Path, edit: str):
    campaign = read(campaigns / "01")
    for k in (1, 2):
        run = edited(campaign.machine, campaign.runs[k], edit, seed=k)
        if run is None:  # an empty run has no payload to lose
            continue
        notes = doubts_of(campaign.machine, [*campaign.runs[:k], run, *campaign.runs[k + 1 :]])
        assert notes
        assert all(note.startswith(f"{run.name}: ") and "check" in note for note in notes), notes


def test_a_start_position_is_held_against_the_logged_one(campaigns: Path):
    campaign = read(campaigns / "21")
    run = edited(campaign.machine, campaign.runs[2], "start position 3 m off", seed=0)
    assert run is not None
    (note,) = doubts_of(campaign.machine, [*campaign.runs[:2], run, *campaign.runs[3:]])
    assert note.startswith(f"{run.name}: position_carriage_m begins at ")
    assert note.endswith("check start_position_m")


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("force x 1.3", "times what the other runs' machine takes for this motion"),
        ("force with an offset", "off what its motion takes on average"),
        ("time x 1.2", "1.2 times as long"),
        ("noise x 10", "times as noisy as in the other runs"),
    ],
)
def test_an_edited_run_of_an_axis_is_named(shared_data: Path, edit: str, said: str):
    campaign = read_campaign(shared_data / "axes" / "01")

    def scaled(run: Run, change: Callable[[np.ndarray], np.ndarray]) -> Run:
        return replace(run, signals={**run.signals, "force_n": change(run["force_n"])})

    run = campaign.runs[1]
    if edit == "force x 1.3":
        run = scaled(run, lambda force: 1.3 * force)
    elif edit == "force with an offset":
        run = scaled(run, lambda force: force + 0.15 * np.ptp(force))
    else:
        run = edited(campaign.machine, run, edit, seed=1) or run
    notes = doubts_of(campaign.machine, [campaign.runs[0], run, *campaign.runs[2:]])
    assert any(note.startswith(f"{run.name}: ") and said in note for note in notes), notes


def test_a_wrong_payload_is_told_with_the_one_that_fits(campaigns: Path):
    campaign = read(campaigns / "01")
    wrong = replace(campaign.run("half_fast"), payload_kg=4.5)
    runs = [wrong if run.name == wrong.name else run for run in campaign.runs]
    (note,) = doubts_of(campaign.machine, runs)
    fits = float(note.split("payload_kg: ")[1].split(" kg would fit")[0])
    assert fits == pytest.approx(4500.0, rel=0.05)
