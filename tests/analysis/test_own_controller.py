"""State-space systems of plant and loop, and a controller written as a Python function around the sampled plant."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import workbench as wb

DOCS = Path(__file__).resolve().parents[2] / "docs" / "loop_design.md"


def test_the_systems_are_those_of_the_loop_whose_margins_are_shown():
    control = pytest.importorskip("control")
    analysis = wb.loop(payloads_kg=[9000.0], heights_m=[10.0])
    gain, phase, *_ = control.stability_margins(control.frd(analysis.open, np.geomspace(0.1, 3100.0, 20000)))
    shown = analysis.weakest.margins
    assert gain == pytest.approx(shown.gain_up, rel=1e-4) and phase == pytest.approx(shown.phase_deg, abs=1e-2)
    assert np.abs(analysis.closed.poles()).max() < 1.0
    assert analysis.closed.input_labels == ["speed_reference", "load_torque", "speed_noise"]


def test_closing_the_plant_by_hand_gives_the_closed_loop():
    control = pytest.importorskip("control")
    analysis = wb.loop(payloads_kg=[9000.0], heights_m=[10.0])
    K = analysis.members[0].loop.controller
    feedback = control.ss(K.A, K.B[:, [1]], K.C, K.D[:, [1]], K.dt)
    seen = analysis.plant[[analysis.plant.noutputs - 1], [0]]
    by_hand = control.feedback(seen, feedback, sign=1)
    ours = np.sort_complex(analysis.closed.poles())
    np.testing.assert_allclose(np.sort_complex(by_hand.poles()), ours, atol=1e-6)


def test_the_controller_of_the_docs_follows_within_a_rad_per_second(capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("control")
    (code,) = re.findall(r"```python\n(import control.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    names: dict[str, object] = {}
    exec(code, names)
    error = float(re.search(r"error ([\d.]+) rad/s", capsys.readouterr().out)[1])  # type: ignore[index]
    assert error < 1.0
    assert np.asarray(names["speed"])[3400] == pytest.approx(60.0, abs=0.05)
