"""How much of what machine and drive bear a study's runs use: the largest share each, with a light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from workbench.machine import Hoist
from workbench.study.conclude.sentences import ASTRAY_M, SWINGS_PER_S, hunts, swings_per_s
from workbench.study.execute.run import motor_torque_limit_nm
from workbench.study.results.row import Row
from workbench.study.variations.varying import run_in_words, swept_axes
from workbench.tables import Column, Table, words

Light = Literal["green", "amber", "red"]
WIRE_SAFETY = 4.5  # least breaking load over tension of a running rope, mechanism group M5 (ISO 4308-1)
OVERSPEED = 1.2  # of nominal speed, where the field is weakened: a round figure, not cited
AMBER, RED = 85.0, 99.9  # % of what is borne
SIGN = {"green": "●", "amber": "▲", "red": "■"}  # told apart without colour, too


@dataclass(frozen=True)
class Use:
    """percent: of what is borne, in the run that uses most. bound: what that is, in words; where: that run."""

    what: str
    percent: float
    bound: str
    where: str

    @property
    def light(self) -> Light:
        return "red" if self.percent >= RED else "amber" if self.percent > AMBER else "green"


def utilisation(rows: Sequence[Row], machine: Hoist) -> list[Use]:
    """Torque peak, rms torque, overload, speed, wire, place of the stop; those that the runs know."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    limit, nominal, drive = motor_torque_limit_nm(machine), machine.motor.nominal_torque_nm, machine.drive
    overspeed = OVERSPEED if drive.field_weakening else 1.0
    fastest = f"{overspeed:g} times nominal speed, {overspeed * machine.motor.nominal_speed_rad_s:.4g} rad/s"
    shares = (
        ("torque peak", "peak_torque_motor_nm", 100.0 / limit, f"the limit of {limit:.0f} N m per motor"),
        ("rms torque", "rms_torque_motor_nm", 100.0 / nominal, f"nominal torque, {nominal:g} N m, without end"),
        ("overload", "overload_use_percent", 1.0, f"{100 * drive.overload:.0f} % for {drive.overload_time_s:g} s"),
        ("motor speed", "peak_speed_percent", 1.0 / overspeed, fastest),
        ("place of the stop", "position_error_end_m", 100.0 / ASTRAY_M, f"{1000 * ASTRAY_M:g} mm from the reference"),
    )
    uses = []
    for what, name, scale, bound in shares:
        known = [row for row in good if row.metrics.get(name) is not None]
        if known:
            worst = max(known, key=lambda row: abs(row[name]))
            uses.append(Use(what, scale * abs(worst[name]), bound, run_in_words(worst, axes)))
    if hunting := [row for row in good if hunts(row)]:
        worst = max(hunting, key=swings_per_s)
        bound = f"{SWINGS_PER_S:g} a second of motion, each by more than nominal torque: the loop hunts"
        uses.append(Use("torque swings", 100.0 * swings_per_s(worst) / SWINGS_PER_S, bound, run_in_words(worst, axes)))
    factors = [row for row in good if (row.metrics.get("wire_safety_factor") or 0.0) > 0.0]
    if factors:
        worst = min(factors, key=lambda row: row["wire_safety_factor"])
        bound = f"a safety factor of {WIRE_SAFETY:g} (ISO 4308-1, M5)"
        uses.append(Use("wire", 100.0 * WIRE_SAFETY / worst["wire_safety_factor"], bound, run_in_words(worst, axes)))
    return uses


def utilisation_table(uses: Sequence[Use]) -> Table:
    """A line each, with its light."""
    lines = [[f"{SIGN[use.light]} {use.light}", use.what, f"{use.percent:.0f}", use.bound, use.where] for use in uses]
    note = f"Green up to {AMBER:g} % of what is borne, amber above, red where it is reached; the run that uses most."
    return Table([words("light"), words("utilisation"), Column("used", "%"), words("of"), words("in")], lines, note)


def alarm(uses: Sequence[Use]) -> str | None:
    """One sentence on what is at or beyond its bound; None where nothing is."""
    over = [f"{use.what} {use.percent:.0f} % of {use.bound} ({use.where})" for use in uses if use.light == "red"]
    return f"Overload: {'; '.join(over)}." if over else None
