"""Diagnose the gap between a campaign and its machine, and how the diagnosis is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from workbench.consequences import consequences_table
from workbench.core.errors import InputError
from workbench.core.shown import View
from workbench.core.table import Table, words
from workbench.diagnose.records import Diagnosis
from workbench.reports.diagnosis import hypotheses, tables
from workbench.reports.diagnosis.page import sections_of


def _consequences(d: Diagnosis) -> Table:
    if d.consequences is None:
        return Table([words("control study")], [[d.why_no_consequences]])
    return consequences_table(d.consequences)


def _figure(section: str, number: int = 0) -> Callable[[Diagnosis], Any]:
    def figure(d: Diagnosis) -> Any:
        drawn = sections_of(d)[section].figures
        if not drawn:
            raise InputError(f"this diagnosis has nothing to draw there; its verdict is '{d.verdict.word}'")
        return drawn[number][0]

    return figure


def _columns(d: Diagnosis) -> Mapping[str, Sequence[Any]]:
    """The ranking: one row a hypothesis, the likeliest first; probabilities sum to 1."""
    rows = sorted(d.verdict.ranking, key=lambda row: -row.probability)
    return {
        "verdict": [row.verdict for row in rows],
        "effects": [" + ".join(row.effects) for row in rows],
        "probability": [row.probability for row in rows],
    }


VIEW = View(
    {
        "candidates": lambda d: replace(hypotheses.candidates_table(d, brief=True), note=d.verdict.sentence),
        "parameters": hypotheses.parameters_table,
        "gap": tables.gap_table,
        "where": tables.where_table,
        "shrink": tables.shrink_table,
        "condition": tables.condition_table,
        "visible": tables.visible_table,
        "consequences": _consequences,
    },
    {
        "ranking": _figure("verdict"),
        "where": _figure("where"),
        "profiles": _figure("where", 1),
        "isolability": _figure("isolability"),
        "shrink": _figure("shrink"),
        "consequences": _figure("consequences"),
    },
    _columns,
)
