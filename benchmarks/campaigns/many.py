"""Many campaigns, of hoists or of axes, in two processes; what is there already stays."""

from __future__ import annotations

import multiprocessing
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.campaigns.families import family_of

# Of a mixed set; the rest are single effects.
_NONE, _PAIRS, _UNKNOWN = 1.0 / 6.0, 0.1, 1.0 / 15.0


@dataclass(frozen=True)
class Order:
    """One campaign to make: its number, seed, kind and effects."""

    out: Path
    number: int
    seed: tuple[int, int]
    kind: str
    names: tuple[str, ...]
    machines: str

    @property
    def name(self) -> str:
        return f"{self.number:03d}"

    @property
    def folder(self) -> Path:
        return self.out / self.name

    @property
    def label(self) -> Path:
        return self.out / "labels" / f"{self.name}.json"


def orders(out: Path, count: int, seed: int, kind: str = "mixed", machines: str = "mixed") -> list[Order]:
    """What to make: each usual effect as often as the others, kinds in their shares, in an order that mixes them.

    machines: one of MACHINES.
    """
    family = family_of(machines)
    rng = np.random.default_rng([seed, 0])
    kinds = _kinds(count, kind)
    usual = family.usual(machines)
    singles, unlisted = _in_turn(rng, usual), _in_turn(rng, family.unlisted)
    firsts = _in_turn(rng, usual)
    wanted: list[tuple[str, tuple[str, ...]]] = []
    for each in kinds:
        if each == "singles":
            wanted.append((each, (next(singles),)))
        elif each == "unknown":
            wanted.append((each, (next(unlisted),)))
        elif each == "pairs":
            wanted.append((each, family.pair(rng, machines, next(firsts))))
        else:
            wanted.append((each, ()))
    mixed = [wanted[k] for k in rng.permutation(count)]
    return [Order(out, n, (seed, n), each, names, machines) for n, (each, names) in enumerate(mixed, start=1)]


def _kinds(count: int, kind: str) -> list[str]:
    if kind != "mixed":
        return [kind] * count
    few = {"none": round(_NONE * count), "pairs": round(_PAIRS * count), "unknown": round(_UNKNOWN * count)}
    return ["singles"] * (count - sum(few.values())) + [name for name, n in few.items() for _ in range(n)]


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
    label = family_of(order.machines).labelled(order.folder, order.seed, order.kind, order.names, order.machines)
    order.label.write_text(label.text(), encoding="utf-8")
    return f"{order.name} {order.kind}: {', '.join(label.effects) or 'no gap'}"


def make_all(wanted: list[Order], processes: int = 2) -> None:
    """Makes them all, a line each as it is done."""
    if processes <= 1:
        for order in wanted:
            print(make(order), flush=True)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for said in pool.imap_unordered(make, wanted):
            print(said, flush=True)
