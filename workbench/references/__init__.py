"""References: what the carriage is asked to do over time, within limits of speed, acceleration and jerk."""

from workbench.references.limits import LimitPair, Limits, Step
from workbench.references.plan import MotionPlan, Plan, Profile, motion_time_s, plan_motion
from workbench.references.recorded import RecordedPlan
from workbench.references.shapes import KINDS, Shape
from workbench.references.stopped import StoppedPlan
from workbench.references.transmission import allowed_carriage_speed_m_s, motor_speed_rad_s

__all__ = [
    "KINDS",
    "LimitPair",
    "Limits",
    "MotionPlan",
    "Plan",
    "Profile",
    "RecordedPlan",
    "Shape",
    "Step",
    "StoppedPlan",
    "allowed_carriage_speed_m_s",
    "motion_time_s",
    "motor_speed_rad_s",
    "plan_motion",
]
