"""A sizing as people and programs read it: what to take, why not smaller, each check, what S1 torque remains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from workbench.core.table import Column, Table, table_of, words
from workbench.core.templates import Sentences
from workbench.study.size import Candidate, Sizing, largest_torque_nm, rated_current, s1_share

MOST_SMALLER = 8
SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.2)  # of nominal


def sentences(sizing: Sizing) -> list[str]:
    """What to take and its closest limit; the next smaller one and what limits it; what had to be estimated."""
    tried = [candidate for candidate in sizing.candidates if candidate.ran]
    nearest = min(tried, key=lambda c: c.limiting.used if c.limiting else 0.0, default=None)
    failed = next((candidate.reason for candidate in sizing.candidates if candidate.reason), "")
    return said.each("sizing", sizing, nearest, failed)


def why_not(candidate: Candidate) -> str:
    """What limits a drive that does not pass, the worst first."""
    broken = sorted((check for check in candidate.checks if not check.ok), key=lambda check: -check.used)
    return candidate.reason or "; ".join(map(said.figure, broken))


said = Sentences("view/size_words.j2", why_not=why_not)


def checks_table(candidate: Candidate) -> Table:
    """Each check of a drive; a dash where the file states no bound."""
    lines = []
    for check in candidate.checks:
        bound = "–" if check.given is None else f"{'at least ' if check.at_least else ''}{check.given:.4g}"
        used = "–" if check.given is None else f"{100.0 * check.used:.0f}"
        lines.append([check.name, f"{check.asked:.4g}", bound, check.unit, used])
    columns = [words("check"), Column("asked"), Column("given"), words("unit"), Column("used", "%")]
    return Table(columns, lines, said.checks(candidate))


def candidates_table(sizing: Sizing) -> Table:
    """The drive taken, then those of less power with what limits each, the largest first."""
    cells: dict[Column, Callable[[Candidate], str]] = {
        words("drive"): lambda c: f"{c.count} × {c.motor.name}",
        Column("power", "kW"): lambda c: f"{c.power_kw:g}",
        Column("ratio"): lambda c: f"{c.ratio:g}",
        words("does not pass for"): lambda c: "passes" if c.passes else why_not(c).split("; ")[0],
    }
    more = len(sizing.smaller) - MOST_SMALLER
    note = f"{more} smaller ones do not pass either." if more > 0 else ""
    taken = [sizing.taken] if sizing.taken is not None else []
    return table_of([*taken, *sizing.smaller[:MOST_SMALLER]], cells, note)


def s1_table(sizing: Sizing) -> Table:
    """Of the motor taken: torque without end and for a short time over speed, with its current."""
    candidate = sizing.taken or sizing.candidates[-1]
    motor, inverter = candidate.motor, sizing.file.inverter
    rated, field = rated_current(motor, inverter)
    share = s1_share(np.array(SPEEDS) * motor.speed_rad_s, motor.speed_rad_s, sizing.file.thermal)
    short = largest_torque_nm(motor, sizing.study)
    lines = [
        [f"{x:.0f}" for x in (100.0 * at, at * motor.speed_rpm, motor.torque_nm * k, short / max(at, 1.0))]
        for at, k in zip(SPEEDS, share, strict=True)
    ]
    note = f"{motor.name}: rated current {rated:.0f} A, of which magnetising {field:.0f} A."
    heads = [Column("speed", "%"), Column("speed", "rpm"), Column("S1 torque", "N m"), Column("short-time", "N m")]
    return Table(heads, lines, note)


def as_json(sizing: Sizing) -> dict[str, Any]:
    """All drives with their checks; null where there is no bound."""

    def one(candidate: Candidate) -> dict[str, Any]:
        return {
            "motor": candidate.motor.name, "power_kw": candidate.motor.power_kw, "count": candidate.count,
            "ratio": candidate.ratio, "passes": candidate.passes, "reason": candidate.reason or why_not(candidate),
            "checks": [vars(check) | {"used": check.used} for check in candidate.checks],
        }  # fmt: skip

    return {
        "format": 1,
        "size": sizing.file.name,
        "sentences": sentences(sizing),
        "taken": None if sizing.taken is None else one(sizing.taken),
        "candidates": [one(candidate) for candidate in sizing.candidates],
    }
