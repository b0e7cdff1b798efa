"""The verdict in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.diagnose.hypotheses.free_parameters import Names
from workbench.diagnose.shrink import Shrink
from workbench.diagnose.verdict.answer import Remainder
from workbench.diagnose.verdict.judge import Judged

MOSTLY = {
    "speed": "with speed",
    "low_speed": "near standstill",
    "acceleration": "with acceleration",
    "load": "with the load",
    "position": "with position",
    "time": "over time",
    "start": "after each start",
    "periodic": "periodically",
}  # regime of a remainder -> how it shows


def listed(names: Names) -> str:
    """a; a and b; a, b and c."""
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last


def either(names: Names, twins: Sequence[Names]) -> str:
    """a; a or b, one cause by two names in these runs; and with what they share: …, and c."""
    if not twins:
        return listed(names)
    others = list(dict.fromkeys(name for twin in twins for name in twin if name not in names))
    shared = [name for name in names if all(name in twin for twin in twins)]
    own = [name for name in names if name not in shared]
    count = {1: "two", 2: "three"}.get(len(others), "several")
    text = f"{' or '.join([*own, *others])}, one cause by {count} names in these runs"
    return f"{text}, and {listed(tuple(shared))}" if shared else text


def sentence_of(judged: Judged, shrink: Shrink, rest: Remainder, also: Names, tabled: bool = False) -> str:
    """The first sentence of the report: the answer, its probability, and the reduction of the gap.

    tabled: whether the corrected machine contains the measured force of an unknown cause.
    """
    unit = shrink.unit
    sure = judged.ranking[0].probability
    size = f"{shrink.before:.2g} {unit} rms on runs held out, noise {shrink.noise:.2g} {unit}"
    if judged.word == "no_gap":
        return f"No gap: within its tolerances the model explains these runs ({size}; {chance(sure)})."
    if judged.word == "unknown":
        # Rivals are weighed beside what may be named: one of them may well explain it.
        which = "listed effect" if any(hypothesis.rival for hypothesis in judged.weighed) else "effect of the library"
        head = f"The gap ({size}) has a cause that no {which} explains ({chance(sure)})"
        if sure < 0.5:  # a listed cause is likelier, and the fits do not find it
            head = (
                f"No {which} as it was fitted explains the gap ({size}); {chance(sure)} that its cause is none of them"
            )
        return (
            f"{head}; "
            + (
                f"with its measured force, which is in the corrected machine, {shrink.after:.2g} {unit} are left"
                if tabled
                else "no table of it keeps what it promises, so the machine holds none"
            )
            + "."
        )
    same = judged.of_answer
    text = f"The gap comes from {either(judged.names, same)} ({chance(sure)}): "
    text += (
        f"on runs held out it shrinks from {shrink.before:.2g} to {shrink.after:.2g} {unit}, noise {shrink.noise:.2g}"
    )
    text += f". It explains {_percent(1.0 - rest.share)} of the gap's energy beyond noise"
    if rest.rms > 0.0:
        text += (
            f"; {rest.rms:.2g} {unit} remain, {rest.percent_of_input:.2g} % of the input, "
            + (f"mostly {MOSTLY[rest.regime]}, " if rest.relevant and rest.regime in MOSTLY else "")
            + ("enough to change a conclusion" if rest.relevant else "too little to change a conclusion")
        )
    if others := [name for name in also if not any(name in names for names in same)]:
        it = "it" if len(judged.names) == 1 else "one of them"
        text += f"; these runs cannot tell {it} from {', '.join(others)}"
    return text + "."


def _percent(share: float) -> str:
    """A share of the energy in per cent, with enough digits near 100."""
    if share >= 0.9999:
        return "over 99.99 %"
    return f"{100.0 * share:.2f} %" if share > 0.99 else f"{100.0 * share:.0f} %"


def chance(probability: float) -> str:
    """A probability in words; above 0.99 it is not given exactly."""
    return "probability over 0.99" if probability > 0.99 else f"probability {probability:.2f}"
