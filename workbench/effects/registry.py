"""All effects there are: those of this package's modules, of entry points, and of users' files.

The registry collects what is declared; nothing else has to be edited for a new effect.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import pkgutil
import sys
import threading
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

from workbench.effects.declare import Effect
from workbench.errors import InputError, nearest

ENTRY_POINTS = "workbench.effects"  # the group; each entry names a module that declares effects

_users: dict[tuple[str, str], Effect] = {}  # (id, kind) -> what users' files declared in this process
_changing = threading.RLock()


@cache
def library() -> tuple[Effect, ...]:
    """The effects of the package, in the order of modules and lines."""
    package = importlib.import_module(__package__ or "workbench.effects")
    modules = [name for _, name, _ in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")]
    found: list[Effect] = []
    for name in modules:
        module = importlib.import_module(name)
        found += [each for each in declared_in(module) if each.function.__module__ == name]
    return tuple(found)


def declared_in(module: ModuleType) -> list[Effect]:
    """The effects that stand in a module under any name, once each."""
    return list({id(value): value for value in vars(module).values() if isinstance(value, Effect)}.values())


@cache
def _of_entry_points() -> None:
    from importlib.metadata import entry_points

    for entry in entry_points(group=ENTRY_POINTS):
        try:
            module = entry.load()
        except Exception as error:
            raise InputError(f"cannot be loaded: {error}", place=f"entry point {entry.name}") from error
        add(declared_in(module) if isinstance(module, ModuleType) else [module], place=f"entry point {entry.name}")


def load_effects(path: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """The effects that a Python file declares; from now on they are known by name in this process.

    InputError where the file is not there, fails, declares nothing, or takes a name that is taken.
    Loading the same file again replaces what it declared before.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("no such file; expected Python with effects in it", file=file)
    name = f"workbench_user_effects_{hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise InputError("is no Python file (.py)", file=file)
    module = importlib.util.module_from_spec(spec)
    with _changing:
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            del sys.modules[name]
            raise InputError(f"fails: {type(error).__name__}: {error}", file=file) from error
        found = [each for each in declared_in(module) if each.function.__module__ == name]
        if not found:
            raise InputError("declares no effect; see workbench.effects.effect", file=file)
        add(found, place=str(file))
    return tuple(found)


def add(effects: Iterable[Effect], place: str = "effects") -> None:
    """Makes effects known. InputError where a name is taken by another module's effect."""
    with _changing:
        for each in effects:
            for kind in each.kinds:
                taken = {(e.id, k): e for e in library() for k in e.kinds} | _users
                before = taken.get((each.id, kind))
                if before is not None and before.function.__module__ != each.function.__module__:
                    raise InputError(f"the effect name '{each.id}' is taken; choose another", place=place)
            _users.update({(each.id, kind): each for kind in each.kinds})


def forget_users() -> None:
    """Takes the users' effects out again."""
    with _changing:
        _users.clear()
        _of_entry_points.cache_clear()


def users() -> Mapping[tuple[str, str], Effect]:
    """(id, kind) -> effect, of users' files and entry points."""
    with _changing:
        _of_entry_points()
        return dict(_users)


def effects_for(kind: str) -> dict[str, Effect]:
    """id -> effect, for a kind of plant (hoist, axis-linear, axis-rotary)."""
    own = {each.id: each for each in library() if kind in each.kinds}
    return own | {name: each for (name, of), each in users().items() if of == kind}


def names(kind: str | None = None) -> tuple[str, ...]:
    """The ids of all effects, or of those for one kind of plant."""
    if kind is not None:
        return tuple(effects_for(kind))
    return tuple(dict.fromkeys([each.id for each in library()] + [name for name, _ in users()]))


def find(name: str, kind: str) -> Effect:
    """The effect of that name. InputError with the nearest one where there is none, or none for that plant."""
    known = effects_for(kind)
    if name in known:
        return known[name]
    problem = f"'{name}' is no effect of a {kind} machine" if name in names() else f"unknown effect '{name}'"
    raise InputError(f"{problem}; {nearest(name, known)}", place=f"effects.{name}")
