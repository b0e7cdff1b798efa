"""Drum and wire: how much wire the drum takes in, how stiff and how heavy the wire is."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import INEXACT, Parameter, amount, effect
from workbench.symbolic.expr import Scalar, cos, minimum, sqrt

CLIMB_RAD = 0.5  # of drum angle, within which the wire climbs onto the next layer
LEAST_LENGTH = 0.05  # of a fall: nearer to the anchor no carriage comes


@effect(
    place={"hoist": "wound_length_m"}, subsystem="drum", regime="position",
    parameters=[
        Parameter("dR", "radius_step_m", "what the next layer adds to the radius", "radius", -0.3, 0.3, 0.01, 0.03,
                  vanishes_at=0.0, simplified=lambda e: INEXACT * abs(e.dR)),
        # What is found is the middle of the climb; how long before that it begins, half of it or less, is not seen.
        Parameter("th_0", "drum_angle_rad", "where it begins", "drum_angle", -0.1, 1.0, 0.01, 0.3, scan="drum_angle",
                  simplified=lambda e: 0.5 * CLIMB_RAD),
    ],
    reads={"theta_w": "drum angle, rad"},
    equation="wound = R θ_w + ½ ΔR (a + √(a² + 0.5²)), a = θ_w − θ_0",
    reference="K. Feyrer, Wire Ropes, 2015, section 3.4: multi-layer spooling; the step rounded over half a radian",
    shows="torque and carriage speed that step by one ratio at one height, with load and friction",
)  # fmt: skip
def drum_layer_change(s: Any, e: Any, p: Any) -> Scalar:
    """The drum's radius grows by a wire's height where the next layer begins."""
    a = s.theta_w - e.th_0
    return 0.5 * e.dR * (a + sqrt(a * a + CLIMB_RAD * CLIMB_RAD))


@effect(
    place={"hoist": "wound_length_m"}, subsystem="drum", regime="periodic",
    parameters=[
        amount("A", "amplitude_m", "of the eccentricity", "radius", 0.2, 0.003, 0.01),
        Parameter("phi", "phase_rad", "at drum angle 0", "1", 0.0, 2.0 * math.pi, 0.5, 0.0, scan="phase"),
    ],
    reads={"theta_w": "drum angle, rad"},
    equation="radius = R + e sin(θ_w + φ): wound = R θ_w + e (cos φ − cos(θ_w + φ))",
    reference="docs/model.md, virtual work: the wire force's arm is the derivative of the wound length by the angle",
    shows="a wave of torque and carriage speed, one per turn of the drum, that grows with the load",
)  # fmt: skip
def drum_eccentricity(s: Any, e: Any, p: Any) -> Scalar:
    """A drum out of round, or out of centre."""
    return e.A * (cos(e.phi) - cos(s.theta_w + e.phi))


@effect(
    place={"hoist": "line_mass_kg_per_m"}, subsystem="wire", regime="position",
    parameters=[amount("rho", "mass_kg_per_m", "beyond the bare wire", "mass/length", 0.5, 0.01, 0.02)],
    equation="ρ → ρ + ρ_extra, of each fall",
    reference="docs/model.md, weight of the wire",
    shows="a holding torque that falls as the carriage rises, alike at all payloads",
)  # fmt: skip
def wire_mass(s: Any, e: Any, p: Any) -> Scalar:
    """Hoses and cables that hang with the wire, beyond the bare wire."""
    return e.rho


@effect(
    place={"hoist": "wire_compliance_m_per_n"}, subsystem="wire", regime="position",
    parameters=[amount("s", "share", "1: the whole fall stretches, 0: the nominal stiffness", "1", 1.0, 0.2, 0.8)],
    reads={"x": "carriage height, m", "k": "nominal stiffness of a fall, N/m"},
    equation="k = EA/(L − s x), with the force −½ k'(x) δ² of each fall on the carriage",
    reference="Eq. 7 of the paper with the free length; docs/model.md, length-dependent stiffness",
    shows="a wire mode that rises in frequency with the height; a stretch that falls with it",
)  # fmt: skip
def wire_stiffness_length(s: Any, e: Any, p: Any) -> Scalar:
    """A fall of wire is stiffer the shorter it is."""
    return -(e.s * minimum(s.x, (1.0 - LEAST_LENGTH) * p.L) / (p.L * s.k))
