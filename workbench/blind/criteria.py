"""What is right about one answer: verdict, names, place, event and amounts, each held against the label."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.diagnose.isolation.next_run import APART, WORTH

Z_95 = 1.959963984540054  # two-sided, normal
Row = Mapping[str, Any]
LOOSE = ("heave", "torque_ripple")  # their residual may stay at twice the noise
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
    effects = row["label"]["effects"]
    if not effects:
        return "no_gap"
    return "unknown" if unlisted(row) or set(effects) & set(row.get("withheld") or ()) else "named"


def unlisted(row: Row) -> bool:
    """Whether what is hidden is on no list of effects."""
    return any("unlisted" in name for name in row["label"]["effects"])


def single(row: Row) -> bool:
    return right_word(row) == "named" and len(row["label"]["effects"]) == 1


def detectable(row: Row) -> bool:
    """A single effect on a recorded machine whose energy, less what base values within a tolerance take up, is at least
    that of noise and the machine's own remainder: what is below cannot be found by anybody."""
    return single(row) and float((row["label"].get("truth") or {}).get("detectability", 0.0)) >= 1.0


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
    return run is not None and bool(run["separation"] > APART and run["separation"] > run["now"] + WORTH)


def has_event(row: Row) -> bool:
    """Whether the label holds a brief event, with its run and time."""
    return bool(row["label"].get("events"))


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
