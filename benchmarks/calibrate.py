"""`python -m benchmarks.calibrate FOLDER --make 120`: the numbers by which evidence becomes probability.

Fitted on campaigns of the simulators of a seed that is kept for it (SEED), and on blind tests that are open, so of no
further use as such (`--with TEST...`); nothing recorded takes part. With `--make N` the campaigns are made and
diagnosed first, in FOLDER, as `workbench blind` does it; what is there stays, and everything else needs no more than
the kept answers. What is stated of an answer (`surer`, `missed_*`, see `verdict/answer.py`) is fitted by the
likelihood of the answers being right or wrong; it changes no answer.

With `--decide` the numbers that decide are fitted too: every campaign of a single effect is diagnosed once more with
the effect taken out of the library, the weights of an unknown cause are a logistic regression (scikit-learn) with no
weight below zero, the temperature is the one under which the answers' probabilities are most likely, and the threshold
is what the best hypothesis of machines without a gap stays below in all but one of fifty.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from workbench.blind.answer import answer, load, save, text_of
from workbench.blind.make import Asked, make, mapped
from workbench.blind.measures import (
    Share,
    calibration_by_chance,
    calibration_error,
    family_of,
    pair,
    right,
    right_as_stated,
    right_word,
    single,
)
from workbench.blind.run import run
from workbench.blind.score import Score, open_and_score
from workbench.blind.seal import CAMPAIGNS, key_of
from workbench.core.run import Array
from workbench.diagnose.hypotheses.settings import CALIBRATION, calibration
from workbench.diagnose.verdict.answer import Hypothesis, logistic_argument, rank

Row = Mapping[str, Any]
WEIGHT = "unknown_"  # of what speaks for an unknown cause; the bias is the logistic's own
EVIDENCE = tuple(
    name.removeprefix(WEIGHT) for name in calibration() if name.startswith(WEIGHT) and name != f"{WEIGHT}bias"
)
STATED = ("surer", "missed_no_gap", "missed_unknown")
FACTOR = 3.0  # by which `surer` may be off 1
ONE = 1.0  # campaign more that was missed, and one that was not: shares of few campaigns are neither 0 nor 1
SEED = 7001  # of the campaigns that calibrate; what is scored has another one
SEALED, WITHHELD, ANSWERED_WITH = "sealed", "withheld", "calibration.json"
LEAST_THRESHOLD = 4.0
FALSE_ALARMS = 0.02
INSIDE = 0.90
EQUAL = 0.01  # merit
SURE = (-30.0, 30.0)  # arguments of the logistic: as good as no unknown cause, and as nothing else
BEFORE_RANKING = ("pair",)  # to change these is to diagnose anew


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the campaigns and their answers")
    parser.add_argument("--make", type=int, metavar="N", help="make and diagnose N campaigns of all families first")
    parser.add_argument("--first", type=int, metavar="N", help="diagnose the first N of them only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--decide", action="store_true", help="fit the numbers that decide, too")
    parser.add_argument("--leave-out", action="store_true", help="judge each family by the calibration of the others")
    parser.add_argument(
        "--with", dest="tests", type=Path, nargs="+", default=[], metavar="TEST", help="fit to these, too"
    )
    parser.add_argument(
        "--judge", type=Path, nargs="+", default=[], metavar="TEST", help="judge opened blind tests by it"
    )
    parser.add_argument("--sensitivity", action="store_true", help="say what 30 %% of each number changes")
    parser.add_argument("--write", action="store_true", help="write workbench/diagnose/hypotheses/calibration.json")
    given = parser.parse_args()
    if given.make:
        made(given.folder, given.make, given.processes, first=given.first, withhold=given.decide)
    rows = [*rows_of(given.folder), *(row for test in given.tests for row in opened(test))]
    numbers = fitted([row for row in rows if answered(row)], given.decide)
    print(json.dumps(numbers, indent=1))
    if given.leave_out:
        print("\n".join(by_family(rows, left_out(rows, given.decide))))
    for test in given.judge:
        judged = opened(test)
        print("\n".join(by_family(judged, [_anew(row, numbers) for row in judged])))
    if given.sensitivity:
        print("\n".join(sensitivity(rows, numbers)))
    if given.write:
        what = "all" if given.decide else f"what decides: set by hand; {', '.join(STATED)}"
        made_by = f"{what}: python -m benchmarks.calibrate, {len(rows)} answers"
        CALIBRATION.write_text(json.dumps({"made_by": made_by, "numbers": numbers}, indent=1) + "\n", encoding="utf-8")


def made(folder: Path, count: int, processes: int, *, first: int | None = None, withhold: bool = False) -> None:
    """Campaigns of SEED and all families, diagnosed as they are; what is there stays. first: so many of them, in their
    mixed order. withhold: and once more with the effect taken out."""
    sealed = folder / SEALED
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / ANSWERED_WITH).exists():
        (folder / ANSWERED_WITH).write_text(json.dumps(dict(calibration()), indent=1) + "\n", encoding="utf-8")
    if not sealed.exists():
        make(Asked(cases=count, seed=SEED), sealed, processes=processes, tell=print)
    run(sealed, processes=processes, count=first, tell=print)
    if not withhold:
        return
    score = open_and_score(sealed, key_of(sealed))
    left = [row for row in score.rows if single(row) and not (folder / WITHHELD / f"{row['folder']}.json").exists()]
    with mapped(processes) as over:
        for k, name in enumerate(over(partial(_with_effect_out, score, folder / WITHHELD), left)):
            print(f"{k + 1}/{len(left)} with its effect taken out: {name}")


def _with_effect_out(score: Score, answers: Path, row: Row) -> str:
    name = str(row["folder"])
    given = answer(score.folder / CAMPAIGNS / name, row["label"]["effects"])
    save(text_of(given), answers / f"{name}.json")
    return name


def rows_of(folder: Path) -> list[Row]:
    """All answers of a folder that `made` wrote, joined with their labels."""
    score = open_and_score(folder / SEALED, key_of(folder / SEALED))
    labels = {row["folder"]: row["label"] for row in score.rows}
    withheld = load(folder / WITHHELD) if (folder / WITHHELD).is_dir() else {}
    return [*score.rows, *({**row, "label": labels[name]} for name, row in withheld.items())]


def opened(test: Path) -> list[Row]:
    """All answers of a blind test that was scored, joined with their labels. They belong to no later score."""
    rows = open_and_score(test, key_of(test)).rows
    return [row if "twins" in row else {**row, "twins": _equals(row)} for row in rows]


def _equals(row: Row) -> list[list[list[str]]]:
    """Twins, of an answer that was kept before twins were: of one merit, and of one name that differs."""
    groups: list[list[tuple[list[str], float]]] = []
    for names, merit in row["counted"]:
        if not names or merit <= 0.0:
            continue
        group = next((g for g in groups if abs(g[0][1] - merit) < EQUAL and _differ_by_one(g[0][0], names)), None)
        if group is None:
            groups.append([(names, merit)])
        else:
            group.append((names, merit))
    return [[list(names) for names, _ in group] for group in groups if len(group) > 1]


def _differ_by_one(one: Sequence[str], other: Sequence[str]) -> bool:
    return len(one) == len(other) and len(set(one) - set(other)) == 1


def answered(row: Row) -> bool:
    """The diagnosis gave an answer."""
    return row["word"] not in ("refused", "failed")


def left_out(rows: Sequence[Row], decide: bool = False) -> list[dict[str, Any]]:
    """Each family's answers anew, by the calibration that all other families give; in the order of the families."""
    anew: list[dict[str, Any]] = []
    for family in sorted({family_of(row) for row in rows}):
        others = [row for row in rows if family_of(row) != family and answered(row)]
        numbers = fitted(others, decide)
        anew += [_anew(row, numbers) for row in rows if family_of(row) == family]
    return anew


