"""What a directly driven axis has of its own: its inertia, play, and friction before it slides."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import EffectMemory, Parameter, effect
from workbench.plants.axis import level
from workbench.trace.expr import Scalar, absolute, sin, where

PRESS_S = 0.01  # a load that outweighs friction presses the teeth onto their flank within this time


@effect(
    place={"axis": "axis_inertia"}, subsystem="axis", regime="acceleration",
    parameters=[
        Parameter("a", "inertia_fraction", "beyond the nominal inertia", "1", -0.8, 2.0, 0.05, 0.1, vanishes_at=0.0),
    ],
    equation="M → (1 + a) M",
    reference="the axis' equation in the formats",
    shows="a residual in proportion to the acceleration",
)  # fmt: skip
def inertia_error(s: Any, e: Any, p: Any) -> Scalar:
    """An axis heavier or lighter than stated."""
    return e.a * p.M


def _speed(s: Any) -> Scalar:
    return s.velocity_m_s if hasattr(s, "velocity_m_s") else s.speed_rad_s


def _bristle_rate(s: Any, e: Any, p: Any) -> Scalar:
    v = _speed(s)
    length = where(e.d > 0.0, e.d, 1.0)
    return where(e.d > 0.0, (level(v, p) * v - absolute(v) * e.z) / length, 0.0)


@effect(
    place={"axis": "axis_force"}, subsystem="axis", regime="low_speed",
    parameters=[
        Parameter("d", "distance_{m}", "over which the friction builds up after a reversal", "length",
                  0.0, 0.2, 0.002, 0.005, vanishes_at=0.0, domain="not_negative"),
    ],
    reads={"v": "speed, {m}/s", "switch": "sign of the speed", "z": "its memory: force in the bristles, {n}"},
    equation="F = F_C S(v) − z;  z' = (F_C v − |v| z)/d",
    reference="P. R. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18), 1968",
    shows="after each reversal the friction comes back over a distance, not at once",
    memory=EffectMemory(
        "z", _bristle_rate, start=lambda e, p: 0.0, scale=lambda e, p: max(p.F_f, p.F_b) or 1.0,
    ),
)  # fmt: skip
def presliding(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that builds up over a small distance, as bristles bend, instead of jumping at a reversal."""
    return where(e.d > 0.0, level(s.v, p) * s.switch - e.z, 0.0)


@effect(
    place={"axis-linear": "axis_force"}, subsystem="axis", regime="periodic",
    parameters=[
        Parameter("A", "amplitude_n", "of the force", "force", 0.0, 0.3, 0.01, 0.02,
                  vanishes_at=0.0, domain="not_negative"),
        Parameter("n", "waves_per_m", "waves per metre of the way", "1/length", 1.2, 400.0, 0.05, 5.0,
                  domain="positive", scan="waves"),
        Parameter("phi", "phase_rad", "at position 0", "1", 0.0, 2.0 * math.pi, 0.5, 0.0, scan="phase"),
    ],
    reads={"x": "position, m"},
    equation="F = A sin(2π n x + φ)",
    reference="P. Van den Braembussche et al., Accurate tracking control of linear synchronous motor machine tool "
    "axes, Mechatronics 6, 1996: cogging repeats over the magnets' pitch",
    shows="a ripple whose frequency follows the speed, at the same places in every run",
)  # fmt: skip
def torque_ripple(s: Any, e: Any, p: Any) -> Scalar:
    """Cogging of a linear motor, or a screw's error: a wave of force along the way."""
    return e.A * sin(2.0 * math.pi * e.n * s.x + e.phi)


def _flank_rate(s: Any, e: Any, p: Any) -> Scalar:
    """Where the teeth are: -1 to 1; moved by the motion, held on their flank by a load beyond friction."""
    v = _speed(s)
    half = where(e.play > 0.0, 0.5 * e.play, 1.0)
    load = _load(s, p)
    pressed = where(absolute(load) > level(v, p), (where(load > 0.0, 1.0, -1.0) - e.n) / PRESS_S, 0.0)
    return where(e.play > 0.0, (v - absolute(v) * e.n) / half + pressed, 0.0)


def _load(s: Any, p: Any) -> Scalar:
    return p.C if hasattr(s, "velocity_m_s") else p.G * sin(s.angle_rad) + p.C


@effect(
    place={"axis": "axis_force"}, subsystem="axis", regime="event",
    parameters=[
        Parameter("play", "play_{m}", "from flank to flank", "length", 0.0, 0.1, 0.001, 0.003,
                  vanishes_at=0.0, domain="not_negative"),
        Parameter("share", "load_share", "of friction and load that lies beyond the play", "1", 0.0, 1.0, 0.1, 0.5,
                  domain="not_negative", tries=(0.5,)),
    ],
    reads={"friction": "the axis' friction, {n}", "load": "its load, {n}", "n": "its memory: the flank, −1 to 1"},
    equation="F = share (1 − n²)(friction + load);  n' = (v − |v| n)/(play/2), held at the load's flank",
    reference="M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002",
    shows="a gap in friction and load for a short way after each reversal; the blow at its end is left out",
    memory=EffectMemory("n", _flank_rate, start=lambda e, p: where(p.C >= 0.0, 1.0, -1.0), scale=lambda e, p: 1.0),
)  # fmt: skip
def backlash(s: Any, e: Any, p: Any) -> Scalar:
    """Play in the drive: after a reversal what lies beyond it asks nothing until the teeth meet again."""
    return where(e.play > 0.0, e.share * (1.0 - e.n * e.n) * (s.friction + s.load), 0.0)
