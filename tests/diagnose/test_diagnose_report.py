"""What a diagnosis writes: the fixed keys of diagnosis.json, probabilities that add up, the page's steps."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.made_diagnosis import KINDS, made_diagnosis
from workbench.core.record import LogTraits
from workbench.diagnose import gap
from workbench.diagnose.diagnose import Diagnosis, differing
from workbench.diagnose.gap import delivered_of
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.places import Event, PlaceProbability
from workbench.diagnose.residual_tests import Correlation, ResidualTest
from workbench.diagnose.tables import Curve
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Reason, ReasonKind, Verdict
from workbench.effects.declare import SUBSYSTEMS
from workbench.simulate.driven import InverseSimulation, pooled_rms
from workbench.simulate.replay import replay_runs
from workbench.view import diagnosis
from workbench.view.diagnosis import save_diagnosis_page
from workbench.view.diagnosis_figures import curves, series_of
from workbench.view.diagnosis_json import probabilities, to_json
from workbench.view.film import marked_machine

FIXED = [
    "format", "campaign", "verdict", "effects", "ranking", "alike", "next_run", "where", "parameters",
    "explained", "left", "remainder", "places", "gap", "shrink",
]  # fmt: skip
SHRINK = [
    "before", "after", "noise", "unit", "band_hz", "factor", "ci95",
    "speed_rmse_percent_before", "speed_rmse_percent_after", "model_error",
]  # fmt: skip


def strict_json(data: object) -> Any:
    """Through JSON and back; NaN and infinity are no JSON."""
    return json.loads(json.dumps(data, allow_nan=False))


@pytest.mark.parametrize("kind", KINDS)
def test_the_fixed_keys_come_first_and_in_their_order(kind: str):
    said = strict_json(to_json(made_diagnosis(kind)))
    assert list(said)[: len(FIXED)] == FIXED
    unit = "n" if kind == "axis" else "nm"
    quantity = "force" if kind == "axis" else "torque"
    assert list(said["gap"]) == [f"{quantity}_rms_{unit}", f"noise_rms_{unit}", "band_hz", "speed_rmse_percent"]
    assert list(said["shrink"]) == SHRINK
    assert said["shrink"]["unit"] == ("N" if kind == "axis" else "N m")
    assert said["format"] == 1
    for row in said["ranking"]:
        assert list(row) == ["verdict", "effects", "probability"]
    if said["where"] is not None:
        assert list(said["where"]) == ["subsystem", "regime", "windows", "share"]
        assert all(list(window) == ["run", "from_s", "to_s"] for window in said["where"]["windows"])
    if said["next_run"] is not None:
        assert list(said["next_run"])[:4] == ["why", "payload_kg", "profile", "signals"]


def test_what_is_no_finite_number_is_null():
    d = made_diagnosis("named")
    heave = next(candidate for candidate in to_json(d)["candidates"] if candidate["effects"] == ["heave"])
    assert heave["parameters"]["heave"]["phase_rad"] == {"value": [0.1, 2.2, 1.4], "std_error": [0.2, 0.2, None]}
    endless = dataclasses.replace(d, shrink=dataclasses.replace(d.shrink, factor=math.inf, ci95=(1.0, math.inf)))
    said = strict_json(to_json(endless))["shrink"]
    assert said["factor"] is None
    assert said["ci95"] == [1.0, None]


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=400).filter(lambda p: sum(p) > 1e-6))
def test_rounded_probabilities_add_up_to_one_and_keep_their_order(exact: list[float]) -> None:
    rounded = probabilities(exact)
    assert abs(sum(rounded) - 1.0) < 1e-9
    assert min(rounded) >= 0.0
    for p, r in zip(exact, rounded, strict=True):
        assert abs(r - p / math.fsum(exact)) < 1.001e-5
    order = np.argsort(exact, kind="stable")
    in_order = np.array(rounded)[order]
    strictly = np.diff(np.array(exact)[order]) > 0.0
    assert np.all(np.diff(in_order)[strictly] >= 0.0)


def page_of(d: Diagnosis, folder: Path) -> str:
    save_diagnosis_page(d, folder / "page.html")
    text = (folder / "page.html").read_text(encoding="utf-8")
    return text[text.index("</head>") :]  # the words, without plotly's own text


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_says_the_answer_first_and_then_each_step(kind: str, tmp_path: Path):
    d = made_diagnosis(kind)
    page = page_of(d, tmp_path)
    steps = [
        d.verdict.sentence, "1. Condition of the logs", "2. The gap", "3. Where it lies", "4. Candidates",
        "5. Isolability of the effects", "6. Verdict", "7. Residual on held-out runs",
        "9. What changes in the control study", "10. The next run",
    ]  # fmt: skip
    places = [page.index(step) for step in steps]
    assert places == sorted(places)
    assert diagnosis.probability_sentence(d) in page
    assert ("measured_correction" in page) == (kind == "unknown")
    read = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"\b(nan|inf|None)\b", read)


def test_a_page_of_a_machine_that_holds_no_table_speaks_of_no_correction_nor_of_a_share_that_no_table_takes():
    d = made_diagnosis("unknown")
    assert d.unknown is not None
    in_vain = dataclasses.replace(d.unknown, curves=(dataclasses.replace(d.unknown.curves[0], explains=0.0),))
    told = dataclasses.replace(d, corrected=d.refitted, unknown=in_vain, replays=None)
    corrected, none = ({name: str(section) for name, section in diagnosis.sections_of(x).items()} for x in (d, told))
    for words in ("After: the corrected machine", "before and after its correction"):
        assert words in corrected["shrink"] and words not in none["shrink"]
    assert "Yellow: the gap's windows. After: " in corrected["shrink"] and "the gap's windows.\"" in none["shrink"]
    assert "explains" in corrected["unknown"].partition("Figure(")[2]
    assert "explains" not in none["unknown"].partition("Figure(")[2]


def test_every_lag_of_an_autocorrelation_lies_inside_its_panel():
    two = np.array([0.1, 0.2])
    test = ResidualTest("half", two, two, two, two, 0.5, {})
    (low, high) = diagnosis.draw.autocorrelations([test]).layout.xaxis.range
    assert low == 0.0 and high > 0.2


def test_a_spectrum_of_less_than_a_decade_has_several_frequencies_written_out():
    (profile, *_) = made_diagnosis("named").where.profiles  # type: ignore[union-attr]
    edges = np.array([0.3, 0.8, 2.0])
    nothing = np.full(2, np.nan)
    spectrum = dataclasses.replace(
        profile, edges=edges, share=np.array([0.2, 0.1]), mean_forward=nothing, mean_backward=nothing
    )
    axis = diagnosis.draw.profiles([spectrum], "N m", ("forward", "backward")).layout.xaxis
    inside = [text for at, text in zip(axis.tickvals, axis.ticktext, strict=True) if edges[0] <= at <= edges[-1]]
    assert inside == ["0.5", "1", "2"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_parts_of_the_residual_add_up(kind: str):
    *parts, together = made_diagnosis(kind).table("parts").rows
    rms, share = (sum(float(row[k]) ** n for row in parts) for k, n in ((1, 2), (2, 1)))
    assert math.sqrt(rms) == pytest.approx(float(together[1]), rel=0.01)
    assert share == pytest.approx(float(together[2]), abs=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_a_runs_share_of_the_gaps_energy_is_one_number_wherever_it_is_said(kind: str):
    """By hand from what a replay gives: before² − noise², times the time in motion."""
    d = made_diagnosis(kind)
    energy = {
        run.name: max(told.before**2 - told.noise**2, 0.0) * np.count_nonzero(run.balance.moving)
        for run, told in zip(d.replayed()[0].runs, d.delivered.runs, strict=True)
    }
    shares = {name: f"{100.0 * one / sum(energy.values()):.0f}" for name, one in energy.items()}
    heads = [column.head.replace("\n", " ") for column in d.table("runs").columns]
    assert ("of the gap's energy" in heads) == (d.where is not None)  # of a gap that is none there is no share
    if d.where is not None:
        assert {row[0]: row[1] for row in d.table("runs").rows} == shares
        assert {row[0]: row[1] for row in diagnosis.where_table(d).rows} == shares
        assert {run.name: run.said.partition(" ")[0] for run in series_of(d)} == shares
        said = to_json(d)["where_details"]["energy_by_run"]
        assert {name: f"{100.0 * share:.0f}" for name, share in said.items()} == shares


def test_the_probabilities_of_the_candidates_add_up_to_no_more_than_one():
    """Two names of one hypothesis share one probability; a reader who adds up the column finds it once."""
    d = made_diagnosis("named")
    twins = [("heave",), ("brake_drag",)]
    ranking = (
        Hypothesis("named", ("friction_viscous",), 0.5),
        Hypothesis("named", twins[0], 0.4, (twins[1],)),
        Hypothesis("no_gap", (), 0.1),
    )
    rows = tuple(dataclasses.replace(d.candidates[0], effects=names) for names in (("friction_viscous",), *twins))
    told = dataclasses.replace(d, candidates=rows, verdict=dataclasses.replace(d.verdict, ranking=ranking))
    assert [row[1] for row in diagnosis.candidates_table(told).rows] == ["50 %", "40 %", "(same)"]
    none = dataclasses.replace(d, candidates=(dataclasses.replace(d.candidates[0], merit=-0.3),))
    assert diagnosis.candidates_table(none).rows[0][5] == "0"  # no signed zero


def test_what_is_said_of_an_unknown_cause_holds_where_an_unlisted_effect_is_it_and_on_either_ground():
    """Which may have been weighed and explain it; and on a dark ground the law is a white line."""
    (plain, _), below = diagnosis.plain_summary(made_diagnosis("unknown")), diagnosis.said.curves(True)
    assert "none of the listed causes explains it" in plain
    assert "Without points: the law" in below and "Black" not in below


def test_a_law_is_drawn_at_the_level_of_the_points_that_it_goes_through():
    """A fan's law stood 8 N m above its points: base parameters had taken that level up."""
    at, std = np.linspace(1.0, 5.0, 5), np.full(5, 0.1)
    levels = np.concatenate([at**2 + 8.0, at**2 - 3.0])
    curve = Curve("speed", "motor", at, at**2, at**2, std, std, 0.9)
    drawn = curves([curve], ("forward", "backward"), {}, ["N m"], levels)
    laws = [trace for trace in drawn.data if (trace.name or "").startswith("law, ")]
    assert [np.allclose(trace.y, at**2) for trace in laws] == [True, True]


