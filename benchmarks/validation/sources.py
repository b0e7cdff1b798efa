"""What a source of campaigns is, and those that there are."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.validation.content import Content, kind_of
from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.kind import Kind
from workbench.core.errors import InputError, nearest


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


SIMULATOR = Source("simulator", tuple(FAMILIES), kind_of, lambda content: content)
NAMES = (SIMULATOR.name, "multibody", "plant")


def source_of(name: str) -> Source:
    """The source of that name. InputError with the nearest one where there is none."""
    if name not in NAMES:
        raise InputError(f"unknown source '{name}'; {nearest(name, NAMES)}", place="source")
    if name == SIMULATOR.name:
        return SIMULATOR
    source: Source = importlib.import_module(f"benchmarks.validation.{name}").SOURCE
    return source
