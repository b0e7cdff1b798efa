"""The base parameters: what a nominal machine may honestly be off by, each held by its tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.diagnose.hypotheses.knobs import GAIN, LOG_TIMING, OFFSET, TENSION_GAIN, Knob, Value, Wave
from workbench.effects import find, ranges_of, sizes_of
from workbench.identify.parameters import free_parameters
from workbench.machine import Axis, Hoist, get_value
from workbench.plants import plant_of
from workbench.run import Run

STANDSTILL_STD = math.log(10.0)  # nobody knows how friction turns over at standstill: a factor of ten either way

AXIS_RIPPLE = 0.003  # of the largest input: cogging that every axis has
AXIS_PRESLIDING = 0.001  # of the travel: bristles that every axis has
SHAPE_STD = math.log(3.0)  # of a nuisance's shape, such as the speed at which Stribeck friction falls: a factor
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


def nuisance_knobs(machine: Hoist | Axis, runs: Sequence[Run]) -> dict[str, Knob]:
    """Effect -> knob of the small amount of it that every machine has, held by a tolerance of its own.

    An effect is a cause where it is beyond that: a hypothesis that frees it takes the nuisance's place.
    """
    if not isinstance(machine, Hoist):
        return {}
    tolerances = machine.tolerances
    kind = plant_of(machine).kind
    fastest = machine.motor.nominal_speed_rad_s * machine.lift_m_per_rad
    level = 0.5 * (machine.guide.coulomb_hoisting_n + machine.guide.coulomb_lowering_n)
    radius = 0.5 * machine.winch.drum_diameter_m
    spreads = {
        "gearbox_efficiency": tolerances.gearbox_loss,
        "friction_viscous": tolerances.viscous * level / fastest,
        "friction_stribeck": tolerances.stribeck * level,
        "drum_eccentricity": tolerances.eccentricity * radius,
    }
    knobs: dict[str, Knob] = {}
    for name, std in spreads.items():
        ranges = ranges_of(find(name, kind), machine, runs)
        phase = next((r for r in ranges if r.scan == "phase"), None)
        for r in (r for r in ranges if r.vanishes_at is None and r is not phase and std > 0.0):
            knobs[f"{name}.{r.name}"] = Value(
                r.symbol, r.start, 1.0, r.lowest, r.highest, std=SHAPE_STD, logarithmic=True
            )
        for r in (r for r in ranges if r.vanishes_at is not None and std > 0.0):
            if phase is None:
                knobs[f"{name}.{r.name}"] = Value(r.symbol, 0.0, std, 0.0, r.highest, std=1.0)
            else:  # of an amplitude of unknown phase, either quadrature
                knobs[f"{name}.{r.name}"] = Wave(r.symbol, phase.symbol, 0.0, std, r.highest, (1.0, 1.0))
    return knobs


def traces(machine: Hoist | Axis, runs: Sequence[Run], name: str) -> dict[str, float]:
    """Symbol -> standard deviation of the small amount of an effect that every machine has, where no base parameter
    stands for it: a ripple's phase is each run's own, bristles have no amount that is linear. Empty for other effects."""
    kind = plant_of(machine).kind
    sizes = sizes_of(machine, runs)
    if isinstance(machine, Hoist):
        stds = {"torque_ripple": machine.tolerances.ripple * sizes.torque}
    else:
        stds = {"torque_ripple": AXIS_RIPPLE * sizes.force, "presliding": AXIS_PRESLIDING * sizes.length}
    if not stds.get(name, 0.0) > 0.0:
        return {}
    amount = next(r for r in ranges_of(find(name, kind), machine, runs) if r.vanishes_at is not None)
    return {amount.symbol: stds[name]}


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
