"""The score sheet as tables of ready text."""

from __future__ import annotations

import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence

from workbench.blind import criteria, measures
from workbench.blind.baselines import baselines
from workbench.blind.criteria import Row, Share, right, right_word
from workbench.blind.later import WithNextRun
from workbench.blind.measures import MEASURES, OF_A_METHOD, median, numbers
from workbench.blind.power import Power
from workbench.core.names import unit_of, words_of
from workbench.core.table import Column, Table, words
from workbench.diagnose.hypotheses.settings import calibration

WILSON = "In brackets: 95 % Wilson interval, in per cent."
DIAGNOSIS = "workbench diagnose"


def sheets(rows: Sequence[Row]) -> list[Table]:
    """A sheet for each kind of machine."""
    return [sheet(of_kind) for of_kind in measures.by_kind(rows).values()]


def sheet(rows: Sequence[Row]) -> Table:
    """One row for each measure, one column for each kind and source."""
    groups = measures.groups(rows)
    kinds = [name.partition(",")[0] for name in groups]
    asked = {kind: [measure.asked_text(kind) for measure in MEASURES] for kind in dict.fromkeys(kinds)}
    columns = [words("measured")]
    for number, (name, kind) in enumerate(zip(groups, kinds, strict=True)):
        if number == 0 or kinds[number - 1] != kind:
            columns.append(Column(f"{kind},\nasked", "%"))
        columns.append(Column(name.replace(", ", ",\n")))
    lines = []
    for k, measure in enumerate(MEASURES):
        line = [measure.line]
        for number, (which, kind) in enumerate(zip(groups.values(), kinds, strict=True)):
            if number == 0 or kinds[number - 1] != kind:
                line.append(asked[kind][k])
            line.append(measure.share(which).text())
        lines.append(line)
    return Table(columns, [line for line in lines if _says_something(line)], WILSON)


def _says_something(line: Sequence[str]) -> bool:
    return any("/" in cell for cell in line[1:])


def sizes(rows: Sequence[Row]) -> Table:
    """One row for each measure of cases with a cause, one column for each class of gap over noise."""
    groups = measures.by_size(rows)
    lines = [[measure.line, *map(Share.text, map(measure.share, groups.values()))] for measure in MEASURES]
    counted = [_amounts(which) for which in groups.values()]
    lines += [[name, *(amounts[name].partition(" of ")[0] for amounts in counted)] for name in AMOUNTS[:-1]]
    shown = [line for line in lines if any(cell != "–" for cell in line[1:])]
    note = (
        "Columns: gap over noise. The gap is what the cause changes in the input, rms while moving; the noise is that "
        f"of the diagnosis' band. {WILSON}"
    )
    return Table([words("measured"), *(Column(name.replace(", ", ",\n")) for name in groups)], shown, note)


def sizes_by_kind(rows: Sequence[Row]) -> list[tuple[str, Table]]:
    """Heading and table of each kind of machine."""
    return _by_kind("By the size of the gap", sizes, rows)


def _by_kind(head: str, table: Callable[[Sequence[Row]], Table], rows: Sequence[Row]) -> list[tuple[str, Table]]:
    """One kind needs no name in its heading."""
    kinds = measures.by_kind(rows)
    return [(head if len(kinds) < 2 else f"{head}: {kind}", table(of_kind)) for kind, of_kind in kinds.items()]


def methods(rows: Sequence[Row]) -> Table:
    """The diagnosis compared with simpler methods: one row for each measure, one column for each method."""
    answers: dict[str, Sequence[Row]] = {DIAGNOSIS: rows, **baselines(rows)}
    lines = []
    for measure in (measures.measure(key) for key in OF_A_METHOD):
        shares = [measure.share(which) for which in answers.values()]
        if shares[0].of:
            lines.append([measure.line, str(shares[0].of), *(share.percent() for share in shares)])
    heads = [Column(name.replace(" ", "\n", 1) if len(name) < 20 else _parted(name), "%") for name in answers]
    note = "The commonest answer is taken from the labels. " + WILSON
    return Table([words("measured"), Column("cases"), *heads], lines, note)


