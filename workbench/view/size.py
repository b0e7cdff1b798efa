"""A sizing as people and programs read it: what to take, why not smaller, each check, what S1 torque remains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from workbench.core.table import Column, Table, table_of, words
from workbench.study.size import Candidate, Check, Sizing, largest_torque_nm, rated_current, s1_share

MOST_SMALLER = 8
SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.2)  # of nominal


def sentences(sizing: Sizing) -> list[str]:
    """What to take and its closest limit; the next smaller one and what limits it; what had to be estimated."""
    taken = sizing.taken
    if taken is None:
        tried = [candidate for candidate in sizing.candidates if candidate.ran]
        if not tried:
            failed = next((candidate.reason for candidate in sizing.candidates if candidate.reason), None)
            why = failed or "none turns fast enough and holds the load"
            return [f"None of {len(sizing.candidates)} drives passes: {why}."]
        nearest = min(tried, key=lambda c: c.limiting.used if c.limiting else 0.0)
        return [f"None of {len(sizing.candidates)} drives passes. Nearest is {drive(nearest)}: {why_not(nearest)}."]
    said = [f"Take {drive(taken)}: the smallest of {len(sizing.candidates)} drives that passes."]
    if taken.limiting is not None:
        said[0] += f" Its closest limit is {figure(taken.limiting)}."
    if sizing.smaller:
        said.append(f"The next smaller, {drive(sizing.smaller[0])}, does not pass: {why_not(sizing.smaller[0])}.")
    if estimated := taken.motor.estimated:
        said.append(f"The catalogue does not state {', '.join(estimated)} of this motor; they are estimates.")
    return said


def drive(candidate: Candidate) -> str:
    motor = candidate.motor
    power = f"{motor.power_kw:g} kW"
    name = motor.name if power in motor.name else f"{motor.name} ({power})"
    return f"{candidate.count} × {name} with gear ratio {candidate.ratio:g}"


def figure(check: Check) -> str:
    """`thermal torque, 412 of 484 N m (85 %)`; of a safety factor `…, 5.8 for at least 4.5`."""
    if check.given is None:
        return f"{check.name}, {check.asked:.4g} {check.unit}".strip()
    if check.at_least:
        return f"{check.name}, {check.asked:.3g} for at least {check.given:g} ({100.0 * check.used:.0f} %)"
    return f"{check.name}, {check.asked:.4g} of {check.given:.4g} {check.unit} ({100.0 * check.used:.0f} %)"


def why_not(candidate: Candidate) -> str:
    """What limits a drive that does not pass, the worst first."""
    broken = sorted((check for check in candidate.checks if not check.ok), key=lambda check: -check.used)
    return candidate.reason or "; ".join(map(figure, broken))


def checks_table(candidate: Candidate) -> Table:
    """Each check of a drive; a dash where the file states no bound."""
    lines = []
    for check in candidate.checks:
        bound = "–" if check.given is None else f"{'at least ' if check.at_least else ''}{check.given:.4g}"
        used = "–" if check.given is None else f"{100.0 * check.used:.0f}"
        lines.append([check.name, f"{check.asked:.4g}", bound, check.unit, used])
    columns = [words("check"), Column("asked"), Column("given"), words("unit"), Column("used", "%")]
    note = (
        f"{drive(candidate)}. A dash: the file states no bound, the figure is what is needed. The brakes at rest and "
        "after STO are reckoned, not simulated."
    )
    return Table(columns, lines, note)


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
