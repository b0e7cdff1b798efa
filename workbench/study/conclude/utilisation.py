"""How much of what machine and drive bear a study's runs use: the largest share each, with a light."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.metrics import set_of
from workbench.study.conclude.sentences import ASTRAY_M, SWINGS_PER_S, hunts, swings_per_s
from workbench.study.execute.run import peak_limit
from workbench.study.results.row import Row
from workbench.study.variations.varying import SweptAxis, run_in_words, swept_axes
from workbench.tables import Column, Table, words

Light = Literal["green", "amber", "red"]
WIRE_SAFETY = 4.5  # least breaking load over tension of a running rope, mechanism group M5 (ISO 4308-1)
OVERSPEED = (
    1.2  # of nominal speed, where the field is weakened: a drive's own limit (ABB ACS850 firmware manual, 20.01)
)
AMBER, RED = 85.0, 99.9  # % of what is borne
MANY = 1000.0  # % from which on a share is said in times
SIGN = {"green": "●", "amber": "▲", "red": "■"}  # told apart without colour, too


@dataclass(frozen=True)
class Use:
    """percent: of what is borne, in the run that uses most. bound: what that is, in words; where: that run."""

    what: str
    percent: float
    bound: str
    where: str

    @property
    def used(self) -> str:
        """`104 % of`, `176 times`."""
        return f"{self.percent:.0f} % of" if self.percent < MANY else f"{self.percent / 100.0:.0f} times"

    @property
    def light(self) -> Light:
        return "red" if self.percent >= RED else "amber" if self.percent > AMBER else "green"


def utilisation(rows: Sequence[Row], machine: Hoist | Axis) -> list[Use]:
    """Torque peak, rms torque, overload, speed, wire, place of the stop; those that the runs know."""
    good, axes = [row for row in rows if row.ok], swept_axes(rows)
    shares = _SHARES.get(kind_of(machine).name, _axis_shares)(machine)
    uses = []
    for what, name, scale, bound in shares:
        known = [row for row in good if row.metrics.get(name) is not None]
        if known:
            worst = max(known, key=lambda row: abs(row[name]))
            uses.append(Use(what, scale * abs(worst[name]), bound, run_in_words(worst, axes)))
    return [*uses, *_hunting(good, axes), *_wire(good, axes)]


Share = tuple[str, str, float, str]  # what, metric, per cent per unit of it, of what


def _hoist_shares(machine: Any) -> tuple[Share, ...]:
    limit, nominal, drive = peak_limit(machine), machine.motor.nominal_torque_nm, machine.drive
    overspeed = OVERSPEED if drive.field_weakening else 1.0
    fastest = f"{overspeed:g} times nominal speed, {overspeed * machine.motor.nominal_speed_rad_s:.4g} rad/s"
    cycle = f"{100 * drive.overload:.0f} % for {drive.overload_time_s:g} s in {drive.overload_period_s:g} s"
    return (
        ("torque peak", "peak_torque_motor_nm", 100.0 / limit, f"the limit of {limit:.0f} N m per motor"),
        ("rms torque", "rms_torque_motor_nm", 100.0 / nominal, f"nominal torque, {nominal:g} N m, without end"),
        ("overload", "overload_use_percent", 1.0, cycle),
        ("motor speed", "peak_speed_percent", 1.0 / overspeed, fastest),
        ("place of the stop", "position_error_end_m", 100.0 / ASTRAY_M, f"{1000 * ASTRAY_M:g} mm from the reference"),
    )


def _axis_shares(machine: Any) -> tuple[Share, ...]:
    """Of what the drive states: its limit, what it gives without end, its top speed."""
    drive, kind, judged = machine.drive, kind_of(machine), set_of(kind_of(machine).name)
    unit, word = kind.drive.unit, kind.drive.quantity
    fastest = next(name for name in judged.by_name if name.startswith(("peak_velocity", "peak_speed")))
    shares: list[Share] = []
    if math.isfinite(drive.limit):
        shares.append((f"{word} peak", judged.peak, 100.0 / drive.limit, f"the limit of {drive.limit:g} {unit}"))
    if drive.nominal is not None:
        without_end = f"nominal {word}, {drive.nominal:g} {unit}, without end"
        shares.append((f"rms {word}", judged.rms, 100.0 / drive.nominal, without_end))
    if drive.top_speed is not None:
        bound = f"the top speed, {drive.top_speed:g} {kind.moved.speed_unit}"
        shares.append(("speed", fastest, 100.0 / drive.top_speed, bound))
    return tuple(shares)


_SHARES: dict[str, Callable[[Any], tuple[Share, ...]]] = {"hoist": _hoist_shares}


def _hunting(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Use]:
    hunting = [row for row in good if hunts(row)]
    if not hunting:
        return []
    worst = max(hunting, key=swings_per_s)
    bound = f"{SWINGS_PER_S:g} a second of motion, each by more than nominal torque: the loop hunts"
    return [Use("torque swings", 100.0 * swings_per_s(worst) / SWINGS_PER_S, bound, run_in_words(worst, axes))]


def _wire(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Use]:
    factors = [row for row in good if (row.metrics.get("wire_safety_factor") or 0.0) > 0.0]
    if not factors:
        return []
    worst = min(factors, key=lambda row: row["wire_safety_factor"])
    bound = f"a safety factor of {WIRE_SAFETY:g} (ISO 4308-1, M5)"
    return [Use("wire", 100.0 * WIRE_SAFETY / worst["wire_safety_factor"], bound, run_in_words(worst, axes))]


def utilisation_table(uses: Sequence[Use]) -> Table:
    """A line each, with its light."""
    lines = [[f"{SIGN[use.light]} {use.light}", use.what, f"{use.percent:.0f}", use.bound, use.where] for use in uses]
    note = f"Green up to {AMBER:g} % of what is borne, amber above, red where it is reached; the run that uses most."
    return Table([words("light"), words("utilisation"), Column("used", "%"), words("of"), words("in")], lines, note)


def alarm(uses: Sequence[Use]) -> str | None:
    """One sentence on what is at or beyond its bound; None where nothing is."""
    over = [f"{use.what} {use.used} {use.bound} ({use.where})" for use in uses if use.light == "red"]
    return f"Overload: {'; '.join(over)}." if over else None