def methods_by_kind(rows: Sequence[Row]) -> list[tuple[str, Table]]:
    """Heading and table of each kind of machine."""
    return _by_kind("Beside other methods", methods, rows)


def _parted(name: str) -> str:
    """Split into lines of about twelve characters."""
    return "\n".join(textwrap.wrap(name, 14))


AMOUNTS = ("parameter error %", "inside their 90 % interval", "shrink over oracle's", "calibration error", "CPU s")


def _amounts(rows: Sequence[Row]) -> dict[str, str]:
    """name of AMOUNTS -> text."""
    n = numbers(rows)
    calibration = "–"
    if n.calibration_error is not None:
        calibration = f"{n.calibration_error:.3f} ({n.calibration_by_chance:.3f})"
    texts = (
        _median([100.0 * error for error in n.parameter_errors], 1),
        n.covered.text(),
        f"{_median(n.of_oracle, 2)} of {len(n.of_oracle)}" if n.of_oracle else "–",
        calibration,
        f"{median(n.cpu_s):.0f}, {n.cpu_s[-1]:.0f}" if n.cpu_s else "–",
    )
    return dict(zip(AMOUNTS, texts, strict=True))


def _median(values: Sequence[float], digits: int) -> str:
    """As 3.9 (2.7–5.1)."""
    if not values:
        return "–"
    interval = measures.median_interval(values)
    shown = "" if interval is None else f" ({interval[0]:.{digits}f}–{interval[1]:.{digits}f})"
    return f"{median(values):.{digits}f}{shown}"


def amounts(rows: Sequence[Row]) -> Table:
    """Parameters, shrink, calibration and time, of each group."""
    lines = [[name, *_amounts(which).values()] for name, which in measures.groups(rows).items()]
    columns = [
        words("kind, source"),
        Column("parameter\nerror", "%"),
        Column("inside their\n90 % interval"),
        Column("shrink over\noracle's"),
        Column("calibration\nerror"),
        Column("CPU,\nlargest", "s"),
    ]
    note = (
        "Medians with their 95 % interval between two of the values; CPU time beside the largest. Asked: 85 to 95 % "
        "inside the interval, shrink at least 0.9 of the oracle's, the true effect fitted to the same runs, "
        "calibration error at most 0.05; in brackets that which answers would have that are right exactly as often as "
        "they say."
    )
    missing = numbers(rows).without_oracle
    if missing:
        note += f" In {missing} cases the true effect was not among the best fits."
    return Table(columns, lines, note)


def reliability(rows: Sequence[Row]) -> Table:
    """How often answers of each probability were right."""
    lines = [[f"{b.low:.2f}–{b.high:.2f}", f"{b.said:.3f}", b.right.text()] for b in measures.reliability(rows)]
    return Table([words("probability said"), Column("mean"), Column("right")], lines, WILSON)


def confusion(rows: Sequence[Row]) -> Table:
    """One line for each label: how often each answer was given."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        counts.setdefault(_told(row), Counter())[_said(row)] += 1
    lines = [
        [told, str(sum(counts[told].values())), ", ".join(f"{said} {n}" for said, n in counts[told].most_common())]
        for told in sorted(counts)
    ]
    return Table([words("in the machine"), Column("cases"), words("answers")], lines)


def confusion_counts(rows: Sequence[Row]) -> dict[str, Counter[str]]:
    """What is in the machine -> answer -> how often, of single effects, unlisted causes and machines without a gap. A
    wrong pair is one answer."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row["label"]["effects"]) < 2:
            told = "unlisted cause" if criteria.unlisted(row) else _told(row)
            word = row["word"].replace("_", " ")
            said = (row["names"][0] if len(row["names"]) == 1 else "two effects") if word == "named" else word
            counts.setdefault(told.replace("none", "no gap"), Counter())[said] += 1
    return dict(sorted(counts.items(), key=lambda item: (item[0] in ("unlisted cause", "no gap"), item[0])))


def _told(row: Row) -> str:
    effects = row["label"]["effects"]
    told = "two effects" if len(effects) == 2 else "+".join(effects) or "none"
    return f"{told} (taken out of the library)" if row.get("withheld") else told


