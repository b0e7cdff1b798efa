"""Recorded campaigns with known truth are answered as their labels say; they lie beside the checkout."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.records import Diagnosis
from workbench.logs import read_campaign


def answer(shared_data: Path, name: str) -> tuple[Diagnosis, dict[str, float]]:
    folder = shared_data / "campaigns"
    label = json.loads((folder / "labels" / f"{name}.json").read_text(encoding="utf-8"))
    return diagnose(read_campaign(folder / name), study=False), label["values"]


def test_a_machine_that_sticks_has_no_gap(shared_data: Path):
    found, _ = answer(shared_data, "01")
    assert (found.verdict.word, found.verdict.effects) == ("no_gap", ())


def test_a_tight_stretch_is_named_with_its_place_and_size(shared_data: Path):
    found, told = answer(shared_data, "05")
    assert found.verdict.effects == ("friction_position_dependent",)
    peak, centre, width = (each.value for each in found.candidates[0].parameters["friction_position_dependent"])
    assert (peak, centre, width) == pytest.approx((told["bump_A"], told["bump_x"], told["bump_w"]), rel=0.1)
    assert found.shrink.after < 1.5 * found.shrink.noise < 0.2 * found.shrink.before
    assert found.where is not None
    assert (found.where.subsystem, found.where.regime) == ("guide", "position")


def test_a_rail_that_changes_its_friction_at_one_height_is_unknown_and_in_the_machine_as_a_table(shared_data: Path):
    found, _ = answer(shared_data, "33")
    assert (found.verdict.word, found.verdict.effects) == ("unknown", ())
    assert found.corrected.measured_correction is not None
    assert found.shrink.after < 1.3 * found.shrink.noise
