"""A run's torque compared with that of a rigid machine: coarse, but every error of sign, unit or machine shows.

    input = inertia · acceleration + friction · sign(speed) + load

fitted by least squares to each run for itself, low-passed to half the band; an axis' friction
has a viscous part too, and the load of one that turns against gravity a wave over its angle. Every
effect of the library leaves inertia and load within a third of the nominal ones.

Friction that builds up over a distance is a spring after each reversal: its force follows the position, as an inertia
below zero would have it. A wrong sign shows an inertia below zero too, but then the input takes power from the motion,
for friction is turned round with it. So an axis' run with an inertia below zero whose input gives power says nothing of
its inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.run import Array
from workbench.machines import kind_of
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass

BAND_SHARE = 0.5  # of the band: farther below the wire's resonance the machine is nearly rigid
TURNS_OVER = 0.005  # of the speed scale: where friction takes on its full value
SURE = 5.0  # standard errors
SHOWN = 0.05  # of the input, rms: beside a lag of friction or load, less of it says nothing of the inertia
MOST = 0.5  # of the input
UNLIKE = 0.2  # of the input's variance: a run of which a rigid machine leaves more says nothing of its inertia
WORKS = 0.2  # of the power's size: what the input gives on average, at least
AS_WELL = 0.4  # of what the inertia takes in the run that shows it best: an axis' slower runs show friction's lag


@dataclass(frozen=True)
class Rigid:
    """Ratios of a run's fitted values to those of the nominal machine, with standard errors.

    inertia: None where the run does not accelerate enough to tell, or is not like a rigid machine at all: of an axis,
    where more is left than the inertia takes. hold: mean
    load, None on an axis or where friction hides it. friction: in the input's unit, against the motion positive.
    shown: what the nominal inertia takes of the input, rms.
    """

    run: str
    inertia: float | None
    inertia_std: float
    hold: float | None
    friction: float
    shown: float = 0.0


def rigid_of(bench: Bench, j: int) -> Rigid:
    """Run j of the bench as a rigid machine."""
    run, machine = bench.runs[j], bench.machine
    rows = bench.moving[j]
    band = BAND_SHARE * bench.band_hz
    speed = lowpass(run.time_s, bench.motions[j].speed, band)
    sign = lowpass(run.time_s, np.clip(speed / (TURNS_OVER * bench.scale), -1.0, 1.0), band)
    kind = kind_of(machine)
    body = kind.rigid(machine, run.payload_kg)
    columns = [body.inertia * np.gradient(speed, run.time_s), np.ones_like(speed), sign]
    if kind.friction.viscous:
        columns.append(speed)
    if body.wave:
        angle = bench.motions[j].position
        columns += [lowpass(run.time_s, wave(angle), band) for wave in (np.sin, np.cos)]
    x = np.stack(columns, axis=1)[rows]
    y = lowpass(run.time_s, run[bench.plant.input], band)[rows]
    independent = 2.0 * band * run.sample_time_s * len(y)
    if independent < 2.0 * x.shape[1]:
        return Rigid(run.name, None, float("inf"), None, 0.0)
    values, std = _least_squares(x, y, independent)
    power = y * speed[rows]
    works = kind.friction.viscous and float(np.mean(power)) > WORKS * float(np.mean(np.abs(power)))
    size = max(float(np.std(y)), 1e-300)
    shown = float(np.sqrt(np.mean(x[:, 0] ** 2))) / size
    left = float(np.var(y - x @ values)) / size**2
    taken = abs(float(values[0])) * shown
    like = left < UNLIKE and not (kind.friction.viscous and left > taken**2)
    springs = values[0] < 0.0 and works  # with a wrong sign the input would take power from friction
    told = like and not springs and std[0] < np.inf and abs(values[0]) > SURE * std[0] and taken > SHOWN
    hold = float(values[1]) / body.hold if body.hold and std[1] < 0.1 * body.hold else None
    return Rigid(run.name, float(values[0]) if told else None, float(std[0]), hold, float(values[2]), shown)


def as_well_shown(rigid: Sequence[Rigid]) -> list[Rigid]:
    """Drops the inertia of runs of an axis in which it shows far less than in other runs, because the lag of friction
    biases it there. It is kept if it takes most of the input, as with a wrong unit."""
    most = max((r.shown for r in rigid), default=0.0)
    return [
        r
        if r.inertia is None or r.shown >= AS_WELL * most or abs(r.inertia) * r.shown > MOST
        else replace(r, inertia=None)
        for r in rigid
    ]


def _least_squares(x: Array, y: Array, independent: float) -> tuple[Array, Array]:
    """Values and standard errors; infinite ones where the columns cannot be told apart."""
    size = np.linalg.norm(x, axis=0)
    size[size == 0.0] = 1.0
    scaled = x / size
    solution, *_ = np.linalg.lstsq(scaled, y, rcond=1e-6)
    left = y - scaled @ solution
    normal = scaled.T @ scaled
    values, vectors = np.linalg.eigh(normal)
    variance = (vectors**2) @ (1.0 / np.maximum(values, 1e-12))
    # Scaled columns: what is left of one after the others are taken out is 1/variance.
    variance[variance > 1e6] = np.inf
    per_row = float(left @ left) / max(independent - x.shape[1], 1.0)
    return solution / size, np.sqrt(variance * per_row) / size
