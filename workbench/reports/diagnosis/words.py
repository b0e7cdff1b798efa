"""A diagnosis in words: the meaning of the verdict and its probability, and the text of each step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.diagnose.records import Diagnosis
from workbench.diagnose.unexplained.words import over_what
from workbench.diagnose.verdict.answer import Hypothesis, Reason, ReasonKind, VerdictWord
from workbench.effects import Effect, effects_for
from workbench.machines import Axis, Hoist, kind_of, plant_of
from workbench.view.numbers import figures
from workbench.view.words import listed, words_of

SHRINKS = 1.02  # factor: less is none
RUN_AWAY = 100.0  # per cent of the speed's scale: a replay in open loop that is further off has left the motion
NO_GAP, UNKNOWN = "no gap", "unknown cause"


def hypothesis_name(verdict: VerdictWord, effects: Sequence[str], twins: Sequence[Sequence[str]] = ()) -> str:
    if verdict != "named":
        return {"no_gap": NO_GAP, "unknown": UNKNOWN}[verdict]
    return " or ".join(" + ".join(names) for names in (effects, *twins))


def chosen_probability(d: Diagnosis) -> float:
    """The probability of the verdict; 0 if the ranking has no such row."""
    v = d.verdict
    return sum(hypothesis.probability for hypothesis in v.ranking if _is_verdict(hypothesis, v.word, v.effects))


def _is_verdict(hypothesis: Hypothesis, word: VerdictWord, effects: Sequence[str]) -> bool:
    return hypothesis.verdict == word and set(hypothesis.effects) == set(effects)


def probability_sentence(d: Diagnosis) -> str:
    """What the probability in the verdict's sentence means."""
    p, word = chosen_probability(d), d.verdict.word
    what = {
        "named": "the missing physics would be just this",
        "no_gap": "the machine would lack nothing that these runs can show",
        "unknown": "the cause would be one that the library does not hold",
    }[word]
    count = round(100.0 * p)
    many = "more than 99" if p > 0.995 else "less than one" if p < 0.005 else f"about {count}"
    said = f"That probability means: of a hundred campaigns judged like this one, in {many} {what}."
    named = sum(hypothesis.probability for hypothesis in d.verdict.ranking if hypothesis.verdict == "named")
    if word == "named" and p < 0.5 and named > p + 0.005:
        return f"{said} In about {100.0 * named:.0f} some effect would be missing, this one or another."
    return said


def alike_sentence(d: Diagnosis) -> str:
    """The effects that these runs cannot tell from the verdict; "" if there are none, or if its sentence names them."""
    if all(name in d.verdict.sentence for name in d.verdict.alike):
        return ""
    return f"These runs cannot tell it from {listed(d.verdict.alike)}: either explains them as well."


def reasons_of(d: Diagnosis) -> list[str]:
    """The reasons for a cause outside the library, as sentences."""
    unit = d.shrink.unit
    return [_reason(reason, unit) for reason in d.verdict.reasons]


def _reason(reason: Reason, unit: str) -> str:
    names = listed(reason.effects) if reason.effects else ""
    return {
        ReasonKind.UNLISTED_EXPLAINS_MORE: f"An unlisted effect explains more: {names}. Weigh it among the candidates.",
        ReasonKind.LEAVES_MUCH: f"The best hypothesis leaves {reason.value:.2g} {unit}, {reason.percent:.2g} % of the "
        "input, beyond noise and what a model may miss.",
        ReasonKind.STRETCHES_TOLERANCES: "It needs base parameters further off than their tolerances allow together.",
        ReasonKind.ON_A_BOUND: "It sits on the bound of one of its parameters.",
        ReasonKind.UNDO_EACH_OTHER: f"{names} largely undo each other, as two do that stand in for a third.",
    }[reason.kind]


def reasons_lead(d: Diagnosis) -> str:
    """The heading of `reasons_of`; "" if there are none."""
    if not d.verdict.reasons:
        return ""
    if d.verdict.word == "unknown":
        return "What speaks for a cause that the library does not hold:"
    return "What speaks against it:"


def effect_sentences(d: Diagnosis) -> list[str]:
    """The declared meaning, equation and signature of each named effect."""
    known: dict[str, Effect] = effects_for(plant_of(d.campaign.machine).kind)
    sentences = []
    for name in d.verdict.effects:
        if effect := known.get(name):
            place = effect.subsystem(plant_of(d.campaign.machine).kind).replace("_", " ")
            sentences.append(f"{name} ({place}): {effect.meaning} {effect.equation}. It shows as {effect.shows}.")
    return sentences


def where_sentence(d: Diagnosis) -> str:
    w = d.where
    if w is None:
        return "Where there is no gap, there is no place of it."
    low, high = (round(100.0 * x) for x in w.interval)
    side = {"drive": " It lies on the drive's side of the wire.", "carriage": " It lies on the carriage's side."}
    return (
        f"The gap lies at the {w.subsystem.replace('_', ' ')}, {REGIMES.get(w.regime, w.regime)}: "
        f"{100.0 * w.share:.0f} % of its energy (90 % interval {low} to {high} %) is of this kind and in the "
        f"windows of time that the report marks.{side.get(w.side, '')}"
    )


