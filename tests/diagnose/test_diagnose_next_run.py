"""The next run: closed forms of the separation, the choice, and what decides between alike effects."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from tests.support.searched_campaign import simulated_search
from workbench.core.numbers import figures
from workbench.core.run import Run
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import price, weigh
from workbench.diagnose.hypotheses.fit import Fitted, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import TENSION_GAIN, Scalar, base_parameters, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.isolability import angle_between, isolability, separations, smallest_amount
from workbench.diagnose.isolability import best_signatures as signatures
from workbench.diagnose.isolation import next_run as advising
from workbench.diagnose.isolation import planned as planning
from workbench.diagnose.isolation.lines import LEAST, Line, OnMenu, ahead_of, on_campaign, on_menu, rough_of
from workbench.diagnose.isolation.next_run import (
    APART,
    CLOSER,
    SURE,
    Compared,
    Odds,
    Offer,
    Question,
    _closer,
    _longer,
    choose,
    compared,
    distances,
    next_run,
)
from workbench.diagnose.isolation.planned import (
    FASTER,
    LEAD_PERIODS,
    Design,
    Planned,
    drawn,
    from_moves,
    menu,
    planned_as,
    repeated,
    seen_in,
)
from workbench.machines import kind_of, save_machine
from workbench.references import Limits
from workbench.study.load import load_study
from workbench.view.diagnosis import write_next_run

TRIED = (
    "torque_offset", "carriage_mass_error", "friction_viscous", "friction_viscous_asymmetric",
    "friction_position_dependent", "payload_mass_error",
)  # fmt: skip
ROWS = 200


@pytest.fixture(scope="module")
def heavier(tmp_path_factory: pytest.TempPathFactory) -> SearchResult:
    """A carriage 500 kg heavier than stated: in motor signals alone, much like an offset of the torque."""
    truth = {"carriage_mass_error": {"mass_kg": 500.0}}
    return simulated_search(tmp_path_factory.mktemp("next") / "heavier", truth, TRIED)[1]


def line(level: float, slope: float, own: bool = False) -> Line:
    """Residuals of a level, and one base parameter that shifts them all."""
    extra = np.ones((ROWS, 1)) if own else np.zeros((ROWS, 0))
    return Line(
        np.full(ROWS, level), np.full((ROWS, 1), slope), extra, np.zeros(extra.shape[1]), np.zeros(ROWS, dtype=int),
        0.5, LEAST,
    )  # fmt: skip


def separation(true: Fitted, rival: Fitted, data: Sequence[Compared], closer: str = "") -> float:
    return distances(true, rival, data, closer)[0]


def both(mine: Line, its: Line) -> Compared:
    return compared([mine, its])[0]


def fitted(z: float = 0.0) -> Fitted:
    parameter = Scalar("x", 0.0, 1.0, std=1.0)
    return Fitted(("e",), (parameter,), np.array([z]), np.zeros(ROWS), np.zeros((ROWS, 1)), 0.0, z * z, 1, True)


def test_predictions_that_no_base_parameter_brings_together_are_apart_by_their_distance():
    expected = math.sqrt(0.5 * ROWS * (1.0 - LEAST**2))
    assert separation(fitted(), fitted(), [both(line(0.0, 0.0), line(1.0, 0.0))]) == pytest.approx(expected)


def test_predictions_that_a_base_parameter_brings_together_are_apart_by_its_tolerances():
    # A slope so steep that the data pin it: the rival has to move by 2.5 tolerances.
    assert separation(fitted(), fitted(), [both(line(0.0, 1e3), line(2.5e3, 1e3))]) == pytest.approx(2.5, rel=1e-3)


def test_a_run_that_sees_the_parameter_otherwise_sets_apart_what_the_campaign_did_not():
    """On the campaign the base parameter hides the difference; on the new run it cannot."""
    campaign = both(line(0.0, 1e3), line(1e3, 1e3))
    new = both(line(0.0, -1e3), line(1e3, -1e3))
    now = separation(fitted(), fitted(), [campaign])
    assert now == pytest.approx(1.0, rel=1e-3)
    assert separation(fitted(), fitted(), [campaign, new]) > 100.0 * now


@pytest.mark.parametrize(
    ("simpler", "freer", "open_for_ever"),
    [
        ("friction_viscous", "friction_viscous_asymmetric", False),
        ("friction_viscous", "friction_stribeck", True),
    ],
)
def test_whether_a_freer_law_is_needed_is_asked_of_what_it_has_more(simpler: str, freer: str, open_for_ever: bool):
    """One slope both ways is predicted by a slope each way, on any run: the question was open for ever."""
    fits = [replace(fitted(), effects=(name,)) for name in (simpler, freer)]
    problem = SimpleNamespace(active=SimpleNamespace(kind="hoist"))
    lines = [line(0.0, 0.0), line(1.0, 0.0, own=True)]
    apart, _ = advising._apart(problem, fits, compared(lines))  # type: ignore[arg-type]
    assert apart < 0.1 if open_for_ever else apart == pytest.approx(separation(fits[1], fits[0], compared(lines)[1:]))
    assert open_for_ever or apart > APART


def test_what_is_kept_of_each_run_gives_the_least_squares_of_all_their_rows():
    """Two channels, a value of the run's own, tolerances: against all rows stacked."""
    rng = np.random.default_rng(2)
    channel = np.repeat([0, 1], (150, 50))
    mine, its = (Line(rng.normal(size=200), rng.normal(size=(200, 1)), rng.normal(size=(200, 1)), np.ones(1), channel,
                      0.7, LEAST) for _ in range(2))  # fmt: skip
    rows = np.hstack([its.jacobian, its.own, (mine.residual - its.residual)[:, None]]) * math.sqrt(0.7)
    stacked = np.vstack([[1.0, 0.0, -0.4], rows, [0.0, 1.0, 0.0]])
    step = np.linalg.lstsq(stacked[:, :2], stacked[:, 2], rcond=None)[0]
    left = (stacked[:, :2] @ step - stacked[:, 2]) ** 2
    expected = left[0] - 0.09 + sum(np.sum(left[1:-1][channel == c] - 0.7 * LEAST**2) for c in (0, 1))
    assert separation(fitted(0.3), fitted(0.4), [both(mine, its)]) == pytest.approx(math.sqrt(expected), rel=1e-9)


