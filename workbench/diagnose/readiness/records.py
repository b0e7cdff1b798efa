"""What is said of the logs before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunCondition:
    """How fit one run's log is. noise_rms: of the input in the band, N m (N). moving_share: of its samples that
    speak of friction and inertia. delay_s: logged speed behind its reference, None without one."""

    name: str
    samples: int
    sample_time_s: float
    noise_rms: float
    moving_share: float
    clipped_share: float
    outliers: int
    delay_s: float | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Condition:
    """The logs, made ready. sentences: what was repaired, left out or is worth a warning."""

    runs: tuple[RunCondition, ...]
    band_hz: float
    noise_rms: float
    sentences: tuple[str, ...]
