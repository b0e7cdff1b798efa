"""Campaigns, runs, simulated motions and imported logs as tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.names import unit_of, words_of
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
from workbench.view.style import BLUE, line
from workbench.view.words import figures


def run_figure(run: Run) -> Any:
    """The run's signals over time, a panel a signal."""
    labels = [metric_label(name) for name in run.signals]
    panels = Panels(run.name, [f"{x.words}<br>({x.unit})" if x.unit else x.words for x in labels])
    for row, (name, label) in enumerate(zip(run.signals, labels, strict=True)):
        panels.line(row, 0, run.time_s, run[name], label.words, line("measured", width=1.4), label.unit)
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


CAMPAIGN = View(
    {"runs": _runs},
    {"input": lambda campaign: input_profiles(campaign.machine, campaign.runs)},
    _run_columns,
    index="run",
)


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