def test_a_place_of_a_named_cause_is_no_share_of_what_the_refit_leaves():
    """Its windows hold a share of the residual with the effect taken out of the fit; where tolerances alone tell of a
    cause, that was 52 % "of the gap's energy" beside "explains 0 %"."""
    said = {kind: diagnosis.where_sentence(made_diagnosis(kind)) for kind in ("named", "pair", "unknown")}
    assert "% of what the runs leave without it, all else equal (90 %" in said["named"]
    assert "% of what the runs leave without them, all else equal (90 %" in said["pair"]
    assert "% of the gap's energy (90 %" in said["unknown"]


def test_a_place_that_is_one_of_several_is_not_said_to_be_the_place():
    """A blow was said to lie at the payload, at 29 %, as likely as at the platform; and not when."""
    d = made_diagnosis("unknown")
    assert d.where is not None
    places = tuple(
        PlaceProbability(*one) for one in [("payload", 0.35), ("motor", 0.33), ("drum", 0.3), ("guide", 0.02)]
    )
    event = Event("half", 5.16, 5.64, "payload", 0.96, 240.0)
    struck = dataclasses.replace(d.where, subsystem="payload", regime="event", places=places, events=(event,))
    said = diagnosis.where_sentence(dataclasses.replace(d, where=struck))
    assert said.startswith(
        "The gap lies most likely at the payload (35 %), the motor (33 %) or the drum (30 %), at single events, "
        "in half from 5.2 to 5.6 s: in windows"
    )
    alone = dataclasses.replace(struck, places=(PlaceProbability("payload", 1.0),), events=())
    assert "The gap lies at the payload, at single events: in" in diagnosis.where_sentence(
        dataclasses.replace(d, where=alone)
    )


