"""A machine and runs of one's own: what is taken from them, and the power of an experiment."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.validation import next_run
from benchmarks.validation.axis_causes import LISTED as ON_AXES
from benchmarks.validation.axis_causes import OF_A_LOAD, OF_NO_LOAD
from benchmarks.validation.campaign import make_campaign
from benchmarks.validation.content import draw
from benchmarks.validation.entry import LARGEST, SMALLEST, content_of, made, ordered
from benchmarks.validation.rig import Rig, rig_from
from benchmarks.validation.rig_files import rig_of
from workbench.blind import score as later
from workbench.blind.answer import Answer
from workbench.blind.make import Asked
from workbench.blind.measures import Share, of_the_oracle
from workbench.blind.power import LEAST, power_of, thresholds
from workbench.blind.seal import Order
from workbench.core.errors import InputError
from workbench.effects import find
from workbench.logs import read_campaign
from workbench.machines import plant_of
from workbench.view import blind as tables

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "scenarios" / "demo_campaign"


@pytest.fixture(scope="module")
def rig() -> Rig:
    return rig_of(None, DEMO)


def noise(values: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)


def test_a_campaign_gives_its_speeds_payloads_heights_rate_and_noise(rig: Rig):
    recorded = read_campaign(DEMO)
    assert rig.drawn.machine == recorded.machine
    assert [(r.name, r.payload_kg, r.start) for r in rig.runs] == [
        (run.name, run.payload_kg, run.start_position_m) for run in recorded.runs
    ]
    assert rig.logging.rate_hz == pytest.approx(50.0)
    one = recorded.runs[0]
    assert rig.sensors["input_noise"] == pytest.approx(noise(one["torque_motor1_nm"]), rel=0.2)
    reference = np.array(rig.runs[0].reference)
    t = np.arange(len(reference)) * 1e-3
    assert np.interp(one.time_s, t, reference) == pytest.approx(one["speed_reference_rad_s"], abs=0.02)


def test_a_case_of_a_rig_repeats_its_runs_on_another_true_machine(rig: Rig, tmp_path: Path):
    short = replace(rig, runs=rig.runs[1:2])
    (order,) = ordered(Asked(runs=DEMO, cases=1, case="singles", effects="friction_viscous"), 7)[0]
    assert SMALLEST <= order.size <= LARGEST
    _, label = made(short, tmp_path, order)
    again, recorded = read_campaign(tmp_path / "001"), read_campaign(DEMO)
    (run,), measured = again.runs, recorded.run(short.runs[0].name)
    assert again.machine == recorded.machine
    assert run.payload_kg == measured.payload_kg
    assert run.sample_time_s == pytest.approx(measured.sample_time_s)
    assert noise(run["torque_motor1_nm"]) == pytest.approx(noise(measured["torque_motor1_nm"]), rel=0.15)
    speed = np.interp(measured.time_s, run.time_s, run["speed_motor_rad_s"])
    off = np.std(speed - measured["speed_motor_rad_s"])
    assert off < 0.02 * np.max(np.abs(speed))  # the same motion, from another drive
    assert label.effects == ("friction_viscous",) and label.family == "yours"
    assert label.torque_change_rms_nm > 0.0


def test_an_axis_gives_its_motion_and_plays_it_again(tmp_path: Path):
    content = draw((5, 1), "axis_std", "none")
    make_campaign(tmp_path / "own", (5, 1), replace(content, runs=content.runs[:2]))
    rig = rig_of(None, tmp_path / "own")
    assert rig.kind == "axis"
    assert rig_from(json.loads(json.dumps(rig.said()))) == rig
    wanted, _ = ordered(Asked(runs=tmp_path / "own", cases=1, case="none"), 3)
    made(replace(rig, runs=rig.runs[:1]), tmp_path, wanted[0])
    ours, theirs = (read_campaign(tmp_path / name).runs[0] for name in ("001", "own"))
    (speed,) = {"velocity_m_s", "speed_rad_s"} & set(theirs.signals)
    seen = np.interp(theirs.time_s, ours.time_s, ours[speed])
    assert np.std(seen - theirs[speed]) < 0.1 * np.std(theirs[speed])


@pytest.mark.parametrize("seed", [5, 8])
def test_every_effect_of_an_axis_can_be_made_smaller(seed: int):
    content = draw((seed, 1), "axis_std", "none")
    sensors = {"input_noise": 0.0, "encoder": False, "jitter_s": 0.0}
    rig = Rig("axis", content.drawn, content.runs, content.logging, sensors, (), "N")
    plant = plant_of(content.drawn.machine).kind
    seen = 0
    for name in sorted({*ON_AXES} - {*(OF_NO_LOAD if content.drawn.loaded else OF_A_LOAD)}):
        order = Order(1, (seed, 1), "simulator", "yours", "singles", (name,))
        (whole,), (half,) = (content_of(replace(order, size=size), rig).causes for size in (1.0, 0.5))
        for effect, numbers in whole.library.items():
            for parameter in find(effect, plant).parameters:
                key = parameter.named(plant)
                if key in numbers and parameter.vanishes_at is not None:
                    expected = parameter.vanishes_at + 0.5 * (numbers[key] - parameter.vanishes_at)
                    assert half.library[effect][key] == pytest.approx(expected), (name, key)
                    seen += numbers[key] != parameter.vanishes_at
    assert seen > 10


PLAN = """\
rate_hz: 100
input_noise: 2.0
signals: [reference, position]
runs:
  - {name: empty, profile: fast, payload_kg: 0, start_position_m: 9.0, duration_s: 40}
  - {name: loaded, profile: slow, payload_kg: 9000, start_position_m: 9.0, duration_s: 40, top_speed: 60}
