"""Friction near standstill, relative to the Coulomb level: the laws that machines of these campaigns may follow.

tanh:     tanh(v/turn) g(v)                                   smooth; a machine at rest creeps
dahl:     dz/dt = (v/length) (1 − |z| sgn(v z))               P. Dahl 1968: bristles that bend and slide
lugre:    dz/dt = (v/length) (1 − |z| sgn(v z)/g(v))          C. Canudas de Wit et al. 1995
creeping: as lugre, less z/relax_s                            stiction that gives way slowly
g(v) = 1 + peak exp(−(v/peak_v)²) is what friction rises to at standstill, over its Coulomb level. The bristles'
damping is part of the bristle laws: it lets them come to rest.
"""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np

from benchmarks.validation.kind import about

HERE = Path(__file__).parent


def kernel_folder() -> Path:
    """numba does not see that a function called from another module has changed; the folder's name does."""
    sources = [HERE / name for name in ("hoist_motion.py", "axis_motion.py", "standstill.py")]
    state = hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()[:12]
    owner = os.getuid() if hasattr(os, "getuid") else "own"
    root = os.environ.get("NUMBA_CACHE_DIR") or str(Path(tempfile.gettempdir()) / f"campaign-kernels-{owner}")
    return Path(root) / state


@contextmanager
def own_cache() -> Iterator[None]:
    """While functions are decorated: numba asks for the folder then. Others' kernels keep theirs."""
    folder = kernel_folder()
    folder.mkdir(parents=True, exist_ok=True)
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


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
