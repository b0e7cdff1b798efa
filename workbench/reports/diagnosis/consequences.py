"""What a machine's effects change in its control study, as a table."""

from __future__ import annotations

from workbench.consequences import Change, Consequences
from workbench.reports.numbers import NOTHING, figures
from workbench.tables import Column, Table, words

COLUMNS = (
    Column("payload", "kg"), words("reference"), Column("peak", "N m"), Column("now", "N m"), Column("peak", "%"),
    Column("error max", "rad/s"), Column("now", "rad/s"), Column("error max", "%"), Column("error rms", "%"),
    Column("min wire", "kN"), Column("now", "kN"), Column("moves", "s"),
)  # fmt: skip
CAPTION = (
    "Each value before and now, with the effects, and its change in %. Peak: torque of the harder-worked motor; error: "
    "motor speed against its set point; min wire: smallest tension. A dash: the run failed."
)


def table(consequences: Consequences) -> Table:
    """A line for each payload and reference."""
    return Table(COLUMNS, [_line(row) for row in consequences.rows], CAPTION)


def _line(row: Change) -> list[str]:
    was, now = row.before, row.after
    return [
        f"{row.payload_kg:g}", row.reference,
        _whole(was.peak_torque_motor_nm), _whole(now.peak_torque_motor_nm), _change(row, "peak_torque_motor_nm"),
        figures(was.speed_error_max_rad_s), figures(now.speed_error_max_rad_s), _change(row, "speed_error_max_rad_s"),
        _change(row, "speed_error_rms_rad_s"),
        figures(was.min_wire_tension_n / 1000.0), figures(now.min_wire_tension_n / 1000.0),
        f"{now.move_time_s:.2f}",
    ]  # fmt: skip


def _whole(value: float) -> str:
    return f"{value:.0f}" if value == value else NOTHING


def _change(row: Change, metric: str) -> str:
    change = row.percent(metric)
    return f"{change:+.1f}" if change == change else NOTHING