def offer(apart: float, seconds: float, *signals: str) -> Offer:
    run = Run("r", np.array([0.0, seconds]), {})
    planned = Planned(run, 0.0, "slow", (), Limits(1.0, 1.0, 1.0), 0.0)
    return Offer(planned, signals, apart, apart, chance=min(0.14 * apart, 1.0), short=1.0 / apart)


def test_the_shortest_run_that_decides_is_chosen_before_one_that_sets_more_apart():
    offers = [offer(9.0, 60.0), offer(7.0, 20.0), offer(2.0, 10.0), offer(30.0, 10.0, "tension_dead_line_n")]
    assert choose(offers) is offers[1]


def test_the_menu_stays_within_what_the_logs_show(heavier: SearchResult):
    problem = heavier.problem
    seen = seen_in(problem)
    assert seen.speed == pytest.approx(0.5, rel=0.05)
    assert seen.high - seen.low == pytest.approx(2.0, rel=0.1)
    for planned in [planned for planned in menu(problem) if not planned.faster]:
        speed = planned.run["speed_motor_rad_s"] * problem.machine.lift_m_per_rad
        way = planned.run.start_position_m + np.cumsum(speed) * planned.run.sample_time_s
        assert np.max(np.abs(speed)) <= 1.001 * seen.speed
        assert seen.low - 0.05 < np.min(way) and np.max(way) < seen.high + 0.05
        assert np.min(speed) < 0.0 < np.max(speed)
        assert abs(way[-1] - way[0]) < 0.05
    assert {planned.payload_kg for planned in menu(problem)} == {0.0, 4500.0, 9000.0}


def test_every_planned_run_rests_where_it_turns(heavier: SearchResult):
    """Where friction turns over without a rest no law of it is exact: with such a run a gearbox' loss was unknown, and
    friction over load, at 15 times the noise at each reversal."""
    problem, rng = heavier.problem, np.random.default_rng(1)
    seen = seen_in(problem)
    designs = [planned_as(problem, seen, one, 90.0, seen.speed) for one in drawn(problem, 30, rng)]
    often = [repeated(problem, one, 2) for one in menu(problem)[:3]]
    for planned in [*menu(problem), *often, *(one for one in designs if one is not None)]:
        t, speed = planned.run.time_s, planned.run["speed_motor_rad_s"]
        on = np.flatnonzero(np.abs(speed) > 0.01 * np.max(np.abs(speed)))
        turns = np.sign(speed[on[1:]]) != np.sign(speed[on[:-1]])
        assert np.all(np.diff(t[on])[turns] > 0.95 * LEAD_PERIODS / problem.band_hz)


def test_a_machine_of_which_the_logs_show_little_speed_may_be_driven_as_fast_as_it_is_built_for(
    heavier: SearchResult, monkeypatch: pytest.MonkeyPatch
):
    """Viscous friction and a quadratic one were alike in slow runs, and no run was on the menu that shows which."""
    problem, seen = heavier.problem, seen_in(heavier.problem)
    assert seen.speed > 0.5 * seen.nominal and not any(one.faster for one in menu(problem))
    monkeypatch.setattr(planning, "seen_in", lambda problem: replace(seen, speed=0.3 * seen.nominal))
    faster = [planned for planned in menu(problem) if planned.faster]
    speeds = [float(np.max(np.abs(one.run["speed_motor_rad_s"]))) for one in faster]
    assert faster and max(speeds) <= 1.001 * problem.machine.motor.nominal_speed_rad_s
    assert min(speeds) > 1.2 * 0.3 * problem.machine.motor.nominal_speed_rad_s
    slow, quick = (Design(0.0, 0.05, ((0.95, share, 0.0),)) for share in (0.3, 0.6))
    for design, is_faster in ((slow, False), (quick, True)):
        planned = planned_as(problem, replace(seen, speed=0.3 * seen.nominal), design, 60.0, seen.nominal)
        assert planned is not None and (FASTER in planned.words) is is_faster


