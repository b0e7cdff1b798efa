"""What an effect is: its function, and beside it everything that others need to know of it.

    @effect(
        place={"hoist": "guide_force_n", "axis": "axis_force"},
        subsystem={"hoist": "guide", "axis": "axis"},
        regime="speed",
        parameters=[
            Parameter("B", "viscous_{n}_s_per_{m}", "slope", "force/speed", 0.0, 1.0, scale=0.02, start=0.03,
                      vanishes_at=0.0)
        ],
        reads={"v": "speed, {m}/s"},
        equation="F = −B v",
        reference="...", shows="...", dissipative=True,
    )
    def friction_viscous(s, e, p):
        '''Friction in proportion to the speed.'''
        return -(e.B * s.v)

The function's name is the effect's id and its docstring what it is. s holds the signals at
the place, e the effect's own parameters by symbol, p those of the plant. It is pure and
traceable (`workbench.symbolic.expr`), without branches, and exactly zero at the vanishing values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Any, Literal

from workbench.core.errors import InputError, nearest
from workbench.machines import KINDS, PLACES, Sizes
from workbench.machines.declare import UNIT_SIZES
from workbench.symbolic.expr import Scalar

SENSOR_PLACES: Mapping[str, str] = {
    "torque_sensor": "the logged torque or force: f(true) of a whole series",
    "speed_sensor": "the logged motion of the driven coordinate: f(true) of a whole series",
}
SUBSYSTEMS = (
    "motor", "gearbox", "brake", "drum", "wire", "sheave", "guide", "payload", "platform",
    "torque_sensor", "speed_sensor", "axis",
)  # fmt: skip
REGIMES = ("speed", "low_speed", "acceleration", "load", "position", "time", "start", "periodic", "event", "all")


def words(kind: str) -> Mapping[str, str]:
    """What the placeholders in names stand for, on a kind of plant."""
    return KINDS[kind].words


Domain = Literal["any", "not_negative", "positive"]
Scan = Literal["", "position", "width", "drum_angle", "phase", "frequency", "waves", "period", "order"]
INEXACT = 0.06  # of a value: one standard deviation of what a simple law near standstill, or of a wire, is off
DOMAINS: Mapping[str, tuple[Callable[[float], bool], str]] = {
    "any": (lambda value: True, "a number"),
    "not_negative": (lambda value: value >= 0.0, "at least 0"),
    "positive": (lambda value: value > 0.0, "more than 0"),
}


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    symbol: as the function reads it. name: with its unit, as YAML has it; {n}, {m}, {input},
    {up}, {dn} stand for the plant's own words. lowest, highest (of a fit), scale and start are
    in units of `size`, a quotient of the machine's sizes ("force/speed"; "1" for plain
    numbers), so that they fit a machine of any size. vanishes_at: the value, in the same unit,
    at which the effect is exactly off; None for what has no such value (a width, a phase).
    per_run: every run has its own. domain: what a value has to be at all.
    scan: how a search tries a shape (what has no vanishing value) before it refines it: as a
    place that the runs have passed (position, drum_angle), as a phase of the amplitude beside
    it, as a frequency, as waves along the way, as finely as the runs resolve it; as a period of friction along the way,
    of the residual's loudest; as an order (`tries`, of which the
    way has to show more than one wave, and the residual's loudest); as a width on the way that the samples show at any
    speed; "": `tries` (in `size`), or some values from lowest to highest.
    simplified: one standard deviation, in the unit of the name, by which the fitted value may be off because the law
    simplifies what a machine does: a function of e, the effect's values. No run shows it, for all runs have it alike.
    on_levels: which of the machine's Coulomb levels it is on top of, 0 the forward, 1 the backward one: it takes off
    no more than there is, for friction does not drive.
    per: of the machine's values p, what a share is of: a fit holds the product while these move, for a cause that takes
    over what one of them took leaves it as it is. nominal: these values on one machine, by symbol.
    """

    symbol: str
    name: str
    meaning: str
    size: str
    lowest: float
    highest: float
    scale: float
    start: float
    vanishes_at: float | None = None
    per_run: bool = False
    domain: Domain = "any"
    scan: Scan = ""
    tries: tuple[float, ...] = ()
    simplified: Callable[[Any], float] | None = None
    on_levels: tuple[int, ...] = ()
    per: Callable[[Any], float] | None = None
    nominal: tuple[tuple[str, float], ...] = ()

    def named(self, kind: str) -> str:
        return self.name.format(**words(kind))