def _said(row: Row) -> str:
    if len(row["label"]["effects"]) == 2:
        return "both" if right(row) else f"{len(set(row['names']) & set(row['label']['effects']))} of them"
    said = "+".join(sorted(row["names"])) if row["word"] == "named" else row["word"].replace("_", " ")
    if criteria.unlisted(row) and criteria.likeliest_place(row):
        said += f" at {criteria.likeliest_place(row)}"
    return said


def misses(rows: Sequence[Row], most: int | None = None) -> Table:
    """The wrong answers, the largest gap over noise first, each with its reason."""

    def order(row: Row) -> tuple[bool, float]:
        size = criteria.size_over_noise(row)
        return math.isnan(size), -size

    wrong = sorted((row for row in rows if not right(row)), key=order)
    lines = []
    for row in wrong[:most]:
        size = criteria.size_over_noise(row)
        told = " + ".join(row["label"]["effects"]) or "none"
        said = " + ".join(row["names"]) or row["word"].replace("_", " ")
        source = f"{criteria.family_of(row)}, {criteria.source_of(row)}"
        shown = "–" if math.isnan(size) else f"{size:.1f}"
        probability = f"{row['ranking'][0][2]:.2f}" if row["ranking"] else "–"
        lines.append([row["folder"], source, told, shown, said, probability, why(row)])
    columns = [
        words("campaign"),
        words("family, source"),
        words("in the machine"),
        Column("gap over\nnoise"),
        words("answer"),
        Column("proba-\nbility"),
        words("how it came"),
    ]
    more = f" The first {most} of {len(wrong)}." if most is not None and len(wrong) > most else ""
    return Table(columns, lines, f"Largest gaps first.{more}" if lines else "")


def miss_lines(rows: Sequence[Row], most: int) -> list[str]:
    """The wrong answers as sentences, for a terminal."""
    shown = misses(rows, most)
    lines = [
        f"{name} ({which}): {told}, {size} times the noise, answered {said} ({probability}): {how}."
        for name, which, told, size, said, probability, how in shown.rows
    ]
    return [*lines, shown.note] if lines else []


def why(row: Row) -> str:
    """The reason of a wrong answer in one line, from the hypotheses that were weighed."""
    if row["word"] in ("refused", "failed"):
        return _last_line(row)
    word, told = right_word(row), set(row["label"]["effects"])
    if criteria.right_or_alike(row):
        return "the right one is said to be alike"
    if word == "no_gap":
        least = row["before"] / row["noise"] if row["noise"] else math.nan
        return f"residual {least:.1f} times the noise before any effect{_against(row)}"
    if word == "unknown" and row["word"] == "no_gap":
        return "no hypothesis explains enough of it, and too little is left" if criteria.visible(row) else _SMALL
    if word == "unknown":
        return f"a listed effect takes {100.0 * (row.get('explained') or 0.0):.0f} % of the gap's energy"
    if not criteria.visible(row):
        return _SMALL
    if criteria.among_first_three(row):
        place, probability = next(
            (place, p)
            for place, (verdict, names, p) in enumerate(row["ranking"], start=1)
            if verdict == "named" and told in (set(names), *criteria.twins_of(row, names))
        )
        return f"the right one comes {_ORDINALS[place]}, with {probability:.2f}{_against(row)}"
    if told & set(row["names"]):
        added = sorted(set(row["names"]) - told)
        return f"with {added[0]} beside it" if added else "the other one is missed"
    merit = next((fit["merit"] for fit in row["weighed"] if set(fit["names"]) == told), None)
    if merit is not None:
        best = max(fit["merit"] for fit in row["weighed"])
        if row["word"] == "no_gap":
            return f"weighed, with a merit of {merit:.0f}; a cause needs {calibration()['threshold']:.0f}"
        return f"weighed, and worth less than the answer: merit {merit:.0f}, the best {best:.0f}{_against(row)}"
    return f"not among the fits that the search followed{_against(row)}"


_SMALL = "smaller than the noise"
_ORDINALS = {1: "first", 2: "second", 3: "third"}
_EVIDENCE = {
    "left": "what is left",
    "prior": "stretched tolerances",
    "bound": "a value at its bound",
    "against": "two effects that undo each other",
}
MOST_OF_A_LINE = 140  # characters of an error