def test_a_run_faster_than_any_before_is_asked_for_where_no_other_one_decides():
    slow, quick = offer(7.0, 60.0), offer(9.0, 20.0)
    quick = replace(quick, planned=replace(quick.planned, faster=True))
    assert choose([slow, quick]) is slow
    assert choose([offer(2.0, 60.0), quick, offer(9.0, 10.0, "tension_dead_line_n")]) is quick


def test_the_dead_lines_tension_decides_between_an_offset_and_a_mass(heavier: SearchResult):
    advice = next_run(heavier.problem, heavier, [("torque_offset",), ("carriage_mass_error",)])
    assert advice is not None
    assert advice.signals == ("tension_dead_line_n",)
    assert advice.now < 1.0 < 4.0 < advice.separation and advice.decides >= SURE
    assert "torque_offset" in advice.why and "carriage_mass_error" in advice.why
    assert f"by {advice.separation:.1f} standard deviations" in advice.why
    assert advice.planned is not None


def test_the_tension_of_the_one_run_that_was_asked_for_decides(heavier: SearchResult):
    """It counted only where all runs had it: who followed the advice had the same answer as before."""
    problem, (first, *others) = heavier.problem, heavier.problem.runs
    fits = [heavier.fits[name,] for name in ("carriage_mass_error", "torque_offset")]
    dead_line = kind_of(problem.machine).dead_line
    assert dead_line is not None

    def with_tension(newtons: np.ndarray) -> Run:
        return replace(first, signals={**first.signals, dead_line.signal: newtons})

    rest = np.full(len(first.time_s), dead_line.at_rest(problem.machine, first.payload_kg))
    alone = Problem(problem.machine, [with_tension(rest)], problem.band_hz)
    (table,) = tables = alone.tables([fits[0].setting])
    states = alone.bench.required(tables)[0][:, 1:, 0]
    pulled = with_tension(alone._tension(first.time_s, states, alone._parameters(table, 0)))
    mixed = Problem(problem.machine, [pulled, *others], problem.band_hz)
    cell = base_parameters(mixed.machine, mixed.runs)[TENSION_GAIN]
    again = [fit_hypothesis(mixed, fit.effects, [cell, *fit.free], np.append(0.0, fit.z)) for fit in fits]
    before, after = (offset.objective - mass.objective for mass, offset in (fits, again))
    assert abs(before) < 5.0 and after > settings.DECISIVE


def test_a_designed_motion_is_no_longer_than_the_plain_one_and_sets_more_apart(heavier: SearchResult):
    advice = next_run(heavier.problem, heavier, [("torque_offset",), ("friction_viscous",)])
    assert advice is not None and advice.planned is not None
    seen, run = seen_in(heavier.problem), advice.planned.run
    assert advice.separation >= advice.menu
    speed = run["speed_motor_rad_s"] * heavier.problem.machine.lift_m_per_rad
    place = advice.planned.start_position + np.cumsum(speed) * run.sample_time_s
    assert np.max(np.abs(speed)) <= 1.001 * seen.speed
    assert seen.low - 0.06 < np.min(place) and np.max(place) < seen.high + 0.06
    kept = json.loads(json.dumps(advice.record))  # as an answer of the blind test keeps it, to simulate it later
    assert kept["separation"] == advice.separation and kept["now"] == advice.now
    played = from_moves(heavier.problem, *(kept[key] for key in ("payload_kg", "start_position", "speed", "moves")))
    assert np.allclose(played.run["speed_motor_rad_s"], run["speed_motor_rad_s"])


def test_rivals_share_base_signatures_in_the_choice_and_have_their_own_in_what_is_stated(heavier: SearchResult):
    """Of a menu both give nearly the same; the stated separation is that of each hypothesis' own, both ways."""
    problem, runs = heavier.problem, [one.run for one in menu(heavier.problem)[:3]]
    fits = [heavier.fits[names] for names in (("torque_offset",), ("friction_viscous",))]
    known = compared([on_campaign(problem, fit) for fit in fits])

    def apart(lines: Sequence[OnMenu], run: int, signals: tuple[str, ...]) -> float:
        data = compared([of_run(run, signals) for of_run in lines])
        return min(separation(fits[true], fits[1 - true], [known[true], data[true]]) for true in (0, 1))

    def own(runs: Sequence[Run]) -> list[OnMenu]:
        return [on_menu(problem, ahead_of(problem, runs, fits[0]), fit, rough) for fit in fits]

    rough = rough_of(problem, fits[0])
    once, each = ahead_of(problem, runs, fits[0]), own(runs)
    shared = [on_menu(problem, once, fit, rough) for fit in fits]
    for run, signals in product(range(3), ((), ("tension_dead_line_n",))):
        assert apart(shared, run, signals) == pytest.approx(apart(each, run, signals), rel=0.05)
    advice = next_run(problem, heavier, [fit.effects for fit in fits])
    assert advice is not None and advice.planned is not None
    assert advice.separation == pytest.approx(apart(own([advice.planned.run]), 0, advice.signals), rel=1e-9)


