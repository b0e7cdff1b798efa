"""The verdict in one sentence."""

from __future__ import annotations

from workbench.diagnose.hypotheses.records import Names
from workbench.diagnose.shrink import Shrink
from workbench.diagnose.verdict.judge import Judged, twins


def listed(names: Names) -> str:
    """a; a and b; a, b and c."""
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last


def sentence_of(judged: Judged, shrink: Shrink, also: Names, tabled: bool = False) -> str:
    """The first sentence of the report: the answer, its probability, and the reduction of the gap.

    tabled: whether the corrected machine contains the measured force of an unknown cause.
    """
    unit = shrink.unit
    sure = sum(row.probability for row in judged.ranking if row.verdict == judged.word)
    size = f"{shrink.before:.2g} {unit} rms on runs held out, noise {shrink.noise:.2g} {unit}"
    if judged.word == "no_gap":
        return f"No gap: within its tolerances the model explains these runs ({size}; {chance(sure)})."
    if judged.word == "unknown":
        # Rivals are weighed beside what may be named: one of them may well explain it.
        which = "listed effect" if any(hypothesis.rival for hypothesis in judged.weighed) else "effect of the library"
        return (
            f"The gap ({size}) has a cause that no {which} explains ({chance(sure)}); "
            + (
                f"with its measured force, which is in the corrected machine, {shrink.after:.2g} {unit} are left"
                if tabled
                else "no table of it keeps what it promises, so the machine holds none"
            )
            + "."
        )
    same = twins(judged, also)
    answers = {judged.names, *((name,) for name in same)}
    likely = sum(row.probability for row in judged.ranking if row.effects in answers)
    text = f"The gap comes from {listed(judged.names)} ({chance(likely)}): "
    if same:
        text = f"The gap comes from {' or '.join((*judged.names, *same))}, one cause by two names in these runs "
        text += f"({chance(likely)}): "
    text += (
        f"on runs held out it shrinks from {shrink.before:.2g} to {shrink.after:.2g} {unit}, noise {shrink.noise:.2g}"
    )
    text += f". It explains {_percent(judged.explained)} of the gap's energy"
    if judged.left.rms > 0.0:
        text += (
            f"; {judged.left.rms:.2g} {unit} beyond noise stay, {judged.left.percent_of_input:.2g} % of the input, "
            + ("enough to change a conclusion" if judged.left.relevant else "too little to change a conclusion")
        )
    if others := [name for name in also if name not in same]:
        text += f"; these runs cannot tell it from {', '.join(others)}"
    return text + "."


def _percent(share: float) -> str:
    """A share of the energy in per cent, with enough digits near 100."""
    if share >= 0.9999:
        return "over 99.99 %"
    return f"{100.0 * share:.2f} %" if share > 0.99 else f"{100.0 * share:.0f} %"


def chance(probability: float) -> str:
    """A probability in words; above 0.99 it is not given exactly."""
    return "probability over 0.99" if probability > 0.99 else f"probability {probability:.2f}"
