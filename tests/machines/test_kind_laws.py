"""Laws over every kind of machine: what it declares agrees with the derivatives of its traced equations."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from tests.support.effect_machines import MACHINES
from workbench.core.run import Array
from workbench.machines import KINDS, NO_EFFECTS, PLANTS, Effects, Kind, kind_of
from workbench.machines.files import RECORDS
from workbench.symbolic.derive import jacobian
from workbench.symbolic.expr import Scalar, symbol

EVERY = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
PAYLOAD_KG = 3000.0


def _named(x: Scalar, s: Any, p: Any) -> Scalar:
    return x


def rates_by(kind: Kind, by: list[str], states: int = 12) -> Array:
    """(states, rates, names): derivatives of the accelerations by parameters (their symbols) and by what effects add
    at places, at random states of the example: fast and near standstill, either way."""
    plant, rng = kind.plant, np.random.default_rng(5)
    p = plant.values(kind.example(), PAYLOAD_KG)
    names = {name: symbol(name) for name in (*plant.positions, *plant.speeds, "u", *vars(p), *plant.places)}
    effects = Effects({place: [partial(_named, names[place])] for place in plant.places})
    q, y = ([names[name] for name in which] for which in (plant.positions, plant.speeds))
    traced = plant.rates(0.0, q, y, names["u"], SimpleNamespace(**{n: names[n] for n in vars(p)}), effects)
    found = []
    for k in range(states):
        start, even, hold = plant.start_of(1.0 + 0.1 * k, (1.0 if k % 3 else 1e-5) * rng.normal(), p)
        moved = [x * (1.0 + 1e-4 * rng.normal()) for x in start]
        at = [*moved, *[v * (1.0 + 0.1 * rng.normal()) for v in even], 1.3 * hold + rng.normal()]
        everything = jacobian(traced, list(names.values()), [*at, *vars(p).values(), *[0.0] * len(plant.places)])
        found.append(everything[:, [list(names).index(name) for name in by]])
    return np.array(found)


def faults(kind: Kind) -> list[str]:
    """What of a kind's parameters no fit and no diagnosis would ever doubt, in words."""
    keys = {
        symbol: key for symbol, key in kind.plant.parameters.items() if isinstance(key, str) and key != "payload_kg"
    }
    by_parameters, by_places = rates_by(kind, list(keys)), rates_by(kind, list(kind.plant.places))
    exact = {value.key for value in kind.values if value.exact}
    prior, sentences = {value.key for value in kind.base}, []
    for number, key in enumerate(keys.values()):
        moves = by_parameters[:, :, number]
        if not np.any(moves) or key in exact:
            continue
        if key not in prior:
            sentences.append(f"{key} moves the machine and has no prior: declare its Value, or say why it is exact")
        for at, of in zip(moves, by_places, strict=True):
            left = at - of @ np.linalg.lstsq(of, at, rcond=None)[0]
            if np.linalg.norm(left) > 1e-6 * np.linalg.norm(at):
                sentences.append(f"{key} moves the machine where no place lets an effect act")
                break
    return sentences


@EVERY
def test_every_parameter_that_moves_the_machine_has_a_prior_and_a_place(kind: Kind):
    assert faults(kind) == []


@EVERY
def test_a_value_has_one_declaration_and_a_prior_or_a_reason(kind: Kind):
    keys = [value.key for value in kind.values]
    assert len(set(keys)) == len(keys) and set(kind.symbols) - {"payload_kg"} <= set(keys)
    for value in kind.values:
        assert bool(value.exact) != bool(value.tolerance or value.spread == "factor"), value.key
        assert not (value.exact and value.free), value.key


def rigid_inertia(kind: Kind) -> float:
    """kg m² or kg: the second derivative of the kinetic energy by the speed of an even motion."""
    p = kind.plant.values(kind.example(), PAYLOAD_KG)

    def energy(speed: float) -> float:
        q, y, _ = kind.plant.start_of(1.0, speed, p)
        return float(kind.plant.energy(q, y, p))

    return energy(1.0) - 2.0 * energy(0.0) + energy(-1.0)