@pytest.mark.parametrize("base", [True, False])
def test_a_value_at_its_upper_bound_bends_a_planned_run_as_one_beside_it_does(heavier: SearchResult, base: bool):
    """Differenced over the bound it changed nothing, and what it foretells was a rival's to hold against it."""
    problem, fit = heavier.problem, heavier.fits["torque_offset",]
    rough, runs = rough_of(problem, fit), [menu(heavier.problem)[0].run]
    scalars = [one for one in fit.free if isinstance(one, Scalar) and math.isfinite(one.std) == base]
    there = next(one for one in scalars if one.symbol not in rough and not one.logarithmic)
    k = next(n for n, one in enumerate(fit.free) if one is there)
    column = sum(one.size for one in fit.free[:k])
    bounded = (*fit.free[:k], replace(there, most=float(np.mean(fit.setting[there.symbol]))), *fit.free[k + 1 :])
    shared, own = (ahead_of(problem, runs, fit) for _ in range(2))
    held, kept, free = (
        on_menu(problem, ahead, one, rough)(0, ()).jacobian[:, column]
        for ahead, one in ((shared, replace(fit, free=bounded)), (shared, fit), (own, fit))
    )
    assert np.linalg.norm(free) > 0.0
    assert held == pytest.approx(free, abs=0.02 * np.max(np.abs(free)))
    assert kept == pytest.approx(free, abs=0.02 * np.max(np.abs(free)))


def test_what_differs_near_standstill_alone_is_promised_with_the_largest_model_error_there(heavier: SearchResult):
    """An offset and unequal friction levels of an axis are one at speed: eighteen slow legs were to set them apart by
    229 of chi^2 with a probability of 0.98, and on the true machine, of another law of friction, did by 0.5."""
    problem, fit = heavier.problem, heavier.fits["torque_offset",]
    ahead = ahead_of(problem, [menu(problem)[0].run], fit)
    usual = ahead.errors.sized(problem.errors.sizes)
    slow = usual.sized((1.0, 1.0)).at_speed < settings.HALF
    shown = [
        [float(np.sum(errors.whiten(problem.noise * rows.astype(float)) ** 2)) for errors in (usual, ahead.errors)]
        for rows in (slow, ~slow)
    ]
    (there, left), (at_speed, stays) = shown
    assert left < settings.HALF * there and stays > settings.HALF * at_speed


def odds(
    z: Sequence[float], curved: Sequence[float], lead: float = 0.0, least: float = -math.inf,
    names: Sequence[str] = ("torque_offset", "carriage_mass_error"), std: float = math.inf,
) -> Odds:  # fmt: skip
    """Two hypotheses of one value each, the first one `lead` ahead, and none. least: bound of the second's value. std:
    tolerance of each value."""
    bounds, named = (-math.inf, least, -math.inf), [*((name,) for name in names), ()]
    fits = [
        replace(fitted(at), effects=effects, free=(Scalar("x", 0.0, 1.0, low, std=std),))
        for at, effects, low in zip([*z, 0.0], named, bounds, strict=True)
    ]
    evidence = np.array([200.0 + lead, 200.0, 5.0])
    known = [np.array([[one]]) for one in (*curved, 1.0)]
    return Odds(fits, evidence, np.zeros(3), np.zeros(3), ROWS, known, [np.zeros(1)] * 3, 2, "hoist", 0.0, [False] * 3)


def of_run(slope: Sequence[float], level: Sequence[float]) -> list[Line]:
    """What 50 whitened samples show of each: no effect predicts 100 everywhere."""
    wave = np.resize([1.0, -1.0], 50)
    whites = [np.column_stack([a * wave, b * wave]) for a, b in zip((*slope, 0.0), (*level, 100.0), strict=True)]
    return [replace(line(0.0, 0.0), white=white) for white in whites]


@pytest.mark.parametrize(("apart", "lead"), [(2.0, 0.0), (3.5, 0.0), (4.5, 6.0), (3.0, -4.0), (0.1, 3.0)])
def test_the_chance_to_decide_is_that_of_drawn_likelihoods(apart: float, lead: float):
    """Of what the verdict takes for decided, twelve of evidence; a factor of twenty was stated, which is six. The
    campaign's lead makes the first hypothesis likelier, and what it still needs less."""
    rng = np.random.default_rng(3)
    shift = np.full(50, apart / math.sqrt(50))
    data = rng.normal(size=(20000, 50))  # the true hypothesis predicts 0, the other one `shift`
    more = np.sum((data - shift) ** 2 - data**2, axis=1)
    first = rng.uniform(size=20000) < 1.0 / (1.0 + math.exp(-0.5 * lead))
    decided = more + np.where(first, lead, -lead) > settings.DECISIVE
    stated = odds((0.0, 0.0), (1.0, 1.0), lead).chance(of_run((0.0, 0.0), (0.0, apart / math.sqrt(50))))[0]
    assert stated == pytest.approx(np.mean(decided), abs=0.09)  # of 200 machines


