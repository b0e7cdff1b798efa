"""Where an unknown cause lies: forces put into a campaign without a gap are given to the part they act on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.simulated_campaign import simulated_campaign, true_machine
from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.places import Placed, Weigher, pulses_of, weighed
from workbench.diagnose.location.survey import Course, Survey, at_rows, loop_of, survey_of
from workbench.logs import read_campaign


def looked_at(problem: Problem) -> Survey:
    """From its nominal values."""
    free = tuple(base_parameters(problem.machine, problem.runs).values())
    z = np.zeros(len(free))
    return survey_of(problem, Fitted((), free, z, *problem.evaluate(free, z), 0.0, 0.0, 1, True))


@pytest.fixture(scope="module")
def even(tmp_path_factory: pytest.TempPathFactory) -> Survey:
    """A hoist within its tolerances."""
    campaign = read_campaign(simulated_campaign(tmp_path_factory.mktemp("places") / "even", true_machine({})))
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
def test_a_force_is_given_to_the_part_it_acts_on(even: Survey, name: str):
    subsystem, regime, force = FORCES[name]
    most_likely = weighed(with_force(even, force))
    assert (most_likely.places[0].subsystem, most_likely.port.regime) == (subsystem, regime)
    assert sum(place.probability for place in most_likely.places) == pytest.approx(1.0)
    assert [place.probability for place in most_likely.places] == sorted(
        (p.probability for p in most_likely.places), reverse=True
    )


@pytest.fixture(scope="module")
def struck(even: Survey) -> Placed:
    """An impact of 1.5 s in the third run."""
    return weighed(with_force(even, lambda c: pulse_at(c, begin_of(even), 1.5) * (c is even.runs[2]), 1.5))


def begin_of(survey: Survey) -> float:
    """Of the impact: in the middle of what the third run shows in motion."""
    return float(np.median(survey.runs[2].at))


def test_an_impact_in_one_run_is_an_event_at_its_time(even: Survey, struck: Placed):
    assert struck.port.regime == "event"
    begins = begin_of(even)
    (pulse,) = struck.pulses
    assert pulse.run == 2
    assert begins - 1.0 < pulse.from_s < begins + 0.6 < begins + 0.9 < pulse.to_s < begins + 2.5


def test_motor_signals_alone_do_not_say_what_an_impact_struck(struck: Placed):
    assert struck.places[0].probability < 0.6
    assert len(struck.places) > 3


def test_noise_has_no_events(even: Survey):
    noise = np.random.default_rng(3).normal(scale=even.noise, size=len(even.residual))
    quiet = replace(even, residual=noise)
    pulses = pulses_of(quiet, weigher := Weigher(quiet))
    assert pulses is None or pulses.evidence.log - pulses.choices < weigher.nothing()


def test_an_impact_at_every_start_is_no_event(even: Survey):
    assert weighed(with_force(even, FORCES["a brake"][2])).pulses == ()


def test_a_linear_loops_law_accounts_for_the_input_it_asked_for(followed: Problem):
    loop = loop_of(followed)
    assert loop is not None
    assert np.sqrt(np.mean(loop.residual**2)) < 3.0 * followed.noise


def test_without_a_reference_the_loop_says_nothing(even: Survey):
    assert not even.loop


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
