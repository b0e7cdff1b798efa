"""Recorded campaigns with known truth are answered as their labels say; they lie beside the checkout."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.support.emps_campaign import RUNS
from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.records import Diagnosis
from workbench.diagnose.verdict.records import Reason, ReasonKind
from workbench.logs import read_campaign

# What is marked as proof has a quicker counterpart: effects that are found again and unknown causes of simulated runs
# in test_diagnose_laws.py, the table of campaign 33 in test_diagnose_unknown.py.


def answer(shared_data: Path, name: str) -> tuple[Diagnosis, dict[str, float]]:
    folder = shared_data / "campaigns"
    label = json.loads((folder / "labels" / f"{name}.json").read_text(encoding="utf-8"))
    return diagnose(read_campaign(folder / name), study=False), label["values"]


# 25 is of the smaller machine; 01 sticks, and its search is long.
@pytest.mark.parametrize("number", ["25", pytest.param("01", marks=pytest.mark.proof)])
def test_a_machine_within_its_tolerances_has_no_gap(shared_data: Path, number: str):
    found, _ = answer(shared_data, number)
    assert (found.verdict.word, found.verdict.effects) == ("no_gap", ())


def test_a_tight_stretch_is_named_with_its_place_and_size(shared_data: Path):
    found, told = answer(shared_data, "05")
    assert found.verdict.effects == ("friction_position_dependent",)
    peak, centre, width = (each.value for each in found.candidates[0].parameters["friction_position_dependent"])
    assert (peak, centre, width) == pytest.approx((told["bump_A"], told["bump_x"], told["bump_w"]), rel=0.1)
    assert found.shrink.after < 1.5 * found.shrink.noise < 0.2 * found.shrink.before
    assert found.where is not None
    assert (found.where.subsystem, found.where.regime) == ("guide", "position")


@pytest.mark.proof
def test_a_rail_that_changes_its_friction_at_one_height_is_unknown_and_in_the_machine_as_a_table(shared_data: Path):
    found, _ = answer(shared_data, "33")
    assert (found.verdict.word, found.verdict.effects) == ("unknown", ())
    assert "no listed effect explains" in found.verdict.sentence
    assert found.verdict.reasons[0] == Reason(ReasonKind.UNLISTED_EXPLAINS_MORE, ("friction_step",))
    assert found.corrected.measured_correction is not None
    assert found.shrink.after < 1.3 * found.shrink.noise


def values(found: Diagnosis) -> dict[str, tuple[float, float]]:
    """name -> value and standard error, of the best candidate."""
    rows = [each for rows in found.candidates[0].parameters.values() for each in rows]
    assert all(isinstance(each.value, float) and isinstance(each.std_error, float) for each in rows)
    return {each.name: (each.value, each.std_error) for each in rows}  # type: ignore[misc]


@pytest.mark.proof
def test_an_offset_of_the_torque_is_named_or_what_is_alike_by_nature(shared_data: Path):
    found, told = answer(shared_data, "16")
    assert found.verdict.word == "named"
    alike = {"torque_offset", "carriage_mass_error", "friction_coulomb_asymmetric"}
    assert "torque_offset" in {*found.verdict.effects, *found.verdict.alike} <= alike
    assert found.shrink.after < 1.3 * found.shrink.noise
    if found.verdict.effects == ("torque_offset",):  # no better than friction and mass are known
        value, error = values(found)["offset_nm"]
        assert abs(value - told["t_off"]) < 2.0 * error
        assert error < 0.4 * told["t_off"]


def test_two_effects_are_named_together_each_with_its_size(shared_data: Path):
    found, told = answer(shared_data, "23")
    assert set(found.verdict.effects) == {"friction_viscous", "torque_scale"}
    assert values(found)["viscous_n_s_per_m"][0] == pytest.approx(told["B_visc"], rel=0.1)
    assert values(found)["gain"][0] - 1.0 == pytest.approx(told["t_gain"] - 1.0, rel=0.1)
    assert found.shrink.after < 1.3 * found.shrink.noise < 0.1 * found.shrink.before


@pytest.mark.proof
def test_a_late_speed_of_a_small_machine_is_named(shared_data: Path):
    found, told = answer(shared_data, "31")
    assert found.verdict.effects == ("speed_delay",)
    assert values(found)["delay_s"][0] == pytest.approx(told["w_delay"], rel=0.1)
    # Three sampling steps of the delay are within what a log's timing may be off, so they are no part of the gap.
    assert found.shrink.after < 1.3 * found.shrink.noise < 0.25 * found.shrink.before


# A real ball-screw axis whose values are published; see test_emps.py.
MACHINE = """\
kind: axis
motion: linear
mass_kg: 95.1089
gravity: {constant_n: 0.0}
friction: {coulomb_forward_n: COULOMB, coulomb_backward_n: COULOMB, viscous_n_s_per_m: 203.5034}
sensors: {force_offset_n: OFFSET}
"""
Emps = Callable[..., Diagnosis]


@pytest.fixture(scope="module")
def emps(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Emps:
    @cache
    def diagnosed(coulomb: float = 20.3935, offset: float = -3.1648, more: str = "") -> Diagnosis:
        folder = tmp_path_factory.mktemp("emps")
        text = MACHINE.replace("COULOMB", str(coulomb)).replace("OFFSET", str(offset))
        (folder / "machine.yaml").write_text(text + more)
        (folder / "runs.yaml").write_text(RUNS)
        (folder / "runs").symlink_to(shared_data / "emps")
        return diagnose(read_campaign(folder), most_effects=1, study=False)

    return diagnosed


def test_friction_taken_out_of_a_real_axis_comes_back(emps: Emps):
    found = emps(coulomb=0.0)
    assert found.verdict.effects == ("friction_coulomb",)
    assert values(found)["level_n"][0] == pytest.approx(20.3935, rel=0.05)
    claimed = {*found.verdict.effects, *found.verdict.alike}
    assert not claimed & {"friction_stribeck", "friction_position_dependent"}
    assert found.shrink.after < 0.25 * found.shrink.before


def test_a_fully_known_real_axis_has_no_gap(emps: Emps):
    found = emps()
    assert (found.verdict.word, found.verdict.effects) == ("no_gap", ()), found.verdict.sentence


@pytest.mark.proof
@pytest.mark.parametrize("more", ["", "tolerances: {force_offset_n: 0.3, coulomb: 0.02}\n"], ids=["default", "tight"])
def test_an_offset_withheld_from_a_real_axis_comes_back(emps: Emps, more: str):
    found = emps(offset=0.0, more=more)
    assert found.verdict.effects == ("torque_offset",)
    value, error = values(found)["offset_n"]
    assert abs(value + 3.1648) < 2.0 * error
    assert error < 0.8 * 3.1648
    assert "friction_coulomb_asymmetric" in found.verdict.alike  # by nature


def test_what_a_real_axis_leaves_itself_moves_no_base_parameter_off(emps: Emps):
    found = emps()
    far = [
        abs(z)
        for z, knob in zip(found.found.base.z, found.found.base.knobs, strict=True)
        if not getattr(knob, "logarithmic", False)
    ]
    assert max(far) < 1.0
