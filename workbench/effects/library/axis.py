"""What a directly driven axis has of its own: its inertia, play, and friction before it slides."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import INEXACT, EffectMemory, Parameter, amount, effect
from workbench.machines.kinds.axis import friction, switch
from workbench.symbolic.expr import Scalar, absolute, clip, exp, maximum, minimum, sin, where

CONTACT = 2.0 * math.pi * 100.0  # rad/s, of the teeth on their flank: beyond what a diagnosis compares
LEAST_SHARE = 0.1  # a smaller share of the inertia carries a smaller part of the load
SETTLES_S = 0.02  # at a run's start the load lies on the flank that it presses against
FORETOLD = 0.3  # of a play and its share, and of 1: its teeth meet some milliseconds off what two rigid parts foretell
BUILDS_UP_S = 2e-5  # of friction, at least: no log shows less, and over next to no distance no fixed step follows less
PLAYS = tuple(0.0005 * 1.3**k for k in range(16))  # the impact of a play a third larger comes a pulse's width later


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


def _position(s: Any) -> Scalar:
    return s.position_m if hasattr(s, "position_m") else s.angle_rad


def _bristle_rate(s: Any, e: Any, p: Any) -> Scalar:
    v = _speed(s)
    over = maximum(absolute(v), p.v_s)  # |v|/|S(v)|: beyond it Dahl's bristles, slower they creep
    length = where(e.d > 0.0, e.d + BUILDS_UP_S * over, 1.0)
    return where(e.d > 0.0, (v - over * e.z) / length, 0.0)


def _bristle_step(s: Any, s1: Any, h: Scalar, e: Any, p: Any) -> Scalar:
    """z' is linear in z each time: on the way beyond the standstill speed, between, and beyond again.

    Beyond, |±1 − z| falls by exp(−∫ |v|/(d + τ |v|) dt), here by two points of Gauss; between, v is a line in time.
    """
    v, v1, d = _speed(s), _speed(s1), where(e.d > 0.0, e.d, 1.0)
    least, most, swing = minimum(v, v1), maximum(v, v1), where(absolute(v1 - v) > 0.0, v1 - v, 1.0)
    above = where(least > p.v_s, 1.0, (maximum(v1, p.v_s) - maximum(v, p.v_s)) / swing)  # shares of the time
    below = where(most < -p.v_s, 1.0, (minimum(v1, -p.v_s) - minimum(v, -p.v_s)) / swing)

    def slid(z: Scalar, share: Scalar, way: Scalar, v: Scalar, v1: Scalar) -> Scalar:
        w, w1 = maximum(way * v, p.v_s), maximum(way * v1, p.v_s)
        points = [0.5 * (w + w1) + side * (w1 - w) for side in (-0.5 / math.sqrt(3.0), 0.5 / math.sqrt(3.0))]
        rate = 0.5 * sum(at / (d + BUILDS_UP_S * at) for at in points)
        return way + (z - way) * exp(-(share * h * rate))

    way, way1 = where(v < 0.0, -1.0, 1.0), where(v1 < 0.0, -1.0, 1.0)
    z = slid(e.z, where(v > p.v_s, above, where(v < -p.v_s, below, 0.0)), way, v, v1)
    time = h * maximum(1.0 - above - below, 0.0) / (d + BUILDS_UP_S * p.v_s)
    x = time * p.v_s
    decay = exp(-x)
    whole = where(x > 1e-4, (1.0 - decay) / maximum(x, 1e-4), 1.0 - 0.5 * x)
    late = where(x > 1e-2, (1.0 - whole) / maximum(x, 1e-2), 0.5 - x / 6.0)
    z = decay * z + time * (clip(v, -p.v_s, p.v_s) * (whole - late) + clip(v1, -p.v_s, p.v_s) * late)
    after = where((least > p.v_s) | (most < -p.v_s), 0.0, where(v1 > p.v_s, above, where(v1 < -p.v_s, below, 0.0)))
    return where(e.d > 0.0, slid(z, after, way1, v, v1), e.z)


@effect(
    place={"axis": "axis_switch"}, subsystem="axis", regime="low_speed",
    parameters=[
        amount(
            "d", "distance_{m}", "over which the friction builds up after a reversal", "length", 0.2, 0.002, 0.005,
            simplified=lambda e: INEXACT * e.d,
        ),
    ],
    reads={"v": "speed, {m}/s", "switch": "sign of the speed", "z": "its memory: the bristles' bend, -1 to 1"},
    equation="S(v) → z in all dry friction;  z' = (v − w z)/(d + τ w), w = |v|/|S(v)|, τ = 0.02 ms",
    reference="C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, A new model for control of systems with "
    "friction, IEEE Transactions on Automatic Control 40, 1995, g = S; beyond the standstill speed P. R. Dahl's, 1968",
    shows="after each reversal the friction comes back over a distance, not at once",
    memory=[
        EffectMemory("z", _bristle_rate, start=lambda e, p: 0.0, scale=lambda e, p: 1.0, step_s=5.0 * BUILDS_UP_S,
                     step=_bristle_step),
    ],
)  # fmt: skip
def presliding(s: Any, e: Any, p: Any) -> Scalar:
    """Friction that builds up over a small distance, as bristles bend, instead of jumping at a reversal."""
    return where(e.d > 0.0, clip(e.z, -1.0, 1.0) - s.switch, 0.0)


@effect(
    place={"axis-linear": "axis_force"}, subsystem="axis", regime="periodic",
    parameters=[
        amount("A", "amplitude_n", "of the force", "force", 0.3, 0.01, 0.02),
        Parameter("n", "waves_per_m", "waves per metre of travel", "1/length", 2.0, 400.0, 0.05, 5.0,
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
    """Cogging of a linear motor, or a screw's error: a wave of force along the travel."""
    return e.A * sin(2.0 * math.pi * e.n * s.x + e.phi)


