"""The size of the gap, and where it lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.core.run import Array


@dataclass(frozen=True)
class Gap:
    """How large the gap is after the base parameters were refitted within their tolerances.

    residual_rms, noise_rms: input, N m (N), below band_hz. force_rms_n: the same as a force on the carriage (None on
    an axis). speed_rmse_percent: open-loop replay of the refitted machine. nominal_*: before any refit.
    """

    residual_rms: float
    noise_rms: float
    band_hz: float
    force_rms_n: float | None
    speed_rmse_percent: float
    nominal_residual_rms: float
    nominal_speed_rmse_percent: float
    worst_tolerance: tuple[str, float]
    significant: bool
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class RunResidual:
    """One run under the delivered machine, as `replay` prints it: rms while moving, N m (N). before: refitted within
    the tolerances; after: as delivered. share: of the gap's energy that this run holds; differs: whether it alone
    holds most of what stays."""

    name: str
    share: float
    before: float
    after: float
    noise: float
    differs: bool = False


@dataclass(frozen=True)
class Delivered:
    """What `replay` gives with the delivered machine.yaml, in the band of the gap: rms of the residual while moving,
    N m (N); speed error in open loop, per cent; and each run."""

    residual_rms: float
    speed_rmse_percent: float
    runs: tuple[RunResidual, ...]


@dataclass(frozen=True)
class Window:
    run: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Profile:
    """The gap over one variable: in each bin its mean and rms, N m (N), and its share of the energy.

    edges: (k + 1,); mean_forward, mean_backward, share: (k,), NaN where nothing lies; over frequency there is no mean,
    and share is what the best single wave of a bin takes of the energy. explains: share of the gap's energy that a
    function of this variable (and direction) takes away; interval: of it, 90 %, over runs.
    """

    variable: str
    label: str
    unit: str
    regime: str
    edges: Array
    mean_forward: Array
    mean_backward: Array
    share: Array
    explains: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class PlaceProbability:
    """How likely the cause lies in a part of the machine, 0 to 1."""

    subsystem: str
    probability: float


@dataclass(frozen=True)
class Event:
    """A brief stretch of one run, s on its own clock, that a force of one part of the machine accounts for.

    energy: its share of the gap's. largest: the force's largest value, as input, N m (N)."""

    run: str
    from_s: float
    to_s: float
    subsystem: str
    energy: float
    largest: float


@dataclass(frozen=True)
class Where:
    """Where the gap lies. share: of its energy in the windows and the regime. side: drive, carriage, or unsaid.

    places: the likeliest first, probabilities that sum to one. events: the brief stretches, where that is what it is.
    """

    subsystem: str
    regime: str
    windows: tuple[Window, ...]
    share: float
    interval: tuple[float, float]
    profiles: tuple[Profile, ...]
    energy_by_run: Mapping[str, float]
    side: str
    sentences: tuple[str, ...]
    places: tuple[PlaceProbability, ...] = ()
    events: tuple[Event, ...] = ()
