"""Campaigns of the multi-body machine: read like any other, and labelled with how large their causes are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.validation import entry, multibody
from benchmarks.validation.campaign import built, input_change
from benchmarks.validation.content import Content, draw
from workbench.blind.seal import Order
from workbench.logs import read_campaign
from workbench.machines import Hoist


def short(*names: str) -> Content:
    """One machine, one run of 8 s, with causes."""
    content = draw((5, 1), "hoist_clean", "singles" if names else "none", names)
    return multibody.SOURCE.content(replace(content, runs=(replace(content.runs[0], duration_s=8.0),)))


def test_the_label_says_how_much_torque_the_cause_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(entry, "draw", lambda seed, family, case, names: short(*names))
    order = Order(1, (5, 1), "multibody", "hoist_clean", "singles", ("friction_coulomb",))
    _, label = entry.made(None, tmp_path, order)
    assert (label.source, label.effects) == ("multibody", ("friction_coulomb",))
    (run,) = read_campaign(tmp_path / "001").runs
    assert label.truth["multibody_arm.reach_m"] > 0.0
    (seconds,) = label.torque_change_by_second_nm.values()
    assert len(seconds) == 8 and run.duration_s == pytest.approx(8.0, abs=0.1)
    assert 0.0 < label.torque_change_rms_nm < max(seconds)


def test_without_a_cause_nothing_changes_and_a_torque_offset_changes_by_itself():
    well, ill = short(), short("torque_offset")
    assert input_change(well, (5, 1)).rms_nm == 0.0
    more = built(ill, (5, 1)).sensors.offset - built(well, (5, 1)).sensors.offset
    assert input_change(ill, (5, 1)).rms_nm == pytest.approx(abs(more), rel=1e-3)


def test_an_identified_machine_is_that_of_the_well_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A coulomb friction half as large again is withheld: the machine.yaml of before does not have it."""
    monkeypatch.setattr(entry, "draw", lambda seed, family, case, names: short(*names))
    order = Order(1, (5, 1), "multibody", "hoist_clean", "singles", ("friction_coulomb",), identified=True)
    _, label = entry.made(None, tmp_path, order)
    assert label.identified
    machine, nominal = read_campaign(tmp_path / "001").machine, short().machine
    assert isinstance(machine, Hoist) and isinstance(nominal, Hoist)
    assert machine.identified["campaign"] == "plain"
    truth = built(short(), order.seed).truth
    more_n = label.parameters["friction_coulomb"]["level_n"]
    for fitted, true in (
        (machine.guide.coulomb_hoisting_n, truth.F_up),
        (machine.guide.coulomb_lowering_n, truth.F_dn),
    ):
        assert abs(fitted - true) < 0.5 * abs(more_n)
    assert machine.guide.coulomb_hoisting_n != nominal.guide.coulomb_hoisting_n
