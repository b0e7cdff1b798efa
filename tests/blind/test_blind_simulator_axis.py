"""The simulator of axis campaigns: honest machines, effects of the size and at the place that their labels say."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from benchmarks.validation.axis_causes import EVENTS, IN_THE_LIBRARY, LISTED, UNLISTED, scales_of
from benchmarks.validation.axis_machines import KINDS, MOTIONS, drawn_axis, excitation
from benchmarks.validation.axis_motion import (
    ACCELERATION,
    FORCE,
    FRICTION,
    LOAD_POSITION,
    POSITION,
    RECORD_S,
    SPEED,
    coupled,
    nominal_truth,
    simulate,
)
from benchmarks.validation.campaign import built, input_change, make_campaign, simulated
from benchmarks.validation.content import draw
from benchmarks.validation.families import FAMILIES
from workbench import effects
from workbench.identify.identify import identify
from workbench.logs import read_campaign

FAMILY_NAMES = [name for name, family in FAMILIES.items() if family.kind == "axis"]


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
    extra_force = (record[:, FORCE] - plain_force(p, record))[moving]
    assert rms(expected) > 0.01 * axis.force
    assert rms(extra_force - expected) < 0.01 * axis.force


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
def test_a_load_is_held_at_rest(motion):
    axis = axis_of(motion)
    x = axis.low + 0.3 * axis.travel
    nothing = np.zeros(3000)
    for p in (nominal_truth(axis), coupled(nominal_truth(axis), 0.5, 150.0, 0.05, 0.5)):
        record = simulate(p._replace(x_0=x, F_f=0.0, F_b=0.0), nothing, nothing, nothing)
        held = p.G * math.sin(x) + p.C
        assert np.mean(record[1000:, FORCE]) == pytest.approx(held, abs=0.002 * axis.force)
        assert np.ptp(record[1000:, POSITION]) < 1e-4 * axis.travel


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


@pytest.mark.parametrize("name", UNLISTED)
def test_a_cause_that_only_the_log_shows_lies_in_a_sensor(name):
    cause = UNLISTED[name](np.random.default_rng(5), scales_of(axis_of(), 1000.0))
    assert cause.subsystem.endswith("_sensor") == (bool(cause.log) and not cause.truth)


@pytest.mark.parametrize("motion", MOTIONS)
def test_every_effect_of_the_formats_list_can_be_drawn(motion):
    listed = {name for name, effect in effects.effects_for(f"axis-{motion}").items() if effect.listed}
    assert listed == set(LISTED)


@pytest.mark.parametrize("name", [*LISTED, *UNLISTED])
def test_a_cause_shows_in_the_force(name):
    content = draw(3, "axis_std", "singles", [name])
    force = content.drawn.force
    if name == "dead_band":  # it acts on the samples of the log
        assert content.causes[0].log["dead_band"] > 0.04 * force
        return
    change = input_change(content, 3)
    strongest = max(max(seconds) for seconds in change.by_second_nm.values())
    if name in EVENTS:  # it lasts for a small part of a second
        assert strongest > 0.004 * force
        return
    assert 0.004 * force < change.rms_nm < 0.3 * force


@pytest.mark.parametrize("family", FAMILY_NAMES)
@pytest.mark.parametrize("seed", range(4))
def test_a_drawn_axis_follows_its_reference_within_its_travel(seed, family):
    content = draw(seed, family, "none")
    machine, axis = built(content, (seed,)), content.drawn
    for number in range(len(content.runs)):
        run = simulated(content, machine, number, (seed,))
        assert np.std(run.record[:, SPEED] - run.reference) < 0.06 * axis.speed
        assert np.max(np.abs(run.record[:, FORCE])) < 1.5 * axis.force
        low, high = np.min(run.record[:, POSITION]), np.max(run.record[:, POSITION])
        assert axis.low - 0.05 * axis.travel < low < high < axis.low + 1.15 * axis.travel


@pytest.mark.parametrize("seed", [2, 3])
def test_an_axis_without_a_gap_is_identified_down_to_its_ripple_and_noise_and_an_ailing_one_is_not(tmp_path, seed):
    """The workbench's plant and this simulator share no code: that they agree says both are right."""
    residual = {}
    for name in ((), ("friction_wave",)):
        content = draw(seed, "axis_std", "unknown", name)
        make_campaign(tmp_path / "-".join(("made", *name)), seed, content)
        residual[name] = identify(read_campaign(tmp_path / "-".join(("made", *name)))).fit.residual_rms
    assert residual[()] < 0.02 * content.drawn.force
    assert residual[("friction_wave",)] > 1.4 * residual[()]


def test_friction_only_takes_energy():
    axis, _, record, _ = plain_run("moves")
    power = record[:, FRICTION] * record[:, SPEED]
    assert np.mean(power < -1e-9 * axis.force * axis.speed) < 0.01
    assert np.sum(power) > 0.0
