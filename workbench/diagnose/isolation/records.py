"""What these runs can tell apart, and the run that would decide what is open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.diagnose.hypotheses.records import Names
from workbench.run import Array


@dataclass(frozen=True)
class Isolability:
    """Angles between signatures, degrees, after the base parameters are projected out. names: (k,), angle: (k, k).

    visible: (k,) the effect's smallest amount this campaign would show, in its first parameter's unit.
    """

    names: Names
    angle: Array
    visible: Mapping[str, tuple[str, float]]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class NextRun:
    """The run that would decide what is open. separation: distance of the candidates' predictions on it, in
    standard deviations, against `now` on the campaign as it is."""

    why: str
    payload_kg: float
    profile: str
    signals: tuple[str, ...]
    separation: float
    now: float
