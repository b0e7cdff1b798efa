"""The sampled cascade of an axis: a proportional position loop over a PI speed loop, as the pure step that is compiled.

    asked    = s r' + kv (r - r0)                       s: speed feed-forward, r: position reference from the start on
    measured = filtered speed + kv (position - r0)
    error    = asked - measured  =  s r' - speed + kv (r - position)
    wanted   = filters(kp (error - (1 - b) s r') + integral) + feed-forward
    force    = rate limit(clip(wanted, +-limit))
    integral += Ts (ki error + (force - wanted)/Tt)

The position loop's speed and the PI are linear, so the two loops are one PI on speed + kv position, and one delay
line serves both. At constant speed without speed feed-forward the position error is speed/kv; with an integral a
constant load leaves none. W. Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001, section 15.2;
back-calculation as in `workbench.control.pi`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from workbench.control.pi import NEVER, TURN, Controller, loop_gains
from workbench.control.settings import Cascade
from workbench.machines import ClosedLoop
from workbench.symbolic.expr import Scalar, clip, floor, maximum, where

PARAMETERS = (
    "kp", "ki", "b_set", "track", "conditional", "rate", "alpha_u", "b0", "b1", "b2", "a1", "a2", "ff_v", "ff_J",
    "ff_L", "ff_F", "counts", "alpha_w", "late", "kv", "x_start", "u_limit",
)  # fmt: skip
MEMORY = ("integral", "z1", "z2", "smooth", "force", "r", "counted", "w_f")


@cache
def cascade(loop: ClosedLoop, late: bool = False) -> Controller:
    """The cascade at a kind's signals; where it is `late`, so are speed and position, by p.late samples."""
    assert loop.inertia is not None and loop.load is not None and loop.friction is not None
    inertia, load, friction = loop.inertia, loop.load, loop.friction
    position_reference, speed_reference = loop.references

    def seen(p: Any, memory: Sequence[Scalar], measured: Any, dt: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """(marks counted, the speed counted and filtered, with kv times the way since the start)."""
        counted, w_f = memory[6:8]
        x, w = getattr(measured, loop.position), getattr(measured, loop.speed)
        count = floor(x * p.counts / TURN)
        marks = maximum(p.counts, 1.0)
        w_f = w_f + p.alpha_w * (where(p.counts > 0.0, (count - counted) * TURN / (marks * dt), w) - w_f)
        x = where(p.counts > 0.0, count * TURN / marks, x)
        return count, w_f, w_f + p.kv * (x - p.x_start)

    def step(
        p: Any, memory: Sequence[Scalar], reference: Any, measured: Any, dt: Scalar
    ) -> tuple[Scalar, list[Scalar]]:
        integral, z1, z2, smooth, before, r_before = memory[:6]
        x_r, r = getattr(reference, position_reference), getattr(reference, speed_reference)
        count, w_f, now = seen(p, memory, measured, dt)
        error = p.ff_v * r + p.kv * (x_r - p.x_start) - (measured.late if late else now)
        raw = p.kp * (error - (1.0 - p.b_set) * p.ff_v * r) + integral
        cut = p.b0 * raw + z1
        z1, z2 = p.b1 * raw - p.a1 * cut + z2, p.b2 * raw - p.a2 * cut
        smooth = smooth + p.alpha_u * (cut - smooth)
        ahead = p.ff_J * inertia(p) * ((r - r_before) / dt) + p.ff_L * load(p, x_r) + p.ff_F * friction(p, r)
        wanted = smooth + ahead
        force = clip(clip(wanted, -p.u_limit, p.u_limit), before - p.rate * dt, before + p.rate * dt)
        deeper = (wanted - force) * error > 0.0
        push = where(deeper, (1.0 - p.conditional) * error, error)
        integral = integral + dt * (p.ki * push + p.track * (force - wanted))
        return force, [integral, z1, z2, smooth, force, r, count, w_f]

    def start(p: Any, hold: float, position: float) -> list[float]:
        still = hold - p.ff_L * load(p, position)  # what the integral holds beside the feed-forward
        z2 = (p.b2 - p.a2) * still
        z1 = (p.b1 - p.a1) * still + z2
        return [still, z1, z2, still, hold, 0.0, floor(position * p.counts / TURN), 0.0]

    def sensed(p: Any, memory: Sequence[Scalar], measured: Any, dt: Scalar) -> Scalar:
        return seen(p, memory, measured, dt)[2]

    return Controller(PARAMETERS, MEMORY, loop.references, step, start, sensed if late else None)


def cascade_values(settings: Cascade, drive: Any, start_position: float) -> dict[str, float]:
    """The numbers of loop and drive by symbol, the force's limit included; `drive` is the axis' drive block."""
    ahead = settings.feed_forward
    return {
        **loop_gains(settings, drive),
        "rate": settings.rate_limit or NEVER,
        "ff_v": ahead.speed,
        "ff_J": ahead.inertia,
        "ff_L": ahead.load,
        "ff_F": ahead.friction,
        "kv": settings.kv_per_s,
        "x_start": start_position,
        "u_limit": min(drive.limit, NEVER),
    }
