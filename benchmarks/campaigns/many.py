"""Many campaigns of several families, in two processes; what is there already stays."""

from __future__ import annotations

import itertools
import multiprocessing
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.campaigns.campaign import Label, make_campaign
from benchmarks.campaigns.content import CASES, MIXED, draw
from benchmarks.campaigns.families import FAMILIES
from benchmarks.campaigns.kinds import kind_of
from benchmarks.campaigns.size import input_change

EVENTS_EVERY = 3  # unlisted causes: one of them is a brief event


@dataclass(frozen=True)
class Order:
    """One campaign to make: its number, seed, family, case and effects."""

    out: Path
    number: int
    seed: tuple[int, int]
    family: str
    case: str
    names: tuple[str, ...]

    @property
    def name(self) -> str:
        return f"{self.number:03d}"

    @property
    def folder(self) -> Path:
        return self.out / self.name

    @property
    def label(self) -> Path:
        return self.out / "labels" / f"{self.name}.json"


def orders(
    out: Path, seed: int, families: Sequence[str], *, count: int = 0, counts: Mapping[str, int] | None = None
) -> list[Order]:
    """What to make: families and effects each as often as the others, in an order that mixes them.

    count: of all, with the shares of MIXED; counts: case -> number, in its place.
    """
    rng = np.random.default_rng([seed, 0])
    cases = _cases(count) if counts is None else [case for case in CASES for _ in range(counts.get(case, 0))]
    turns = {name: _Turns(name, rng) for name in families}
    wanted = []
    for case in CASES:
        family = _in_turn(rng, tuple(families))
        for _ in range(cases.count(case)):
            name = next(family)
            wanted.append((name, case, turns[name].effects(case)))
    mixed = [wanted[k] for k in rng.permutation(len(wanted))]
    return [Order(out, n, (seed, n), name, case, names) for n, (name, case, names) in enumerate(mixed, start=1)]


class _Turns:
    """A family's effects, each as often as the others."""

    def __init__(self, family: str, rng: np.random.Generator) -> None:
        which = FAMILIES[family]
        kind, usual = kind_of(which), kind_of(which).usual(which)
        lasting = tuple(name for name in kind.unlisted if name not in kind.events)
        singles, firsts = _in_turn(rng, usual), _in_turn(rng, usual)
        unlisted, events = _in_turn(rng, lasting), _in_turn(rng, kind.events)
        favoured = _in_turn(rng, which.favoured)
        unlisted_so_far, singles_so_far = itertools.count(), itertools.count()

        def unknown() -> tuple[str, ...]:
            return (next(events if next(unlisted_so_far) % EVENTS_EVERY == 1 else unlisted),)

        def single() -> tuple[str, ...]:
            return (next(favoured if which.favoured and next(singles_so_far) % 2 == 0 else singles),)

        self._next: Mapping[str, Callable[[], tuple[str, ...]]] = {
            "none": tuple,
            "singles": single,
            "pairs": lambda: kind.pair(rng, which, next(firsts)),
            "unknown": unknown,
        }

    def effects(self, case: str) -> tuple[str, ...]:
        return self._next[case]()


def _cases(count: int) -> list[str]:
    few = {case: round(share * count) for case, share in MIXED.items() if case != "singles"}
    return ["singles"] * (count - sum(few.values())) + [case for case, n in few.items() for _ in range(n)]


def _in_turn(rng: np.random.Generator, names: tuple[str, ...]) -> Iterator[str]:
    """All of them in a drawn order, again and again."""
    while True:
        yield from (names[k] for k in rng.permutation(len(names)))


def make(order: Order) -> str:
    """Makes one campaign unless its folder and label are there; says what it did."""
    if order.folder.exists() and order.label.exists():
        return f"{order.name} is there"
    if order.folder.exists():  # a label alone is missing: the session broke off between the two
        shutil.rmtree(order.folder)
    order.label.parent.mkdir(parents=True, exist_ok=True)
    label = _made(order)
    order.label.write_text(label.text(), encoding="utf-8")
    return f"{order.name} {order.family} {order.case}: {', '.join(label.effects) or 'no gap'}"


def _made(order: Order) -> Label:
    """Its whole label, with how large its causes are."""
    content = draw(order.seed, order.family, order.case, order.names)
    label = make_campaign(order.folder, order.seed, content)
    if not content.causes:
        return label
    change = input_change(content, order.seed)
    return replace(label, torque_change_rms_nm=change.rms_nm, torque_change_by_second_nm=change.by_second_nm)


def make_all(wanted: Sequence[Order], processes: int = 2) -> None:
    """Makes them all, a line each as it is done."""
    if processes <= 1:
        for order in wanted:
            print(make(order), flush=True)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for said in pool.imap_unordered(make, wanted):
            print(said, flush=True)
