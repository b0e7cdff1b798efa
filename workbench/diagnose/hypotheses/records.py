"""The names of a hypothesis, and the estimate of a parameter."""

from __future__ import annotations

from dataclasses import dataclass

Names = tuple[str, ...]  # ids of the effects of one hypothesis; () is the machine within its tolerances


@dataclass(frozen=True)
class Estimate:
    """One parameter of an effect, in the unit of its name. value: of each run where it is each run's own."""

    name: str
    value: float | tuple[float, ...]
    std_error: float | tuple[float, ...]
