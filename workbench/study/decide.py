"""Which reference to take: a line each with its figures, and one sentence that agrees with their front.
What the lowest torque peak costs in the other figures of the table that decides.
What a study says in sentences, the answer to its question first: in the terminal and on its page alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from workbench.metrics import Metric, MetricSet, View, set_with, shown_in
from workbench.study.findings import alarm, sentences, utilisation
from workbench.study.labels import set_in, words_of
from workbench.study.load import Study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit
from workbench.study.side import from_the_bound, on_another_damping
from workbench.study.tables import metric_heads, metric_note
from workbench.tables import Table, words

TIME = "move_time_s"
BEST = "★"
SAME_TIME_S, SAME_PEAK = 5e-3, 2e-3  # a smaller difference in time (s), in peak (relative) decides nothing


@dataclass(frozen=True)
class Choice:
    """One reference's figures: of each metric the worst of the payloads that all references have run."""

    reference: str
    values: dict[str, float]
    judged: MetricSet = field(default_factory=lambda: set_with(()))

    @property
    def peak(self) -> float:
        """The largest input."""
        return self.values[self.judged.peak]

    def beats(self, other: Choice) -> bool:
        """As quick and as low in peak, and one of the two by more than what decides nothing."""
        time, peak = other.values[TIME] - self.values[TIME], 1.0 - self.peak / other.peak
        return time > -SAME_TIME_S and peak > -SAME_PEAK and (time > SAME_TIME_S or peak > SAME_PEAK)


def choices(rows: Sequence[Row]) -> list[Choice]:
    """A choice a reference, in the order of the rows; none where values are swept or drawn, or no payload is common."""
    if any(row.assigned for row in rows):
        return []
    good = [row for row in rows if row.ok]
    kinds = list(dict.fromkeys(row.reference for row in good))
    loads = [{row.payload_kg for row in good if row.reference == kind} for kind in kinds]
    common = set.intersection(*loads) if loads else set()
    judged = metrics_of(rows)
    names = dict.fromkeys([TIME, judged.peak, *(metric.name for metric in shown_in(View.DECISION, judged))])
    fair = [row for row in good if row.payload_kg in common]
    of_kind = {kind: [row for row in fair if row.reference == kind] for kind in kinds}
    return [
        Choice(kind, {n: _worst(own, judged.by_name[n]) for n in names}, judged) for kind, own in of_kind.items() if own
    ]


def _worst(rows: Sequence[Row], metric: Metric) -> float:
    return float(metric.worst([row.get(metric.name) for row in rows]))


def decision_table(rows: Sequence[Row]) -> Table | None:
    """A row a reference, the best of each column marked; None where there is nothing to choose."""
    compared = choices(rows)
    if len(compared) < 2:
        return None
    metrics = [
        m
        for m in shown_in(View.DECISION, metrics_of(rows))
        if all(c.values[m.name] == c.values[m.name] for c in compared)
    ]
    best = {m.name: _best(m, [c.values[m.name] for c in compared]) for m in metrics}
    lines = [[c.reference, *(_cell(m, c.values[m.name], best[m.name]) for m in metrics)] for c in compared]
    worst = "The worst of the payloads; " if metrics_of(rows).payload else ""
    note = f"{worst}{BEST}: the best of the column. {metric_note(metrics)}"
    return Table([words("reference"), *metric_heads(metrics)], lines, note)


def _best(metric: Metric, values: Sequence[float]) -> float:
    return min(values, key=abs) if metric.better == "zero" else -metric.worst([-value for value in values])


def _cell(metric: Metric, value: float, best: float) -> str:
    text = metric.text(value)
    return f"{BEST} {text}" if text == metric.text(best) else text


