"""What modules declare: objects of one type, found without a list; those of a package's modules and of entry points."""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from workbench.core.errors import InputError

T = TypeVar("T")


def declared_in(module: ModuleType, kind: type[T]) -> list[T]:
    """What stands in a module under any public name, in the order of its lines, once each."""
    found = {id(value): value for name, value in vars(module).items() if isinstance(value, kind) and name[0] != "_"}
    return list(found.values())


def library(package: str, kind: type[T], ending: str = "") -> list[T]:
    """What the package's modules of that ending declare, in the order of modules and lines, once each."""
    names = sorted(name for _, name, _ in pkgutil.iter_modules(importlib.import_module(package).__path__))
    modules = [importlib.import_module(f"{package}.{name}") for name in names if name.endswith(ending)]
    return list({id(value): value for module in modules for value in declared_in(module, kind)}.values())


def of_entry_points(group: str, kind: type[T]) -> Iterator[tuple[str, list[T]]]:
    """(the entry's place, what it declares): a module, or one object. InputError for one that cannot be loaded."""
    from importlib.metadata import entry_points

    for entry in entry_points(group=group):
        place = f"entry point {entry.name}"
        try:
            loaded = entry.load()
        except Exception as error:
            raise InputError(f"cannot be loaded: {error}", place=place) from error
        yield place, declared_in(loaded, kind) if isinstance(loaded, ModuleType) else [loaded]


def digest_of(module: str) -> str:
    """Of a module's text as it is installed, "" where it has no file."""
    source = getattr(sys.modules.get(module), "__file__", None)
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16] if source else ""
