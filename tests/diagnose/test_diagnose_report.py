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

from tests.support.made_diagnosis import KINDS, made_diagnosis
from workbench.core.record import LogTraits
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Verdict
from workbench.effects import check
from workbench.effects.declare import SUBSYSTEMS
from workbench.machines import load_machine
from workbench.simulate.driven import InverseSimulation, pooled_rms
from workbench.view import diagnosis
from workbench.view.diagnosis import save_diagnosis_page, write_diagnosis
from workbench.view.diagnosis_figures import ALL, RunSeries, residuals, series_of, shrink_bars
from workbench.view.diagnosis_json import probabilities, to_json
from workbench.view.film import marked_machine
from workbench.view.style import AFTER, BEFORE, REST, WINDOW

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


@pytest.mark.parametrize("kind", ["no_gap", "unknown"])
def test_without_a_name_there_are_no_effects_and_no_parameters(kind: str):
    said = to_json(made_diagnosis(kind))
    assert (said["verdict"], said["effects"], said["parameters"]) == (kind, [], {})
    assert (said["where"] is None) == (kind == "no_gap")
    assert said["next_run"] is None


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


def test_a_page_that_cannot_be_written_takes_the_numbers_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(d: Diagnosis, path: Path) -> None:
        path.write_text("half a page")
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnosis, "save_diagnosis_page", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_diagnosis(lambda: made_diagnosis("named"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


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


@pytest.mark.parametrize("kind", ["named", "unknown", "no_gap"])
def test_the_plain_summary_names_no_effect_by_its_key_and_gives_the_size(kind: str):
    d = made_diagnosis(kind)
    said = " ".join(diagnosis.plain_summary(d))
    assert "_" not in said
    assert diagnosis.figures(d.shrink.after if kind != "unknown" else d.shrink.before) in said


@pytest.mark.parametrize("subsystem", SUBSYSTEMS)
def test_every_place_of_a_gap_is_marked_once_on_the_drawing(subsystem: str):
    d = made_diagnosis("named")
    drawn = fromstring(marked_machine(d.campaign.machine, subsystem, d.shrink))
    named = [text.text for text in drawn.iter() if text.get("font-weight") == "bold"]
    assert named == [subsystem.removesuffix("_sensor")]


# The figures of a diagnosis carry the data they are given, with units, and one colour for before and after.


TIME = np.linspace(0.0, 10.0, 401)


def series(name: str = "half", after: bool = True, size: float = 5.0) -> RunSeries:
    measured = 300.0 + size * np.sin(TIME)
    moving = (TIME > 1.0) & (TIME < 9.0)
    return RunSeries(
        name, TIME, measured, measured - size * np.cos(TIME), measured - 0.1 if after else None,
        np.sin(TIME), 1.1 * np.sin(TIME), np.sin(TIME) if after else None, moving,
        ((2.0, 3.5),), ((0.0, 1.0), (9.0, 10.0)), "60 % of the gap's energy",
    )  # fmt: skip


def traces(figure: Any, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


def shaded(figure: Any, colour: str) -> list[tuple[float, float]]:
    return [(shape.x0, shape.x1) for shape in figure.layout.shapes if shape.fillcolor == colour]


def titles(figure: Any) -> list[str]:
    return [axis.title.text for axis in [*figure.select_xaxes(), *figure.select_yaxes()] if axis.title.text]


def test_the_residual_stands_before_and_after_with_noise_windows_and_rests():
    figure = residuals([series()], "N m", noise_rms=0.6)
    (before,), (after,) = traces(figure, "before"), traces(figure, "after")
    assert (before.line.color, after.line.color) == (BEFORE, AFTER)
    going = (before.x > 1.0) & (before.x < 9.0)
    np.testing.assert_allclose(before.y[going], 5.0 * np.cos(before.x[going]), atol=1e-4)
    assert np.isnan(before.y[~going]).all() and before.x[going][[0, -1]] == pytest.approx([1.0, 9.0], abs=0.06)
    np.testing.assert_allclose(after.y[(after.x > 1.0) & (after.x < 9.0)], 0.1, atol=1e-4)
    assert shaded(figure, WINDOW) == [(2.0, 3.5)]
    assert shaded(figure, REST) == [(0.0, 1.0), (9.0, 10.0)]
    assert [shape.y0 for shape in figure.layout.shapes if shape.type == "line"] == [1.2, -1.2]
    assert "torque residual (N m)" in titles(figure)


def test_shrink_has_two_bars_a_run_and_the_noise_floor():
    figure = shrink_bars({"slow": (9.0, 0.8), "fast": (11.0, 0.7)}, (10.0, 0.75), 0.6, "N m")
    (before,), (after,) = traces(figure, "before"), traces(figure, "after")
    assert list(before.x) == ["slow", "fast", f"<b>{ALL}</b>"]
    assert list(before.y) == [9.0, 11.0, 10.0]
    assert list(after.y) == [0.8, 0.7, 0.75]
    assert (before.marker.color, after.marker.color) == (BEFORE, AFTER)
    (floor,) = figure.layout.shapes
    assert (floor.y0, floor.y1, floor.line.dash) == (0.6, 0.6, "5px,4px")
    assert figure.data[2].name == "noise floor, 0.6 N m"
    assert figure.layout.yaxis.range[1] > 11.0
