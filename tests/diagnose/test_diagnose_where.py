"""The size of the gap, its windows, profiles and place; the machines that a fit leaves behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.support.emps_campaign import emps_in
from tests.support.searched_campaign import searched_in, simulated_search
from tests.support.simulated_campaign import simulated_campaign, true_machine
from workbench.core.run import Array
from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.gap import Gap, gap_of
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.location import where
from workbench.diagnose.location.places import Placed, Weigher, pulses_of, weighed
from workbench.diagnose.location.profiles import (
    Free,
    Variable,
    best_of,
    explain,
    forward,
    spacing,
    times,
    variables,
    wave_along_the_way,
    wave_in_time,
    way,
)
from workbench.diagnose.location.survey import Course, Survey, at_rows, loop_of, survey_of
from workbench.diagnose.location.where import where_of
from workbench.diagnose.machines import refitted_machine
from workbench.effects import find
from workbench.logs import Campaign, read_campaign
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
def test_a_gap_made_of_one_variable_is_explained_by_it_on_runs_that_were_held_out(even, name):
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


def test_a_bump_in_the_rail_is_found_in_the_guide_by_its_height_without_any_candidate(bump):
    problem, near = bump[1].problem, bump[1].within_tolerances
    where = where_of(problem, near)
    assert (where.subsystem, where.regime) == ("guide", "position")
    assert where.profiles[0].variable == "position"
    assert where.profiles[0].explains > 0.7
    assert where.side == "unsaid"


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


@pytest.mark.parametrize(("viscous", "bump_n"), [(9000.0, 1500.0), (2500.0, 9000.0)])
def test_the_larger_part_of_a_gap_of_two_causes_is_the_one_that_is_missed_more(
    tmp_path: Path, viscous: float, bump_n: float
):
    """Against replays of the delivered machine without one of them."""
    true = {"friction_viscous": {"viscous_n_s_per_m": viscous}, TRIED[0]: {**BUMP[TRIED[0]], "peak_n": bump_n}}
    machine = true_machine().model_copy(update={"effects": true})
    campaign = read_campaign(simulated_campaign(tmp_path / "two", machine))
    found = diagnose(campaign, candidates=[*true], most_effects=2, study=False)
    assert set(found.verdict.effects) == {*true}
    missed = {}
    for name in true:
        kept = {other: values for other, values in found.corrected.effects.items() if other != name}
        without = found.corrected.model_copy(update={"effects": kept})
        missed[name] = replay_runs(without, campaign.runs, found.gap.band_hz).residual_rms_moving
    larger = max(missed, key=lambda name: missed[name])
    assert found.where is not None
    regimes = {name: find(name, "hoist").regime for name in true}
    assert (found.where.subsystem, found.where.regime) == ("guide", regimes[larger])


def test_a_machine_within_its_tolerances_has_no_significant_gap(even: tuple[Campaign, SearchResult]):
    gap = gap_in(*even)
    assert not gap.significant
    assert gap.residual_rms < 1.3 * gap.noise_rms
    assert abs(gap.worst_tolerance[1]) < 3.0
    assert gap.nominal_residual_rms > 2.0 * gap.residual_rms
    assert gap.speed_rmse_percent < 0.2 * gap.nominal_speed_rmse_percent


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


def test_an_axis_whose_viscous_friction_was_taken_out_shows_its_gap_over_the_speed(shared_data: Path, tmp_path: Path):
    emps_in(tmp_path, shared_data, "tolerances: {viscous: 0.0}\n", viscous=80.0)
    campaign, search = searched_in(tmp_path, [])
    where = where_of(search.problem, search.within_tolerances)
    assert (where.subsystem, where.regime, where.side) == ("axis", "speed", "unsaid")
    assert where.profiles[0].explains > where.profiles[1].explains
    gap = gap_in(campaign, search)
    assert gap.significant
    assert gap.force_rms_n is None
    assert " N rms" in gap.sentences[0]


# Where an unknown cause lies: forces put into a campaign without a gap are given to the part they act on.


def looked_at(problem: Problem) -> Survey:
    """From its nominal values."""
    free = tuple(base_parameters(problem.machine, problem.runs).values())
    z = np.zeros(len(free))
    return survey_of(problem, Fitted((), free, z, *problem.evaluate(free, z), 0.0, 0.0, 1, True))


@pytest.fixture(scope="module")
def even_places(tmp_path_factory: pytest.TempPathFactory) -> Survey:
    """A hoist within its tolerances."""
    campaign = read_campaign(simulated_campaign(tmp_path_factory.mktemp("places") / "even_places", true_machine({})))
    return looked_at(Problem(campaign.machine, campaign.runs))


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """The same with the speed reference logged."""
    folder = tmp_path_factory.mktemp("places") / "followed"
    campaign = read_campaign(simulated_campaign(folder, true_machine({}), reference=True))
    return Problem(campaign.machine, campaign.runs)


def with_force(survey: Survey, force: Callable[[Course], Array], times_noise: float = 30.0) -> Survey:
    """The survey of noise and one torque, as large as so many times the noise, rms."""
    noise = np.random.default_rng(3).normal(scale=survey.noise, size=len(survey.residual))
    rows = at_rows(survey, [force(c)[:, None] for c in survey.runs])[:, 0]
    more = times_noise * survey.noise * rows / np.sqrt(np.mean(rows**2))
    return replace(survey, residual=noise + more)


def pulse_at(c: Course, begin_s: float, length_s: float) -> Array:
    u = (c.time - begin_s) / length_s
    return np.where((u > 0.0) & (u < 1.0), np.sin(np.pi * u) ** 2, 0.0)


FORCES: dict[str, tuple[str, str, Callable[[Course], Array]]] = {
    "rollers": ("guide", "speed", lambda c: c.speed),
    "a tight stretch": ("guide", "position", lambda c: c.way * np.exp(-(((c.position - 9.5) / 0.2) ** 2))),
    "rollers that carry the load": ("guide", "load", lambda c: c.way * c.payload),
    "a fan": ("motor", "speed", lambda c: c.speed * np.abs(c.speed)),
    "teeth that rub": ("gearbox", "load", lambda c: c.way * np.abs(c.carried)),
    "rotors": ("gearbox", "acceleration", lambda c: c.turn_acceleration),
    "a brake": ("brake", "start", lambda c: c.way * np.exp(-c.since_start / 0.8)),
    "a layer of wire": ("drum", "position", lambda c: c.carried * (c.position > 9.5)),
    "hose": ("wire", "position", lambda c: c.position),
    "a heavier load": ("payload", "load", lambda c: c.payload * (1.0 + c.acceleration / 9.81)),
    "a swell": ("platform", "time", lambda c: c.mass * np.sin(0.9 * c.time + c.payload)),
    "a saturating sensor": ("torque_sensor", "load", lambda c: c.torque**2),
    "a sensor that differs by direction": ("torque_sensor", "load", lambda c: c.torque * (c.speed > 0.0)),
    "a late speed": ("speed_sensor", "acceleration", lambda c: np.gradient(c.torque, c.time)),
}


@pytest.mark.parametrize("name", FORCES)
def test_a_force_is_given_to_the_part_it_acts_on(even_places: Survey, name: str):
    subsystem, regime, force = FORCES[name]
    most_likely = weighed(with_force(even_places, force))
    assert (most_likely.places[0].subsystem, most_likely.port.regime) == (subsystem, regime)
    assert sum(place.probability for place in most_likely.places) == pytest.approx(1.0)
    assert [place.probability for place in most_likely.places] == sorted(
        (p.probability for p in most_likely.places), reverse=True
    )


@pytest.fixture(scope="module")
def struck(even_places: Survey) -> Placed:
    """An impact of 1.5 s in the third run."""
    return weighed(
        with_force(even_places, lambda c: pulse_at(c, begin_of(even_places), 1.5) * (c is even_places.runs[2]), 1.5)
    )


def begin_of(survey: Survey) -> float:
    """Of the impact: in the middle of what the third run shows in motion."""
    return float(np.median(survey.runs[2].at))


def test_an_impact_in_one_run_is_an_event_at_its_time(even_places: Survey, struck: Placed):
    assert struck.port.regime == "event"
    begins = begin_of(even_places)
    (pulse,) = struck.pulses
    assert pulse.run == 2
    assert begins - 1.0 < pulse.from_s < begins + 0.6 < begins + 0.9 < pulse.to_s < begins + 2.5


def test_motor_signals_alone_do_not_say_what_an_impact_struck(struck: Placed):
    assert struck.places[0].probability < 0.6
    assert len(struck.places) > 3


@pytest.mark.parametrize(("side", "pull"), [("drive", 0.0), ("carriage", 1.0)])
def test_a_logged_tension_says_on_which_side_of_the_wire_an_impact_was(tmp_path: Path, side: str, pull: float):
    """The report asks for it where places on both sides are likely."""
    campaign = read_campaign(simulated_campaign(tmp_path / "pulled", true_machine({}), tension=True))
    survey = looked_at(Problem(campaign.machine, campaign.runs))
    shapes = [(pulse_at(c, begin_of(survey), 1.5) * (c is survey.runs[2]))[:, None] for c in survey.runs]
    rows, noise = at_rows(survey, shapes), np.random.default_rng(3).normal(size=len(survey.residual))
    force = survey.shown(rows, pull, False)[:, 0] * 1.5 / np.sqrt(np.mean(rows**2))
    places = weighed(replace(survey, residual=survey.noise * (noise + force))).places
    on_carriage = sum(place.probability for place in places if place.subsystem in where.CARRIAGE_SIDE)
    assert on_carriage > 0.95 if side == "carriage" else on_carriage < 0.05


def test_noise_has_no_events(even_places: Survey):
    noise = np.random.default_rng(3).normal(scale=even_places.noise, size=len(even_places.residual))
    quiet = replace(even_places, residual=noise)
    pulses = pulses_of(quiet, weigher := Weigher(quiet))
    assert pulses is None or pulses.evidence.log - pulses.choices < weigher.nothing()


def test_an_impact_at_every_start_is_no_event(even_places: Survey):
    assert weighed(with_force(even_places, FORCES["a brake"][2])).pulses == ()


def test_a_linear_loops_law_accounts_for_the_input_it_asked_for(followed: Problem):
    loop = loop_of(followed)
    assert loop is not None
    assert np.sqrt(np.mean(loop.residual**2)) < 3.0 * followed.noise


def bumped(problem: Problem, begin_s: float, size_nm: float) -> Problem:
    """The last run's log of the torque shows a bump of 1.5 s that no motion follows."""
    *others, run = problem.runs
    u = (run.time_s - begin_s) / 1.5
    bump = np.where((u > 0.0) & (u < 1.0), size_nm * np.sin(np.pi * u) ** 2, 0.0)
    signals = {**run.signals, "torque_motor_nm": run["torque_motor_nm"] + bump}
    return Problem(problem.machine, [*others, replace(run, signals=signals)])


