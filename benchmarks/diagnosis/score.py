"""`python -m benchmarks.diagnosis.score ANSWERS...`: what was asked, what was measured, the confusions, the misses."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.diagnosis.answers import load

Row = Mapping[str, Any]
LOOSE = ("heave", "torque_ripple")  # their residual may stay at twice the noise
VISIBLE = 1.0  # of the noise: an effect that changes the torque by less, rms, is too small to see


def right_word(row: Row) -> str:
    effects = row["label"]["effects"]
    if not effects:
        return "no_gap"
    unlisted = any("unlisted" in name for name in effects)
    return "unknown" if unlisted or set(effects) & set(row["withheld"]) else "named"


def right(row: Row) -> bool:
    """The answer is the label's, exactly."""
    word = right_word(row)
    return row["word"] == word and (word != "named" or set(row["names"]) == set(row["label"]["effects"]))


def right_or_alike(row: Row) -> bool:
    """Exactly, or the label's effect stands among those that are said to be alike."""
    told = set(row["label"]["effects"])
    return right(row) or (row["word"] == "named" and len(told) == 1 and told <= {*row["names"], *row["alike"]})


def visible(row: Row) -> bool:
    size = row["label"].get("torque_change_rms_nm") or math.inf
    return bool(size >= VISIBLE * row["noise"])


def estimates_within(row: Row) -> Iterator[tuple[str, float, float]]:
    """name, relative error, error over standard error, of each amount of a rightly named campaign."""
    if not right(row) or right_word(row) != "named":
        return
    for effect, told in row["label"].get("parameters", {}).items():
        for name, truth in told.items():
            found = row["estimates"].get(effect, {}).get(name)
            if found is None or isinstance(found[0], list) or name.endswith("phase_rad"):
                continue
            value, error = float(found[0]), float(found[1])
            neutral = 1.0 if effect in ("torque_scale", "payload_mass_error") else 0.0
            if abs(truth - neutral) > 0.0 and error > 0.0:
                yield f"{effect}.{name}", abs(value - truth) / abs(truth - neutral), abs(value - truth) / error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("answers", type=Path, nargs="+")
    parser.add_argument("--misses", type=int, default=20)
    given = parser.parse_args()
    rows = [row for folder in given.answers for row in load(folder)]
    print("\n".join(report(rows, given.misses)))


def report(rows: Sequence[Row], misses: int) -> list[str]:
    singles = [r for r in rows if right_word(r) == "named" and len(r["label"]["effects"]) == 1]
    seen = [r for r in singles if visible(r)]
    pairs = [r for r in rows if right_word(r) == "named" and len(r["label"]["effects"]) == 2]
    none = [r for r in rows if right_word(r) == "no_gap"]
    unlisted = [r for r in rows if right_word(r) == "unknown" and not r["withheld"]]
    withheld = [r for r in rows if r["withheld"]]
    lines = ["| what | asked | measured | campaigns |", "|---|---|---|---|"]

    def share(what: str, asked: str, which: Sequence[Row], test: Callable[[Row], bool]) -> None:
        count = sum(map(test, which))
        measured = f"{100.0 * count / len(which):.0f} % ({count})" if which else "–"
        lines.append(f"| {what} | {asked} | {measured} | {len(which)} |")

    share("single effect named, visible ones", "≥ 90 %", seen, right)
    share("the same, or said to be alike", "", seen, right_or_alike)
    share("single effect named, all sizes", "", singles, right)
    share("false alarm without a gap", "≤ 3 %", none, lambda r: not right(r))
    share("pair: both named", "≥ 65 %", pairs, right)
    share("effect no library holds: unknown", "≥ 80 %", unlisted, right)
    share("effect taken out of the library: unknown", "≥ 80 %", withheld, right)
    named = [r for r in rows if right(r) and right_word(r) == "named"]
    strict = [r for r in named if not set(r["label"]["effects"]) & set(LOOSE)]
    loose = [r for r in named if set(r["label"]["effects"]) & set(LOOSE)]
    share("held-out residual ≤ 1.3 of the noise", "", strict, lambda r: r["after"] <= 1.3 * r["noise"])
    share("the same, heave and ripple ≤ 2", "", loose, lambda r: r["after"] <= 2.0 * r["noise"])
    errors = sorted(e for r in rows for _, e, _ in estimates_within(r))
    inside = [s <= 1.6449 for r in rows for _, _, s in estimates_within(r)]
    if errors:
        lines.append(
            f"| parameters' error, median | ≤ 10 % | {100.0 * errors[len(errors) // 2]:.1f} % | {len(errors)} |"
        )
        lines.append(
            f"| inside their 90 % interval | 85–95 % | {100.0 * sum(inside) / len(inside):.0f} % | {len(inside)} |"
        )
    lines.append(f"| subsystem right | | {_place(named)} | {len(named)} |")
    times = sorted(float(r["cpu_s"]) for r in rows)
    lines.append(
        f"| CPU time, median and largest | | {times[len(times) // 2]:.0f} s, {times[-1]:.0f} s | {len(times)} |"
    )
    lines += ["", *_calibration(rows), "", *_confusion(rows), "", *_misses(rows, misses)]
    return lines


def _place(rows: Sequence[Row]) -> str:
    def fits(row: Row) -> bool:
        return any(w["subsystem"] == row["subsystem"] and w["regime"] == row["regime"] for w in row["label"]["where"])

    return f"{100.0 * sum(map(fits, rows)) / max(len(rows), 1):.0f} %"


def _calibration(rows: Sequence[Row]) -> list[str]:
    """Of the answers given with about this probability, how many were right."""
    lines = ["| probability of the answer | answers | right |", "|---|---|---|"]
    for low, high in ((0.0, 0.6), (0.6, 0.8), (0.8, 0.95), (0.95, 1.01)):
        which = [r for r in rows if low <= r["ranking"][0][2] < high]
        if which:
            lines.append(
                f"| {low:.2f}–{min(high, 1.0):.2f} | {len(which)} | "
                f"{100.0 * sum(map(right, which)) / len(which):.0f} % |"
            )
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
        counts.setdefault(told, Counter())[said] += 1
    lines = ["| in the machine | answers |", "|---|---|"]
    return lines + [
        f"| {told} | {', '.join(f'{said} {n}' for said, n in counts[told].most_common())} |" for told in sorted(counts)
    ]


def _misses(rows: Sequence[Row], most: int) -> list[str]:
    """The misses, largest effects first."""
    wrong = sorted((r for r in rows if not right(r)), key=lambda r: -(r["label"].get("torque_change_rms_nm") or 0.0))
    lines = ["| campaign | in the machine | size / noise | answer | probability |", "|---|---|---|---|---|"]
    for r in wrong[:most]:
        size = (r["label"].get("torque_change_rms_nm") or 0.0) / r["noise"] if r["noise"] else math.nan
        said = "+".join(r["names"]) or r["word"]
        told = "+".join(r["label"]["effects"]) or "none"
        kept = " (withheld)" if r["withheld"] else ""
        lines.append(f"| {r['folder']} | {told}{kept} | {size:.1f} | {said} | {r['ranking'][0][2]:.2f} |")
    return lines


if __name__ == "__main__":
    main()
