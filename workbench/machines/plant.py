"""What a plant is: the names of its states, and the pure functions that are its physics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from workbench.symbolic.expr import Scalar, Scalars, Signals

Piece = Callable[[Any, Any], Scalar]
Pieces = Mapping[str, Sequence[Piece]]


@dataclass(frozen=True)
class Memory:
    """A first-order state that an effect keeps: it stands behind the plant's speeds.

    rate(s, p): its derivative; s holds the time `t` and the plant's states by their names,
    p the parameters and, under `symbol`, the state itself. start(p): at standstill.
    scale(p): what the integration's tolerance is relative to, positive. step(s, s1, h, p): where it has a closed form,
    the state a time h later, from s to s1 the driven speed being linear in time, and nothing else moving.
    """

    symbol: str
    rate: Piece
    start: Callable[[Any], float]
    scale: Callable[[Any], float]
    step: Callable[[Any, Any, Scalar, Any], Scalar] | None = None


class Effects:
    """The unmodelled pieces that are switched on: at each place, the sum of what they add.

    `pieces` maps a place to functions of (signals, parameters); `parameters` are the
    symbols they need beside the plant's, `memory` the states they keep. The empty set adds
    exactly nothing: the traced plant is then the plain one, operation by operation.
    """

    def __init__(
        self, pieces: Pieces | None = None, parameters: Sequence[str] = (), memory: Sequence[Memory] = ()
    ) -> None:
        self.pieces = dict(pieces or {})
        self.parameters = tuple(parameters)
        self.memory = tuple(memory)

    def at(self, place: str, p: Any, **signals: Scalar) -> Scalar:
        total: Scalar = 0.0
        for piece in self.pieces.get(place, ()):
            total = total + piece(SimpleNamespace(**signals), p)
        return total

    def with_memory(self, p: Any, kept: Scalars) -> Any:
        """The parameters together with the memory's values, as pieces read them."""
        if not self.memory:
            return p
        return SimpleNamespace(**vars(p), **{m.symbol: z for m, z in zip(self.memory, kept, strict=True)})

    def rates(self, p: Any, **states: Scalar) -> list[Scalar]:
        """The derivatives of the memory; p as `with_memory` gives it."""
        return [m.rate(SimpleNamespace(**states), p) for m in self.memory]


NO_EFFECTS = Effects()


@dataclass(frozen=True)
class Output:
    """A signal that a plant shows: name with unit, and in words."""

    name: str
    meaning: str


@dataclass(frozen=True, eq=False)
class Plant:
    """A lumped machine with one driven coordinate, the first, and one input acting on it.

    positions, speeds: the states; the derivative of positions[i] is speeds[i].
    parameters: the symbol in the equations -> the key in machine.yaml, or a fixed number.
    places: where effects may add -> what is added there. Always summed, zero where nothing is there.
    accelerations(t, q, y, u, p, effects): y' for positions q, speeds y, input u.
    outputs(t, q, y, u, p, effects): name -> value, every signal named in `signals`.
    equilibrium(height, p): positions hanging still there, and the input that holds it.
    placed: the position that says where the machine is, the one `equilibrium` is given.
    start_of(height, speed, p): positions, speeds and holding input of an even motion.
    guess: as start_of, without branches, near enough for Newton's method; None where start_of itself can be traced.
    band_hz(p): up to which frequency the balance of forces is worth comparing.
    energy(q, y, p) and dissipation(t, q, y, u, p): J and W, for the balance
    input power = d energy/dt + dissipation.
    """

    kind: str
    positions: tuple[str, ...]
    speeds: tuple[str, ...]
    input: str
    parameters: Mapping[str, str | float]
    places: Mapping[str, str]
    signals: tuple[Output, ...]
    accelerations: Callable[..., Scalars]
    outputs: Callable[..., Signals]
    equilibrium: Callable[[float, Any], tuple[list[float], float]]
    energy: Callable[..., Scalar]
    dissipation: Callable[..., Scalar]
    start_of: Callable[..., tuple[list[float], list[float], float]]
    band_hz: Callable[[Any], float]
    placed: int = 0
    guess: Callable[..., tuple[list[Any], list[Any], Any]] | None = None

    def rates(self, t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Scalars:
        """The derivatives of speeds and memory; y holds the speeds, then the effects' memory.

        ValueError for an effect at a place that this plant does not have.
        """
        for place in effects.pieces:
            if place not in self.places:
                raise ValueError(f"no place '{place}' for an effect of {self.kind}; places: {', '.join(self.places)}")
        n = len(self.speeds)
        p = effects.with_memory(p, y[n:])
        states = dict(zip((*self.positions, *self.speeds), (*q, *y[:n]), strict=True))
        return [*self.accelerations(t, q, y[:n], u, p, effects), *effects.rates(p, t=t, **states)]

    def shown(self, t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Signals:
        """`outputs` for a y that holds the effects' memory behind the speeds."""
        n = len(self.speeds)
        return self.outputs(t, q, y[:n], u, effects.with_memory(p, y[n:]), effects)

    def values(self, machine: Any, payload_kg: float = 0.0) -> SimpleNamespace:
        """The parameters of one scenario as numbers, by symbol."""
        return SimpleNamespace(**{s: _value(machine, key, payload_kg) for s, key in self.parameters.items()})


def _value(machine: Any, key: str | float, payload_kg: float) -> float:
    if isinstance(key, float):
        return key
    return float(payload_kg if key == "payload_kg" else _reader(key)(machine))


@cache
def _reader(key: str) -> Callable[[Any], float]:
    """Reads a dotted key of a machine; ten times faster than a look-up by name, and there are thousands."""
    return attrgetter(key)
