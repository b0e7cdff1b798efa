"""`python -m benchmarks.diagnosis.score ANSWERS...`: what was measured, by family; confusions and misses."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.diagnosis import criteria
from benchmarks.diagnosis.answers import load
from benchmarks.diagnosis.criteria import Row, right, right_word
from benchmarks.diagnosis.share import Share

Test = Callable[[Row], bool]


def named(row: Row) -> bool:
    return bool(row["word"] == "named")


def unknown(row: Row) -> bool:
    return bool(row["word"] == "unknown")


def _unlisted(row: Row) -> bool:
    return criteria.unlisted(row) and not row["withheld"]


# What is measured of each family: heading, the campaigns that are asked, the test that they pass.
MEASURES: Mapping[str, tuple[Test, Test]] = {
    "single named": (criteria.single, right),
    "or alike": (criteria.single, criteria.right_or_alike),
    "in the first three": (criteria.single, criteria.among_first_three),
    "pair: both": (criteria.pair, right),
    "pair: one or both": (criteria.pair, criteria.one_of_them),
    "no gap: named": (lambda row: right_word(row) == "no_gap", named),
    "no gap: unknown": (lambda row: right_word(row) == "no_gap", unknown),
    "unlisted: unknown": (_unlisted, unknown),
    "unlisted: place": (_unlisted, criteria.place_right),
    "event as event": (criteria.has_event, criteria.event_found),
}
# What the project asks of each, in per cent; at most where the heading says "no gap".
ASKED: Mapping[str, Mapping[str, str]] = {
    "hoist": {
        "single named": "≥ 95", "pair: both": "≥ 80", "pair: one or both": "≥ 97", "no gap: named": "≤ 3",
        "no gap: unknown": "≤ 3", "unlisted: unknown": "≥ 90", "unlisted: place": "≥ 75", "event as event": "≥ 80",
    },
    "axis": {
        "or alike": "≥ 90", "pair: both": "≥ 70", "no gap: named": "≤ 3", "no gap: unknown": "≤ 3",
        "unlisted: unknown": "≥ 85",
    },
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("answers", type=Path, nargs="+", help="folders that `run` wrote")
    parser.add_argument("--misses", type=int, default=20)
    parser.add_argument(
        "--leave-out",
        action="store_true",
        help="judge each family by the calibration that the other families of these answers give",
    )
    given = parser.parse_args()
    rows = [row for folder in given.answers for row in load(folder)]
    if given.leave_out:
        from benchmarks.diagnosis.calibrate import left_out

        rows = left_out(rows)
    print("\n".join(report(rows, given.misses)))


def report(rows: Sequence[Row], misses: int) -> list[str]:
    return [
        *by_family(rows), "", *pooled(rows), "", *_calibration(rows), "", *_confusion(rows), "", *_misses(rows, misses)
    ]  # fmt: skip


def shares(rows: Sequence[Row]) -> dict[str, Share]:
    """Of each of MEASURES; a withheld effect counts in none but where it is unlisted by itself."""
    return {
        heading: Share.counted(filter(asked, rows), test)
        for heading, (asked, test) in MEASURES.items()
    }  # fmt: skip


def by_family(rows: Sequence[Row]) -> list[str]:
    """A line for each family, then one for each kind with what is asked of it."""
    headings = [*MEASURES, "probability of the place"]
    lines = [f"| family | {' | '.join(headings)} |", "|---" * (len(headings) + 1) + "|"]

    def line(name: str, which: Sequence[Row]) -> None:
        given = [criteria.probability_of_place(row) for row in which if _unlisted(row)]
        mean = f"{sum(given) / len(given):.2f}" if given else "–"
        lines.append(f"| {name} | {' | '.join(share.text() for share in shares(which).values())} | {mean} |")

    for family in sorted({criteria.family_of(row) for row in rows}):
        line(family, [row for row in rows if criteria.family_of(row) == family])
    for kind, asked in ASKED.items():
        which = [row for row in rows if criteria.kind_of(row) == kind]
        if which:
            line(f"all of kind {kind}", which)
            lines.append(f"| asked of them, % | {' | '.join(asked.get(heading, '') for heading in headings)} |")
    return lines


def pooled(rows: Sequence[Row]) -> list[str]:
    """What is measured over all families together."""
    lines = ["| what | asked | measured |", "|---|---|---|"]

    def share(what: str, asked: str, which: Sequence[Row], test: Test) -> None:
        lines.append(f"| {what} | {asked} | {Share.counted(which, test).text()} |")

    seen = [row for row in rows if criteria.single(row) and criteria.visible(row)]
    share("single effect named, visible ones", "≥ 90 %", seen, right)
    share("the same, or said to be alike", "", seen, criteria.right_or_alike)
    share("effect taken out of the library: unknown", "≥ 80 %", [row for row in rows if row["withheld"]], right)
    rightly = [row for row in rows if right(row) and right_word(row) == "named"]
    strict = [row for row in rightly if not set(row["label"]["effects"]) & set(criteria.LOOSE)]
    loose = [row for row in rightly if set(row["label"]["effects"]) & set(criteria.LOOSE)]
    share("held-out residual ≤ 1.3 of the noise", "", strict, lambda row: row["after"] <= 1.3 * row["noise"])
    share("the same, heave and ripple ≤ 2", "", loose, lambda row: row["after"] <= 2.0 * row["noise"])
    share("subsystem and regime right where rightly named", "", rightly, criteria.place_and_regime_right)
    said = [row for row in rightly if row.get("left")]
    share("what is left said not to matter", "", said, lambda row: not row["left"]["relevant"])
    errors = sorted(error for row in rows for _, error, _ in criteria.estimates_within(row))
    inside = [ratio <= 1.6449 for row in rows for _, _, ratio in criteria.estimates_within(row)]
    if errors:
        lines.append(f"| parameters' error, median of {len(errors)} | ≤ 10 % | {100.0 * _median(errors):.1f} % |")
        lines.append(
            f"| inside their 90 % interval | 85–95 % | {Share(sum(inside), len(inside)).text()} |"
        )  # fmt: skip
    explained = sorted(float(row["explained"]) for row in rightly if row.get("explained") is not None)
    if explained:
        lines.append(f"| gap's energy explained, median | | {100.0 * _median(explained):.2f} % |")
    times = sorted(float(row["cpu_s"]) for row in rows)
    if times:
        lines.append(f"| CPU time, median and largest | ≤ 30 s | {_median(times):.0f} s, {times[-1]:.0f} s |")
    return lines


def _median(values: Sequence[float]) -> float:
    return values[len(values) // 2]


def _calibration(rows: Sequence[Row]) -> list[str]:
    """Of the answers given with about this probability, how many were right."""
    lines = ["| probability of the answer | right |", "|---|---|"]
    for low, high in ((0.0, 0.6), (0.6, 0.8), (0.8, 0.95), (0.95, 1.01)):
        which = [row for row in rows if low <= row["ranking"][0][2] < high]
        if which:
            lines.append(f"| {low:.2f}–{min(high, 1.0):.2f} | {Share.counted(which, right).text()} |")
    return lines


def _confusion(rows: Sequence[Row]) -> list[str]:
    """One line for each label: how often each answer was given."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        told = "+".join(sorted(row["label"]["effects"])) or "none"
        if row["withheld"]:
            told = f"{told} (withheld)"
        if len(row["label"]["effects"]) == 2:
            told = "two effects"
        said = "+".join(sorted(row["names"])) if row["word"] == "named" else row["word"].replace("_", " ")
        if len(row["label"]["effects"]) == 2:
            said = "both" if right(row) else f"{len(set(row['names']) & set(row['label']['effects']))} of them"
        if criteria.unlisted(row) and criteria.likeliest_place(row):
            said += f" at {criteria.likeliest_place(row)}"
        counts.setdefault(told, Counter())[said] += 1
    lines = ["| in the machine | answers |", "|---|---|"]
    return lines + [
        f"| {told} | {', '.join(f'{said} {n}' for said, n in counts[told].most_common())} |" for told in sorted(counts)
    ]


def _misses(rows: Sequence[Row], most: int) -> list[str]:
    """The misses, largest effects over the noise first."""

    def size(row: Row) -> float:
        """Over the noise; not a number where the label or the answer says nothing of it."""
        change = row["label"].get("torque_change_rms_nm")
        return float(change / row["noise"]) if change is not None and row["noise"] else math.nan

    def order(row: Row) -> tuple[bool, float]:
        return math.isnan(size(row)), -size(row)

    wrong = sorted((row for row in rows if not right(row)), key=order)
    headings = ("family", "campaign", "in the machine", "size / noise", "answer", "probability")
    lines = [f"| {' | '.join(headings)} |", "|---" * len(headings) + "|"]
    for row in wrong[:most]:
        said = "+".join(row["names"]) or row["word"]
        told = "+".join(row["label"]["effects"]) or "none"
        kept = " (withheld)" if row["withheld"] else ""
        lines.append(
            f"| {criteria.family_of(row)} | {row['folder']} | {told}{kept} | {_number(size(row))} | {said} | "
            f"{row['ranking'][0][2]:.2f} |"
        )
    return lines


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1f}"


if __name__ == "__main__":
    main()
