"""The candidates as rows of a report: fit, parameters, held-out score, and what speaks against each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.evidence import Weighed
from workbench.diagnose.hypotheses.fit import Fitted, estimates
from workbench.diagnose.hypotheses.free_parameters import Scalar
from workbench.diagnose.hypotheses.held_out import folds_by_payload, folds_by_run, held_out
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.verdict.answer import Candidate
from workbench.diagnose.verdict.judge import Judged

SCORED = 3  # hypotheses whose held-out score is computed
FAR = 3.0  # tolerances


def candidates(search: SearchResult, judged: Judged, keys: Mapping[str, Scalar]) -> tuple[Candidate, ...]:
    """All weighed hypotheses, the best first; then those with a linear fit only, then those whose fit failed."""
    problem = search.problem
    gap = max(_energy(search, search.within_tolerances) - problem.noise**2, 1e-300)
    rows, folds = [], _folds(search)
    for k, hypothesis in enumerate(judged.weighed):
        unseen = (
            [held_out(problem, hypothesis.fit, f.fold_of_row).rms(problem.inputs) for f in folds[: 1 + (k == 0)]]
            if k < SCORED
            else []
        )
        rows.append(
            Candidate(
                effects=hypothesis.names,
                gain=hypothesis.gain,
                merit=hypothesis.evidence,
                residual_rms=hypothesis.fit.rms(problem.inputs),
                held_out_rms=unseen[0] if unseen else None,
                explained=float(
                    np.clip(
                        (_energy(search, search.within_tolerances) - _energy(search, hypothesis.fit)) / gap, 0.0, 1.0
                    )
                ),
                parameters=estimates(problem, hypothesis.fit),
                fitted=True,
                against=tuple(_against(search, judged, hypothesis, keys, list(zip(folds, unseen, strict=False)))),
            )
        )
    known = {hypothesis.names for hypothesis in judged.weighed}
    rows += [
        Candidate(names, gain, -math.inf, None, None, None, {}, False)
        for names, gain in sorted(search.linear.items(), key=lambda q: -q[1])
        if names not in known and names not in search.failures
    ]
    rows += [
        Candidate(names, 0.0, -math.inf, None, None, None, {}, False, failure=why)
        for names, why in search.failures.items()
        if names not in known
    ]
    return tuple(rows)


def _energy(search: SearchResult, fit: Fitted) -> float:
    return fit.rms(search.problem.inputs) ** 2


def _against(
    search: SearchResult,
    judged: Judged,
    hypothesis: Weighed,
    keys: Mapping[str, Scalar],
    unseen: Sequence[tuple[_Folds, float]],
) -> list[str]:
    """The objections to a hypothesis, as sentences."""
    problem, fit = search.problem, hypothesis.fit
    said = []
    left = fit.rms(problem.inputs) / problem.noise
    if left > 1.5:
        said.append(f"leaves {left:.1f} times the noise")
    best = judged.best
    if hypothesis.rival:
        said.append("is none of the causes that are named unasked")
    if best is not None and hypothesis.names != best.names and best.gain > hypothesis.gain:
        said.append(f"gains {best.gain - hypothesis.gain:.0f} less in chi-squared than {' and '.join(best.names)}")
    far = [
        (abs(float(z)) / parameter.std, key)
        for (key, parameter), z in zip(keys.items(), fit.z, strict=False)
        if not parameter.logarithmic and math.isfinite(parameter.std)
    ]
    worst = max(far, default=(0.0, ""))
    if worst[0] > FAR:
        said.append(f"needs {worst[1]} {worst[0]:.1f} tolerances off")
    said += [
        f"predicts a {f.what} it has not seen worse than without it" for f, left in unseen if left > 1.02 * f.without
    ]
    return said


@dataclass(frozen=True)
class _Folds:
    """One way of cross-validation: the fold of each row, and the held-out residual without any effect."""

    what: str
    fold_of_row: np.ndarray
    without: float


def _folds(search: SearchResult) -> list[_Folds]:
    problem = search.problem
    ways = (("run", folds_by_run(problem)), ("payload", folds_by_payload(problem)))
    return [
        _Folds(what, folds, held_out(problem, search.within_tolerances, folds).rms(problem.inputs))
        for what, folds in ways
        if folds is not None
    ]
