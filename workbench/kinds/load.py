"""The load as a reference that knows its machine is given it: two masses along the rail, the wire between them."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Load:
    """Drive and load as two masses in the direction of the load's motion; forces in N (rotary axis: N m) at the load.

    drive_kg: motors and drum, as felt at the load. mass_kg: what hangs on the wire. stiffness_n_per_m: of all falls
    together, inf for a rigid machine. damping_time_s: damping over stiffness. hold_n: what carries the load, up
    positive. friction_up_n, friction_down_n: magnitudes. force_limit_n: of all motors. hangs: it pulls on a wire, which
    cannot push. top_speed_m_s: what the drive allows, 0 where nothing is stated. Equations: drive_kg a = u - F,
    mass_kg x'' = F - hold - friction with F = stiffness (z + damping_time z'), z the wire's stretch.
    """

    drive_kg: float
    mass_kg: float
    stiffness_n_per_m: float
    damping_time_s: float
    hold_n: float
    friction_up_n: float
    friction_down_n: float
    force_limit_n: float
    hangs: bool = True
    top_speed_m_s: float = 0.0

    @property
    def rigid(self) -> bool:
        return math.isinf(self.stiffness_n_per_m)

    @property
    def angular_frequency_rad_s(self) -> float:
        """Of the load on its wire while the drive moves as asked, undamped."""
        return math.sqrt(self.stiffness_n_per_m / self.mass_kg)

    @property
    def damping(self) -> float:
        """Damping ratio of the same."""
        return 0.0 if self.rigid else 0.5 * self.damping_time_s * self.angular_frequency_rad_s

    def steady_force_n(self, direction: float) -> float:
        """Along an even motion up (+1) or down (-1): weight and friction; negative where the load drives."""
        friction = self.friction_up_n if direction > 0.0 else self.friction_down_n
        return direction * self.hold_n + friction
