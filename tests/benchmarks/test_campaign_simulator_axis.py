"""The simulator of axis campaigns: honest machines, effects of the size and at the place that their labels say."""

from __future__ import annotations

import dataclasses
import json
import math
from functools import cache

import numpy as np
import pytest

from benchmarks.campaigns.axis.campaign import built, make_campaign, simulated
from benchmarks.campaigns.axis.content import AXES, draw
from benchmarks.campaigns.axis.kernel import (
    ACCELERATION,
    FORCE,
    FRICTION,
    LOAD_POSITION,
    LOAD_SPEED,
    POSITION,
    RECORD_S,
    SPEED,
    simulate,
)
from benchmarks.campaigns.axis.listed import ALIKE, LISTED, drawn_pair, scales_of, usual
from benchmarks.campaigns.axis.machines import MOTIONS, drawn_axis
from benchmarks.campaigns.axis.profiles import KINDS, excitation
from benchmarks.campaigns.axis.sensors import Sensors, log_columns, shown_force
from benchmarks.campaigns.axis.size import force_change
from benchmarks.campaigns.axis.truth import coupled, nominal_truth
from benchmarks.campaigns.axis.unlisted import IN_THE_LIBRARY, UNLISTED
from benchmarks.campaigns.many import make, orders
from workbench import effects
from workbench.identify.identify import identify
from workbench.logs import read_campaign


@cache
def axis_of(motion="linear", loaded=True):
    return drawn_axis(np.random.default_rng(4), motion, loaded)


@cache
def plain_run(profile="shuttle", motion="linear", **truth):
    """Axis, truth, record and reference of the nominal axis, without noise; truth: in place of its own numbers."""
    axis = axis_of(motion)
    p = nominal_truth(axis)._replace(x_0=axis.low, **truth)
    given = excitation(profile, np.random.default_rng(7), axis, 9.0)
    return axis, p, simulate(p, given.speed, given.pulses, np.zeros(len(given.speed))), given.speed


def under_way(axis, record):
    """Faster than a fiftieth of the axis' speed, and for some while already."""
    fast = np.abs(record[:, SPEED]) > 0.02 * axis.speed
    return fast & (np.convolve(~fast, np.ones(100), "full")[: len(fast)] < 0.5)


def plain_force(p, record):
    """What the equation of docs/formats.md asks for the motion of a rigid axis."""
    v = record[:, SPEED]
    level = np.where(v > 0.0, p.F_f, -p.F_b)
    return p.M_m * record[:, ACCELERATION] + p.B * v + level + p.G * np.sin(record[:, POSITION]) + p.C


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("profile", KINDS)
def test_a_rigid_axis_takes_the_force_of_its_equation(motion, profile):
    axis, p, record, _ = plain_run(profile, motion)
    moving = under_way(axis, record)
    assert np.sum(moving) * RECORD_S > 2.0
    assert rms((record[:, FORCE] - plain_force(p, record))[moving]) < 0.01 * axis.force


F, V, L = axis_of().force, axis_of().speed, axis_of().travel
MID = axis_of().low + 0.4 * L


def sign(r):
    return np.sign(r[:, SPEED])


