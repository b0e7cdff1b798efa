"""`python -m benchmarks.calibrate FOLDER --make 240`: the numbers by which evidence becomes probability.

Fitted on campaigns of the simulators of a seed that is kept for it (SEED); nothing recorded takes part. With `--make N`
the campaigns are made and diagnosed first, in FOLDER, as `workbench blind` does it, and once more with the effect taken
out of the library; what is there stays. The weights of an unknown cause are a logistic regression (scikit-learn), with
no weight below zero; the temperature is the one under which the answers' probabilities are most likely; the threshold
is what the best hypothesis of machines without a gap stays below in all but one of fifty.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from workbench.blind.answer import answer, load, save, text_of
from workbench.blind.ask import Asked, make_asked
from workbench.blind.criteria import estimates_within, family_of, right, right_word, single
from workbench.blind.make import mapped
from workbench.blind.run import run
from workbench.blind.score import Score, open_and_score
from workbench.blind.seal import CAMPAIGNS, key_of
from workbench.blind.share import Share
from workbench.diagnose.verdict.probability import CALIBRATION, calibration, rank
from workbench.diagnose.verdict.records import Hypothesis
from workbench.reports.blind import tables

WEIGHT = "unknown_"  # of what speaks for an unknown cause; the bias is the logistic's own
EVIDENCE = tuple(
    name.removeprefix(WEIGHT) for name in calibration() if name.startswith(WEIGHT) and name != f"{WEIGHT}bias"
)
SEED = 7001  # of the campaigns that calibrate; what is scored has another one
SEALED, WITHHELD = "sealed", "withheld"
LEAST_THRESHOLD = 4.0
FALSE_ALARMS = 0.02
INSIDE = 0.90


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the campaigns and their answers")
    parser.add_argument("--make", type=int, metavar="N", help="make and diagnose N campaigns of all families first")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--leave-out", action="store_true", help="judge each family by the calibration of the others")
    parser.add_argument("--sensitivity", action="store_true", help="say what 30 %% of each number changes")
    parser.add_argument("--write", action="store_true", help="write workbench/diagnose/verdict/calibration.json")
    given = parser.parse_args()
    if given.make:
        made(given.folder, given.make, given.processes)
    rows = rows_of(given.folder)
    if given.leave_out:
        anew = left_out(rows)
        for family in sorted({family_of(row) for row in anew}):
            print(f"\n{family}\n{tables.sheet([row for row in anew if family_of(row) == family]).markdown()}")
        return
    if given.sensitivity:
        print("\n".join(sensitivity(rows, calibration())))
        return
    numbers = fitted([row for row in rows if answered(row)])
    print(json.dumps(numbers, indent=1))
    if given.write:
        made_by = f"python -m benchmarks.calibrate, {len(rows)} answers on simulated campaigns"
        CALIBRATION.write_text(json.dumps({"made_by": made_by, "numbers": numbers}, indent=1) + "\n", encoding="utf-8")


def made(folder: Path, count: int, processes: int) -> None:
    """Campaigns of SEED and all families, diagnosed as they are and with the effect taken out; what is there stays."""
    sealed = folder / SEALED
    if not sealed.exists():
        make_asked(Asked(cases=count, seed=SEED), sealed, processes=processes, tell=print)
    run(sealed, processes=processes, tell=print)
    score = open_and_score(sealed, key_of(sealed))
    left = [row for row in score.rows if single(row) and not (folder / WITHHELD / f"{row['folder']}.json").exists()]
    with mapped(processes) as over:
        for k, name in enumerate(over(partial(_with_effect_out, score, folder / WITHHELD), left)):
            print(f"{k + 1}/{len(left)} with its effect taken out: {name}")


def _with_effect_out(score: Score, answers: Path, row: Mapping[str, Any]) -> str:
    name = str(row["folder"])
    given = answer(score.folder / CAMPAIGNS / name, row["label"]["effects"])
    save(text_of(given), answers / f"{name}.json")
    return name


def rows_of(folder: Path) -> list[Mapping[str, Any]]:
    """All answers of a folder that `made` wrote, joined with their labels."""
    score = open_and_score(folder / SEALED, key_of(folder / SEALED))
    labels = {row["folder"]: row["label"] for row in score.rows}
    withheld = load(folder / WITHHELD) if (folder / WITHHELD).is_dir() else {}
    return [*score.rows, *({**row, "label": labels[name]} for name, row in withheld.items())]


def answered(row: Mapping[str, Any]) -> bool:
    """The diagnosis gave an answer."""
    return row["word"] not in ("refused", "failed")


def left_out(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each family's answers anew, by the calibration that all other families give."""
    anew: list[dict[str, Any]] = []
    for family in sorted({family_of(row) for row in rows}):
        others = [row for row in rows if family_of(row) != family and answered(row)]
        numbers = fitted(others)
        anew += [_anew(row, numbers) for row in rows if family_of(row) == family]
    return anew


def sensitivity(rows: Sequence[Mapping[str, Any]], numbers: Mapping[str, float]) -> list[str]:
    """A line for each number: the answers that are right with it as it is, and 30 % smaller and larger."""
    lines = ["| number | value | right | 30 % smaller | 30 % larger |", "|---|---|---|---|---|"]
    for name, value in numbers.items():
        if name in ("interval", "pair"):  # these act before the ranking: answers are to be given anew
            continue
        tried = [{**numbers, name: factor * value} for factor in (1.0, 0.7, 1.3)]
        shown = [Share.counted((_anew(row, each) for row in rows), right).text() for each in tried]
        lines.append(f"| {name} | {value:g} | {' | '.join(shown)} |")
    return lines


def _anew(row: Mapping[str, Any], numbers: Mapping[str, float]) -> dict[str, Any]:
    """The answer that other numbers would have given; what was fitted stays."""
    if not answered(row):
        return dict(row)
    ranking = _ranked(row, numbers)
    rows = [(hypothesis.verdict, list(hypothesis.effects), hypothesis.probability) for hypothesis in ranking]
    return {**row, "word": rows[0][0], "names": rows[0][1], "ranking": rows}


def _ranked(row: Mapping[str, Any], numbers: Mapping[str, float]) -> tuple[Hypothesis, ...]:
    twins = [[tuple(names) for names in group] for group in row.get("twins") or ()]
    return rank(_merits(row), row["evidence"], numbers, twins)


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
        for hypothesis in _ranked(row, numbers)
        if hypothesis.verdict == word
        and (word != "named" or effects in [set(names) for names in (hypothesis.effects, *hypothesis.twins)])
    )


def _interval(rows: Sequence[Mapping[str, Any]]) -> float:
    """The factor on standard errors at which nine of ten true values lie within the 90 % interval."""
    ratios = sorted(ratio for row in rows for _, _, ratio in estimates_within(row))
    if not ratios:
        return 1.0
    return ratios[min(len(ratios) - 1, math.ceil(INSIDE * len(ratios)) - 1)] / 1.6449


if __name__ == "__main__":
    main()
