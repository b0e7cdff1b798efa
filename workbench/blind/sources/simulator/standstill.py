"""Friction near standstill, relative to the Coulomb level: the laws that machines of these campaigns may follow.

tanh:     tanh(v/turn) g(v)                                   smooth; a machine at rest creeps
dahl:     dz/dt = (v/length) (1 − |z| sgn(v z))               P. Dahl 1968: bristles that bend and slide
lugre:    dz/dt = (v/length) (1 − |z| sgn(v z)/g(v))          C. Canudas de Wit et al. 1995
creeping: as lugre, less z/relax_s                            stiction that gives way slowly
g(v) = 1 + peak exp(−(v/peak_v)²) is what friction rises to at standstill, over its Coulomb level. The bristles'
damping is part of the bristle laws: it lets them come to rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from workbench.blind.sources.simulator.causes import about
from workbench.blind.sources.simulator.compiled import own_cache

LAWS = ("tanh", "smooth_peak", "dahl", "lugre", "creeping")


@dataclass(frozen=True)
class Standstill:
    """bristles: 1 or 0 (tanh). peak: relative rise at standstill; peak_speed: of the top speed, within which it
    has gone. relax_s: time in which bent bristles give way; 0: they never do."""

    bristles: float
    peak: float
    peak_speed: float
    relax_s: float


def drawn_standstill(laws: tuple[str, ...], rng: np.random.Generator) -> Standstill:
    """One of `laws`, with numbers of its own."""
    law = laws[int(rng.integers(len(laws)))]
    peak, speed, relax = about(rng, 0.02, 0.10), about(rng, 0.002, 0.01), about(rng, 5.0, 60.0)
    return Standstill(
        bristles=float(law not in ("tanh", "smooth_peak")),
        peak=peak if law in ("smooth_peak", "lugre", "creeping") else 0.0,
        peak_speed=speed,
        relax_s=relax if law == "creeping" else 0.0,
    )


with own_cache():

    @numba.njit(cache=True)
    def rise(v: float, peak: float, peak_v: float) -> float:
        """g(v), what friction rises to near standstill; peak_v in the unit of v."""
        return 1.0 + peak * math.exp(-((v / peak_v) ** 2)) if peak > 0.0 else 1.0

    @numba.njit(cache=True)
    def bend(z: float, v: float, length: float, level: float, relax_s: float, step_s: float) -> float:
        """The bristles' bend one step on, implicit; |z| stays below `level`."""
        r = step_s * v / length
        give = step_s / relax_s if relax_s > 0.0 else 0.0
        return (z + r) / (1.0 + abs(r) / level + give)
