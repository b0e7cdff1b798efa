"""What a diagnosis writes: the fixed keys of diagnosis.json, a machine that is accepted, a page, all or nothing."""

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

from tests.support.effect_machines import rotary_axis
from tests.support.made_diagnosis import KINDS, made_diagnosis
from workbench.cli.campaign import chosen_candidates
from workbench.core.errors import InputError
from workbench.core.record import LogTraits
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.location.where import Window
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Verdict
from workbench.effects import check
from workbench.effects.declare import SUBSYSTEMS
from workbench.machines import load_machine
from workbench.simulate.driven import InverseSimulation, pooled_rms
from workbench.view import diagnosis, diagnosis_figures
from workbench.view.diagnosis import save_diagnosis_page, write_diagnosis
from workbench.view.diagnosis_figures import series_of
from workbench.view.diagnosis_json import probabilities, to_json
from workbench.view.place import for_dark_ground, marked_machine

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


def with_verdict(d: Diagnosis, **changes: Any) -> Diagnosis:
    return dataclasses.replace(d, verdict=dataclasses.replace(d.verdict, **changes))


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


def test_a_named_effect_stands_with_its_parameters_and_errors():
    said = to_json(made_diagnosis("pair"))
    assert said["verdict"] == "named"
    assert said["effects"] == ["friction_viscous", "gearbox_inertia"]
    assert said["parameters"] == {
        "friction_viscous": {"viscous_n_s_per_m": {"value": 4210.0, "std_error": 126.3}},
        "gearbox_inertia": {"inertia_kg_m2": {"value": 0.31, "std_error": 0.0093}},
    }
    assert said["alike"] == ["carriage_mass_error"]
    assert said["next_run"]["payload_kg"] == 9000.0


@pytest.mark.parametrize("kind", ["no_gap", "unknown"])
def test_without_a_name_there_are_no_effects_and_no_parameters(kind: str):
    said = to_json(made_diagnosis(kind))
    assert (said["verdict"], said["effects"], said["parameters"]) == (kind, [], {})
    assert (said["where"] is None) == (kind == "no_gap")
    assert said["next_run"] is None


def test_a_rotary_axis_says_torque():
    d = made_diagnosis("axis")
    rotary = dataclasses.replace(d, campaign=dataclasses.replace(d.campaign, machine=rotary_axis()))
    assert list(to_json(rotary)["gap"])[:2] == ["torque_rms_nm", "noise_rms_nm"]


def test_what_is_no_finite_number_is_null():
    d = made_diagnosis("named")
    heave = next(candidate for candidate in to_json(d)["candidates"] if candidate["effects"] == ["heave"])
    assert heave["parameters"]["heave"]["phase_rad"] == {"value": [0.1, 2.2, 1.4], "std_error": [0.2, 0.2, None]}
    endless = dataclasses.replace(d, shrink=dataclasses.replace(d.shrink, factor=math.inf, ci95=(1.0, math.inf)))
    said = strict_json(to_json(endless))["shrink"]
    assert said["factor"] is None
    assert said["ci95"] == [1.0, None]


def test_numbers_have_five_digits_at_most():
    d = made_diagnosis("named")
    said = to_json(dataclasses.replace(d, gap=dataclasses.replace(d.gap, residual_rms=9.123456789)))
    assert said["gap"]["torque_rms_nm"] == 9.1235


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


@pytest.mark.parametrize("exact", [[], [0.0, 0.0], [math.nan, 1.0], [1.2, -0.2]])
def test_what_are_no_probabilities_is_refused(exact: list[float]):
    with pytest.raises(ValueError, match="add up to"):
        probabilities(exact)


@pytest.mark.parametrize("kind", KINDS)
def test_the_folder_holds_the_corrected_machine_the_numbers_and_the_page(kind: str, tmp_path: Path):
    d = made_diagnosis(kind)
    told: list[str] = []
    assert write_diagnosis(lambda: d, tmp_path / "out", told.append) is d
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "diagnose.html", "diagnosis.json", "machine.yaml",
    ]  # fmt: skip
    machine = load_machine(tmp_path / "out" / "machine.yaml", check_effects=check)
    assert machine.effects == d.corrected.effects
    assert machine.measured_correction == d.corrected.measured_correction
    assert (machine.measured_correction is not None) == (kind == "unknown")
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == d.verdict.word
    assert told == ["writing the report"]


