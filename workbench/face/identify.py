"""Identify a campaign's machine; the view of an identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.table import Table
from workbench.face.logs import PathLike, campaign_of
from workbench.face.view import View
from workbench.figures.identify import correlation_matrix
from workbench.identify.identify import Identification
from workbench.identify.identify import identify as fit_machine
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist
from workbench.reports.identify import page, report
from workbench.reports.replay import page as replay_page
from workbench.simulate.lowpass import check_band


def identify(
    campaign: Campaign | PathLike,
    *,
    free: Sequence[str] | None = None,
    machine: Hoist | Axis | None = None,
    band_hz: float | None = None,
    date: str = "",
) -> Identification:
    """Fit friction, masses and inertia of the campaign's machine to its runs.

    free: keys of machine.yaml to fit, the usual ones without it. machine: to start from, in place of the campaign's.
    date: when, for the machine's record. The result's `machine` goes into every other function.
    """
    chosen = campaign_of(campaign, machine)
    if band_hz is not None:
        check_band(band_hz, chosen.runs)
    return fit_machine(chosen, free=free, band_hz=band_hz, date=date)


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
