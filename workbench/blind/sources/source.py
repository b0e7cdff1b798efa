"""What a source of campaigns is, and those that there are."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from workbench.blind.sources.simulator.content import Content
from workbench.blind.sources.simulator.families import Family
from workbench.blind.sources.simulator.kind import Kind
from workbench.errors import InputError, nearest


def _nothing(content: Content, seeds: Sequence[int]) -> Mapping[str, float]:
    return {}


@dataclass(frozen=True)
class Source:
    """families: names of those that it can play. kind_of: what it makes of a family. content: the same content, moved
    by this source's machine. truth: what its labels say beside. ready: InputError where an extra is missing."""

    name: str
    families: tuple[str, ...]
    kind_of: Callable[[Family], Kind]
    content: Callable[[Content], Content]
    truth: Callable[[Content, Sequence[int]], Mapping[str, float]] = _nothing
    ready: Callable[[], object] = lambda: None


_WHERE = {
    "simulator": "workbench.blind.sources.simulator.source",
    "multibody": "workbench.blind.sources.multibody",
    "plant": "workbench.blind.sources.plant",
}
NAMES = tuple(_WHERE)


def source_of(name: str) -> Source:
    """The source of that name. InputError with the nearest one where there is none."""
    if name not in _WHERE:
        raise InputError(f"unknown source '{name}'; {nearest(name, NAMES)}", place="source")
    source: Source = importlib.import_module(_WHERE[name]).SOURCE
    return source
