"""All kinds of references there are: those of the library, of entry points, and those that a program adds.

Each kind is declared once; nothing else has to be edited for a new one.
"""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import ModuleType

from workbench.errors import InputError, nearest
from workbench.references.kind import PlannedKind, RecordedKind, ReferenceKind

ENTRY_POINTS = "workbench.references"  # the group; each entry names a module that declares kinds
BASELINE = "trapezoid"  # the kind that studies compare the others with

_added: dict[str, ReferenceKind] = {}


def _declared_in(module: ModuleType) -> list[ReferenceKind]:
    """The kinds that stand in a module, in the order of its lines."""
    return list({value.name: value for value in vars(module).values() if isinstance(value, ReferenceKind)}.values())


@cache
def library_kinds() -> tuple[ReferenceKind, ...]:
    """The kinds of the package, in the order of modules and lines."""
    package = importlib.import_module("workbench.references.library")
    modules = [name for _, name, _ in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")]
    return tuple(kind for name in modules for kind in _declared_in(importlib.import_module(name)))


@cache
def _of_entry_points() -> tuple[ReferenceKind, ...]:
    from importlib.metadata import entry_points

    kinds: list[ReferenceKind] = []
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            module = entry.load()
        except Exception as error:
            raise InputError(f"cannot be loaded: {error}", place=f"entry point {entry.name}") from error
        kinds += _declared_in(module) if isinstance(module, ModuleType) else [module]
    return tuple(kinds)


def add(*kinds: ReferenceKind) -> None:
    """Makes kinds known in this process. InputError where a name is taken."""
    for kind in kinds:
        if kind.name in by_name():
            raise InputError(f"the reference name '{kind.name}' is taken; choose another", place="references")
        _added[kind.name] = kind


def forget_added() -> None:
    """Takes the added kinds out again."""
    _added.clear()


def by_name() -> dict[str, ReferenceKind]:
    """name -> kind: planned ones in the library's order, recorded ones, those of others."""
    return {kind.name: kind for kind in (*library_kinds(), *_of_entry_points(), *_added.values())}


def planned_kinds() -> dict[str, PlannedKind]:
    """name -> kind, of those that are planned from moves and limits."""
    return {name: kind for name, kind in by_name().items() if isinstance(kind, PlannedKind)}


def recorded_kinds() -> dict[str, RecordedKind]:
    """name -> kind, of those that follow a campaign's run."""
    return {name: kind for name, kind in by_name().items() if isinstance(kind, RecordedKind)}


def usual_kinds() -> tuple[str, ...]:
    """The names that a scenario without `references` runs."""
    return tuple(name for name, kind in planned_kinds().items() if kind.usual)


def planned_kind(name: str) -> PlannedKind:
    """The planned kind of that name. InputError with the nearest one where there is none."""
    kinds = planned_kinds()
    if name in kinds:
        return kinds[name]
    if name in recorded_kinds():
        raise InputError(f"'{name}'; it takes a block with campaign and run", place="references")
    raise InputError(f"unknown reference '{name}'; {nearest(name, kinds)}", place="references")


def digests_of(names: Iterable[str]) -> dict[str, str]:
    """name -> digest of the text that declares it, of those kinds that are not the library's."""
    own, known = {kind.name for kind in library_kinds()}, planned_kinds()
    return {name: _digest(known[name]) for name in sorted(set(names) - own) if name in known}


def _digest(kind: PlannedKind) -> str:
    source = getattr(sys.modules.get(kind.move.__module__), "__file__", None)
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16] if source else ""
