"""References: what the carriage is asked to do over time, within limits of speed, acceleration and jerk.

Each kind is declared once, in `workbench/references/library`.
"""

from workbench.references.kind import BASELINE, Move, PlannedKind, planned, planned_kind, planned_kinds, recorded_kinds
from workbench.references.plan import MotionPlan, Plan, RecordedPlan, motion_time_s, move_shape, plan_motion
from workbench.references.shape import LimitPair, Limits, Shape, Step, allowed_carriage_speed_m_s, motor_speed_rad_s
