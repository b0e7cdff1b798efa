"""`workbench identify`: finds what a simulated machine has, says how sure it is, writes a machine that is accepted."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.simulated_campaign import simulated_campaign, true_machine
from workbench import __version__
from workbench.identify.identify import Identification, identify
from workbench.logs import Campaign, read_campaign
from workbench.machines import Hoist, default_hoist, get_value, load_machine, value_names
from workbench.machines.kinds.hoist import guide_friction
from workbench.view.identify import force_balance, law, sentences

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("identify") / "lifts")


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return read_campaign(folder)


@pytest.fixture(scope="module")
def identified(campaign: Campaign) -> Identification:
    return identify(campaign, date="2026-01-02T03:04:05+00:00")


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """--out of one identification in a process of its own."""
    out = tmp_path_factory.mktemp("written") / "out"
    done = subprocess.run(
        [sys.executable, "-m", "workbench", "identify", folder, "--out", out],
        cwd=ROOT, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "80"},
    )  # fmt: skip
    assert done.stderr == ""
    assert f"Machine: {out / 'machine.yaml'}" in done.stdout
    return out


def test_the_identified_machine_leaves_only_noise(identified: Identification):
    assert identified.before.residual_rms_moving > 5.0 * identified.before.noise_rms
    assert identified.after.residual_rms_moving < 1.2 * identified.after.noise_rms
    assert identified.after.speed_rmse_percent < 0.3 < identified.before.speed_rmse_percent


def test_written_machine_is_the_identified_one_with_its_record(written: Path, identified: Identification):
    machine = load_machine(written / "machine.yaml")
    assert isinstance(machine, Hoist)
    for key, value in identified.fit.values().items():
        assert get_value(machine, key) == pytest.approx(value, rel=1e-6)
    untouched = set(value_names(default_hoist())) - set(identified.fit.values())
    assert all(get_value(machine, key) == get_value(default_hoist(), key) for key in untouched)
    record: Any = machine.identified
    assert record["campaign"] == "lifts"
    assert record["runs"] == ["empty", "half", "full"]
    assert record["version"] == __version__
    assert "date" not in record  # the same runs, the same bytes
    assert set(record["parameters"]) == set(identified.fit.values())
    assert all(entry["std_error"] > 0.0 for entry in record["parameters"].values())


def test_the_balance_of_the_log_shows_the_true_friction_whatever_machine_looks(campaign: Campaign):
    """All but the levels nominal: the balance's points lie on the true law, though the machine's own is another."""
    from workbench.simulate.replay import replay_runs

    speed, force = force_balance(default_hoist(), replay_runs(default_hoist(), campaign.runs))
    fast = np.abs(speed) > 0.2
    true = law(true_machine(), speed[fast])
    assert abs(np.mean(force[fast] / true) - 1.0) < 0.02
    assert np.max(np.abs(law(default_hoist(), np.array([0.5])) - guide_friction(0.5, _plant_values()))) == 0.0


def _plant_values() -> Any:
    from workbench.machines import plant_of

    return plant_of(default_hoist()).values(default_hoist())


def test_a_value_far_off_or_a_residual_above_the_noise_leads_to_diagnose(
    campaign: Campaign, identified: Identification
):
    assert not any("diagnose" in sentence for sentence in sentences(identified))
    free, value = identified.fit.free[0], list(identified.fit.value)
    assert free.prior_std is not None and not free.logarithmic
    value[0] = free.nominal + 7.0 * free.scale * free.prior_std
    far = replace(identified, fit=replace(identified.fit, value=tuple(value)))
    assert far.fit.tolerances_off()[0] == pytest.approx(7.0)
    assert sentences(far)[-1] == (
        "A value is 7 tolerances off: the model may lack something; `workbench diagnose` names what."
    )
    above = replace(identified, after=replace(identified.after, residual_rms_moving=2.0 * identified.after.noise_rms))
    assert sentences(above)[-1].startswith("The residual while moving is 2.0 times the noise: the model may lack")