def _against(row: Row) -> str:
    """What spoke most for an unknown cause, where that is the answer."""
    speaks = {name: value for name, value in row["evidence"].items() if value > 0.0 and name in _EVIDENCE}
    if row["word"] != "unknown" or not speaks:
        return ""
    weights = calibration()
    most = max(speaks, key=lambda name: weights.get(f"unknown_{name}", 0.0) * speaks[name])
    return f"; for an unknown one speaks most: {_EVIDENCE[most]}"


def _last_line(row: Row) -> str:
    """Of what the diagnosis said as it broke off, without the folder, which is gone."""
    if not row["warnings"]:
        return str(row["word"])
    line = str(row["warnings"][0]).strip().splitlines()[-1]
    return textwrap.shorten(re.sub(r"\S*workbench-blind-[^/\\]*[/\\]", "", line), MOST_OF_A_LINE, placeholder=" …")


def power(chart: Power) -> Table:
    """The smallest size of each effect that these runs would have named in nine of ten."""
    lines = []
    for effect in chart.effects:
        more = "–" if effect.one_more is None else _amount(effect.one_more)
        if effect.amount is None and effect.ratio is not None:
            more = f"{100.0 * effect.ratio:.0f} % of it"
        lines.append(
            [
                effect.effect,
                effect.share.text(),
                ", ".join(filter(None, (words_of(effect.parameter), unit_of(effect.parameter)))),
                f"> {_amount(effect.largest_tried)}" if effect.amount is None else _amount(effect.amount),
                "–" if effect.interval is None else "–".join(map(_amount, effect.interval)),
                more,
            ]
        )
    columns = [
        words("effect"),
        Column("named or\nalike"),
        words("amount"),
        Column("named in\n9 of 10 from"),
        Column("95 % interval"),
        Column("with one\nmore run"),
    ]
    return Table(columns, lines, chart.note)


def _amount(value: float) -> str:
    """Three digits, as 1400 and 0.0452."""
    return f"{float(f'{value:.3g}'):.10g}"


def settled(cases: Sequence[WithNextRun]) -> Share:
    """Of open cases whose recommended run was simulated, those that it settled."""
    return Share(sum(case.settled for case in cases), len(cases))


def settled_text(cases: Sequence[WithNextRun], rows: Sequence[Row]) -> str:
    """rows: of the whole sheet."""
    left_open = [row for row in rows if row.get("next_run") and row["label"]["effects"]]
    decided = sum(map(criteria.next_run_decides, left_open))
    return (
        f"{len(left_open)} cases with a cause are left open. Of {len(left_open) - decided} the diagnosis says that no "
        f"run on its menu decides. Of those whose recommended run was simulated, {settled(cases).text()} were settled "
        "by it (asked: 80 %)."
    )


def next_runs(cases: Sequence[WithNextRun]) -> Table:
    """One row for each open case that was diagnosed again with its recommended run."""
    lines = []
    for case in cases:
        asked = case.row["next_run"]
        load = f", {asked['payload_kg']:g} kg" if asked["payload_kg"] else ""
        more = f", logging {', '.join(asked['signals'])}" if asked["signals"] else ""
        lines.append(
            [
                case.row["folder"],
                " + ".join(case.row["label"]["effects"]),
                _answer(case.row),
                f"{asked['profile']}{load}{more}",
                _answer(case.then),
                "yes" if case.settled else "open still" if right(case.then) else "no",
            ]
        )
    columns = ("campaign", "in the machine", "answer", "recommended run", "answer with it", "settled")
    return Table([words(name) for name in columns], lines, "Settled: the answer is right, and leaves nothing open.")


def next_run_lines(cases: Sequence[WithNextRun]) -> list[str]:
    """The same as sentences, for a terminal."""
    return [
        f"{name}: {told}, answered {said}; with a run {run}: {then}; settled: {settled}."
        for name, told, said, run, then, settled in next_runs(cases).rows
    ]


def _answer(row: Row) -> str:
    """As friction_viscous (0.93)."""
    said = " + ".join(row["names"]) or row["word"].replace("_", " ")
    return f"{said} ({row['ranking'][0][2]:.2f})" if row["ranking"] else said
