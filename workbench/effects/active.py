"""Effects at work: which ones with which values, as the plant, its kernels and the sensors take them.

Kernels are not made per combination: one holds the whole library, and what is not chosen is
at the value where it vanishes; two hold a part of it, and are quicker. A user's effects make more, library and
theirs together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.errors import InputError, check_known, nearest
from workbench.core.run import Array, Run
from workbench.effects.declare import Effect, EffectMemory, Ranged
from workbench.effects.registry import effects_for, find, library_effects, library_for
from workbench.machines import KINDS, NO_EFFECTS, PLANTS, Effects, Machine, Memory, Sizes, get_value, kind_of, plant_of
from workbench.machines.correction import correction_of
from workbench.symbolic.expr import Scalar

# What a run says beside its machine: when it began, so that effects may count from the campaign's start.
RUN_SYMBOLS = ("start_time_s",)
Chosen = Mapping[str, Mapping[str, float]]
WAVES = 1.2  # along the way, at least


@dataclass(frozen=True)
class Active:
    """What is switched on: the pieces in the plant, the numbers by symbol, and what the sensors do.

    Falsy where nothing is: the plant is then the plain one, with the plain kernels.
    """

    kind: str
    effects: Effects = NO_EFFECTS
    values: Mapping[str, float] = field(default_factory=dict)
    sensors: tuple[Effect, ...] = ()
    of_runs: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # run -> symbol -> its own value

    def __bool__(self) -> bool:
        return self.effects is not NO_EFFECTS or bool(self.sensors)

    def values_of(self, start_time_s: float, run: str = "") -> dict[str, float]:
        """The numbers of one run, which began at that time of its campaign, at its time 0."""
        values = {**self.values, **self.of_runs.get(run, {})}
        return {**values, RUN_SYMBOLS[0]: start_time_s} if self.effects is not NO_EFFECTS else values


@dataclass(frozen=True)
class Part:
    """A part of what is searched, for kernels that compute less: `effects` without those whose amounts are in `off`,
    symbol -> the value at which each vanishes. Where all amounts are there, results are those of the whole."""

    effects: Effects
    off: Mapping[str, float]


@dataclass(frozen=True)
class Alone:
    """The chosen effects in the plant, and no others; sensors_left_out: names of those on the log's sensors."""

    effects: Effects
    values: Mapping[str, float]
    chosen: tuple[Effect, ...]
    sensors_left_out: tuple[str, ...]


def at_work(machine: Machine) -> Mapping[str, Mapping[str, float]]:
    """Effect -> its parameters, of everything that machine.yaml puts to work: effects, allowances, the lateness of the
    log (a delay of the speed sensor beside the machine's own)."""
    late = machine.log.speed_late_s
    wanted = {**machine.allowances, **machine.effects}
    if late > 0.0:
        known = wanted.get("speed_delay", {})
        wanted["speed_delay"] = {**known, "delay_s": known.get("delay_s", 0.0) + late}
    return wanted


def longest_step_s(machine: Machine, chosen: Chosen | None = None) -> float:
    """The longest fixed step, s, that follows the machine and what its effects and the chosen ones keep."""
    effects = (find(name, plant_of(machine).kind) for name in {**at_work(machine), **(chosen or {})})
    own = kind_of(machine).longest_step_s(machine)
    return min([own, *(state.step_s for effect in effects for state in effect.memory)])


def of(machine: Machine, chosen: Chosen | None = None, *, place: str = "effects") -> Active:
    """The machine's own effects, `chosen` ones (a scenario's, a candidate's) in place of or beside them.

    The machine's measured correction is at work too, here and in `searchable`: it is no effect, but what
    stands in for an unknown one.
    InputError for an unknown effect or parameter, with the nearest name, for an impossible
    value, and for an effect whose size is not said.
    """
    kind, wanted = plant_of(machine).kind, {**at_work(machine), **(chosen or {})}
    if not wanted:
        return _made(machine, ())
    sizes = sizes_of(machine)
    effects = {name: find(name, kind) for name in wanted}
    values: dict[str, float] = {}
    for name, effect in effects.items():
        values |= _numbers(effect, wanted[name], sizes, place)
    of_runs: dict[str, dict[str, float]] = {}
    for run, own_of_effect in machine.log.of_runs.items():
        for name, own in own_of_effect.items():
            if name not in effects:
                raise InputError(f"{name} is no effect of this machine; {nearest(name, wanted)}", place="log.of_runs")
            numbers = _numbers(effects[name], {**wanted[name], **own}, sizes, place)
            symbols = {r.name: r.symbol for r in effects[name].ranges(sizes)}
            of_runs.setdefault(run, {}).update({symbols[parameter]: numbers[symbols[parameter]] for parameter in own})
    sensors = tuple(e for e in effects_for(kind).values() if e.on_sensor and e in effects.values())
    in_plant = {effect.id for effect in effects.values() if not effect.on_sensor}
    held: tuple[Effect, ...] = ()
    if in_plant:
        library = tuple(effect for effect in library_for(kind) if not effect.on_sensor)
        held = library if in_plant <= {effect.id for effect in library_effects()} else _in_plant(kind)
        held = next(f for f in _families(kind, held) if in_plant <= {effect.id for effect in f})
    return _made(machine, held, _vanished(held, sizes) | values, sensors, of_runs)


