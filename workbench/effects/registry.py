"""All effects there are: those of this package's modules, of entry points, and of users' files.

The registry collects what is declared; nothing else has to be edited for a new effect.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from workbench.core.declared import digest_of, library, of_entry_points
from workbench.core.errors import InputError, nearest
from workbench.core.input_file import read_input
from workbench.effects.declare import Effect

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


# Where effects come from beside the library, a file's path or an entry point's name -> its file, its effects.
_sources: dict[str, tuple[UserFile | None, tuple[Effect, ...]]] = {}
_changing = threading.RLock()


@cache
def library_effects() -> tuple[Effect, ...]:
    """The effects of the package, in the order of modules and lines."""
    return tuple(library("workbench.effects.library", Effect))


@cache
def library_for(kind: str) -> tuple[Effect, ...]:
    """The package's effects for a kind of plant. Of two of one name, the one that is declared for the kind itself
    goes before the one that is declared for a family it belongs to."""
    suiting = [effect for effect in library_effects() if kind in effect.kinds]
    nearest_of = {effect.id: effect for effect in sorted(suiting, key=lambda effect: -effect.nearness(kind))}
    return tuple(effect for effect in suiting if nearest_of[effect.id] is effect)


@cache
def _of_entry_points() -> None:
    for place, effects in of_entry_points(ENTRY_POINTS, Effect):
        add(effects, place)


def add(effects: Iterable[Effect], place: str, file: UserFile | None = None) -> None:
    """Makes effects known, of a file in place of those that it declared before. InputError where a name is taken."""
    source, made = file.path if file else place, tuple(effects)
    with _changing:
        others = [effect for name, (_, known) in _sources.items() if name != source for effect in known]
        taken = {(effect.id, kind) for effect in (*library_effects(), *others) for kind in effect.kinds}
        for effect in made:
            if any((effect.id, kind) in taken for kind in effect.kinds):
                raise InputError(f"the effect name '{effect.id}' is taken; choose another", place=place)
        _sources[source] = file, made


def files_behind(names: Iterable[str], kind: str) -> tuple[UserFile, ...]:
    """The users' files that declare these effects, in the order they were loaded."""
    wanted = set(names)
    with _changing:
        known = list(_sources.values())
    return tuple(f for f, effects in known if f and any(e.id in wanted and kind in e.kinds for e in effects))


def user_files() -> tuple[UserFile, ...]:
    """All users' files, in the order they were loaded."""
    with _changing:
        return tuple(file for file, _ in _sources.values() if file is not None)


def digests_of(names: Iterable[str], kind: str) -> dict[str, str]:
    """id -> digest of the text that declares it, of those effects that are not the library's."""
    own = {effect.id for effect in library_effects() if kind in effect.kinds}
    return {name: _digest(find(name, kind)) for name in sorted(set(names) - own)}


def _digest(effect: Effect) -> str:
    """Of a user's file as it was read; of a package's module as it is installed, "" where it has no file."""
    file = next((file for file, effects in _sources.values() if file and effect in effects), None)
    if file is not None:
        return file.digest
    return digest_of(effect.function.__module__)


def forget_users() -> None:
    """Takes the users' effects out again."""
    with _changing:
        _sources.clear()
        _of_entry_points.cache_clear()


def _users() -> list[Effect]:
    """Of users' files and entry points."""
    with _changing:
        _of_entry_points()
        return [effect for _, effects in _sources.values() for effect in effects]


def effects_for(kind: str) -> dict[str, Effect]:
    """id -> effect, for a kind of plant (hoist, axis-linear, axis-rotary)."""
    own = {effect.id: effect for effect in library_for(kind)}
    return own | {effect.id: effect for effect in _users() if kind in effect.kinds}


def names(kind: str | None = None) -> tuple[str, ...]:
    """The ids of all effects, or of those for one kind of plant."""
    if kind is not None:
        return tuple(effects_for(kind))
    return tuple(dict.fromkeys(effect.id for effect in (*library_effects(), *_users())))


def find(name: str, kind: str) -> Effect:
    """The effect of that name. InputError with the nearest one where there is none, or none for that plant."""
    known = effects_for(kind)
    if name in known:
        return known[name]
    problem = f"'{name}' is no effect of a {kind} machine" if name in names() else f"unknown effect '{name}'"
    raise InputError(f"{problem}; {nearest(name, known)}", place=f"effects.{name}")
