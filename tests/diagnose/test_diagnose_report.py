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
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Verdict
from workbench.effects.declare import SUBSYSTEMS
from workbench.simulate.driven import InverseSimulation, pooled_rms
from workbench.view import diagnosis
from workbench.view.diagnosis import save_diagnosis_page
from workbench.view.diagnosis_figures import series_of
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
        np.testing.assert_allclose(drawn.after, alone.predicted, atol=0.02)
    assert ["heave", "phase_rad, run half", "2.00", "0.10"] in diagnosis.parameters_table(d).rows
    assert to_json(d)["parameters"]["heave"]["phase_rad"]["value"] == [0.3, 2.0, 4.5]


@pytest.mark.parametrize("subsystem", SUBSYSTEMS)
def test_every_place_of_a_gap_is_marked_once_on_the_drawing(subsystem: str):
    d = made_diagnosis("named")
    drawn = fromstring(marked_machine(d.campaign.machine, subsystem, d.shrink))
    named = [text.text for text in drawn.iter() if text.get("font-weight") == "bold"]
    assert named == [subsystem.removesuffix("_sensor")]
