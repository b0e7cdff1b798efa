"""Which campaigns to make: sources, families and effects each as often as the others, in an order that mixes them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.kind import Kind
from benchmarks.validation.sources import source_of
from workbench.blind.seal import CASES, MIXED, Order

EVENTS_EVERY = 3  # unlisted causes: one of them is a brief event
IDENTIFIED = ("no", "half", "yes")  # campaigns whose machine.yaml was identified first; half: every second of each case


def orders(
    seed: int,
    families: Mapping[str, Sequence[Family]],
    *,
    count: int = 0,
    counts: Mapping[str, int] | None = None,
    effects: Sequence[str] = (),
    sizes: tuple[float, float] = (1.0, 1.0),
    identified: str = "no",
) -> list[Order]:
    """families: source -> families that it plays. count: of all, with the shares of MIXED; counts: case -> number, in
    its place. effects: the only ones that are drawn, of those that a kind of machine has. sizes: between these, evenly
    on a logarithmic scale. identified: of IDENTIFIED.
    """
    rng = np.random.default_rng([seed, 0])
    cases = mixed_cases(count) if counts is None else [case for case in CASES for _ in range(counts.get(case, 0))]
    turns = {
        (source, family.name): _Turns(source_of(source).kind_of(family), family, rng, effects)
        for source, played in families.items()
        for family in played
    }
    wanted = []
    for case in CASES:
        able = {s: [f.name for f in played if turns[s, f.name].has(case)] for s, played in families.items()}
        sources = _in_turn(rng, tuple(source for source, names in able.items() if names))
        of_source = {source: _in_turn(rng, tuple(names)) for source, names in able.items() if names}
        for k in range(cases.count(case)):
            source = next(sources)
            family = next(of_source[source])
            first = identified == "yes" or (identified == "half" and k % 2 == 1)
            wanted.append((source, family, case, turns[source, family].effects(case), first))
    mixed = [wanted[k] for k in rng.permutation(len(wanted))]
    low, high = np.log(sizes)
    return [
        Order(n, (seed, n), source, family, case, names, float(np.exp(rng.uniform(low, high))), first)
        for n, (source, family, case, names, first) in enumerate(mixed, start=1)
    ]


def families_of(names: Sequence[str]) -> list[Family]:
    return [FAMILIES[name] for name in names]


class _Turns:
    """A family's effects, each as often as the others."""

    def __init__(self, kind: Kind, family: Family, rng: np.random.Generator, only: Sequence[str]) -> None:
        usual = tuple(name for name in kind.usual if not only or name in only)
        listed_too = tuple(name for name in kind.listed if name in only)  # what hardly shows, where it is asked for
        usual = tuple(dict.fromkeys([*usual, *listed_too]))
        favoured = tuple(name for name in family.favoured if not only or name in only)
        lasting = tuple(name for name in kind.unlisted if name not in kind.events)
        singles, firsts = _in_turn(rng, usual), _in_turn(rng, usual)
        unlisted, events = _in_turn(rng, lasting), _in_turn(rng, kind.events)
        liked = _in_turn(rng, favoured)
        unlisted_so_far, singles_so_far = itertools.count(), itertools.count()
        self._usual = usual

        def unknown() -> tuple[str, ...]:
            event = next(unlisted_so_far) % EVENTS_EVERY == 1 and kind.events
            return (next(events if event else unlisted),)

        def single() -> tuple[str, ...]:
            return (next(liked if favoured and next(singles_so_far) % 2 == 0 else singles),)

        def pair() -> tuple[str, ...]:
            return next(drawn for drawn in _pairs(kind, rng, firsts) if not only or set(drawn) <= {*only})

        trial = itertools.islice(_pairs(kind, np.random.default_rng(0), itertools.cycle(usual)), 20 * len(usual))
        self._pairs = bool(usual) and (not only or any(set(drawn) <= {*only} for drawn in trial))
        self._next: Mapping[str, Callable[[], tuple[str, ...]]] = {
            "none": tuple,
            "singles": single,
            "pairs": pair,
            "unknown": unknown,
        }

    def has(self, case: str) -> bool:
        return self._pairs if case == "pairs" else bool(self._usual) or case in ("none", "unknown")

    def effects(self, case: str) -> tuple[str, ...]:
        return self._next[case]()


def _pairs(kind: Kind, rng: np.random.Generator, firsts: Iterator[str]) -> Iterator[tuple[str, ...]]:
    for first in firsts:
        yield kind.pair(rng, first)


def mixed_cases(count: int) -> list[str]:
    """So many cases, with the shares of MIXED."""
    few = {case: round(share * count) for case, share in MIXED.items() if case != "singles"}
    return ["singles"] * (count - sum(few.values())) + [case for case, n in few.items() for _ in range(n)]


def _in_turn(rng: np.random.Generator, names: tuple[str, ...]) -> Iterator[str]:
    """All of them in a drawn order, again and again; nothing of none."""
    while names:
        yield from (names[k] for k in rng.permutation(len(names)))