@pytest.mark.parametrize("times", [1.2, 2.2])
def test_white_or_not_what_is_larger_than_the_noise_is_said_to_be(times: float):
    d = made_diagnosis("named")
    lag, bound = np.array([0.1]), np.array([0.3])
    white = ResidualTest("half", lag, 0.0 * lag, bound, bound, 0.9, {})
    left = dataclasses.replace(d.delivered, residual_rms=times * d.gap.noise_rms)
    said = diagnosis.left_sentence(dataclasses.replace(d, residual_tests=(white,), delivered=left))
    assert said.startswith("In 1 of 1 runs the residual is indistinguishable from white noise")
    assert ("it is 2.2 times the noise" in said) == (times > 1.5)


@pytest.mark.parametrize("probability", [0.45, 0.5, 0.7])
@pytest.mark.parametrize("word", ["named", "no_gap"])
def test_an_answer_at_one_half_or_less_is_not_said_to_need_no_further_run(word: str, probability: float):
    d = made_diagnosis("named" if word == "named" else "no_gap")
    first = dataclasses.replace(d.verdict.ranking[0], probability=probability)
    told = dataclasses.replace(d, verdict=dataclasses.replace(d.verdict, ranking=(first,)), next_run=None)
    said = diagnosis.next_run_sentence(told)
    assert ("needs no further run" in said) == (probability > 0.5)
    assert ("leave the cause open" in said) == (probability <= 0.5 and word == "named")
    assert ("leave open whether anything is missing" in said) == (probability <= 0.5 and word == "no_gap")