def test_what_the_model_may_be_off_decides_nothing():
    """An offset beside a friction of each direction: a slow run of 13 s was to decide with a probability of 0.97, for
    what the friction law may be off would grow with the samples; it left 9.9 of evidence, and both open."""
    asked, run = odds((0.0, 0.0), (1.0, 1.0)), of_run((0.0, 0.0), (0.0, 2.0 / math.sqrt(50)))
    off = replace(asked, lost=np.array([0.0, 50.0, 0.0]))
    assert off.chance(run)[0] <= asked.chance(run)[0] < 0.1


def test_a_value_that_the_campaign_left_open_may_decide_though_both_are_alike_at_the_values_fitted():
    """A carriage's mass error of which a short run said little: a long one was to decide with a probability of 0.00,
    and did in 15 of 18 simulations."""
    run = of_run((3.0, 0.0), (0.0, 0.0))  # the first one's value shows, and the rival has none
    assert odds((0.0, 0.0), (0.1, 1.0)).chance(run)[0] > 0.4
    assert odds((0.0, 0.0), (10.0, 1.0)).chance(run)[0] < 0.05


def test_a_rival_takes_no_negative_amount_to_predict_what_the_true_one_does():
    """A loss of less than nothing passed for less friction."""
    run = of_run((0.0, 3.0), (-1.0, 0.0))
    free, bounded = (odds((0.0, 0.0), (1e3, 1e-3), least=low).chance(run)[0] for low in (-math.inf, 0.0))
    assert free < 0.6 < 0.9 < bounded


LEVELS = ("friction_coulomb", "friction_coulomb_asymmetric")


@pytest.mark.parametrize(
    ("names", "lead", "z", "decides"),
    [
        (("torque_offset", "carriage_mass_error"), 9.5, 0.0, False),
        (LEVELS, 9.5, 0.0, True),  # what a freer law explains does not pay for its parameters
        (LEVELS, 3.0, 0.0, False),
        (("torque_offset", "carriage_mass_error"), 9.5, 4.0, True),  # four tolerances off
    ],
)
def test_a_run_decides_where_the_verdict_would_take_no_rival_for_about_as_good(
    names: Sequence[str], lead: float, z: float, decides: bool
):
    """Twelve of evidence were asked over any rival: the freer law of a true one was open whatever a run showed."""
    asked = odds((0.0, z), (1e6, 1e6), lead, names=names, std=1.0)
    chance, _ = asked.chance(of_run((0.0, 0.0), (0.0, 0.0)))
    assert chance > 0.95 if decides else chance < 0.05


def test_a_freer_law_pays_for_its_freedom_once_however_long_a_run_is(tmp_path: Path):
    """What it had paid grew with the samples of a run: stated were leads of 15 to 28 where the verdict's came to 8 to
    11, and the freer law was open after one of two such runs that were to decide with 0.9."""
    names = ("friction_viscous", "friction_viscous_asymmetric")
    truth = {"friction_viscous": {"viscous_n_s_per_m": 1500.0}}
    search = simulated_search(tmp_path / "viscous", truth, names)[1]
    weighed = {w.names: w.evidence for w in weigh(search.problem, search.base, search.within_tolerances, search.fits)}
    fits = [search.fits[name,] for name in names]
    asked = Odds.of(search, fits, {(): price(search.problem.active.kind)} | weighed)
    simple, freer, _ = asked.lost
    assert freer - simple < 0.5 * settings.THRESHOLD  # of a law's model error, and of nothing else
    as_judged = [weighed[name,] for name in names]
    assert asked._freely(asked.evidence)[:2] == pytest.approx(as_judged, abs=1e-6)
    assert as_judged[0] - as_judged[1] > settings.THRESHOLD


def test_a_run_decides_where_nothing_but_what_a_freer_law_explains_by_chance_is_left_open():
    """The verdict leaves a freer law open where it explains more than one of ten does by chance: no run, however long,
    leaves the simpler one alone more often."""
    known = [odds((0.0, 0.0), (1.0, 1.0), lead, names=LEVELS) for lead in (40.0, -40.0)]
    assert known[0].most == pytest.approx(0.9, abs=1e-6) and known[1].most == pytest.approx(1.0, abs=1e-6)
    near = replace(offer(5.0, 9.0), chance=0.85)
    assert replace(near, most=known[0].most).decides and not near.decides


