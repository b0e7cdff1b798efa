"""The runs under the machine before and after its correction, as the figures over time take them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.records import Diagnosis
from workbench.figures.diagnose_time import RunSeries
from workbench.machines import Axis, Hoist, plant_of
from workbench.reports.replay.page import stretches
from workbench.simulate.driven import Balance, Bench, changed
from workbench.simulate.replay import simulate_replays

MOST_RUNS = 12  # that are drawn, those with most of the gap's energy
Own = Mapping[str, tuple[float, ...]]  # symbol -> a value for each run


def series_of(d: Diagnosis, most: int = MOST_RUNS) -> tuple[RunSeries, ...]:
    """Balances and open-loop replays of the refitted machine and, where it differs, of the corrected one.

    At most `most` runs: those with the largest energy of the gap, in the order of the campaign.
    """
    before = _under(d, d.refitted, {})
    after = None if d.corrected == d.refitted else _under(d, d.corrected, own_values(d))
    windows = () if d.where is None else d.where.windows
    energy = {} if d.where is None else d.where.energy_by_run
    kept = sorted(range(len(before)), key=lambda j: -energy.get(before[j][0].run.name, 0.0))[:most]
    series = []
    for j in sorted(kept):
        balance, scale, speed = before[j]
        name, time = balance.run.name, balance.run.time_s
        one = RunSeries(
            name,
            time,
            balance.measured,
            balance.predicted,
            None,
            100.0 * balance.motion.speed / scale,
            100.0 * speed / scale,
            None,
            balance.moving,
            tuple((w.from_s, w.to_s) for w in windows if w.run == name),
            stretches(time, ~balance.moving),
            f"{100.0 * energy[name]:.0f} % of the gap's energy" if name in energy else "",
        )
        if after is not None:
            corrected, scale, speed = after[j]
            one = replace(one, after=corrected.predicted, speed_after=100.0 * speed / scale)
        series.append(one)
    return tuple(series)


def own_values(d: Diagnosis) -> Own:
    """Values of the chosen hypothesis that differ from run to run; machine.yaml has those of the first run."""
    chosen = next((c for c in d.candidates if set(c.effects) == set(d.verdict.effects)), None)
    if chosen is None or d.verdict.word != "named":
        return {}
    return {
        f"{effect}__{one.name}": one.value
        for effect, estimates in chosen.parameters.items()
        for one in estimates
        if isinstance(one.value, tuple) and len(one.value) == len(d.campaign.runs)
    }


def _under(d: Diagnosis, machine: Hoist | Axis, own: Own) -> list[tuple[Balance, float, Array]]:
    """For each run its torque balance, the scale of speeds, and the speed of the open-loop replay."""
    bench = Bench(machine, d.campaign.runs, d.gap.band_hz)
    bench.base = [changed(p, {key: values[j] for key, values in own.items()}) for j, p in enumerate(bench.base)]
    states = simulate_replays(machine, bench)
    column = len(plant_of(machine).positions)  # the driven speed stands first behind the positions
    return [
        (balance, bench.scale, np.asarray(out[:, column]))
        for balance, out in zip(bench.balances(), states, strict=True)
    ]
