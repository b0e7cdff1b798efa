"""`python -m benchmarks.calibrate FOLDER --make 120`: the numbers by which evidence becomes probability.

Fitted on campaigns of the simulators of a seed that is kept for it (SEED), and on blind tests that are open, so of no
further use as such (`--with TEST...`); nothing recorded takes part. With `--make N` the campaigns are made and
diagnosed first, in FOLDER, as `workbench blind` does it; what is there stays, and everything else needs no more than
the kept answers. What is stated of an answer (`missed_*`, see `verdict/answer.py`) is fitted by the
likelihood of the answers being right or wrong; it changes no answer. What decides is set by hand;
`benchmarks.sensitivity` says what an error in each number would change.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.blind.make import Asked, make
from workbench.blind.measures import (
    calibration_by_chance,
    calibration_error,
    family_of,
    kind_of,
    pair,
    right_as_stated,
    right_word,
    single,
)
from workbench.blind.run import run
from workbench.blind.score import open_and_score
from workbench.blind.seal import key_of
from workbench.core.run import Array
from workbench.diagnose.hypotheses.evidence import price
from workbench.diagnose.hypotheses.settings import CALIBRATION, THRESHOLD, calibration
from workbench.diagnose.verdict.answer import Hypothesis, logistic_argument, none_missed, rank

Row = Mapping[str, Any]
STATED = ("missed_no_gap", "missed_unknown")
ONE = 1.0  # campaign more that was missed, and one that was not: shares of few campaigns are neither 0 nor 1
SEED = 7001  # of the campaigns that calibrate; what is scored has another one
SEALED, ANSWERED_WITH = "sealed", "calibration.json"
SURE = (-30.0, 30.0)  # arguments of the logistic: as good as no unknown cause, and as nothing else


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the campaigns and their answers")
    parser.add_argument("--make", type=int, metavar="N", help="make and diagnose N campaigns of all families first")
    parser.add_argument("--first", type=int, metavar="N", help="diagnose the first N of them only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--leave-out", action="store_true", help="judge each family by the calibration of the others")
    parser.add_argument(
        "--with", dest="tests", type=Path, nargs="+", default=[], metavar="TEST", help="fit to these, too"
    )
    parser.add_argument(
        "--judge", type=Path, nargs="+", default=[], metavar="TEST", help="judge opened blind tests by it"
    )
    parser.add_argument("--write", action="store_true", help="write workbench/diagnose/hypotheses/calibration.json")
    given = parser.parse_args()
    if given.make:
        made(given.folder, given.make, given.processes, first=given.first)
    rows = [*rows_of(given.folder), *(row for test in given.tests for row in opened(test))]
    numbers = fitted([row for row in rows if answered(row)])
    print(json.dumps(numbers, indent=1))
    if given.leave_out:
        print("\n".join(by_family(rows, left_out(rows))))
    for test in given.judge:
        judged = opened(test)
        print("\n".join(by_family(judged, [_anew(row, numbers) for row in judged])))
    if given.write:
        made_by = f"python -m benchmarks.calibrate, {len(rows)} answers"
        kept = {"made_by": made_by, "numbers": {name: numbers[name] for name in STATED}}
        CALIBRATION.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def made(folder: Path, count: int, processes: int, *, first: int | None = None) -> None:
    """Campaigns of SEED and all families, diagnosed as they are; what is there stays. first: so many of them, in their
    mixed order."""
    sealed = folder / SEALED
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / ANSWERED_WITH).exists():
        (folder / ANSWERED_WITH).write_text(json.dumps(calibration(), indent=1) + "\n", encoding="utf-8")
    if not sealed.exists():
        make(Asked(cases=count, seed=SEED), sealed, processes=processes, tell=print)
    run(sealed, processes=processes, count=first, tell=print)


def rows_of(folder: Path) -> list[Row]:
    """All answers of a folder that `made` wrote, joined with their labels."""
    return list(open_and_score(folder / SEALED, key_of(folder / SEALED)).rows)


def opened(test: Path) -> list[Row]:
    """All answers of a blind test that was scored, joined with their labels. They belong to no later score."""
    return list(open_and_score(test, key_of(test)).rows)


def answered(row: Row) -> bool:
    """The diagnosis gave an answer."""
    return row["word"] not in ("refused", "failed")


def left_out(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Each family's answers anew, by the calibration that all other families give; in the order of the families."""
    anew: list[dict[str, Any]] = []
    for family in sorted({family_of(row) for row in rows}):
        others = [row for row in rows if family_of(row) != family and answered(row)]
        numbers = fitted(others)
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
        was = [row for row in before if family in ("all", family_of(row))]
        now = [row for row in after if family in ("all", family_of(row))]
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


