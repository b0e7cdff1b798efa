"""Campaigns, runs, simulated motions and imported logs as tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from workbench.core.names import unit_of, words_of
from workbench.core.numbers import figures
from workbench.core.run import Array, Run
from workbench.core.shown import View
from workbench.core.table import Column, Table, table_of, words
from workbench.core.whole_folder import whole_file
from workbench.logs import Campaign
from workbench.logs.importing import Proposed
from workbench.simulate.loop import LoopResult
from workbench.study.labels import metric_label
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels
from workbench.view.replay import input_profiles
from workbench.view.study_figures import over_time
from workbench.view.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, Figure, label, line

COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
DASHES = ("solid", "6px,3px", "2px,2px")
# From a unit that a log has to one that is read more easily, with what the values are multiplied by.
SHOWN_IN: Mapping[str, tuple[str, float]] = {"N": ("kN", 1e-3)}
ROW = 150  # px
MOVES_ABOVE = 0.02  # of the largest speed
BEFORE_S, AFTER_S = 0.5, 3.5  # around the start of a move


@dataclass(frozen=True, eq=False)
class Stretch:
    """What is drawn of a run: from start_s to end_s of its time, shown from zero_s on."""

    run: Run
    start_s: float
    end_s: float
    zero_s: float = 0.0

    @classmethod
    def whole(cls, run: Run) -> Stretch:
        return cls(run, float(run.time_s[0]), float(run.time_s[-1]))

    def cut(self, signal: str) -> tuple[Array, Array]:
        """Time (n,) and values (n,) of the stretch, and the samples that its edges lie between."""
        first, last = np.searchsorted(self.run.time_s, (self.start_s, self.end_s))
        inside = slice(max(int(first) - 1, 0), int(last) + 1)
        return self.run.time_s[inside] - self.zero_s, self.run[signal][inside]


def start_of_move(run: Run) -> Stretch | None:
    """From shortly before the first move on, time counted from there; None for a run without a speed, or at rest."""
    name = next((name for name in run.signals if name.startswith("speed_")), None)
    if name is None:
        return None
    speed = np.abs(np.nan_to_num(run[name]))
    moving = speed > MOVES_ABOVE * float(speed.max())
    if not moving.any():
        return None
    start = float(run.time_s[int(np.argmax(moving))])
    return Stretch(run, start - BEFORE_S, start + AFTER_S, start)


def browser(
    stretches: Sequence[Stretch], rows: Sequence[str | Sequence[str]], references: Sequence[str] = ()
) -> Figure:
    """A row for each signal, or for several of one unit; a line for each run that has it. Long runs are thinned; their
    peaks stay.

    references: of each run the reference that it followed, whose name and colour it then has.
    """
    grouped = [[row] if isinstance(row, str) else list(row) for row in rows]
    units = [[SHOWN_IN.get(unit_of(signal), (unit_of(signal), 1.0)) for signal in row] for row in grouped]
    heads = [
        f"{'<br>'.join(map(_words, row))}<br>({', '.join(dict.fromkeys(unit or '–' for unit, _ in own))})"
        for row, own in zip(grouped, units, strict=True)
    ]
    panels = Panels("", heads, one_cursor=True)
    for number, stretch in enumerate(stretches):
        name = label(references[number]) if references else stretch.run.name
        for row, (signals, own) in enumerate(zip(grouped, units, strict=True)):
            for k, (signal, (unit, factor)) in enumerate(zip(signals, own, strict=True)):
                if signal in stretch.run:
                    look = line(references[number], number, 1.5) if references else _look(number, k)
                    time, values = stretch.cut(signal)
                    called = name if k == 0 else f"{name}, {words_of(signal)}"
                    panels.line(row, 0, time, factor * values, called, look, unit)
    return panels.figure(ROW * len(grouped) + 130)


def _look(number: int, signal: int = 0) -> dict[str, Any]:
    dash = DASHES[(number // len(COLOURS) + signal) % len(DASHES)]
    return {"color": COLOURS[number % len(COLOURS)], "width": 1.5, "simplify": False, "dash": dash}


def _words(signal: str) -> str:
    """A signal's name in words, in lines that a row has room for."""
    return "<br>".join(wrap(words_of(signal), 18))


def run_figure(run: Run) -> Any:
    """The run's signals over time, a panel a signal."""
    labels = [metric_label(name) for name in run.signals]
    panels = Panels(run.name, [f"{x.words}<br>({x.unit})" if x.unit else x.words for x in labels])
    for row, (name, of) in enumerate(zip(run.signals, labels, strict=True)):
        panels.line(row, 0, run.time_s, run[name], of.words, line("measured", width=1.4), of.unit)
    return panels.figure(140 + 130 * len(labels)).update_layout(showlegend=False)