def alone(machine: Machine, chosen: Chosen | None = None) -> Alone:
    """As `of`, but without the rest of the library at its vanishing values: for a model that stays as it is."""
    kind, whole = plant_of(machine).kind, of(machine, chosen)
    wanted = (find(name, kind) for name in {**at_work(machine), **(chosen or {})})
    in_plant = tuple(effect for effect in wanted if not effect.on_sensor)
    made = _made(machine, in_plant, {name: whole.values[name] for name in _vanished(in_plant, sizes_of(machine))})
    return Alone(made.effects, made.values, in_plant, tuple(effect.id for effect in whole.sensors))


def searchable(machine: Machine, runs: Sequence[Run] = ()) -> Active:
    """Everything that is known, sensors too, at the machine's own values or else vanished: for a search."""
    kind = plant_of(machine).kind
    everything = tuple(effects_for(kind).values())
    values = {**_vanished(everything, sizes_of(machine, runs)), **of(machine).values}
    return _made(machine, _in_plant(kind), values, tuple(effect for effect in everything if effect.on_sensor))


def _made(
    machine: Machine,
    in_plant: tuple[Effect, ...],
    values: Mapping[str, float] | None = None,
    sensors: tuple[Effect, ...] = (),
    of_runs: Mapping[str, Mapping[str, float]] | None = None,
) -> Active:
    """Effects at work, with the machine's measured correction beside them."""
    kind, numbers = kind_of(machine), dict(values or {})
    effects = compiled(kind.name, in_plant) if in_plant else NO_EFFECTS
    correction = correction_of(machine, kind)
    if correction is not None:
        effects, numbers = joined(effects, correction[0]), {**numbers, **correction[1]}
    return Active(kind.name, effects, MappingProxyType(numbers), sensors, of_runs or {})


def parts(machine: Machine, runs: Sequence[Run] = ()) -> tuple[Part, ...]:
    """Parts of what `searchable` holds, the smallest first; see `_families`."""
    kind, sizes = plant_of(machine).kind, sizes_of(machine, runs)
    everything = _in_plant(kind)
    made = []
    for kept in _families(kind, everything)[:-1]:
        off = {k: v for effect in everything if effect not in kept for k, v in _amounts(effect, sizes).items()}
        made.append(Part(_made(machine, kept).effects, MappingProxyType(off)))
    return tuple(made)


@cache
def _families(kind: str, effects: tuple[Effect, ...]) -> tuple[tuple[Effect, ...], ...]:
    """Of effects in the plant, the smallest first: what is linear in its amounts, with the traces that every machine of
    the kind has; these and all that is a force or a torque and keeps no state; these and all that keeps one; these and
    all that is neither; these and all that keeps none; all."""
    traces = {trace.effect for trace in KINDS[kind].nuisances if trace.fitted}
    places = {port.place for port in KINDS[kind].ports.values()}

    def linear(effect: Effect) -> bool:
        vanish = [parameter.vanishes_at is not None for parameter in effect.parameters]
        return effect.id in traces or (not effect.memory and all(vanish)) or not any(vanish)

    first = tuple(effect for effect in effects if linear(effect))
    memory = [effect for effect in effects if effect.memory]
    forces = [effect for effect in effects if effect.place_on(kind) in places and effect not in memory]
    others = [effect for effect in effects if effect not in (*memory, *forces)]
    beside: Sequence[Sequence[Effect]] = [], forces, memory, others, [*forces, *others]
    return *(tuple(effect for effect in effects if effect in first or effect in more) for more in beside), effects


def idle_sensors(machine: Machine, runs: Sequence[Run] = ()) -> Mapping[str, float]:
    """symbol -> the value at which it vanishes, of the amounts of all effects on the sensor of torque (force)."""
    kind, sizes = kind_of(machine).name, sizes_of(machine, runs)
    on_torque = [effect for effect in effects_for(kind).values() if effect.place_on(kind) == "torque_sensor"]
    return {symbol: value for effect in on_torque for symbol, value in _amounts(effect, sizes).items()}


def _amounts(effect: Effect, sizes: Sizes) -> dict[str, float]:
    """symbol -> the value at which it vanishes, of what has one."""
    return {amount.symbol: amount.vanishes_at for amount in effect.ranges(sizes) if amount.vanishes_at is not None}


