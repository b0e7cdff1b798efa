"""What a directly driven axis has of its own: its inertia, play, and friction before it slides."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import EffectMemory, Parameter, effect
from workbench.plants.axis import friction, level
from workbench.trace.expr import Scalar, absolute, clip, maximum, minimum, sin, where

CONTACT = 2.0 * math.pi * 100.0  # rad/s, of the teeth on their flank: beyond what a diagnosis compares
CONTACT_DAMPING = 0.1


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
    memory=[
        EffectMemory("z", _bristle_rate, start=lambda e, p: 0.0, scale=lambda e, p: max(p.F_f, p.F_b) or 1.0),
    ],
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


def _through(v: Scalar, e: Any, p: Any) -> Scalar:
    """Force from flank to flank were all of the axis beyond the play: a stiff contact that only pushes."""
    behind = e.q - clip(e.q, -0.5 * e.play, 0.5 * e.play)
    pushed = p.M * (CONTACT * CONTACT * behind + 2.0 * CONTACT_DAMPING * CONTACT * (v - e.w))
    return where(behind > 0.0, maximum(pushed, 0.0), where(behind < 0.0, minimum(pushed, 0.0), 0.0))


def _lead_rate(s: Any, e: Any, p: Any) -> Scalar:
    return where(e.share > 0.0, _speed(s) - e.w, 0.0)


def _beyond_rate(s: Any, e: Any, p: Any) -> Scalar:
    """The acceleration of what lies beyond the play."""
    load = p.C if hasattr(s, "velocity_m_s") else p.G * sin(s.angle_rad - e.q) + p.C
    return where(e.share > 0.0, (_through(_speed(s), e, p) - friction(e.w, p) - load) / p.M, 0.0)


def _pressed(e: Any, p: Any) -> Scalar:
    """On the flank that the constant load presses against."""
    return where(p.C >= 0.0, 0.5, -0.5) * e.play + p.C / (p.M * CONTACT * CONTACT)


def _less_inertia(s: Any, e: Any, p: Any) -> Scalar:
    return -(e.share * p.M)


@effect(
    place={"axis": "axis_force"}, subsystem="axis", regime="event",
    parameters=[
        Parameter("share", "load_share", "of inertia, friction and load that lies beyond the play", "1", 0.0, 0.95,
                  0.05, 0.3, vanishes_at=0.0, domain="not_negative"),
        # Little and large play look nothing alike: it is tried, and the share says whether there is any.
        Parameter("play", "play_{m}", "from flank to flank", "length", 1e-4, 0.1, 0.0005, 0.003,
                  domain="positive", tries=(0.0005, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03)),
    ],
    reads={"v": "speed, {m}/s", "friction": "the axis' friction, {n}", "load": "its load, {n}",
           "q": "its memory: motor before load, {m}", "w": "its memory: the load's speed, {m}/s"},
    equation="M → (1 − share) M;  F = share (friction + load − T(q, v − w));  q' = v − w;  "
    "M w' = T − friction(w) − load;  T: contact at ±play/2, 100 Hz, damping 0.1",
    reference="M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002; "
    "damping of teeth 0.03 to 0.17: R. Kasuba, J. W. Evans, An extended model for determining dynamic loads in spur "
    "gearing, Journal of Mechanical Design 103, 1981",
    shows="after each reversal the motor turns without the load for a short way, then a blow",
    memory=[
        EffectMemory("q", _lead_rate, start=_pressed, scale=lambda e, p: e.play),
        EffectMemory("w", _beyond_rate, start=lambda e, p: 0.0, scale=lambda e, p: 0.1 * CONTACT * e.play),
    ],
    beside={"axis_inertia": _less_inertia},
)  # fmt: skip
def backlash(s: Any, e: Any, p: Any) -> Scalar:
    """Play in the drive: within it the motor moves without what lies beyond, then takes it along with a blow."""
    nominal = s.friction + s.load
    return where(e.share > 0.0, e.share * (nominal - _through(s.v, e, p)), 0.0)
