"""Friction of the guide rollers in the rails, alike all along them and by place; on an axis, of its own guide."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import INEXACT, Parameter, amount, effect
from workbench.symbolic.expr import Scalar, absolute, clip, cos, exp, where

GUIDE = {"hoist": "guide_force_n", "axis": "axis_force"}
OF = {"hoist": "guide", "axis": "axis"}
SPEED = {"v": "speed, {m}/s"}
SWITCH = {"switch": "sign of the speed, turned over at standstill as the machine's own friction is"}
ARMSTRONG = (
    "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation "
    "methods for the control of machines with friction, Automatica 30(7), 1994"
)


@effect(
    place=GUIDE, subsystem=OF, regime="speed",
    parameters=[amount("B", "viscous_{n}_s_per_{m}", "slope over speed", "force/speed", 1.0, 0.02, 0.03)],
    reads=SPEED,
    equation="F = −B v",
    reference=f"{ARMSTRONG}, section 2",
    shows="a residual that grows with the speed, against it, whatever the payload",
    dissipative=True,
)  # fmt: skip
def friction_viscous(s: Any, e: Any, p: Any) -> Scalar:
    """Friction in proportion to the speed."""
    return -(e.B * s.v)


@effect(
    place=GUIDE, subsystem=OF, regime="speed",
    parameters=[
        amount("B_up", "viscous_{up}_{n}_s_per_{m}", "slope for v > 0", "force/speed", 1.0, 0.02, 0.03),
        amount("B_dn", "viscous_{dn}_{n}_s_per_{m}", "slope for v < 0", "force/speed", 1.0, 0.02, 0.03),
    ],
    reads=SPEED,
    equation="F = −B_up v for v > 0, −B_dn v else",
    reference=f"{ARMSTRONG}, section 2, with a slope for each direction",
    shows="as friction_viscous, with another slope in each direction",
    dissipative=True,
)  # fmt: skip
def friction_viscous_asymmetric(s: Any, e: Any, p: Any) -> Scalar:
    """Friction in proportion to the speed, with another slope in each direction."""
    return -(where(s.v > 0.0, e.B_up, e.B_dn) * s.v)


@effect(
    place=GUIDE, subsystem=OF, regime="all",
    parameters=[
        Parameter("F", "level_{n}", "beyond both nominal levels", "force", -0.5, 1.0, 0.02, 0.03, vanishes_at=0.0,
                  on_levels=(0, 1)),
    ],
    reads=SWITCH,
    equation="F = −ΔF S(v)",
    reference="Eq. 17 of the paper; C. A. Coulomb, Théorie des machines simples, 1785",
    shows="a step of the residual at each reversal, the same at every speed, height and payload",
    dissipative=True,
)  # fmt: skip
def friction_coulomb(s: Any, e: Any, p: Any) -> Scalar:
    """Friction levels off the nominal ones, the same in both directions; below 0 friction is less than nominal."""
    return -(e.F * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="all",
    parameters=[
        Parameter("F_up", "level_{up}_{n}", "beyond the level, v > 0", "force", -0.5, 1.0, 0.02, 0.03, vanishes_at=0.0,
                  on_levels=(0,)),
        Parameter("F_dn", "level_{dn}_{n}", "beyond the level, v < 0", "force", -0.5, 1.0, 0.02, 0.03, vanishes_at=0.0,
                  on_levels=(1,)),
    ],
    reads=SPEED | SWITCH,
    equation="F = −ΔF_up S(v) for S > 0, −ΔF_dn S(v) else",
    reference="Eq. 17 of the paper, both levels free",
    shows="two levels of the residual, one in each direction; alike: a torque offset, an error of the carriage's mass",
    dissipative=True,
)  # fmt: skip
def friction_coulomb_asymmetric(s: Any, e: Any, p: Any) -> Scalar:
    """Friction levels off the nominal ones, by another amount in each direction."""
    return -(where(s.switch > 0.0, e.F_up, e.F_dn) * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="low_speed",
    parameters=[
        amount(
            "F_up", "peak_{up}_{n}", "at low speed beyond the level, v > 0", "force", 0.5, 0.02, 0.04,
            simplified=lambda e: INEXACT * e.F_up,
        ),
        amount(
            "F_dn", "peak_{dn}_{n}", "at low speed beyond the level, v < 0", "force", 0.5, 0.02, 0.04,
            simplified=lambda e: INEXACT * e.F_dn,
        ),
        Parameter(
            "v_S", "stribeck_speed_{m}_s", "where the peak has fallen to 37 %", "speed", 0.005, 0.5, 0.02, 0.05,
            domain="positive", tries=(0.02, 0.04, 0.08, 0.16), simplified=lambda e: INEXACT * e.v_S,
        ),
    ],
    reads=SPEED | SWITCH,
    equation="F = −F_up,dn exp(−(v/v_S)²) S(v)",
    reference=f"{ARMSTRONG}, Eq. 6 with exponent 2; R. Stribeck, VDI-Zeitschrift 46, 1902",
    shows="more friction while creeping, at each start and stop, than at speed",
    dissipative=True,
)  # fmt: skip
def friction_stribeck(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that is larger at low speed and falls as the lubricant carries."""
    ratio = s.v / e.v_S
    return -(where(s.switch > 0.0, e.F_up, e.F_dn) * exp(-(ratio * ratio)) * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="load",
    parameters=[amount("a", "friction_fraction", "friction per unit of load", "1", 3.0, 0.02, 0.03)],
    reads=SWITCH | {"load": "a hoist: the payload's weight, N; an axis: the load force, {n}"},
    equation="F = −a |load| S(v)",
    reference="F. P. Bowden, D. Tabor, The Friction and Lubrication of Solids, 1950, chapter 5 (Amontons' law)",
    shows="friction levels that grow with the payload, at any speed",
    dissipative=True,
)  # fmt: skip
def friction_load_dependent(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that grows with the payload's weight; on an axis with the load, alike with gearbox_efficiency."""
    return -(e.a * absolute(s.load) * s.switch)


@effect(
    place=GUIDE, subsystem=OF, regime="time",
    parameters=[
        amount("a", "friction_fraction", "extra friction of the cold machine over its warm one", "1", 3.0, 0.1, 0.5),
        Parameter("tau", "time_constant_s", "of warming up", "1", 1.0, 5000.0, 30.0, 200.0, domain="positive",
                  tries=(50.0, 150.0, 400.0, 1200.0)),
    ],
    reads={
        "friction": "the machine's own friction, {n}, along the speed",
        "t": "time, s; the plant's start_time_s makes it count from the campaign's start",
    },
    equation="F = −a exp(−t/τ) F_friction",
    reference=f"{ARMSTRONG}, section 2 on temperature; one time constant of warming up",
    shows="friction levels that fall from run to run",
    dissipative=True,
)  # fmt: skip
def friction_thermal_drift(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that falls as the machine warms up, counted from the campaign's start."""
    return -(e.a * exp(-((s.t + p.start_time_s) / e.tau)) * s.friction)


@effect(
    place=GUIDE, subsystem=OF, regime="speed", listed=False,
    parameters=[amount("c", "drag_{n}_s2_per_{m}2", "drag over speed squared", "force/speed*speed", 1.0, 0.02, 0.03)],
    reads=SPEED,
    equation="F = −c v |v|",
    reference="L. Prandtl, Führer durch die Strömungslehre, drag in proportion to dynamic pressure",
    shows="as friction_viscous, bent: a quarter at half the speed",
    dissipative=True,
)  # fmt: skip
def friction_quadratic(s: Any, e: Any, p: Any) -> Scalar:
    """Drag of a fluid on what moves: hydraulic hoses, air, water."""
    return -(e.c * s.v * absolute(s.v))


@effect(
    place=GUIDE, subsystem=OF, regime="position",
    parameters=[
        amount("F", "peak_{n}", "friction at the middle of the stretch", "force", 1.0, 0.02, 0.04),
        Parameter("x_0", "centre_{m}", "position of its middle", "length", -1.0, 1.0, 0.02, 0.3, scan="position"),
        Parameter("b", "width_{m}", "from the middle to 61 %", "length", 0.002, 0.3, 0.01, 0.02, domain="positive",
                  scan="width", tries=(0.01, 0.02, 0.04)),
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
        amount("F", "level_{n}", "extra friction above the position", "force", 1.0, 0.02, 0.04),
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
        amount("F", "amplitude_{n}", "friction at the tightest point", "force", 0.5, 0.01, 0.02),
        Parameter("d", "period_{m}", "a roller's circumference", "length", 0.002, 1.0, 0.01, 0.03, domain="positive",
                  scan="period"),
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
