"""`python -m benchmarks.diagnosis.calibrate FOLDER`: the numbers by which evidence becomes probability.

Fitted on simulated campaigns of a seed that is kept for it (SEED); nothing recorded takes part. With `--make N` the
campaigns are made and diagnosed first, in FOLDER; without it the answers that lie in the given folders are taken. The
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

from benchmarks.campaigns.families import FAMILIES
from benchmarks.campaigns.many import make_all, orders
from benchmarks.diagnosis.answers import load
from benchmarks.diagnosis.criteria import estimates_within, family_of, right_word
from benchmarks.diagnosis.run import Asked, answer_all
from workbench.diagnose.verdict.judge import CALIBRATION, calibration, rank

WEIGHT = "unknown_"  # of what speaks for an unknown cause; the bias is the logistic's own
EVIDENCE = tuple(
    name.removeprefix(WEIGHT) for name in calibration() if name.startswith(WEIGHT) and name != f"{WEIGHT}bias"
)
SEED = 7001  # of the campaigns that calibrate; what is scored has another one
LEAST_THRESHOLD = 4.0
FALSE_ALARMS = 0.02
INSIDE = 0.90


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="of answers; with --make one folder, for all it makes")
    parser.add_argument("--make", type=int, metavar="N", help="make and diagnose N campaigns of all families first")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--write", action="store_true", help="write workbench/diagnose/verdict/calibration.json")
    given = parser.parse_args()
    folders = given.folders
    if given.make:
        if len(folders) > 1:
            parser.error("--make takes one folder")
        folders = made(folders[0], given.make, given.processes)
    rows = [row for folder in folders for row in load(folder) if row["word"] != "refused"]
    numbers = fitted(rows)
    print(json.dumps(numbers, indent=1))
    if given.write:
        made_by = f"python -m benchmarks.diagnosis.calibrate, {len(rows)} answers on simulated campaigns"
        CALIBRATION.write_text(json.dumps({"made_by": made_by, "numbers": numbers}, indent=1) + "\n", encoding="utf-8")


def made(folder: Path, count: int, processes: int) -> list[Path]:
    """Campaigns of SEED and all families, diagnosed as they are and with the effect taken out; what is there stays."""
    make_all(orders(folder / "campaigns", SEED, tuple(FAMILIES), count=count), processes)
    folders = [folder / "answers", folder / "withheld"]
    for target, withhold in zip(folders, (False, True), strict=True):
        answer_all(Asked(folder / "campaigns", target, withhold=withhold, singles_only=withhold), processes)
    return folders


def left_out(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each family's answers anew, by the calibration that all other families give."""
    answered = []
    for family in sorted({family_of(row) for row in rows}):
        others = [row for row in rows if family_of(row) != family and row["word"] != "refused"]
        numbers = fitted(others)
        answered += [_anew(row, numbers) for row in rows if family_of(row) == family]
    return answered


def _anew(row: Mapping[str, Any], numbers: Mapping[str, float]) -> dict[str, Any]:
    """The answer that other numbers would have given; what was fitted stays."""
    if row["word"] == "refused":
        return dict(row)
    ranking = rank(_merits(row), row["evidence"], numbers)
    rows = [(hypothesis.verdict, list(hypothesis.effects), hypothesis.probability) for hypothesis in ranking]
    return {**row, "word": rows[0][0], "names": rows[0][1], "ranking": rows}


def _merits(row: Mapping[str, Any]) -> list[tuple[tuple[str, ...], float]]:
    return [(tuple(names), float(merit)) for names, merit in row["counted"]]


def fitted(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    numbers = dict(calibration())
    numbers["threshold"] = _threshold(rows)
    numbers |= _unknown(rows)
    numbers["temperature"] = _temperature(rows, numbers)
    if "interval" in numbers:
        numbers["interval"] *= _interval(rows)
    return {name: float(f"{value:.4g}") for name, value in numbers.items()}


def _threshold(rows: Sequence[Mapping[str, Any]]) -> float:
    best = sorted(max((merit for _, merit in row["counted"]), default=-math.inf) for row in _without(rows))
    if not best:
        return float(calibration()["threshold"])
    return max(LEAST_THRESHOLD, best[min(len(best) - 1, math.ceil((1.0 - FALSE_ALARMS) * len(best)) - 1)] + 1.0)


def _without(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [row for row in rows if not row["label"]["effects"]]


def _unknown(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Weights none of which is negative: a feature that comes out so is left out, and the rest fitted anew."""
    from sklearn.linear_model import LogisticRegression

    # Where a rival leads the answer is unknown whatever the evidence: such campaigns say nothing of its weights.
    rows = [row for row in rows if not row["counted"] or row["counted"][0][0]]
    x = np.array([[row["evidence"][name] for name in EVIDENCE] for row in rows])
    y = np.array([right_word(row) == "unknown" for row in rows])
    used = list(range(len(EVIDENCE)))
    while True:
        model = LogisticRegression(C=100.0, max_iter=10_000).fit(x[:, used], y)
        weights = model.coef_[0]
        if np.all(weights >= 0.0) or len(used) == 1:
            break
        used = [k for k, w in zip(used, weights, strict=True) if w > 0.0]
    numbers = {f"unknown_{name}": 0.0 for name in EVIDENCE}
    numbers |= {f"unknown_{EVIDENCE[k]}": float(w) for k, w in zip(used, weights, strict=True)}
    return {"unknown_bias": float(model.intercept_[0]), **numbers}


def _temperature(rows: Sequence[Mapping[str, Any]], numbers: Mapping[str, float]) -> float:
    from scipy.optimize import minimize_scalar

    def loss(log_t: float) -> float:
        tried = {**numbers, "temperature": math.exp(log_t)}
        return -sum(math.log(max(_given_to_truth(row, tried), 1e-6)) for row in rows)

    return float(math.exp(minimize_scalar(loss, bounds=(-1.0, 4.0), method="bounded").x))


def _given_to_truth(row: Mapping[str, Any], numbers: Mapping[str, float]) -> float:
    word, effects = right_word(row), set(row["label"]["effects"])
    return sum(
        hypothesis.probability
        for hypothesis in rank(_merits(row), row["evidence"], numbers)
        if hypothesis.verdict == word and (word != "named" or set(hypothesis.effects) == effects)
    )


def _interval(rows: Sequence[Mapping[str, Any]]) -> float:
    """The factor on standard errors at which nine of ten true values lie within the 90 % interval."""
    ratios = sorted(ratio for row in rows for _, _, ratio in estimates_within(row))
    if not ratios:
        return 1.0
    return ratios[min(len(ratios) - 1, math.ceil(INSIDE * len(ratios)) - 1)] / 1.6449


if __name__ == "__main__":
    main()