def _signals(run: Run) -> Table:
    rows = []
    for name, values in run.signals.items():
        known = values[np.isfinite(values)]
        numbers = (known.min(), known.mean(), known.max()) if len(known) else (np.nan,) * 3
        rows.append([name, *(figures(float(x), 4) for x in numbers)])
    note = f"{len(run.time_s)} samples in {run.duration_s:.1f} s, payload {run.payload_kg:g} kg, from {run.source}."
    return Table([words("signal"), Column("smallest"), Column("mean"), Column("largest")], rows, note)


def _columns(run: Run) -> Mapping[str, Sequence[Any]]:
    return {"time_s": run.time_s, **run.signals}  # type: ignore[dict-item]


RUN = View({"signals": _signals}, {"signals": run_figure}, _columns, index="time_s")


def _loop_metrics(result: LoopResult) -> Table:
    labels = {name: metric_label(name) for name in result.metrics}
    rows = [[labels[name].words, figures(value, 4), labels[name].unit] for name, value in result.metrics.items()]
    note = f"{result.case.name}: {result.outcome.value}."
    return Table([words("metric"), Column("value"), words("unit")], rows, note)


LOOP = View(
    {"metrics": _loop_metrics},
    {
        "overview": lambda r: over_time([(r.case.name, r.run)], r.case.machine, r.case.name),
        "signals": lambda r: run_figure(r.run),
    },
    lambda r: _columns(r.run),
    index="time_s",
)


def _runs(campaign: Campaign) -> Table:
    cells: dict[Column, Callable[[Run], str]] = {
        words("run"): lambda run: run.name,
        Column("payload", "kg"): lambda run: f"{run.payload_kg:g}",
        Column("length", "s"): lambda run: f"{run.duration_s:.1f}",
        Column("samples"): lambda run: str(len(run.time_s)),
        Column("step", "ms"): lambda run: figures(1000.0 * run.sample_time_s),
        words("signals"): lambda run: ", ".join(run.signals),
    }
    return table_of(campaign.runs, cells, "; ".join(campaign.all_notes))


def _run_columns(campaign: Campaign) -> Mapping[str, Sequence[Any]]:
    names = ("payload_kg", "start_position_m", "start_time_s", "duration_s")
    columns = {name: [getattr(run, name) for run in campaign.runs] for name in names}
    samples, steps = ([of(run) for run in campaign.runs] for of in (lambda r: len(r.time_s), lambda r: r.sample_time_s))
    return {"run": [run.name for run in campaign.runs], **columns, "samples": samples, "sample_time_s": steps}


CAMPAIGN = View({"runs": _runs}, {"input": lambda c: input_profiles(c.machine, c.runs)}, _run_columns, index="run")


def mapping_table(proposed: Proposed) -> Table:
    rows, guessed = [], any(p.guessed_unit for p in proposed.proposals)
    for p in proposed.proposals:
        remark = ""
        if p.guessed_unit:
            said = f"its unit '{p.unit}' is not known" if p.unit else "its unit is not said"
            taken = f"by its size {p.by_size}" if p.by_size else "taken as SI"
            remark = f"{said}: {taken}"
        if p.others:
            remark = "; ".join(part for part in (remark, f"also fits: {', '.join(p.others)}") if part)
        rows.append([p.signal, p.column, p.unit or "–", f"{p.factor:.6g}", remark])
    columns = [words("signal"), words("column"), words("unit"), Column("factor\nto SI"), words("remark")]
    return Table(columns, rows, "Where a unit is a guess, name it in the mapping, or a scale." if guessed else "")


def write_page(signals: Sequence[tuple[str, str, Array, Array]], proposed: Proposed, name: str, path: Path) -> None:
    """Replaces the page. InputError where it cannot be written."""
    section = Section(
        sentences=[f"Columns that are no signal: {', '.join(proposed.unused) or 'none'}."],
        tables=[mapping_table(proposed)],
        figures=[(drawn(signals), "Each signal in SI, at its own samples; up, hoisting and forward are positive.")],
    )
    with whole_file(path) as part:
        save_page([section], part, f"Import of {name}")


def drawn(signals: Sequence[tuple[str, str, Array, Array]]) -> Any:
    """signals: (signal, column, time in s, values in SI) of each."""
    panels = Panels("", [f"{words_of(signal)} ({unit_of(signal)})" for signal, _, _, _ in signals])
    for i, (signal, column, time_s, values) in enumerate(signals):
        panels.line(i, 0, time_s, values, f"{signal}: {column}", {"color": BLUE, "width": 1.3})
    return panels.figure(170 * len(signals) + 60).update_layout(showlegend=False, margin={"t": 24})
