"""Records of the answer and of the hypotheses it was chosen from, and the probabilities of the answers, from evidence
and from what speaks for an unknown cause."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.free_parameters import Estimate, Names

VerdictWord = Literal["named", "no_gap", "unknown"]
WITHOUT_EFFECTS = {"no_gap": "no gap", "unknown": "unknown cause", "named": "a listed effect, not found"}


class ReasonKind(Enum):
    """Reasons against a named cause; from ON_A_BOUND on against the listed hypothesis with most evidence,
    BARRED against one that has as much as a cause has."""

    UNLISTED_EXPLAINS_MORE = "unlisted_explains_more"
    LEAVES_MUCH = "leaves_much"
    STRETCHES_TOLERANCES = "stretches_tolerances"
    LOG_KEEPS = "log_keeps"
    ON_A_BOUND = "on_a_bound"
    UNDO_EACH_OTHER = "undo_each_other"
    ONLY_SMOOTHER = "only_smoother"
    TAKES_NOTHING = "takes_nothing"
    VARIES = "varies"
    FREE_LAW = "free_law"
    NO_IMPACTS = "no_impacts"
    BARRED = "barred"


@dataclass(frozen=True)
class Reason:
    """value: N m (N) left, or standard deviations; percent: of the input's rms; effects: those it is about;
    over: the variable of a free law, or of what an amount varies with, or what bars a hypothesis, in words."""

    kind: ReasonKind
    effects: Names = ()
    value: float = 0.0
    percent: float = 0.0
    over: str = ""


@dataclass(frozen=True)
class Left:
    """The residual of the answer beyond noise, on held-out runs: rms, N m (N); per cent of the input's rms; relevant:
    whether it can change a conclusion of a study."""

    rms: float
    percent_of_input: float
    relevant: bool


@dataclass(frozen=True)
class Remainder(Left):
    """What no cause takes, with any verdict. share: of the gap's energy beyond noise on held-out runs, 0 to 1.
    subsystem, regime: where it lies; regime "all" where no variable of the motion foretells it."""

    share: float
    subsystem: str
    regime: str


@dataclass(frozen=True)
class Candidate:
    """One hypothesis. gain: the fall of chi^2 and tolerances together; merit: its evidence, as diagnosis.json calls it.

    residual_rms, held_out_rms: N m (N). explained: share of the gap's energy beyond noise on held-out runs; both are
    None for what was not predicted there. against: the reasons against it. failure: why its fit broke down, "" for one
    that did not.
    """

    effects: Names
    gain: float
    merit: float
    residual_rms: float | None
    held_out_rms: float | None
    explained: float | None
    parameters: Mapping[str, tuple[Estimate, ...]]
    fitted: bool
    against: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True)
class Hypothesis:
    """One row of the ranking. twins: what differs from it in name only; the probability is of all. Named without
    effects, beside an answer of no gap or of an unknown cause: a listed effect that no fit has found, whichever."""

    verdict: VerdictWord
    effects: Names
    probability: float
    twins: tuple[Names, ...] = ()


@dataclass(frozen=True)
class Step:
    """One step to an answer, with one effect more. merit: of these effects; left_rms: the rms of their
    residual, in the input's unit."""

    effects: Names
    merit: float
    left_rms: float


@dataclass(frozen=True)
class Verdict:
    """The answer. alike: what this campaign cannot tell from it. sentence: the answer in one sentence. steps: how an
    answer was come to, one effect after the other. beside: unlisted effects that are taken for the machine's own, and
    that it holds before the answer and after it."""

    word: VerdictWord
    effects: Names
    ranking: tuple[Hypothesis, ...]
    alike: Names
    sentence: str
    reasons: tuple[Reason, ...] = ()
    explained: float = 0.0
    left: Left = Left(0.0, 0.0, False)
    steps: tuple[Step, ...] = ()
    remainder: Remainder | None = None
    beside: Names = ()

    @property
    def probability(self) -> float:
        """Of the answer, with what differs from it in name only."""
        return self.ranking[0].probability

    @property
    def twins(self) -> tuple[Names, ...]:
        """What differs from the answer in name only."""
        return self.ranking[0].twins


def percent_of(share: float) -> str:
    """A share of the energy in per cent, with enough digits near 100."""
    if share >= 0.9999:
        return "over 99.99 %"
    return f"{100.0 * share:.2f} %" if share > 0.99 else f"{100.0 * share:.0f} %"


def rank(
    evidence: Sequence[tuple[Names, float]],
    signs: Mapping[str, float],
    numbers: Mapping[str, float],
    price: float,
    groups: Sequence[Sequence[Names]] = (),
) -> tuple[Hypothesis, ...]:
    """The ranking, the answer first, from evidence and the signs of an unknown cause.

    Named hypotheses share what no unknown cause takes with no gap, which has no evidence and pays no `price` for being
    chosen from all effects; evidence is twice the logarithm of a likelihood. Evidence without names speaks for an
    unknown cause. The answer is the likeliest of the three words. groups: of hypotheses that differ in name only, the
    first one's name leading; each is one row, with one probability.
    """
    shares = _shares(evidence, logistic_argument(signs, numbers), price)
    answer = _rows(evidence, shares, groups)[0]
    rows = _rows(evidence, _with_misses(shares, numbers, answer.verdict), groups)
    first = next(row for row in rows if (row.verdict, row.effects) == (answer.verdict, answer.effects))
    return (first, *sorted((row for row in rows if row is not first), key=lambda row: -row.probability))


