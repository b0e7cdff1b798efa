"""The campaign simulator: honest machines, effects of the size and at the place that their labels say."""

from __future__ import annotations

import ast
import dataclasses
import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.campaigns.campaign import built, make_campaign, simulated
from benchmarks.campaigns.content import KINDS, draw
from benchmarks.campaigns.kernel import (
    CARRIAGE_SPEED,
    DRUM,
    HEIGHT,
    RECORD_S,
    SHAFT,
    SPEED,
    TENSION,
    TORQUE,
    simulate,
)
from benchmarks.campaigns.listed import LISTED, NEARLY_INVISIBLE, USUAL, scales_of
from benchmarks.campaigns.machines import drawn_machine, practice_machine
from benchmarks.campaigns.many import make, orders
from benchmarks.campaigns.profiles import reference
from benchmarks.campaigns.sensors import Sensors, log_columns, shown_torque
from benchmarks.campaigns.size import torque_change
from benchmarks.campaigns.truth import nominal_truth
from benchmarks.campaigns.unlisted import IN_THE_LIBRARY, UNLISTED
from workbench import effects
from workbench.identify.identify import identify
from workbench.logs import read_campaign

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "benchmarks" / "campaigns"
MACHINE, FULL_KG = practice_machine(0)
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
    "viscous of hoisting": (
        "fast",
        {"B_up": 5000.0},
        lambda p, r, t: at_motor(5000.0 * np.maximum(r[:, CARRIAGE_SPEED], 0.0)),
    ),
    "coulomb": ("slow", {"dF_up": 4000.0, "dF_dn": 4000.0}, lambda p, r, t: at_motor(4000.0 * sign(r))),
    "coulomb of lowering": (
        "slow",
        {"dF_dn": 4000.0},
        lambda p, r, t: at_motor(-4000.0 * (r[:, CARRIAGE_SPEED] < 0.0)),
    ),
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
    "wire": (
        "slow",
        {"rho": nominal_truth(MACHINE).rho + 8.0},
        lambda p, r, t: ARM * 8.0 * p.g * (p.L - r[:, HEIGHT]),
    ),
    "heave": (
        "slow",
        {"heave_A": 0.3, "heave_w": 0.7, "heave_ph": 2.0},
        lambda p, r, t: -0.3 * 0.49 * np.sin(0.7 * t + 2.0) * (r[:, SHAFT] / p.ratio / p.g),
    ),
    "carriage": (
        "slow",
        {"m_c": 8500.0},
        lambda p, r, t: at_motor(500.0 * 9.81) * np.ones(len(r)),
    ),
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


def test_a_late_brake_drags_after_each_start_and_lets_go():
    change, _, record, speed = change_of("fast", {"brk_T": 80.0, "brk_tau": 0.8})
    since = starts(speed)
    for direction in (-1.0, 1.0):
        early = (since > 0.5) & (since < 0.9) & (sign(record) == direction)
        assert np.mean(change[early]) * direction > 15.0
    assert np.max(np.abs(change[(since > 4.5) & steady(speed)])) < 1.0


