"""The score of a blind test: sentences, tables, figures, JSON and page."""

from __future__ import annotations

import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.blind import measures
from workbench.blind.make import validation
from workbench.blind.measures import MEASURES, OF_A_METHOD, Row, Share, median, numbers, right, right_word
from workbench.blind.power import LEAST, LITTLE, EffectPower, Power
from workbench.blind.score import Score, Sheet, WithNextRun
from workbench.core.errors import InputError
from workbench.core.json_records import plain
from workbench.core.names import unit_of, words_of
from workbench.core.numbers import NOTHING
from workbench.core.table import Column, Table, table_of, words
from workbench.core.templates import Sentences
from workbench.core.whole_folder import whole_folder, write_json
from workbench.diagnose.hypotheses.settings import THRESHOLD
from workbench.view.page import Section, save_page
from workbench.view.style import BLUE, FAINT, GREY, ORANGE, VERMILLION, Figure, figure, legend

WILSON = "In brackets: 95 % Wilson interval, in per cent."
DIAGNOSIS = "workbench diagnose"
AMOUNTS = ("parameter error %", "inside their 90 % interval", "shrink over oracle's", "calibration error", "CPU s")
MOST_OF_A_LINE = 140  # characters of an error
ROW = 36  # pixels of the power chart for each effect
BUYS = 0.9  # of an amount: less with one more run is written beside it
APART = 0.07  # of the distance of two sizes: measures stand side by side


said = Sentences("view/blind_words.j2")

# Sentences


def headline(sheet: Sheet) -> str:
    """The score in one line: what is named, what is accused without a gap, what is said to be unknown."""
    told = {
        "named": "single effects are named", "pair_both": "pairs are named in full",
        "false_alarm": "machines without a gap are given a cause", "unknown_caught": "unlisted causes are caught",
    }  # fmt: skip
    shares = {text: measures.measure(key).share(sheet.rows) for key, text in told.items()}
    return "; ".join(f"{share.count} of {share.of} {text}" for text, share in shares.items() if share.of) + "."


def sentences(sheet: Sheet) -> list[str]:
    """When the test was made and opened, how many campaigns have an answer, and what was not blind."""
    several = len(sheet.scores) > 1
    told = [f"{one.folder.name}: " * several + text for one in sheet.scores for text in said.each("folder", one)]
    broken = [row["folder"] for row in sheet.rows if row["word"] in ("refused", "failed")]
    return [*told, *said.each("sheet", broken, all(measures.source_of(row) == "plant" for row in sheet.rows))]


# Tables


def by_kind(head: str, table: Callable[[Sequence[Row]], Table], rows: Sequence[Row]) -> list[tuple[str, Table]]:
    """Heading and table of each kind of machine; one kind needs no name in its heading."""
    kinds = measures.by_kind(rows)
    return [(head if len(kinds) < 2 else f"{head}: {kind}", table(of_kind)) for kind, of_kind in kinds.items()]


def sheet_table(rows: Sequence[Row]) -> Table:
    """One row for each measure, one column for each kind and source."""
    columns: dict[Column, list[str]] = {words("measured"): [measure.line for measure in MEASURES]}
    for name, which in measures.groups(rows).items():
        kind = name.partition(",")[0]
        columns.setdefault(Column(f"{kind},\nasked", "%"), [measure.asked_text(kind) for measure in MEASURES])
        columns[Column(name.replace(", ", ",\n"))] = [measure.share(which).text() for measure in MEASURES]
    lines = [line for line in zip(*columns.values(), strict=True) if any("/" in cell for cell in line[1:])]
    return Table(list(columns), lines, WILSON)


def sizes(rows: Sequence[Row]) -> Table:
    """One row for each measure of cases with a cause, one column for each class of gap over noise."""
    groups = measures.by_size(rows)
    lines = [[measure.line, *(measure.share(which).text() for which in groups.values())] for measure in MEASURES]
    counted = [_amounts(which) for which in groups.values()]
    lines += [[name, *(amounts[name].partition(" of ")[0] for amounts in counted)] for name in AMOUNTS[:-1]]
    shown = [line for line in lines if any(cell != NOTHING for cell in line[1:])]
    columns = [words("measured"), *(Column(name.replace(", ", ",\n")) for name in groups)]
    return Table(columns, shown, f"{said.sizes()} {WILSON}")


