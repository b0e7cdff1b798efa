"""The gripper arm's geometry and what only the multi-body machine knows: the `arm` block of machine.yaml.

docs/multibody.md draws every length. The defaults are the proportions of a vertical pipe racker with a reach of
some 3.5 m; no source gives them all, so a real machine's own drawing is to replace them.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from workbench.core.record import Finite, FrictionCoefficient, Gap, Lag, Length, Record, RollerPlay, Stiffness

Share = Annotated[float, Field(gt=0.0, lt=1.0, strict=True, allow_inf_nan=False)]


class ArmShares(Record):
    """How carriage.mass_kg less the sheave's divides into the arm's bodies; the six add up to 1."""

    lower_dolly: Share = 0.30
    upper_dolly: Share = 0.18
    main_arm: Share = 0.22
    support_link: Share = 0.08
    level_bar: Share = 0.05
    head: Share = 0.17

    @model_validator(mode="after")
    def _whole(self) -> ArmShares:
        total = sum(self.model_dump().values())
        if not math.isclose(total, 1.0, abs_tol=1e-9):
            raise ValueError(f"the six shares add up to {total:g}, expected 1")
        return self


class ArmSwitches(Record):
    """What the lumped plant leaves out; each is off at its default.

    roller_friction_coefficient: of the rollers' normal forces, beside the guide's own Coulomb levels.
    roller_clearance_m: play of each roller in its rail, to either side. wire_stiffness_follows_length: E·A over
    the fall's own free length. wire_inertia: the wire's mass moves too (its weight hangs always). bristle_m: the
    guide's friction gives way elastically by so much before it slides. layer_step_m: by which the drum's radius
    grows beyond layer_angle_rad of drum angle.
    """

    roller_friction_coefficient: FrictionCoefficient = 0.0
    roller_clearance_m: RollerPlay = 0.0
    wire_stiffness_follows_length: bool = False
    wire_inertia: bool = False
    bristle_m: Gap = 0.0
    layer_step_m: Gap = 0.0
    layer_angle_rad: Finite = 0.0


class Arm(Record):
    """Lengths and stiffnesses of Figures 2 and 3, in the plane through the column; rails and cylinders are pairs.

    Positions count from the rails (x = 0) outwards and from the lower dolly's pivot (the carriage height) upwards.
    The main arm of main_arm_m hangs from the upper dolly; the support link of half its length holds its middle
    from the lower dolly, so the head moves on a level line (Scott Russell's linkage), and the level bar keeps the
    head upright. Stiffnesses are of both rails' rollers at one height together, and of both cylinders.
    """

    reach_m: Length = 2.5
    main_arm_m: Length = 3.6
    pivot_offset_m: Length = 0.45
    level_bar_offset_m: Length = 0.35
    pipe_offset_m: Gap = 0.55
    pipe_length_m: Length = 27.0
    roller_spacing_m: Length = 1.2
    sheave_offset_m: Gap = 0.25
    cylinder_offset_m: Gap = 0.2
    shortest_reach_m: Length = 0.8
    longest_reach_m: Length = 3.3
    roller_stiffness_n_per_m: Stiffness = 1.0e8
    roller_damping_time_s: Lag = 0.002
    cylinder_stiffness_n_per_m: Stiffness = 3.0e7
    cylinder_damping_time_s: Lag = 0.002
    shares: ArmShares = ArmShares()
    switches: ArmSwitches = ArmSwitches()

    @model_validator(mode="after")
    def _closes(self) -> Arm:
        if not self.shortest_reach_m <= self.reach_m <= self.longest_reach_m:
            raise ValueError(
                f"reach_m {self.reach_m}, expected within shortest_reach_m {self.shortest_reach_m} and "
                f"longest_reach_m {self.longest_reach_m}"
            )
        if self.longest_reach_m >= self.main_arm_m:
            raise ValueError(
                f"longest_reach_m {self.longest_reach_m}, expected less than main_arm_m {self.main_arm_m}: "
                "the linkage does not close"
            )
        if self.pipe_offset_m > self.longest_reach_m:
            raise ValueError(
                f"pipe_offset_m {self.pipe_offset_m} holds the payload outside the arm's reach, expected at most "
                f"longest_reach_m {self.longest_reach_m}"
            )
        if self.dolly_distance_m <= self.roller_spacing_m:
            raise ValueError(
                f"reach_m {self.reach_m} brings the dollies within {self.dolly_distance_m:.3f} m of each other, "
                f"expected more than roller_spacing_m {self.roller_spacing_m}: they would collide"
            )
        return self

    @property
    def dolly_distance_m(self) -> float:
        """Of the dollies' pivots, which the cylinders' stroke sets: the other leg of the main arm's triangle."""
        return math.sqrt(max(self.main_arm_m**2 - self.reach_m**2, 0.0))