# effect in the truth -> the force that it takes, from its law and the run's own motion.
LAWS = {
    "viscous": ("steps", {"B_f": 0.1 * F / V, "B_b": 0.1 * F / V}, lambda p, r, t: 0.1 * F / V * r[:, SPEED]),
    "viscous forward": ("steps", {"B_f": 0.1 * F / V}, lambda p, r, t: 0.1 * F / V * np.maximum(r[:, SPEED], 0.0)),
    "coulomb": ("shuttle", {"dF_f": 0.1 * F, "dF_b": 0.1 * F}, lambda p, r, t: 0.1 * F * sign(r)),
    "coulomb backward": ("shuttle", {"dF_b": 0.1 * F}, lambda p, r, t: -0.1 * F * (r[:, SPEED] < 0.0)),
    "stribeck": (
        "slow",
        {"Fs_f": 0.1 * F, "Fs_b": 0.1 * F, "v_str": 0.1 * V},
        lambda p, r, t: 0.1 * F * sign(r) * np.exp(-((r[:, SPEED] / (0.1 * V)) ** 2)),
    ),
    "load": ("shuttle", {"a_load": 0.2}, lambda p, r, t: 0.2 * abs(p.C) * sign(r)),
    "bump": (
        "shuttle",
        {"bump_A": 0.1 * F, "bump_x": MID, "bump_w": 0.1 * L},
        lambda p, r, t: 0.1 * F * sign(r) * np.exp(-0.5 * ((r[:, POSITION] - MID) / (0.1 * L)) ** 2),
    ),
    "drift": (
        "shuttle",
        {"drift_a": 1.0, "drift_tau": 5.0},
        lambda p, r, t: np.exp(-t / 5.0) * (np.where(r[:, SPEED] > 0.0, p.F_f, -p.F_b) + p.B * r[:, SPEED]),
    ),
    "quadratic drag": (
        "steps",
        {"drag_c": 0.1 * F / V**2},
        lambda p, r, t: 0.1 * F / V**2 * r[:, SPEED] * np.abs(r[:, SPEED]),
    ),
    "guide step": (
        "shuttle",
        {"step_A": 0.1 * F, "step_x": MID, "step_w": 0.01 * L},
        lambda p, r, t: 0.1 * F * sign(r) * np.clip((r[:, POSITION] - MID) / (0.01 * L) + 0.5, 0.0, 1.0),
    ),
    "friction wave": (
        "shuttle",
        {"wave_A": 0.1 * F, "wave_d": 0.3 * L, "wave_ph": 0.5},
        lambda p, r, t: 0.05 * F * sign(r) * (1.0 + np.cos(2.0 * math.pi * r[:, POSITION] / (0.3 * L) + 0.5)),
    ),
    "foreign body": (
        "shuttle",
        {"body_F": 0.1 * F, "body_t": 3.0, "body_tau": 0.5},
        lambda p, r, t: 0.1 * F * sign(r) * (t > 3.0) * (1.0 - np.exp(-np.maximum(t - 3.0, 0.0) / 0.5)),
    ),
    "cable chain": (
        "shuttle",
        {"spring_k": 0.2 * F / L, "spring_x": MID},
        lambda p, r, t: 0.2 * F / L * (r[:, POSITION] - MID),
    ),
    "cogging": (
        "slow",
        {"cog1_A": 0.05 * F, "cog1_k": 60.0 / L, "cog1_ph": 0.3},
        lambda p, r, t: -0.05 * F * np.sin(60.0 / L * r[:, POSITION] + 0.3),
    ),
    "ripple": (
        "slow",
        {"ripple_A": 0.05 * F, "ripple_n": 40.0 / L, "ripple_ph": 0.3},
        lambda p, r, t: -0.05 * F * np.sin(40.0 / L * r[:, POSITION] + 0.3),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_an_effect_takes_the_force_of_its_law(name):
    profile, truth, law = LAWS[name]
    axis, p, record, _ = plain_run(profile, **truth)
    time = np.arange(len(record)) * RECORD_S
    moving = under_way(axis, record)
    expected = law(p, record, time)[moving]
    found = (record[:, FORCE] - plain_force(p, record))[moving]
    assert rms(expected) > 0.01 * axis.force
    assert rms(found - expected) < 0.01 * axis.force


def test_friction_before_sliding_comes_back_over_its_distance():
    """Dahl's law while it moves one way: 1 − z falls with exp(−x/d)."""
    d = 0.01 * L
    _, p, record, speed = plain_run("shuttle", bristles=1.0, bristle=d, bristle_tau=0.0, B=0.0)
    begins = np.flatnonzero((speed[:-1] == 0.0) & (speed[1:] > 0.0))
    start = begins[1]  # the first move back has bent the bristles the other way
    ahead = slice(start, start + np.argmax(speed[start + 1 :] == 0.0))
    assert record[start, FRICTION] < 0.0
    way = record[ahead, POSITION] - record[start, POSITION]
    slid = record[ahead, FRICTION] / p.F_f
    one, two, five = np.searchsorted(np.maximum.accumulate(way), d * np.array([1.0, 2.0, 5.0]))
    assert 1.0 - slid[two] == pytest.approx((1.0 - slid[one]) * math.exp(-1.0), rel=0.1)
    assert slid[five] > 0.95


def test_a_load_beyond_play_lags_by_half_of_it_each_way():
    axis, play = axis_of(loaded=False), 0.01 * L
    p = coupled(nominal_truth(axis), 0.5, 150.0, 0.05, 0.3)._replace(play=play, x_0=axis.low)
    given = excitation("shuttle", np.random.default_rng(7), axis, 9.0)
    record = simulate(p, given.speed, given.pulses, np.zeros(len(given.speed)))
    stretch = record[:, POSITION] - record[:, LOAD_POSITION]
    at_speed = np.abs(given.speed) > 0.99 * np.max(given.speed)
    assert np.sum(at_speed) > 500
    friction = 0.7 * (p.F_f + p.F_b) / 2.0 + 0.7 * p.B * V
    behind = np.median((stretch * np.sign(given.speed))[at_speed])
    assert behind == pytest.approx(0.5 * play + friction / p.k_c, rel=0.1)


@pytest.mark.parametrize("motion", MOTIONS)
def test_two_sides_take_the_force_of_their_sum(motion):
    axis = axis_of(motion)
    p = coupled(nominal_truth(axis), 0.6, 120.0, 0.05, 0.4)._replace(x_0=axis.low)
    given = excitation("moves", np.random.default_rng(3), axis, 9.0)
    record = simulate(p, given.speed, given.pulses, np.zeros(len(given.speed)))
    load_acceleration = np.gradient(record[:, LOAD_SPEED], RECORD_S)
    v, v_l = record[:, SPEED], record[:, LOAD_SPEED]
    side = [np.where(s > 0.0, p.F_f, -p.F_b) + p.B * s for s in (v, v_l)]
    expected = p.M_m * record[:, ACCELERATION] + p.M_l * load_acceleration
    expected += 0.4 * side[0] + 0.6 * side[1] + p.G * np.sin(record[:, LOAD_POSITION]) + p.C
    moving = under_way(axis, record) & (np.sign(v) == np.sign(v_l))
    assert rms((record[:, FORCE] - expected)[moving]) < 0.015 * axis.force


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_load_is_held_at_rest(motion):
    axis = axis_of(motion)
    x = axis.low + 0.3 * axis.travel
    nothing = np.zeros(3000)
    for p in (nominal_truth(axis), coupled(nominal_truth(axis), 0.5, 150.0, 0.05, 0.5)):
        record = simulate(p._replace(x_0=x, F_f=0.0, F_b=0.0), nothing, nothing, nothing)
        held = p.G * math.sin(x) + p.C
        assert np.mean(record[1000:, FORCE]) == pytest.approx(held, abs=0.002 * axis.force)
        assert np.ptp(record[1000:, POSITION]) < 1e-4 * axis.travel


def test_friction_only_takes_energy():
    axis, _, record, _ = plain_run("moves")
    power = record[:, FRICTION] * record[:, SPEED]
    assert np.mean(power < -1e-9 * axis.force * axis.speed) < 0.01
    assert np.sum(power) > 0.0


@pytest.mark.parametrize(
    ("changed", "law"),
    [
        ({"gain": 1.07}, lambda f, v: 1.07 * f),
        ({"offset": 0.1 * F}, lambda f, v: f + 0.1 * F),
        ({"gain_forward": 0.05}, lambda f, v: f * (1.0 + 0.05 * np.tanh(v / (0.01 * V)))),
        ({"bend": 0.1 / F}, lambda f, v: f + 0.1 / F * f * np.abs(f)),
    ],
)
def test_the_logged_force_is_what_its_sensor_makes_of_the_true_one(changed, law):
    _, _, record, _ = plain_run()
    sensors = Sensors(force_noise=0.0, speed_noise=0.0, count=1e-6, speed_turn=0.01 * V, **changed)
    shown, _ = shown_force(record, sensors, np.random.default_rng(1), 0.0)
    assert shown == pytest.approx(law(record[:, FORCE], record[:, SPEED]), rel=1e-12)


def test_a_filtered_force_lags_by_its_time_constant():
    _, _, record, _ = plain_run()
    sensors = Sensors(force_noise=0.0, speed_noise=0.0, count=1e-6, speed_turn=1.0, filter_s=0.03)
    shown, _ = shown_force(record, sensors, np.random.default_rng(1), 0.0)
    undone = shown + 0.03 * np.gradient(shown, RECORD_S)
    assert rms(undone - record[:, FORCE]) < 0.2 * rms(shown - record[:, FORCE])


@pytest.mark.parametrize("irregular", [False, True])
def test_the_log_has_the_encoders_steps_at_its_own_times(irregular):
    _, _, record, speed = plain_run()
    count = 1e-4 * L
    sensors = Sensors(force_noise=0.01 * F, speed_noise=1e-3 * V, count=count, speed_turn=1.0, delay_s=0.02)
    columns, _ = log_columns(
        record, np.cumsum(speed) * RECORD_S, sensors, np.random.default_rng(1), np.random.default_rng(2),
        linear=True, rate_hz=200.0, logs=("position", "speed", "reference"), irregular=irregular,
    )  # fmt: skip
    assert list(columns) == ["time_s", "force_n", "position_m", "velocity_m_s", "position_reference_m"]
    time, position = columns["time_s"][0], columns["position_m"][0]
    steps = np.diff(time)
    assert np.all(steps > 0.0)
    assert (np.ptp(steps) > 1e-3) == irregular
    assert position / count == pytest.approx(np.round(position / count), abs=1e-6)
    true = np.interp(time - 0.02, np.arange(len(record)) * RECORD_S, record[:, POSITION])
    assert np.all((true - position >= -1e-9 * L) & (true - position <= count * (1.0 + 1e-9)))
    assert np.std(columns["velocity_m_s"][0] - np.gradient(true, time)) < 0.02 * V


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", [*LISTED, *IN_THE_LIBRARY])
def test_labels_use_the_names_places_and_bounds_of_the_workbenchs_library(name, motion):
    if name == "torque_ripple" and motion == "linear":
        return
    axis, kind = axis_of(motion), f"axis-{motion}"
    cause = {**LISTED, **UNLISTED}[name](np.random.default_rng(5), scales_of(axis, 1000.0))
    ((known, numbers),) = cause.library.items()
    effect = effects.find(known, kind)
    assert name in (known, *IN_THE_LIBRARY)
    assert (cause.subsystem, cause.regime) == (effect.subsystem(kind), effect.regime)
    assert set(numbers) <= {parameter.named(kind) for parameter in effect.parameters}
    effects.of(axis.machine.model_copy(update={"effects": {known: dict(numbers)}}))


@pytest.mark.parametrize("motion", MOTIONS)
def test_every_effect_of_the_formats_list_can_be_drawn(motion):
    listed = {name for name, effect in effects.effects_for(f"axis-{motion}").items() if effect.listed}
    assert listed == set(usual(motion))
    assert set(usual("axis")) == set(LISTED)


@pytest.mark.parametrize("name", [*LISTED, *UNLISTED])
def test_a_cause_shows_in_the_force(name):
    content = draw(3, "singles", names=[name])
    if name == "dead_band":  # it acts on the samples of the log
        assert content.causes[0].log["dead_band"] > 0.04 * content.axis.force
        return
    size = force_change(content, 3).rms_nm
    assert 0.004 * content.axis.force < size < 0.3 * content.axis.force


def test_effects_that_want_a_load_or_none_have_their_axis():
    for seed in range(6):
        for name, loaded in (("gearbox_efficiency", True), ("friction_load_dependent", True), ("backlash", False)):
            assert draw(seed, "singles", names=[name]).axis.loaded == loaded


def test_what_tolerances_could_take_up_is_far_beyond_them():
    for seed in range(30):
        axis, rng = drawn_axis(np.random.default_rng(seed), MOTIONS[seed % 2]), np.random.default_rng(seed)
        role, tol, scales = axis.machine.role, axis.machine.tolerances, scales_of(axis, 1000.0)
        (offset,), (B,), (gain,), (inertia,) = (
            LISTED[name](rng, scales).values.values()
            for name in ("torque_offset", "friction_viscous", "torque_scale", "inertia_error")
        )
        assert abs(offset) > 5.0 * math.hypot(
            axis.machine.offset_tolerance(axis.force), tol.gravity * role("gravity_constant")
        )
        assert 5.0 * tol.viscous * role("viscous") < B
        assert abs(gain - 1.0) > 5.0 * role("gain_tolerance")
        assert inertia < 0.0 or inertia > 5.0 * tol.inertia


def test_pairs_are_not_alike_by_nature():
    rng = np.random.default_rng(2)
    for first in usual("linear"):
        pair = drawn_pair(rng, "linear", first)
        assert pair[0] == first != pair[1]
        assert not any(set(pair) <= group for group in ALIKE)
        assert "torque_ripple" not in pair


@pytest.mark.parametrize("motion", MOTIONS)
def test_axes_are_drawn_from_gram_to_tonne_with_and_without_a_load(motion):
    axes = [drawn_axis(np.random.default_rng(seed), motion) for seed in range(60)]
    inertias = [axis.machine.role("inertia") for axis in axes]
    assert max(inertias) > 1e4 * min(inertias)
    assert 0.2 < np.mean([axis.loaded for axis in axes]) < 0.6


@pytest.mark.parametrize("seed", range(8))
def test_a_drawn_axis_follows_its_reference_within_its_travel(seed):
    content = draw(seed, "none")
    machine, axis = built(content, (seed,)), content.axis
    for number in range(len(content.runs)):
        run = simulated(content, machine, number, (seed,))
        assert np.std(run.record[:, SPEED] - run.reference) < 0.06 * axis.speed
        assert np.max(np.abs(run.record[:, FORCE])) < 1.5 * axis.force
        low, high = np.min(run.record[:, POSITION]), np.max(run.record[:, POSITION])
        assert axis.low - 0.05 * axis.travel < low < high < axis.low + 1.15 * axis.travel


@pytest.mark.parametrize("kind", ["singles", "none", "pairs", "unknown"])
def test_a_seeds_axis_and_runs_do_not_depend_on_what_ails_it(kind):
    names = {"singles": ["presliding"], "pairs": ["inertia_error", "torque_offset"], "unknown": ["force_walk"]}
    content, well = draw(21, kind, names=names.get(kind, ())), draw(21, "none")
    assert (content.axis, content.runs, content.rate_hz, content.logs) == (
        well.axis,
        well.runs,
        well.rate_hz,
        well.logs,
    )
    assert len(content.causes) == {"none": 0, "pairs": 2}.get(kind, 1)


def test_a_campaign_of_an_axis_is_read_without_a_remark_and_its_label_says_what_is_in_it(tmp_path):
    content = draw((5, 1), "singles", names=["friction_viscous"])
    label = make_campaign(tmp_path / "one", (5, 1), content)
    campaign = read_campaign(tmp_path / "one")
    machine = content.axis.machine
    assert campaign.machine.model_dump(exclude={"sensors"}) == machine.model_dump(exclude={"sensors"})
    assert [run.name for run in campaign.runs] == [plan.name for plan in content.runs]
    assert all(run.notes == () for run in campaign.runs)
    said = json.loads(label.text())
    assert said["effects"] == ["friction_viscous"]
    (value,) = said["parameters"]["friction_viscous"].values()
    assert value == said["truth"]["B_f"] == said["truth"]["B_b"]


def test_a_seed_makes_the_same_axis_campaign_to_the_byte_and_another_seed_another(tmp_path):
    content = draw(9, "pairs")
    content = dataclasses.replace(content, runs=content.runs[:1])
    for name, seed in (("a", 9), ("b", 9), ("c", 10)):
        make_campaign(tmp_path / name, seed, content)
    a, b, c = (
        {p.relative_to(tmp_path / n): p.read_bytes() for p in (tmp_path / n).rglob("*.*") if p.is_file()} for n in "abc"
    )
    assert a == b
    assert a != c


@pytest.mark.parametrize("seed", [2, 3, 9])
def test_an_axis_without_a_gap_is_identified_down_to_its_ripple_and_noise_and_an_ailing_one_is_not(tmp_path, seed):
    """The workbench's plant and this simulator share no code: that they agree says both are right."""
    residual = {}
    for name in ((), ("friction_wave",)):
        content = draw(seed, "unknown", names=name)
        make_campaign(tmp_path / "-".join(("made", *name)), seed, content)
        residual[name] = identify(read_campaign(tmp_path / "-".join(("made", *name)))).fit.residual_rms
    assert residual[()] < 0.015 * content.axis.force
    assert residual[("friction_wave",)] > 1.4 * residual[()]


@pytest.mark.parametrize("machines", AXES)
def test_orders_of_axes_hold_each_effect_that_shows_on_them_as_often_as_the_others(tmp_path, machines):
    names = usual(machines)
    wanted = orders(tmp_path, 2 * len(names), seed=4, kind="singles", machines=machines)
    singles = [order.names[0] for order in wanted]
    assert {name: singles.count(name) for name in names} == dict.fromkeys(names, 2)


def test_an_ordered_axis_is_made_with_its_size_in_the_label(tmp_path):
    order = orders(tmp_path, 1, seed=2, kind="singles", machines="linear")[0]
    assert make(order) == f"001 singles: {order.names[0]}"
    label = json.loads(order.label.read_text(encoding="utf-8"))
    assert label["torque_change_rms_nm"] > 0.0
    assert len(label["torque_change_by_second_nm"]) == len(read_campaign(order.folder).runs)
    assert make(order) == "001 is there"
