"""Campaigns of the multi-body machine: read like any other, and labelled with how large their causes are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import campaigns_multibody as made
from benchmarks.campaigns.campaign import built
from benchmarks.campaigns.content import Content, draw
from benchmarks.campaigns.size import input_change
from workbench.logs import read_campaign


def short(*names: str) -> Content:
    """One machine, one run of 8 s, with causes."""
    content = draw((5, 1), "hoist_clean", "singles" if names else "none", names)
    return made.MultibodyContent(**vars(replace(content, runs=(replace(content.runs[0], duration_s=8.0),))))


def test_the_label_says_how_much_torque_the_cause_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(made, "draw", lambda seed, family, case, names: short(*names))
    (order,) = made.all_orders(tmp_path, 1, 5, ("hoist_clean",), "singles")
    order = replace(order, names=("friction_coulomb",))
    assert "friction_coulomb" in made.make(order)
    label = json.loads(order.label.read_text(encoding="utf-8"))
    (run,) = read_campaign(order.folder).runs
    assert label["truth"]["multibody_arm.reach_m"] > 0.0
    (seconds,) = label["torque_change_by_second_nm"].values()
    assert len(seconds) == 8 and run.duration_s == pytest.approx(8.0, abs=0.1)
    assert 0.0 < label["torque_change_rms_nm"] < max(seconds)
    assert made.make(order) == "001 is there"


def test_without_a_cause_nothing_changes_and_a_torque_offset_changes_by_itself():
    well, ill = short(), short("torque_offset")
    assert input_change(well, (5, 1)).rms_nm == 0.0
    more = built(ill, (5, 1)).sensors.offset - built(well, (5, 1)).sensors.offset
    assert input_change(ill, (5, 1)).rms_nm == pytest.approx(abs(more), rel=1e-3)


def test_causes_that_this_machine_does_not_have_give_way():
    orders = made.all_orders(Path("out"), 40, 3, made.USUAL, "unknown")
    assert len(orders) == 40
    assert {order.names[0] for order in orders} <= set(made.UNLISTED)
    assert np.all(np.diff([order.number for order in orders]) == 1)
