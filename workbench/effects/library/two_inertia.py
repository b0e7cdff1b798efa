"""What an axis of two inertias has of its own: play, a softer coupling, another load."""

from __future__ import annotations

from typing import Any

from workbench.effects.declare import Parameter, amount, effect
from workbench.machines.kinds.two_inertia import coupling
from workbench.symbolic.expr import Scalar


@effect(
    place={"two_inertia": "coupling_torque_nm"}, subsystem="gearbox", regime="event",
    parameters=[
        # Little and large play look nothing alike: it is tried, and the share says whether there is any.
        amount("share", "play_share", "of the coupling that has play; the rest has none", "1", 1.05, 0.05, 1.0),
        Parameter("play", "play_{m}", "from flank to flank, beyond the nominal", "1", 1e-4, 0.5, 0.002, 0.02,
                  domain="positive", tries=(0.001, 0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.05, 0.08)),
    ],
    reads={"twist": "motor before load, rad", "rate": "its rate, rad/s", "k": "stiffness, N m/rad",
           "c": "damping, N m s/rad", "torque": "torque of the nominal coupling, N m"},
    equation="T → T + share (T with play b + Δb − T)",
    reference="M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002",
    shows="after each reversal the motor turns without the load over a short distance, then an impact",
)  # fmt: skip
def backlash(s: Any, e: Any, p: Any) -> Scalar:
    """Play between motor and load: within it the motor does not feel the load."""
    with_play, _ = coupling(s.twist, s.rate, s.k, s.c, p.b + e.play)
    return e.share * (with_play - s.torque)


@effect(
    place={"two_inertia": "coupling_compliance"}, subsystem="gearbox", regime="acceleration",
    parameters=[
        Parameter("a", "compliance_fraction", "beyond the nominal compliance", "1", -0.8, 9.0, 0.05, 0.3,
                  vanishes_at=0.0),
    ],
    equation="1/k → (1 + a)/k",
    reference="docs/model.md, two inertias: the load's frequency falls with the root of the stiffness",
    shows="a load that swings slower after each change of acceleration",
)  # fmt: skip
def coupling_compliance(s: Any, e: Any, p: Any) -> Scalar:
    """A coupling softer or stiffer than stated."""
    return e.a


@effect(
    place={"two_inertia": "load_inertia_kg_m2"}, subsystem="axis", regime="acceleration",
    parameters=[
        Parameter("a", "inertia_fraction", "beyond the nominal inertia of the load", "1", -0.8, 2.0, 0.05, 0.1,
                  vanishes_at=0.0),
    ],
    equation="M_l → (1 + a) M_l",
    reference="the load's equation in docs/model.md, two inertias",
    shows="a residual in proportion to the acceleration, with the load's own frequency in it",
)  # fmt: skip
def load_inertia_error(s: Any, e: Any, p: Any) -> Scalar:
    """A load heavier or lighter than stated."""
    return e.a * p.M_l
