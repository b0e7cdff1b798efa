"""What the report says of where a gap lies, held against the machine that the runs were simulated on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.simulated_campaign import simulated_campaign
from workbench.diagnose.diagnose import diagnose
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.simulate.driven import InverseSimulation
from workbench.view.diagnosis import where_sentence

TRUTHS = {
    "friction_viscous": {"viscous_n_s_per_m": 4210.0},
    "friction_position_dependent": {"peak_n": 5000.0, "centre_m": 9.8, "width_m": 0.3},
}


@pytest.mark.parametrize("effect", TRUTHS)
def test_the_windows_hold_the_stated_share_of_what_the_true_effect_takes(effect: str, tmp_path: Path):
    """The true effect's torque is that of two machines under the logged motion, with and without it: no fit."""
    machine = default_hoist()
    truth = machine.model_copy(update={"effects": {effect: TRUTHS[effect]}})
    campaign = read_campaign(simulated_campaign(tmp_path / "lifts", truth))
    d = diagnose(campaign, candidates=(effect, "gearbox_inertia"), most_effects=1, study=False)
    assert d.verdict.effects == (effect,) and d.where is not None
    ill, well = (InverseSimulation(m, campaign.runs, d.gap.band_hz).balances() for m in (truth, machine))
    inside = total = 0.0
    for run, one, other in zip(campaign.runs, ill, well, strict=True):
        energy = np.where(one.moving, (one.predicted - other.predicted) ** 2, 0.0)
        mine = [w for w in d.where.windows if w.run == run.name]
        marked = np.any([(run.time_s >= w.from_s) & (run.time_s <= w.to_s) for w in mine] or [run.time_s < 0.0], axis=0)
        inside, total = inside + float(energy[marked].sum()), total + float(energy.sum())
    low, high = d.where.interval
    assert low - 0.05 <= inside / total <= high + 0.05
    assert f"{100.0 * d.where.share:.0f} % of the gap's energy" in where_sentence(d)
    assert abs(inside / total - d.where.share) < 0.1
