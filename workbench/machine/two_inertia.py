"""`kind: two_inertia`: a motor that turns a load through a coupling, with friction on either side.

Motor: inertia · acceleration = torque − friction − coupling. Load: inertia · acceleration =
coupling − friction − sine · sin(load angle) − constant. See `workbench.plants.two_inertia`.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from workbench.machine.axis import Axis, RotaryAxis, RotaryFriction, RotaryGravity, RotarySensors, RotaryTolerances
from workbench.machine.axis_drive import ROTARY_DRIVES, RotaryDrive
from workbench.machine.correction import MeasuredCorrection, RotaryCorrection
from workbench.machine.named import by_name
from workbench.machine.quantities import Backlash, Inertia, Slope, Stiffness, Tolerance
from workbench.machine.record import Record


class MotorSide(Record):
    """What turns with the motor's encoder."""

    inertia_kg_m2: Inertia
    friction: RotaryFriction


class Coupling(Record):
    """Between motor and load. `backlash_rad`: from flank to flank, at the motor."""

    stiffness_nm_per_rad: Stiffness
    damping_nm_s_per_rad: Slope = 0.0
    backlash_rad: Backlash = 0.0


class LoadSide(Record):
    """What hangs on the coupling, as the motor feels it: a gear's ratio is taken into the values."""

    inertia_kg_m2: Inertia
    friction: RotaryFriction = RotaryFriction(coulomb_forward_nm=0.0, coulomb_backward_nm=0.0, viscous_nm_s_per_rad=0.0)
    gravity: RotaryGravity = RotaryGravity()


class TwoInertiaTolerances(RotaryTolerances):
    """As an axis', for the friction of the motor and the load's gravity; `inertia` is the motor's."""

    load_inertia: Tolerance = 0.05
    stiffness: Tolerance = 0.1
    damping: Tolerance = 0.5


class TwoInertia(Axis):
    """`kind: two_inertia`: kg m², N m, rad."""

    kind: Literal["two_inertia"] = "two_inertia"
    name: str = "two-inertia axis"
    motor: MotorSide
    coupling: Coupling
    load: LoadSide
    drive: Annotated[RotaryDrive, *by_name(ROTARY_DRIVES)] = RotaryDrive()
    sensors: RotarySensors = RotarySensors()
    tolerances: TwoInertiaTolerances = TwoInertiaTolerances()
    measured_correction: RotaryCorrection | None = None

    value_of: ClassVar[dict[str, str]] = {
        "inertia": "motor.inertia_kg_m2",
        "coulomb_forward": "motor.friction.coulomb_forward_nm",
        "coulomb_backward": "motor.friction.coulomb_backward_nm",
        "viscous": "motor.friction.viscous_nm_s_per_rad",
        "gravity_sine": "load.gravity.sine_nm",
        "gravity_constant": "load.gravity.constant_nm",
        "gain": "sensors.torque_gain",
        "offset": "sensors.torque_offset_nm",
        "gain_tolerance": "tolerances.torque_gain",
    }
    input_signal: ClassVar[str] = RotaryAxis.input_signal
    position_signal: ClassVar[str] = RotaryAxis.position_signal
    speed_signal: ClassVar[str] = RotaryAxis.speed_signal
    reference_signal: ClassVar[str] = RotaryAxis.reference_signal
    CORRECTION: ClassVar[type[MeasuredCorrection]] = RotaryCorrection