def test_values_refitted_to_a_run_stay_within_their_bounds_as_bounded_least_squares_has_it():
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(5)
    many = 5
    free = tuple(Scalar(f"x{k}", 0.0, 1.0, -0.1, 0.1 if k % 2 else math.inf) for k in range(many))
    fit = replace(fitted(), free=free, z=np.zeros(many))
    curved, steep, block = rng.normal(size=(many, many)), rng.normal(size=many), rng.normal(size=(20, many + 1))
    none = np.zeros(1)
    asked = Odds([fit], none, none, none, ROWS, [curved], [steep], 1, "hoist", 0.0, [False])
    drawn = 3.0 * rng.normal(size=(30, 20))
    low, high, _ = bounds_of(free)
    shifted = np.linalg.solve(curved.T, steep)  # |curved x + shifted|^2 has the slope `steep`
    for left, data in zip(asked._left(0, block, np.zeros(0), drawn)[0], drawn, strict=True):
        rows, wanted = np.vstack([block[:, :-1], curved]), -np.append(data + block[:, -1], shifted)
        x = lsq_linear(rows, wanted, (low, high), method="bvls").x
        assert left == pytest.approx(np.sum((rows @ x - wanted) ** 2) - shifted @ shifted, rel=1e-6)


def test_a_rival_that_cannot_predict_what_the_answer_does_is_open_no_longer():
    """The rival needs an improbable machine. Were it true all the same, the answer would predict as much on a likelier
    one: so it stayed open, whatever a run had shown."""
    fits, problem = [fitted(), fitted(4.0)], SimpleNamespace(active=SimpleNamespace(kind="hoist"))
    level = math.sqrt(20.0 / (0.5 * ROWS) + LEAST**2)
    held = 1e3 * np.resize([1.0, -1.0], (ROWS, 1))
    lines = [line(0.0, 0.0), replace(line(level, 0.0), jacobian=held)]
    either, answer = (advising._apart(problem, fits, compared(lines, favoured))[0] for favoured in (False, True))  # type: ignore[arg-type]
    assert either == pytest.approx(2.0) and answer == pytest.approx(6.0)
    assert either < APART < answer


def test_a_plain_run_that_does_not_decide_is_driven_as_often_over_as_it_takes(heavier: SearchResult):
    problem, one = heavier.problem, menu(heavier.problem)[1]
    fits = [heavier.fits[name,] for name in ("torque_offset", "friction_viscous")]
    known = compared([on_campaign(problem, fit) for fit in fits])
    question = Question(problem, fits, known, None, advising._apart(problem, fits, known))
    long = 2.5 * one.duration_s
    plain = Offer(one, (), question.now[0] + 1.0, question.now[1] + 1.0)
    asked = SimpleNamespace(
        problem=problem, fits=fits, hypotheses=fits, poor_with=lambda planned: False,
        weighed=lambda one, times=1, draws=0: replace(one, chance=1.0) if times > 1 else one,
        offer=lambda trial, run, planned, signals: Offer(planned, signals, 9.0, 9.0, chance=planned.duration_s > long),
    )  # fmt: skip
    best, usual = _longer(asked, (plain, plain))  # type: ignore[arg-type]
    longer = best.planned
    assert best is usual
    assert [step for step in longer.steps if step.by_m] == 3 * [
        step for step in one.steps if step.by_m
    ] and longer.words == f"{one.words}, 3 times"
    assert repeated(problem, one, 2).duration_s < long < longer.duration_s
    way = np.cumsum(longer.run["speed_motor_rad_s"]) * longer.run.sample_time_s
    assert abs(way[-1]) < 0.01 * np.ptp(way)


def test_a_run_that_is_said_to_decide_leaves_room_for_noise_in_what_is_ignored(heavier: SearchResult):
    """Six deviations beyond what is ignored, of nine: next to half of such runs fall short of five."""
    question = Question(heavier.problem, [], [], None, (0.0, 0.0))
    near, far = (question.weighed(replace(offer(apart, 9.0), whole=9.0)).chance for apart in (5.5, 7.5))
    assert near < 0.7 < SURE < far


def test_the_files_of_the_next_run_are_a_study_and_a_motion_for_a_drive(heavier: SearchResult, tmp_path: Path):
    machine = heavier.problem.machine
    advice = next_run(heavier.problem, heavier, [("torque_offset",), ("carriage_mass_error",)])
    assert advice is not None and advice.planned is not None
    save_machine(machine, tmp_path / "machine.yaml")
    diagnosis = SimpleNamespace(campaign=SimpleNamespace(machine=machine), corrected=machine)
    write_next_run(diagnosis, advice.planned, tmp_path)  # type: ignore[arg-type]
    played = np.genfromtxt(tmp_path / "next_run.csv", delimiter=",", names=True)
    driven = np.gradient(played["position_m"], played["time_s"])
    assert np.max(np.abs(driven - played["speed_m_s"])) < 0.05 * np.max(np.abs(played["speed_m_s"]))
    study = load_study(tmp_path / "next_run.yaml")
    assert study.plans["ruckig"].end_position_m == pytest.approx(played["position_m"][-1], abs=0.05)
    limits = yaml.safe_load((tmp_path / "next_run.yaml").read_text(encoding="utf-8"))["limits"]
    assert all(len(str(value)) < 10 for value in limits.values())


