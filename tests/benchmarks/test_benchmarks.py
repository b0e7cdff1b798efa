"""The benchmarks' own hoist against the workbench's, and the form of what they write. Nothing here is timed."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

from benchmarks import ours
from benchmarks.case import FITTED, HEIGHT_M, LOOP, PAYLOAD_KG, make_fit_log, make_loop, make_replay, solve_loop
from benchmarks.hoist import hanging, load_hoist, rates, reference_replay, speed_error
from benchmarks.measure import ACCURACY, FIT_ACCURACY, RESULTS
from benchmarks.peers.python_rhs import make_rates

KEYS = {
    "name": str,
    "ours_s": float,
    "peer": str,
    "peer_s": float,
    "ratio": float,
    "error_ours": float,
    "error_peer": float,
}
NAMES = {"replay", "models", "closed_loop", "batch", "fit"}
PEERS = {"multibody", "scipy-bdf", "scipy-lsoda", "cvode", "python-control", "casadi"}


@pytest.fixture(scope="module")
def loop():
    case = make_loop()
    return case, *solve_loop(case)


@pytest.fixture(scope="module")
def log(loop):
    return make_replay(load_hoist(PAYLOAD_KG), loop[2])


def test_replay_meets_the_independent_reference_within_a_millionth(log):
    assert speed_error(ours.replay(ours.read(log)), log.speed_rad_s) <= ACCURACY


def test_closed_loop_meets_the_independent_reference_within_a_millionth(loop):
    case, speed, _ = loop
    result = ours.closed_loops(ours.loop_cases([case]), 1)[0]
    assert speed_error(ours.speed_of(result), speed) <= ACCURACY


def test_saturated_loop_meets_the_independent_reference(loop):
    """Ramps ten times as steep drive the torque into its limit, where the anti-windup acts."""
    case = make_loop(9000.0, LOOP, ramp=0.1)
    speed, torque = solve_loop(case)
    assert np.max(np.abs(torque)) == LOOP.limit_nm
    result = ours.closed_loops(ours.loop_cases([case]), 1)[0]
    assert speed_error(ours.speed_of(result), speed) <= 1e-5


def test_halving_the_references_step_changes_nothing_that_counts(log):
    short = slice(0, 400)  # standing, the ramp up, and the swing after it
    fine = reference_replay(log.hoist, log.start, log.torque_nm[short], 0.01, 2.5e-6)[:, 1]
    assert speed_error(fine, log.speed_rad_s[short]) < 1e-3 * ACCURACY


def test_fit_finds_the_friction_that_the_log_was_made_with():
    fitted = ours.friction_fit(ours.read(make_fit_log()))
    assert fitted.values() == pytest.approx(FITTED, rel=FIT_ACCURACY)


@pytest.mark.parametrize("payload_kg", [0.0, 4500.0, 9000.0])
def test_hanging_still_is_an_equilibrium(payload_kg):
    p = load_hoist(payload_kg)
    state, hold = hanging(p, HEIGHT_M)
    assert np.max(np.abs(rates(p, *state, hold))) < 1e-9


def test_the_peers_right_hand_side_is_the_references():
    """In every regime: up and down, slack and taut, pins sticking and slipping."""
    p = load_hoist(PAYLOAD_KG)
    (th, _, th_s, _, x, _), hold = hanging(p, HEIGHT_M)
    flat = make_rates(p)
    for w, w_s, v, sag in itertools.product((-140.0, 0.1, 90.0), (-2.0, 0.004), (-0.7, 0.0, 0.3), (-0.5, 0.0, 0.2)):
        y = (th, w, th_s, w_s, x - sag, v)
        assert flat(list(y), hold + 50.0) == pytest.approx(rates(p, *y, hold + 50.0), rel=1e-12, abs=1e-9)


def test_results_json_has_the_agreed_form_and_every_comparison():
    if not RESULTS.is_file():
        pytest.skip("allowed: no benchmarks/results.json; make bench writes it")
    rows = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert {row["name"] for row in rows} == NAMES
    assert {row["peer"] for row in rows} == PEERS
    for row in rows:
        assert {key: type(value) for key, value in row.items()} == KEYS
        assert row["ratio"] == pytest.approx(row["peer_s"] / row["ours_s"])
