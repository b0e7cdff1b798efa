"""Laws over every kind of machine: its record, its plant, its machine.yaml and the documents say the same."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from tests.support.effect_machines import MACHINES
from workbench.core.run import Run
from workbench.effects import effects_for
from workbench.identify.model import fittable
from workbench.machines import KINDS, PLANTS, Axis, Hoist, Kind, kind_of, value_names
from workbench.machines.files import RECORDS

ROOT = Path(__file__).resolve().parents[2]
EVERY = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
# Classes of machines: what asks for one of them has a rule that belongs into the record.
MACHINE_CLASSES = {"Hoist", *(record.__name__ for record in RECORDS), "Axis"}


def a_run(kind: Kind) -> Run:
    time = np.linspace(0.0, 9.99, 1000)
    signals = dict.fromkeys(kind.signals.names, np.sin(time)) | {kind.plant.input: 3.0 * np.sin(time)}
    return Run("one", time, {name: values for name, values in signals.items() if name != "time_s"}, 500.0, 5.0)


def tolerances_of(machine: Hoist | Axis) -> Any:
    return getattr(machine, "tolerances")  # noqa: B009  declared by each record


def test_every_plant_has_its_kind_and_every_record_of_machine_yaml_too():
    assert set(KINDS) == set(PLANTS)
    assert {type(machine) for machine in MACHINES.values()} == set(RECORDS)
    assert all(kind_of(machine) is KINDS[name] for name, machine in MACHINES.items())


@EVERY
def test_the_record_names_what_the_plant_and_the_machine_have(kind):
    machine = MACHINES[kind.name]
    states = (*kind.plant.positions, *kind.plant.speeds)
    assert kind.family[0] == kind.name == kind.plant.kind
    assert kind.friction.speed in states and set(kind.friction.levels) <= set(kind.plant.parameters)
    assert set(kind.friction.off) <= set(kind.plant.parameters)
    assert kind.plant.input in kind.signals.names or set(kind.drive.parts) <= set(kind.signals.names)
    assert {port.place for port in kind.ports.values()} <= set(kind.plant.places)
    assert kind.plant.input.endswith(f"_{kind.drive.suffix}")
    keys = {*kind.sensor, *kind.free, *(value.key for value in kind.values)}
    assert keys <= {*value_names(machine), *fittable(machine)}
    assert set(kind.free) <= set(fittable(machine))
    for value in kind.base:
        assert value.spread == "factor" or value.tolerance in type(tolerances_of(machine)).model_fields


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


@EVERY
def test_sizes_are_positive_and_the_effects_can_be_named(kind):
    machine = MACHINES[kind.name]
    sizes = kind.sizes(machine, [a_run(kind)])
    assert sizes.kind == kind.name
    assert all(sizes[name] > 0.0 for name in type(sizes).__dataclass_fields__ if name != "kind")
    assert {"friction_viscous", "friction_coulomb", "torque_offset", "speed_delay"} <= set(effects_for(kind.name))


def asked_for(source: str) -> Iterator[int]:
    """Lines that ask a machine for its class."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
            names = {part.id for part in ast.walk(node.args[1]) if isinstance(part, ast.Name)}
            if names & MACHINE_CLASSES:
                yield node.lineno


def test_no_rule_asks_a_machine_for_its_class():
    texts = {file: file.read_text(encoding="utf-8") for file in (ROOT / "workbench").rglob("*.py")}
    named = re.compile(rf"\b({'|'.join(MACHINE_CLASSES)})\b")
    suspects = {
        str(f.relative_to(ROOT)): text for f, text in texts.items() if "isinstance(" in text and named.search(text)
    }
    assert {file: lines for file, text in suspects.items() if (lines := list(asked_for(text)))} == {}