def methods_of(rows: Sequence[Row]) -> dict[str, Sequence[Row]]:
    """The diagnosis' rows, and in a checkout those of simpler methods."""
    try:
        return {DIAGNOSIS: rows, **validation("baselines").baselines(rows)}
    except InputError:
        return {DIAGNOSIS: rows}


def methods(rows: Sequence[Row]) -> Table:
    """The diagnosis compared with simpler methods: one row for each measure, one column for each method."""
    answers, lines = methods_of(rows), []
    for measure in (measures.measure(key) for key in OF_A_METHOD):
        shares = [measure.share(which) for which in answers.values()]
        if shares[0].of:
            lines.append([measure.line, str(shares[0].of), *(share.percent() for share in shares)])
    heads = [Column(name.replace(" ", "\n", 1) if len(name) < 20 else textwrap.fill(name, 14), "%") for name in answers]
    note = "The commonest answer is taken from the labels. " + WILSON
    return Table([words("measured"), Column("cases"), *heads], lines, note)


def _amounts(rows: Sequence[Row]) -> dict[str, str]:
    """name of AMOUNTS -> text."""
    n = numbers(rows)

    def middle(values: Sequence[float], digits: int) -> str:
        """As 3.9 (2.7–5.1)."""
        interval = measures.median_interval(values)
        shown = "" if interval is None else f" ({interval[0]:.{digits}f}–{interval[1]:.{digits}f})"
        return f"{median(values):.{digits}f}{shown}" if values else NOTHING

    texts = (
        middle([100.0 * error for error in n.parameter_errors], 1),
        n.covered.text(),
        f"{middle(n.of_oracle, 2)} of {len(n.of_oracle)}" if n.of_oracle else NOTHING,
        NOTHING if n.calibration_error is None else f"{n.calibration_error:.3f} ({n.calibration_by_chance:.3f})",
        f"{median(n.cpu_s):.0f}, {n.cpu_s[-1]:.0f}" if n.cpu_s else NOTHING,
    )
    return dict(zip(AMOUNTS, texts, strict=True))


def amounts(rows: Sequence[Row]) -> Table:
    """Parameters, shrink, calibration and time, of each group."""
    columns = [
        words("kind, source"), Column("parameter\nerror", "%"), Column("inside their\n90 % interval"),
        Column("shrink over\noracle's"), Column("calibration\nerror"), Column("CPU,\nlargest", "s"),
    ]  # fmt: skip
    note = said.amounts(numbers(rows).without_oracle)
    return Table(columns, [[name, *_amounts(which).values()] for name, which in measures.groups(rows).items()], note)


def reliability_table(rows: Sequence[Row]) -> Table:
    """How often answers of each probability were right."""
    cells: dict[Column, Callable[[measures.Bin], str]] = {
        words("probability said"): lambda b: f"{b.low:.2f}–{b.high:.2f}",
        Column("mean"): lambda b: f"{b.said:.3f}",
        Column("right"): lambda b: b.right.text(),
    }
    return table_of(measures.reliability(rows), cells, WILSON)


