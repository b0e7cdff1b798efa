"""The candidates as rows of a report: fit, parameters, held-out score, and what speaks against each."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from workbench.diagnose.hypotheses.evidence import Weighed
from workbench.diagnose.hypotheses.fit import estimates
from workbench.diagnose.hypotheses.free_parameters import Names, Scalar, key_told
from workbench.diagnose.hypotheses.held_out import folds_by_run, held_out, jackknifed, widened
from workbench.diagnose.hypotheses.search import TOLERANCES, SearchResult
from workbench.diagnose.hypotheses.signatures import other_waves
from workbench.diagnose.verdict.answer import Candidate
from workbench.diagnose.verdict.judge import Judged

SCORED = 3  # hypotheses whose held-out score is computed, at most
OPEN = 0.01  # probability: beside a named answer, what has less is not worth refits to all runs but one


def candidates(
    search: SearchResult,
    judged: Judged,
    keys: Mapping[str, Scalar],
    alike: Collection[Names] = (),
    most: int = SCORED,
) -> tuple[Candidate, ...]:
    """The answer and all other hypotheses weighed, the best first; then those that are barred, those with a linear fit
    only, and those whose fit failed. alike: those that share the answer's probability. These, and `most` of the others
    with the answer, are predicted on left-out runs, too."""
    problem, rows, folds = search.problem, list[Candidate](), folds_by_run(search.problem)
    without = held_out(problem, search.within_tolerances, folds).rms(problem.inputs)
    likely = {names for row in judged.ranking if row.probability > OPEN for names in (row.effects, *row.twins)}
    # A freer law that is alike may have the larger evidence.
    for k, hypothesis in enumerate(sorted(judged.weighed, key=lambda weighed: weighed.names != judged.names)):
        scored = k < most and (k == 0 or judged.word != "named" or hypothesis.names in likely)
        scored = scored or hypothesis.names in alike
        parameters, unseen = estimates(problem, hypothesis.fit), None
        if scored:
            found = held_out(problem, hypothesis.fit, folds)
            unseen = found.rms(problem.inputs)
            for of, every in parameters.items():
                weight, waves = other_waves(problem, hypothesis.fit, of, len(search.base.z))
                told = [widened(of, one, waves, weight) for one in every]
                parameters[of] = tuple(jackknifed(of, one, found) for one in told)
        gap, left = (max((rms or 0.0) ** 2 - problem.noise**2, 0.0) for rms in (without, unseen))
        against = _against(search, judged, hypothesis, keys)
        if unseen is not None and unseen > without:
            against.append("predicts a run it has not seen worse than without it")
        rows.append(
            Candidate(
                effects=hypothesis.names,
                gain=hypothesis.gain,
                merit=hypothesis.evidence,
                residual_rms=hypothesis.fit.rms(problem.inputs),
                held_out_rms=unseen,
                explained=None if unseen is None else max(1.0 - left / gap, 0.0) if gap > 0.0 else 0.0,
                parameters=parameters,
                fitted=True,
                against=tuple(against),
            )
        )
    rows += [
        Candidate(w.names, w.gain, w.evidence, w.fit.rms(problem.inputs), None, None, own, True, (why,))
        for w in judged.barred
        for own, why in [(estimates(problem, w.fit), judged.bars[w.names])]
    ]
    known = {hypothesis.names for hypothesis in (*judged.weighed, *judged.barred)}
    rows += [
        Candidate(names, gain, -math.inf, None, None, None, {}, False)
        for names, gain in sorted(search.linear.items(), key=lambda q: (-float(f"{q[1]:.5g}"), len(q[0]), q[0]))
        if names not in known and names not in search.failures
    ]
    rows += [
        Candidate(names, 0.0, -math.inf, None, None, None, {}, False, failure=why)
        for names, why in search.failures.items()
        if names not in known
    ]
    return tuple(rows)


def _against(search: SearchResult, judged: Judged, hypothesis: Weighed, keys: Mapping[str, Scalar]) -> list[str]:
    """The objections to a hypothesis, as sentences."""
    problem, fit, best, said = search.problem, hypothesis.fit, judged.best, list[str]()
    left = fit.rms(problem.inputs) / problem.noise
    if left > 1.5:
        said.append(f"leaves {left:.1f} times the noise")
    if hypothesis.rival:
        said.append("is none of the causes that are named unasked")
    if best is not None and hypothesis.names != best.names and best.gain - hypothesis.gain > 0.5:
        said.append(f"gains {best.gain - hypothesis.gain:.0f} less in chi-squared than {' and '.join(best.names)}")
    far = [
        (abs(float(z)) / parameter.std, key_told(key))
        for (key, parameter), z in zip(keys.items(), fit.z, strict=False)
        if not parameter.logarithmic and math.isfinite(parameter.std)
    ]
    worst = max(far, default=(0.0, ""))
    if worst[0] > TOLERANCES:
        said.append(f"needs {worst[1]} {worst[0]:.1f} tolerances off")
    return said