def test_what_may_change_a_conclusion_is_not_said_to_need_no_further_run():
    """A real pendulum leaves 10 % of its input that no effect is named for."""
    d = made_diagnosis("no_gap")
    left = dataclasses.replace(d.verdict.left, relevant=True)
    told = dataclasses.replace(d, verdict=dataclasses.replace(d.verdict, left=left), next_run=None)
    assert "leave enough to change a conclusion" in diagnosis.next_run_sentence(told)


def test_what_a_strange_run_holds_of_the_rest_is_a_share_of_it():
    """A run that leaves less than its noise takes nothing off the others'; and a longer run holds more."""
    refitted, corrected = made_diagnosis("named").replayed()
    after = np.array([run.residual_rms_moving for run in corrected.runs])
    told = delivered_of(after * [1.5, 0.5, 0.5], refitted, corrected, np.array([1.0, 1.0, 1e-6]))
    assert sum(run.stays for run in told.runs) == pytest.approx(1.0) and told.runs[0].stays == 0.0
    (said,) = differing(told)
    assert f"full holds {100.0 * told.runs[2].stays:.0f} % of what stays" in said and "below 0.0001" in said


def test_a_correlation_of_nothing_has_no_sign():
    d = made_diagnosis("named")
    found = {"speed": Correlation(-0.001, 0.1, 0.2), "input": Correlation(0.3, 0.1, 0.2)}
    lag, bound = np.array([0.1]), np.array([0.3])
    test = ResidualTest("half", lag, lag, bound, bound, 0.5, found)
    assert diagnosis.left_table(dataclasses.replace(d, residual_tests=(test,))).rows[0][3:] == ["0.00", "+0.30 *"]


@pytest.mark.parametrize("kind", ReasonKind)
def test_each_reason_names_the_hypothesis_that_it_is_about(kind: ReasonKind):
    reason = Reason(kind, ("heave", "brake_drag"), value=134.2, percent=0.8, over="speed of the carriage")
    text = diagnosis.said.reason(reason, "N m")
    assert ("heave and brake_drag" in text) == (kind is not ReasonKind.LOG_KEEPS)
    assert ("134 N m" in text) == (kind is ReasonKind.LEAVES_MUCH)
    assert ("speed of the carriage" in text) == (kind in (ReasonKind.FREE_LAW, ReasonKind.VARIES, ReasonKind.BARRED))
    # A listed effect that is not established may have more evidence than the unlisted one, and the other way round.
    assert ("explains more than any listed one that is established" in text) == (
        kind is ReasonKind.UNLISTED_EXPLAINS_MORE
    )
    assert "most evidence" not in text or "most evidence of what is listed" in text


def test_a_run_that_rests_has_dashes_in_the_table_and_no_share():
    d = made_diagnosis("named")
    moving, rests = d.campaign.runs[1], d.campaign.runs[0]
    still = dataclasses.replace(rests, signals={name: np.zeros(len(rests.time_s)) for name in rests.signals})
    refitted, corrected = (replay_runs(machine, [still, moving]) for machine in (d.refitted, d.corrected))
    told = dataclasses.replace(d, delivered=delivered_of(np.full(2, 0.5), refitted, corrected))
    rest, moves = diagnosis.runs_table(told).rows
    assert rest == [rests.name, *4 * ["–"]] and moves[:2] == [moving.name, "100"]
    # The other table's speed error is replay's, of all runs.
    assert diagnosis.brief_shrink_table(told).rows[1][0] == "speed error of runs that move, open loop, %"
    assert diagnosis.brief_shrink_table(d).rows[1][0] == "speed error, open loop, %"