@EVERY
def test_the_declared_inertias_are_that_of_the_energy(kind: Kind):
    machine, p = kind.example(), kind.plant.values(kind.example(), PAYLOAD_KG)
    rough = 0.02 if kind.transmission else 1e-6  # a hoist's sheave is left out of its controller's feed-forward
    assert kind.rigid(machine, PAYLOAD_KG).inertia == pytest.approx(rigid_inertia(kind), rel=1e-5)
    assert kind.looped.total_inertia(machine, PAYLOAD_KG) == pytest.approx(rigid_inertia(kind), rel=rough)
    if kind.looped.inertia is not None:
        assert kind.looped.inertia(p) == pytest.approx(rigid_inertia(kind), rel=rough)


@EVERY
def test_the_declared_load_holds_the_machine_still(kind: Kind):
    p = kind.plant.values(kind.example(), PAYLOAD_KG)
    for place in (0.3, 1.0, 2.0):
        hold = kind.plant.equilibrium(place, p)[1]
        if kind.looped.load is not None:
            assert kind.looped.load(p, place) == pytest.approx(hold, rel=1e-6, abs=1e-9)
        still = kind.plant.start_of(place, 0.0, p)
        assert kind.plant.rates(0.0, still[0], still[1], hold, p, NO_EFFECTS)[0] == pytest.approx(0.0, abs=1e-6)


@EVERY
def test_the_declared_friction_is_what_an_even_motion_loses(kind: Kind):
    p = kind.plant.values(kind.example(), PAYLOAD_KG)
    for speed in (-3.0, 0.5):
        if kind.looped.friction is not None:
            q, y, hold = kind.plant.start_of(1.0, speed, p)
            lost = kind.plant.dissipation(0.0, q, y, hold, p)
            assert kind.looped.friction(p, speed) * speed == pytest.approx(lost, rel=1e-6)


def test_a_kind_whose_inertia_has_no_prior_is_found_out():
    boom = KINDS["slew_boom"]
    silent = replace(boom, values=tuple(value for value in boom.values if "inertia" not in value.key))
    assert faults(silent) == [
        "boom.inertia_kg_m2 moves the machine and has no prior: declare its Value, or say why it is exact"
    ]


def test_a_kind_that_no_effect_can_reach_is_found_out():
    coupled = KINDS["two_inertia"]
    motor_only = {place: what for place, what in coupled.plant.places.items() if place.startswith("axis")}
    unreached = replace(coupled, plant=replace(coupled.plant, places=motor_only))
    assert "load.inertia_kg_m2 moves the machine where no place lets an effect act" in faults(unreached)


@EVERY
def test_power_in_is_the_rate_of_energy_plus_dissipation(kind: Kind):
    """u v = dE/dt + losses at random states near an even motion, by exact derivatives of the traced energy."""
    plant, rng = kind.plant, np.random.default_rng(7)
    p = plant.values(kind.example(), PAYLOAD_KG)
    by = [symbol(name) for name in (*plant.positions, *plant.speeds)]
    n = len(plant.positions)
    energy = plant.energy(by[:n], by[n:], p)
    for k in range(20):
        q, y, hold = plant.start_of(1.0 + 0.2 * k, (1.0 if k % 3 else 1e-4) * rng.normal(), p)
        q = [x * (1.0 + 1e-5 * rng.normal()) for x in q]
        y = [v * (1.0 + 0.1 * rng.normal()) for v in y]
        u = 1.3 * hold + rng.normal()
        slopes = jacobian([energy], by, [*q, *y])[0]
        rate = slopes @ np.array([*y, *plant.rates(0.0, q, y, u, p)])
        lost = plant.dissipation(0.0, q, y, u, p)
        assert lost >= -1e-9
        size = np.sum(np.abs(slopes * np.array([*y, *plant.rates(0.0, q, y, u, p)]))) + abs(u * y[0]) + lost
        assert rate == pytest.approx(u * y[0] - lost, abs=1e-9 * size)


# Laws over every kind of machine: its record, its plant, its machine.yaml and the documents say the same.


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