def test_the_same_diagnosis_is_written_as_the_same_bytes(tmp_path: Path):
    for name in ("one", "two"):
        write_diagnosis(lambda: made_diagnosis("pair"), tmp_path / name)
    for file in ("diagnosis.json", "machine.yaml", "diagnose.html"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file


@pytest.mark.parametrize("stop", [KeyboardInterrupt, InputError("no such thing")])
def test_a_diagnosis_that_stops_leaves_nothing(stop: Any, tmp_path: Path):
    def run() -> Diagnosis:
        raise stop

    with pytest.raises((KeyboardInterrupt, InputError)):
        write_diagnosis(run, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_page_that_cannot_be_written_takes_the_numbers_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(d: Diagnosis, path: Path) -> None:
        path.write_text("half a page")
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnosis, "save_diagnosis_page", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_diagnosis(lambda: made_diagnosis("named"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_something_is_left_alone_before_any_work(tmp_path: Path):
    (tmp_path / "mine").write_text("kept")
    with pytest.raises(InputError, match="nothing is overwritten"):
        write_diagnosis(lambda: pytest.fail("diagnosed"), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


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
        "8. What changes in the control study", "9. The next run",
    ]  # fmt: skip
    places = [page.index(step) for step in steps]
    assert places == sorted(places)
    assert diagnosis.probability_sentence(d) in page
    assert ("measured_correction" in page) == (kind == "unknown")
    read = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"\b(nan|inf|None)\b", read)


def test_the_page_shows_what_changes_in_the_control_study(tmp_path: Path):
    d = made_diagnosis("named", with_consequences=True)
    assert d.consequences is not None
    page = page_of(d, tmp_path)
    assert d.consequences.sentences[3].replace("'", "&#39;") in page
    assert "torque peak per motor" in page


def test_a_candidate_that_broke_down_is_a_row_with_its_reason():
    row = next(row for row in diagnosis.candidates_table(made_diagnosis("named")).rows if row[0] == "backlash")
    assert row[-1] == "its fit broke down: ValueError: the step size fell to zero"
    assert row[1:6] == ["–"] * 5


@pytest.mark.parametrize(
    ("p", "said"),
    [
        (0.93, "of a hundred campaigns judged like this one, in about 93 "),
        (0.999, "of a hundred campaigns judged like this one, in more than 99 "),
        (0.003, "of a hundred campaigns judged like this one, in less than one "),
    ],
)
def test_a_probability_says_what_it_means(p: float, said: str):
    d = with_verdict(made_diagnosis("named"), ranking=(Hypothesis("named", ("friction_viscous",), p),))
    assert diagnosis.probability_sentence(d) == f"That probability means: {said}the missing physics would be just this."


def test_the_verdicts_section_says_what_speaks_for_another_cause_and_for_an_unknown_one(tmp_path: Path):
    assert '<p class="lead">What speaks against it:</p>' in page_of(made_diagnosis("named"), tmp_path)
    page = page_of(made_diagnosis("unknown"), tmp_path)
    assert "What speaks for a cause that the library does not hold:" in page
    assert "An unlisted effect explains more: friction_step. Weigh it among the candidates.</li>" in page


@pytest.mark.parametrize("kind", KINDS)
def test_the_parts_of_the_residual_add_up(kind: str):
    *parts, together = made_diagnosis(kind).table("parts").rows
    rms, share = (sum(float(row[k]) ** n for row in parts) for k, n in ((1, 2), (2, 1)))
    assert math.sqrt(rms) == pytest.approx(float(together[1]), rel=0.01)
    assert share == pytest.approx(float(together[2]), abs=0.03)


def test_a_report_without_a_gap_has_no_before_and_after(tmp_path: Path):
    d = made_diagnosis("no_gap")
    assert diagnosis.shrink_table(d).heads == ("held out", "residual N m", "times the noise")
    page = page_of(d, tmp_path)
    assert not re.search(r"\bbefore\b|After:|Yellow", page[page.index("7. Residual") :])


def test_a_gap_that_is_none_is_not_said_to_shrink():
    said = diagnosis.shrink_sentence(made_diagnosis("no_gap"))
    assert said.startswith("Nothing to shrink")
    assert "by a factor of" in diagnosis.shrink_sentence(made_diagnosis("named"))


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


def test_a_machine_that_was_not_changed_has_no_after():
    assert all(run.after is None and run.speed_after is None for run in series_of(made_diagnosis("no_gap")))


def test_of_many_runs_those_with_most_of_the_energy_are_drawn_in_the_campaigns_order():
    d = made_diagnosis("named")
    assert d.where is not None
    energy = {"empty": 0.5, "half": 0.1, "full": 0.4}
    d = dataclasses.replace(d, where=dataclasses.replace(d.where, energy_by_run=energy))
    assert [run.name for run in series_of(d, most=2)] == ["empty", "full"]


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
        np.testing.assert_allclose(drawn.after, alone.predicted, atol=0.02)
    assert ["heave", "phase_rad, run half", "2.00", "0.10"] in diagnosis.parameters_table(d).rows
    assert to_json(d)["parameters"]["heave"]["phase_rad"]["value"] == [0.3, 2.0, 4.5]


def test_candidates_are_checked_by_name():
    machine = made_diagnosis("named").campaign.machine
    assert chosen_candidates(None, machine) is None
    assert chosen_candidates("heave, torque_scale", machine) == ("heave", "torque_scale")
    every = chosen_candidates("all", machine)
    assert every is not None and {"heave", "friction_step"} <= set(every)
    for text, problem in (
        ("heav", r"^candidates: unknown effect 'heav'; did you mean 'heave'\?"),
        ("inertia_error", "unknown effect 'inertia_error'"),
        (" , ", "no effect is named"),
        ("heave,heave", "'heave' is named twice"),
    ):
        with pytest.raises(InputError, match=problem):
            chosen_candidates(text, machine)


def test_hypotheses_without_a_chance_share_one_bar():
    rows = [Hypothesis("named", ("heave",), 0.99), Hypothesis("unknown", (), 0.0099), Hypothesis("no_gap", (), 0.0)]
    rows += [Hypothesis("named", (name,), 2e-5) for name in ("torque_scale", "wire_mass", "torque_offset")]
    shown = diagnosis.ranking_table(rows, 8)
    assert [name for _, name, _ in shown] == ["heave", "unknown cause", "torque_scale", "3 more"]
    assert shown[-1][2] == pytest.approx(4e-5)


def test_a_row_of_the_ranking_has_the_names_of_its_twins():
    d = made_diagnosis("named")
    first, *rest = d.verdict.ranking
    twin = dataclasses.replace(first, twins=(("heave",),))
    d = dataclasses.replace(d, verdict=dataclasses.replace(d.verdict, ranking=(twin, *rest)))
    assert to_json(d)["ranking"][0]["twins"] == [["heave"]]
    assert diagnosis.ranking_table(d.verdict.ranking, 8)[0][1] == "friction_viscous or heave"
    stated = {row[0]: row[1] for row in diagnosis.candidates_table(d).rows}
    assert stated["heave"] == stated["friction_viscous"] == diagnosis_figures.percent(first.probability)


def test_only_what_was_fitted_or_broke_down_is_in_the_table():
    d = made_diagnosis("named")
    assert [row[0] for row in diagnosis.candidates_table(d).rows] == ["friction_viscous", "heave", "backlash"]
    assert [row[0] for row in diagnosis.candidates_table(d, brief=True).rows] == ["friction_viscous", "heave"]
    assert [candidate["effects"] for candidate in to_json(d)["candidates"]][2] == ["friction_stribeck"]


def test_the_next_run_is_a_row_with_its_signals():
    assert diagnosis.next_run_table(made_diagnosis("pair")).rows == [
        ["half speed, two reversals", "–", "9000", "tension_dead_line_n", "1.3", "7.4", "–", "–"]
    ]
    assert diagnosis.next_run_table(made_diagnosis("named")).rows == []


def test_of_many_windows_the_longest_are_listed_in_order_of_time():
    d = made_diagnosis("named")
    assert d.where is not None
    windows = [Window("half", float(k), k + (0.9 if k % 2 and k < 12 else 0.2)) for k in range(16)]
    d = dataclasses.replace(d, where=dataclasses.replace(d.where, windows=tuple(windows)))
    row = next(row for row in diagnosis.where_table(d).rows if row[0] == "half")
    assert row[2] == "1.0 to 1.9, 3.0 to 3.9, 5.0 to 5.9, 7.0 to 7.9, 9.0 to 9.9, 11.0 to 11.9; 10 shorter"
    assert len(to_json(d)["where"]["windows"]) == 16


def test_a_name_less_likely_than_not_says_how_likely_any_name_is():
    rows = (Hypothesis("named", ("heave",), 0.3), Hypothesis("named", ("wire_mass",), 0.25))
    d = with_verdict(made_diagnosis("named"), effects=("heave",), ranking=(*rows, Hypothesis("no_gap", (), 0.45)))
    assert diagnosis.probability_sentence(d).endswith("In about 55 some effect would be missing, this one or another.")


def test_a_gap_that_stays_is_said_to_stay():
    d = made_diagnosis("unknown")
    d = dataclasses.replace(d, shrink=dataclasses.replace(d.shrink, after=d.shrink.before, factor=1.0))
    assert diagnosis.shrink_sentence(d).startswith("It does not shrink: ")


@pytest.mark.parametrize("kind", ["named", "unknown", "no_gap"])
def test_the_plain_summary_names_no_effect_by_its_key_and_gives_the_size(kind: str):
    d = made_diagnosis(kind)
    said = " ".join(diagnosis.plain_summary(d))
    assert "_" not in said
    assert diagnosis.figures(d.shrink.after if kind != "unknown" else d.shrink.before) in said


def test_the_plain_summary_says_what_looks_the_same_in_these_runs():
    d = with_verdict(made_diagnosis("named"), alike=("heave",))
    assert "or what looks the same in these runs: " in diagnosis.plain_summary(d)[-1]
    assert "looks the same" not in " ".join(diagnosis.plain_summary(with_verdict(d, alike=())))


@pytest.mark.parametrize("subsystem", SUBSYSTEMS)
def test_every_place_of_a_gap_is_marked_once_on_the_drawing(subsystem: str):
    d = made_diagnosis("named")
    drawn = fromstring(marked_machine(d.campaign.machine, subsystem, d.shrink))
    named = [text.text for text in drawn.iter() if text.get("font-weight") == "bold"]
    assert named == [subsystem.removesuffix("_sensor")]


def luminance(colour: str) -> float:
    """Relative, of #rrggbb or white (WCAG 2.2)."""
    digits = "ffffff" if colour == "white" else colour.removeprefix("#")
    parts = [int(digits[i : i + 2], 16) / 255.0 for i in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_words_of_the_drawing_can_be_read_on_its_ground(dark: bool):
    d = made_diagnosis("named")
    svg = marked_machine(d.campaign.machine, "guide", d.shrink)
    drawn = fromstring(for_dark_ground(svg) if dark else svg)
    ground = luminance(drawn.findall("{*}rect")[0].get("fill", ""))
    for text in drawn.findall("{*}text"):
        light, ink = sorted([ground, luminance(text.get("fill", ""))], reverse=True)
        assert (light + 0.05) / (ink + 0.05) > 4.5, text.text
    assert (ground < 0.1) is dark


def test_the_bars_below_the_drawing_are_as_long_as_the_residuals():
    d = made_diagnosis("named")
    drawn = fromstring(marked_machine(d.campaign.machine, "guide", d.shrink))
    before, after, noise = (float(bar.get("width", "")) for bar in drawn.findall("{*}rect")[-3:])
    assert before == pytest.approx(170.0)
    assert [after / before, noise / before] == pytest.approx(
        [d.shrink.after / d.shrink.before, d.shrink.noise / d.shrink.before], abs=1e-3
    )
