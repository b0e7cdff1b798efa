"""The campaign simulator: honest machines, effects of the size and at the place that their labels say."""

from __future__ import annotations

import ast
import dataclasses
import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.validation.campaign import built, input_change, log_columns, make_campaign, simulated
from benchmarks.validation.content import draw
from benchmarks.validation.families import FAMILIES
from benchmarks.validation.hoist_causes import EVENTS, IN_THE_LIBRARY, LISTED, UNLISTED, scales_of
from benchmarks.validation.hoist_machines import practice_machine, reference
from benchmarks.validation.hoist_motion import (
    CARRIAGE_SPEED,
    DRUM,
    FRICTION,
    HEIGHT,
    RECORD_S,
    SHAFT,
    SPEED,
    TENSION,
    TORQUE,
    nominal_truth,
    simulate,
)
from benchmarks.validation.sensors import Window
from benchmarks.validation.standstill import LAWS as STANDSTILL_LAWS
from benchmarks.validation.standstill import drawn_standstill
from workbench import effects
from workbench.identify.identify import identify
from workbench.logs import read_campaign

ROOT = Path(__file__).resolve().parents[2]
VALIDATION = ROOT / "benchmarks" / "validation"
MACHINE, FULL_KG = practice_machine(0).machine, practice_machine(0).full_kg
FAMILY_NAMES = [name for name, family in FAMILIES.items() if family.kind == "hoist"]
ARM = MACHINE.winch.drum_diameter_m / 2.0 / MACHINE.gearbox.ratio  # N m at the motor per N of fall 1
LONG_S = 49.76


@cache
def plain_run(profile: str = "fast", **truth):
    """Truth, record and reference of the nominal machine at half payload, without noise."""
    p = nominal_truth(MACHINE)._replace(m_p=FULL_KG / 2.0, turn_m_s=5e-4, **truth)
    room = 5.5 / MACHINE.lift_m_per_rad
    speed = reference(profile, np.random.default_rng(7), duration_s=LONG_S, speed_rad_s=157.1, room_rad=room)
    nothing = np.zeros(len(speed))
    return p, simulate(p, speed, nothing, nothing), speed


def change_of(profile: str, truth: dict[str, float]):
    """Torque with the effect less torque without it, the truth with it, and the record with it; even speeds apart."""
    ill, record, speed = plain_run(profile, **truth)
    _, well, _ = plain_run(profile)
    return record[:, TORQUE] - well[:, TORQUE], ill, record, speed


def steady(speed):
    """Moving evenly for 1.2 s: what a start or a stop set swinging has died away."""
    held = np.concatenate([[False], np.abs(np.diff(speed)) < 1e-9]) & (speed != 0.0)
    span = round(1.2 / RECORD_S)
    since = np.convolve(held, np.ones(span), "full")[: len(held)]
    return since >= span - 0.5


def near_a_jump(expected):
    """A little before and 1.2 s after the law steps: the wire swings as it does after a start."""
    jump = np.concatenate([[False], np.abs(np.diff(expected)) > 1.0])
    return np.convolve(jump, np.ones(round(1.5 / RECORD_S)), "full")[150 : 150 + len(jump)] > 0.5


def starts(speed):
    """Where the reference begins to move, and how long ago that was, s."""
    moving = speed != 0.0
    since, out = 0, np.zeros(len(speed))
    for k, on in enumerate(moving):
        since = since + 1 if on else 0
        out[k] = since * RECORD_S
    return out


def sign(record):
    return np.sign(record[:, SPEED])


def at_motor(force_n):
    """Torque at the motor of a force on the carriage."""
    return 0.5 * ARM * force_n


