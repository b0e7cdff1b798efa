"""The hypotheses of a diagnosis as tables: what was weighed, how likely it is, and the named effects' numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.diagnose.records import Candidate, Diagnosis, Estimate, Hypothesis
from workbench.reports.diagnosis.words import hypothesis_name, unit_of
from workbench.reports.numbers import NOTHING, figures, with_error

Row = list[str]
PARAMETERS_HEAD = (" effect", " parameter", "value", "± std\nerror")
WORTH_A_BAR = 1e-3  # of probability


def ranking_table(rows: Sequence[Hypothesis], most: int) -> list[tuple[str, str, float]]:
    """(verdict, name, probability) of the likeliest, at least three; all others as one, under an empty verdict."""
    order = sorted(rows, key=lambda each: -each.probability)
    most = min(most, max(sum(each.probability >= WORTH_A_BAR for each in order), 3))
    shown = [
        (str(each.verdict), hypothesis_name(each.verdict, each.effects), each.probability) for each in order[:most]
    ]
    if rest := order[most:]:
        shown.append(("", f"{len(rest)} others together", sum(each.probability for each in rest)))
    return shown


def candidates_head(d: Diagnosis, *, brief: bool = False) -> tuple[str, ...]:
    unit = unit_of(d)
    head = (" hypothesis", "proba-\nbility", "explains\n%", f"residual\n{unit}", f"held out\n{unit}", "merit")
    return head if brief else (*head, " parameters ± standard error", " what speaks against it")


def candidates_table(d: Diagnosis, most: int | None = None, *, brief: bool = False) -> list[Row]:
    """The hypotheses that were fitted and those whose fit broke down, in the diagnosis' order.

    most: so many at most. brief: the fitted ones only, without parameters and objections.
    """
    probability = {
        frozenset(each.effects): each.probability for each in d.verdict.ranking if each.verdict == "named"
    }  # fmt: skip
    rows = []
    for each in [each for each in d.candidates if each.fitted or (each.failure and not brief)][:most]:
        p = probability.get(frozenset(each.effects))
        row = [
            hypothesis_name("named", each.effects).replace(" + ", " +\n" if brief else " + "),
            NOTHING if p is None else percent(p),
            # Of a gap that is none there is no share.
            NOTHING if each.explained is None or d.verdict.word == "no_gap" else f"{100.0 * each.explained:.0f}",
            _known(each.residual_rms), _known(each.held_out_rms), _merit(each),
        ]  # fmt: skip
        rows.append(row if brief else [*row, _parameters(each), _against(each)])
    return rows


def percent(probability: float) -> str:
    """With a digit more near 0 and 1."""
    p = 100.0 * probability
    if p < 0.1:
        return "< 0.1 %"
    if p > 99.9:
        return "> 99.9 %"
    return f"{p:.1f} %" if p < 10.0 or p > 99.0 else f"{p:.0f} %"


def _known(value: float | None) -> str:
    return NOTHING if value is None else figures(value)


def _merit(each: Candidate) -> str:
    return f"{each.merit:.0f}" if each.fitted and math.isfinite(each.merit) else NOTHING


def _parameters(each: Candidate) -> str:
    return "; ".join(
        f"{one.name} {said}" for estimates in each.parameters.values() for one in estimates for said in [_said(one)]
    )


def _said(one: Estimate) -> str:
    pairs = [with_error(*pair) for pair in values_of(one)]
    if len(pairs) == 1:
        return _with(*pairs[0])
    return f"of each run: {', '.join(_with(*pair) for pair in pairs)}"


def _with(value: str, error: str) -> str:
    """A value without an error does not move the prediction: it sits on a bound, or its effect has vanished."""
    return f"{value} (not determined)" if error == NOTHING else f"{value} ± {error}"


def values_of(one: Estimate) -> list[tuple[float, float]]:
    """(value, standard error), of each run where it is each run's own."""
    values = one.value if isinstance(one.value, tuple) else (one.value,)
    errors = one.std_error if isinstance(one.std_error, tuple) else (one.std_error,)
    return list(zip(values, errors, strict=True))


def _against(each: Candidate) -> str:
    if each.failure:
        return f"its fit broke down: {each.failure}"
    return "; ".join(each.against)


def chosen_candidate(d: Diagnosis) -> Candidate | None:
    """The one that the verdict names."""
    if d.verdict.word != "named":
        return None
    return next((each for each in d.candidates if set(each.effects) == set(d.verdict.effects)), None)


def parameters_table(d: Diagnosis) -> list[Row]:
    """The named effects' numbers, a line a value."""
    chosen = chosen_candidate(d)
    if chosen is None:
        return []
    rows = []
    for effect, estimates in chosen.parameters.items():
        for one in estimates:
            own = isinstance(one.value, tuple)
            for run, pair in zip(d.campaign.runs if own else [None], values_of(one), strict=True):
                rows.append([effect, one.name if run is None else f"{one.name}, run {run.name}", *with_error(*pair)])
    return rows
