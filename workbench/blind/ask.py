"""What `make` is asked for, in the words of its options: checked, and turned into campaigns to order."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from workbench.blind import recorded
from workbench.blind.make import Made, Tell, make
from workbench.blind.orders import Order, families_of, orders
from workbench.blind.rig import Rig
from workbench.blind.sources.simulator.families import FAMILIES, Family
from workbench.blind.sources.source import source_of
from workbench.errors import InputError, nearest

SMALLEST, LARGEST = 0.1, 1.2  # of what an effect's size is drawn as: on a machine of one's own the power is asked for
MOST_SEED = 2**63


@dataclass(frozen=True)
class Asked:
    """machine, runs: a machine.yaml and a plan or campaign, of the user's. seed: None for one of the system's own.
    sources, families: names, all of a source's families where none is named. effects: names, separated by commas.
    case: all cases of that sort. identified: which machine.yaml was identified first, of orders.IDENTIFIED."""

    machine: Path | None = None
    runs: Path | None = None
    cases: int = 60
    seed: int | None = None
    sources: Sequence[str] = ("simulator",)
    kind: str | None = None
    families: Sequence[str] = ()
    effects: str | None = None
    case: str | None = None
    identified: str = "no"

    def said(self) -> dict[str, Any]:
        """For the manifest: all but the seed."""
        words = {"sources": list(self.sources), "kind": self.kind, "families": list(self.families)}
        files = {"machine": self.machine and self.machine.name, "runs": self.runs and self.runs.name}
        return {
            "cases": self.cases,
            **words,
            **files,
            "effects": self.effects,
            "case": self.case,
            "identified": self.identified,
        }


def make_asked(asked: Asked, folder: Path, *, key: Path | None = None, processes: int = 2, tell: Tell) -> Made:
    """Check what is asked, make and seal it. InputError for what does not fit together."""
    if asked.cases < 1:
        raise InputError(f"{asked.cases}, expected at least 1", place="cases")
    seed = secrets.randbelow(MOST_SEED) if asked.seed is None else asked.seed
    if recorded.SOURCE in asked.sources:
        return _recorded(asked, folder, seed, key=key, processes=processes, tell=tell)
    wanted, rig = ordered(asked, seed)
    return make(folder, wanted, seed, rig=rig, key=key, asked=asked.said(), processes=processes, tell=tell)


def _recorded(asked: Asked, folder: Path, seed: int, **more: Any) -> Made:
    if tuple(asked.sources) != (recorded.SOURCE,):
        raise InputError("recorded does not go with other sources; make a folder of each", place="source")
    if asked.runs is None:
        raise InputError("recorded needs a campaign of measured runs", place="runs")
    unfit = {"machine": asked.machine, "family": asked.families, "effects": asked.effects}
    for place, value in unfit.items():
        if value:
            raise InputError("does not go with recorded: the machine is that of the runs", place=place)
    if asked.identified != "no" or asked.case == "pairs":
        place = "case" if asked.case == "pairs" else "identified"
        raise InputError("does not go with recorded: one piece is bent of a machine that is identified", place=place)
    known = recorded.recording(asked.runs)
    if asked.kind not in (None, known.kind):
        raise InputError(f"{asked.kind}, but the machine is of kind {known.kind}", place="kind")
    share = 100.0 * known.remainder_rms / known.input_rms
    more["tell"](f"{known.name} identified on {len(known.runs)} runs; it leaves {share:.1f} % of its input")
    wanted = recorded.ordered(seed, known, asked.cases, asked.case)
    return make(folder, wanted, seed, asked=asked.said(), one=partial(_one, known), **more)


def _one(known: recorded.Recording, folder: Path, order: Order) -> Any:
    return recorded.made(folder, known, order)


def ordered(asked: Asked, seed: int) -> tuple[list[Order], Rig | None]:
    """The campaigns that are asked for, and the user's own machine where one is."""
    if asked.machine is not None or asked.runs is not None:
        return _of_the_users(asked, seed)
    played = _played(asked)
    kinds = [source_of(source).kind_of(family) for source, families in played.items() for family in families]
    known = {name for kind in kinds for name in kind.listed}
    effects = _effects(asked.effects, known)
    counts = {asked.case: asked.cases} if asked.case else None
    return orders(seed, played, count=asked.cases, counts=counts, effects=effects, identified=asked.identified), None


def _of_the_users(asked: Asked, seed: int) -> tuple[list[Order], Rig]:
    from workbench.blind.rig_files import rig_of
    from workbench.blind.sources.simulator.kinds import kind_of

    rig = rig_of(asked.machine, asked.runs)
    if asked.families:
        raise InputError("draws machines; it does not go with a machine or runs of one's own", place="family")
    if asked.kind not in (None, rig.family.kind):
        raise InputError(f"{asked.kind}, but the machine is of kind {rig.family.kind}", place="kind")
    for name in asked.sources:
        plays = source_of(name).kind_of(rig.family).name
        if plays != rig.family.kind:
            raise InputError(
                f"{name} plays machines of kind {plays}, and yours is of kind {rig.family.kind}", place="source"
            )
    effects = _effects(asked.effects, set(kind_of(rig.family).listed)) or rig.effects
    played = {name: [rig.family] for name in dict.fromkeys(asked.sources) if source_of(name)}
    counts = {asked.case: asked.cases} if asked.case else None
    sizes = (SMALLEST, LARGEST)
    wanted = orders(
        seed, played, count=asked.cases, counts=counts, effects=effects, sizes=sizes, identified=asked.identified
    )
    return wanted, rig


def _played(asked: Asked) -> Mapping[str, list[Family]]:
    """source -> the families that it plays."""
    for name in asked.families:
        if name not in FAMILIES:
            raise InputError(f"unknown family '{name}'; {nearest(name, FAMILIES)}", place="family")

    def fits(name: str) -> bool:
        return name in asked.families if asked.families else asked.kind in (None, FAMILIES[name].kind)

    played = {}
    for source in dict.fromkeys(asked.sources):
        names = [name for name in source_of(source).families if fits(name)]
        if not names:
            what = ", ".join(asked.families) or f"machines of kind {asked.kind}"
            plays = ", ".join(source_of(source).families)
            raise InputError(f"{source} does not play {what}; it plays {plays}", place="source")
        played[source] = families_of(names)
    return played


def _effects(text: str | None, known: set[str]) -> tuple[str, ...]:
    if text is None:
        return ()
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise InputError("no effect is named, expected names with commas between", place="effects")
    for name in names:
        if name not in known:
            raise InputError(f"unknown effect '{name}'; {nearest(name, known)}", place="effects")
    return names
