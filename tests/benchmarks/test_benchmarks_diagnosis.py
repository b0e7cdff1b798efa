"""Scores and calibration of the diagnosis' benchmark, on answers made by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks.campaigns.families import FAMILIES
from benchmarks.diagnosis import calibrate, criteria, score
from benchmarks.diagnosis.answers import answer, load, save
from benchmarks.diagnosis.share import Share
from workbench.diagnose.verdict.judge import calibration, rank

EVIDENCE = dict.fromkeys(calibrate.EVIDENCE, 0.0)
GUIDE = {"subsystem": "guide", "regime": "speed"}


def made(
    told: Sequence[str],
    word: str,
    names: Sequence[str] = (),
    *,
    alike: Sequence[str] = (),
    withheld: Sequence[str] = (),
    size: float = 5.0,
    probability: float = 0.9,
    after: float = 0.55,
    merits: Sequence[tuple[Sequence[str], float]] = (),
    evidence: Mapping[str, float] = EVIDENCE,
    truth: Mapping[str, Mapping[str, float]] | None = None,
    found: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
    folder: str = "001",
    family: str = "hoist_small",
    where: Mapping[str, str] = GUIDE,
    places: Sequence[tuple[str, float]] = (),
    events: Sequence[Mapping[str, Any]] = (),
    windows: Sequence[tuple[str, float, float]] = (),
    regime: str = "speed",
    twins: Sequence[str] = (),
) -> dict[str, Any]:
    """An answer as it is kept: what the label told, and what was said."""
    return {
        "folder": folder, "withheld": list(withheld), "word": word, "names": list(names), "alike": list(alike),
        "label": {
            "effects": list(told), "where": [where], "torque_change_rms_nm": size, "parameters": truth or {},
            "family": family, "kind": family.partition("_")[0], "events": list(events), "alike": list(twins),
        },
        "ranking": [[word, list(names), probability]], "evidence": dict(evidence), "estimates": found or {},
        "weighed": [{"names": list(n), "merit": m, "fit": list(n)} for n, m in merits],
        "counted": [[list(n), m] for n, m in merits], "places": list(places), "windows": list(windows),
        "before": 5.0, "after": after, "noise": 0.5, "cpu_s": 12.0, "subsystem": "guide", "regime": regime,
    }  # fmt: skip


VISCOUS, OFFSET = "friction_viscous", "torque_offset"
ANSWERS = [
    made([VISCOUS], "named", [VISCOUS], probability=0.99),
    made([VISCOUS], "named", [OFFSET], size=9.0, folder="002"),
    made([OFFSET], "named", ["carriage_mass_error"], alike=[OFFSET], folder="003"),
    made([OFFSET], "no_gap", size=0.3, folder="004"),  # below the noise: nobody could see it
    made([], "no_gap", size=0.0, folder="005"),
    made([], "named", [VISCOUS], size=0.0, folder="006"),
    made([VISCOUS, OFFSET], "named", [OFFSET, VISCOUS], folder="007", after=0.9),
    made([VISCOUS, OFFSET], "named", [VISCOUS], folder="008"),
    made(["unlisted: a fan"], "unknown", folder="009"),
    made(["unlisted: a fan"], "named", [VISCOUS], size=7.0, folder="010"),
    made(["heave"], "unknown", withheld=["heave"], folder="011"),
    made(["heave"], "named", ["heave"], after=0.95, folder="012"),
]


def cells(lines: Sequence[str]) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def by_family(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, str]]:
    """family -> heading -> what was measured."""
    head, _, *lines = cells(score.by_family(rows))
    return {line[0]: dict(zip(head[1:], line[1:], strict=True)) for line in lines}


def table(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """what -> what was measured, of the table over all families."""
    return {row[0]: row[2] for row in cells(score.pooled(rows)[2:])}


def test_shares_are_of_the_campaigns_they_speak_of():
    said = by_family(ANSWERS)["hoist_small"]
    assert said["single named"].startswith("2/5 40 %")
    assert said["or alike"].startswith("3/5 60 %")
    assert said["pair: both"].startswith("1/2 50 %")
    assert said["pair: one or both"].startswith("2/2 100 %")
    assert said["no gap: named"].startswith("1/2 50 %")
    assert said["no gap: unknown"].startswith("0/2 0 %")
    assert said["unlisted: unknown"].startswith("1/2 50 %")
    pooled = table(ANSWERS)
    assert pooled["single effect named, visible ones"].startswith("2/4 50 %")  # the small one does not count
    assert pooled["the same, or said to be alike"].startswith("3/4 75 %")
    assert pooled["effect taken out of the library: unknown"].startswith("1/1 100 %")
    assert pooled["held-out residual ≤ 1.3 of the noise"].startswith("1/2 50 %")
    assert pooled["the same, heave and ripple ≤ 2"].startswith("1/1 100 %")
    assert pooled["subsystem and regime right where rightly named"].startswith("3/3 100 %")


def test_what_was_never_asked_has_no_share():
    assert by_family(ANSWERS[:1])["hoist_small"]["pair: both"] == "–"


def test_families_have_lines_of_their_own_and_kinds_what_is_asked_of_them():
    axis = made([], "unknown", family="axis_std")
    said = by_family([*ANSWERS, axis])
    assert set(said) == {"hoist_small", "axis_std", "all of kind hoist", "all of kind axis", "asked of them, %"}
    assert said["axis_std"]["no gap: unknown"].startswith("1/1")
    assert said["all of kind hoist"]["no gap: unknown"].startswith("0/2")
    recorded = {**made([], "no_gap"), "source": "campaigns"}
    recorded["label"] = {"effects": [], "where": []}
    assert criteria.family_of(recorded) == "campaigns"


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(10, 10, 0.7225, 1.0), (0, 10, 0.0, 0.2775), (81, 263, 0.2553, 0.3662), (0, 0, 0.0, 1.0)],
)
def test_intervals_are_wilsons(count: int, of: int, low: float, high: float):
    """81 of 263: R. G. Newcombe, Statistics in Medicine 17 (1998), table I; at 0 and n by the closed form."""
    assert Share(count, of).interval() == pytest.approx((low, high), abs=5e-5)


UNLISTED = "unlisted: a fan"


def test_a_place_is_right_by_the_likeliest_one_and_weighed_by_its_probability():
    motor = {"subsystem": "motor", "regime": "speed"}
    row = made([UNLISTED], "unknown", where=motor, places=[("guide", 0.3), ("motor", 0.6), ("drum", 0.1)])
    assert criteria.likeliest_place(row) == "motor"
    assert criteria.place_right(row)
    assert criteria.probability_of_place(row) == pytest.approx(0.6)
    wrong = made([UNLISTED], "unknown", where=motor, places=[("guide", 0.8), ("motor", 0.2)])
    assert not criteria.place_right(wrong)
    assert criteria.probability_of_place(wrong) == pytest.approx(0.2)
    single = made([UNLISTED], "unknown", where=motor)  # an answer of one place, without probabilities
    assert not criteria.place_right(single)
    assert criteria.probability_of_place(single) == 0.0
    said = by_family([row, wrong, single])["hoist_small"]
    assert said["unlisted: place"].startswith("1/3")
    assert said["probability of the place"] == f"{(0.6 + 0.2 + 0.0) / 3.0:.2f}"


@pytest.mark.parametrize(
    ("regime", "window", "found"),
    [
        ("event", ("half_fast", 12.0, 13.0), True),
        ("event", ("half_fast", 10.2, 11.8), True),  # half a second beside it
        ("event", ("half_fast", 20.0, 21.0), False),
        ("event", ("empty_fast", 12.0, 13.0), False),
        ("time", ("half_fast", 12.0, 13.0), False),
    ],
)
def test_an_event_is_found_in_its_run_at_its_time_and_by_its_name(regime: str, window: Any, found: bool):
    event = {"run": "half_fast", "from_s": 12.2, "to_s": 13.1, "subsystem": "guide"}
    row = made([UNLISTED], "unknown", events=[event], windows=[window], regime=regime)
    assert criteria.event_found(row) == found
    assert by_family([row, ANSWERS[0]])["hoist_small"]["event as event"].startswith(f"{int(found)}/1")


def test_twins_by_nature_are_one_answer_with_two_names():
    row = made(["gearbox_efficiency"], "named", ["friction_load_dependent"], twins=["friction_load_dependent"])
    assert not criteria.right(row)
    assert criteria.right_or_alike(row)
    assert not criteria.right_or_alike({**row, "names": [OFFSET]})


def test_the_label_among_the_first_three_counts_however_the_answer_reads():
    row = made([VISCOUS], "unknown")
    ranking = [["unknown", [], 0.5], ["named", [OFFSET], 0.3], ["named", [VISCOUS], 0.15], ["no_gap", [], 0.05]]
    assert criteria.among_first_three({**row, "ranking": ranking})
    assert not criteria.among_first_three({**row, "ranking": [ranking[0], ranking[1], ranking[3], ranking[2]]})


def test_what_is_left_and_explained_is_reported_where_an_answer_says_it():
    row = made([VISCOUS], "named", [VISCOUS])
    assert "what is left said not to matter" in table([row])
    assert table([row])["what is left said not to matter"] == "–"
    left = {"rms": 0.7, "percent_of_input": 0.1, "relevant": False}
    said = table([{**row, "left": left, "explained": 0.997}, {**row, "left": {**left, "relevant": True}}])
    assert said["what is left said not to matter"].startswith("1/2")
    assert said["gap's energy explained, median"] == "99.70 %"


@pytest.mark.parametrize(
    ("row", "word"),
    [(ANSWERS[0], "named"), (ANSWERS[4], "no_gap"), (ANSWERS[8], "unknown"), (ANSWERS[10], "unknown")],
)
def test_the_right_word_is_of_the_label_and_of_what_was_taken_out(row: Mapping[str, Any], word: str):
    assert criteria.right_word(row) == word


def test_the_order_of_two_effects_does_not_matter_and_one_of_them_is_not_enough():
    assert criteria.right(ANSWERS[6])
    assert not criteria.right(ANSWERS[7])


def test_the_confusion_says_what_was_answered_instead():
    lines = score.report(ANSWERS, misses=0)
    assert "| friction_viscous | friction_viscous 1, torque_offset 1 |" in lines
    assert "| two effects | both 1, 1 of them 1 |" in lines
    assert "| none | no gap 1, friction_viscous 1 |" in lines
    assert "| heave (withheld) | unknown 1 |" in lines


def test_misses_are_listed_largest_first_and_no_more_than_asked():
    lines = score.report(ANSWERS, misses=3)
    start = next(k for k, line in enumerate(lines) if line.startswith("| family | campaign |"))
    assert [row[1] for row in cells(lines[start + 2 :])] == ["002", "010", "003"]
    assert "| 18.0 | torque_offset | 0.90 |" in lines[start + 2]


def test_answers_are_counted_by_how_sure_they_were():
    lines = score.report(ANSWERS, misses=0)
    said = {row[0]: row[1] for row in cells(lines) if len(row) == 2}
    assert said["0.95–1.00"].startswith("1/1 100 %")
    assert said["0.80–0.95"].startswith("5/11 45 %")


def test_errors_are_relative_to_what_the_effect_changes():
    """A gain of 1.06 that is found as 1.09 is off by half of what is wrong with it."""
    row = made(
        ["torque_scale"], "named", ["torque_scale"],
        truth={"torque_scale": {"gain": 1.06}}, found={"torque_scale": {"gain": (1.09, 0.02)}},
    )  # fmt: skip
    ((name, relative, errors),) = criteria.estimates_within(row)
    assert name == "torque_scale.gain"
    assert (relative, errors) == pytest.approx((0.5, 1.5))
    assert list(criteria.estimates_within({**row, "names": [OFFSET]})) == []
    wave = {"heave": {"amplitude_m": 0.2, "phase_rad": 1.0}}
    waves = made(["heave"], "named", ["heave"], truth=wave, found={"heave": {"phase_rad": (6.0, 0.1)}})
    assert list(criteria.estimates_within(waves)) == []


def test_a_campaign_that_the_diagnosis_refuses_is_a_miss_that_says_so(tmp_path: Path):
    """Runs that all stand still."""
    (tmp_path / "labels").mkdir()
    label = tmp_path / "labels" / "still.json"
    label.write_text(json.dumps({"effects": [VISCOUS], "torque_change_rms_nm": 5.0}))
    folder = tmp_path / "still"
    folder.mkdir()
    friction = "{coulomb_forward_n: 1.0, coulomb_backward_n: 1.0, viscous_n_s_per_m: 1.0}"
    (folder / "machine.yaml").write_text(f"kind: axis\nmotion: linear\nmass_kg: 1.0\nfriction: {friction}\n")
    (folder / "runs.yaml").write_text("runs: [{name: still, file: still.csv}]\n")
    rows = "".join(f"{0.01 * k:.2f},{0.1 * (k % 7)},1.0\n" for k in range(2000))
    (folder / "still.csv").write_text("time_s,force_n,position_m\n" + rows)
    save(answer(folder, label), tmp_path / "answers" / "still.json")
    (row,) = load(tmp_path / "answers")
    assert row["word"] == "refused"
    assert row["warnings"]
    assert not criteria.right(row)
    assert by_family([row])["answers"]["single named"].startswith("0/1")
    assert "| answers | still | friction_viscous | – | refused | 1.00 |" in score.report([row], misses=1)


def test_answers_are_read_in_the_order_of_their_names(tmp_path: Path):
    for row in reversed(ANSWERS):
        (tmp_path / f"{row['folder']}.json").write_text(json.dumps(row))
    assert [row["folder"] for row in load(tmp_path)] == [row["folder"] for row in ANSWERS]


# Calibration
# What is left, in whatever measure the verdict has of it.
MAIN = next(name for name in calibrate.EVIDENCE if name not in ("prior", "bound", "against"))


def none_of(merit: float) -> dict[str, Any]:
    return made([], "no_gap", merits=[((VISCOUS,), merit), ((OFFSET,), merit - 3.0)])


def test_the_threshold_lies_above_all_but_two_per_cent_of_machines_without_a_gap():
    rows = [none_of(float(k)) for k in range(100)] + [made([VISCOUS], "named", merits=[((VISCOUS,), 500.0)])]
    assert calibrate._threshold(rows) == 98.0
    assert calibrate._threshold([none_of(-5.0)] * 10) == calibrate.LEAST_THRESHOLD
    assert calibrate._threshold(rows[-1:]) == calibration()["threshold"]


def test_the_interval_is_widened_until_nine_of_ten_true_values_are_inside():
    rows = [
        made(
            [OFFSET], "named", [OFFSET],
            truth={OFFSET: {"offset_nm": 30.0}}, found={OFFSET: {"offset_nm": (30.0 + 0.1 * k, 1.0)}},
        )
        for k in range(1, 51)
    ]  # fmt: skip
    factor = calibrate._interval(rows)
    inside = [s <= 1.6449 * factor for row in rows for _, _, s in criteria.estimates_within(row)]
    assert sum(inside) / len(inside) == pytest.approx(0.9)
    assert calibrate._interval([]) == 1.0


def sure(lead: float, right: bool) -> dict[str, Any]:
    """Two causes, of which the first leads by so much merit."""
    told = VISCOUS if right else OFFSET
    return made([told], "named", [VISCOUS], merits=[((VISCOUS,), 60.0), ((OFFSET,), 60.0 - lead)])


def test_answers_that_are_wrong_more_often_make_the_temperature_higher():
    numbers = dict(calibration())
    often = calibrate._temperature([sure(8.0, k % 3 != 0) for k in range(30)], numbers)
    seldom = calibrate._temperature([sure(8.0, k % 15 != 0) for k in range(30)], numbers)
    assert often > seldom > 0.0
    given = rank([((VISCOUS,), 60.0), ((OFFSET,), 52.0)], EVIDENCE, {**numbers, "temperature": often})
    assert given[0].probability == pytest.approx(2.0 / 3.0, abs=0.12)


def campaigns() -> list[dict[str, Any]]:
    """Known causes leave noise, unknown ones leave structure; the bound says nothing, rather the opposite."""
    rows = [none_of(float(k % 7) - 3.0) for k in range(20)]
    for k in range(30):
        left = {**EVIDENCE, MAIN: 0.03 * (k % 5), "prior": 0.1 * (k % 3), "bound": float(k % 4 == 0)}
        rows.append({**sure(5.0 + k, k % 10 != 0), "evidence": left})
        left = {**EVIDENCE, MAIN: 0.2 + 0.05 * (k % 6), "prior": 0.4 * (k % 3)}
        rows.append(
            made(["unlisted: a fan"], "unknown", merits=[((VISCOUS,), 30.0 + k)], evidence=left, folder=f"{k:03d}")
        )
    return rows


def test_calibration_gives_finite_numbers_and_no_negative_weight():
    pytest.importorskip("sklearn", reason="allowed: scikit-learn comes with the bench extra")
    numbers = calibrate.fitted(campaigns())
    assert set(numbers) == set(calibration())
    assert all(math.isfinite(value) for value in numbers.values())
    weights = {name: value for name, value in numbers.items() if name.startswith("unknown_") and name != "unknown_bias"}
    assert set(weights) == {f"unknown_{name}" for name in calibrate.EVIDENCE}
    assert all(value >= 0.0 for value in weights.values())
    assert weights["unknown_bound"] == 0.0
    assert weights[f"unknown_{MAIN}"] > 0.0
    assert numbers["temperature"] > 0.0
    assert numbers["threshold"] == pytest.approx(4.0)


def test_calibrated_numbers_tell_the_campaigns_that_they_were_fitted_to():
    pytest.importorskip("sklearn", reason="allowed: scikit-learn comes with the bench extra")
    rows = campaigns()
    numbers = calibrate.fitted(rows)
    hits = 0
    for row in rows:
        hits += rank(calibrate._merits(row), row["evidence"], numbers)[0].verdict == criteria.right_word(row)
    assert hits > 0.95 * len(rows)


def test_a_family_is_judged_by_what_the_others_give(monkeypatch: pytest.MonkeyPatch):
    """Its own answers play no part in the numbers that it is judged by, and each keeps its label and its fits."""
    families = ("hoist_small", "hoist_large", "axis_std")
    rows = [{**row, "label": {**row["label"], "family": families[k % 3]}} for k, row in enumerate(campaigns())]
    asked: list[set[str]] = []

    def fitted(others: Sequence[Mapping[str, Any]]) -> dict[str, float]:
        asked.append({criteria.family_of(row) for row in others})
        return {**calibration(), "threshold": 1e9 if "axis_std" not in asked[-1] else 4.0}

    monkeypatch.setattr(calibrate, "fitted", fitted)
    anew = calibrate.left_out(rows)
    assert len(anew) == len(rows)
    assert sorted(map(sorted, asked)) == sorted(sorted(set(families) - {family}) for family in families)
    by_name = {family: [row for row in anew if criteria.family_of(row) == family] for family in families}
    assert all(row["word"] != "named" for row in by_name["axis_std"])  # nothing beats that threshold
    assert any(row["word"] == "named" for row in by_name["hoist_small"])
    for row in anew:
        assert row["word"] == row["ranking"][0][0]
        assert sum(probability for _, _, probability in row["ranking"]) == pytest.approx(1.0)


def test_refused_campaigns_stay_refused_whatever_the_numbers():
    rows = [made([], "refused", folder="x"), made([VISCOUS], "refused", family="axis_std")]
    assert [calibrate._anew(row, calibration())["word"] for row in rows] == ["refused", "refused"]


def test_one_command_makes_and_diagnoses_what_calibrates_on_a_seed_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ordered: list[Any] = []
    asked: list[Any] = []
    monkeypatch.setattr(calibrate, "make_all", lambda wanted, processes: ordered.extend(wanted))
    monkeypatch.setattr(calibrate, "answer_all", lambda what, processes: asked.append(what))
    folders = calibrate.made(tmp_path, 60, 2)
    assert len(ordered) == 60
    assert {order.seed[0] for order in ordered} == {calibrate.SEED}
    assert {order.family for order in ordered} == set(FAMILIES)
    assert [what.answers for what in asked] == folders
    assert [(what.withhold, what.singles_only) for what in asked] == [(False, False), (True, True)]