"""


def test_a_plan_gives_runs_that_were_never_recorded(tmp_path: Path):
    (tmp_path / "plan.yaml").write_text(PLAN)
    rig = rig_of(DEMO / "machine.yaml", tmp_path / "plan.yaml")
    assert [run.payload_kg for run in rig.runs] == [0.0, 9000.0]
    assert rig.sensors["input_noise"] == 2.0
    assert rig.logging.logs == ("reference", "position")
    assert max(map(abs, rig.runs[1].reference or ())) < 60.0 * 0.31  # a slow run's part of the top speed
    assert rig == rig_of(DEMO / "machine.yaml", tmp_path / "plan.yaml")


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ("profile: fast", "profile: fats", r"plan.yaml:5: runs.0.profile: unknown profile 'fats'; did you mean 'fast'"),
        ("name: loaded", "name: empty", "plan.yaml:6: run 'empty' is there twice"),
        ("rate_hz: 100", "rate_hz: 0", "rate_hz"),
        ("rate_hz: 100", "rate: 100", "did you mean 'rate_hz'"),
        ("start_position_m: 9.0, duration_s: 40}", "start_position_m: 0.5, duration_s: 40}", "the rail reaches from"),
        (PLAN[PLAN.index("runs:") :], "runs: []\n", "runs"),
    ],
)
def test_a_plan_that_cannot_be_driven_is_one_line(tmp_path: Path, before: str, after: str, sentence: str):
    assert before in PLAN
    (tmp_path / "plan.yaml").write_text(PLAN.replace(before, after, 1))
    with pytest.raises(InputError, match=sentence):
        rig_of(DEMO / "machine.yaml", tmp_path / "plan.yaml")


# Power


def test_thresholds_of_a_known_logistic_law_are_recovered():
    """logit P = 3 (ln size − middle): nine of ten pass at middle · 9^(1/3)."""
    rng = np.random.default_rng(1)
    middles = (0.5, 1.0, 2.0)
    sizes = [np.exp(rng.uniform(-2.0, 2.5, 400)) for _ in middles]
    passed = [rng.random(400) < 1.0 / (1.0 + (m / x) ** 3.0) for m, x in zip(middles, sizes, strict=True)]
    threshold, std = thresholds([list(x) for x in sizes], [list(p) for p in passed])
    true = np.log(np.multiply(middles, 9.0 ** (1.0 / 3.0)))
    assert threshold == pytest.approx(true, abs=0.3)
    assert np.all(np.abs(threshold - true) < 3.5 * std)
    assert np.all((std > 0.03) & (std < 0.3))
    assert len(thresholds([], [])[0]) == 0


def power_score(rig: Rig) -> Any:
    """Twenty cases of two effects: one is named from 4 N m on, the other one never."""
    rows = []
    for k in range(20):
        size = 0.5 * 1.25**k
        for name, key in (("friction_viscous", "viscous_n_s_per_m"), ("torque_offset", "offset_nm")):
            label = {
                "effects": [name], "parameters": {name: {key: 100.0 * size}}, "torque_change_rms_nm": size,
                "family": "yours", "kind": "hoist", "where": [],
            }  # fmt: skip
            right = name == "friction_viscous" and size > 4.0
            names = [name] if right else ["heave"]
            rows.append({"label": label, "word": "named", "names": names, "alike": [], "noise": 0.5})
    return SimpleNamespace(rows=rows, truth=SimpleNamespace(rig=json.loads(json.dumps(rig.said()))))


def test_the_power_is_the_size_from_which_nine_of_ten_are_named_and_what_never_is_says_so(rig: Rig):
    power = power_of(power_score(rig), {"friction_viscous": 0.5}, "the quickest one again")
    assert power is not None and power.unit == "N m"
    never, named = sorted(power.effects, key=lambda effect_power: effect_power.change is not None)
    assert (named.effect, named.parameter) == ("friction_viscous", "viscous_n_s_per_m")
    assert named.change and named.amount and named.interval and named.change_interval
    assert 4.0 < named.change < 10.0  # twenty cases do not say how sharp the edge at 4 is
    assert named.change_interval[0] < 5.0
    assert named.amount == pytest.approx(100.0 * named.change)
    assert named.one_more == pytest.approx(0.5 * named.amount)
    assert named.interval[0] < named.amount < named.interval[1]
    assert (never.effect, never.amount, never.interval) == ("torque_offset", None, None)
    assert "> 3470" in tables.power_table(power).by_column["named in 9 of 10 from"]
    assert (
        "the quickest one again, makes effects show at down to 50 % of these sizes" in tables.power_sentences(power)[0]
    )
    little = power_of(power_score(rig), {"friction_viscous": 0.99}, "another one")
    assert little is not None
    assert (
        "makes an effect show at a size that is smaller by more than 3 %; another one comes"
        in tables.power_sentences(little)[0]
    )
    drawn = tables.power(power.effects, power.unit)
    assert [trace.name for trace in drawn.data] == ["these runs", "with one more run", "not within the sizes tried"]
    few = power_score(rig)
    few.rows = few.rows[: 2 * LEAST - 2]
    none = power_of(few)
    assert none is not None and none.effects == ()
    few.truth.rig = None
    assert power_of(few) is None


def test_one_more_run_makes_smaller_effects_show(rig: Rig, monkeypatch: pytest.MonkeyPatch):
    """Two runs, and one of them again: noise alone gives 1/sqrt(2) at best, tolerances less."""
    short = replace(
        rig,
        runs=tuple(replace(run, reference=(run.reference or ())[:20_000], duration_s=20.0) for run in rig.runs[1:3]),
    )
    order = ordered(Asked(runs=DEMO, cases=1, case="none"), 5)[0][0]
    content = content_of(order, short)
    now = next_run.shows(content, order.seed)
    first, *others = next_run._trials(short)
    assert first.words.startswith("the quickest one")
    assert ("tension" in rig.logging.logs) != any(trial.logs for trial in others)
    then = next_run.shows(first.added_to(content), order.seed)
    both = [name for name in now if name in then and math.isfinite(now[name])]
    ratios = [then[name] / now[name] for name in both]
    assert len(both) > 15
    assert 0.3 < np.median(ratios) < 1.0


# What is computed once the seal is open


def test_the_recommended_run_is_driven_as_the_menu_has_it_by_the_same_machine(rig: Rig, tmp_path: Path):
    short = replace(rig, runs=tuple(cut(run, 20.0) for run in rig.runs[1:3]))
    content = content_of(ordered(Asked(runs=DEMO, cases=1, case="none"), 5)[0][0], short)
    make_campaign(tmp_path / "before", (5, 1), content)
    asked = {
        "payload_kg": 0.0, "profile": "designed", "signals": ["tension_dead_line_n"],
        "start_position": 6.0, "speed": 0.2,
        "moves": [{"by_m": 1.0}, {"by_m": -0.5}, {"by_m": 0.5}, {"by_m": -1.0}, {"by_m": 0.5}, {"by_m": -0.5}],
    }  # fmt: skip
    more = next_run.extended(content, asked, tmp_path / "before")
    assert more.drawn == content.drawn and more.runs[:-1] == content.runs
    assert "tension" in more.logging.logs
    last = more.runs[-1]
    assert last.payload_kg == 0.0 and last.start_time_s > content.runs[-1].start_time_s
    speed = np.array(last.reference)
    assert np.sum(np.diff(np.sign(speed[np.abs(speed) > 1e-3])) != 0) == 5  # up, back, up, down, back, down
    with pytest.raises(InputError, match="moves"):
        next_run.extended(content, {k: v for k, v in asked.items() if k != "moves"}, tmp_path / "before")


def cut(run: Any, length_s: float) -> Any:
    return replace(run, reference=(run.reference or ())[: round(1000 * length_s)], duration_s=length_s)


DECIDES = {"profile": "slow", "separation": 7.0, "now": 1.0}


def open_score(folder: Path) -> Any:
    """Three cases of which two are open; the second one's label says friction_viscous."""
    rows = []
    for k, effect in enumerate(("heave", "friction_viscous", "torque_offset")):
        label = {"effects": [effect], "where": [], "parameters": {}, "seed": [5, k], "torque_change_rms_nm": 5.0}
        rows.append(
            {
                "folder": f"{k:03d}", "label": label, "word": "unknown", "names": [], "alike": [], "noise": 0.5,
                "after": 1.0, "held_out": [], "next_run": DECIDES if k else None,
            }
        )  # fmt: skip
    said = {"number": 1, "seed": [5, 1], "source": "simulator", "family": "hoist_small", "case": "singles", "names": []}
    truth = SimpleNamespace(orders={row["folder"]: said for row in rows}, rig=None)
    score = SimpleNamespace(folder=folder, rows=tuple(rows), truth=truth)
    score.with_rows = lambda changed: SimpleNamespace(rows=tuple(changed))
    return score


