"""Laws over every kind of machine: its record, its plant, its machine.yaml and the documents say the same."""

from __future__ import annotations

from typing import get_args

import pytest

from tests.support.effect_machines import MACHINES
from workbench.machines import KINDS, PLANTS, kind_of
from workbench.machines.files import RECORDS

EVERY = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def test_every_plant_has_its_kind_and_every_record_of_machine_yaml_too():
    assert set(KINDS) == set(PLANTS)
    assert {type(machine) for machine in MACHINES.values()} == set(RECORDS)
    assert all(kind_of(machine) is KINDS[name] for name, machine in MACHINES.items())


@EVERY
def test_the_law_of_friction_brakes_both_ways_and_is_its_levels_beyond_standstill(kind):
    p = kind.plant.values(MACHINES[kind.name], 0.0)
    plain = type(p)(**{**vars(p), **kind.friction.off})
    forward, backward = (getattr(p, level) for level in kind.friction.levels)
    assert kind.friction.law(1e6, plain) == pytest.approx(forward, rel=1e-3)
    assert kind.friction.law(-1e6, plain) == pytest.approx(-backward, rel=1e-3)


@EVERY
def test_tables_and_ports_are_those_of_machine_yaml(kind):
    correction = type(MACHINES[kind.name]).CORRECTION
    over, acts_on = (get_args(correction.model_fields[name].annotation) for name in ("over", "acts_on"))
    assert {table.over for table in kind.tables} == set(over)
    assert set(kind.ports) == set(acts_on) == set(correction.UNITS)
    assert {table.acts_on for table in kind.tables} <= set(acts_on)
    assert {table.over for table in kind.tables if table.turn} == set(correction.PERIODIC)
    for place, port in kind.ports.items():
        assert port.unit == {"n": "N", "nm": "N m"}[correction.UNITS[place]]
