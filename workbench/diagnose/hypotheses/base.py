"""The base parameters: what a nominal machine may honestly be off by, each held by its tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.diagnose.hypotheses.knobs import GAIN, LOG_TIMING, OFFSET, TENSION_GAIN, Value
from workbench.identify.parameters import free_parameters
from workbench.machine import Axis, Hoist, get_value
from workbench.plants import plant_of
from workbench.run import Run

STANDSTILL_STD = math.log(10.0)  # nobody knows how friction turns over at standstill: a factor of ten either way

LOAD_CELL_STD = 0.005  # of a dead line's load cell: its gain


def base_knobs(machine: Hoist | Axis, runs: Sequence[Run]) -> dict[str, Value]:
    """Key of machine.yaml -> knob. What has no tolerance at all stays at its nominal value."""
    if isinstance(machine, Hoist):
        found = {}
        for free in free_parameters(machine, runs):
            symbol = free.symbol or (GAIN if free.key.endswith("gain") else OFFSET)
            if free.prior_std is not None:
                least = 0.0 if free.logarithmic else free.lowest
                found[free.key] = Value(
                    symbol, free.nominal, free.scale, least, std=free.prior_std, logarithmic=free.logarithmic
                )
        if all("tension_dead_line_n" in run for run in runs):
            found[TENSION_GAIN] = Value(TENSION_GAIN, 1.0, LOAD_CELL_STD, std=1.0)
        return found
    return _axis(machine, runs)


def _axis(machine: Axis, runs: Sequence[Run]) -> dict[str, Value]:
    tolerances = machine.tolerances  # type: ignore[attr-defined]
    largest = max(float(np.max(np.abs(run[machine.input_signal]))) for run in runs)
    relative = {
        "inertia": tolerances.inertia,
        "viscous": tolerances.viscous,
        "coulomb_forward": tolerances.coulomb,
        "coulomb_backward": tolerances.coulomb,
        "gravity_sine": tolerances.gravity,
        "gravity_constant": tolerances.gravity,
        "gain": machine.role("gain_tolerance"),
    }
    symbols = {key: symbol for symbol, key in plant_of(machine).parameters.items() if isinstance(key, str)}
    found = {}
    for role, share in relative.items():
        key = machine.value_of[role]
        if not key:
            continue
        std = share * abs(get_value(machine, key))
        if std > 0.0:
            symbol = GAIN if role == "gain" else symbols[key]
            least = -math.inf if "gravity" in role else 1e-3 * abs(get_value(machine, key))
            found[key] = Value(symbol, get_value(machine, key), std, least, std=1.0)
    offset = machine.offset_tolerance(largest)
    if offset > 0.0:
        key = machine.value_of["offset"]
        found[key] = Value(OFFSET, get_value(machine, key), offset, std=1.0)
    # The channels of one log are rarely sampled at one instant: one sampling step is no gap.
    step = float(np.median([run.sample_time_s for run in runs]))
    found[LOG_TIMING] = Value(LOG_TIMING, 0.0, step, 0.0, std=1.0)
    standstill = next(key for key in symbols if "standstill" in key)
    found[standstill] = Value(
        symbols[standstill], get_value(machine, standstill), 1.0, 0.0, std=STANDSTILL_STD, logarithmic=True
    )
    return found
