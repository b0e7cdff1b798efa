"""Replay a campaign on its machine; the view of a replay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.shown import View
from workbench.core.table import Table
from workbench.reports.replay import page, report
from workbench.simulate.replay import ReplayResult


def _table(r: ReplayResult) -> Table:
    return report.table(r.machine, r)


def columns(r: ReplayResult) -> Mapping[str, Sequence[Any]]:
    """One row a run; residual and noise in the unit of the machine's input, N m or N."""
    return {
        "run": [run.name for run in r.runs],
        "speed_rmse_percent": [run.speed_rmse_percent for run in r.runs],
        "speed_rmse_percent_restarted_2s": [run.speed_rmse_percent_restarted_2s for run in r.runs],
        "residual_rms": [run.residual_rms for run in r.runs],
        "residual_rms_moving": [run.residual_rms_moving for run in r.runs],
        "noise_rms": [run.balance.noise_rms for run in r.runs],
    }


VIEW = View(
    {"runs": _table},
    {
        "speed": lambda r: page.speeds(r.machine, r),
        "residual": lambda r: page.residuals(r.machine, r),
        "input": lambda r: page.inputs(r.machine, r),
    },
    columns,
    index="run",
)
