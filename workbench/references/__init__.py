"""References: what the carriage is asked to do over time, within limits of speed, acceleration and jerk.

Each kind is declared once, in `workbench/references/library`.
"""

from workbench.references.kind import (
    BASELINE,
    Move,
    PlannedKind,
    ReferenceKind,
    add,
    by_name,
    digests_of,
    forget_added,
    planned,
    planned_kind,
    planned_kinds,
    recorded_kinds,
    usual_kinds,
)
from workbench.references.plan import (
    MotionPlan,
    Plan,
    RecordedPlan,
    StoppedPlan,
    motion_time_s,
    move_shape,
    move_time_s,
    plan_motion,
)
from workbench.references.shape import LimitPair, Limits, Shape, Step, allowed_carriage_speed_m_s, motor_speed_rad_s
