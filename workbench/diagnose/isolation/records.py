"""Records: which effects the runs can tell apart, and the run that would decide between open hypotheses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.core.run import Array
from workbench.diagnose.hypotheses.free_parameters import Names


@dataclass(frozen=True)
class Isolability:
    """Angles between signatures, degrees, after the base parameters are projected out. names: (k,), angle: (k, k).

    visible: the smallest amount of each effect that this campaign can show, in its first parameter's unit.
    """

    names: Names
    angle: Array
    visible: Mapping[str, tuple[str, float]]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class NextRun:
    """The run that would decide between the open hypotheses. separation: distance of their predictions with this
    run, in standard deviations; now: the same without it."""

    why: str
    payload_kg: float
    profile: str
    signals: tuple[str, ...]
    separation: float
    now: float
