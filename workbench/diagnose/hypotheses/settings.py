"""The numbers that turn fits into a verdict: set by hand, each with its reason; and `calibration`, fitted to answers.

`python -m benchmarks.sensitivity` says what an error of 30 % in each would change.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path

CALIBRATION = Path(__file__).with_name("calibration.json")

MOST_EFFECTS = 5  # that are looked for at once

# Evidence
LAW = 0.15  # of what a law explains, rms, and of an axis' noise: so far a real machine is off both; EMPS 0.1 off one
DECISIVE = 12.0  # evidence within which another hypothesis is as good, listed or not
NUISANCE = 3.0  # standard deviations of a tolerance or an effect's nuisance amount, by chance

# Impacts of a play
IMPACTS = 150.0  # evidence of a play where impacts come again: no other effect has them, and no fit looks at them

# A law that holds
FORETOLD = 0.1  # of an energy: so much a curve, a change of amount, another lag or the base parameters take by chance
HALF = 0.5  # of the best one's evidence; of several shares' energy: their sum; of a cause, rms, what stays beside it
MINOR = 0.2  # of the gap, the input, a filter's lag, of jumps: of five surer causes that explained less two were none

# An unknown cause
RELEVANT_PERCENT = 0.15  # of the input's rms: less left changes no conclusion of a study
OWN_PERCENT = 1.5  # of the input's rms: what an axis may leave of a law of one variable; simulated ones leave 0.24


@cache
def calibration() -> Mapping[str, float]:
    """What decides: threshold: evidence that no gap has; unknown_bias: log odds of an unknown cause.

    What is stated of the decision (`answer._with_misses`): misses of no gap, and of an unknown cause.
    """
    numbers: Mapping[str, float] = json.loads(CALIBRATION.read_text(encoding="utf-8"))["numbers"]
    return numbers
