"""The band, in Hz (-3 dB), in which measured and predicted are compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace

from workbench.errors import InputError
from workbench.machine import Axis, Hoist
from workbench.plants import Plant
from workbench.run import Run

# Of the sampling rate: where a Butterworth filter at a tenth of it, run both ways, has lost 3 dB.
SAMPLING_SHARE = 0.0896
LEAST_PERIODS = 4.0  # of the band in the shortest run


def default_band(machine: Hoist | Axis, plant: Plant, values: Sequence[SimpleNamespace], runs: Sequence[Run]) -> float:
    """The highest frequency at which the plant is valid, limited by the slowest sampling rate.

    An identified machine is compared in the band it was identified in, so that its figures
    are those of its identification.
    """
    sampling = min(SAMPLING_SHARE / run.sample_time_s for run in runs)
    said = machine.identified.get("band_hz")
    if isinstance(said, int | float) and said > 0.0:
        return min(sampling, float(said))
    return min(sampling, *(plant.band_hz(p) for p in values))


def check_band(band_hz: float, runs: Sequence[Run]) -> None:
    """InputError if the runs are too short or sampled too slowly for this band."""
    highest = min(0.5 / run.sample_time_s for run in runs)
    lowest = max(LEAST_PERIODS / run.duration_s for run in runs)
    # Steps are differences of rounded times: half the sampling rate may come out a rounding error above itself.
    if not (math.isfinite(band_hz) and lowest <= band_hz < highest * (1.0 - 1e-6)):
        raise InputError(
            f"{band_hz:g} Hz, expected at least {lowest:.2g} Hz ({LEAST_PERIODS:g} periods in the shortest run) "
            f"and less than {highest:.3g} Hz (half the sampling rate)",
            place="band_hz",
        )
