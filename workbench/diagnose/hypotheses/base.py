"""The base parameters: the values of the nominal machine that have a tolerance, with the tolerance as prior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from workbench.core.run import Run
from workbench.diagnose.hypotheses.knobs import GAIN, LOG_TIMING, OFFSET, TENSION_GAIN, Knob, Value, Wave
from workbench.effects import find, ranges_of
from workbench.machines import get_value, kind_of

SHAPE_STD = math.log(3.0)  # of a trace's shape, such as the speed at which Stribeck friction falls: a factor
LEAST_STATE = 4e-5  # of its deviation: a trace that keeps a state is never quite off, for there it has no derivative
LOAD_CELL_STD = 0.005  # of a dead line's load cell: its gain


def base_knobs(machine: Any, runs: Sequence[Run]) -> dict[str, Value]:
    """Key of machine.yaml -> knob. Values without a tolerance stay at nominal."""
    kind = kind_of(machine)
    largest = kind.largest_input(runs)
    sensor = dict(zip(kind.sensor, (GAIN, OFFSET), strict=True))
    knobs: dict[str, Value] = {}
    for value in kind.base:
        std = value.std(machine, largest)
        if std <= 0.0 or (value.with_payload and all(run.payload_kg == 0.0 for run in runs)):
            continue
        nominal = float(get_value(machine, value.key))
        symbol = sensor.get(value.key) or kind.symbols[value.key]
        if value.spread == "factor":
            knobs[value.key] = Value(symbol, nominal, 1.0, 0.0, std=std, logarithmic=True)
            continue
        least = -math.inf if value.signed else 0.0 if "coulomb" in value.key else 1e-3 * abs(nominal)
        knobs[value.key] = Value(symbol, nominal, std, least, std=1.0)
    if kind.log_timing:
        # The channels of one log are rarely sampled at one instant: one sampling step is no gap.
        step = float(np.median([run.sample_time_s for run in runs]))
        knobs[LOG_TIMING] = Value(LOG_TIMING, 0.0, step, 0.0, std=1.0)
    if kind.dead_line is not None and all(kind.dead_line.signal in run for run in runs):
        knobs[TENSION_GAIN] = Value(TENSION_GAIN, 1.0, LOAD_CELL_STD, std=1.0)
    return knobs


def trace_knobs(machine: Any, runs: Sequence[Run]) -> dict[str, Knob]:
    """Name -> knob of the small amounts of effects that every machine of the kind has (`Kind.nuisances`).

    An effect counts as a cause only beyond that amount. A hypothesis with the effect replaces its trace.
    """
    kind = kind_of(machine)
    sizes = kind.sizes(machine, runs)
    knobs: dict[str, Knob] = {}
    for trace in kind.nuisances:
        std = trace.std(machine, sizes)
        if not trace.fitted or std <= 0.0:
            continue
        ranges = ranges_of(find(trace.effect, kind.name), machine, runs)
        phase = next((r for r in ranges if r.scan == "phase"), None)
        for r in ranges:
            name = f"{trace.effect}.{r.name}"
            if r is phase:
                continue
            if r.vanishes_at is None:
                knobs[name] = Value(r.symbol, r.start, 1.0, r.lowest, r.highest, std=SHAPE_STD, logarithmic=True)
            elif phase is None:
                least = LEAST_STATE * std if find(trace.effect, kind.name).memory else 0.0
                knobs[name] = Value(r.symbol, 0.0, std, least, r.highest, std=1.0)
            else:  # of an amplitude of unknown phase, either quadrature
                knobs[name] = Wave(r.symbol, phase.symbol, 0.0, std, r.highest, (1.0, 1.0))
    return knobs


def traces(machine: Any, runs: Sequence[Run], name: str) -> dict[str, float]:
    """Symbol -> standard deviation of the trace of an effect that is not fitted. Empty for other effects."""
    kind = kind_of(machine)
    std = next(
        (t.std(machine, kind.sizes(machine, runs)) for t in kind.nuisances if t.effect == name and not t.fitted), 0.0
    )
    if std <= 0.0:
        return {}
    amount = next(r for r in ranges_of(find(name, kind.name), machine, runs) if r.vanishes_at is not None)
    return {amount.symbol: std}
