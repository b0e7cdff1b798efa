"""The verdict in one sentence."""

from __future__ import annotations

from workbench.diagnose.records import Gap, Names, Shrink
from workbench.diagnose.verdict.judge import Judged


def sentence_of(judged: Judged, gap: Gap, shrink: Shrink, also: Names, tabled: bool = False) -> str:
    """What an engineer reads first: the answer, how sure, and how far the gap shrinks.

    tabled: the corrected machine holds the measured force of an unknown cause.
    """
    unit = shrink.unit
    sure = sum(row.probability for row in judged.ranking if row.verdict == judged.word)
    size = f"{gap.residual_rms:.2g} {unit} rms below {gap.band_hz:.2g} Hz, noise {gap.noise_rms:.2g} {unit}"
    if judged.word == "no_gap":
        return f"No gap: within its tolerances the model explains these runs ({size}; {chance(sure)})."
    if judged.word == "unknown":
        # Rivals are weighed beside what may be named: one of them may well explain it.
        which = "listed effect" if any(each.rival for each in judged.weighed) else "effect of the library"
        return (
            f"The gap ({size}) has a cause that no {which} explains ({chance(sure)}); "
            + (
                f"with its measured force, which is in the corrected machine, {shrink.after:.2g} {unit} are left"
                if tabled
                else "no table of it keeps what it promises, so the machine holds none"
            )
            + "."
        )
    likeliest = next(row.probability for row in judged.ranking if row.effects == judged.names)
    text = f"The gap comes from {' and '.join(judged.names)} ({chance(likeliest)}): "
    text += (
        f"on runs held out it shrinks from {shrink.before:.2g} to {shrink.after:.2g} {unit}, noise {shrink.noise:.2g}"
    )
    if also:
        text += f"; these runs cannot tell it from {', '.join(also)}"
    return text + "."


def chance(probability: float) -> str:
    """A probability in words that claims no certainty."""
    return "probability over 0.99" if probability > 0.99 else f"probability {probability:.2f}"
