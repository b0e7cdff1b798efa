"""The hypotheses of a diagnosis as tables: candidates, probabilities, parameters of the named effects."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.core.table import Column, Table, words
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.records import Diagnosis
from workbench.diagnose.verdict.answer import Candidate, Hypothesis
from workbench.reports.diagnosis.words import hypothesis_name, unit_of
from workbench.view.numbers import NOTHING, figures, with_error

WORTH_A_BAR = 1e-3  # of probability


def ranking_table(rows: Sequence[Hypothesis], most: int) -> list[tuple[str, str, float]]:
    """(verdict, name, probability) of the most probable, at least three; the rest in one row without verdict."""
    order = sorted(rows, key=lambda row: -row.probability)
    most = min(most, max(sum(row.probability >= WORTH_A_BAR for row in order), 3))
    shown = [
        (str(row.verdict), hypothesis_name(row.verdict, row.effects, row.non_identifiable), row.probability)
        for row in order[:most]
    ]
    if rest := order[most:]:
        name = "1 other" if len(rest) == 1 else f"{len(rest)} others together"
        shown.append(("", name, sum(row.probability for row in rest)))
    return shown


def candidates_table(d: Diagnosis, most: int | None = None, *, brief: bool = False) -> Table:
    """The hypotheses that were fitted and those whose fit failed, in the order of the diagnosis.

    most: largest number of rows. brief: only fitted hypotheses, without parameters and objections.
    """
    unit = unit_of(d)
    columns = [words("hypothesis"), Column("proba-\nbility"), Column("explains", "%"), Column("residual", unit),
               Column("held out", unit), Column("merit")]  # fmt: skip
    if not brief:
        columns += [words("parameters ± standard error"), words("what speaks against it")]
    probability = {
        frozenset(names): h.probability
        for h in d.verdict.ranking
        if h.verdict == "named"
        for names in (h.effects, *h.non_identifiable)
    }
    rows = []
    for candidate in [c for c in d.candidates if c.fitted or (c.failure and not brief)][:most]:
        p = probability.get(frozenset(candidate.effects))
        explained = candidate.explained
        row = [
            hypothesis_name("named", candidate.effects).replace(" + ", " +\n" if brief else " + "),
            NOTHING if p is None else percent(p),
            # Of a gap that is none there is no share.
            NOTHING if explained is None or d.verdict.word == "no_gap" else f"{100.0 * explained:.0f}",
            _known(candidate.residual_rms), _known(candidate.held_out_rms), _merit(candidate),
        ]  # fmt: skip
        rows.append(row if brief else [*row, _parameters(candidate), _against(candidate)])
    return Table(columns, rows, _candidates_note(len(d.candidates) - len(rows)))


def _candidates_note(left_out: int) -> str:
    more = (
        f" {left_out} more hypotheses were weighed, most of them linearly only, for they promised less than these; "
        "diagnosis.json has them all."
        if left_out > 0
        else ""
    )
    return (
        "Explains: the share of the gap's energy. Held out: residual rms of runs that the fit did not see. Merit: gain "
        "in the penalised likelihood, less what its parameters cost; below 0 it is not worth them. Names end in their "
        f"units.{more}"
    )


def percent(probability: float) -> str:
    """A probability in per cent, with one more digit near 0 and 1."""
    p = 100.0 * probability
    if p < 0.1:
        return "< 0.1 %"
    if p > 99.9:
        return "> 99.9 %"
    return f"{p:.1f} %" if p < 10.0 or p > 99.0 else f"{p:.0f} %"


def _known(value: float | None) -> str:
    return NOTHING if value is None else figures(value)


def _merit(candidate: Candidate) -> str:
    return f"{candidate.evidence:.0f}" if candidate.fitted and math.isfinite(candidate.evidence) else NOTHING


def _parameters(candidate: Candidate) -> str:
    return "; ".join(
        f"{one.name} {said}"
        for estimates in candidate.parameters.values()
        for one in estimates
        for said in [_said(one)]
    )


def _said(one: Estimate) -> str:
    pairs = [with_error(*pair) for pair in values_of(one)]
    if len(pairs) == 1:
        return _with(*pairs[0])
    return f"of each run: {', '.join(_with(*pair) for pair in pairs)}"


def _with(value: str, error: str) -> str:
    """A value with its standard error. Without one, the value is on a bound or its effect has vanished."""
    return f"{value} (not determined)" if error == NOTHING else f"{value} ± {error}"


def values_of(one: Estimate) -> list[tuple[float, float]]:
    """(value, standard error), of each run where it is each run's own."""
    values = one.value if isinstance(one.value, tuple) else (one.value,)
    errors = one.std_error if isinstance(one.std_error, tuple) else (one.std_error,)
    return list(zip(values, errors, strict=True))


def _against(candidate: Candidate) -> str:
    if candidate.failure:
        return f"its fit broke down: {candidate.failure}"
    return "; ".join(candidate.against)


def chosen_candidate(d: Diagnosis) -> Candidate | None:
    """The candidate that the verdict names."""
    if d.verdict.word != "named":
        return None
    return next((c for c in d.candidates if set(c.effects) == set(d.verdict.effects)), None)


def parameters_table(d: Diagnosis, note: str = "") -> Table:
    """The parameters of the named effects, one row for each value; no rows if none is named."""
    chosen = chosen_candidate(d)
    columns = [words("effect"), words("parameter"), Column("value"), Column("± std\nerror")]
    rows: list[list[str]] = []
    for effect, estimates in () if chosen is None else chosen.parameters.items():
        for one in estimates:
            own = isinstance(one.value, tuple)
            for run, pair in zip(d.campaign.runs if own else [None], values_of(one), strict=True):
                rows.append([effect, one.name if run is None else f"{one.name}, run {run.name}", *with_error(*pair)])
    return Table(columns, rows, note)
