"""The benchmarks' own hoist and the form of what they write; the attack on the readers; the verdict's numbers."""

from __future__ import annotations

import difflib
import itertools
import json
import math
from typing import Any

import numpy as np
import pytest

from benchmarks import ours, sensitivity
from benchmarks.attack.__main__ import attack
from benchmarks.attack.mangle import KINDS, MADE_BY_THE_VICTIM, good, mangled
from benchmarks.attack.victim import read
from benchmarks.case import FITTED, HEIGHT_M, LOOP, PAYLOAD_KG, make_fit_log, make_loop, make_replay, solve_loop
from benchmarks.hoist import hanging, load_hoist, rates, reference_replay, speed_error
from benchmarks.measure import ACCURACY, FIT_ACCURACY, RESULTS
from benchmarks.peers.python_rhs import make_rates
from benchmarks.sensitivity import Number, changed, numbers
from workbench.diagnose.hypotheses import evidence, settings
from workbench.diagnose.verdict import judge

FIGURES = "ours_s", "peer_s", "ratio", "error_ours", "error_peer"
KEYS = {"name": str, "peer": str, **dict.fromkeys(FIGURES, float)}
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


# The attack on the readers: repeatable, counts what breaks, and finds nothing in a small sample.


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_same_bytes_and_another_one_others(kind):
    inputs = [mangled(kind, seed) for seed in range(30)]
    assert inputs == [mangled(kind, seed) for seed in range(30)]
    assert len(set(inputs)) > 25


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in MADE_BY_THE_VICTIM])
def test_what_is_mangled_reads_when_whole(tmp_path, kind):
    # The first scenarios extend another one, as they stand in their folder.
    ended = read(kind, good(kind, 0), tmp_path)
    assert (ended.how, ended.said) == ("read", "")


@pytest.mark.parametrize("seed", [11000141, 12000034])
def test_mat_files_that_crash_scipy_are_refused(tmp_path, seed):
    ended = read("mat", mangled("mat", seed), tmp_path)
    assert ended.how == "refused"
    assert "lift.mat: lift: " in ended.said


@pytest.mark.parametrize("seed", [11000099, 12000131])
def test_of_thousands_of_junk_keys_only_those_that_are_told_are_compared_with_names(tmp_path, seed, monkeypatch):
    compared: list[str] = []
    compare = difflib.get_close_matches

    def counted(word: str, *rest: Any, **how: Any) -> list[str]:
        compared.append(word)
        return compare(word, *rest, **how)

    monkeypatch.setattr(difflib, "get_close_matches", counted)
    ended = read("scenario", mangled("scenario", seed), tmp_path)
    assert ended.how == "refused"
    assert ended.said.endswith("(and 4995 more problems)")
    assert len(compared) == 5


def test_a_small_attack_breaks_nothing():
    results = attack(KINDS, range(100, 104))
    assert len(results) == 4 * len(KINDS)
    assert [(r.kind, r.seed, r.ended) for r in results if r.bad] == []
    assert {result.ended.how for result in results} <= {"read", "noted", "refused"}


# The verdict's numbers: all are listed with their reason, one is changed everywhere, answers are counted.


PAGE = sensitivity.ROOT / "benchmarks" / "verdict_numbers.md"


def the(name: str, place: str = "settings") -> Number:
    (one,) = (number for number in numbers() if number.name == name and number.place.endswith(place))
    return one


def test_every_number_of_the_verdict_has_a_reason_and_a_line_on_the_page():
    listed = numbers()
    assert {"missed_no_gap", "LAW", "HALF", "SIGNIFICANT"} <= {number.name for number in listed}
    assert [number.key for number in listed if not number.reason] == []
    page = PAGE.read_text(encoding="utf-8")
    command = "python -m benchmarks.sensitivity FOLDERS --out ANSWERS --page benchmarks/verdict_numbers.md"
    assert [number.key for number in listed if f"| {number.name} |" not in page] == [], f"make it anew: {command}"


def test_a_changed_number_is_another_one_wherever_the_diagnosis_reads_it_and_comes_back():
    kept = settings.LAW
    with changed(the("LAW"), 0.5):
        assert evidence.settings.LAW == judge.settings.LAW == pytest.approx(0.5 * kept)
    assert evidence.settings.LAW == judge.settings.LAW == kept
    missed = settings.calibration()["missed_unknown"]
    with changed(the("missed_unknown", "json"), 2.0):
        assert settings.calibration()["missed_unknown"] == 2.0 * missed
    assert settings.calibration()["missed_unknown"] == missed


def test_what_is_derived_from_a_changed_number_is_changed_with_it():
    """Evidence of chance is that of the probability of chance, wherever it is asked for."""
    kept = (settings.THRESHOLD, settings.DECISIVE, settings.NUISANCE, settings.SAME)
    with changed(the("SIGNIFICANT"), 0.2):
        assert pytest.approx(-2.0 * math.log(0.01)) == settings.THRESHOLD
        assert judge.settings.DECISIVE == 2.0 * settings.THRESHOLD
        assert pytest.approx(0.02) == settings.SAME
        assert pytest.approx(3.891, abs=1e-3) == settings.NUISANCE
        assert settings.calibration()["unknown_bias"] == pytest.approx(math.log(0.01 / 0.99))
    assert kept == (settings.THRESHOLD, settings.DECISIVE, settings.NUISANCE, settings.SAME)
    assert kept == pytest.approx((5.9915, 11.983, 3.0233, 0.1), rel=1e-4)