@pytest.mark.parametrize(("first", "decides"), [(0.96, True), (0.5, False)])
def test_a_designed_motion_takes_less_time_where_the_plain_one_decides_and_tells_more_where_it_does_not(
    heavier: SearchResult, first: float, decides: bool, monkeypatch: pytest.MonkeyPatch
):
    """Motions decide as surely as they last 20 s or longer: none was taken that is shorter than the plain one."""
    problem = heavier.problem
    runs = sorted(menu(problem), key=lambda one: one.duration_s)

    def told(planned: Planned, chance: float | None = None) -> Offer:
        sure = chance or min(0.97, planned.duration_s / 20.0)
        return Offer(planned, (), 5.0, 5.0, chance=sure, short=1.0 - sure)

    asked = SimpleNamespace(problem=problem, hypotheses=(), offer=lambda trial, k, run, signals: told(run))
    monkeypatch.setattr(advising, "_ahead", lambda *given: [])
    monkeypatch.setattr(advising, "_stated", lambda question, one: one)
    plain, others = told(runs[-1], first), [told(run) for run in runs]
    designed, beside = advising._designed(asked, plain, others)  # type: ignore[arg-type]
    assert designed is not plain and designed.chance >= (SURE if decides else 1.05 * first)
    assert designed.planned.duration_s < 0.6 * plain.planned.duration_s or not decides
    shortest = runs[0].duration_s
    assert beside.planned.duration_s <= max(designed.planned.duration_s, shortest)


# Angles between signatures, the smallest visible amounts, and what is told apart by neither.


def unit(*angles_deg: float) -> np.ndarray:
    return np.array([[math.cos(math.radians(a)) for a in angles_deg], [math.sin(math.radians(a)) for a in angles_deg]])


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 12.0, 45.0, 60.0, 90.0])
def test_the_angle_of_two_directions_is_the_one_between_them(degrees: float):
    assert angle_between(unit(20.0), unit(20.0 + degrees)) == pytest.approx(degrees, abs=1e-8)


def test_a_direction_within_a_plane_is_at_no_angle_to_it():
    plane = np.eye(3)[:, :2]
    inside = np.array([[0.6], [0.8], [0.0]])
    outside = np.array([[0.6], [0.0], [0.8]])
    assert angle_between(plane, inside) == pytest.approx(0.0, abs=1e-6)
    assert angle_between(inside, plane) == pytest.approx(0.0, abs=1e-6)
    assert angle_between(plane, outside) == pytest.approx(math.degrees(math.asin(0.8)))


@pytest.mark.parametrize(("data", "prior"), [(40.0, 0.0), (1e-3, 5.0), (2.0, 3.0), (300.0, 0.1)])
def test_the_smallest_visible_amount_is_worth_exactly_nothing(data: float, prior: float):
    scale = 400.0
    a = smallest_amount(data, prior, 2, scale)
    assert a * a * (data + prior) == pytest.approx(2.0 * math.log(scale))