def by_family(before: Sequence[Row], after: Sequence[Row]) -> list[str]:
    """A line for each family and one for all: answers that are right, and the calibration error, before and after."""
    lines = [
        "| family | singles | pairs | no gap | unknown | error of what is stated, before | after | by chance |",
        "|---|---|---|---|---|---|---|---|",
    ]
    families = sorted({family_of(row) for row in after})
    for family in (*families, "all"):
        was = [row for row in before if family in ("all", family_of(row)) and not row.get("withheld")]
        now = [row for row in after if family in ("all", family_of(row)) and not row.get("withheld")]
        shares = [_right_before_and_after(was, now, case) for case in CASES.values()]
        errors = [calibration_error(was), calibration_error(now), calibration_by_chance(now)]
        shown = ["–" if error is None else f"{error:.3f}" for error in errors]
        lines.append(f"| {family} | {' | '.join([*shares, *shown])} |")
    return lines


CASES = {
    "singles": single,
    "pairs": pair,
    "no gap": lambda row: right_word(row) == "no_gap",
    "unknown": lambda row: right_word(row) == "unknown",
}


def _right_before_and_after(before: Sequence[Row], after: Sequence[Row], case: Any) -> str:
    """Right answers, exact twins counted as right: once where nothing changed."""
    was, now = ([right_as_stated(row) for row in rows if case(row)] for rows in (before, after))
    if not now:
        return "–"
    return f"{sum(now)} of {len(now)}" if sum(was) == sum(now) else f"{sum(was)} → {sum(now)} of {len(now)}"


