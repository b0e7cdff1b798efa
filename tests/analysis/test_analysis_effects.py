"""The linear loop of a machine with effects: closed forms, what is on the log stays out, off is exactly off."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import MOTIONS, LinearPlant, OperatingPoint, linearise
from workbench.analysis.loop import linear_loop
from workbench.analysis.margins import Margins, margins
from workbench.cli import cli
from workbench.control import PiSettings
from workbench.effects import effects_for, sizes_of
from workbench.machines import Effects, Hoist, Memory, save_machine

POINT = OperatingPoint(4500.0, 10.0)
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
SENSORS = ("torque_scale", "torque_offset", "torque_filter", "speed_delay")
INERTIA = 1.656  # kg m², drive and drum of the default machine at the motor shaft


def with_effects(**effects: dict[str, float]) -> Hoist:
    return ideal_hoist().model_copy(update={"effects": effects})


def at_start(name: str, *, off: bool) -> Hoist:
    """The default machine with one effect where a fit begins, or exactly off."""
    ranges = effects_for("hoist")[name].ranges(sizes_of(ideal_hoist()))
    gone = {r.name: r.start if r.vanishes_at is None else r.vanishes_at for r in ranges}
    return with_effects(**{name: gone if off else {r.name: r.start for r in ranges}})


def element(plant: LinearPlant, of_state: str, by: str) -> float:
    return float(plant.A[plant.states.index(of_state), plant.states.index(by)])


def margins_of(machine: Hoist, settings: PiSettings = SETTINGS) -> Margins:
    return margins(linear_loop(machine, settings, POINT))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", effects_for("hoist"))
def test_an_effect_that_vanishes_leaves_the_linear_plant_bit_for_bit(name: str, motion: Any):
    plain, gone = (
        linearise(machine, OperatingPoint(4500.0, 10.0, motion))
        for machine in (ideal_hoist(), at_start(name, off=True))
    )
    assert gone.states == plain.states
    for matrix in "ABC":
        np.testing.assert_array_equal(getattr(gone, matrix), getattr(plain, matrix))


@pytest.mark.parametrize("name", SENSORS)
def test_an_effect_on_a_sensor_leaves_the_margins_bit_for_bit(name: str):
    assert margins_of(at_start(name, off=False)) == margins_of(ideal_hoist())


@pytest.mark.parametrize("more", [0.2, 0.8])
def test_gearbox_inertia_lowers_the_crossover_in_proportion_to_the_inertia(more: float):
    # Far above the wire's 2.5 Hz the motor turns alone: |L| = kp / (J w), so the crossover is kp / (2 pi J).
    stiff = SETTINGS.model_copy(update={"kp_nm_s_per_rad": 300.0})
    heavier = with_effects(gearbox_inertia={"inertia_kg_m2": more})
    before, after = margins_of(ideal_hoist(), stiff), margins_of(heavier, stiff)
    plain = linearise(ideal_hoist(), POINT)
    assert 1.0 / plain.B[plain.states.index("speed_motor_rad_s"), 0] == pytest.approx(INERTIA, rel=1e-3)
    assert after.crossover_hz == pytest.approx(300.0 / (2.0 * math.pi * (INERTIA + more)), rel=0.01)
    assert before.crossover_hz / after.crossover_hz == pytest.approx(1.0 + more / INERTIA, rel=0.005)


def test_a_ripple_is_no_spring_on_the_shaft():
    # Its slope over the angle, 900 N m/rad, is seven times the wire's; under way it averages out.
    rippled = with_effects(torque_ripple={"amplitude_nm": 30.0, "order_per_turn": 30.0})
    np.testing.assert_allclose(linearise(rippled, POINT).A, linearise(ideal_hoist(), POINT).A, rtol=1e-9, atol=1e-9)


def lagging(tau: float) -> Effects:
    """Friction of 6000 N s/m on a carriage speed that is late by a first-order lag."""
    memory = Memory(
        "late_speed", lambda s, p: (s.speed_carriage_m_s - p.late_speed) / tau, lambda p: 0.0, lambda p: 1.0
    )
    return Effects({"guide_force_n": [lambda s, p: -(6000.0 * p.late_speed)]}, (), [memory])


def test_a_memory_that_the_motion_moves_is_a_state_of_the_loop():
    mass, tau = ideal_hoist().carriage.mass_kg + 4500.0, 0.2
    plant = linearise(ideal_hoist(), POINT, effects=lagging(tau))
    assert plant.states[-1] == "late_speed"
    assert element(plant, "late_speed", "speed_carriage_m_s") == pytest.approx(1.0 / tau)
    assert element(plant, "late_speed", "late_speed") == pytest.approx(-1.0 / tau)
    assert element(plant, "speed_carriage_m_s", "late_speed") == pytest.approx(-6000.0 / mass)
    assert plant.start[1][-1] == pytest.approx(plant.start[1][2])  # settled at the even speed


def test_the_memory_of_a_brake_that_has_let_go_is_no_state_of_the_loop():
    released = with_effects(brake_drag={"torque_nm": 60.0})
    assert linearise(released, POINT).states == linearise(ideal_hoist(), POINT).states
    assert margins_of(released) == margins_of(ideal_hoist())


def test_the_loop_command_says_what_is_in_the_loop_and_what_is_not(tmp_path: Path):
    file, out = tmp_path / "machine.yaml", tmp_path / "loop"
    machine = with_effects(gearbox_inertia={"inertia_kg_m2": 0.5}, torque_scale={"gain": 1.1})
    save_machine(machine, file)
    words = ["loop", "--machine", str(file), "--payloads", "0", "--heights", "5", "--out", str(out)]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "In the machine: gearbox_inertia." in said
    assert "Not in the loop, for they act on the log alone: torque_scale." in said
    written = json.loads((out / "loop.json").read_text(encoding="utf-8"))
    assert written["effects"]["gearbox_inertia"] == {"inertia_kg_m2": 0.5}
    computed = margins(linear_loop(machine, _rule(machine), OperatingPoint(0.0, 5.0)))
    assert written["loops"][0]["crossover_hz"] == pytest.approx(computed.crossover_hz, rel=1e-6)


def _rule(machine: Hoist) -> PiSettings:
    from workbench.analysis.usual import usual_controller

    return usual_controller(machine)