def _anew(row: Row, numbers: Mapping[str, float]) -> dict[str, Any]:
    """The answer that other numbers would have given; what was fitted stays."""
    if not answered(row):
        return dict(row)
    rows = [(one.verdict, list(one.effects), one.probability) for one in _ranked(row, numbers)]
    return {**row, "word": rows[0][0], "names": rows[0][1], "ranking": rows}


def _ranked(row: Row, numbers: Mapping[str, float]) -> tuple[Hypothesis, ...]:
    twins = [[tuple(names) for names in group] for group in row.get("twins") or ()]
    counted = [(tuple(names), float(merit)) for names, merit in row["counted"]]
    stands = any(names and merit > THRESHOLD for names, merit in counted)
    if row["word"] == "unknown" and kind_of(row) == "hoist":
        numbers = none_missed(row["evidence"], stands, numbers)
    return rank(counted, row["evidence"], numbers, price(kind_of(row)), twins)


def fitted(rows: Sequence[Row]) -> dict[str, float]:
    """The calibration with what is stated of an answer fitted anew."""
    numbers = dict(calibration())
    numbers |= _stated(rows, numbers)
    return {name: float(f"{value:.4g}") for name, value in numbers.items()}


def _stated(rows: Sequence[Row], numbers: Mapping[str, float]) -> dict[str, float]:
    """What is stated: the numbers under which the answers are likeliest to be right and wrong as they are."""
    from scipy.optimize import minimize

    outcome = np.array([right_as_stated(_anew(row, numbers)) for row in rows], dtype=bool)
    corners = _corners(rows, numbers)

    def numbers_of(values: Sequence[float]) -> dict[str, float]:
        return dict(zip(STATED, map(_share, values), strict=True))

    def loss(values: Sequence[float]) -> float:
        p = np.clip(corners.stated(numbers_of(values)), 1e-4, 1.0 - 1e-4)
        unlikely = -ONE * sum(math.log(_share(v)) + math.log(1.0 - _share(v)) for v in values)
        return float(unlikely - np.sum(np.log(np.where(outcome, p, 1.0 - p))))

    best = minimize(loss, [-2.0] * len(STATED), method="L-BFGS-B", bounds=[(-6.0, 6.0)] * len(STATED))
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
        """(n,) of the answers, by `missed_*`."""
        unknown = 1.0 / (1.0 + np.exp(-np.clip(self.x, -50.0, 50.0)))
        missed = (np.full(len(unknown), numbers[name]) for name in STATED)
        weights = (np.stack([1.0 - p, p]) for p in (unknown, *missed))
        return np.asarray(np.einsum("in,jn,kn,ijkn->n", *weights, self.at))


def _corners(rows: Sequence[Row], numbers: Mapping[str, float]) -> Corners:
    at = np.zeros((2, 2, 2, len(rows)))
    for n, row in enumerate(rows):
        answer = _ranked(row, numbers)[0]
        plain = {**row, "evidence": dict.fromkeys(row["evidence"], 0.0)}
        for i, j, k in itertools.product((0, 1), repeat=3):
            corner = {"unknown_bias": SURE[i], "missed_no_gap": j, "missed_unknown": k}
            at[i, j, k, n] = _of(answer, _ranked(plain, {**numbers, **corner}))
    x = [logistic_argument(row["evidence"], numbers) for row in rows]
    return Corners(np.array(x), at)


def _of(answer: Hypothesis, ranking: Sequence[Hypothesis]) -> float:
    return next(h.probability for h in ranking if (h.verdict, h.effects) == (answer.verdict, answer.effects))


def _share(logit: float) -> float:
    return 1.0 / (1.0 + math.exp(-logit))


if __name__ == "__main__":
    main()