def verdict(rows: Sequence[Row], beside: Sequence[Row] = ()) -> str | None:
    """One sentence: which reference to take, by move time and torque peak; None where there is nothing to choose.

    beside: runs of the same motion at the heaviest payload under other limits; where one of them is quicker and
    lower than what would be chosen, the sentence says so, as the front of those runs does.
    """
    compared = choices(rows)
    if len(compared) < 2:
        return None
    front = sorted((c for c in compared if not any(o.beats(c) for o in compared)), key=lambda c: c.values[TIME])
    beaten, judged = [c for c in compared if c not in front], compared[0].judged
    quickest, lowest = front[0], min(front, key=lambda c: c.peak)
    if quickest.values[TIME] >= lowest.values[TIME] - SAME_TIME_S:
        what = f"its {judged.input_words} peak of {_peak(lowest)}"
        said = f"Take {name_of(lowest)}: none is quicker, and {what} is the lowest"
    else:
        longer = lowest.values[TIME] - quickest.values[TIME]
        more = f"{longer:{_seconds(quickest)}} s more"
        less = 100.0 * (1.0 - lowest.peak / quickest.peak)
        said = (
            f"Take {name_of(quickest)} where time counts ({_time(quickest)} s, peak {_peak(quickest)}), "
            f"{name_of(lowest)} where the peak does: {less:.1f} % less ({_peak(lowest)}) for {more}"
        )
    if beaten:
        names = " and ".join(filter(None, [", ".join(name_of(c) for c in beaten[:-1]), name_of(beaten[-1])]))
        said += f"; {names} {'is' if len(beaten) == 1 else 'are'} neither quicker nor lower"
    better = _better_beside([quickest, lowest], rows, beside)
    return f"{said}{better}."


def _better_beside(taken: Sequence[Choice], rows: Sequence[Row], beside: Sequence[Row]) -> str:
    """That other limits beat what is taken, at the payload of the runs beside."""
    said = []
    for choice in {c.reference: c for c in taken}.values():
        own = [r for r in rows if r.ok and r.reference == choice.reference]
        rivals = []
        for row in beside:
            same = [r for r in own if r.payload_kg == row.payload_kg]
            if row.ok and same and _values(row).beats(_values(same[0])):
                rivals.append((row, same[0]))
        if not rivals:
            continue
        row, mine = min(rivals, key=lambda pair: pair[0][choice.judged.peak])
        of, unit = choice.judged.peak, choice.judged.input_unit
        where = f"at {row.payload_kg:g} kg " if choice.judged.payload else ""
        other = "" if row.reference == choice.reference else f" than {name_of(choice)}"
        quicker, lower = mine[TIME] - row[TIME], mine[of] - row[of]
        time = f"{quicker:{_seconds(choice)}} s quicker" if quicker > SAME_TIME_S else "as quick"
        peak = f"{_lower(lower)} {unit} lower" if lower > SAME_PEAK * mine[of] else "as low"
        what = f"{name_of(_values(row))} would do better{other} at {set_in(row)}"
        said.append(f"; {where}{what}: {time}, {peak}")
    return "".join(said)


def _lower(by: float) -> str:
    """Whole newtons or newton metres; two digits where that would say little."""
    return f"{by:.0f}" if by >= 10.0 else f"{by:.2g}"


def _values(row: Row) -> Choice:
    judged = metrics_of([row])
    return Choice(row.reference, {TIME: row[TIME], judged.peak: row[judged.peak]}, judged)


def name_of(choice: Choice) -> str:
    """As a sentence calls the reference."""
    return words_of(choice.reference)


def _peak(choice: Choice) -> str:
    return f"{choice.judged.by_name[choice.judged.peak].text(choice.peak)} {choice.judged.input_unit}"


def _time(choice: Choice) -> str:
    return f"{choice.values[TIME]:{_seconds(choice)}}"


def _seconds(choice: Choice) -> str:
    """Tenths for a hoist; an axis' moves are short."""
    return ".1f" if choice.judged.payload else ".3g"


DEAR = 1.5  # times the best of the references: a figure that is worth a word


def price_sentence(rows: Sequence[Row]) -> str | None:
    """The figures in which the reference of the lowest peak is far from the best; None where it is dear in none."""
    compared = choices(rows)
    if len(compared) < 2:
        return None
    lowest = min(compared, key=lambda choice: choice.peak)
    dear = []
    for metric in shown_in(View.DECISION, lowest.judged):
        values = [choice.values[metric.name] for choice in compared]
        own, best = lowest.values[metric.name], min(values)
        if metric.name not in (lowest.judged.peak, TIME) and metric.better == "lower" and 0.0 < DEAR * best < own:
            dear.append(f"{metric.label} {metric.text(own)} {metric.shown_unit} against {metric.text(best)}")
    if not dear:
        return None
    name = name_of(lowest)
    return f"The lowest peak, by {name}, has its price: {', '.join(dear)}."


def answer(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> list[str]:
    """Which reference to take, what is at its bound, how far that hangs on the damping assumed, how far the references
    are from the best, then what the rows say. simulate: the damping's sentence may take two more runs."""
    first = verdict(rows), alarm(utilisation(rows, study.machine)), on_another_damping(study) if simulate else None
    said = [*(s for s in first if s), *from_the_bound(study)]
    return [*said, *sentences(rows, peak_limit(study.machine))]
