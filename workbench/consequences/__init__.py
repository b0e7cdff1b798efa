"""What a machine's unmodelled effects change in its control study: the same small study, without and with them."""

from workbench.consequences.compare import consequences_of
from workbench.consequences.motion import SmallStudy, small_study
from workbench.consequences.record import (
    Change,
    Choice,
    Consequences,
    Gains,
    LoopFigures,
    RunFigures,
    as_json,
    percent,
)

__all__ = [
    "Change",
    "Choice",
    "Consequences",
    "Gains",
    "LoopFigures",
    "RunFigures",
    "SmallStudy",
    "as_json",
    "consequences_of",
    "percent",
    "small_study",
]
