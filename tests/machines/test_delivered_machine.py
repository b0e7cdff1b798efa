"""A machine as a diagnosis delivers it, with allowances and a log, goes through what takes machines."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.core.errors import InputError
from workbench.effects import of
from workbench.machines import default_hoist, load_machine, save_machine, value_names
from workbench.machines.kinds.hoist import Hoist

DELIVERED = Hoist.model_validate(
    default_hoist().model_dump()
    | {
        "effects": {"heave": {"amplitude_m": 0.1, "frequency_rad_s": 0.9, "phase_rad": 1.0}},
        "allowances": {"friction_viscous": {"viscous_n_s_per_m": 28.0}},
        "log": {"speed_late_s": 0.004, "of_runs": {"full": {"heave": {"phase_rad": 2.0}}}},
    }
)


def test_it_is_saved_and_read_back(tmp_path: Path):
    save_machine(DELIVERED, tmp_path / "machine.yaml")
    assert load_machine(tmp_path / "machine.yaml") == DELIVERED


def test_allowances_and_the_logs_lateness_are_at_work_as_effects_are():
    values = of(DELIVERED).values_of(0.0)
    assert values["friction_viscous__viscous_n_s_per_m"] == 28.0
    assert values["speed_delay__delay_s"] == pytest.approx(0.004)
    assert not any(name.startswith("log.") for name in value_names(DELIVERED))


def test_a_run_has_its_own_values_and_every_other_run_the_machines():
    active = of(DELIVERED)
    assert active.values_of(0.0, "full")["heave__phase_rad"] == 2.0
    assert active.values_of(0.0, "empty")["heave__phase_rad"] == 1.0


def test_a_runs_own_value_of_an_effect_that_is_not_there_is_one_error():
    log = DELIVERED.log.model_copy(update={"of_runs": {"full": {"haeve": {"phase_rad": 2.0}}}})
    with pytest.raises(InputError, match=r"haeve is no effect of this machine.*heave"):
        of(DELIVERED.model_copy(update={"log": log}))