def test_the_held_out_speed_error_is_in_per_cent_of_one_scale_for_slow_and_fast_runs():
    """As `replay` has it: of the largest speed of all runs. Of its own speed a slow run would be off by more."""
    d = made_diagnosis("axis")
    problem, machine = Problem(d.campaign.machine, d.campaign.runs), d.campaign.machine
    top = [float(np.max(np.abs(run["velocity_m_s"]))) for run in d.campaign.runs]
    assert max(top) > 2.0 * min(top)
    expected = replay_runs(machine, d.campaign.runs, problem.band_hz).speed_rmse_percent
    assert gap._speed(problem, [machine, machine]) == pytest.approx(expected, rel=1e-3)


def test_series_hold_the_balance_before_and_after():
    d = made_diagnosis("named")
    runs = series_of(d)
    assert [run.name for run in runs] == [run.name for run in d.campaign.runs]
    left = pooled_rms([(run.measured - run.before)[run.moving] for run in runs])
    assert left == pytest.approx(d.shrink.before, rel=1e-9)
    after = [(run.measured - run.after)[run.moving] for run in runs if run.after is not None]
    assert pooled_rms(after) == pytest.approx(d.shrink.after, rel=1e-9)
    assert all(run.windows and run.said.endswith("of the gap's energy") for run in runs)
    errors = [np.sqrt(np.mean((run.speed_before - run.speed) ** 2)) for run in runs]
    assert pooled_rms([np.array(errors)]) == pytest.approx(d.gap.speed_rmse_percent, rel=1e-6)


def test_a_phase_of_each_run_is_in_that_runs_prediction():
    """`log` of machine.yaml holds each run's phase, and predicts it with its own."""
    d, phases = made_diagnosis("named"), (0.3, 2.0, 4.5)
    wave = {"amplitude_m": 0.15, "frequency_rad_s": 0.8, "phase_rad": phases[0]}
    own = {run.name: {"heave": {"phase_rad": phase}} for run, phase in zip(d.campaign.runs, phases, strict=True)}
    update = {"effects": {"heave": wave}, "log": LogTraits(of_runs=own)}
    corrected = d.campaign.machine.model_copy(update=update)
    estimates = (Estimate("amplitude_m", 0.15, 0.01), Estimate("phase_rad", phases, (0.1, 0.1, 0.1)))
    heave = Candidate(("heave",), 1.0, 1.0, 1.0, 1.0, 0.5, {"heave": estimates}, True)
    verdict = Verdict("named", ("heave",), (Hypothesis("named", ("heave",), 1.0),), (), "Heave.")
    d = dataclasses.replace(d, candidates=(heave,), verdict=verdict, corrected=corrected)
    for run, drawn, phase in zip(d.campaign.runs, series_of(d), phases, strict=True):
        machine = corrected.model_copy(update={"effects": {"heave": {**wave, "phase_rad": phase}}, "log": LogTraits()})
        alone = InverseSimulation(machine, [run], d.gap.band_hz).balances()[0]
        assert drawn.after is not None
        np.testing.assert_allclose(drawn.after, np.where(alone.inside, alone.predicted, np.nan), atol=0.02)
    assert ["heave", "phase_rad, run half", "2.00", "0.10"] in diagnosis.parameters_table(d).rows
    assert to_json(d)["parameters"]["heave"]["phase_rad"]["value"] == [0.3, 2.0, 4.5]


@pytest.mark.parametrize("subsystem", SUBSYSTEMS)
def test_every_place_of_a_gap_is_marked_once_on_the_drawing(subsystem: str):
    d = made_diagnosis("named")
    drawn = fromstring(marked_machine(d.campaign.machine, subsystem, d.shrink))
    named = [text.text for text in drawn.iter() if text.get("font-weight") == "bold"]
    assert named == [subsystem.removesuffix("_sensor")]
