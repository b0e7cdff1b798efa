"""Where the arm's bodies and joints are, and what they weigh, at one carriage height."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.machines import Hoist

Point = tuple[float, float]
ROLLERS = ("lower_dolly_top", "lower_dolly_bottom", "upper_dolly_top", "upper_dolly_bottom")
_DOLLY_DEPTH_M = 0.6  # for the dollies' moment of inertia only
_HEAD_SIZE_M = 0.8  # and for the head's


@dataclass(frozen=True)
class Body:
    """mass_kg, inertia_kg_m2 about the centre of mass, which stands at `centre` (x, y in m)."""

    mass_kg: float
    inertia_kg_m2: float
    centre: Point


@dataclass(frozen=True)
class Geometry:
    """bodies and joints by name; a joint is (body, body, point). rollers: name -> (dolly, point on the rail)."""

    bodies: Mapping[str, Body]
    joints: Mapping[str, tuple[str, str, Point]]
    rollers: Mapping[str, tuple[str, Point]]
    cylinder: tuple[Point, Point]
    sheave_x_m: float


def geometry_of(machine: Hoist, payload_kg: float, height_m: float) -> Geometry:
    """Figure 3 of the paper in the plane: x from the rails outwards, y up, the lower pivot at the carriage height.

    The payload is what hangs in the gripper in truth. Without one there is no such body.
    """
    arm, shares = machine.arm, machine.arm.shares
    s, half = arm.dolly_distance_m, arm.roller_spacing_m / 2.0
    x, y = arm.pivot_offset_m, height_m
    low, high = (x, y), (x, y + s)  # the two dollies' pivots
    head, middle = (x + arm.reach_m, y), (x + arm.reach_m / 2.0, y + s / 2.0)
    bar_in, bar_out = (x, y + s + arm.level_bar_offset_m), (x + arm.reach_m, y + arm.level_bar_offset_m)
    pipe = (x + arm.reach_m + arm.pipe_offset_m, y)
    structure = machine.carriage.mass_kg - machine.sheave.mass_kg

    def rod(share: float, length: float, a: Point, b: Point) -> Body:
        mass = share * structure
        return Body(mass, mass * length**2 / 12.0, ((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0))

    def block(share: float, size: Point, centre: Point) -> Body:
        mass = share * structure
        return Body(mass, mass * (size[0] ** 2 + size[1] ** 2) / 12.0, centre)

    dolly = (_DOLLY_DEPTH_M, arm.roller_spacing_m)
    bodies = {
        "lower_dolly": block(shares.lower_dolly, dolly, (x / 2.0, y)),
        "upper_dolly": block(shares.upper_dolly, dolly, (x / 2.0, y + s)),
        "main_arm": rod(shares.main_arm, arm.main_arm_m, high, head),
        "support_link": rod(shares.support_link, arm.main_arm_m / 2.0, low, middle),
        "level_bar": rod(shares.level_bar, arm.main_arm_m, bar_in, bar_out),
        "head": block(shares.head, (_HEAD_SIZE_M, _HEAD_SIZE_M), (x + arm.reach_m + arm.pipe_offset_m / 2.0, y)),
        "sheave": Body(machine.sheave.mass_kg, machine.sheave.inertia_kg_m2, (arm.sheave_offset_m, y)),
    }
    joints = {
        "lower_pivot": ("lower_dolly", "support_link", low),
        "upper_pivot": ("upper_dolly", "main_arm", high),
        "middle_pivot": ("support_link", "main_arm", middle),
        "head_pivot": ("main_arm", "head", head),
        "level_bar_inner": ("upper_dolly", "level_bar", bar_in),
        "level_bar_outer": ("level_bar", "head", bar_out),
        "sheave_pin": ("lower_dolly", "sheave", (arm.sheave_offset_m, y)),
    }
    if payload_kg > 0.0:
        bodies["payload"] = Body(payload_kg, payload_kg * arm.pipe_length_m**2 / 12.0, pipe)
        joints["gripper"] = ("head", "payload", pipe)
    rollers = dict(
        zip(
            ROLLERS,
            [
                ("lower_dolly", (0.0, y + half)),
                ("lower_dolly", (0.0, y - half)),
                ("upper_dolly", (0.0, y + s + half)),
                ("upper_dolly", (0.0, y + s - half)),
            ],
            strict=True,
        )
    )
    cylinder = ((arm.cylinder_offset_m, y), (arm.cylinder_offset_m, y + s))
    return Geometry(bodies, joints, rollers, cylinder, arm.sheave_offset_m)
