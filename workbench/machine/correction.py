"""`measured_correction`: a measured force or torque that the model lacks, as a table; for an unknown cause.

A force (torque) against the motion over one variable, a level for each way. It is no effect:
it has no cause, no name, and holds within the runs it was measured in only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import ClassVar, Literal

from pydantic import field_validator, model_validator

from workbench.machine.quantities import Finite
from workbench.machine.record import Record

FEWEST, MOST = 3, 33
TURN = 2.0 * math.pi
Numbers = tuple[Finite, ...]


class MeasuredCorrection(Record):
    """What the three forms share. forward, backward: against the motion positive, in N or N m, at each of `at`.

    Linear between the points; beyond the ends the last value stands. A periodic table covers one turn
    and closes by itself. Over a speed or a payload `at` holds magnitudes.
    """

    over: str
    acts_on: str
    at: Numbers

    PERIODIC: ClassVar[tuple[str, ...]] = ()
    MAGNITUDES: ClassVar[tuple[str, ...]] = ()
    UNITS: ClassVar[Mapping[str, str]] = {}  # acts_on -> the unit that its levels' keys end in

    @property
    def forward(self) -> tuple[float, ...]:
        raise NotImplementedError

    @property
    def backward(self) -> tuple[float, ...]:
        raise NotImplementedError

    @property
    def periodic(self) -> bool:
        return self.over in self.PERIODIC

    @field_validator("at")
    @classmethod
    def _rises(cls, at: tuple[float, ...]) -> tuple[float, ...]:
        if not FEWEST <= len(at) <= MOST:
            raise ValueError(f"{len(at)} points, expected {FEWEST} to {MOST}")
        for i, (before, after) in enumerate(pairwise(at)):
            if after <= before:
                raise ValueError(f"{after:g} (point {i + 1}) after {before:g}, expected rising values")
        return at

    @model_validator(mode="after")
    def _fits(self) -> MeasuredCorrection:
        if self.over in self.MAGNITUDES and self.at[0] < 0.0:
            raise ValueError(f"at begins at {self.at[0]:g}, expected at least 0: {self.over} is a magnitude here")
        # Rounded to some digits, a whole turn may lie just within one.
        if self.periodic and self.at[-1] - self.at[0] > TURN * (1.0 - 1e-3):
            raise ValueError(
                f"at spans {self.at[-1] - self.at[0]:.4g} rad, expected less than one turn, {TURN:.4g}: "
                "the table closes by itself"
            )
        for name, values in (("forward", self.forward), ("backward", self.backward)):
            if len(values) != len(self.at):
                raise ValueError(f"{name} has {len(values)} values, at has {len(self.at)}; expected as many")
        return self


class HoistCorrection(MeasuredCorrection):
    """acts_on guide: a force on the carriage, N; motor: a torque at the motor shaft, N m. Hoisting is forward."""

    over: Literal[
        "speed_carriage_m_s",
        "position_carriage_m",
        "speed_motor_rad_s",
        "angle_motor_rad",
        "angle_drum_rad",
        "payload_kg",
        "torque_load_nm",
        "time_s",
        "campaign_time_s",
    ]
    acts_on: Literal["guide", "motor"]
    forward_n: Numbers | None = None
    backward_n: Numbers | None = None
    forward_nm: Numbers | None = None
    backward_nm: Numbers | None = None

    PERIODIC: ClassVar[tuple[str, ...]] = ("angle_motor_rad", "angle_drum_rad")
    MAGNITUDES: ClassVar[tuple[str, ...]] = ("speed_carriage_m_s", "speed_motor_rad_s", "payload_kg")
    UNITS: ClassVar[Mapping[str, str]] = {"guide": "n", "motor": "nm"}

    @property
    def forward(self) -> tuple[float, ...]:
        return (self.forward_n if self.acts_on == "guide" else self.forward_nm) or ()

    @property
    def backward(self) -> tuple[float, ...]:
        return (self.backward_n if self.acts_on == "guide" else self.backward_nm) or ()

    @model_validator(mode="before")
    @classmethod
    def _right_unit(cls, data: object) -> object:
        """Before the other checks, which could not say as much."""
        if isinstance(data, dict) and data.get("acts_on") in ("guide", "motor"):
            if data.get("over") == "torque_load_nm" and data["acts_on"] == "guide":
                raise ValueError("over torque_load_nm goes with acts_on motor, where that torque passes; got guide")
            unit, other = ("n", "nm") if data["acts_on"] == "guide" else ("nm", "n")
            for way in ("forward", "backward"):
                if data.get(f"{way}_{other}") is not None:
                    raise ValueError(f"{way}_{other} does not go with acts_on {data['acts_on']}; expected {way}_{unit}")
                if data.get(f"{way}_{unit}") is None:
                    raise ValueError(f"{way}_{unit} is missing; acts_on {data['acts_on']} expects it")
        return data


class LinearCorrection(MeasuredCorrection):
    """A force on a linear axis, N."""

    over: Literal["velocity_m_s", "position_m", "time_s", "campaign_time_s"]
    acts_on: Literal["axis"] = "axis"
    forward_n: Numbers
    backward_n: Numbers

    MAGNITUDES: ClassVar[tuple[str, ...]] = ("velocity_m_s",)
    UNITS: ClassVar[Mapping[str, str]] = {"axis": "n"}

    @property
    def forward(self) -> tuple[float, ...]:
        return self.forward_n

    @property
    def backward(self) -> tuple[float, ...]:
        return self.backward_n


class RotaryCorrection(MeasuredCorrection):
    """A torque on a rotary axis, N m. angle_in_turn_rad is periodic, angle_rad goes on and on."""

    over: Literal["speed_rad_s", "angle_rad", "angle_in_turn_rad", "time_s", "campaign_time_s"]
    acts_on: Literal["axis"] = "axis"
    forward_nm: Numbers
    backward_nm: Numbers

    PERIODIC: ClassVar[tuple[str, ...]] = ("angle_in_turn_rad",)
    MAGNITUDES: ClassVar[tuple[str, ...]] = ("speed_rad_s",)
    UNITS: ClassVar[Mapping[str, str]] = {"axis": "nm"}

    @property
    def forward(self) -> tuple[float, ...]:
        return self.forward_nm

    @property
    def backward(self) -> tuple[float, ...]:
        return self.backward_nm
