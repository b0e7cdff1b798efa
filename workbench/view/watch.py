"""A watch as people see it: the answer, the page with alarms, trends and events, the table of a fleet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from workbench.core.names import unit_of, words_of
from workbench.core.run import Array
from workbench.core.table import Column, Table, table_of, words
from workbench.core.whole_folder import whole_file
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels
from workbench.view.style import BLUE, GREY, VERMILLION, Figure
from workbench.watch.fleet import STATES, Row, by_state
from workbench.watch.judge import Cause, Judge
from workbench.watch.watch import Watch

MOST_EVENTS = 50
MEAN_OF = 20  # cycles


def answer(watch: Watch) -> str:
    """What is to be known first."""
    alarms, judge = watch.alarms, watch.judge
    if judge.baseline is None:
        counted = f"the baseline takes {watch.rules.healthy} that count, {len(judge.counted)} do"
        return f"{len(judge.cycles)} cycles; {counted}."
    if not alarms:
        return f"{len(judge.cycles)} cycles, no alarm: the machine is the one that was identified."
    more = f" {len(alarms) - 1} earlier alarm{'s' if len(alarms) > 2 else ''}." if len(alarms) > 1 else ""
    return f"Alarm {watch.told(alarms[-1]).sentence}{more}"


def write_page(watch: Watch, path: Path) -> None:
    """Replaces the page as a whole."""
    judge, cycles = watch.judge, watch.judge.cycles
    sections = [Section("Alarms", tables=[alarm_table(watch)])] if watch.alarms else []
    if cycles:
        rate = f"one false alarm in {watch.rules.cycles_between:g} cycles of a healthy machine, by simulation"
        dots = "Dots: one cycle's estimate, held by the machine's tolerances. Upright lines: alarms."
        threshold = f"The threshold gives {rate}; after an alarm the test begins anew."
        figures = [(parameters(judge, watch.rules.healthy), dots), (statistic(judge), threshold)]
        sections.append(Section("Trends", figures=figures))
    events = [f"{cycles[e.cycle].name}: {e.text}" for judged in judge.results for e in judged.events]
    points = [*events[-MOST_EVENTS:], *(f"not counted: {reason}" for reason in watch.store.refused()[-MOST_EVENTS:])]
    if points:
        sections.append(Section("Events that are not the machine, and logs that do not count", points=points))
    with whole_file(path) as part:
        save_page(sections, part, f"Watch of {watch.machine.name}", answer(watch))


def _change(cause: Cause) -> str:
    return f"{cause.name} {cause.amount:+.3g} {unit_of(cause.keys[0])}"


def alarm_table(watch: Watch) -> Table:
    columns = [
        words("at"), Column("cycle"), Column("since"), words("likeliest change"), Column("share of it", "%"),
        Column("cycles to\nthe limit"), words("diagnosis"),
    ]  # fmt: skip
    rows = []
    for told in map(watch.told, watch.alarms):
        left = "–" if told.cycles_left is None else f"{told.cycles_left:.0f}"
        if told.cycles_left is not None and told.cycles_left_ci95 is not None:
            left += " ({:.0f} to {:.0f})".format(*told.cycles_left_ci95)
        said = "not asked" if told.diagnosis is None else str(told.diagnosis["sentence"])
        cause = told.causes[0]
        share = f"{100.0 * cause.share:.0f}"
        rows.append([told.name, str(told.cycle), str(told.onset), _change(cause), share, left, said])
    repeated = sum(alarm.again for alarm in watch.judge.alarms)
    return Table(columns, rows, f"The test alarmed again {repeated} times for the same change." if repeated else "")


def fleet_table(rows: Sequence[Row]) -> Table:
    """The machines by state, the worst first."""
    cells: dict[Column, Callable[[Row], str]] = {
        words("machine"): lambda row: row.machine,
        words("state"): lambda row: row.state,
        Column("cycles"): lambda row: str(row.cycles),
        Column("alarms"): lambda row: str(row.alarms),
        words("since"): lambda row: row.since,
        words("likeliest change"): lambda row: (
            "" if row.amount is None else f"{row.cause} {row.amount:+.3g} {row.unit}"
        ),
        Column("cycles to\nthe limit"): lambda row: "–" if row.cycles_left is None else f"{row.cycles_left:.0f}",
        words("trouble"): lambda row: row.trouble,
    }
    counts = (f"{sum(row.state == state for row in rows)} {state}" for state in STATES)
    return table_of(by_state(rows), cells, f"{len(rows)} machine{'s' if len(rows) != 1 else ''}: {', '.join(counts)}.")


def parameters(judge: Judge, healthy: int) -> Figure:
    """Each parameter over the cycles, with the mean of the last ones and of the first `healthy` that count."""
    keys = judge.cycles[0].estimate.keys
    values: Array = np.array([cycle.estimate.values for cycle in judge.cycles])
    heads = [f"{words_of(key)} ({unit_of(key)})" if unit_of(key) else words_of(key) for key in keys]
    panels = Panels("Estimates, cycle by cycle", heads, x_title="cycle")
    x = np.arange(len(values), dtype=float)
    counts = np.array([judged.counted for judged in judge.results])
    learned = healthy if judge.baseline is not None else len(values)
    for i, unit in enumerate(map(unit_of, keys)):
        for chosen, name, symbol in ((counts, "one cycle", "circle"), (~counts, "does not count", "circle-open")):
            if chosen.any():
                dots = {"size": 4, "color": GREY, "symbol": symbol}
                series = x[chosen], values[chosen, i]
                panels.line(i, 0, *series, name, {"color": GREY}, unit, mode="markers", marker=dots)
        of = values[counts, i]
        if len(of) > MEAN_OF:
            mean = np.convolve(of, np.full(MEAN_OF, 1.0 / MEAN_OF), "valid")
            look = {"color": BLUE, "width": 1.8}
            panels.line(i, 0, x[counts][MEAN_OF - 1 :], mean, f"mean of {MEAN_OF}", look, unit)
        if len(of):
            panels.level(i, 0, float(np.mean(of[: max(1, learned)])), "baseline" if i == 0 else "")
        _mark(panels, i, judge)
    return panels.figure(190 * len(keys) + 120)


def statistic(judge: Judge) -> Figure:
    """The test's statistic, zero where a cycle did not count, and its threshold."""
    panels = Panels("Test of a change", ["log likelihood ratio"], x_title="cycle")
    values: Array = np.array([judged.statistic for judged in judge.results])
    panels.line(0, 0, np.arange(len(values), dtype=float), values, "statistic", {"color": BLUE, "width": 1.6})
    if judge.limit is not None:
        panels.level(0, 0, judge.limit, "alarm above")
    _mark(panels, 0, judge)
    return panels.figure(380)


def _mark(panels: Panels, row: int, judge: Judge) -> None:
    for alarm in judge.alarms:
        if not alarm.again:
            panels.shade(row, 0, alarm.cycle, alarm.cycle, VERMILLION, edge=1.2)
