"""The `drive` block of an axis: what stands between the wanted force and the axis, and behind its encoder."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from workbench.machine.quantities import Delay, Force, Lag, Speed
from workbench.machine.record import Record

COUNTS = Field(ge=0, le=100_000_000, strict=True)


class AxisDrive(Record):
    """The drive as the speed loop meets it. A missing key has a round figure on the slow side of servo drives;
    docs/formats.md tells what makers state.

    torque_lag_s: first-order lag of the current loop; 0.5 ms rise in 1.1 ms from a tenth to nine tenths.
    speed_filter_s: first-order filter of the measured speed. speed_delay_s: transport delay of the measured speed and
    position; 1 ms is one sample, the computing delay of a controller that acts at its next sample.
    """

    torque_lag_s: Lag = 0.0005
    speed_filter_s: Lag = 0.001
    speed_delay_s: Delay = 0.001


class LinearDrive(AxisDrive):
    """force_limit_n: the largest force, either way; nominal_force_n: the one that it gives without end. top_speed_m_s:
    what no motion may exceed. encoder_counts_per_m: the resolution of position and counted speed, 0 is ideal."""

    force_limit_n: Force | None = None
    nominal_force_n: Force | None = None
    top_speed_m_s: Speed | None = None
    encoder_counts_per_m: Annotated[int, COUNTS] = 10_000_000

    @property
    def limit(self) -> float:
        """N; inf where none is stated."""
        return math.inf if self.force_limit_n is None else self.force_limit_n

    @property
    def nominal(self) -> float | None:
        return self.nominal_force_n

    @property
    def top_speed(self) -> float | None:
        return self.top_speed_m_s

    @property
    def encoder_counts_per_turn(self) -> float:
        """Counts over 2 pi of the driven coordinate."""
        return 2.0 * math.pi * self.encoder_counts_per_m


class RotaryDrive(AxisDrive):
    """torque_limit_nm: the largest torque, either way; nominal_torque_nm: the one that it gives without end.
    top_speed_rad_s: what no motion may exceed. encoder_counts_per_turn: the resolution of angle and counted speed, 0 is
    ideal."""

    torque_limit_nm: Force | None = None
    nominal_torque_nm: Force | None = None
    top_speed_rad_s: Speed | None = None
    encoder_counts_per_turn: Annotated[int, COUNTS] = 1_048_576

    @property
    def limit(self) -> float:
        """N m; inf where none is stated."""
        return math.inf if self.torque_limit_nm is None else self.torque_limit_nm

    @property
    def nominal(self) -> float | None:
        return self.nominal_torque_nm

    @property
    def top_speed(self) -> float | None:
        return self.top_speed_rad_s


_IDEAL = {"torque_lag_s": 0.0, "speed_filter_s": 0.0, "speed_delay_s": 0.0}
# What `drive:` may be by name, in place of a block.
LINEAR_DRIVES = {"standard": LinearDrive(), "ideal": LinearDrive(**_IDEAL, encoder_counts_per_m=0)}
ROTARY_DRIVES = {"standard": RotaryDrive(), "ideal": RotaryDrive(**_IDEAL, encoder_counts_per_turn=0)}
