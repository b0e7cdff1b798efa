"""The numbers that turn fits into a verdict: set by hand, each with its reason; and `calibration`, fitted to answers.

What is taken for chance is one number, SIGNIFICANT, as a probability, an evidence (twice the logarithm of a likelihood
ratio), standard deviations. `python -m benchmarks.sensitivity` says what an error of 30 % in each number would change.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from statistics import NormalDist

CALIBRATION = Path(__file__).with_name("calibration.json")

MOST_EFFECTS = 5  # that are looked for at once

# Chance
SIGNIFICANT = 0.05  # probability of what is taken for chance; of an unknown cause that nothing speaks for
THRESHOLD = -2.0 * math.log(SIGNIFICANT)  # 6.0: evidence that no gap has, nor a freer law over a simpler one
DECISIVE = 2.0 * THRESHOLD  # 12.0: evidence within which another hypothesis is as good, listed or not
NUISANCE = NormalDist().inv_cdf(1.0 - SIGNIFICANT**2 / 2.0)  # 3.0: of a tolerance, or an effect's nuisance amount
SAME = 2.0 * SIGNIFICANT  # evidence and chi^2 by which hypotheses that differ in name only are apart, at most

# Impacts of a play
IMPACTS = 150.0  # evidence of a play where impacts come again: no other effect has them, and no fit looks at them

# A law that holds
LAW = 0.15  # of what a law explains, rms, and of an axis' noise: so far a real machine is off both; EMPS 0.1 off one
FORETOLD = 0.1  # of an energy: so much a curve, a change of amount, another lag or the base parameters take by chance
HALF = 0.5  # of the best one's evidence; of several shares' energy: their sum; of a cause, rms, what stays beside it
MINOR = 0.2  # of the gap, the input, a filter's lag, of jumps: of five surer causes that explained less two were none

# An unknown cause
RELEVANT_PERCENT = 0.15  # of the input's rms: less left changes no conclusion of a study
OWN_PERCENT = 1.5  # of the input's rms: what an axis may leave of a law of one variable; simulated ones leave 0.24


def calibration() -> Mapping[str, float]:
    """unknown_bias: log odds of an unknown cause that nothing speaks for. missed_*: of answers of no gap and of an
    unknown cause, as stated (`answer._with_misses`)."""
    return {"unknown_bias": math.log(SIGNIFICANT / (1.0 - SIGNIFICANT)), **stated()}


@cache
def stated() -> dict[str, float]:
    """What is stated of the decision, as `benchmarks.calibrate` fitted it."""
    numbers: dict[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers
