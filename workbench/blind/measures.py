"""Right answers, held against their labels; the measures of many answers, by source, kind and size of the gap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.diagnose.isolation.next_run import SURE

Z_95 = 1.959963984540054  # two-sided, normal
Row = Mapping[str, Any]
VISIBLE = 1.0  # of the noise: an effect that changes the torque by less, rms, is too small to see
HARM = 1.02  # of the residual before: more after is harm
SLACK_S = 0.5  # by which an event's window may miss the event


def family_of(row: Row) -> str:
    """The family of machines; of recorded campaigns, which have none, the folder that the answers are in."""
    return str(row["label"].get("family") or row.get("source") or "–")


def recorded(row: Row) -> bool:
    """Whether the runs are those of a real machine."""
    return row["label"].get("source") == "recorded"


def source_of(row: Row) -> str:
    """What played the machine, and whether machine.yaml was identified first; of recorded campaigns "recorded"."""
    source = str(row["label"].get("source") or "recorded")
    return f"{source}, identified first" if row["label"].get("identified") else source


def size_over_noise(row: Row) -> float:
    """What the causes change in the input, rms, over the diagnosis' noise; not a number where nobody knows."""
    change = row["label"].get("torque_change_rms_nm")
    return float(change / row["noise"]) if change and row["noise"] else math.nan


def kind_of(row: Row) -> str:
    """hoist or axis; "" where neither the label nor the answer says."""
    return str(row.get("kind") or row["label"].get("kind") or "")


def right_word(row: Row) -> str:
    return "no_gap" if not row["label"]["effects"] else "unknown" if unlisted(row) else "named"


def unlisted(row: Row) -> bool:
    """Whether what is hidden is on no list of effects."""
    return any("unlisted" in name for name in row["label"]["effects"])


def single(row: Row) -> bool:
    return right_word(row) == "named" and len(row["label"]["effects"]) == 1


def detectable(row: Row) -> bool:
    """A cause on a recorded machine whose energy, less what base values within a tolerance take up, is at least that of
    noise and the machine's own remainder: what is below cannot be told from what the machine leaves itself."""
    return float(row["label"].get("detectability", 0.0)) >= 1.0


def pair(row: Row) -> bool:
    return right_word(row) == "named" and len(row["label"]["effects"]) == 2


def right(row: Row) -> bool:
    """The answer is the label's, exactly."""
    word = right_word(row)
    return row["word"] == word and (word != "named" or set(row["names"]) == set(row["label"]["effects"]))


def right_as_stated(row: Row) -> bool:
    """The label's answer is the answer, or one of its exact twins: what the stated probability is of."""
    if right(row):
        return True
    return row["word"] == right_word(row) == "named" and set(row["label"]["effects"]) in twins_of(row, row["names"])


def twins_of(row: Row, names: Sequence[str]) -> list[set[str]]:
    """Hypotheses that differ from this one in name only."""
    groups = [[set(one) for one in group] for group in row.get("twins") or ()]
    return [one for group in groups if set(names) in group for one in group if one != set(names)]


def right_or_alike(row: Row) -> bool:
    """Exactly, or the label's effect is said to be alike, or the label says that no log tells the answer from it."""
    told = set(row["label"]["effects"])
    if right_as_stated(row):
        return True
    if row["word"] != "named" or len(told) != 1:
        return False
    if len(row["names"]) == 1 and told <= {*row["names"], *row["alike"]}:
        return True
    return any(set(row["names"]) == set(known.split("+")) for known in row["label"].get("alike") or ())


def wrong(row: Row) -> bool:
    """A cause is named, and it is not that of the label."""
    return row["word"] == "named" and not right_or_alike(row)


def among_first_three(row: Row) -> bool:
    """Whether the label's answer is one of the three likeliest of the ranking."""
    word, told = right_word(row), set(row["label"]["effects"])
    return any(
        verdict == word and (word != "named" or told in (set(names), *twins_of(row, names)))
        for verdict, names, _ in row["ranking"][:3]
    )


def one_of_them(row: Row) -> bool:
    """At least one of the label's effects is named."""
    return row["word"] == "named" and bool(set(row["names"]) & set(row["label"]["effects"]))


def visible(row: Row) -> bool:
    size = row["label"].get("torque_change_rms_nm") or math.inf
    return bool(size >= VISIBLE * row["noise"])


def harmful(row: Row) -> bool:
    """The answer corrects the machine, and on runs held out the corrected one is off further than before."""
    return row["word"] in ("named", "unknown") and row["after"] > HARM * row["before"]


def oracle_after(row: Row) -> float | None:
    """Held-out rms of the label's own effects fitted to the same runs; None where they were not fitted."""
    told = sorted(row["label"]["effects"])
    for names, rms in row.get("held_out") or ():
        if sorted(names) == told and rms is not None:
            return float(rms)
    return None


def of_the_oracle(row: Row) -> float | None:
    """The shrink over that of the true effect fitted to the same data, both as before over after; 1 is as good."""
    true = oracle_after(row)
    return None if true is None or not row["after"] else true / float(row["after"])


def likeliest_place(row: Row) -> str:
    """The subsystem that the answer gives first; "" for none."""
    places = row.get("places") or ()
    return str(max(places, key=lambda place: place[1])[0]) if places else str(row["subsystem"])


def place_right(row: Row) -> bool:
    """The likeliest place is one where the label says that something is wrong."""
    return likeliest_place(row) in {where["subsystem"] for where in row["label"]["where"]}


def next_run_decides(row: Row) -> bool:
    """Whether the answer leaves hypotheses open and says that the run that it recommends tells them apart."""
    run = row.get("next_run")
    return run is not None and run["decides"] >= SURE


def event_found(row: Row) -> bool:
    """Said to be an event, with one of its stretches, or of the answer's windows, in its run and at its time."""
    return row["regime"] == "event" and any(
        run == event["run"] and begins <= event["to_s"] + SLACK_S and ends >= event["from_s"] - SLACK_S
        for run, begins, ends in row.get("events") or row.get("windows") or ()
        for event in row["label"]["events"]
    )


def estimates_within(row: Row) -> Iterator[tuple[str, float, float]]:
    """name, relative error, error over standard error, of each amount of a rightly named campaign."""
    if not right(row) or right_word(row) != "named":
        return
    for effect, told in row["label"].get("parameters", {}).items():
        for name, truth in told.items():
            estimate = row["estimates"].get(effect, {}).get(name)
            if estimate is None or isinstance(estimate[0], list) or name.endswith("phase_rad"):
                continue
            value, error = float(estimate[0]), float(estimate[1])
            neutral = 1.0 if effect in ("torque_scale", "payload_mass_error") else 0.0
            if abs(truth - neutral) > 0.0 and error > 0.0:
                yield f"{effect}.{name}", abs(value - truth) / abs(truth - neutral), abs(value - truth) / error


@dataclass(frozen=True)
class Share:
    """count of `of`; `of` may be zero, then nothing was asked."""

    count: int
    of: int

    @classmethod
    def counted(cls, rows: Iterable[Mapping[str, Any]], test: Callable[[Mapping[str, Any]], bool]) -> Share:
        passed = [test(row) for row in rows]
        return cls(sum(passed), len(passed))

    def interval(self) -> tuple[float, float]:
        """Wilson's score interval, 95 %, of the share (E. B. Wilson 1927); (0, 1) where nothing was asked."""
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.of, self.count / self.of, Z_95**2
        middle = (p + z2 / (2.0 * n)) / (1.0 + z2 / n)
        half = Z_95 / (1.0 + z2 / n) * math.sqrt(p * (1.0 - p) / n + z2 / (4.0 * n * n))
        return max(middle - half, 0.0), min(middle + half, 1.0)

    def _with_interval(self, text: str) -> str:
        low, high = self.interval()
        return f"{text} ({100.0 * low:.0f}–{100.0 * high:.0f})" if self.of else "–"

    def text(self) -> str:
        """As 17/18 (74–99), the interval in per cent; – where nothing was asked."""
        return self._with_interval(f"{self.count}/{self.of}")

    def percent(self) -> str:
        """As 94 (74–99), in per cent; – where nothing was asked."""
        return self._with_interval(f"{100.0 * self.count / max(self.of, 1):.0f}")


# Measures


Test = Callable[[Row], bool]
# Of the gap over the noise: (name, from, below).
SIZES = (
    ("below the noise", 0.0, 1.0),
    ("just visible, 1 to 3", 1.0, 3.0),
    ("3 to 10", 3.0, 10.0),
    ("10 and more", 10.0, math.inf),
)


