"""What a comparison comes to: one line of the table and of results.json."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .measure import Measured

RESULTS = Path(__file__).with_name("results.json")
ACCURACY = 1e-6  # of the largest motor speed, for replay, closed loop and batch
FIT_ACCURACY = 1e-4  # of each parameter: the right answer


@dataclass(frozen=True)
class Row:
    """Ours beside one peer's, with what the peer was set to and the ratio aimed at."""

    name: str
    ours: Measured
    peer: str
    theirs: Measured
    setting: str
    target: float | None

    @property
    def ratio(self) -> float:
        return self.theirs.seconds / self.ours.seconds

    def record(self) -> dict[str, float | str]:
        return {
            "name": self.name,
            "ours_s": self.ours.seconds,
            "peer": self.peer,
            "peer_s": self.theirs.seconds,
            "ratio": self.ratio,
            "error_ours": self.ours.error,
            "error_peer": self.theirs.error,
        }
