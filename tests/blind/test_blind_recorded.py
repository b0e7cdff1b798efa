"""Recorded machines as blind campaigns: what is bent is what the label says, and nothing else is."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from tests.support.commands import Commands
from tests.support.emps_campaign import emps_in
from workbench.blind import make as making
from workbench.blind.recorded import SINGLES, bent
from workbench.blind.recording import Recording, recording, rms
from workbench.blind.seal import key_of, read_manifest, unseal
from workbench.logs import read_campaign

SEED = (5, 1)
ON_AXES = [name for name in SINGLES if name not in ("payload", "load")]


@pytest.fixture(scope="module")
def emps(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "emps"
    return emps_in(folder, shared_data, mass=50.0, coulomb=10.0, viscous=50.0, offset=0.0)


@cache
def known_of(folder: Path) -> Recording:
    return recording(folder)


def explained(known: Recording, name: str) -> tuple[float, float]:
    """rms that the bent machine leaves, and that it leaves with the label's effect, over that of the identified one."""
    found = bent(name, SEED, known)
    assert found is not None, name
    made, _ = found
    with_effect = made.machine.model_copy(update={"effects": {made.entry: dict(made.parameters)}})
    residuals = [known.residual(machine, made.runs) for machine in (made.machine, with_effect)]
    return rms(residuals[0]) / known.remainder_rms, rms(residuals[1]) / known.remainder_rms


@pytest.mark.parametrize("name", [*ON_AXES, "step", "quadratic", "periodic"])
def test_with_what_the_label_says_the_bent_axis_leaves_what_the_machine_does(emps: Path, name: str):
    before, after = explained(known_of(emps), name)
    assert before > 1.1
    assert abs(after**2 - 1.0) < 0.2 * (before**2 - 1.0)


# Half of one level is taken up there by both levels' tolerances of 15 % with those of the mass and of the offset.
@pytest.mark.parametrize("name", [name for name in SINGLES if name not in ("drift", "coulomb_one_way")])
def test_with_what_the_label_says_the_bent_hoist_leaves_what_the_machine_does(shared_data: Path, name: str):
    before, after = explained(known_of(shared_data / "campaigns" / "20"), name)
    assert before > 1.1
    assert abs(after**2 - 1.0) < 0.2 * (before**2 - 1.0)


def test_a_pendulum_logged_with_noise_is_identified_in_a_band_that_holds_its_inertia(shared_data: Path):
    """Plain least squares: 0.182 kg m^2 and 3.56 N m; in the usual band the noise draws the inertia to half of it."""
    known = known_of(shared_data / "real" / "geared_pendulum")
    assert known.machine.inertia_kg_m2 == pytest.approx(0.182, rel=0.03)
    assert known.machine.gravity.sine_nm == pytest.approx(3.56, rel=0.03)


def test_a_gain_is_alike_with_inertia_and_friction_together(emps: Path):
    known = known_of(emps)
    found = bent("gain", SEED, known)
    assert found is not None
    assert any(
        name.startswith("friction_") and "inertia_error" in name for name in known.alike("torque_scale", found[1])
    )
    inertia = bent("inertia", SEED, known)
    assert inertia is not None
    assert not known.alike("inertia_error", inertia[1])


def test_the_command_makes_campaigns_that_tell_nothing_of_the_truth(
    emps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(making, "recording", known_of)  # what the other tests have identified
    out = tmp_path / "sealed"
    words = ("--source", "recorded", "--runs", emps, "--cases", "3", "--seed", "11", "--processes", "1")
    done = Commands(capsys)("blind", "make", "--out", out, *words)
    assert done.status == 0, done.err
    truth = unseal(out, read_manifest(out), key_of(out))
    for name, label in truth.labels.items():
        campaign = read_campaign(out / "campaigns" / name)
        assert len(campaign.runs) >= 3
        assert not campaign.machine.identified
        assert label["source"] == "recorded"
        assert label["family"] == "emps"
        assert not any(word in (out / "manifest.json").read_text() for word in label["effects"])
    assert json.loads((out / "manifest.json").read_text())["asked"]["runs"] == "emps"
