"""The page of a watch: what it says now, its alarms, events and trends; replaced as a whole."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workbench.core.names import unit_of, words_of
from workbench.core.table import Column, Table
from workbench.core.table import words as word_column
from workbench.figures.watch import parameters, statistic
from workbench.view.page import Section, save_page
from workbench.watch.fleet import STATES, Row
from workbench.watch.store import KeptAlarm
from workbench.watch.watch import Told, Watch

MOST_EVENTS = 50


def answer(watch: Watch) -> str:
    """What is to be known first."""
    alarms = [alarm for alarm in watch.store.alarms() if not alarm.again]
    count = len(watch.judge.cycles)
    if watch.judge.baseline is None:
        return f"{count} cycles; the baseline takes {watch.rules.healthy} that count, {len(watch.judge.counted)} do."
    if not alarms:
        return f"{count} cycles, no alarm: the machine is the one that was identified."
    told = watch.told(alarms[-1])
    more = f" {len(alarms) - 1} earlier alarm{'s' if len(alarms) > 2 else ''}." if len(alarms) > 1 else ""
    return f"Alarm {told.sentence}{more}"


def write_page(watch: Watch, path: Path) -> None:
    """Replaces the page."""
    judge, kept = watch.judge, watch.store.cycles()
    alarms = watch.store.alarms()
    first = [alarm for alarm in alarms if not alarm.again]
    sections = [Section("Alarms", tables=[alarm_table([watch.told(a) for a in first], alarms)])] if first else []
    if kept:
        keys = kept[0].cycle.estimate.keys
        values = np.array([k.cycle.estimate.values for k in kept])
        names = [(words_of(key), unit_of(key)) for key in keys]
        marks = [alarm.cycle for alarm in first]
        learned = watch.rules.healthy if judge.baseline is not None else len(kept)
        over_time = np.array([k.statistic for k in kept])
        sections.append(
            Section(
                "Trends",
                figures=[
                    (parameters(names, values, learned, marks, [k.counted for k in kept]),
                     "Dots: one cycle's estimate, held by the machine's tolerances. Upright lines: alarms."),
                    (statistic(over_time, judge.limit, marks),
                     f"The threshold gives one false alarm in {watch.rules.cycles_between:g} cycles of a healthy "
                     "machine, by simulation; after an alarm the test begins anew."),
                ],
            )
        )  # fmt: skip
    events = watch.store.events()
    refused = watch.store.refused()
    points = [f"{kept[e.cycle].cycle.name}: {e.text}" for e in events[-MOST_EVENTS:]]
    points += [f"not counted: {reason}" for _, reason in refused[-MOST_EVENTS:]]
    if points:
        sections.append(Section("Events that are not the machine, and logs that do not count", points=points))
    hidden = path.with_name(f".{path.name}.part")
    save_page(sections, hidden, f"Watch of {watch.machine.name}", answer(watch))
    os.replace(hidden, path)


def alarm_table(told: Sequence[Told], kept: Sequence[KeptAlarm]) -> Table:
    columns = [
        word_column("at"), Column("cycle"), Column("since"), word_column("likeliest change"),
        Column("share of it", "%"), Column("cycles to\nthe limit"), word_column("diagnosis"),
    ]  # fmt: skip
    rows = []
    for alarm in told:
        cause = alarm.causes[0]
        left = "–" if alarm.cycles_left is None else f"{alarm.cycles_left:.0f}"
        if alarm.cycles_left is not None and alarm.cycles_left_ci95 is not None:
            left += " ({:.0f} to {:.0f})".format(*alarm.cycles_left_ci95)
        said = "not asked" if alarm.diagnosis is None else str(alarm.diagnosis["sentence"])
        rows.append(
            [alarm.name, str(alarm.cycle), str(alarm.onset),
             f"{cause['name']} {cause['amount']:+.3g} {unit_of(cause['keys'][0])}",
             f"{100.0 * cause['share']:.0f}", left, said]
        )  # fmt: skip
    repeated = sum(alarm.again for alarm in kept)
    note = f"The test alarmed again {repeated} times for the same change." if repeated else ""
    return Table(columns, rows, note)


def fleet_table(rows: Sequence[Row]) -> Table:
    """The machines by state, the worst first."""
    columns = [
        word_column("machine"), word_column("state"), Column("cycles"), Column("alarms"), word_column("since"),
        word_column("likeliest change"), Column("cycles to\nthe limit"), word_column("trouble"),
    ]  # fmt: skip
    made = []
    for row in sorted(rows, key=lambda row: (STATES.index(row.state), row.machine)):
        change = "" if row.amount is None else f"{row.cause} {row.amount:+.3g} {row.unit}"
        left = "–" if row.cycles_left is None else f"{row.cycles_left:.0f}"
        cells = [row.machine, row.state, str(row.cycles), str(row.alarms), row.since, change, left, row.trouble]
        made.append(cells)
    counts = (f"{sum(row.state == state for row in rows)} {state}" for state in STATES)
    return Table(columns, made, f"{len(rows)} machines: {', '.join(counts)}.")