# effect in the truth -> the torque it takes at the motor, from its law and the run's own motion.
LAWS = {
    "viscous": ("fast", {"B_up": 3000.0, "B_dn": 3000.0}, lambda p, r, t: at_motor(3000.0 * r[:, CARRIAGE_SPEED])),
    "coulomb": ("slow", {"dF_up": 4000.0, "dF_dn": 4000.0}, lambda p, r, t: at_motor(4000.0 * sign(r))),
    "coulomb down": ("slow", {"dF_dn": 4000.0}, lambda p, r, t: at_motor(-4000.0 * (r[:, CARRIAGE_SPEED] < 0.0))),
    "stribeck": (
        "slow",
        {"Fs_up": 5000.0, "Fs_dn": 5000.0, "v_str": 0.1},
        lambda p, r, t: at_motor(5000.0 * sign(r) * np.exp(-((r[:, CARRIAGE_SPEED] / 0.1) ** 2))),
    ),
    "load": ("fast", {"a_load": 0.08}, lambda p, r, t: at_motor(0.08 * p.m_p * p.g * sign(r))),
    "bump": (
        "fast",
        {"bump_A": 6000.0, "bump_x": 7.0, "bump_w": 0.8},
        lambda p, r, t: at_motor(6000.0 * sign(r) * np.exp(-0.5 * ((r[:, HEIGHT] - 7.0) / 0.8) ** 2)),
    ),
    "drift": (
        "slow",
        {"drift_a": 1.0, "drift_tau": 20.0},
        lambda p, r, t: at_motor(np.where(sign(r) > 0, p.F_up, p.F_dn) * np.exp(-t / 20.0) * sign(r)),
    ),
    "gear": ("fast", {"eta_loss": 0.04}, lambda p, r, t: 0.04 * r[:, SHAFT] / p.ratio * sign(r)),
    "layer": (
        "fast",
        {"layer_dR": 0.012, "layer_th": 34.0},
        lambda p, r, t: np.where(r[:, DRUM] > 34.3, r[:, SHAFT] / p.ratio * 0.012 / (p.R + 0.012), 0.0),
    ),
    "eccentric": (
        "slow",
        {"ecc_e": 0.008, "ecc_ph": 1.0},
        lambda p, r, t: r[:, SHAFT] / p.ratio * 0.008 * np.sin(r[:, DRUM] + 1.0) / p.R,
    ),
    "wire": ("slow", {"rho": nominal_truth(MACHINE).rho + 8.0}, lambda p, r, t: ARM * 8.0 * p.g * (p.L - r[:, HEIGHT])),
    "heave": (
        "slow",
        {"heave_A": 0.3, "heave_w": 0.7, "heave_ph": 2.0},
        lambda p, r, t: -0.3 * 0.49 * np.sin(0.7 * t + 2.0) * (r[:, SHAFT] / p.ratio / p.g),
    ),
    "carriage": ("slow", {"m_c": 8500.0}, lambda p, r, t: at_motor(500.0 * 9.81) * np.ones(len(r))),
    "fan": ("fast", {"fan_q": 0.002}, lambda p, r, t: 0.002 * r[:, SPEED] * np.abs(r[:, SPEED])),
    "rail step": (
        "fast",
        {"step_A": 4000.0, "step_x": 7.0},
        lambda p, r, t: at_motor(4000.0 * sign(r) * (r[:, HEIGHT] > 7.0)),
    ),
    "quadratic drag": (
        "fast",
        {"drag_c": 8000.0},
        lambda p, r, t: at_motor(8000.0 * r[:, CARRIAGE_SPEED] * np.abs(r[:, CARRIAGE_SPEED])),
    ),
    "roller": (
        "slow",
        {"roller_A": 5000.0, "roller_d": 1.0, "roller_ph": 0.5},
        lambda p, r, t: at_motor(2500.0 * sign(r) * (1.0 + np.cos(2.0 * math.pi * r[:, HEIGHT] + 0.5))),
    ),
    "foreign body": (
        "slow",
        {"body_F": 4000.0, "body_t": 8.0, "body_tau": 0.5},
        lambda p, r, t: at_motor(4000.0 * sign(r) * (t > 8.0) * (1.0 - np.exp(-(np.maximum(t - 8.0, 0.0)) / 0.5))),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_an_effect_takes_the_torque_of_its_law(name):
    """In even motion, to a tenth: the rest is the speed loop, which has to follow, and what pins add."""
    profile, truth, law = LAWS[name]
    change, p, record, speed = change_of(profile, truth)
    time = np.arange(len(speed)) * RECORD_S
    expected = law(p, record, time)
    even = steady(speed) & ~near_a_jump(expected)
    assert np.sum(even) > 3.0 / RECORD_S
    assert np.sqrt(np.mean(expected[even] ** 2)) > 3.0
    error = np.sqrt(np.mean((change - expected)[even] ** 2))
    assert error < 0.12 * np.sqrt(np.mean(expected[even] ** 2))


def test_inertia_takes_torque_while_the_speed_changes_and_none_else():
    change, _, record, speed = change_of("fast", {"J_m": 2.0})
    expected = 0.4 * np.gradient(record[:, SPEED], RECORD_S)
    assert np.corrcoef(change, expected)[0, 1] > 0.9
    assert np.polyfit(expected, change, 1)[0] == pytest.approx(1.0, abs=0.15)
    assert np.max(np.abs(change[steady(speed)])) < 1.0


@pytest.mark.parametrize("payload_kg", [0.0, 4500.0, 9000.0])
def test_a_load_is_held_by_its_weight_times_the_lever_over_the_gear(payload_kg):
    p = nominal_truth(MACHINE)._replace(m_p=payload_kg, x_0=10.0)
    nothing = np.zeros(1000)
    record = simulate(p, nothing, nothing, nothing)
    held = {0.0: 383.5, 4500.0: 597.1, 9000.0: 810.7}[payload_kg]  # docs/model.md, hanging still
    assert np.mean(record[:, TORQUE]) == pytest.approx(held, abs=0.1)
    weight_of_fall = p.rho * p.g * (p.L - 10.0)
    assert np.mean(record[:, TENSION]) == pytest.approx(0.5 * (p.m_c + payload_kg) * p.g + weight_of_fall, rel=1e-3)
    assert np.ptp(record[:, HEIGHT]) < 1e-4


def test_without_friction_the_motors_work_is_what_the_load_gained():
    """From rest to rest; the wire's own damping takes the rest, which is little and never negative."""
    p, record, _ = plain_run("fast", F_up=0.0, F_dn=0.0, mu=0.0, rho=0.0)
    work = np.sum(record[:, TORQUE] * record[:, SPEED]) * RECORD_S
    gained = (p.m_c + p.m_p) * p.g * (record[-1, HEIGHT] - record[0, HEIGHT])
    moved = np.sum(np.abs(record[:, TORQUE] * record[:, SPEED])) * RECORD_S
    assert -1e-4 * moved < work - gained < 0.01 * moved


def logged(content, seed, number):
    machine = built(content, (seed,))
    run = simulated(content, machine, number, (seed,))
    streams = np.random.default_rng(1), np.random.default_rng(2)
    return log_columns(content, machine.sensors, run, *streams, 0.0)[0]


@pytest.mark.parametrize("name", [name for name in UNLISTED if name not in IN_THE_LIBRARY])
def test_an_unlisted_cause_shows_in_the_log(name):
    content = draw(12, "hoist_practice", "unknown", [name])
    content = dataclasses.replace(content, runs=content.runs[2:3])
    if name == "dead_band":  # it acts on the samples of the log
        held, free = (
            sum(logged(case, 12, 0)[f"torque_motor{k}_nm"][0] for k in (1, 2))
            for case in (content, dataclasses.replace(content, causes=()))
        )
        band = content.causes[0].log["dead_band"]
        assert 0.2 * band < np.std(held - free) < band
        return
    change = input_change(content, 12)
    strongest = max(max(seconds) for seconds in change.by_second_nm.values())
    assert strongest > 1.5 if name in EVENTS else change.rms_nm > 0.8


@pytest.mark.parametrize("name", [*LISTED, *IN_THE_LIBRARY])
def test_labels_use_the_names_places_and_bounds_of_the_workbenchs_library(name):
    scales = scales_of(MACHINE, FULL_KG, 3.0, 9.0)
    cause = {**LISTED, **UNLISTED}[name](np.random.default_rng(5), scales)
    ((known, numbers),) = cause.library.items()
    effect = effects.find(known, "hoist")
    assert name in (known, *IN_THE_LIBRARY)
    assert (cause.subsystem, cause.regime) == (effect.subsystem("hoist"), effect.regime)
    assert set(numbers) <= {parameter.named("hoist") for parameter in effect.parameters}
    effects.of(MACHINE.model_copy(update={"effects": {known: numbers}}))


def test_every_effect_of_the_formats_list_can_be_drawn():
    assert {name for name, effect in effects.effects_for("hoist").items() if effect.listed} == set(LISTED)


def test_a_campaign_is_read_without_a_remark_and_its_label_says_what_is_in_it(tmp_path):
    content = draw((5, 1), "hoist_middle", "singles", ["friction_viscous"])
    label = make_campaign(tmp_path / "one", (5, 1), content)
    campaign = read_campaign(tmp_path / "one")
    assert campaign.machine == content.machine
    assert [(run.name, run.payload_kg, run.start_position_m) for run in campaign.runs] == [
        (plan.name, plan.payload_kg, plan.start) for plan in content.runs
    ]
    assert all(run.notes == () for run in campaign.runs)
    said = json.loads(json.dumps(dataclasses.asdict(label)))
    assert said["effects"] == ["friction_viscous"]
    value = said["parameters"]["friction_viscous"]["viscous_n_s_per_m"]
    assert value == said["values"]["B_visc"] == said["truth"]["B_up"]


def test_a_seed_makes_the_same_campaign_to_the_byte_and_another_seed_another(tmp_path):
    content = draw(9, "hoist_middle", "pairs")
    content = dataclasses.replace(content, runs=content.runs[:2])
    for name, seed in (("a", 9), ("b", 9), ("c", 10)):
        make_campaign(tmp_path / name, seed, content)
    a, b, c = (
        {p.relative_to(tmp_path / n): p.read_bytes() for p in (tmp_path / n).rglob("*.*") if p.is_file()} for n in "abc"
    )
    assert a == b
    assert a != c


@pytest.mark.parametrize("family", FAMILY_NAMES)
def test_all_profiles_stay_within_the_rails_on_every_drawn_machine(family):
    for seed in range(12):
        content = draw(seed, family)
        wire_m = content.machine.wire.segment_length_m
        assert min(plan.start for plan in content.runs) - 0.32 * wire_m > 0.0
    content = draw(30, family, "none")
    for number in range(min(len(content.runs), 3)):
        height = simulated(content, built(content, (30,)), number, (30,)).record[:, HEIGHT]
        assert 0.0 < np.min(height) < np.max(height) < 0.6 * content.machine.wire.segment_length_m


@pytest.mark.parametrize("seed", [103, 105])
def test_a_drawn_machine_without_a_gap_is_identified_down_to_the_noise(tmp_path, seed):
    """The workbench's plant and this simulator share no code: that they agree says both are right."""
    content = draw(seed, "hoist_small", "none")
    content = dataclasses.replace(content, runs=content.runs[:4])
    make_campaign(tmp_path / "none", seed, content)
    fit = identify(read_campaign(tmp_path / "none")).fit
    assert fit.residual_rms < 1.25 * fit.noise_rms


# place -> the torque at the motor of 100 N m there, or of a force of so much on the carriage.
AT_MOTOR = {
    "event_motor": lambda r: np.full(len(r), 100.0),
    "event_drum": lambda r: np.full(len(r), 100.0),
    "event_brake": lambda r: 100.0 * sign(r),
    "event_guide": lambda r: 100.0 * sign(r),
    "event_payload": lambda r: np.full(len(r), 100.0),
}


@pytest.mark.parametrize("name", AT_MOTOR)
def test_an_event_takes_its_torque_at_its_place_while_it_lasts(name):
    size = 100.0 / (0.5 * ARM) if name in ("event_guide", "event_payload") else 100.0
    change, _, record, _ = change_of("fast", {name: size, "event_t": 6.0, "event_s": 4.0})
    time = RECORD_S * np.arange(len(record), dtype=np.float64)
    expected = AT_MOTOR[name](record) * Window(6.0, 4.0).pulse(time)
    assert np.sqrt(np.mean((change - expected)[(time > 5.5) & (time < 10.5)] ** 2)) < 8.0
    assert np.max(np.abs(change[time < 5.9])) < 1e-9
    assert np.max(np.abs(change[time > 13.0])) < 3.0


# Laws near standstill


@pytest.mark.parametrize("law", STANDSTILL_LAWS)
def test_a_law_near_standstill_is_coulombs_at_speed_and_rises_by_its_peak_before(law):
    drawn = drawn_standstill((law,), np.random.default_rng(3))
    assert (drawn.peak > 0.0) == (law in ("smooth_peak", "lugre", "creeping"))
    peak_m_s = 20.0 * drawn.peak_speed  # wide, so that the run's slow starts pass through it
    numbers = {"bristles": drawn.bristles, "peak": drawn.peak, "peak_m_s": peak_m_s, "relax_s": drawn.relax_s}
    p, record, speed = plain_run("slow", bristle_m=2e-4, bristle_tau=0.01, **numbers)
    v, up = np.abs(record[:, CARRIAGE_SPEED]), record[:, CARRIAGE_SPEED] > 0.0
    relative = np.abs(record[:, FRICTION]) / np.where(up, p.F_up, p.F_dn)
    moving = (v > 0.005) & (starts(speed) > 0.3)
    expected = 1.0 + drawn.peak * np.exp(-((v / peak_m_s) ** 2))
    assert np.sum(moving) > 5.0 / RECORD_S
    assert np.median(np.abs(relative - expected)[moving]) < 0.005
    assert np.max(relative[moving]) < 1.05 + drawn.peak


PHYSICS = {"HOIST", "KINDS", "LINEAR", "PLANTS", "ROTARY", "TWO_INERTIA", "kind_of", "plant_of"}


@pytest.mark.parametrize(
    ("which", "allowed"),
    [
        ("hoist*.py", {"workbench.machines"}),
        ("axis*.py", {"workbench.machines"}),
        *((f"{name}.py", set()) for name in ("kind", "families", "sensors", "standstill")),
        ("multibody.py", {"workbench.machines", "workbench.machines.multibody"}),
    ],
)
def test_a_source_shares_nothing_with_the_plant_but_the_machines_records(which, allowed):
    imports = set()
    for module in VALIDATION.glob(which):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("workbench"):
                imports.add(node.module)
                assert not {alias.name for alias in node.names} & PHYSICS
            elif isinstance(node, ast.Import):
                imports |= {alias.name for alias in node.names if alias.name.startswith("workbench")}
    assert imports == allowed