def test_a_next_run_settles_an_open_case_where_the_answer_becomes_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked = []

    def anew(said: Any, rig: Any, row: Any) -> Answer:
        asked.append(row["folder"])
        open_still = DECIDES if row["folder"] == "000" else None
        return Answer("after", "named", names=("friction_viscous",), next_run=open_still)

    monkeypatch.setattr(next_run, "answered_with_next_run", anew)
    score = open_score(tmp_path)
    lines: list[str] = []

    def counted(scores: list[Any], most: int) -> Share:
        return tables.settled(later.with_next_runs(scores, most, 1, lines.append))

    assert counted([score], 9) == Share(1, 2)
    assert asked == ["001", "002"] and lines[0] == "1/2 next run of campaign 001: friction_viscous"
    assert counted([score], 9) == Share(1, 2)
    assert asked == ["001", "002"]  # what was answered is kept
    assert counted([score], 1) == Share(1, 1)
    score.rows[0].update(label=score.rows[1]["label"], next_run=DECIDES)
    assert counted([score, score], 2) == Share(2, 4)  # 000 is right, and open still
    score.rows[0].update(next_run={**DECIDES, "separation": 1.5})  # no run on the menu decides
    assert counted([score], 9) == Share(1, 2)


def test_the_true_effect_is_fitted_where_the_diagnosis_has_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def fitted(campaigns: Path, row: Any) -> Any:
        return {**row, "held_out": [[row["label"]["effects"], 0.8]]}

    monkeypatch.setattr(later, "fitted_truth", fitted)
    score = open_score(tmp_path)
    score.rows[0]["held_out"] = [[["heave"], 0.5]]
    rows = later.with_oracle(score, 1, lambda line: None).rows
    assert [of_the_oracle(row) for row in rows] == pytest.approx([0.5, 0.8, 0.8])