def check(machine: Machine) -> None:
    """InputError where the machine's effects are not as they should be; for `load_machine`."""
    of(machine)


def _numbers(effect: Effect, given: Mapping[str, float], sizes: Sizes, place: str) -> dict[str, float]:
    """symbol -> value; what is not given starts as declared, a size that is not given vanishes."""
    ranges = effect.ranges(sizes)
    known = [ranged.name for ranged in ranges]
    for name, value in given.items():
        check_known(f"effect '{effect.id}' has no parameter", name, known, place=f"{place}.{effect.id}.{name}")
        effect.check(name, value, sizes.kind)
    amounts = [ranged.name for ranged in ranges if ranged.vanishes_at is not None]
    if not any(name in given for name in amounts):
        raise InputError(f"says no size; expected {' or '.join(amounts)}", place=f"{place}.{effect.id}")
    return {ranged.symbol: float(given.get(ranged.name, _unsaid(ranged))) for ranged in ranges}


def _unsaid(ranged: Ranged) -> float:
    return ranged.start if ranged.vanishes_at is None else ranged.vanishes_at


def _vanished(effects: Iterable[Effect], sizes: Sizes) -> dict[str, float]:
    """symbol -> value of effects that are exactly off."""
    return {ranged.symbol: _unsaid(ranged) for effect in effects for ranged in effect.ranges(sizes)}


def _in_plant(kind: str) -> tuple[Effect, ...]:
    """All known effects but those on sensors, users' ones among them."""
    return tuple(effect for effect in effects_for(kind).values() if not effect.on_sensor)


@cache
def compiled(kind: str, effects: tuple[Effect, ...]) -> Effects:
    """The pieces of several effects in the plant; one object for one set, for kernels are found by it."""
    pieces: dict[str, list[Callable[[Any, Any], Scalar]]] = {}
    for effect in effects:
        for place, function in {effect.place_on(kind): effect.function, **effect.beside}.items():
            pieces.setdefault(place, []).append(partial(_piece, effect, function, kind, effects))
    symbols = [effect.symbol(parameter, kind) for effect in effects for parameter in effect.parameters]
    memory = [_memory(effect, state, kind, effects) for effect in effects for state in effect.memory]
    return Effects(pieces, (*symbols, *RUN_SYMBOLS), memory)


@cache
def joined(first: Effects, second: Effects) -> Effects:
    """Two sets of pieces as one."""
    if first is NO_EFFECTS or second is NO_EFFECTS:
        return second if first is NO_EFFECTS else first
    places = dict.fromkeys([*first.pieces, *second.pieces])
    return Effects(
        {place: [*first.pieces.get(place, ()), *second.pieces.get(place, ())] for place in places},
        tuple(dict.fromkeys((*first.parameters, *second.parameters))),
        (*first.memory, *second.memory),
    )


def _piece(
    effect: Effect, function: Callable[[Any, Any, Any], Any], kind: str, effects: tuple[Effect, ...], s: Any, p: Any
) -> Scalar:
    return function(_rubbed(effect, kind, effects, s, p), effect.own(p, kind), p)


def _rubbed(effect: Effect, kind: str, effects: tuple[Effect, ...], s: Any, p: Any) -> Any:
    """The signals of an effect that keeps a state, and `rubbing`: what all effects that only take energy, at its place,
    add under other signals than the place's own, as where a part moves by itself."""
    if not effect.memory:
        return s
    place = effect.place_on(kind)
    others = [other for other in effects if other.dissipative and other.listed and other.place_on(kind) == place]

    def rubbing(**signals: Scalar) -> Scalar:
        at = SimpleNamespace(**signals)
        return sum((other.function(at, other.own(p, kind), p) for other in others), 0.0)

    return SimpleNamespace(**vars(s), rubbing=rubbing)


def _step(step: Callable[..., Scalar], own: Callable[[Any], Any], s: Any, s1: Any, h: Scalar, p: Any) -> Scalar:
    return step(s, s1, h, own(p), p)


def _memory(effect: Effect, memory: EffectMemory, kind: str, effects: tuple[Effect, ...]) -> Memory:
    def own(p: Any) -> SimpleNamespace:
        return effect.own(p, kind)

    return Memory(
        effect.memory_symbol(memory),
        rate=lambda s, p: memory.rate(_rubbed(effect, kind, effects, s, p), own(p), p),
        start=lambda p: memory.start(own(p), p),
        scale=lambda p: memory.scale(own(p), p),
        step=memory.step and partial(_step, memory.step, own),
    )


def ranges_of(effect: Effect, machine: Machine, runs: Sequence[Run] = ()) -> tuple[Ranged, ...]:
    """The effect's parameters on this machine: names, symbols, bounds, scales, starts in SI."""
    return tuple(_on_machine(ranged, machine, runs) for ranged in effect.ranges(sizes_of(machine, runs)))


