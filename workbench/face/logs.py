"""Read measured runs of a campaign; the views of campaigns and runs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.run import Run
from workbench.core.table import Column, Table, words
from workbench.effects import check
from workbench.face.view import View
from workbench.figures.panels import Panels
from workbench.figures.replay import input_profiles
from workbench.logs import Campaign
from workbench.logs import read_campaign as read
from workbench.machines import Axis, Hoist, plant_of
from workbench.study.labels import metric_label
from workbench.view.numbers import figures
from workbench.view.style import line
from workbench.view.words import words_of

PathLike = str | os.PathLike[str]


def read_campaign(path: PathLike, *, runs: Sequence[str] | str | None = None) -> Campaign:
    """Read a campaign: a folder with machine.yaml, runs.yaml and logs.

    runs: names of the runs to read, all without it. InputError with file and place for what is wrong with the files.
    """
    return read(path, select=runs, check_effects=check)


def campaign_of(campaign: Campaign | PathLike, machine: Hoist | Axis | None = None) -> Campaign:
    """The campaign, read where a path is given; `machine` in place of its own. InputError for another kind of one."""
    campaign = campaign if isinstance(campaign, Campaign) else read_campaign(campaign)
    if machine is None:
        return campaign
    if type(machine) is not type(campaign.machine):
        kinds = type(machine).__name__, type(campaign.machine).__name__
        raise InputError(f"is a {kinds[0]}, expected a {kinds[1]} such as the campaign's", place="machine")
    return replace(campaign, machine=machine)


def run_figure(run: Run, signals: Sequence[str] | None = None) -> Any:
    """The run's signals over time, a panel a signal. InputError for a signal that the run does not have."""
    for name in signals or ():
        if name not in run:
            raise InputError(f"no signal '{name}'; {nearest(name, run.signals)}")
    names = list(run.signals if signals is None else signals)
    labels = [metric_label(name) for name in names]
    panels = Panels(run.name, [f"{x.words}<br>({x.unit})" if x.unit else x.words for x in labels])
    for row, (name, label) in enumerate(zip(names, labels, strict=True)):
        panels.line(row, 0, run.time_s, run[name], label.words, line("measured", width=1.4), label.unit)
    figure = panels.figure(140 + 130 * len(names))
    return figure.update_layout(showlegend=False)


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

_RUN_COLUMNS = (
    words("run"), Column("payload", "kg"), Column("length", "s"), Column("samples"), Column("step", "ms"),
    words("signals"),
)  # fmt: skip


def _runs(campaign: Campaign) -> Table:
    rows = [
        [
            run.name, f"{run.payload_kg:g}", f"{run.duration_s:.1f}", str(len(run.time_s)),
            figures(1000.0 * run.sample_time_s), ", ".join(run.signals),
        ]
        for run in campaign.runs
    ]  # fmt: skip
    return Table(_RUN_COLUMNS, rows, "; ".join(campaign.all_notes))


def _run_columns(campaign: Campaign) -> Mapping[str, Sequence[Any]]:
    runs = campaign.runs
    return {
        "run": [run.name for run in runs],
        "payload_kg": [run.payload_kg for run in runs],
        "start_position_m": [run.start_position_m for run in runs],
        "start_time_s": [run.start_time_s for run in runs],
        "duration_s": [run.duration_s for run in runs],
        "samples": [len(run.time_s) for run in runs],
        "sample_time_s": [run.sample_time_s for run in runs],
    }


def _inputs(campaign: Campaign) -> Any:
    machine = campaign.machine
    return input_profiles(campaign.runs, plant_of(machine).input, words_of(machine).unit)


CAMPAIGN = View({"runs": _runs}, {"input": _inputs}, _run_columns, index="run")
