"""A law in a formula: the form that made the data is found, its file gives what it promises, and noise has no law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.driven_campaign import driven, planned
from workbench.core.run import Run
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import Search
from workbench.diagnose.law import Law, find_law
from workbench.effects.loading import load_effects
from workbench.effects.registry import forget_users
from workbench.machines import LinearAxis, load_machine
from workbench.simulate.replay import replay_runs

AXIS = LinearAxis.model_validate(
    {
        "kind": "axis",
        "motion": "linear",
        "mass_kg": 95.0,
        "friction": {"coulomb_forward_n": 20.0, "coulomb_backward_n": 20.0, "viscous_n_s_per_m": 200.0},
        "tolerances": {"inertia": 0.01, "coulomb": 0.05, "viscous": 0.05, "force_gain": 0.005, "force_offset_n": 0.3},
    }
)
NOISE = {"force_n": 0.3, "velocity_m_s": 1e-5}
SPEEDS = (0.08, 0.15, 0.3)


def still() -> list[Run]:
    return [planned(AXIS, f"at_{speed:g}", 0.2, speed, 250.0) for speed in SPEEDS]


def fitted(runs: list[Run]) -> tuple[Problem, Fitted]:
    problem = Problem(AXIS, runs)
    search = Search(problem, [], base=base_parameters(AXIS, runs))
    return problem, search._within_tolerances(search.base_fit())


def law_of(force: dict[str, dict[str, float]]) -> tuple[Law | None, list[Run]]:
    runs = driven(AXIS.model_copy(update={"effects": force}), still(), NOISE)
    return find_law(*fitted(runs), "axis"), runs


@pytest.fixture(scope="module")
def drag() -> tuple[Law | None, list[Run]]:
    return law_of({"friction_quadratic": {"drag_n_s2_per_m2": 150.0}})


def test_a_drag_is_found_as_the_square_of_the_speed(drag: tuple[Law | None, list[Run]]):
    law, _ = drag
    assert law is not None
    assert law.formulas == ["v |v|"]
    (name, value, error, unit), *_ = law.values
    assert (name, unit) == ("c1", "N s²/m²")
    assert value == pytest.approx(150.0, abs=max(4.0 * error, 8.0))
    assert law.explains > 0.9


def test_the_file_of_a_law_replays_to_the_residual_that_was_stated(drag: tuple[Law | None, list[Run]], tmp_path: Path):
    law, runs = drag
    assert law is not None
    (tmp_path / "law.py").write_text(law.source)
    (tmp_path / "machine.yaml").write_text(law.machine)
    try:
        load_effects(tmp_path / "law.py")
        replayed = replay_runs(load_machine(tmp_path / "machine.yaml"), runs)
        without = replay_runs(AXIS, runs)
    finally:
        forget_users()
    assert replayed.residual_rms_moving < without.residual_rms_moving
    assert replayed.residual_rms_moving == pytest.approx(law.rms, rel=0.03)  # all samples, thinned samples
    assert law.after < 1.5 * law.rms


def test_noise_has_no_law():
    law, _ = law_of({})
    assert law is None or law.before - law.after < 0.1 * law.before


def test_a_step_over_place_is_found_where_it_lies():
    runs = driven(AXIS, still(), NOISE)
    where = 0.03
    forced = []
    for run in runs:
        position, velocity = run["position_m"], run["velocity_m_s"]
        extra = 12.0 * np.clip((position - where) / 0.004 + 0.5, 0.0, 1.0) * np.tanh(velocity / 0.002)
        forced.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + extra}))
    law = find_law(*fitted(forced), "axis")
    assert law is not None
    steps = [term for term in law.terms if "step" in term.formula[0] and "sign v" in term.formula[0]]
    assert steps
    assert steps[0].shape["x_0"] == pytest.approx(where, abs=0.01)


def test_a_mean_that_no_tolerance_holds_is_a_level_of_the_law():
    """Friction of 8 N on average, that comes and goes along the way, where the stated level holds to 1 N."""
    forced = []
    for run in driven(AXIS, still(), NOISE):
        extra = 8.0 * (1.0 + np.cos(2.0 * np.pi * run["position_m"] / 0.05)) * np.tanh(run["velocity_m_s"] / 0.002)
        forced.append(replace(run, signals={**run.signals, "force_n": run["force_n"] + extra}))
    law = find_law(*fitted(forced), "axis")
    assert law is not None
    assert "sign v" in law.formulas
    (wave,) = [term for term in law.terms if "d" in term.shape]
    assert wave.shape["d"] == pytest.approx(0.05, rel=0.01)
    assert max(law.amplitudes) == pytest.approx(8.0, rel=0.02) == law.amplitudes[law.formulas.index("sign v")]
    assert law.explains > 0.99