def sensitivity(rows: Sequence[Row], numbers: Mapping[str, float]) -> list[str]:
    """A line for each number: the answers that are right, and the calibration error, with it as it is, and 30 % smaller
    and larger."""
    rows = [row for row in rows if not row.get("withheld")]
    lines = ["| number | value | right | 30 % smaller | 30 % larger |", "|---|---|---|---|---|"]
    for name, value in numbers.items():
        if name in BEFORE_RANKING:
            continue
        shown = []
        for factor in (1.0, 0.7, 1.3):
            changed = factor * value if name not in STATED[1:] else min(factor * value, 1.0)
            anew = [_anew(row, {**numbers, name: changed}) for row in rows]
            shown.append(f"{Share.counted(anew, right).text()}, {calibration_error(anew) or 0.0:.3f}")
        lines.append(f"| {name} | {value:g} | {' | '.join(shown)} |")
    return lines


def _anew(row: Row, numbers: Mapping[str, float]) -> dict[str, Any]:
    """The answer that other numbers would have given; what was fitted stays."""
    if not answered(row):
        return dict(row)
    rows = [(one.verdict, list(one.effects), one.probability) for one in _ranked(row, numbers)]
    return {**row, "word": rows[0][0], "names": rows[0][1], "ranking": rows}


def _ranked(row: Row, numbers: Mapping[str, float]) -> tuple[Hypothesis, ...]:
    twins = [[tuple(names) for names in group] for group in row.get("twins") or ()]
    return rank(_merits(row), row["evidence"], numbers, twins)


def _merits(row: Row) -> list[tuple[tuple[str, ...], float]]:
    return [(tuple(names), float(merit)) for names, merit in row["counted"]]


def fitted(rows: Sequence[Row], decide: bool = False) -> dict[str, float]:
    """decide: the numbers that decide, too."""
    numbers = dict(calibration())
    if decide:
        numbers["threshold"] = _threshold(rows)
        numbers |= _unknown(rows)
        numbers["temperature"] = _temperature(rows, numbers)
    numbers |= _stated(rows, numbers)
    return {name: float(f"{value:.4g}") for name, value in numbers.items()}


def _threshold(rows: Sequence[Row]) -> float:
    best = sorted(max((merit for _, merit in row["counted"]), default=-math.inf) for row in _without(rows))
    if not best:
        return float(calibration()["threshold"])
    return max(LEAST_THRESHOLD, best[min(len(best) - 1, math.ceil((1.0 - FALSE_ALARMS) * len(best)) - 1)] + 1.0)


def _without(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if not row["label"]["effects"]]


def _unknown(rows: Sequence[Row]) -> dict[str, float]:
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


