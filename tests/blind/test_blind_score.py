"""The score of a blind test and the calibration, on answers made by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from benchmarks import calibrate, practice
from workbench.blind import measures, score
from workbench.blind.measures import Share
from workbench.diagnose.hypotheses.settings import calibration
from workbench.view import blind as tables

EVIDENCE = {"left": 0.0, "prior": 0.0}
GUIDE = {"subsystem": "guide", "regime": "speed"}


def made(
    told: Sequence[str],
    word: str,
    names: Sequence[str] = (),
    *,
    alike: Sequence[str] = (),
    size: float = 5.0,
    probability: float = 0.9,
    after: float = 0.55,
    merits: Sequence[tuple[Sequence[str], float]] = (),
    evidence: Mapping[str, float] = EVIDENCE,
    truth: Mapping[str, Mapping[str, float]] | None = None,
    estimates: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
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
        "folder": folder, "word": word, "names": list(names), "alike": list(alike),
        "label": {
            "effects": list(told), "where": [where], "torque_change_rms_nm": size, "parameters": truth or {},
            "family": family, "kind": family.partition("_")[0], "events": list(events), "alike": list(twins),
        },
        "ranking": [[word, list(names), probability]], "evidence": dict(evidence), "estimates": estimates or {},
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
    made(["heave"], "named", ["heave"], after=0.95, folder="012"),
]


def share(key: str, rows: Sequence[Mapping[str, Any]] = ANSWERS) -> tuple[int, int]:
    """How many of how many cases pass a measure."""
    counted = measures.measure(key).share(rows)
    return counted.count, counted.of


def test_shares_are_of_the_campaigns_they_speak_of():
    assert share("named") == (2, 5)
    assert share("named_or_alike") == (3, 5)
    assert share("pair_both") == (1, 2)
    assert share("pair_one") == (2, 2)
    assert share("false_alarm") == (1, 2)
    assert share("false_unknown") == (0, 2)
    assert share("unknown_caught") == (1, 2)
    assert share("pair_both", ANSWERS[:1]) == (0, 0)


def test_causes_that_a_recorded_machine_hides_are_counted_apart():
    """By what is sealed, as a score reads it."""
    labels = {row["folder"]: {**row["label"], "truth": {"detectability": 1.5, "M_m": 2.0}} for row in ANSWERS}
    labels["001"]["truth"] = labels["009"]["truth"] = {"detectability": 0.6}
    del labels["002"]["truth"]
    truth = cast(Any, SimpleNamespace(labels=labels))
    rows = [{**row, "label": score._label(truth, row["folder"])} for row in ANSWERS]
    assert (share("detectable", rows), share("unknown_detectable", rows)) == ((2, 3), (0, 1))
    assert not any("truth" in row["label"] for row in rows)


def test_a_correction_that_makes_it_worse_is_harmful_and_a_shrink_is_held_against_the_true_effects():
    row = made([VISCOUS], "named", [OFFSET], after=5.2)
    assert measures.harmful(row)
    assert not measures.harmful({**row, "after": 4.9})
    assert not measures.harmful({**row, "word": "no_gap"})
    assert measures.of_the_oracle(row) is None
    row = {**row, "after": 1.0, "held_out": [[[], 5.0], [[OFFSET], 1.0], [[VISCOUS], 0.9]]}
    assert measures.of_the_oracle(row) == pytest.approx(0.9)
    assert measures.numbers([row]).of_oracle == pytest.approx((0.9,))
    assert measures.numbers(ANSWERS).without_oracle == 7


def test_the_calibration_error_is_the_distance_of_what_is_said_from_what_is_right():
    """G. W. Brier's and Naeini's textbook case: ten answers of 0.9, of which seven are right, are off by 0.2."""
    rows = [made([VISCOUS], "named", [VISCOUS if k < 7 else OFFSET], probability=0.9) for k in range(10)]
    assert measures.calibration_error(rows) == pytest.approx(0.2)
    (only,) = measures.reliability(rows)
    assert (only.low, only.right) == (0.9, Share(7, 10))
    assert only.said == pytest.approx(0.9)
    assert measures.calibration_error([]) is None


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(10, 10, 0.7225, 1.0), (0, 10, 0.0, 0.2775), (81, 263, 0.2553, 0.3662), (0, 0, 0.0, 1.0)],
)
def test_intervals_are_wilsons(count: int, of: int, low: float, high: float):
    """81 of 263: R. G. Newcombe, Statistics in Medicine 17 (1998), table I; at 0 and n by the closed form."""
    assert Share(count, of).interval() == pytest.approx((low, high), abs=5e-5)


UNLISTED = "unlisted: a fan"


def test_a_place_is_right_by_the_likeliest_one():
    motor = {"subsystem": "motor", "regime": "speed"}
    row = made([UNLISTED], "unknown", where=motor, places=[("guide", 0.3), ("motor", 0.6), ("drum", 0.1)])
    assert measures.likeliest_place(row) == "motor"
    assert measures.place_right(row)
    wrong = made([UNLISTED], "unknown", where=motor, places=[("guide", 0.8), ("motor", 0.2)])
    assert not measures.place_right(wrong)
    single = made([UNLISTED], "unknown", where=motor)  # an answer of one place, without probabilities
    assert not measures.place_right(single)
    assert share("unknown_place", [row, wrong, single]) == (1, 3)


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
    assert measures.event_found(row) == found
    assert share("event", [row, ANSWERS[0]]) == (int(found), 1)


def test_errors_are_relative_to_what_the_effect_changes():
    """A gain of 1.06 that is found as 1.09 is off by half of what is wrong with it."""
    row = made(
        ["torque_scale"], "named", ["torque_scale"],
        truth={"torque_scale": {"gain": 1.06}}, estimates={"torque_scale": {"gain": (1.09, 0.02)}},
    )  # fmt: skip
    ((name, relative, errors),) = measures.estimates_within(row)
    assert name == "torque_scale.gain"
    assert (relative, errors) == pytest.approx((0.5, 1.5))
    assert list(measures.estimates_within({**row, "names": [OFFSET]})) == []
    wave = {"heave": {"amplitude_m": 0.2, "phase_rad": 1.0}}
    waves = made(["heave"], "named", ["heave"], truth=wave, estimates={"heave": {"phase_rad": (6.0, 0.1)}})
    assert list(measures.estimates_within(waves)) == []


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
    for line in practice.answered(tmp_path, tmp_path / "answers", None, 1):
        assert line.startswith(f"still: {VISCOUS} -> refused")
    (row,) = practice.rows_of(tmp_path, tmp_path / "answers")
    assert row["word"] == "refused"
    assert row["warnings"]
    assert share("named", [row]) == (0, 1)
    assert tables.misses([row]).rows[0][4:6] == ["refused", "1.00"]


# Calibration


def none_of(merit: float) -> dict[str, Any]:
    return made([], "no_gap", merits=[((VISCOUS,), merit), ((OFFSET,), merit - 3.0)])


def sure(lead: float, right: bool) -> dict[str, Any]:
    """Two causes, of which the first leads by so much merit."""
    told = VISCOUS if right else OFFSET
    return made([told], "named", [VISCOUS], merits=[((VISCOUS,), 60.0), ((OFFSET,), 60.0 - lead)])


def campaigns() -> list[dict[str, Any]]:
    """Known causes leave noise, unknown ones leave structure."""
    rows = [none_of(float(k % 7) - 3.0) for k in range(20)]
    for k in range(30):
        left = {"left": 0.1 * (k % 5), "prior": 0.1 * (k % 3)}
        rows.append({**sure(5.0 + k, k % 10 != 0), "evidence": left})
        left = {"left": 1.1 + 0.1 * (k % 6), "prior": 0.4 * (k % 3)}
        rows.append(
            made(["unlisted: a fan"], "unknown", merits=[((VISCOUS,), 30.0 + k)], evidence=left, folder=f"{k:03d}")
        )
    return rows


def test_what_is_stated_is_fitted_to_how_often_answers_are_right():
    """Of answers without evidence against them one of 25 is wrong, of no gap one of ten, of unknown causes one of four:
    their probabilities are that, or come near it, and no answer changes."""
    rows = [sure(60.0, k % 25 != 0) for k in range(100)]
    rows += [
        {**none_of(-5.0), "label": {**none_of(-5.0)["label"], "effects": [VISCOUS] * (k % 10 == 0)}} for k in range(60)
    ]
    left = {**EVIDENCE, "left": 4.0}
    for k in range(60):
        told = ["unlisted: a fan"] if k % 4 else [OFFSET]
        rows.append(made(told, "unknown", merits=[((VISCOUS,), 30.0)], evidence=left))
    numbers = calibrate.fitted(rows)
    decided = {**calibration(), **{name: numbers[name] for name in calibrate.STATED}}
    assert numbers == pytest.approx(decided, rel=1e-3)
    anew = [calibrate._anew(row, numbers) for row in rows]
    said = {
        word: next(row["ranking"][0][2] for row in anew if row["word"] == word)
        for word in ("named", "no_gap", "unknown")
    }
    assert said["named"] == pytest.approx(0.96, abs=0.01)
    assert said["no_gap"] == pytest.approx(0.90, abs=0.03)
    assert said["unknown"] == pytest.approx(0.75, abs=0.04)
    assert (measures.calibration_error(anew) or 1.0) < 0.03
    lines = calibrate.by_family(rows, anew)
    assert len(lines) == 4 and lines[-1].startswith("| all |")


def test_a_family_is_judged_by_what_the_others_give(monkeypatch: pytest.MonkeyPatch):
    """Its own answers play no part in the numbers that it is judged by, and each keeps its label and its fits."""
    families = ("hoist_small", "hoist_large", "axis_std")
    rows = [{**row, "label": {**row["label"], "family": families[k % 3]}} for k, row in enumerate(campaigns())]
    asked: list[set[str]] = []

    def fitted(others: Sequence[Mapping[str, Any]]) -> dict[str, float]:
        asked.append({measures.family_of(row) for row in others})
        return {**calibration(), "unknown_bias": 30.0 if "axis_std" not in asked[-1] else -3.0}

    monkeypatch.setattr(calibrate, "fitted", fitted)
    anew = calibrate.left_out(rows)
    assert len(anew) == len(rows)
    assert sorted(map(sorted, asked)) == sorted(sorted(set(families) - {family}) for family in families)
    by_name = {family: [row for row in anew if measures.family_of(row) == family] for family in families}
    quiet = [row for row in by_name["axis_std"] if sum(v**2 for v in row["evidence"].values()) < 1.0]
    assert quiet and all(row["word"] == "unknown" for row in quiet)  # by those numbers, whatever it is
    assert any(row["word"] == "named" for row in by_name["hoist_small"])
    for row in anew:
        assert row["word"] == row["ranking"][0][0]
        assert sum(probability for _, _, probability in row["ranking"]) == pytest.approx(1.0)


@pytest.mark.parametrize(("barred", "said"), [([["a"]], "barred: its amounts"), ([["b"]], "not among the fits")])
def test_a_hypothesis_that_left_out_runs_bar_is_not_said_to_be_none_of_the_fits(
    barred: list[list[str]], said: str, monkeypatch: pytest.MonkeyPatch
):
    for name, value in (("right_or_alike", False), ("visible", True), ("among_first_three", False)):
        monkeypatch.setattr(measures, name, lambda row, value=value: value)
    row: dict[str, Any] = {"word": "unknown", "names": [], "label": {"effects": ["a"]}, "weighed": [], "evidence": {}}
    assert said in tables.why(row | {"barred": barred, "bars": {"a": "its amounts may as well be zero"}})
