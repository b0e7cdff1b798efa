"""Campaigns made and sealed: each as a rig would have recorded it, its label where only the key reads it."""

from __future__ import annotations

import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.blind.amounts import scaled
from workbench.blind.identified import identify_first
from workbench.blind.orders import Order
from workbench.blind.rig import Rig
from workbench.blind.seal import CAMPAIGNS, Truth, fernet, hashes, key_of, seal, write_key
from workbench.blind.sources.simulator.campaign import Label, make_campaign
from workbench.blind.sources.simulator.content import Content, draw
from workbench.blind.sources.simulator.size import input_change
from workbench.blind.sources.source import source_of
from workbench.errors import InputError
from workbench.plants import plant_of
from workbench.whole_folder import check_free, whole_folder

TRIES = 3  # seeds of a campaign whose engine gives up
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Made:
    """What `make` wrote. seal_sha256: worth a note elsewhere: a folder made anew has another one."""

    folder: Path
    key: Path
    seal_sha256: str
    cases: int


def make(
    folder: Path,
    wanted: Sequence[Order],
    seed: int,
    *,
    rig: Rig | None = None,
    key: Path | None = None,
    asked: Mapping[str, Any] | None = None,
    processes: int = 2,
    tell: Tell = lambda line: None,
    one: Callable[[Path, Order], tuple[Order, Label]] | None = None,
) -> Made:
    """Make the campaigns in `folder`, which is free, and seal their labels; all or nothing. The key stays outside.

    one: what makes a campaign in a folder, in place of what the order's source does.
    """
    fernet()
    for name in {order.source for order in wanted} if one is None else ():
        source_of(name).ready()
    check_free(folder)
    key = key or key_of(folder)
    if key.exists():
        raise InputError("is there; nothing is overwritten, choose another file for the key", file=key)
    with whole_folder(folder) as hidden:
        (hidden / CAMPAIGNS).mkdir()
        labels: dict[str, Label] = {}
        with mapped(processes) as over:
            for order, label in over(
                (one and partial(one, hidden / CAMPAIGNS)) or partial(made, hidden / CAMPAIGNS, rig), wanted
            ):
                labels[order.name] = label
                tell(f"{len(labels)}/{len(wanted)} campaigns made")
        names = sorted(labels)
        truth = Truth(
            seed,
            {order.name: asdict(order) for order in wanted},
            {name: asdict(labels[name]) for name in names},
            {name: hashes(hidden / CAMPAIGNS / name) for name in names},
            rig.said() if rig else None,
        )
        now = datetime.now(UTC).isoformat(timespec="seconds")
        secret = seal(hidden, truth, now, __version__, asked or {})
        write_key(key, secret)
    from workbench.blind.seal import read_manifest

    return Made(folder, key, read_manifest(folder).seal_sha256, len(names))


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


@contextmanager
def mapped(processes: int) -> Iterator[Callable[..., Any]]:
    """A `map` over processes, in any order; in this one where it is one."""
    if processes <= 1:
        yield map
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by the processes as they start
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield pool.imap_unordered
