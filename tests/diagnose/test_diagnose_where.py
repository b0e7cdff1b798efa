"""The size of the gap, its windows, profiles and place; the machines that a fit leaves behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.searched_campaign import searched_in, simulated_search
from workbench.core.run import Array
from workbench.diagnose.gap import Gap, gap_of
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.location.profiles import (
    Free,
    Variable,
    best_of,
    explain,
    forward,
    held_out,
    spacing,
    times,
    variables,
    wave_along_the_way,
    wave_in_time,
    way,
)
from workbench.diagnose.location.where import HELD, where_of, windows_of
from workbench.diagnose.machines import refitted_machine
from workbench.effects import find
from workbench.logs import Campaign
from workbench.machines import Hoist
from workbench.simulate.replay import replay_runs

BUMP = {"friction_position_dependent": {"peak_n": 4000.0, "centre_m": 9.6, "width_m": 0.25}}
TRIED = ("friction_position_dependent", "friction_viscous", "heave")


@pytest.fixture(scope="module")
def bump(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, SearchResult]:
    """A tight stretch of rail at 9.6 m."""
    return simulated_search(tmp_path_factory.mktemp("where") / "bump", BUMP, TRIED)


@pytest.fixture(scope="module")
def even(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, SearchResult]:
    """A machine within its tolerances."""
    return simulated_search(tmp_path_factory.mktemp("where") / "even", {}, TRIED)


def nothing_free(problem: Problem) -> Free:
    return Free(np.zeros((problem.inputs, 0)), np.zeros(0), np.zeros(0), np.zeros(0))


def noise_of(problem: Problem) -> Array:
    return np.random.default_rng(5).normal(scale=problem.noise, size=problem.inputs)


MADE: dict[str, Callable[[Variable, Array], Array]] = {
    "speed": lambda v, way: -v.at * way,
    "position": lambda v, way: np.exp(-(((v.at - np.mean(v.at)) / 0.2) ** 2)),
    "payload": lambda v, way: v.at / 9000.0,
    "acceleration": lambda v, way: v.at,
    "since_start": lambda v, way: np.exp(-v.at / 0.5) * way,
    "drum_angle": lambda v, way: np.cos(v.at - 1.0),
}


@pytest.mark.parametrize("name", MADE)
def test_a_gap_made_of_one_variable_is_explained_by_it_on_runs_that_were_held_out(
    even: tuple[Campaign, SearchResult], name: str
):
    problem = even[1].problem
    way = np.where(forward(problem), 1.0, -1.0)
    made = next(v for v in variables(problem) if v.name == name)
    gap = MADE[name](made, way)
    gap = 10.0 * problem.noise * gap / np.sqrt(np.mean(gap**2)) + noise_of(problem)
    shares = [explain(problem, gap, v, nothing_free(problem), 0) for v in variables(problem)]
    assert best_of(shares).variable.name == name
    best = next(share for share in shares if share.variable.name == name)
    assert best.share > 0.85
    assert best.interval[0] <= best.share <= best.interval[1]


def test_noise_alone_is_explained_by_nothing_however_many_bins_there_are(even: tuple[Campaign, SearchResult]):
    problem = even[1].problem
    gap = 3.0 * noise_of(problem)
    shares = [explain(problem, gap, v, nothing_free(problem), 0) for v in variables(problem)]
    assert max(share.share for share in shares) < 0.1


def test_a_wave_in_time_with_a_phase_of_each_run_is_found_at_its_frequency(even: tuple[Campaign, SearchResult]):
    problem = even[1].problem
    phase = problem.run_of_row[: problem.inputs] * 2.0
    gap = 8.0 * problem.noise * np.sin(2.0 * np.pi * 0.31 * times(problem) + phase) + noise_of(problem)
    wave, profile = wave_in_time(problem, gap, 0)
    assert wave.variable.at[0] == pytest.approx(0.31, abs=0.01)
    assert wave.share > 0.9
    mine = np.searchsorted(profile.edges, 0.31) - 1
    assert profile.share[mine] == np.max(profile.share) > 0.9
    assert np.max(profile.share[profile.edges[:-1] > 0.6]) < 0.1


def test_a_wave_along_the_way_is_found_at_its_length(even: tuple[Campaign, SearchResult]):
    problem = even[1].problem
    assert isinstance(problem.machine, Hoist)
    turns = way(problem) / problem.machine.lift_m_per_rad / (2.0 * np.pi)
    phase = problem.run_of_row[: problem.inputs] * 2.0
    gap = 8.0 * problem.noise * np.sin(2.0 * np.pi * 1.0 * turns + phase) + noise_of(problem)
    wave_and_profile = wave_along_the_way(problem, gap, 0)
    assert wave_and_profile is not None
    wave, profile = wave_and_profile
    assert wave.variable.at[0] == pytest.approx(1.0 / (2.0 * np.pi * problem.machine.lift_m_per_rad), rel=0.01)
    assert wave.share > 0.8
    assert profile.regime == "periodic"
    assert profile.edges[np.argmax(profile.share)] <= wave.variable.at[0] <= profile.edges[np.argmax(profile.share) + 1]


def test_a_held_out_part_never_saw_its_own_fold():
    rng = np.random.default_rng(0)
    columns, gap = rng.normal(size=(40, 3)), rng.normal(size=40)
    folds = np.arange(40) % 4
    free = Free(np.zeros((40, 0)), np.zeros(0), np.zeros(0), np.zeros(0))
    part = held_out(gap, columns, np.zeros((3, 3)), free, folds)
    mine = folds == 1
    other = np.linalg.lstsq(columns[~mine], gap[~mine], rcond=None)[0]
    assert part[mine] == pytest.approx(columns[mine] @ other, rel=1e-3, abs=1e-4)


def test_windows_lie_where_the_energy_is_and_hold_most_of_it_in_little_time(even: tuple[Campaign, SearchResult]):
    problem = even[1].problem
    t, run = times(problem), problem.run_of_row[: problem.inputs]
    burst = (run == 1) & (t > 4.0) & (t < 6.0)
    loudest = windows_of(problem, np.where(burst, 1.0, 0.0))
    assert [w.run for w in loudest.windows] == [problem.runs[1].name]
    assert 3.0 < loudest.windows[0].from_s < loudest.windows[0].to_s < 7.0
    assert loudest.windows[0].to_s - loudest.windows[0].from_s >= 2.0 / problem.band_hz - 0.1
    assert loudest.held >= HELD
    assert loudest.time < 0.15


def test_a_bump_in_the_rail_is_found_in_the_guide_by_its_height_without_any_candidate(
    bump: tuple[Campaign, SearchResult],
):
    problem, near = bump[1].problem, bump[1].within_tolerances
    where = where_of(problem, near)
    assert (where.subsystem, where.regime) == ("guide", "position")
    assert where.profiles[0].variable == "position"
    assert where.profiles[0].explains > 0.7
    assert where.side == "unsaid"
    assert sum(where.energy_by_run.values()) == pytest.approx(1.0)


def test_windows_of_a_named_bump_are_its_passages(bump: tuple[Campaign, SearchResult]):
    problem, search = bump[1].problem, bump[1]
    fit = search.fits[("friction_position_dependent",)]
    where = where_of(problem, search.within_tolerances, fit, [find("friction_position_dependent", "hoist")])
    assert (where.subsystem, where.regime) == ("guide", "position")
    assert where.share > 0.6
    assert where.interval[0] <= where.share <= where.interval[1]
    height = next(v for v in variables(problem) if v.name == "position").at
    t, runs = times(problem), problem.run_of_row[: problem.inputs]
    inside = np.zeros(problem.inputs, dtype=bool)
    for window in where.windows:
        j = [run.name for run in problem.runs].index(window.run)
        inside |= (runs == j) & (t >= window.from_s) & (t <= window.to_s)
    near = np.abs(height - 9.6) < 0.35
    assert np.mean(near[inside]) > 0.75
    assert np.sum(spacing(problem)[inside]) < 0.6 * np.sum(spacing(problem))


def gap_in(campaign: Campaign, search: SearchResult) -> Gap:
    problem = search.problem
    keys = base_parameters(problem.machine, problem.runs)
    refitted = refitted_machine(problem, keys, search.within_tolerances)
    plain, after = (replay_runs(m, campaign.runs, problem.band_hz) for m in (problem.machine, refitted))
    return gap_of(problem, search, plain, after)


def test_a_machine_within_its_tolerances_has_no_significant_gap(even: tuple[Campaign, SearchResult]):
    gap = gap_in(*even)
    assert not gap.significant
    assert gap.residual_rms < 1.3 * gap.noise_rms
    assert abs(gap.worst_tolerance[1]) < 3.0
    assert gap.nominal_residual_rms > 2.0 * gap.residual_rms
    assert gap.speed_rmse_percent < 0.2 * gap.nominal_speed_rmse_percent


def test_the_refitted_machine_leaves_the_residual_of_its_fit(bump: tuple[Campaign, SearchResult]):
    campaign, search = bump
    problem = search.problem
    machine = refitted_machine(problem, base_parameters(problem.machine, problem.runs), search.within_tolerances)
    again = Problem(machine, campaign.runs, problem.band_hz).exact()
    again.rows, again.inputs = problem.rows, problem.inputs  # it says otherwise by a sample when the carriage moves
    left = again.residuals([{}])[0]
    assert left == pytest.approx(search.within_tolerances.residual, abs=0.02 * problem.noise)
    assert not machine.effects


PRACTICE = {
    "05": ("friction_position_dependent", "friction_viscous"),
    "09": ("brake_drag", "friction_stribeck"),
    "22": ("payload_mass_error", "torque_scale"),
}


@pytest.mark.parametrize("number", ["05", "22", pytest.param("09", marks=pytest.mark.proof)])
def test_recorded_campaigns_show_where_their_effect_is_without_its_name(campaigns: Path, number: str):
    label = json.loads((campaigns / "labels" / f"{number}.json").read_text(encoding="utf-8"))
    _, search = searched_in(campaigns / number, PRACTICE[number][:1])
    where = where_of(search.problem, search.within_tolerances)
    assert {"subsystem": where.subsystem, "regime": where.regime} in label["where"]
    assert where.profiles[0].explains > 0.9
    assert where.side == ("carriage" if label["signals"] == "full" else "unsaid")


EMPS_MACHINE = """\
kind: axis
motion: linear
mass_kg: 95.1089
gravity: {constant_n: 0.0}
friction: {coulomb_forward_n: 20.3935, coulomb_backward_n: 20.3935, viscous_n_s_per_m: 80.0}
sensors: {force_offset_n: -3.1648}
tolerances: {viscous: 0.0}
"""
EMPS_RUNS = """\
columns: {time_s: t, position_m: qm, position_reference_m: qg, force_n: {column: vir, scale: 35.1507}}
runs:
- {name: train, file: runs/DATA_EMPS.mat, start_time_s: 0.0}
- {name: pulses, file: runs/DATA_EMPS_PULSES.mat, start_time_s: 60.0}
"""


def test_an_axis_whose_viscous_friction_was_taken_out_shows_its_gap_over_the_speed(shared_data: Path, tmp_path: Path):
    (tmp_path / "machine.yaml").write_text(EMPS_MACHINE)
    (tmp_path / "runs.yaml").write_text(EMPS_RUNS)
    (tmp_path / "runs").symlink_to(shared_data / "emps")
    campaign, search = searched_in(tmp_path, [])
    where = where_of(search.problem, search.within_tolerances)
    assert (where.subsystem, where.regime, where.side) == ("axis", "speed", "unsaid")
    assert where.profiles[0].explains > where.profiles[1].explains
    gap = gap_in(campaign, search)
    assert gap.significant
    assert gap.force_rms_n is None
    assert " N rms" in gap.sentences[0]
