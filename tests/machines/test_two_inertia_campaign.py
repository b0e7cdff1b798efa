"""A campaign of two inertias goes through the commands as any other: read, replayed, identified, checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.driven_campaign import driven, planned, write
from tests.support.effect_machines import MACHINES
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.diagnose.readiness.checks import check_runs
from workbench.identify.identify import identify
from workbench.logs import read_campaign
from workbench.machines import with_values

NOMINAL = MACHINES["two_inertia"]
TRUE = {"load.inertia_kg_m2": 0.056, "coupling.stiffness_nm_per_rad": 760.0}
NOISE = {"torque_nm": 0.05, "speed_rad_s": 0.005, "angle_rad": 1e-5}


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    motions = [planned(NOMINAL, "slow", 3.0, 3.0), planned(NOMINAL, "fast", 12.0, 20.0)]
    return driven(with_values(NOMINAL, TRUE), motions, NOISE)


@pytest.fixture(scope="module")
def campaign(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("two") / "two", NOMINAL, runs)


def test_identification_finds_load_and_coupling_within_their_errors(campaign: Path):
    identified = identify(read_campaign(campaign))
    at = {free.key: number for number, free in enumerate(identified.fit.free)}
    for key, true in TRUE.items():
        value, error = identified.fit.value[at[key]], identified.fit.std_error[at[key]]
        assert value == pytest.approx(true, rel=0.005)
        assert abs(value - true) < 4.0 * error
    assert identified.after.residual_rms_moving < 1.3 * identified.after.noise_rms
    assert identified.before.residual_rms_moving > 10.0 * identified.before.noise_rms


def test_a_load_side_that_turns_the_other_way_is_refused(runs: list[Run], tmp_path: Path):
    flipped = [replace(run, signals={**run.signals, "angle_load_rad": -run["angle_rad"]}) for run in runs]
    folder = write(tmp_path / "flipped", NOMINAL, flipped)
    with pytest.raises(InputError, match=r"slow: angle_load_rad goes -1 times the way of angle_rad"):
        check_runs(read_campaign(folder))


def test_play_is_seen_in_the_motors_torque_and_gone_with_its_effect():
    motion = [planned(NOMINAL, "middle", 6.0, 8.0)]
    worn = NOMINAL.model_copy(update={"effects": {"backlash": {"play_share": 1.0, "play_rad": 0.02}}})
    taken, plain = (driven(machine, motion, {})[0]["torque_nm"] for machine in (worn, NOMINAL))
    assert np.sqrt(np.mean((taken - plain) ** 2)) > 0.3
    both = driven(with_values(NOMINAL, {"coupling.backlash_rad": 0.02}), motion, {})[0]["torque_nm"]
    assert taken == pytest.approx(both, abs=1e-3 * float(np.max(np.abs(both))))
