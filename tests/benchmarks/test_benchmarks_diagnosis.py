"""Scores and calibration of the diagnosis' benchmark, on answers made by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks.diagnosis import calibrate, score
from benchmarks.diagnosis.answers import answer, load, save
from workbench.diagnose.verdict.judge import calibration, rank

EVIDENCE = {"clear": 0.0, "slow": 0.0, "prior": 0.0, "bound": 0.0, "against": 0.0}
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
) -> dict[str, Any]:
    """An answer as it is kept: what the label told, and what was said."""
    return {
        "folder": folder, "withheld": list(withheld), "word": word, "names": list(names), "alike": list(alike),
        "label": {"effects": list(told), "where": [GUIDE], "torque_change_rms_nm": size, "parameters": truth or {}},
        "ranking": [[word, list(names), probability]], "evidence": dict(evidence), "estimates": found or {},
        "weighed": [{"names": list(n), "merit": m, "earned": m, "fit": list(n)} for n, m in merits],
        "before": 5.0, "after": after, "noise": 0.5, "cpu_s": 12.0, **GUIDE,
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


def table(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """what -> what was measured, of the first table."""
    lines = score.report(rows, misses=20)
    cells = [line.strip("|").split("|") for line in lines[2 : lines.index("")]]
    return {row[0].strip(): row[2].strip() for row in cells}


def test_shares_are_of_the_campaigns_they_speak_of():
    said = table(ANSWERS)
    assert said["single effect named, visible ones"] == "50 % (2)"  # of four: the small one does not count
    assert said["the same, or said to be alike"] == "75 % (3)"
    assert said["single effect named, all sizes"] == "40 % (2)"
    assert said["false alarm without a gap"] == "50 % (1)"
    assert said["pair: both named"] == "50 % (1)"
    assert said["effect no library holds: unknown"] == "50 % (1)"
    assert said["effect taken out of the library: unknown"] == "100 % (1)"
    assert said["held-out residual ≤ 1.3 of the noise"] == "50 % (1)"
    assert said["the same, heave and ripple ≤ 2"] == "100 % (1)"
    assert said["subsystem right"] == "100 %"


def test_what_was_never_asked_has_no_share():
    assert table([ANSWERS[0]])["pair: both named"] == "–"


@pytest.mark.parametrize(
    ("row", "word"),
    [(ANSWERS[0], "named"), (ANSWERS[4], "no_gap"), (ANSWERS[8], "unknown"), (ANSWERS[10], "unknown")],
)
def test_the_right_word_is_of_the_label_and_of_what_was_taken_out(row: Mapping[str, Any], word: str):
    assert score.right_word(row) == word


def test_the_order_of_two_effects_does_not_matter_and_one_of_them_is_not_enough():
    assert score.right(ANSWERS[6])
    assert not score.right(ANSWERS[7])


def test_the_confusion_says_what_was_answered_instead():
    lines = score.report(ANSWERS, misses=0)
    assert "| friction_viscous | friction_viscous 1, torque_offset 1 |" in lines
    assert "| two effects | both 1, 1 of them 1 |" in lines
    assert "| none | no gap 1, friction_viscous 1 |" in lines
    assert "| heave (withheld) | unknown 1 |" in lines


def test_misses_are_listed_largest_first_and_no_more_than_asked():
    lines = score.report(ANSWERS, misses=3)
    start = next(k for k, line in enumerate(lines) if line.startswith("| campaign |"))
    assert [line.split("|")[1].strip() for line in lines[start + 2 :]] == ["002", "010", "003"]
    assert "| 18.0 | torque_offset | 0.90 |" in lines[start + 2]


def test_answers_are_counted_by_how_sure_they_were():
    lines = score.report(ANSWERS, misses=0)
    assert "| 0.95–1.00 | 1 | 100 % |" in lines
    assert "| 0.80–0.95 | 11 | 45 % |" in lines


def test_errors_are_relative_to_what_the_effect_changes():
    """A gain of 1.06 that is found as 1.09 is off by half of what is wrong with it."""
    row = made(
        ["torque_scale"], "named", ["torque_scale"],
        truth={"torque_scale": {"gain": 1.06}}, found={"torque_scale": {"gain": (1.09, 0.02)}},
    )  # fmt: skip
    ((name, relative, errors),) = score.estimates_within(row)
    assert name == "torque_scale.gain"
    assert (relative, errors) == pytest.approx((0.5, 1.5))
    assert list(score.estimates_within({**row, "names": [OFFSET]})) == []
    wave = {"heave": {"amplitude_m": 0.2, "phase_rad": 1.0}}
    waves = made(["heave"], "named", ["heave"], truth=wave, found={"heave": {"phase_rad": (6.0, 0.1)}})
    assert list(score.estimates_within(waves)) == []


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
    assert not score.right(row)
    assert table([row])["single effect named, visible ones"] == "0 % (0)"
    assert "| still | friction_viscous | nan | refused | 1.00 |" in score.report([row], misses=1)


def test_answers_are_read_in_the_order_of_their_names(tmp_path: Path):
    for row in reversed(ANSWERS):
        (tmp_path / f"{row['folder']}.json").write_text(json.dumps(row))
    assert [row["folder"] for row in load(tmp_path)] == [row["folder"] for row in ANSWERS]


# Calibration


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
    inside = [s <= 1.6449 * factor for row in rows for _, _, s in score.estimates_within(row)]
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
        left = {**EVIDENCE, "clear": 0.03 * (k % 5), "prior": 0.1 * (k % 3), "bound": float(k % 4 == 0)}
        rows.append({**sure(5.0 + k, k % 10 != 0), "evidence": left})
        left = {**EVIDENCE, "clear": 0.1 + 0.05 * (k % 6), "slow": 0.2 + 0.04 * (k % 4), "prior": 0.4 * (k % 3)}
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
    assert weights["unknown_slow"] > 0.0
    assert numbers["temperature"] > 0.0
    assert numbers["threshold"] == pytest.approx(4.0)


def test_calibrated_numbers_tell_the_campaigns_that_they_were_fitted_to():
    pytest.importorskip("sklearn", reason="allowed: scikit-learn comes with the bench extra")
    rows = campaigns()
    numbers = calibrate.fitted(rows)
    hits = 0
    for row in rows:
        merits = [(tuple(w["names"]), float(w["merit"])) for w in row["weighed"]]
        hits += rank(merits, row["evidence"], numbers)[0].verdict == score.right_word(row)
    assert hits > 0.95 * len(rows)
