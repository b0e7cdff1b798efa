"""Records of the answer, the hypotheses it was chosen from, and the reasons against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from workbench.diagnose.hypotheses.records import Estimate, Names

VerdictWord = Literal["named", "no_gap", "unknown"]


class ReasonKind(Enum):
    """Reasons against the best named hypothesis."""

    UNLISTED_EXPLAINS_MORE = "unlisted_explains_more"
    LEAVES_MUCH = "leaves_much"
    FITS_ARE_LOST = "fits_are_lost"
    STRETCHES_TOLERANCES = "stretches_tolerances"
    ON_A_BOUND = "on_a_bound"
    UNDO_EACH_OTHER = "undo_each_other"


@dataclass(frozen=True)
class Reason:
    """value: N m (N) left, or standard deviations; percent: of the input's rms; effects: those it is about."""

    kind: ReasonKind
    effects: Names = ()
    value: float = 0.0
    percent: float = 0.0


@dataclass(frozen=True)
class Left:
    """The residual of the answer beyond noise, on held-out runs: rms, N m (N); per cent of the input's rms; relevant:
    whether it can change a conclusion of a study."""

    rms: float
    percent_of_input: float
    relevant: bool


@dataclass(frozen=True)
class Remainder(Left):
    """What no cause takes, with any verdict. share: of the gap's energy beyond noise on held-out runs, 0 to 1.
    subsystem, regime: where it lies; regime "all" where no variable of the motion foretells it."""

    share: float
    subsystem: str
    regime: str


@dataclass(frozen=True)
class Candidate:
    """One hypothesis with its merit. gain: the fall of chi^2 and tolerances together; merit: the gain less the cost.

    residual_rms, held_out_rms: N m (N); held_out_rms is None for what was not fitted. explained: share of the gap's
    energy. against: the reasons against it. failure: why its fit broke down, "" for one that did not.
    """

    effects: Names
    gain: float
    merit: float
    residual_rms: float | None
    held_out_rms: float | None
    explained: float | None
    parameters: Mapping[str, tuple[Estimate, ...]]
    fitted: bool
    against: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True)
class Hypothesis:
    """One row of the ranking. twins: hypotheses that differ from it in name only; the probability is of all."""

    verdict: VerdictWord
    effects: Names
    probability: float
    twins: tuple[Names, ...] = ()


@dataclass(frozen=True)
class Step:
    """One step to an answer, with one effect more. merit: of these effects; left_rms: the rms of their residual, in the
    input's unit."""

    effects: Names
    merit: float
    left_rms: float


@dataclass(frozen=True)
class Verdict:
    """The answer. alike: what this campaign cannot tell from it. sentence: the answer in one sentence. steps: how an
    answer was come to, one effect after the other."""

    word: VerdictWord
    effects: Names
    ranking: tuple[Hypothesis, ...]
    alike: Names
    sentence: str
    reasons: tuple[Reason, ...] = ()
    explained: float = 0.0
    left: Left = Left(0.0, 0.0, False)
    steps: tuple[Step, ...] = ()
    remainder: Remainder | None = None

    @property
    def probability(self) -> float:
        """Of the answer, with its exact twins."""
        return self.ranking[0].probability

    @property
    def twins(self) -> tuple[Names, ...]:
        """What differs from the answer in name only."""
        return self.ranking[0].twins