def _temperature(rows: Sequence[Row], numbers: Mapping[str, float]) -> float:
    from scipy.optimize import minimize_scalar

    plain = {**numbers, "surer": 1.0, **dict.fromkeys(STATED[1:], 0.0)}

    def loss(log_t: float) -> float:
        tried = {**plain, "temperature": math.exp(log_t)}
        return -sum(math.log(max(_given_to_truth(row, tried), 1e-6)) for row in rows)

    return float(math.exp(minimize_scalar(loss, bounds=(-1.0, 4.0), method="bounded").x))


def _given_to_truth(row: Row, numbers: Mapping[str, float]) -> float:
    word, effects = right_word(row), set(row["label"]["effects"])
    return sum(
        hypothesis.probability
        for hypothesis in _ranked(row, numbers)
        if hypothesis.verdict == word
        and (word != "named" or effects in [set(names) for names in (hypothesis.effects, *hypothesis.twins)])
    )


def _stated(rows: Sequence[Row], numbers: Mapping[str, float]) -> dict[str, float]:
    """What is stated: the numbers under which the answers are likeliest to be right and wrong as they are.

    Answers of a library without the effect say nothing of how often an answer is right.
    """
    from scipy.optimize import minimize

    rows = [row for row in rows if not row.get("withheld")]
    outcome = np.array([right_as_stated(_anew(row, numbers)) for row in rows], dtype=bool)
    corners = _corners(rows, numbers)

    def numbers_of(values: Sequence[float]) -> dict[str, float]:
        return {"surer": math.exp(values[0])} | dict(zip(STATED[1:], map(_share, values[1:]), strict=True))

    def loss(values: Sequence[float]) -> float:
        p = np.clip(corners.stated(numbers_of(values)), 1e-4, 1.0 - 1e-4)
        unlikely = (values[0] / math.log(FACTOR)) ** 2
        unlikely -= ONE * sum(math.log(_share(v)) + math.log(1.0 - _share(v)) for v in values[1:])
        return float(unlikely - np.sum(np.log(np.where(outcome, p, 1.0 - p))))

    bounds = [(-math.log(FACTOR), math.log(FACTOR)), *[(-6.0, 6.0)] * (len(STATED) - 1)]
    begin = [0.0, *[-2.0] * (len(STATED) - 1)]
    best = minimize(loss, begin, method="L-BFGS-B", bounds=bounds)
    return numbers_of(best.x)


@dataclass(frozen=True)
class Corners:
    """What the probability of each answer is stated from, for it is linear in each `missed_*`, and in the share that no
    unknown cause takes.

    x: (n,) the argument of the logistic. at: (2, 2, 2, n) the probability where no unknown cause takes anything, or all
    (first index), where no gap is never missed, or always, and where an unknown cause is.
    """

    x: Array
    at: Array

    def stated(self, numbers: Mapping[str, float]) -> Array:
        """(n,) of the answers, by `surer` and `missed_*`."""
        x = np.where(self.x < 0.0, numbers["surer"] * self.x, self.x)
        unknown = 1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0)))
        missed = (np.full(len(x), numbers[name]) for name in STATED[1:])
        weights = (np.stack([1.0 - p, p]) for p in (unknown, *missed))
        return np.asarray(np.einsum("in,jn,kn,ijkn->n", *weights, self.at))


def _corners(rows: Sequence[Row], numbers: Mapping[str, float]) -> Corners:
    at = np.zeros((2, 2, 2, len(rows)))
    for n, row in enumerate(rows):
        answer = _ranked(row, numbers)[0]
        plain = {**row, "evidence": dict.fromkeys(row["evidence"], 0.0)}
        for i, j, k in itertools.product((0, 1), repeat=3):
            corner = {"unknown_bias": SURE[i], "missed_no_gap": j, "missed_unknown": k}
            at[i, j, k, n] = _of(answer, _ranked(plain, {**numbers, "surer": 1.0, **corner}))
    x = [logistic_argument(row["evidence"], numbers) for row in rows]
    return Corners(np.array(x), at)


def _of(answer: Hypothesis, ranking: Sequence[Hypothesis]) -> float:
    return next(h.probability for h in ranking if (h.verdict, h.effects) == (answer.verdict, answer.effects))


def _share(logit: float) -> float:
    return 1.0 / (1.0 + math.exp(-logit))


if __name__ == "__main__":
    main()
