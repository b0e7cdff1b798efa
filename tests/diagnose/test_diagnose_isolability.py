"""Angles between signatures, the smallest visible amounts, and what is told apart by neither."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.searched_campaign import simulated_search
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.isolability import angle_between, isolability, separations, smallest_amount
from workbench.diagnose.isolability import best_signatures as signatures

TRIED = (
    "torque_offset", "carriage_mass_error", "friction_viscous", "friction_viscous_asymmetric",
    "friction_position_dependent", "payload_mass_error",
)  # fmt: skip


@pytest.fixture(scope="module")
def heavier(tmp_path_factory: pytest.TempPathFactory) -> SearchResult:
    """A carriage 500 kg heavier than stated: in motor signals alone, much like an offset of the torque."""
    truth = {"carriage_mass_error": {"mass_kg": 500.0}}
    return simulated_search(tmp_path_factory.mktemp("isolability") / "heavier", truth, TRIED)[1]


def unit(*angles_deg: float) -> np.ndarray:
    return np.array([[math.cos(math.radians(a)) for a in angles_deg], [math.sin(math.radians(a)) for a in angles_deg]])


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 12.0, 45.0, 60.0, 90.0])
def test_the_angle_of_two_directions_is_the_one_between_them(degrees: float):
    assert angle_between(unit(20.0), unit(20.0 + degrees)) == pytest.approx(degrees, abs=1e-8)


def test_a_direction_within_a_plane_is_at_no_angle_to_it():
    plane = np.eye(3)[:, :2]
    inside = np.array([[0.6], [0.8], [0.0]])
    outside = np.array([[0.6], [0.0], [0.8]])
    assert angle_between(plane, inside) == pytest.approx(0.0, abs=1e-6)
    assert angle_between(inside, plane) == pytest.approx(0.0, abs=1e-6)
    assert angle_between(plane, outside) == pytest.approx(math.degrees(math.asin(0.8)))


@pytest.mark.parametrize(("data", "prior"), [(40.0, 0.0), (1e-3, 5.0), (2.0, 3.0), (300.0, 0.1)])
def test_the_smallest_visible_amount_is_worth_exactly_nothing(data: float, prior: float):
    scale = 400.0
    a = smallest_amount(data, prior, 2, scale)
    assert a * a * (data + prior) == pytest.approx(2.0 * math.log(scale))


def test_an_offset_and_an_error_of_mass_are_alike_and_a_bump_is_like_neither(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    at = {name: k for k, name in enumerate(answer.names)}
    mass = answer.angle[at["torque_offset"], at["carriage_mass_error"]]
    place = answer.angle[at["torque_offset"], at["friction_position_dependent"]]
    assert mass < 0.6 * place
    text = " ".join(answer.sentences)
    assert "torque_offset" in text and "carriage_mass_error" in text
    assert "friction_position_dependent" not in text


def test_a_special_case_is_no_fault_of_the_campaign(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    at = {name: k for k, name in enumerate(answer.names)}
    assert answer.angle[at["friction_viscous"], at["friction_viscous_asymmetric"]] < 1.0
    assert "friction_viscous" not in " ".join(answer.sentences)
    projection = Projection.of(heavier.problem, heavier.within_tolerances)
    scale = heavier.problem.share * heavier.problem.inputs
    best = signatures(projection, heavier.signatures, scale)
    apart = separations(best, projection.priors, scale)
    i, j = (list(best).index(name) for name in ("friction_viscous", "friction_viscous_asymmetric"))
    assert apart[i, j] == math.inf


def test_visible_amounts_are_in_the_first_parameters_unit_and_below_what_was_put_in(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    name, amount = answer.visible["torque_offset"]
    assert name == "offset_nm"
    assert 0.5 < amount < 40.0
    least = 0.02 * heavier.problem.noise  # of some hundred independent samples a tenth of the noise shows
    name, amount = answer.visible["friction_position_dependent"]
    machine = heavier.problem.machine
    assert name == "peak_n"
    assert amount > least / machine.lift_m_per_rad
