"""References: what the carriage is asked to do over time, within limits of speed, acceleration and jerk."""

from workbench.references.limits import Limits, Step
from workbench.references.plan import MotionPlan, Profile, plan_motion
from workbench.references.shapes import KINDS, Shape
from workbench.references.transmission import allowed_carriage_speed_m_s, motor_speed_rad_s

__all__ = [
    "KINDS",
    "Limits",
    "MotionPlan",
    "Profile",
    "Shape",
    "Step",
    "allowed_carriage_speed_m_s",
    "motor_speed_rad_s",
    "plan_motion",
]