def confusion_table(rows: Sequence[Row]) -> Table:
    """The confusion matrix, one line for each label: how often each answer was given."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        effects, names = row["label"]["effects"], set(row["names"])
        told = "two effects" if len(effects) == 2 else "+".join(effects) or "none"
        said = "+".join(sorted(names)) if row["word"] == "named" else row["word"].replace("_", " ")
        if len(effects) == 2:
            said = "both" if right(row) else f"{len(names & set(effects))} of them"
        if measures.unlisted(row) and measures.likeliest_place(row):
            said += f" at {measures.likeliest_place(row)}"
        counts.setdefault(told, Counter())[said] += 1
    lines = [
        [told, str(answers.total()), ", ".join(f"{answer} {n}" for answer, n in answers.most_common())]
        for told, answers in sorted(counts.items(), key=lambda one: one[0])
    ]
    return Table([words("in the machine"), Column("cases"), words("answers")], lines)


def _answer(row: Row) -> str:
    return " + ".join(row["names"]) or row["word"].replace("_", " ")


def _probability(row: Row) -> str:
    return f"{row['ranking'][0][2]:.2f}" if row["ranking"] else NOTHING


def misses(rows: Sequence[Row], most: int | None = None) -> Table:
    """The wrong answers, the largest gap over noise first, each with its reason."""
    size = measures.size_over_noise
    wrong = sorted((row for row in rows if not right(row)), key=lambda row: (math.isnan(size(row)), -size(row)))
    cells: dict[Column, Callable[[Row], str]] = {
        words("campaign"): lambda row: str(row["folder"]),
        words("family, source"): lambda row: f"{measures.family_of(row)}, {measures.source_of(row)}",
        words("in the machine"): lambda row: " + ".join(row["label"]["effects"]) or "none",
        Column("gap over\nnoise"): lambda row: NOTHING if math.isnan(size(row)) else f"{size(row):.1f}",
        words("answer"): _answer,
        Column("proba-\nbility"): _probability,
        words("how it came"): why,
    }
    more = f" The first {most} of {len(wrong)}." if most is not None and len(wrong) > most else ""
    return table_of(wrong[:most], cells, f"Largest gaps first.{more}" if wrong else "")


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
    small = "smaller than the noise"
    if row["word"] in ("refused", "failed"):
        if not row["warnings"]:
            return str(row["word"])
        line = str(row["warnings"][0]).strip().splitlines()[-1]  # without the folder, which is gone
        return textwrap.shorten(re.sub(r"\S*workbench-blind-[^/\\]*[/\\]", "", line), MOST_OF_A_LINE, placeholder=" …")
    word, told = right_word(row), set(row["label"]["effects"])
    if measures.right_or_alike(row):
        return "the right one is said to be alike"
    if word == "no_gap":
        least = row["before"] / row["noise"] if row["noise"] else math.nan
        return f"residual {least:.1f} times the noise before any effect{_against(row)}"
    if word == "unknown" and row["word"] == "no_gap":
        return "no hypothesis explains enough of it, and too little is left" if measures.visible(row) else small
    if word == "unknown":
        return f"a listed effect takes {100.0 * (row.get('explained') or 0.0):.0f} % of the gap's energy"
    if not measures.visible(row):
        return small
    if measures.among_first_three(row):
        place, probability = next(
            (place, p)
            for place, (verdict, names, p) in enumerate(row["ranking"])
            if verdict == "named" and told in (set(names), *measures.twins_of(row, names))
        )
        return f"the right one comes {('first', 'second', 'third')[place]}, with {probability:.2f}{_against(row)}"
    if told & set(row["names"]):
        added = sorted(set(row["names"]) - told)
        return f"with {added[0]} beside it" if added else "the other one is missed"
    merit = next((fit["merit"] for fit in row["weighed"] if set(fit["names"]) == told), None)
    if bar := next((names for names in row.get("barred", ()) if set(names) == told), None):
        return f"barred: {row.get('bars', {}).get('+'.join(bar), 'worth too little')}{_against(row)}"
    if merit is None:
        return f"not among the fits that the search followed{_against(row)}"
    if row["word"] == "no_gap":
        return f"weighed, with a merit of {merit:.0f}; a cause needs {THRESHOLD:.0f}"
    best = max(fit["merit"] for fit in row["weighed"])
    return f"weighed, and worth less than the answer: merit {merit:.0f}, the best {best:.0f}{_against(row)}"


_EVIDENCE = {"left": "what is left", "prior": "stretched tolerances"}


def _against(row: Row) -> str:
    """What spoke most for an unknown cause, where that is the answer."""
    speaks = {name: value for name, value in row["evidence"].items() if value > 0.0 and name in _EVIDENCE}
    if row["word"] != "unknown" or not speaks:
        return ""
    return f"; for an unknown one speaks most: {_EVIDENCE[max(speaks, key=speaks.__getitem__)]}"


def power_table(chart: Power) -> Table:
    """The smallest size of each effect that these runs would have named in nine of ten."""

    def with_more(effect: EffectPower) -> str:
        if effect.amount is None and effect.ratio is not None:
            return f"{100.0 * effect.ratio:.0f} % of it"
        return NOTHING if effect.one_more is None else _three(effect.one_more)

    cells: dict[Column, Callable[[EffectPower], str]] = {
        words("effect"): lambda e: e.effect,
        Column("named or\nalike"): lambda e: e.share.text(),
        words("amount"): lambda e: ", ".join(filter(None, (words_of(e.parameter), unit_of(e.parameter)))),
        Column("named in\n9 of 10 from"): lambda e: (
            f"> {_three(e.largest_tried)}" if e.amount is None else _three(e.amount)
        ),
        Column("95 % interval"): lambda e: NOTHING if e.interval is None else "–".join(map(_three, e.interval)),
        Column("with one\nmore run"): with_more,
    }
    return table_of(chart.effects, cells, said.power_note(chart, LEAST))


def power_sentences(chart: Power) -> list[str]:
    """What one more run would buy; none where none was tried."""
    return said.each("power", chart, LITTLE)


def _three(value: float) -> str:
    """Three digits, as 1400 and 0.0452."""
    return f"{float(f'{value:.3g}'):.10g}"


def settled(cases: Sequence[WithNextRun]) -> Share:
    """Of open cases whose recommended run was simulated, those that it settled."""
    return Share(sum(case.settled for case in cases), len(cases))


def settled_text(cases: Sequence[WithNextRun], rows: Sequence[Row]) -> str:
    """rows: of the whole sheet."""
    left_open = [row for row in rows if row.get("next_run") and row["label"]["effects"]]
    decided = sum(map(measures.next_run_decides, left_open))
    return said.settled(len(left_open), decided, settled(cases).text())


def next_runs_table(cases: Sequence[WithNextRun]) -> Table:
    """One row for each open case that was diagnosed again with its recommended run."""

    def run(case: WithNextRun) -> str:
        asked = case.row["next_run"]
        load = f", {asked['payload_kg']:g} kg" if asked["payload_kg"] else ""
        more = f", logging {', '.join(asked['signals'])}" if asked["signals"] else ""
        return f"{asked['profile']}{load}{more}"

    def probable(row: Row) -> str:
        return f"{_answer(row)} ({_probability(row)})" if row["ranking"] else _answer(row)

    cells: dict[Column, Callable[[WithNextRun], str]] = {
        words("campaign"): lambda case: str(case.row["folder"]),
        words("in the machine"): lambda case: " + ".join(case.row["label"]["effects"]),
        words("answer"): lambda case: probable(case.row),
        words("recommended run"): run,
        words("answer with it"): lambda case: probable(case.then),
        words("settled"): lambda case: "yes" if case.settled else "open still" if right(case.then) else "no",
    }
    return table_of(cases, cells, "Settled: the answer is right, and leaves nothing open.")


# Figures


def _points(shares: Sequence[Share], **look: Any) -> dict[str, Any]:
    """Per cent, with 95 % intervals."""
    at = [100.0 * share.count / share.of for share in shares]
    ends = [share.interval() for share in shares]
    error = {
        "type": "data", "symmetric": False, "thickness": 1.2,
        "array": [100.0 * high - y for (_, high), y in zip(ends, at, strict=True)],
        "arrayminus": [y - 100.0 * low for (low, _), y in zip(ends, at, strict=True)],
    }  # fmt: skip
    text = [f"{share.count} of {share.of}" for share in shares]
    shown = {"type": "scatter", "mode": "lines+markers", "hovertemplate": "%{y:.0f} %, %{text}"}
    return {**shown, "y": at, "error_y": error, "text": text, **look}


def right_by_size(rows: Sequence[Row]) -> Figure:
    """Shares right over the size of the gap; a line a measure, with 95 % intervals, side by side."""
    known = [name for name, *_ in measures.SIZES]
    groups = {name: which for name, which in measures.by_size(rows).items() if name in known}
    data = []
    for k, measure in enumerate(measures.measure(key) for key in ("named", "first_three", "place")):
        shares = {at: share for at, which in enumerate(groups.values()) if (share := measure.share(which)).of}
        look = {"line": {"color": (BLUE, ORANGE, VERMILLION)[k]}, "marker": {"size": 9, "symbol": k}}
        data.append(_points([*shares.values()], name=measure.line, x=[at + APART * (k - 1) for at in shares], **look))
    ticks = {"tickvals": list(range(len(groups))), "ticktext": list(groups), "zeroline": False}
    return figure(
        "Answers that are right, by the size of the gap", 400, data, legend=legend(400),
        xaxis={"title": {"text": "gap over noise"}, **ticks}, yaxis={"title": {"text": "share (%)"}, "range": [0, 104]},
    )  # fmt: skip


def reliability(bins: Sequence[measures.Bin]) -> Figure:
    """Share right over the probability that answers had; on the diagonal they say what they are worth."""
    diagonal = {
        "type": "scatter", "mode": "lines", "x": [0, 100], "y": [0, 100], "name": "as said",
        "line": {"color": GREY, "dash": "5px,4px", "width": 1.4}, "hoverinfo": "skip",
    }  # fmt: skip
    look = {"line": {"color": BLUE}, "marker": {"size": 9}}
    measured = _points([b.right for b in bins], name="measured", x=[100.0 * b.said for b in bins], **look)
    return figure(
        "Reliability of the probabilities", 420, [diagonal, measured], legend=legend(420),
        xaxis={"title": {"text": "probability of the answer (%)"}, "range": [0, 104]},
        yaxis={"title": {"text": "right (%)"}, "range": [0, 104]},
    )  # fmt: skip


def power(effects: Sequence[EffectPower], unit: str) -> Figure:
    """The power chart: for each effect the smallest change of the input that is named in 9 of 10 cases, its interval,
    and the same with one more run, each with the effect's own amount above it. An arrow: not within the sizes tried."""
    shown = sorted(effects, key=lambda e: (e.change is None, e.change or e.largest_change_tried), reverse=True)
    named, data = [e for e in shown if e.change is not None], []

    def draw(name: str, place: str, points: Sequence[tuple[EffectPower, float | None, str]], colour: str, symbol: str,
             **more: Any) -> None:  # fmt: skip
        """points: effect, change, amount."""
        if points:
            data.append({
                "type": "scatter", "mode": "markers+text", "name": name, "cliponaxis": False,
                "marker": {"size": 10, "color": colour, "symbol": symbol}, "textfont": {"size": 10, "color": colour},
                "text": [f"{own} {unit_of(e.parameter)}".strip() if own else "" for e, _, own in points],
                "textposition": f"{place} center", "x": [x for _, x, _ in points], "y": [e.effect for e, *_ in points],
                "hovertemplate": f"%{{text}}, %{{x:.3~g}} {unit}", **more,
            })  # fmt: skip

    spans = [(e.change or 0.0, *(e.change_interval or (e.change or 0.0, e.change or 0.0))) for e in named]
    error = {"type": "data", "symmetric": False, "thickness": 1.2, "array": [high - x for x, _, high in spans],
             "arrayminus": [x - low for x, low, _ in spans]}  # fmt: skip
    own = [(e, e.change, _three(e.amount) if e.amount else "") for e in named]
    draw("these runs", "top", own, BLUE, "circle", error_x=error)
    less = {e.effect: bool(e.one_more and e.amount and e.one_more < BUYS * e.amount) for e in named}
    more = [(e, e.change_one_more, _three(e.one_more or 0.0) if less[e.effect] else "") for e in named]
    more = [point for point in more if point[1] is not None]
    draw("with one more run", "bottom", more, ORANGE, "diamond-open")
    beyond = [(e, e.largest_change_tried, f"> {_three(e.largest_tried)}") for e in shown if e.change is None]
    draw("not within the sizes tried", "top", beyond, VERMILLION, "triangle-right")
    height = 150 + ROW * len(shown)
    return figure(
        "The smallest effect that these runs would have named in 9 of 10", height, data, legend=legend(height),
        margin={"l": 210, "r": 28, "t": 84, "b": 60},
        xaxis={"title": {"text": f"change of the input, rms while moving ({unit})"}, "type": "log"},
        yaxis={"categoryorder": "array", "categoryarray": [e.effect for e in shown], "gridcolor": FAINT},
    )  # fmt: skip