@dataclass(frozen=True)
class Measure:
    """name: in tables, over two lines in heads; key: in JSON. asks: the cases it speaks of. passes: of those. asked:
    kind -> what the project asks, in per cent. less: the fewer pass, the better."""

    key: str
    name: str
    asks: Test
    passes: Test
    asked: Mapping[str, float] = field(default_factory=dict)
    less: bool = False

    @property
    def line(self) -> str:
        """The name in one line."""
        return self.name.replace("\n", " ")

    def share(self, rows: Sequence[Row]) -> Share:
        return Share.counted(filter(self.asks, rows), self.passes)

    def asked_text(self, kind: str) -> str:
        limit = self.asked.get(kind)
        return "" if limit is None else f"{'≤' if self.less else '≥'} {limit:g}"


def _is(word: str) -> Test:
    return lambda row: row["word"] == word


def _no_gap(row: Row) -> bool:
    return right_word(row) == "no_gap"


def _cause(row: Row) -> bool:
    return bool(row["label"]["effects"])


_BOTH = {"hoist": 2.0, "axis": 2.0}
_UNKNOWN = {"recorded": 80.0, "hoist": 90.0, "axis": 90.0}
MEASURES = (
    Measure("named", "single effect\nnamed", single, right, {"hoist": 95.0, "axis": 90.0}),
    Measure("named_or_alike", "named, or\nsaid to be alike", single, right_or_alike, {"recorded": 85.0}),
    Measure("detectable", "named or alike,\nof the detectable", lambda r: single(r) and detectable(r), right_or_alike),
    Measure("wrong", "single effect:\nwrong one named", single, wrong, {"recorded": 3.0}, True),
    Measure("first_three", "among the\nfirst three", single, among_first_three),
    Measure("pair_both", "pair:\nboth named", pair, right, {"hoist": 80.0, "axis": 80.0}),
    Measure("pair_one", "pair:\none or both", pair, one_of_them, {"hoist": 97.0, "axis": 97.0}),
    Measure("false_alarm", "no gap,\nbut named", _no_gap, _is("named"), {**_BOTH, "recorded": 5.0}, True),
    Measure("false_unknown", "no gap,\nbut unknown", _no_gap, _is("unknown"), {"hoist": 5.0, "axis": 5.0}, True),
    Measure("unknown_caught", "unlisted cause:\nunknown", unlisted, _is("unknown"), _UNKNOWN),
    Measure(
        "unknown_detectable", "unknown,\nof the detectable", lambda r: unlisted(r) and detectable(r), _is("unknown")
    ),
    Measure("unknown_place", "unlisted cause:\nplace right", unlisted, place_right),
    Measure("place", "place right,\nall causes", _cause, place_right, {"hoist": 95.0, "axis": 95.0}),
    Measure("event", "brief event\nfound", lambda r: bool(r["label"].get("events")), event_found),
    Measure("harmful", "correction\nharmful", lambda r: r["word"] in ("named", "unknown"), harmful, _BOTH, True),
)
# What a method that only names an answer can be measured by.
OF_A_METHOD = ("named", "first_three", "pair_both", "pair_one", "false_alarm", "false_unknown", "unknown_caught")


def measure(key: str) -> Measure:
    return next(known for known in MEASURES if known.key == key)


def sheet_of(row: Row) -> str:
    """Kind of machine, and "recorded" of a real one, whatever its kind."""
    return "recorded" if recorded(row) else kind_of(row)


def groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """ "kind, source" -> its rows, of recorded machines "recorded, family"; then each kind's all where it has more
    than one."""
    grouped: dict[str, list[Row]] = {}
    for kind, of_kind in by_kind(rows).items():
        of_source: dict[str, list[Row]] = {}
        name = family_of if kind == "recorded" else source_of
        for row in sorted(of_kind, key=name):
            of_source.setdefault(f"{kind}, {name(row)}", []).append(row)
        grouped |= of_source
        if len(of_source) > 1:
            grouped[f"{kind}, all"] = of_kind
    return grouped