def _through(v: Scalar, e: Any, p: Any) -> Scalar:
    """Force from flank to flank over the share of the inertia behind it: a stiff contact that only pushes."""
    sunk = e.q - clip(e.q, -0.5 * e.play, 0.5 * e.play)
    pushed = p.M * (CONTACT * CONTACT * sunk + 2.0 * CONTACT * (v - e.w))
    return where(sunk > 0.0, maximum(pushed, 0.0), where(sunk < 0.0, minimum(pushed, 0.0), 0.0))


def _within(e: Any) -> Scalar:
    """1 on the way from flank to flank, 0 in contact, whatever the last thousandths of the way do."""
    left = 1.0 - absolute(e.q) / (0.5 * e.play)
    return clip((left - 0.01) / 0.04, 0.0, 1.0)


def _load_behind(position: Scalar, e: Any, p: Any) -> Scalar:
    """The load over the share of the inertia that it pulls at."""
    return (p.G * sin(position) + p.C) / maximum(e.share, LEAST_SHARE)


def _lead_rate(s: Any, e: Any, p: Any) -> Scalar:
    load = _load_behind(_position(s), e, p)
    flank = where(load < 0.0, -0.5, 0.5) * e.play + load / (p.M * CONTACT * CONTACT)
    rate = where(s.t < SETTLES_S, (flank - e.q) * CONTACT, _speed(s) - e.w)
    return where(e.share > 0.0, rate, 0.0)


def _behind_rate(s: Any, e: Any, p: Any) -> Scalar:
    """The acceleration of what lies behind the play, where effects that rub the axis rub it, too."""
    v, x, own = _speed(s), _position(s), friction(e.w, p)
    rubs = own - s.rubbing(t=s.t, v=e.w, x=x, switch=switch(e.w, p), load=p.G * sin(x) + p.C, friction=own)
    resisting = e.rub * rubs + _load_behind(x - e.q, e, p)
    rate = where(s.t < SETTLES_S, (v - e.w) * CONTACT, (_through(v, e, p) - resisting) / p.M)
    return where(e.share > 0.0, rate, 0.0)


def _inertia(p: Any) -> float:
    return float(p.M)


def _lightness(p: Any) -> float:
    """By which friction stops what lies behind a play."""
    return 1.0 / float(p.M)


def _less_inertia(s: Any, e: Any, p: Any) -> Scalar:
    return -(e.share * p.M * _within(e))


@effect(
    place={"axis": "axis_force"}, subsystem="axis", regime="event",
    parameters=[
        amount(
            "share", "load_share", "of the inertia that lies behind the play, with all of the load", "1", 0.95, 2.0,
            0.5, tries=(0.3, 0.4, 0.5, 0.6, 0.7, 0.8), simplified=lambda e: FORETOLD * e.share, per=_inertia,
        ),
        # Little and large play look nothing alike: it is tried, and the share says whether there is any.
        Parameter("play", "play_{m}", "from flank to flank", "length", 1e-4, 0.1, 0.03, 0.003,
                  domain="positive", tries=PLAYS, simplified=lambda e: FORETOLD * e.play),
        Parameter("rub", "friction_over_load_share", "the friction behind the play, over the share of it", "1",
                  0.0, 3.0, 2.0, 0.0, domain="not_negative", tries=(0.0, 0.7, 1.0, 1.4),
                  simplified=lambda e: FORETOLD, per=_lightness),
    ],
    reads={"friction": "the axis' friction, {n}, without that of effects", "x": "position, {m}",
           "q": "its memory: motor before load, {m}", "w": "its memory: the load's speed, {m}/s"},
    equation="within the play M → (1 − share) M and F = share (rub friction + load/share);  q' = v − w;  "
    "M w' = T − rub friction(w) − load/share;  T: pushes beyond ±play/2, critically damped at 100 Hz;  friction: all "
    "that rubs the axis, effects too",
    reference="M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002",
    shows="after each reversal the motor moves without the load briefly; the impact at its end is left out",
    memory=[
        EffectMemory("q", _lead_rate, start=lambda e, p: where(p.C < 0.0, -0.5, 0.5) * e.play,
                     scale=lambda e, p: e.play),
        EffectMemory("w", _behind_rate, start=lambda e, p: 0.0, scale=lambda e, p: 0.1 * CONTACT * e.play),
    ],
    beside={"axis_inertia": _less_inertia},
)  # fmt: skip
def backlash(s: Any, e: Any, p: Any) -> Scalar:
    """Play in the drive: within it the motor moves without the inertia, friction and load that lie behind."""
    rubs = s.friction - s.rubbing(**{name: value for name, value in vars(s).items() if name != "rubbing"})
    return where(e.share > 0.0, e.share * _within(e) * (e.rub * rubs + _load_behind(s.x, e, p)), 0.0)
