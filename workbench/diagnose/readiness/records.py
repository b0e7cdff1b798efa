"""Records: the condition of the logs before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunCondition:
    """The condition of one run's log. noise_rms: of the input in the band, N m (N). moving_share: share of the
    samples in motion. delay_s: logged speed behind its reference, None without one."""

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
    """The condition of all logs. sentences: repairs, omissions and warnings."""

    runs: tuple[RunCondition, ...]
    band_hz: float
    noise_rms: float
    sentences: tuple[str, ...]