Ranged = Parameter  # on one machine: named, its symbol among the plant's parameters, numbers in the unit of its name


def amount(
    symbol: str, name: str, meaning: str, size: str, highest: float, scale: float, start: float, **more: Any
) -> Parameter:
    """A parameter that says how large an effect is: at least 0, and off at 0."""
    more = {"vanishes_at": 0.0, "domain": "not_negative", **more}
    return Parameter(symbol, name, meaning, size, 0.0, highest, scale, start, **more)


@dataclass(frozen=True)
class EffectMemory:
    """The state of an effect, `symbol` in its e; `rate`, `start`, `scale`, `step` as `plants.Memory`, with e before p.
    step_s: the longest of fixed steps that can follow it, s."""

    symbol: str
    rate: Callable[[Any, Any, Any], Scalar]
    start: Callable[[Any, Any], float]
    scale: Callable[[Any, Any], float]
    step_s: float = math.inf
    step: Callable[[Any, Any, Scalar, Any, Any], Scalar] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Effect:
    """A piece of physics that a nominal machine does not know.

    place, subsystem_of: by kind of machine: hoist, axis (both motions), axis-linear, axis-rotary.
    regime: when it shows. reads: the signals at the place that it reads, with units.
    dissipative: for values at or above the vanishing ones it takes energy only. listed: its
    name is one that a diagnosis may give without being asked for it. inverse: of an effect on
    a sensor, from the logged series to the true one. memory: states of its own. beside: what it adds at other places
    of the same plants, by place.
    """

    id: str
    meaning: str
    place: Mapping[str, str]
    subsystem_of: Mapping[str, str]
    regime: str
    parameters: tuple[Parameter, ...]
    equation: str
    reference: str
    shows: str
    function: Callable[[Any, Any, Any], Any]
    reads: Mapping[str, str] = field(default_factory=dict)
    dissipative: bool = False
    listed: bool = True
    inverse: Callable[[Any, Any, Any], Any] | None = None
    memory: tuple[EffectMemory, ...] = ()
    beside: Mapping[str, Callable[[Any, Any, Any], Any]] = field(default_factory=dict)

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of plant it is for."""
        return tuple(kind for kind in KINDS if _of_kind(self.place, kind) is not None)

    def nearness(self, kind: str) -> int:
        """How near its declaration is to a kind of plant: 0 under the kind's own name, more under a family's."""
        return next(rank for rank, name in enumerate(KINDS[kind].family) if name in self.place)

    def place_on(self, kind: str) -> str:
        return _place(self, kind)

    def subsystem(self, kind: str) -> str:
        return str(_of_kind(self.subsystem_of, kind))

    @property
    def on_sensor(self) -> bool:
        return all(place in SENSOR_PLACES for place in self.place.values())

    def symbol(self, parameter: Parameter, kind: str) -> str:
        """The parameter's name in kernels and among the plant's parameters."""
        return f"{self.id}__{parameter.named(kind)}"

    def own(self, p: Any, kind: str) -> SimpleNamespace:
        """e: the effect's parameters, and its memory, out of the plant's."""
        e = {short: getattr(p, symbol) for short, symbol in _symbols(self, kind)}
        for each in self.memory:
            if hasattr(p, self.memory_symbol(each)):
                e[each.symbol] = getattr(p, self.memory_symbol(each))
        return SimpleNamespace(**e)

    def memory_symbol(self, each: EffectMemory) -> str:
        """What a state of its own is called among the plant's parameters."""
        return f"{self.id}__memory_{each.symbol}"

    def ranges(self, sizes: Sizes) -> tuple[Ranged, ...]:
        """Its parameters on one machine."""
        return tuple(self._on(parameter, sizes.kind, sizes[parameter.size]) for parameter in self.parameters)

    def _on(self, parameter: Parameter, kind: str, unit: float) -> Ranged:
        return replace(
            parameter,
            name=parameter.named(kind),
            symbol=self.symbol(parameter, kind),
            size="1",
            lowest=parameter.lowest * unit,
            highest=parameter.highest * unit,
            scale=parameter.scale * unit,
            start=parameter.start * unit,
            vanishes_at=None if parameter.vanishes_at is None else parameter.vanishes_at * unit,
            tries=tuple(value * unit for value in parameter.tries),
        )

    def check(self, name: str, value: float, kind: str) -> None:
        """InputError where a value is impossible for the parameter of that name."""
        parameter = next(known for known in self.parameters if known.named(kind) == name)
        fits, expected = DOMAINS[parameter.domain]
        if not fits(value):
            raise InputError(f"{value:g}, expected {expected}", place=f"effects.{self.id}.{name}")