def test_an_offset_and_an_error_of_mass_are_alike_and_a_bump_is_like_neither(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    at = {name: k for k, name in enumerate(answer.names)}
    mass = answer.angle[at["torque_offset"], at["carriage_mass_error"]]
    place = answer.angle[at["torque_offset"], at["friction_position_dependent"]]
    assert mass < 0.6 * place
    text = " ".join(answer.sentences)
    assert "torque_offset" in text and "carriage_mass_error" in text
    assert "friction_position_dependent" not in text


def test_a_special_case_is_no_fault_of_the_campaign(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    at = {name: k for k, name in enumerate(answer.names)}
    assert answer.angle[at["friction_viscous"], at["friction_viscous_asymmetric"]] < 1.0
    assert "friction_viscous" not in " ".join(answer.sentences)
    projection = Projection.of(heavier.problem, heavier.within_tolerances)
    scale = heavier.problem.share * heavier.problem.inputs
    best = signatures(projection, heavier.signatures, scale)
    apart = separations(best, projection.priors, scale)
    i, j = (list(best).index(name) for name in ("friction_viscous", "friction_viscous_asymmetric"))
    assert apart[i, j] == math.inf


def test_visible_amounts_are_in_the_first_parameters_unit_and_below_what_was_put_in(heavier: SearchResult):
    answer = isolability(heavier.problem, heavier)
    name, amount = answer.visible["torque_offset"]
    assert name == "offset_nm"
    assert 0.5 < amount < 40.0
    least = 0.02 * heavier.problem.noise  # of some hundred independent samples a tenth of the noise shows
    name, amount = answer.visible["friction_position_dependent"]
    machine = heavier.problem.machine
    assert name == "peak_n"
    assert amount > least / machine.lift_m_per_rad


def test_a_verdict_that_rests_on_less_than_a_model_error_says_so(heavier: SearchResult):
    """It is not claimed that the campaign leaves open what its likelihoods decide, nor that they need no check."""
    rivals = [("torque_offset",), ("carriage_mass_error",)]
    opened, named = (next_run(heavier.problem, heavier, rivals, settled=limit) for limit in (math.inf, APART))
    assert opened is not None and named is not None
    assert opened.separation <= named.separation  # whichever is true, and the first one, which the runs favour
    assert opened.why.startswith("The campaign ")
    assert named.why.startswith("The runs favour torque_offset over carriage_mass_error, but set them apart by only")
    least = LEAST * heavier.problem.noise
    assert f"differences below {figures(least, 2)} N m rms, {LEAST:g} of the noise, count for nothing" in named.why


def test_what_no_run_decides_is_decided_by_the_value_that_stands_in_for_it():
    """The rival has to move the base parameter by one tolerance; known to a tenth of it, that is ten. What lies in the
    data of neither is decided by no value."""
    hidden = [both(line(0.0, 1e3), line(1e3, 1e3))]
    assert separation(fitted(), fitted(), hidden) == pytest.approx(1.0, rel=1e-3)
    assert separation(fitted(), fitted(), hidden, "x") == pytest.approx(10.0, rel=1e-3)
    assert separation(fitted(), fitted(), hidden, "y") == pytest.approx(1.0, rel=1e-3)
    # Of a true value 0.8 tolerances off, and with the rival where it is: nothing is to be moved.
    same = [both(line(0.0, 1e3), line(0.0, 1e3))]
    assert separation(fitted(0.8), fitted(0.8), same, "x") == pytest.approx(0.0, abs=1e-6)


def test_no_load_need_be_weighed_where_no_single_value_stands_in_for_the_difference(heavier: SearchResult):
    """A heavier carriage and an offset of the torque: friction of one direction and three other values hide it."""
    fits = [heavier.fits[name,] for name in ("torque_offset", "carriage_mass_error")]
    known = compared([on_campaign(heavier.problem, fit) for fit in fits])
    assert _closer(heavier.problem, fits, known) == ""


@pytest.mark.parametrize("apart", [0.0, 1.2])
def test_the_run_that_a_closer_value_would_let_decide_is_named(
    heavier: SearchResult, apart: float, monkeypatch: pytest.MonkeyPatch
):
    """Where no run on the menu would, "that run" was none that had been mentioned."""
    fits = [heavier.fits[name,] for name in ("torque_offset", "carriage_mass_error")]
    monkeypatch.setattr(advising, "_apart", lambda *given, closer="": (6.0 if closer else apart, apart))
    best = advising.Offer(menu(heavier.problem)[0], (), apart, apart)
    question = Question(heavier.problem, fits, [], None, (0.0, 0.0))
    said, helps = advising._why(question, best)
    assert helps
    *_, named, need = said.split(". ")
    assert "that run" not in need or best.planned.words in named
    assert best.planned.words in said and need.endswith("would set them apart by 6.0 standard deviations.")
    assert f"known to {CLOSER:g} of it" in need
    far, _ = advising._why(question, replace(best, separation=6.0))  # "a closer tolerance is needed", for as much
    assert far.endswith("No single value of the machine, known more closely, would either.")
    for favoured, words in ((False, "apart from a and from b"), (True, "over a and over b")):
        three = [fits[0], *(replace(fits[1], effects=(name,)) for name in "ab")]
        asked = Question(heavier.problem, three, [], None if favoured else odds((0.0, 0.0), (1.0, 1.0)), (0.0, 0.0))
        assert words in advising._why(asked, best)[0]


def test_no_run_is_planned_where_none_would_set_anything_apart(heavier: SearchResult, monkeypatch: pytest.MonkeyPatch):
    """Beside "no run on the menu would", next_run.csv was offered to be driven."""
    names = [("torque_offset",), ("carriage_mass_error",)]
    fits = [heavier.fits[one] for one in names]
    monkeypatch.setattr(advising, "_apart", lambda *given, closer="": (0.0, 0.0))
    best = advising.Offer(menu(heavier.problem)[0], (), 0.0, 0.0)
    said, helps = advising._why(Question(heavier.problem, fits, [], None, (0.0, 0.0)), best)
    assert not helps and said.endswith(
        "no run on the menu would. No single value of the machine, known more closely, would either."
    )
    monkeypatch.setattr(advising, "_why", lambda question, best: (said, helps))
    advice = next_run(heavier.problem, heavier, names)
    assert advice is not None and advice.planned is advice.plain is None
    assert (advice.why, advice.profile, "moves" in advice.record) == (said, "none", False)


@pytest.mark.parametrize(
    ("chance", "said"),
    [(0.999, "would decide with a probability of over 99 %."), (0.3, "no run on the menu decides. The best, a")],
)
def test_a_run_that_a_law_s_price_lets_decide_is_not_said_to_set_it_apart_by_nothing(
    heavier: SearchResult, chance: float, said: str
):
    """Of a friction level and a freer law of it: "would do so by 0.0 standard deviations, and decide with a
    probability of 83 %", or that no run would, at 61 %."""
    fits = [heavier.fits[name,] for name in ("torque_offset", "carriage_mass_error")]
    best = advising.Offer(menu(heavier.problem)[0], (), 0.0, 0.0, chance=chance)
    why, _ = advising._why(Question(heavier.problem, fits, [], odds((0.0, 0.0), (1.0, 1.0)), (0.0, 0.0)), best)
    assert said in why and "0.0 standard deviations" not in why
