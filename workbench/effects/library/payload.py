"""Masses that are not what the engineer believes."""

from __future__ import annotations

from typing import Any

from workbench.effects.declare import Parameter, effect
from workbench.trace.expr import Scalar


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