def effect(
    *, place: Mapping[str, str], subsystem: str | Mapping[str, str], parameters: Sequence[Parameter], **declared: Any
) -> Callable[[Callable[[Any, Any, Any], Any]], Effect]:
    """Declares the function beneath as an effect: its name is the id, its docstring the meaning; fields as of `Effect`.

    ValueError for a declaration that does not fit together.
    """

    def declare(function: Callable[[Any, Any, Any], Any]) -> Effect:
        name = str(getattr(function, "__name__", ""))
        made = Effect(
            id=name,
            meaning=re.sub(r"\s+", " ", (function.__doc__ or "").strip()),
            place=dict(place),
            subsystem_of=dict.fromkeys(place, subsystem) if isinstance(subsystem, str) else dict(subsystem),
            parameters=tuple(parameters),
            function=function,
            **declared,
        )
        for problem in problems(made):
            raise ValueError(f"effect {name}: {problem}")
        return made

    return declare


def problems(made: Effect) -> list[str]:
    """What is wrong with a declaration, in words: what it names has to exist, and its numbers to make sense."""
    places, families = {**PLACES, **SENSOR_PLACES}, {name for kind in KINDS.values() for name in kind.family}
    faults = [f"{what} is empty" for what in ("meaning", "equation", "reference", "shows") if not getattr(made, what)]
    faults += [f"no kind '{kind}'; {nearest(kind, families)}" for kind in made.place if kind not in families]
    named = [*made.place.values(), *made.beside]
    faults += [f"no place '{place}'; {nearest(place, places)}" for place in named if place not in places]
    subsystems = dict.fromkeys(made.subsystem_of.values())
    faults += [f"no subsystem '{of}'; {nearest(of, SUBSYSTEMS)}" for of in subsystems if of not in SUBSYSTEMS]
    if made.regime not in REGIMES:
        faults.append(f"no regime '{made.regime}'; {nearest(made.regime, REGIMES)}")
    if all(parameter.vanishes_at is None for parameter in made.parameters):
        faults.append("no parameter has a value at which it vanishes")
    if made.on_sensor and made.inverse is None:
        faults.append("an effect on a sensor needs its inverse")
    return [*faults, *(f"{p.name}: {fault}" for p in made.parameters for fault in _faults_of(p, made.kinds))]


def _faults_of(p: Parameter, kinds: Sequence[str]) -> list[str]:
    """Of one parameter."""
    faults = []
    try:
        UNIT_SIZES[p.size]
    except KeyError as error:
        faults.append(str(error.args[0]))
    try:
        for kind in kinds:
            p.named(kind)
    except (KeyError, IndexError, ValueError) as error:
        faults.append(f"{error} is no word of a name; expected {', '.join('{' + w + '}' for w in words(kinds[0]))}")
    if not p.lowest <= p.start <= p.highest:
        faults.append(f"starts at {p.start:g}, outside {p.lowest:g} to {p.highest:g}")
    if p.vanishes_at is not None and not p.lowest <= p.vanishes_at <= p.highest:
        faults.append(f"vanishes at {p.vanishes_at:g}, outside {p.lowest:g} to {p.highest:g}")
    if not p.scale > 0.0:
        faults.append(f"scale {p.scale:g}, expected more than 0")
    if p.domain not in DOMAINS:
        faults.append(f"no domain '{p.domain}'; {nearest(p.domain, DOMAINS)}")
    return faults


# A fit asks thousands of times for these two.
@cache
def _place(effect: Effect, kind: str) -> str:
    return str(_of_kind(effect.place, kind))


@cache
def _symbols(effect: Effect, kind: str) -> tuple[tuple[str, str], ...]:
    """Of each parameter: its symbol in the effect's function, and among the plant's parameters."""
    return tuple((parameter.symbol, effect.symbol(parameter, kind)) for parameter in effect.parameters)


def _of_kind(by_kind: Mapping[str, str], kind: str) -> str | None:
    """What stands for a kind of plant: under its own name, or under that of a family it belongs to."""
    return next((by_kind[name] for name in KINDS[kind].family if name in by_kind), None)
