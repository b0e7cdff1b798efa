"""Many runs in few lines: quantiles of each payload and reference, and the runs at the ends."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from workbench.study.results.row import Row
from workbench.study.variations.varying import Axis, said

QUANTILES = (0.05, 0.5, 0.95)
HEAD = (
    "payload\nkg",
    " reference",
    "runs\n",
    " \n",
    "peak\nN m",
    "peak\n%",
    "RMS\nN m",
    "error max\nrad/s",
    "min wire\nkN",
    "swing\nkN",
    "moves\ns",
)
CAPTION = (
    "Of each payload and reference the smallest value, the 5 %, 50 % and 95 % quantiles and the largest value of each "
    "column for itself. Peak and RMS: torque of one motor; error: motor speed against its set point; swing: of the "
    "wire's tension; moves: time in motion."
)
_COLUMNS = (
    ("peak_torque_motor_nm", 1.0, ".0f"),
    ("peak_torque_percent", 1.0, ".0f"),
    ("rms_torque_motor_nm", 1.0, ".0f"),
    ("speed_error_max_rad_s", 1.0, ".1f"),
    ("min_wire_tension_n", 1e-3, ".1f"),
    ("wire_tension_swing_n", 1e-3, ".1f"),
    ("move_time_s", 1.0, ".2f"),
)
EXTREMES = (
    ("highest torque peak", "peak_torque_motor_nm", 1),
    ("lowest torque peak", "peak_torque_motor_nm", -1),
    ("largest speed error", "speed_error_max_rad_s", 1),
    ("smallest wire tension", "min_wire_tension_n", -1),
    ("shortest moves", "move_time_s", -1),
    ("longest moves", "move_time_s", 1),
)
WIDEST = 42  # of a run in words; longer ones take two lines
EXTREMES_HEAD = (" run with the", " which", "peak\nN m", "error max\nrad/s", "min wire\nkN", "moves\ns")


_SHARES = (0.0, *QUANTILES, 1.0)
_NAMES = ("least", "5 %", "median", "95 %", "most")


def value(row: Row, metric: str) -> float:
    """A metric, NaN where the run has none; results of an older version have fewer."""
    return row[metric] if metric in row.metrics else float("nan")


def number_text(number: float, form: str) -> str:
    text = f"{number:{form}}" if np.isfinite(number) else "–"
    return text.removeprefix("-") if not text.strip("-0.") else text  # no minus before nothing


def quantile_table(rows: Sequence[Row]) -> list[list[str]]:
    """Under HEAD, five lines for each payload and reference; of failed runs their number only."""
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    lines = []
    for (payload, reference), members in groups.items():
        good = [row for row in members if row.ok]
        failed = len(members) - len(good)
        number = f"{len(good)}" if not failed else f"{len(good)} + {failed} failed"
        if not good:
            lines.append([f"{payload:g}", reference, number, "", *("–" for _ in _COLUMNS)])
            continue
        for k, (name, share) in enumerate(zip(_NAMES, _SHARES, strict=True)):
            start = [f"{payload:g}", reference, number] if k == 0 else ["", "", ""]
            cells = [
                number_text(scale * float(np.quantile([value(row, metric) for row in good], share)), form)
                for metric, scale, form in _COLUMNS
            ]
            lines.append([*start, name, *cells])
    return lines


def extremes(rows: Sequence[Row], axes: Sequence[Axis]) -> list[list[str]]:
    """Under EXTREMES_HEAD: the runs at the ends of what matters; where all runs are alike no line."""
    good = [row for row in rows if row.ok]
    lines = []
    for name, metric, sign in EXTREMES:
        if not good or np.ptp([row[metric] for row in good]) <= 1e-9 * abs(good[0][metric]):
            continue
        row = max(good, key=lambda each: sign * each[metric])
        figures = (
            (row["peak_torque_motor_nm"], ".0f"),
            (row["speed_error_max_rad_s"], ".1f"),
            (row["min_wire_tension_n"] / 1000.0, ".1f"),
            (row["move_time_s"], ".2f"),
        )
        which = textwrap.fill(said(row, axes), WIDEST)
        lines.append([name, which, *(number_text(number, form) for number, form in figures)])
    return lines