def test_a_bump_of_the_torque_that_the_loop_did_not_ask_for_is_the_sensors(followed: Problem):
    at = float(np.median(followed.runs[-1].time_s[followed.rows[-1]]))
    most_likely = weighed(looked_at(bumped(followed, at, 60.0)))
    assert (most_likely.places[0].subsystem, most_likely.port.regime) == ("torque_sensor", "event")
    assert most_likely.places[0].probability > 0.9
    (pulse,) = most_likely.pulses
    assert pulse.from_s < at + 0.75 < pulse.to_s


def test_a_force_that_the_loop_answered_is_not_the_sensors(followed: Problem):
    survey = looked_at(followed)
    rows = at_rows(survey, [pulse_at(c, begin_of(survey), 1.5)[:, None] * (c is survey.runs[2]) for c in survey.runs])
    struck = weighed(replace(survey, residual=survey.residual + 60.0 * survey.shown(rows, 0.0, False)[:, 0]))
    assert struck.port.regime == "event"
    assert "torque_sensor" not in [place.subsystem for place in struck.places]


@pytest.mark.parametrize(("low", "said"), [(0.0, False), (0.3, True)])
def test_a_share_that_may_as_well_be_none_is_no_explanation(low: float, said: bool):
    """Of a gap at the noise the frequency was said to explain over 99 %, 0 to 100 %."""
    speed = SimpleNamespace(label="speed of the axis")
    best = cast(Any, SimpleNamespace(variable=speed, share=0.995, interval=(low, 1.0)))
    windows = cast(Any, SimpleNamespace(windows=(1, 2), held=0.8, time=0.4))
    text = " ".join(where._sentences(windows, best, None, (), "unsaid", "the gap"))
    assert ("explains over 99 %" in text) == said
    assert ("No single variable explains much of it." in text) != said
