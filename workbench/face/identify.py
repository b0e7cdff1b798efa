"""Identify a campaign's machine; the view of an identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.shown import View
from workbench.core.table import Table
from workbench.figures.identify import correlation_matrix
from workbench.identify.identify import Identification
from workbench.reports.identify import page, report
from workbench.reports.replay import page as replay_page


def _parameters(i: Identification) -> Table:
    return report.table(i.fit)


def _columns(i: Identification) -> Mapping[str, Sequence[Any]]:
    return {
        "parameter": [free.key for free in i.fit.free],
        "nominal": [free.nominal for free in i.fit.free],
        "value": list(i.fit.value),
        "std_error": list(i.fit.std_error),
        "held_by_tolerance": [free.prior_std is not None for free in i.fit.free],
    }


VIEW = View(
    {
        "parameters": _parameters,
        "replay": report.measures_table,
    },
    {
        "friction": page.friction,
        "speed": lambda i: replay_page.speeds(i.machine, i.after),
        "residual": lambda i: replay_page.residuals(i.machine, i.after, i.before),
        "correlation": lambda i: correlation_matrix([free.key for free in i.fit.free], i.fit.correlation),
    },
    _columns,
    index="parameter",
)
