"""Masses that are not what the engineer believes, and the vessel that the machine stands on."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import Parameter, amount, effect
from workbench.symbolic.expr import Scalar, sin


@effect(
    place={"hoist": "carriage_mass_kg"}, subsystem="payload", regime="all",
    parameters=[
        Parameter("m", "mass_kg", "beyond the nominal carriage", "mass", -0.5, 0.5, 0.01, 0.02, vanishes_at=0.0),
    ],
    equation="m → m + Δm",
    reference="Eq. 16 of the paper",
    shows="a constant residual, up and down alike; alike with a torque offset",
)  # fmt: skip
def carriage_mass_error(s: Any, e: Any, p: Any) -> Scalar:
    """A carriage heavier or lighter than stated."""
    return e.m


@effect(
    place={"hoist": "payload_kg"}, subsystem="payload", regime="load",
    parameters=[
        Parameter("scale", "payload_scale", "true over stated payload", "1", 0.2, 2.0, 0.02, 1.03,
                  vanishes_at=1.0, domain="positive"),
    ],
    reads={"payload_kg": "stated payload, kg"},
    equation="m_p → scale · m_p",
    reference="Eq. 16 of the paper",
    shows="a residual in proportion to the stated payload, up and down alike",
)  # fmt: skip
def payload_mass_error(s: Any, e: Any, p: Any) -> Scalar:
    """Payloads heavier or lighter than stated, all by one ratio."""
    return (e.scale - 1.0) * s.payload_kg


@effect(
    place={"hoist": "platform_acceleration_m_s2"}, subsystem="platform", regime="time",
    parameters=[
        # The sea's own sizes, not the machine's.
        amount("A", "amplitude_m", "of the heave", "1", 10.0, 0.05, 0.2),
        Parameter("w", "frequency_rad_s", "of the heave", "1", 0.2, 3.0, 0.02, 0.8, domain="positive",
                  scan="frequency"),
        Parameter("phi", "phase_rad", "at time 0 of the run", "1", 0.0, 2.0 * math.pi, 0.5, 0.0, per_run=True,
                  scan="phase"),
    ],
    reads={"t": "time in the run, s"},
    equation="a_platform = −A ω² sin(ω t + φ), added to g",
    reference="O. M. Faltinsen, Sea Loads on Ships and Offshore Structures, 1990, chapter 3",
    shows="a slow wave over time, standing or moving, in proportion to all that hangs",
)  # fmt: skip
def heave(s: Any, e: Any, p: Any) -> Scalar:
    """The platform heaves: A sin(ω t + φ), up positive."""
    return -(e.A * (e.w * e.w) * sin(e.w * s.t + e.phi))
