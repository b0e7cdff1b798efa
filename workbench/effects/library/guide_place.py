"""Friction of the guide rollers that changes along the rails; on an axis, along its way."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import Parameter, effect
from workbench.effects.library.guide import ARMSTRONG, GUIDE, OF, SWITCH
from workbench.trace.expr import Scalar, clip, cos, exp


@effect(
    place=GUIDE, subsystem=OF, regime="position",
    parameters=[
        Parameter(
            "F", "peak_{n}", "friction at the middle of the stretch", "force", 0.0, 1.0, 0.02, 0.04,
            vanishes_at=0.0, domain="not_negative",
        ),
        Parameter("x_0", "centre_{m}", "position of its middle", "length", -1.0, 1.0, 0.02, 0.3, scan="position"),
        Parameter("b", "width_{m}", "from the middle to 61 %", "length", 0.002, 0.3, 0.01, 0.02, domain="positive",
                  tries=(0.01, 0.02, 0.04)),
    ],
    reads=SWITCH | {"x": "position, {m}"},
    equation="F = −F_peak exp(−½ ((x − x_0)/b)²) S(v)",
    reference="E. Rabinowicz, Friction and Wear of Materials, 1995, on misaligned guides; a bell of three numbers",
    shows="a bump of the residual at one height in every run that passes it, against the motion",
    dissipative=True,
)  # fmt: skip
def friction_position_dependent(s: Any, e: Any, p: Any) -> Scalar:
    """One tight stretch of the rails."""
    ratio = (s.x - e.x_0) / e.b
    return -(e.F * exp(-0.5 * (ratio * ratio)) * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="position", listed=False,
    parameters=[
        Parameter(
            "F", "level_{n}", "extra friction above the position", "force", 0.0, 1.0, 0.02, 0.04,
            vanishes_at=0.0, domain="not_negative",
        ),
        Parameter("x_0", "position_{m}", "where it sets in", "length", -1.0, 1.0, 0.02, 0.3, scan="position"),
        Parameter("b", "width_{m}", "over which it sets in", "length", 1e-4, 0.1, 0.002, 0.004, domain="positive"),
    ],
    reads=SWITCH | {"x": "position, {m}"},
    equation="F = −ΔF clip((x − x_0)/b + ½, 0, 1) S(v)",
    reference="a rail joint or a change of section: two levels of Coulomb friction",
    shows="friction levels that differ above and below one height",
    dissipative=True,
)  # fmt: skip
def friction_step(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that is larger above one height: another rail section."""
    return -(e.F * clip((s.x - e.x_0) / e.b + 0.5, 0.0, 1.0) * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="periodic", listed=False,
    parameters=[
        Parameter(
            "F", "amplitude_{n}", "friction at the tightest point", "force", 0.0, 0.5, 0.01, 0.02,
            vanishes_at=0.0, domain="not_negative",
        ),
        Parameter("d", "period_{m}", "a roller's circumference", "length", 0.002, 1.0, 0.01, 0.03, domain="positive"),
        Parameter("phi", "phase_rad", "at position 0", "1", 0.0, 2.0 * math.pi, 0.5, 0.0,
                  tries=(0.0, 1.57, 3.14, 4.71)),
    ],
    reads=SWITCH | {"x": "position, {m}"},
    equation="F = −½ F_max (1 + cos(2π x/d + φ)) S(v)",
    reference=f"{ARMSTRONG}, section 2 on position-dependent friction of rolling parts",
    shows="a ripple of the residual over height, against the motion, of one wavelength",
    dissipative=True,
)  # fmt: skip
def friction_periodic(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that comes and goes with the turning of a guide roller."""
    return -(0.5 * e.F * (1.0 + cos(s.x * (2.0 * math.pi / e.d) + e.phi)) * s.switch)
