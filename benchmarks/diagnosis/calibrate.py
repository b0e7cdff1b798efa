"""`python -m benchmarks.diagnosis.calibrate ANSWERS...`: the numbers by which evidence becomes probability.

Fitted on simulated campaigns of seeds that are kept for it; nothing recorded takes part. The
weights of an unknown cause are a logistic regression (scikit-learn), with no weight below zero;
the temperature is the one under which the answers' probabilities are most likely; the threshold
is what the best hypothesis of machines without a gap stays below in all but one of fifty.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.diagnosis.answers import load
from benchmarks.diagnosis.score import estimates_within, right_word
from workbench.diagnose.verdict.judge import CALIBRATION, calibration, rank

EVIDENCE = ("clear", "slow", "prior", "bound", "against")
LEAST_THRESHOLD = 4.0
FALSE_ALARMS = 0.02
INSIDE = 0.90


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("answers", type=Path, nargs="+")
    parser.add_argument("--write", action="store_true", help="write workbench/diagnose/verdict/calibration.json")
    given = parser.parse_args()
    rows = [row for folder in given.answers for row in load(folder) if row["word"] != "refused"]
    numbers = fitted(rows)
    print(json.dumps(numbers, indent=1))
    if given.write:
        made_by = f"python -m benchmarks.diagnosis.calibrate, {len(rows)} simulated campaigns"
        CALIBRATION.write_text(json.dumps({"made_by": made_by, "numbers": numbers}, indent=1) + "\n", encoding="utf-8")


def fitted(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    numbers = dict(calibration())
    numbers["threshold"] = _threshold(rows)
    numbers |= _unknown(rows)
    numbers["temperature"] = _temperature(rows, numbers)
    numbers["interval"] *= _interval(rows)
    return {name: float(f"{value:.4g}") for name, value in numbers.items()}


def _threshold(rows: Sequence[Mapping[str, Any]]) -> float:
    best = sorted(max((w["merit"] for w in row["weighed"]), default=-math.inf) for row in _without(rows))
    if not best:
        return float(calibration()["threshold"])
    return max(LEAST_THRESHOLD, best[min(len(best) - 1, math.ceil((1.0 - FALSE_ALARMS) * len(best)) - 1)] + 1.0)


def _without(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [row for row in rows if not row["label"]["effects"]]


def _unknown(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Weights none of which is negative: a feature that comes out so is left out, and the rest fitted anew."""
    from sklearn.linear_model import LogisticRegression

    # Where a rival leads the answer is unknown whatever the evidence: such campaigns say nothing of its weights.
    rows = [row for row in rows if not row["weighed"] or row["weighed"][0]["names"]]
    x = np.array([[row["evidence"][name] for name in EVIDENCE] for row in rows])
    y = np.array([right_word(row) == "unknown" for row in rows])
    used = list(range(len(EVIDENCE)))
    while True:
        model = LogisticRegression(C=100.0, max_iter=10_000).fit(x[:, used], y)
        weights = model.coef_[0]
        if np.all(weights >= 0.0) or len(used) == 1:
            break
        used = [k for k, w in zip(used, weights, strict=True) if w > 0.0]
    found = {f"unknown_{name}": 0.0 for name in EVIDENCE}
    found |= {f"unknown_{EVIDENCE[k]}": float(w) for k, w in zip(used, weights, strict=True)}
    return {"unknown_bias": float(model.intercept_[0]), **found}


def _temperature(rows: Sequence[Mapping[str, Any]], numbers: Mapping[str, float]) -> float:
    from scipy.optimize import minimize_scalar

    def loss(log_t: float) -> float:
        tried = {**numbers, "temperature": math.exp(log_t)}
        return -sum(math.log(max(_given_to_truth(row, tried), 1e-6)) for row in rows)

    return float(math.exp(minimize_scalar(loss, bounds=(-1.0, 4.0), method="bounded").x))


def _given_to_truth(row: Mapping[str, Any], numbers: Mapping[str, float]) -> float:
    merits = [(tuple(w["names"]), float(w["merit"])) for w in row["weighed"]]
    word, effects = right_word(row), set(row["label"]["effects"])
    return sum(
        each.probability
        for each in rank(merits, row["evidence"], numbers)
        if each.verdict == word and (word != "named" or set(each.effects) == effects)
    )


def _interval(rows: Sequence[Mapping[str, Any]]) -> float:
    """The factor on standard errors at which nine of ten true values lie within the 90 % interval."""
    ratios = sorted(ratio for row in rows for _, _, ratio in estimates_within(row))
    if not ratios:
        return 1.0
    return ratios[min(len(ratios) - 1, math.ceil(INSIDE * len(ratios)) - 1)] / 1.6449


if __name__ == "__main__":
    main()
