"""Laws over every kind of machine: declarations, derivatives, commands; a campaign of two inertias."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.driven_campaign import driven, planned, write
from tests.support.effect_machines import MACHINES
from workbench.analysis.usual import usual_settings
from workbench.control.settings import form_of
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.core.yaml_strict import dumps
from workbench.diagnose.readiness.checks import check_runs
from workbench.identify.identify import identify
from workbench.logs import read_campaign
from workbench.machines import (
    KINDS,
    NO_EFFECTS,
    PLANTS,
    RECORDS,
    Effects,
    Kind,
    get_value,
    kind_of,
    save_machine,
    with_values,
)
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


# Every kind of machine goes through the commands, or says in one line what it lacks.


AXES = [name for name, kind in KINDS.items() if kind.looped.position_loop]


def reach(machine: Any, kind: Any) -> tuple[float, float]:
    """A speed and a way that suit the example."""
    top = kind.looped.top_speed(machine).speed
    speed = 0.7 * top if np.isfinite(top) else {"m": 0.3, "rad": 6.0}[kind.moved.unit]
    strongest = machine.drive.limit / (2.2 * kind.looped.total_inertia(machine, 0.0))  # `planned` takes 8 / s of speed
    speed = min(speed, strongest / 8.0)
    return speed, 4.0 * speed if np.isfinite(top) else speed


@pytest.fixture(scope="module", params=AXES)
def heavier(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, float, Path]:
    """(kind, key of its inertia, the true one, a campaign whose machine.yaml has a tenth less)."""
    kind = KINDS[request.param]
    nominal = kind.example()
    key = nominal.value_of["inertia"]
    true = 1.1 * get_value(nominal, key)
    speed, way = reach(nominal, kind)
    motions = [planned(nominal, "slow", way / 4.0, speed / 5.0), planned(nominal, "fast", way, speed)]
    machine = with_values(nominal, {key: true})
    clean = driven(machine, motions, {})
    noise = {
        kind.plant.input: 1e-3 * max(float(np.max(np.abs(run[kind.plant.input]))) for run in clean),
        kind.plant.speeds[0]: 1e-5 * speed,
    }
    folder = write(tmp_path_factory.mktemp("every") / request.param, nominal, driven(machine, motions, noise))
    return request.param, key, true, folder


def test_identification_finds_the_inertia(heavier: tuple[str, str, float, Path]):
    name, key, true, folder = heavier
    identified = identify(read_campaign(folder))
    number = [free.key for free in identified.fit.free].index(key)
    # Of two inertias the runs show the sum: the motor's stays within its tolerance, and the load's takes the rest.
    if name == "two_inertia":
        number_l = [free.key for free in identified.fit.free].index("load.inertia_kg_m2")
        nominal = KINDS[name].example()
        total = identified.fit.value[number] + identified.fit.value[number_l]
        assert total == pytest.approx(true + nominal.load.inertia_kg_m2, rel=0.01)
    else:
        assert identified.fit.value[number] == pytest.approx(true, rel=0.01)


def test_replay_reports_it(heavier: tuple[str, str, float, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path):
    name, _, _, folder = heavier
    done = Commands(capsys)("replay", folder, "--out", tmp_path / "replay")
    assert done.status == 0, done.err
    overall = json.loads((tmp_path / "replay" / "replay.json").read_text())["overall"]
    assert overall[f"{KINDS[name].drive.quantity}_residual_rms_{KINDS[name].drive.suffix}"] > 0.0


@pytest.mark.parametrize(
    "name", [name if name == "slew_boom" else pytest.param(name, marks=pytest.mark.proof) for name in AXES]
)
def test_study_loop_and_tune_take_its_example(name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    kind = KINDS[name]
    machine = kind.example()
    save_machine(machine, tmp_path / "machine.yaml")
    (speed, way), unit = reach(machine, kind), kind.moved.unit
    controller = usual_settings(machine)[0]
    assert form_of(controller) in ("linear", "rotary")
    scenario = {
        "format": 1,
        "name": "example",
        "machine": "machine.yaml",
        f"start_position_{unit}": 0.0,
        "moves": [{f"by_{unit}": way}, {"dwell_s": 0.2}, {f"by_{unit}": -way}],
        "limits": {f"speed_{unit}_s": speed, f"acceleration_{unit}_s2": speed, f"jerk_{unit}_s3": 10.0 * speed},
        "references": ["ruckig"],
        "controller": controller.model_dump(exclude_none=True),
    }
    (tmp_path / "scenario.yaml").write_text(dumps(scenario), encoding="utf-8")
    run = Commands(capsys)
    for words in (("study", tmp_path / "scenario.yaml"), ("loop", "--scenario", tmp_path / "scenario.yaml"),
                  ("tune", "--scenario", tmp_path / "scenario.yaml")):  # fmt: skip
        done = run(*words, "--out", tmp_path / words[0])
        assert done.status == 0, f"{words[0]}: {done.err}"


def test_what_is_for_hoists_only_is_refused_in_one_line(heavier, capsys, tmp_path):
    name, _, _, folder = heavier
    done = Commands(capsys)("compare-models", folder, "--out", tmp_path / "models")
    assert done.status == 2
    assert len(done.err.strip().splitlines()) == 1 and f"kind '{KINDS[name].example().kind}'" in done.err


# A campaign of two inertias goes through the commands as any other: read, replayed, identified, checked.


NOMINAL = MACHINES["two_inertia"]
TRUE = {"load.inertia_kg_m2": 0.056, "coupling.stiffness_nm_per_rad": 760.0}
NOISE = {"torque_nm": 0.05, "speed_rad_s": 0.005, "angle_rad": 1e-5}


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    motions = [planned(NOMINAL, "slow", 3.0, 3.0), planned(NOMINAL, "fast", 12.0, 20.0)]
    return driven(with_values(NOMINAL, TRUE), motions, NOISE)


@pytest.fixture(scope="module")
def campaign(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("two") / "two", NOMINAL, runs)


def test_identification_finds_load_and_coupling_within_their_errors(campaign: Path):
    identified = identify(read_campaign(campaign))
    at = {free.key: number for number, free in enumerate(identified.fit.free)}
    for key, true in TRUE.items():
        value, error = identified.fit.value[at[key]], identified.fit.std_error[at[key]]
        assert value == pytest.approx(true, rel=0.005)
        assert abs(value - true) < 4.0 * error
    assert identified.after.residual_rms_moving < 1.3 * identified.after.noise_rms
    assert identified.before.residual_rms_moving > 10.0 * identified.before.noise_rms


def test_a_load_side_that_turns_the_other_way_is_refused(runs: list[Run], tmp_path: Path):
    flipped = [replace(run, signals={**run.signals, "angle_load_rad": -run["angle_rad"]}) for run in runs]
    folder = write(tmp_path / "flipped", NOMINAL, flipped)
    with pytest.raises(InputError, match=r"slow: angle_load_rad goes -1 times the way of angle_rad"):
        check_runs(read_campaign(folder))


def test_play_is_seen_in_the_motors_torque_and_gone_with_its_effect():
    motion = [planned(NOMINAL, "middle", 6.0, 8.0)]
    worn = NOMINAL.model_copy(update={"effects": {"backlash": {"play_share": 1.0, "play_rad": 0.02}}})
    taken, plain = (driven(machine, motion, {})[0]["torque_nm"] for machine in (worn, NOMINAL))
    assert np.sqrt(np.mean((taken - plain) ** 2)) > 0.3
    both = driven(with_values(NOMINAL, {"coupling.backlash_rad": 0.02}), motion, {})[0]["torque_nm"]
    assert taken == pytest.approx(both, abs=1e-3 * float(np.max(np.abs(both))))