# Files


def write_score(sheet: Sheet, folder: Path, power: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> None:
    """Write score.json, score.md and score.html into an empty folder, or none."""
    parts = sections(sheet, power, next_runs)
    with whole_folder(folder) as hidden:
        write_json(hidden / "score.json", to_json(sheet, power, next_runs))
        (hidden / "score.md").write_text("\n\n".join(b for p in parts for b in _blocks(p)) + "\n", encoding="utf-8")
        save_page(parts, hidden / "score.html", f"Blind test: {sheet.title}", headline(sheet))


def sections(sheet: Sheet, chart: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> list[Section]:
    """The sections of the page; those without rows are omitted."""
    rows, bins = sheet.rows, measures.reliability(sheet.rows)
    by_size = [Section(head, tables=[table]) for head, table in by_kind("By the size of the gap", sizes, rows)]
    by_size[-1] = replace(by_size[-1], figures=[(right_by_size(rows), "")])
    parts = [
        Section(tables=[*map(sheet_table, measures.by_kind(rows).values()), amounts(rows)]),
        Section("The seal", points=sentences(sheet)),
        *([Section("The power of these runs", power_sentences(chart), (), [power_table(chart)],
                   [(power(chart.effects, chart.unit), "")])] if chart is not None else []),
        *([Section("Open cases with the recommended next run", [settled_text(next_runs, rows)],
                   tables=[next_runs_table(next_runs)])] if next_runs else []),
        *by_size,
        Section("Probabilities", tables=[reliability_table(rows)], figures=[(reliability(bins), "")]),
        *(Section(head, tables=[table]) for head, table in by_kind("Beside other methods", methods, rows)),
        Section("Answers", tables=[confusion_table(rows)]),
        Section("Misses", tables=[misses(rows)]),
    ]  # fmt: skip
    return list(filter(None, parts))


def _blocks(part: Section) -> Iterator[str]:
    """Of a section without its figures, as Markdown."""
    if part.heading:
        yield f"## {part.heading}"
    yield from part.sentences
    if part.points:
        yield "\n".join(f"- {point}" for point in part.points)
    for table in filter(None, part.tables):
        yield from filter(None, (table.markdown(), table.note))


def to_json(sheet: Sheet, power: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> dict[str, Any]:
    """Everything that the page shows. folders: what was scored; cases: each campaign's label and answer."""
    rows, kinds = sheet.rows, measures.by_kind(sheet.rows)
    told: dict[str, Any] = {
        "format": 3,
        "folders": [_folder(score) for score in sheet.scores],
        "campaigns": sheet.cases,
        "answered": len(rows),
        "groups": {name: _group(which) for name, which in measures.groups(rows).items()},
        "by_size": {
            kind: {name: _group(which) for name, which in measures.by_size(of_kind).items()}
            for kind, of_kind in kinds.items()
        },
        "methods": {
            kind: {name: _shares(which, OF_A_METHOD) for name, which in methods_of(of_kind).items()}
            for kind, of_kind in kinds.items()
        },
        "reliability": [
            {"from": b.low, "below": b.high, "said": b.said, "right": _share(b.right)}
            for b in measures.reliability(rows)
        ],
        "next_run_settles": _share(settled(next_runs)) if next_runs else None,
        "next_runs": [
            {
                "campaign": case.row["folder"], "effects": case.row["label"]["effects"],
                "ranking": case.row["ranking"], "run": case.row["next_run"],
                "ranking_with_it": case.then["ranking"], "settled": case.settled,
            }
            for case in next_runs
        ],
        "power": None if power is None else {
            "effects": list(map(vars, power.effects)), "unit": power.unit,
            "note": said.power_note(power, LEAST), "sentences": power_sentences(power),
        },
        "cases": [_case(row) for row in rows],
    }  # fmt: skip
    shown: dict[str, Any] = plain(told)
    return shown


def _folder(score: Score) -> dict[str, Any]:
    known = score.manifest
    return {
        "folder": score.folder.name, "made": known.made, "version": known.version, "answered_by": score.versions,
        "asked": dict(known.asked), "seed": score.truth.seed, "seal_sha256": known.seal_sha256,
        "opened": score.opened, "campaigns": score.cases, "answered": len(score.rows),
        "after_opening": score.after_opening,
    }  # fmt: skip


def _group(rows: Sequence[Row]) -> dict[str, Any]:
    n = numbers(rows)
    return {
        **_shares(rows),
        "parameter_error_median": median(n.parameter_errors),
        "parameter_error_median_95": measures.median_interval(n.parameter_errors),
        "inside_90": _share(n.covered),
        "shrink_over_oracle_median": median(n.of_oracle),
        "shrink_over_oracle_median_95": measures.median_interval(n.of_oracle),
        "calibration_error": n.calibration_error,
        "calibration_error_by_chance": n.calibration_by_chance,
        "cpu_s_median": median(n.cpu_s),
        "cpu_s_largest": n.cpu_s[-1] if n.cpu_s else None,
    }


def _shares(rows: Sequence[Row], keys: Sequence[str] = ()) -> dict[str, Any]:
    return {measure.key: _share(measure.share(rows)) for measure in MEASURES if not keys or measure.key in keys}


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval()
    return {"count": share.count, "of": share.of, "low_95": low, "high_95": high}


def _case(row: Row) -> dict[str, Any]:
    asked: Mapping[str, Any] = row["label"]
    kept = ("names", "alike", "ranking", "places", "before", "after", "noise", "cpu_s")
    return {
        "campaign": row["folder"],
        "source": measures.source_of(row),
        "family": measures.family_of(row),
        "kind": measures.kind_of(row),
        **{key: asked[key] for key in ("effects", "where")},
        "parameters": asked.get("parameters", {}),
        "gap_over_noise": measures.size_over_noise(row),
        "verdict": row["word"],
        **{key: row[key] for key in kept},
        "right": right(row),
        "why": "" if right(row) else why(row),
    }
