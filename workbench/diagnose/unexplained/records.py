"""An unknown cause as a force over what explains it best."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.core.run import Array


@dataclass(frozen=True)
class Curve:
    """An unknown cause's force over what explains it best: the residual at the place it acts on, by direction."""

    over: str
    acts_on: str
    at: Array
    forward: Array
    backward: Array
    std_forward: Array
    std_backward: Array
    explains: float


@dataclass(frozen=True)
class Unknown:
    """What is known of an unknown cause. curves: best first; the first one is in the corrected machine."""

    curves: tuple[Curve, ...]
    sentences: tuple[str, ...]
