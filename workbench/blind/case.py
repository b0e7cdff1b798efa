"""One sealed campaign: what is to be made, and what its label says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# Cases, and their shares of a mixed set.
MIXED: Mapping[str, float] = {"singles": 2.0 / 3.0, "none": 1.0 / 6.0, "pairs": 0.1, "unknown": 1.0 / 15.0}
CASES = tuple(MIXED)


@dataclass(frozen=True)
class Order:
    """One campaign to make. names: of its effects. size: of them, in parts of what their family draws. identified: its
    machine.yaml is that of plain runs before."""

    number: int
    seed: tuple[int, ...]
    source: str
    family: str
    case: str
    names: tuple[str, ...]
    size: float = 1.0
    identified: bool = False

    @property
    def name(self) -> str:
        return f"{self.number:03d}"


@dataclass(frozen=True)
class Label:
    """What a campaign holds: keys of the practice labels first, then the truth under the workbench's names.

    events: of brief events the run, from_s, to_s and subsystem of each. alike: effects that no log tells from it, some
    joined by +.
    """

    effects: tuple[str, ...]
    events: tuple[dict[str, Any], ...]
    values: dict[str, float]
    where: tuple[dict[str, str], ...]
    alike: tuple[str, ...]
    signals: str
    parameters: dict[str, dict[str, float]]
    case: str
    kind: str
    family: str
    machine: str
    seed: tuple[int, ...]
    truth: dict[str, float]
    source: str = "simulator"
    identified: bool = False
    torque_change_rms_nm: float = 0.0
    torque_change_by_second_nm: dict[str, list[float]] = field(default_factory=dict)
