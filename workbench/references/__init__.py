"""References: what the carriage is asked to do over time, within limits of speed, acceleration and jerk."""

from .limits import Limits, Step
from .plan import MotionPlan, Profile, plan_motion
from .shapes import KINDS, Shape
from .transmission import allowed_carriage_speed_m_s, motor_speed_rad_s

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
