"""One run that is not like the others is named: a wrong payload, swapped signals; and sound runs are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.logs import Campaign, read_campaign
from workbench.machines import default_hoist

VISCOUS = {"friction_viscous": {"viscous_n_s_per_m": 4210.0}}


@cache
def six_runs() -> Campaign:
    """Three payloads, twice, with noise of their own."""
    machine = default_hoist().model_copy(update={"effects": VISCOUS})
    with TemporaryDirectory() as folder:
        first, second = (read_campaign(simulated_campaign(Path(folder) / str(k), machine, seed=k)) for k in (3, 4))
    again = tuple(replace(run, name=f"{run.name} again") for run in second.runs)
    return replace(first, runs=(*first.runs, *again))


def changed(name: str, **fields: object) -> Campaign:
    campaign = six_runs()
    runs = tuple(replace(run, **fields) if run.name == name else run for run in campaign.runs)  # type: ignore[arg-type]
    return replace(campaign, runs=runs)


def diagnosed(campaign: Campaign) -> Diagnosis:
    return diagnose(campaign, candidates=("friction_viscous",), quick=True)


def run_of(name: str) -> Run:
    return next(run for run in six_runs().runs if run.name == name)


def test_of_sound_runs_none_is_named_and_of_a_wrong_payload_that_run_is():
    sound = diagnosed(six_runs())
    assert not any("runs agree" in warning for warning in sound.warnings)
    assert not any(run.differs for run in sound.delivered.runs)
    wrong = diagnosed(changed("full again", payload_kg=0.85 * run_of("full again").payload_kg))
    (said,) = [warning for warning in wrong.warnings if "runs agree" in warning]
    assert said.startswith("5 runs agree; full again holds")
    assert [run.name for run in wrong.delivered.runs if run.differs] == ["full again"]


def test_swapped_motors_change_nothing_for_their_sum_drives_the_machine():
    signals = dict(run_of("half").signals)
    one, two = signals["torque_motor1_nm"], signals["torque_motor2_nm"]
    swapped = changed("half", signals=signals | {"torque_motor1_nm": two, "torque_motor2_nm": one})
    assert diagnosed(swapped).delivered == diagnosed(six_runs()).delivered


def test_torque_and_speed_in_each_others_column_are_refused_with_the_run():
    signals = dict(run_of("half").signals)
    torque, speed = signals["torque_motor_nm"], signals["speed_motor_rad_s"]
    swapped = signals | {"torque_motor_nm": speed, "speed_motor_rad_s": torque}
    with pytest.raises(InputError, match="half"):
        diagnosed(changed("half", signals=swapped))
