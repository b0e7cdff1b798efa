"""All effects there are: those of this package's modules, of entry points, and of users' files.

The registry collects what is declared; nothing else has to be edited for a new effect.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import pkgutil
import sys
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import read_input
from workbench.effects.declare import Effect, declared_in

ENTRY_POINTS = "workbench.effects"  # the group; each entry names a module that declares effects


@dataclass(frozen=True)
class UserFile:
    """The file as it was read: a worker elsewhere runs this very text, whatever stands under the path there."""

    path: str
    text: bytes

    @cached_property
    def module(self) -> str:
        """The name its module has in this process: one a path."""
        return f"workbench_user_effects_{hashlib.sha256(self.path.encode()).hexdigest()[:16]}"

    @cached_property
    def digest(self) -> str:
        """Of what it says, not of where it lies."""
        return hashlib.sha256(self.text).hexdigest()[:16]


def read_user_file(path: str | os.PathLike[str]) -> UserFile:
    """InputError where the file is not there, cannot be read, or is no Python."""
    file = Path(path)
    if file.is_file() and file.suffix != ".py":
        raise InputError("is no Python file (.py)", file=file)
    return UserFile(str(file.resolve()), read_input(file, "python"))


_users: dict[tuple[str, str], Effect] = {}  # (id, kind) -> what users' files declared in this process
_files: dict[str, UserFile] = {}  # path -> the file that is known
_changing = threading.RLock()


@cache
def library_effects() -> tuple[Effect, ...]:
    """The effects of the package, in the order of modules and lines."""
    package = importlib.import_module("workbench.effects.library")
    modules = [name for _, name, _ in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")]
    effects: list[Effect] = []
    for name in modules:
        module = importlib.import_module(name)
        effects += [effect for effect in declared_in(module) if effect.function.__module__ == name]
    return tuple(effects)


@cache
def library_for(kind: str) -> tuple[Effect, ...]:
    """The package's effects for a kind of plant. Of two of one name, the one that is declared for the kind itself
    goes before the one that is declared for a family it belongs to."""
    suiting = [effect for effect in library_effects() if kind in effect.kinds]
    nearest_of = {effect.id: effect for effect in sorted(suiting, key=lambda effect: -effect.nearness(kind))}
    return tuple(effect for effect in suiting if nearest_of[effect.id] is effect)


@cache
def _of_entry_points() -> None:
    from importlib.metadata import entry_points

    for entry in entry_points(group=ENTRY_POINTS):
        try:
            module = entry.load()
        except Exception as error:
            raise InputError(f"cannot be loaded: {error}", place=f"entry point {entry.name}") from error
        add(declared_in(module) if isinstance(module, ModuleType) else [module], place=f"entry point {entry.name}")


def replace_file(file: UserFile, effects: Iterable[Effect], place: str) -> None:
    """Makes the effects of a user's file known in place of those it declared before. InputError as of `add`."""
    with _changing:
        before = dict(_users)
        for key in [key for key, effect in _users.items() if effect.function.__module__ == file.module]:
            del _users[key]
        try:
            add(effects, place=place)
        except InputError:
            _users.clear()
            _users.update(before)
            raise
        _files[file.path] = file


def files_behind(names: Iterable[str], kind: str) -> tuple[UserFile, ...]:
    """The users' files that declare these effects, in the order they were loaded."""
    with _changing:
        modules = {_users[name, kind].function.__module__ for name in names if (name, kind) in _users}
        return tuple(file for file in _files.values() if file.module in modules)


def user_files() -> tuple[UserFile, ...]:
    """All users' files, in the order they were loaded."""
    with _changing:
        return tuple(_files.values())


def digests_of(names: Iterable[str], kind: str) -> dict[str, str]:
    """id -> digest of the text that declares it, of those effects that are not the library's."""
    own = {effect.id for effect in library_effects() if kind in effect.kinds}
    return {name: _digest(find(name, kind)) for name in sorted(set(names) - own)}


def _digest(effect: Effect) -> str:
    """Of a user's file as it was read; of a package's module as it is installed, "" where it has no file."""
    name = effect.function.__module__
    for file in _files.values():
        if file.module == name:
            return file.digest
    source = getattr(sys.modules.get(name), "__file__", None)
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16] if source else ""


def add(effects: Iterable[Effect], place: str = "effects") -> None:
    """Makes effects known. InputError where a name is taken by another module's effect."""
    with _changing:
        for effect in effects:
            for kind in effect.kinds:
                taken = {(e.id, k): e for e in library_effects() for k in e.kinds} | _users
                before = taken.get((effect.id, kind))
                if before is not None and before.function.__module__ != effect.function.__module__:
                    raise InputError(f"the effect name '{effect.id}' is taken; choose another", place=place)
            _users.update({(effect.id, kind): effect for kind in effect.kinds})


def forget_users() -> None:
    """Takes the users' effects out again."""
    with _changing:
        _users.clear()
        _files.clear()
        _of_entry_points.cache_clear()


def users() -> Mapping[tuple[str, str], Effect]:
    """(id, kind) -> effect, of users' files and entry points."""
    with _changing:
        _of_entry_points()
        return dict(_users)


def effects_for(kind: str) -> dict[str, Effect]:
    """id -> effect, for a kind of plant (hoist, axis-linear, axis-rotary)."""
    own = {effect.id: effect for effect in library_for(kind)}
    return own | {name: effect for (name, of), effect in users().items() if of == kind}


def names(kind: str | None = None) -> tuple[str, ...]:
    """The ids of all effects, or of those for one kind of plant."""
    if kind is not None:
        return tuple(effects_for(kind))
    return tuple(dict.fromkeys([effect.id for effect in library_effects()] + [name for name, _ in users()]))


def find(name: str, kind: str) -> Effect:
    """The effect of that name. InputError with the nearest one where there is none, or none for that plant."""
    known = effects_for(kind)
    if name in known:
        return known[name]
    problem = f"'{name}' is no effect of a {kind} machine" if name in names() else f"unknown effect '{name}'"
    raise InputError(f"{problem}; {nearest(name, known)}", place=f"effects.{name}")
