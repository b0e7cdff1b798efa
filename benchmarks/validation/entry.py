"""What `workbench blind` asks of the simulators: campaigns ordered and made, and more runs of the same true machine."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.validation.campaign import identify_first, input_change, make_campaign
from benchmarks.validation.content import Content, draw, scaled
from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.orders import families_of, orders
from benchmarks.validation.rig import Rig
from benchmarks.validation.rig_files import rig_of
from benchmarks.validation.sources import source_of
from workbench.blind.make import Asked, Maker
from workbench.blind.seal import Label, Order
from workbench.core.errors import InputError, nearest
from workbench.machines import plant_of

TRIES = 3  # seeds of a campaign whose engine gives up
SMALLEST, LARGEST = 0.1, 1.2  # of what an effect's size is drawn as: on a machine of one's own the power is asked for


def maker(asked: Asked, seed: int) -> Maker:
    """The campaigns that are asked for. InputError for what does not fit together, and where an extra is missing."""
    wanted, rig = ordered(asked, seed)
    for name in {order.source for order in wanted}:
        source_of(name).ready()
    return Maker(wanted, partial(made, rig), rig.said() if rig else None)


def ordered(asked: Asked, seed: int) -> tuple[list[Order], Rig | None]:
    """The campaigns that are asked for, and the user's own machine where one is."""
    rig = rig_of(asked.machine, asked.runs) if asked.machine is not None or asked.runs is not None else None
    played = _played(asked) if rig is None else _played_by_rig(asked, rig.family)
    kinds = [source_of(source).kind_of(family) for source, families in played.items() for family in families]
    effects = _effects(asked.effects, {name for kind in kinds for name in kind.listed})
    wanted = orders(
        seed,
        played,
        count=asked.cases,
        counts={asked.case: asked.cases} if asked.case else None,
        effects=effects or (rig.effects if rig else ()),
        sizes=(SMALLEST, LARGEST) if rig else (1.0, 1.0),
        identified=asked.identified,
    )
    return wanted, rig


def _played_by_rig(asked: Asked, family: Family) -> dict[str, list[Family]]:
    if asked.families:
        raise InputError("draws machines; it does not go with a machine or runs of one's own", place="family")
    if asked.kind not in (None, family.kind):
        raise InputError(f"{asked.kind}, but the machine is of kind {family.kind}", place="kind")
    for name in asked.sources:
        plays = source_of(name).kind_of(family).name
        if plays != family.kind:
            problem = f"{name} plays machines of kind {plays}, and yours is of kind {family.kind}"
            raise InputError(problem, place="source")
    return {name: [family] for name in dict.fromkeys(asked.sources)}


def _played(asked: Asked) -> dict[str, list[Family]]:
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


def content_of(order: Order, rig: Rig | None = None, seed: Sequence[int] | None = None) -> Content:
    """What the campaign of an order is made of."""
    seeds = order.seed if seed is None else seed
    source = source_of(order.source)
    plain = draw(seeds, order.family, order.case, order.names) if rig is None else rig.content(seeds, order)
    plant = plant_of(plain.drawn.machine).kind
    causes = tuple(scaled(cause, order.size, plant) for cause in plain.causes)
    return source.content(replace(plain, causes=causes))


def made(rig: Rig | None, folder: Path, order: Order) -> tuple[Order, Label]:
    """One campaign in `folder`/NAME, and its label. Where the engine gives up, the next seed is taken."""
    for attempt in range(TRIES):
        seeds = (*order.seed, attempt) if attempt else order.seed
        content = content_of(order, rig, seeds)
        try:
            label = make_campaign(folder / order.name, seeds, content)
            if order.identified:
                identify_first(folder / order.name, seeds, content)
            break
        except RuntimeError as error:
            shutil.rmtree(folder / order.name, ignore_errors=True)
            if attempt == TRIES - 1:
                raise InputError(f"campaign {order.name} of {order.source} cannot be simulated: {error}") from error
    truth = {**label.truth, **source_of(order.source).truth(content, seeds)}
    label = replace(label, truth=truth, source=order.source, identified=order.identified)
    if not content.causes:
        return order, label
    change = input_change(content, seeds)
    return order, replace(label, torque_change_rms_nm=change.rms_nm, torque_change_by_second_nm=change.by_second_nm)