def test_the_speed_loop_works_against_ripple_and_its_frequency_follows_the_speed():
    _, _, record, speed = change_of("slow", {"ripple_A": 20.0})
    change = change_of("slow", {"ripple_A": 20.0})[0]
    for level in np.unique(np.round(speed[steady(speed)], 6)):
        even = steady(speed) & (np.abs(speed - level) < 1e-5)
        even = np.flatnonzero(even)[: 2 * (np.sum(even) // 2)]
        spectrum = np.abs(np.fft.rfft((change[even] - np.mean(change[even])) * np.hanning(len(even)), 1 << 17))
        peak = np.fft.rfftfreq(1 << 17, RECORD_S)[np.argmax(spectrum)]
        assert peak == pytest.approx(abs(level) / (2.0 * math.pi), rel=0.08)
    assert np.std(record[steady(speed), SPEED] - speed[steady(speed)]) > 0.05


@pytest.mark.parametrize("name", NEARLY_INVISIBLE)
def test_what_a_taut_wire_hides_hardly_changes_the_torque(name):
    cause = LISTED[name](np.random.default_rng(1), scales_of(MACHINE, FULL_KG, 3.0, 9.0))
    change, _, _, speed = change_of("fast", dict(cause.truth))
    assert 0.0 < np.sqrt(np.mean(change[steady(speed)] ** 2)) < 1.5


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


def test_what_sticks_holds_within_its_friction():
    p = nominal_truth(MACHINE)._replace(bristles=1.0, bristle_m=3e-4, z_0=0.6)
    nothing = np.zeros(4000)
    above = np.mean(simulate(p, nothing, nothing, nothing)[:, TORQUE])
    free = np.mean(simulate(p._replace(z_0=0.0), nothing, nothing, nothing)[:, TORQUE])
    assert 2.0 < above - free < at_motor(p.F_up)


def test_without_friction_the_motors_work_is_what_the_load_gained():
    """From rest to rest; the wire's own damping takes the rest, which is little and never negative."""
    p, record, _ = plain_run("fast", F_up=0.0, F_dn=0.0, mu=0.0, rho=0.0)
    work = np.sum(record[:, TORQUE] * record[:, SPEED]) * RECORD_S
    gained = (p.m_c + p.m_p) * p.g * (record[-1, HEIGHT] - record[0, HEIGHT])
    moved = np.sum(np.abs(record[:, TORQUE] * record[:, SPEED])) * RECORD_S
    assert -1e-4 * moved < work - gained < 0.01 * moved


def test_friction_only_takes_energy():
    _, record, _ = plain_run("steps")
    p, free, _ = plain_run("steps", F_up=0.0, F_dn=0.0, mu=0.0)
    work, less = (np.sum(r[:, TORQUE] * r[:, SPEED]) * RECORD_S for r in (record, free))
    path = np.sum(np.abs(record[:, CARRIAGE_SPEED])) * RECORD_S
    gained = (p.m_c + p.m_p) * p.g * ((record[-1, HEIGHT] - record[0, HEIGHT]) - (free[-1, HEIGHT] - free[0, HEIGHT]))
    nominal = 5250.0 * path  # the mean of both levels, without the pins'
    assert 0.9 * nominal < work - less - gained < 1.5 * nominal


@pytest.mark.parametrize(
    ("sensors", "law"),
    [
        (Sensors(gain=1.07), lambda T, w: 1.07 * T),
        (Sensors(offset_nm=-30.0), lambda T, w: T - 30.0),
        (Sensors(gain_hoisting=0.05), lambda T, w: T * (1.0 + 0.05 * np.tanh(w))),
        (Sensors(bend_per_nm=1e-4), lambda T, w: T + 1e-4 * T**2),
    ],
)
def test_the_logged_torque_is_what_its_sensor_makes_of_the_true_one(sensors, law):
    _, record, _ = plain_run("fast")
    shown, _ = shown_torque(record, sensors, np.random.default_rng(1), 0.0)
    assert shown == pytest.approx(law(record[:, TORQUE], record[:, SPEED]), rel=1e-12)


def test_a_filtered_torque_lags_by_its_time_constant():
    _, record, _ = plain_run("fast")
    shown, _ = shown_torque(record, Sensors(filter_s=0.2), np.random.default_rng(1), 0.0)
    assert shown + 0.2 * np.gradient(shown, RECORD_S) == pytest.approx(record[:, TORQUE], abs=3.0)
    assert np.std(shown - record[:, TORQUE]) > 3.0


def test_noise_and_digits_are_those_of_the_recorded_logs(campaigns):
    content = draw(3, "none", machines="practice")
    run = simulated(content, built(content, (3,)), 0, (3,))
    columns, _ = log_columns(
        run.record, run.reference, Sensors(), np.random.default_rng(1), np.random.default_rng(2), rate_hz=100.0
    )
    recorded = np.genfromtxt(campaigns / "20" / "runs" / "half_fast.csv", delimiter=",", names=True)
    for name in ("torque_motor1_nm", "torque_motor2_nm", "speed_motor_rad_s"):
        ours, theirs = (np.std(np.diff(np.diff(np.round(x, 2)))) for x in (columns[name][0], recorded[name]))
        assert ours == pytest.approx(theirs, rel=0.05), name


@pytest.mark.parametrize("name", ["foreign_body", "torque_walk", "soft_payload", "dead_band"])
def test_an_unlisted_cause_shows_in_the_log(name):
    content = draw(12, "unknown", names=[name], machines="practice")
    if name == "dead_band":  # it acts on the samples of the log
        held, _ = _logged(content)
        free, _ = _logged(dataclasses.replace(content, causes=()))
        band = content.causes[0].log["dead_band_nm"]
        assert 0.2 * band < np.std(held - free) < band
    else:
        assert torque_change(content, 12).rms_nm > 1.0


def _logged(content):
    run = simulated(content, built(content, (12,)), 2, (12,))
    sensors = built(content, (12,)).sensors
    streams = np.random.default_rng(1), np.random.default_rng(2)
    columns, wander = log_columns(run.record, run.reference, sensors, *streams, rate_hz=100.0)
    return columns["torque_motor1_nm"][0] + columns["torque_motor2_nm"][0], wander


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
    content = draw((5, 1), "singles", names=["friction_viscous"])
    label = make_campaign(tmp_path / "one", (5, 1), content)
    campaign = read_campaign(tmp_path / "one")
    assert campaign.machine == content.machine
    assert [(run.name, run.payload_kg, run.start_position_m) for run in campaign.runs] == [
        (plan.name, plan.payload_kg, plan.start_position_m) for plan in content.runs
    ]
    assert all(run.notes == () for run in campaign.runs)
    said = json.loads(label.text())
    assert said["effects"] == ["friction_viscous"]
    value = said["parameters"]["friction_viscous"]["viscous_n_s_per_m"]
    assert value == said["values"]["B_visc"] == said["truth"]["B_up"]


def test_a_seed_makes_the_same_campaign_to_the_byte_and_another_seed_another(tmp_path):
    content = dataclasses.replace(draw(9, "pairs"), runs=draw(9).runs[:2])
    for name, seed in (("a", 9), ("b", 9), ("c", 10)):
        make_campaign(tmp_path / name, seed, content)
    a, b, c = (
        {p.relative_to(tmp_path / n): p.read_bytes() for p in (tmp_path / n).rglob("*.*") if p.is_file()} for n in "abc"
    )
    assert a == b
    assert a != c


@pytest.mark.parametrize("kind", KINDS)
def test_a_seeds_machine_and_runs_do_not_depend_on_what_ails_it(kind):
    content, well = draw(21, kind), draw(21, "none")
    assert (content.machine, content.runs, content.rate_hz) == (well.machine, well.runs, well.rate_hz)
    assert len(content.causes) == {"none": 0, "pairs": 2}.get(kind, 1)
    if kind == "pairs":
        assert len({cause.subsystem for cause in content.causes}) == 2


def test_all_profiles_stay_within_the_rails_on_every_drawn_machine():
    for seed in range(40):
        content = draw(seed)
        low = min(plan.start_position_m for plan in content.runs) - 0.32 * content.machine.wire.segment_length_m
        assert low > 0.0
    content = draw(30, "none", machines="drawn")
    for number in range(len(content.runs)):
        height = simulated(content, built(content, (30,)), number, (30,)).record[:, HEIGHT]
        assert 0.0 < np.min(height) < np.max(height) < 0.6 * content.machine.wire.segment_length_m


def test_drawn_machines_lift_their_payload_within_the_motors_nominal_torque():
    for seed in range(50):
        machine, full_kg = drawn_machine(np.random.default_rng(seed))
        holding = (machine.carriage.mass_kg + full_kg) * 9.81 * machine.winch.drum_diameter_m / 4.0
        assert 0.55 < holding / machine.gearbox.ratio / (2.0 * machine.motor.nominal_torque_nm) < 0.95
        assert 2000.0 <= machine.carriage.mass_kg <= 15000.0


@pytest.mark.parametrize("seed", [103, 105])
def test_a_drawn_machine_without_a_gap_is_identified_down_to_the_noise(tmp_path, seed):
    """The workbench's plant and this simulator share no code: that they agree says both are right."""
    content = draw(seed, "none", machines="drawn")
    make_campaign(tmp_path / "none", seed, content)
    fit = identify(read_campaign(tmp_path / "none")).fit
    assert fit.residual_rms < 1.25 * fit.noise_rms


def test_an_ailing_machine_is_not(tmp_path):
    content = draw(103, "singles", names=["friction_position_dependent"], machines="drawn")
    make_campaign(tmp_path / "bump", 103, content)
    fit = identify(read_campaign(tmp_path / "bump")).fit
    assert fit.residual_rms > 2.0 * fit.noise_rms


def test_orders_hold_each_effect_as_often_as_the_others(tmp_path):
    wanted = orders(tmp_path, 132, seed=4)
    kinds = [order.kind for order in wanted]
    assert {kind: kinds.count(kind) for kind in KINDS} == {"singles": 88, "none": 22, "pairs": 13, "unknown": 9}
    singles = [order.names[0] for order in wanted if order.kind == "singles"]
    assert {name: singles.count(name) for name in USUAL} == dict.fromkeys(USUAL, 4)
    assert wanted == orders(tmp_path, 132, seed=4)


def test_what_is_there_stays_and_what_broke_off_is_made_again(tmp_path):
    order = orders(tmp_path, 1, seed=2, kind="none")[0]
    assert make(order) == "001 none: no gap"
    assert make(order) == "001 is there"
    before = (order.folder / "runs.yaml").read_bytes()
    order.label.unlink()
    (order.folder / "runs.yaml").unlink()
    assert make(order) == "001 none: no gap"
    assert (order.folder / "runs.yaml").read_bytes() == before


def test_the_simulator_shares_nothing_with_the_plant_but_the_machines_records():
    imports = set()
    for module in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("workbench"):
                imports.add(node.module)
            elif isinstance(node, ast.Import):
                imports |= {alias.name for alias in node.names if alias.name.startswith("workbench")}
    assert imports == {"workbench.machine"}
    for module in (ROOT / "workbench").rglob("*.py"):
        assert "benchmarks" not in re.findall(r"^(?:from|import) (\w+)", module.read_text(encoding="utf-8"), re.M)