def shared(ranking: Sequence[Hypothesis], alike: Names, most: float = 0.5) -> tuple[Hypothesis, ...]:
    """The ranking where the runs cannot tell the answer from others: its probability is `most` at the most. What it
    gives up goes to the hypotheses with one of `alike` in place of one effect of its own, of which those that differ in
    name only become rows of their own; where none is ranked, they are unlisted, and an unknown cause has it; without
    any, all others in proportion."""
    first, *rest = ranking
    surplus = first.probability - most
    if surplus <= 0.0 or not rest:
        return tuple(ranking)
    mine = set(first.effects)
    apart = [names for names in first.twins if set(names) - mine <= set(alike)]
    rest += [Hypothesis("named", names, 0.0) for names in apart]
    others = [[set(names) for names in (row.effects, *row.twins)] for row in rest]
    heirs = [
        k
        for k, rows in enumerate(others)
        if any(len(names) == len(mine) and len(names - mine) == 1 and names - mine <= set(alike) for names in rows)
    ]
    heirs = heirs or [k for k, row in enumerate(rest) if row.verdict == "unknown" and alike] or list(range(len(rest)))
    as_likely = [first.probability if rest[k].effects in apart else rest[k].probability for k in heirs]
    for k, weight in zip(heirs, as_likely, strict=True):
        share = weight / sum(as_likely) if sum(as_likely) > 0.0 else 1.0 / len(heirs)
        rest[k] = replace(rest[k], probability=rest[k].probability + surplus * share)
    rest.sort(key=lambda row: -row.probability)
    twins = tuple(names for names in first.twins if names not in apart)
    return (replace(first, probability=most, twins=twins), *rest)


def logistic_argument(signs: Mapping[str, float], numbers: Mapping[str, float]) -> float:
    """Of an unknown cause: below 0 it is the less likely. A sign at its limit, 1, brings it to 0, and many to no more
    than speaks against such a cause where there is none."""
    return numbers["unknown_bias"] * (1.0 - min(sum(value**2 for value in signs.values()), 2.0))


def none_missed(signs: Mapping[str, float], stands: bool, numbers: Mapping[str, float]) -> Mapping[str, float]:
    """The numbers for an unknown cause of a machine that leaves nothing itself: where it leaves much, no listed cause
    is one that the fits miss. Base values are stretched by chance, too; and beside an established cause (`stands`) that
    speaks for another one, that may be listed."""
    beside = stands and logistic_argument(signs, numbers) > 0.0
    return {**numbers, "missed_unknown": 0.0} if signs.get("left", 0.0) > 1.0 and not beside else numbers


@dataclass(frozen=True)
class _Shares:
    """Probabilities; named: of each hypothesis, 0 for evidence without names."""

    no_gap: float
    unknown: float
    named: Array
    missed: float = 0.0


def _shares(evidence: Sequence[tuple[Names, float]], x: float, price: float) -> _Shares:
    """x: the logistic's argument, of an unknown cause."""
    unknown = 1.0 / (1.0 + math.exp(-max(min(x, 50.0), -50.0)))
    exponents = np.array([0.0, *(one - price for _, one in evidence)]) / 2.0
    shares = np.exp(exponents - np.max(exponents))
    shares *= (1.0 - unknown) / np.sum(shares)
    listed = np.array([bool(names) for names, _ in evidence], dtype=bool)
    rivals = float(np.sum(shares[1:][~listed]))
    return _Shares(float(shares[0]), unknown + rivals, np.where(listed, shares[1:], 0.0))


def _with_misses(shares: _Shares, numbers: Mapping[str, float], answer: VerdictWord) -> _Shares:
    """What is stated: of no gap and of an unknown cause less, for so many of such answers are a listed cause that the
    fits have missed. Which one, they do not say: it is a row of its own, and both words give in proportion, no more
    than leaves the answer the likeliest. Beside a named answer it is shared by the hypotheses in proportion."""
    total, without = float(np.sum(shares.named)), shares.no_gap + shares.unknown
    if total <= 0.0:
        return shares
    if answer == "named":
        no_gap = (1.0 - numbers["missed_no_gap"]) * shares.no_gap
        unknown = (1.0 - numbers["missed_unknown"]) * shares.unknown
        return _Shares(no_gap, unknown, shares.named * (1.0 - no_gap - unknown) / total)
    answered = shares.no_gap if answer == "no_gap" else shares.unknown
    kept = 1.0 - numbers[f"missed_{answer}"] * answered / without
    kept = min(max(kept, float(np.max(shares.named)) / answered), 1.0)
    return _Shares(kept * shares.no_gap, kept * shares.unknown, shares.named, (1.0 - kept) * without)


def _rows(
    evidence: Sequence[tuple[Names, float]], shares: _Shares, groups: Sequence[Sequence[Names]]
) -> tuple[Hypothesis, ...]:
    """A row for each hypothesis, one for each group that differs in name only: the likeliest of the likeliest word,
    then the others."""
    leader = {names: group[0] for group in groups for names in group}
    others = {group[0]: tuple(group[1:]) for group in groups}
    together: dict[Names, float] = {}
    for (names, _), share in zip(evidence, shares.named, strict=True):
        if names:
            first = leader.get(names, names)
            together[first] = together.get(first, 0.0) + float(share)
    rows = [Hypothesis("no_gap", (), shares.no_gap), Hypothesis("unknown", (), shares.unknown)]
    rows += [Hypothesis("named", names, share, others.get(names, ())) for names, share in together.items()]
    rows += [Hypothesis("named", (), shares.missed)] if shares.missed > 0.0 else []
    total = {"no_gap": shares.no_gap, "unknown": shares.unknown, "named": sum(together.values())}
    word = max(total, key=lambda verdict: total[verdict])
    rows.sort(key=lambda row: (row.verdict != word, -row.probability))
    return (rows[0], *sorted(rows[1:], key=lambda row: -row.probability))
