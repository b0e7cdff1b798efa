"""What a speed loop is set to: the `controller` block of a scenario, and what `tune` writes."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from workbench.machine.quantities import Frequency, KiGain, KpGain, RateLimit, TrackingTime
from workbench.machine.record import Record

Fraction = Annotated[float, Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False)]


class Notch(Record):
    """Takes out a lightly damped wire: depth at its frequency is depth (0 takes all), width grows with damping."""

    frequency_hz: Frequency
    damping: Annotated[float, Field(gt=0.0, le=2.0, strict=True, allow_inf_nan=False)] = 0.5
    depth: Fraction = 0.1


class FeedForward(Record):
    """Fractions of what the machine's own values say: torque of inertia, of the weight, of guide friction.

    wire: how far the inertia's torque knows the wire: at 0 carriage and payload follow the drum at once, at 1 they
    swing behind it as the machine's stiffness and damping say.
    """

    inertia: Fraction = 0.0
    weight: Fraction = 0.0
    friction: Fraction = 0.0
    wire: Fraction = 0.0

    @property
    def through_the_wire(self) -> bool:
        """Whether the load's swing is computed at all."""
        return self.inertia > 0.0 and self.wire > 0.0


class PiSettings(Record):
    """The sampled PI speed loop; gains act on motor speed and give the torque of all motors together.

    anti_windup: back_calculation runs the integral back with tracking_time_s (kp/ki when null),
    conditional stops it while the torque is limited and the error would drive it further in.
    The notch and the low-pass stand in the controller's output, before feed-forward and limits.
    """

    kind: Literal["pi"] = "pi"
    sample_time_s: Annotated[float, Field(ge=1e-4, le=0.05, strict=True, allow_inf_nan=False)] = 0.001
    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain
    set_point_weight: Fraction = 1.0
    anti_windup: Literal["back_calculation", "conditional", "none"] = "back_calculation"
    tracking_time_s: TrackingTime | None = None
    torque_rate_limit_nm_per_s: RateLimit | None = None
    low_pass_hz: Frequency | None = None
    notch: Notch | None = None
    feed_forward: FeedForward = FeedForward()

    @property
    def tracking_rate_per_s(self) -> float:
        """1/Tt of the back-calculation; 0 where there is none."""
        if self.anti_windup != "back_calculation":
            return 0.0
        if self.tracking_time_s is not None:
            return 1.0 / self.tracking_time_s
        return self.ki_nm_per_rad / self.kp_nm_s_per_rad

    @property
    def plain(self) -> bool:
        """Whether the loop is a PI with limits and back-calculation only."""
        return (
            self.anti_windup != "conditional"
            and self.torque_rate_limit_nm_per_s is None
            and self.low_pass_hz is None
            and self.notch is None
            and self.feed_forward == FeedForward()
        )


def low_pass_gain(frequency_hz: float | None, sample_time_s: float) -> float:
    """alpha of y += alpha (x - y), the exact discretisation of a first-order lag; 1 is no filter."""
    return 1.0 if frequency_hz is None else 1.0 - math.exp(-2.0 * math.pi * frequency_hz * sample_time_s)


def lag_gain(time_constant_s: float, sample_time_s: float) -> float:
    """alpha of y += alpha (x - y) for a time constant; 1 where it is zero."""
    return 1.0 if time_constant_s == 0.0 else 1.0 - math.exp(-sample_time_s / time_constant_s)


def notch_coefficients(notch: Notch | None, sample_time_s: float) -> tuple[float, float, float, float, float]:
    """b0, b1, b2, a1, a2 of the sampled notch; (1, 0, 0, 0, 0) is no notch.

    Tustin's rule, prewarped at the notch's frequency, on
    (s^2 + 2 depth damping w s + w^2)/(s^2 + 2 damping w s + w^2); gain 1 at zero frequency.
    """
    if notch is None:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    t = math.tan(math.pi * notch.frequency_hz * sample_time_s)
    zero, pole = 2.0 * notch.depth * notch.damping * t, 2.0 * notch.damping * t
    a0 = 1.0 + pole + t * t
    return (
        (1.0 + zero + t * t) / a0,
        2.0 * (t * t - 1.0) / a0,
        (1.0 - zero + t * t) / a0,
        2.0 * (t * t - 1.0) / a0,
        (1.0 - pole + t * t) / a0,
    )