REGIMES = {
    "speed": "growing with speed",
    "low_speed": "near standstill",
    "acceleration": "with acceleration",
    "load": "with the load",
    "position": "at a position",
    "time": "over time",
    "start": "at each start",
    "periodic": "periodically",
    "event": "at single events",
    "all": "whenever it moves",
}


def shrink_sentence(d: Diagnosis) -> str:
    """The reduction of the gap with its interval, compared with the noise floor."""
    s = d.shrink
    quantity = words_of(d.campaign.machine).quantity
    low, high = s.ci95
    if s.before <= 0.0 or d.verdict.word == "no_gap":
        return (
            f"Nothing to shrink: on held-out runs the {quantity} residual is {figures(s.after)} {s.unit} rms, the "
            f"noise {figures(s.noise)} {s.unit}."
        )
    if s.factor < SHRINKS:
        return (
            f"It does not shrink: on held-out runs the {quantity} residual is {figures(s.before)} {s.unit} rms before "
            f"and {figures(s.after)} {s.unit} after; the noise floor is {figures(s.noise)} {s.unit}."
        )
    away = (
        "; it has run away, for every bias adds up, and judges neither machine"
        if s.speed_rmse_percent_after > RUN_AWAY
        else ""
    )
    return (
        f"On runs that were held out of the fit the {quantity} residual falls from {figures(s.before)} to "
        f"{figures(s.after)} {s.unit} rms, by a factor of {figures(s.factor)} (95 % interval {figures(low)} to "
        f"{figures(high)}); the noise floor is {figures(s.noise)} {s.unit}. Replayed open loop, the speed's error goes "
        f"from {figures(s.speed_rmse_percent_before)} to {figures(s.speed_rmse_percent_after)} % of "
        f"{words_of(d.campaign.machine).scale}{away}."
    )


def next_run_sentence(d: Diagnosis) -> str:
    """The run that would decide between open hypotheses, or that none is open."""
    if d.next_run is not None:
        return d.next_run.why
    return (
        "The verdict needs no further run. Effects that look alike in these runs are listed with their angles: they "
        "stay undecided where a campaign shows one of them in a small amount."
    )


def plain_summary(d: Diagnosis) -> list[str]:
    """The verdict for a reader who knows the machine and not this program: what, where, how sure, what it mends."""
    s, known = d.shrink, effects_for(plant_of(d.campaign.machine).kind)
    quantity = words_of(d.campaign.machine).quantity
    size = f"{figures(s.before)} {s.unit}"
    if d.verdict.word == "no_gap":
        return [
            f"The model agrees with the machine: predicted and measured {quantity} differ by {figures(s.after)} "
            f"{s.unit} on average in runs that were held out; the sensors alone make {figures(s.noise)} {s.unit}."
        ]
    if d.verdict.word == "unknown" or not all(name in known for name in d.verdict.effects):
        at = f" {_at(d.where.subsystem)}" if d.where is not None else ""
        return [
            f"Something{at} is missing in the model, and none of the causes that were weighed explains it. "
            f"Measured and predicted {quantity} differ by {size} on average; the sensors alone make "
            f"{figures(s.noise)} {s.unit}.",
            "The controller should not be tuned on this model before the cause is found.",
        ]
    kind = plant_of(d.campaign.machine).kind
    causes = [f"{_cause(known[name].meaning)} ({_at(known[name].subsystem(kind))})" for name in d.verdict.effects]
    sure = d.verdict.probability
    return [
        f"What the model lacks: {', and '.join(causes)}.",
        f"That made the predicted {quantity} wrong by {size} on average. With it in the model {figures(s.after)} "
        f"{s.unit} remain; the sensors alone make {figures(s.noise)} {s.unit}."
        f" In about {100.0 * sure:.0f} of 100 such cases this is the cause{_or_alike(d, known)}.",
    ]


def _or_alike(d: Diagnosis, known: Mapping[str, Effect]) -> str:
    """What these runs cannot tell from the named cause, in words; "" if there is nothing."""
    alike = [_cause(known[name].meaning) for name in d.verdict.alike if name in known]
    return f", or what looks the same in these runs: {'; '.join(alike)}" if alike else ""


def _cause(meaning: str) -> str:
    """`Friction that grows with the load; on …` as `friction that grows with the load`."""
    first = meaning.partition(";")[0].partition(". ")[0].rstrip(".")
    return first[0].lower() + first[1:]


def _at(subsystem: str) -> str:
    return f"at the {subsystem.replace('_', ' ')}"


def unknown_sentences(d: Diagnosis) -> list[str]:
    if d.unknown is None:
        return []
    said = list(d.unknown.sentences)
    if d.corrected.measured_correction is not None:
        over = over_what(d.corrected.measured_correction.over)
        said.append(
            f"machine.yaml holds it, over {over}, as `measured_correction`, which replay and study take into account. "
            "It is a measurement, no explanation."
        )
    return said


def unit_of(d: Diagnosis) -> str:
    """The unit of the input for the heads of tables, with non-breaking spaces."""
    return words_of(d.campaign.machine).unit.replace(" ", "\u00a0")


def curve_unit(machine: Hoist | Axis, acts_on: str) -> str:
    """The unit of a curve: N at the guide and on a linear axis, otherwise N m."""
    return kind_of(machine).ports[acts_on].unit
