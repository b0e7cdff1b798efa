"""Force laws of rollers and bearings, recorded as expressions that the engine evaluates within its own iteration.

The engine's convention: a connector's force acts on what moves, against a positive displacement or speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from workbench.machines import Hoist
from workbench.machines.multibody.exudyn_import import engine
from workbench.machines.multibody.switches import Switches

_SEAL = 1e-3  # of the roller's stiffness, which centres it within its play
_TOUCH_M = 2e-5  # of contact over which the damping grows: a force that jumps would stop the engine's iteration
ROLLERS = 4


@dataclass(frozen=True)
class Operations:
    """exp, cos, max and the choice between two numbers: of expressions or of plain floats."""

    exp: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    largest: Callable[[Any, Any], Any]
    choose: Callable[[Any, float, float], Any]


def _symbolic() -> Operations:
    es = engine().symbolic
    return Operations(
        es.exp,
        es.cos,
        lambda a, b: es.max(es.Real(a), b),
        lambda v, up, down: es.Real(up) if up == down else es.IfThenElse(v > 0, es.Real(up), es.Real(down)),
    )


_LARGEST = 700.0  # that exp of a float can take
PLAIN = Operations(lambda v: math.exp(min(v, _LARGEST)), math.cos, max, lambda v, up, down: up if v > 0.0 else down)


def guide_level(o: Operations, machine: Hoist, s: Switches, payload_n: float) -> Callable[[Any, Any, Any], Any]:
    """The guide's Coulomb level, N, of (speed m/s, carriage height m, campaign time s); roller friction apart."""
    guide = machine.guide

    def level(v: Any, x: Any, t: Any) -> Any:
        F = o.choose(v, guide.coulomb_hoisting_n, guide.coulomb_lowering_n)
        if s.drift:
            F = F * (1.0 + s.drift * o.exp(-t / s.drift_s))
        if s.level_up_n or s.level_down_n:
            F = F + o.choose(v, s.level_up_n, s.level_down_n)
        if s.peak_up_n or s.peak_down_n:
            F = F + o.choose(v, s.peak_up_n, s.peak_down_n) * o.exp(-(v * v) / s.stribeck_m_s**2)
        if s.load_fraction:
            F = F + s.load_fraction * payload_n
        if s.bell_n:
            off = (x - s.bell_m) / s.bell_width_m
            F = F + s.bell_n * o.exp(-0.5 * off * off)
        if s.rail_step_n:  # as steep in its middle as a ramp of its width
            F = F + s.rail_step_n / (1.0 + o.exp((s.rail_step_m - x) * (4.0 / s.rail_step_width_m)))
        if s.flat_n:
            F = F + 0.5 * s.flat_n * (1.0 + o.cos(x * (2.0 * math.pi / s.flat_period_m) + s.flat_rad))
        return o.largest(0.0, F)

    return level


def pin_law() -> Any:
    """Coulomb friction of level `offset`, linear in speed within +-`damping` (Eq. 13 of the paper)."""
    es = engine().symbolic

    def law(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):  # type: ignore[no-untyped-def]
        return offset * es.max(es.Real(-1.0), es.min(es.Real(1.0), velocity / damping))

    return law


def shaft_law() -> Any:
    """As `pin_law` with a tanh: on the quick shaft the corners of the other would stop the engine's iteration."""
    es = engine().symbolic

    def law(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):  # type: ignore[no-untyped-def]
        return offset * es.tanh(velocity / damping)

    return law


def roller_law(machine: Hoist, s: Switches, height_m: float, payload_n: float, clock_s: float) -> Any:
    """One roller in its rail: its normal force along x, and its share of the guide's friction along y.

    N = k δ + c δ' (with play: of what exceeds it, c growing over the first 20 µm of contact);
    friction = (Coulomb level/4 + μ |N|) (2/π) atan(slope v) + B v/4, the turn at standstill as in Eq. 17 of the
    paper. height_m: where displacement y is 0; clock_s: the campaign's time at t = 0. Bristles act on the dolly
    instead of the Coulomb part.
    """
    es, o = engine().symbolic, _symbolic()
    level_of = guide_level(o, machine, s, payload_n)

    def law(mbs, t, itemNumber, displacement, velocity, stiffness, damping, offset):  # type: ignore[no-untyped-def]
        gap, v = displacement[0], velocity[1]
        k, c = stiffness[0], damping[0]
        N = k * gap + c * velocity[0]
        if s.clearance_m:
            play = offset[0]  # clearance_m, once the machine hangs
            beyond = es.max(gap - play, es.Real(0.0)) + es.min(gap + play, es.Real(0.0))
            touches = _SEAL + es.min(es.Real(1.0), es.abs(beyond) * (1.0 / _TOUCH_M))
            N = k * (beyond + _SEAL * gap) + c * touches * velocity[0]
        along = es.Real(0.0)
        if not s.bristle_m:
            level = level_of(v, displacement[1] + height_m, t + clock_s) * (1.0 / ROLLERS)
            if s.roller_friction:
                level = level + s.roller_friction * es.abs(N)
            along = level * (2.0 / math.pi) * es.atan(machine.guide.atan_slope_s_per_m * v)
        if s.viscous_up or s.viscous_down:
            along = along + o.choose(v, s.viscous_up / ROLLERS, s.viscous_down / ROLLERS) * v
        if s.drag_n_s2_per_m2:
            along = along + (s.drag_n_s2_per_m2 / ROLLERS) * es.abs(v) * v
        return [N, along, es.Real(0.0)]

    return law
