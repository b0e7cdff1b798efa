"""`kind: axis`: one inertia, driven directly, linear or rotary.

input = inertia · acceleration + viscous · speed + Coulomb · sign(speed) + gravity,
where gravity is sine · sin(angle) + constant. A positive constant load opposes
forward motion. Friction values are magnitudes; loads may have either sign.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from workbench.machine.axis_drive import LINEAR_DRIVES, ROTARY_DRIVES, LinearDrive, RotaryDrive
from workbench.machine.correction import LinearCorrection, MeasuredCorrection, RotaryCorrection
from workbench.machine.named import by_name
from workbench.machine.quantities import Gain, Inertia, Level, Mass, Offset, Slope, Standstill, Tolerance
from workbench.machine.record import EffectValues, Identified, Record, renamed


class LinearGravity(Record):
    constant_n: Offset = 0.0


class RotaryGravity(Record):
    sine_nm: Offset = 0.0
    constant_nm: Offset = 0.0


class LinearFriction(Record):
    """Below `standstill_speed_m_s` the Coulomb force falls linearly to zero with the speed."""

    coulomb_forward_n: Level
    coulomb_backward_n: Level
    viscous_n_s_per_m: Slope
    standstill_speed_m_s: Standstill = 1e-4


class RotaryFriction(Record):
    """Below `standstill_speed_rad_s` the Coulomb torque falls linearly to zero with the speed."""

    coulomb_forward_nm: Level
    coulomb_backward_nm: Level
    viscous_nm_s_per_rad: Slope
    standstill_speed_rad_s: Standstill = 1e-4


class AxisTolerances(Record):
    """One standard deviation of each nominal value, relative unless the name carries a unit."""

    inertia: Tolerance = 0.02
    coulomb: Tolerance = 0.05
    viscous: Tolerance = 0.1
    gravity: Tolerance = 0.05


OFFSET_TOLERANCE = 0.001  # of the largest measured input, where the file gives none: a transducer of class 0.1


class LinearTolerances(AxisTolerances):
    """`torque_gain` and `torque_offset_nm` are accepted as other names of force_gain and force_offset_n."""

    force_gain: Tolerance = 0.005
    force_offset_n: Level | None = None

    @model_validator(mode="before")
    @classmethod
    def _other_names(cls, data: object) -> object:
        return renamed(renamed(data, "torque_gain", "force_gain"), "torque_offset_nm", "force_offset_n")


class RotaryTolerances(AxisTolerances):
    """`force_gain` and `force_offset_n` are accepted as other names of torque_gain and torque_offset_nm."""

    torque_gain: Tolerance = 0.005
    torque_offset_nm: Level | None = None

    @model_validator(mode="before")
    @classmethod
    def _other_names(cls, data: object) -> object:
        return renamed(renamed(data, "force_gain", "torque_gain"), "force_offset_n", "torque_offset_nm")


class LinearSensors(Record):
    """Logged force = gain · true force + offset."""

    force_gain: Gain = 1.0
    force_offset_n: Offset = 0.0


class RotarySensors(Record):
    """Logged torque = gain · true torque + offset."""

    torque_gain: Gain = 1.0
    torque_offset_nm: Offset = 0.0


class Axis(Record):
    """What linear and rotary axes share. The class attributes name their keys and signals alike."""

    format: Literal[1] = 1
    kind: str = "axis"
    name: str = "axis"
    drive: LinearDrive | RotaryDrive = LinearDrive()
    tolerances: AxisTolerances = AxisTolerances()
    effects: EffectValues = Field(default_factory=dict)
    measured_correction: MeasuredCorrection | None = None
    identified: Identified = Field(default_factory=dict)

    # role -> dotted name of the value, the same roles for both motions
    value_of: ClassVar[dict[str, str]] = {}
    input_signal: ClassVar[str]
    position_signal: ClassVar[str]
    speed_signal: ClassVar[str]
    reference_signal: ClassVar[str]
    CORRECTION: ClassVar[type[MeasuredCorrection]]

    def role(self, name: str) -> float:
        """The value of a role: inertia, coulomb_forward, coulomb_backward, viscous, gravity_sine,
        gravity_constant, gain, offset, gain_tolerance. A linear axis has no sine load: 0."""
        target: object = self
        dotted = self.value_of[name]
        if not dotted:
            return 0.0
        for part in dotted.split("."):
            target = getattr(target, part)
        assert isinstance(target, float)
        return target

    def offset_tolerance(self, largest_input: float) -> float:
        """Tolerance of the input's offset, in the input's unit; where missing, 0.1 % of the largest measured input."""
        tolerances = getattr(self, "tolerances")  # noqa: B009  declared by each motion
        stated = tolerances.force_offset_n if isinstance(tolerances, LinearTolerances) else tolerances.torque_offset_nm
        return OFFSET_TOLERANCE * largest_input if stated is None else float(stated)


class LinearAxis(Axis):
    """`motion: linear`: kg, N, m."""

    kind: Literal["axis"] = "axis"
    motion: Literal["linear"] = "linear"
    name: str = "linear axis"
    mass_kg: Mass
    gravity: LinearGravity = LinearGravity()
    friction: LinearFriction
    drive: Annotated[LinearDrive, *by_name(LINEAR_DRIVES)] = LinearDrive()
    sensors: LinearSensors = LinearSensors()
    tolerances: LinearTolerances = LinearTolerances()
    measured_correction: LinearCorrection | None = None

    value_of: ClassVar[dict[str, str]] = {
        "inertia": "mass_kg",
        "coulomb_forward": "friction.coulomb_forward_n",
        "coulomb_backward": "friction.coulomb_backward_n",
        "viscous": "friction.viscous_n_s_per_m",
        "gravity_sine": "",
        "gravity_constant": "gravity.constant_n",
        "gain": "sensors.force_gain",
        "offset": "sensors.force_offset_n",
        "gain_tolerance": "tolerances.force_gain",
    }
    input_signal: ClassVar[str] = "force_n"
    position_signal: ClassVar[str] = "position_m"
    speed_signal: ClassVar[str] = "velocity_m_s"
    reference_signal: ClassVar[str] = "position_reference_m"
    CORRECTION: ClassVar[type[MeasuredCorrection]] = LinearCorrection


class RotaryAxis(Axis):
    """`motion: rotary`: kg m², N m, rad."""

    kind: Literal["axis"] = "axis"
    motion: Literal["rotary"] = "rotary"
    name: str = "rotary axis"
    inertia_kg_m2: Inertia
    gravity: RotaryGravity = RotaryGravity()
    friction: RotaryFriction
    drive: Annotated[RotaryDrive, *by_name(ROTARY_DRIVES)] = RotaryDrive()
    sensors: RotarySensors = RotarySensors()
    tolerances: RotaryTolerances = RotaryTolerances()
    measured_correction: RotaryCorrection | None = None

    value_of: ClassVar[dict[str, str]] = {
        "inertia": "inertia_kg_m2",
        "coulomb_forward": "friction.coulomb_forward_nm",
        "coulomb_backward": "friction.coulomb_backward_nm",
        "viscous": "friction.viscous_nm_s_per_rad",
        "gravity_sine": "gravity.sine_nm",
        "gravity_constant": "gravity.constant_nm",
        "gain": "sensors.torque_gain",
        "offset": "sensors.torque_offset_nm",
        "gain_tolerance": "tolerances.torque_gain",
    }
    input_signal: ClassVar[str] = "torque_nm"
    position_signal: ClassVar[str] = "angle_rad"
    speed_signal: ClassVar[str] = "speed_rad_s"
    reference_signal: ClassVar[str] = "angle_reference_rad"
    CORRECTION: ClassVar[type[MeasuredCorrection]] = RotaryCorrection