def sizes_of(machine: Machine, runs: Sequence[Run] = ()) -> Sizes:
    """A machine's sizes; one that says little about its own asks its runs, where there are any."""
    return kind_of(machine).sizes(machine, runs)


def _on_machine(r: Ranged, machine: Machine, runs: Sequence[Run]) -> Ranged:
    """Where the log says where a machine is, its zero may lie anywhere: a place along its way is looked for where
    its runs have been. A stretch of width b is at least half as wide as the way d between two samples, which show it to
    2 exp(-2 (pi b/d)^2), by Poisson's sum; a narrower one is what single samples are off. A wave is one that comes
    again on that way: of less than WAVES, nobody can say so; and it has one phase in all runs that log where they are.
    What is on top of a level of the machine's own takes off that level at most.
    """
    kind = kind_of(machine)
    if r.on_levels:
        keys = {symbol: key for key, symbol in kind.symbols.items()}
        levels = [float(get_value(machine, keys[kind.friction.levels[way]])) for way in r.on_levels]
        return replace(r, lowest=max(r.lowest, -min(levels)))
    if r.per is not None:
        return replace(
            r, nominal=tuple((symbol, float(get_value(machine, key))) for key, symbol in kind.symbols.items())
        )
    if r.scan not in ("position", "width", "order", "phase") or not kind.moved.placed_by_log:
        return r
    position = kind.plant.positions[kind.plant.placed]
    been = [run[position] for run in runs if position in run]
    if r.scan == "width":
        apart = max((run.sample_time_s for run in runs), default=0.0) * sizes_of(machine, runs).speed
        wider, least = max(apart / r.tries[0], 1.0), min(max(r.lowest, 0.5 * apart), r.highest)
        tries = tuple(dict.fromkeys(min(wider * width, r.highest) for width in r.tries))
        return replace(r, lowest=least, start=min(wider * r.start, r.highest), tries=tries)
    if r.scan == "phase":
        return replace(r, per_run=r.per_run and (len(been) < len(runs) or not runs))
    low, high = min(map(np.min, been), default=0.0), max(map(np.max, been), default=0.0)
    if not high > low:
        return r
    if r.scan == "order":
        least = min(max(r.lowest, WAVES * 2.0 * math.pi / float(high - low)), r.highest)
        tries = tuple(order for order in r.tries if order >= least) or (least,)
        return replace(r, lowest=least, start=max(r.start, least), tries=tries)
    return replace(r, lowest=float(low - 0.1 * (high - low)), highest=float(high + 0.1 * (high - low)))


def _through(
    place: str, back: bool, active: Active, time_s: Array, series: Array, values: Mapping[str, float] | None = None
) -> Array:
    """A series (n,) through the effects on a sensor, or back to what is behind them; `values` by symbol where not the
    active ones."""
    p = SimpleNamespace(**(active.values if values is None else {**active.values, **values}))
    effects = _at(active, place)
    for effect in reversed(effects) if back else effects:
        function = effect.inverse if back else effect.function
        assert function is not None  # declarations of sensors have both
        series = function(SimpleNamespace(time_s=time_s, value=series), effect.own(p, active.kind), p)
    return series


# The logged torque (force) for a true one and the true one behind a log; likewise speed, angle or position of the
# driven coordinate.
logged_input, true_input = (partial(_through, "torque_sensor", back) for back in (False, True))
logged_motion, true_motion = (partial(_through, "speed_sensor", back) for back in (False, True))


def logged(run: Run, active: Active) -> Run:
    """The run as the machine's log shows it: its true signals through the sensors' effects."""
    if not active.sensors:
        return run
    plant, signals = PLANTS[active.kind], dict(run.signals)
    if plant.input in signals:
        before = signals[plant.input]
        after = signals[plant.input] = logged_input(active, run.time_s, before)
        parts = [name for name in KINDS[active.kind].drive.parts if name in signals]
        for part in parts:  # the sum is what is off; it is shared evenly
            signals[part] = signals[part] + (after - before) / len(parts)
    for name in (plant.positions[0], plant.speeds[0]):
        if name in signals:
            signals[name] = logged_motion(active, run.time_s, signals[name])
    return replace(run, signals=signals)


def moved_by(active: Active) -> tuple[str, ...]:
    """The symbols of which the motion behind a log depends: those of the speed sensor's effects."""
    effects = _at(active, "speed_sensor")
    return tuple(effect.symbol(parameter, active.kind) for effect in effects for parameter in effect.parameters)


def _at(active: Active, place: str) -> list[Effect]:
    return [effect for effect in active.sensors if effect.place_on(active.kind) == place]