def by_kind(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Kind of machine -> its rows, recorded machines first."""
    kinds = sorted({sheet_of(row) for row in rows}, key=lambda kind: (kind != "recorded", kind))
    return {kind: [row for row in rows if sheet_of(row) == kind] for kind in kinds}


def by_size(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Size of the gap over the noise -> the rows with a cause of that size; those of unknown size last."""
    sized = [(size_over_noise(row), row) for row in rows if _cause(row)]
    sizes = {name: [row for size, row in sized if low <= size < high] for name, low, high in SIZES}
    sizes["size not known"] = [row for size, row in sized if math.isnan(size)]
    return {name: which for name, which in sizes.items() if which}


@dataclass(frozen=True)
class Numbers:
    """parameter_errors: relative, of rightly named effects, in their order. covered: of true values, those inside the
    90 % interval. of_oracle: shrink over the true effect's, in their order; without_oracle: cases that lack it.
    calibration_error: mean distance of stated probability and share right (M. P. Naeini et al. 2015), None for no
    answers; calibration_by_chance: what it would be of answers that are right exactly as often as they say. cpu_s: in
    their order."""

    parameter_errors: tuple[float, ...]
    covered: Share
    of_oracle: tuple[float, ...]
    without_oracle: int
    calibration_error: float | None
    calibration_by_chance: float | None
    cpu_s: tuple[float, ...]


INSIDE_90 = 1.6449


def numbers(rows: Sequence[Row]) -> Numbers:
    within = [estimate for row in rows for estimate in estimates_within(row)]
    ratios = [of_the_oracle(row) for row in rows if right_word(row) == "named"]
    return Numbers(
        parameter_errors=tuple(sorted(error for _, error, _ in within)),
        covered=Share(sum(ratio <= INSIDE_90 for _, _, ratio in within), len(within)),
        of_oracle=tuple(sorted(ratio for ratio in ratios if ratio is not None)),
        without_oracle=sum(ratio is None for ratio in ratios),
        calibration_error=calibration_error(rows),
        calibration_by_chance=calibration_by_chance(rows),
        cpu_s=tuple(sorted(float(row["cpu_s"]) for row in rows)),
    )


def median(values: Sequence[float]) -> float:
    """values: in their order."""
    return values[len(values) // 2] if values else math.nan


def median_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """The 95 % interval of the median of values in their order, between two of them whatever their distribution (W. R.
    Thompson 1936): x_j to x_(n+1-j), j the largest with P(Binomial(n, 1/2) < j) <= 2.5 %. None for fewer than six."""
    from scipy.stats import binom

    j = int(binom.ppf(0.025, len(values), 0.5)) if values else 0
    return (values[j - 1], values[len(values) - j]) if j > 0 else None


@dataclass(frozen=True)
class Bin:
    """Answers of about this probability: from, below, mean of what they said, and how many were right; the name of an
    exact twin is, for the probability is of both."""

    low: float
    high: float
    said: float
    right: Share


EDGES = (0.0, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


def reliability(rows: Sequence[Row]) -> list[Bin]:
    """The reliability curve: bins with answers in them."""
    return [
        Bin(low, high, sum(map(_said, which)) / len(which), Share.counted(which, right_as_stated))
        for low, high, which in _binned(rows)
    ]


def _binned(rows: Sequence[Row]) -> Iterator[tuple[float, float, list[Row]]]:
    for low, high in itertools.pairwise(EDGES):
        top = high if high < 1.0 else math.inf
        if which := [row for row in rows if row["ranking"] and low <= _said(row) < top]:
            yield low, high, which


def _said(row: Row) -> float:
    return float(row["ranking"][0][2])


def calibration_error(rows: Sequence[Row]) -> float | None:
    bins = reliability(rows)
    total = sum(b.right.of for b in bins)
    return sum(abs(b.right.of * b.said - b.right.count) for b in bins) / total if total else None


def calibration_by_chance(rows: Sequence[Row]) -> float | None:
    """The calibration error to expect of answers that are right exactly as often as they say: of few answers it is not
    small. The number right in a bin has then a Poisson binomial distribution."""
    total, expected = 0, 0.0
    for _, _, which in _binned(rows):
        of_count = np.ones(1)
        for p in map(_said, which):
            of_count = np.convolve(of_count, [1.0 - p, p])
        expected += float(of_count @ np.abs(np.arange(len(of_count)) - sum(map(_said, which))))
        total += len(which)
    return expected / total if total else None
