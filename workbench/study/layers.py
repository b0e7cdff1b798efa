"""A scenario file with those that it extends, as one: whose each value is stays known, for errors and for paths."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.core.errors import InputError
from workbench.core.yaml_strict import Document, Place, dotted, load

LONGEST_CHAIN = 10
# Values that are names with dots in them: written as blocks they mean the same.
_FLAT = ("machine_overrides",)


@dataclass(frozen=True)
class Layered:
    """`data` after all merging. `file` is the outermost; `origin`: place -> where it stands."""

    file: Path
    data: dict[str, Any]
    origin: Mapping[Place, tuple[Path, int]]

    def at(self, place: Place) -> tuple[Path, int | None]:
        """File and line of a place, or of the nearest block around it."""
        for end in range(len(place), 0, -1):
            if place[:end] in self.origin:
                return self.origin[place[:end]]
        return self.file, 1 if not place else None

    def keys_in_same_file(self, place: Place) -> set[str]:
        """The keys of a place's block that stand in the same file as the place itself."""
        block: Any = self.data
        for part in place[:-1]:
            block = block[part]
        mine = self.at(place)[0]
        keys = block if isinstance(block, dict) else ()
        return {str(key) for key in keys if self.at((*place[:-1], key))[0] == mine}

    def error(self, problem: str, place: Place) -> InputError:
        file, line = self.at(place)
        return InputError(problem, file=file, line=line, place=dotted(place) or None)


def read_layers(path: str | os.PathLike[str]) -> Layered:
    """A scenario file over what it extends: blocks are merged key by key, everything else is replaced.

    Raises InputError for a file that cannot be read, a circle, a chain of more than ten.
    """
    chain: list[Layered] = []
    seen: list[Path] = []
    file, asked = Path(path), None
    while True:
        if asked is not None and (not os.path.isfile(file) or file.resolve() in seen or len(seen) >= LONGEST_CHAIN):
            raise asked.error(_why_not(file, seen), ("extends",))
        layer = layer_of(load(file))
        chain.append(layer)
        seen.append(file.resolve())
        extended = layer.data.pop("extends", None)
        if extended is None:
            break
        if not isinstance(extended, str) or not extended:
            raise layer.error(f"{extended!r}, expected the path of a scenario file, seen from this one", ("extends",))
        if "\0" in extended:
            raise layer.error("is not a path", ("extends",))
        file, asked = file.parent / extended, layer
    return together(Path(path), chain)


def together(file: Path, chain: Sequence[Layered]) -> Layered:
    """Layers as one, the outermost first."""
    data: dict[str, Any] = {}
    origin: dict[Place, tuple[Path, int]] = {}
    for layer in reversed(chain):
        data = _merged(data, layer.data, (), origin, layer.origin)
    return Layered(file, data, origin)


def _why_not(file: Path, seen: list[Path]) -> str:
    if not os.path.isfile(file):  # False, too, for a name that no file can have
        return f"no scenario file {file}; expected a path seen from this file"
    if file.resolve() in seen:
        return f"goes in a circle: {' extends '.join(path.name for path in [*seen, file])}"
    return f"is a chain of more than {LONGEST_CHAIN} files"


def layer_of(document: Document) -> Layered:
    """One document by itself, what it extends aside. InputError where it is no block of keys."""
    origin = {place: (document.file, line) for place, line in document.lines.items() if place}
    if not isinstance(document.data, dict):
        line = document.line(())
        raise InputError("is not a block of keys; expected a scenario", file=document.file, line=line)
    layer = Layered(document.file, dict(document.data), origin)
    for key in _FLAT:
        if isinstance(block := layer.data.get(key), dict):
            layer.data[key] = _flattened(block, (key,), "", {}, layer)
    return layer


def _flattened(
    block: dict[str, Any], place: Place, prefix: str, flat: dict[str, Any], layer: Layered
) -> dict[str, Any]:
    """{wire: {segment_length_m: 30}} as {wire.segment_length_m: 30}, lines kept."""
    assert isinstance(layer.origin, dict)
    for key, value in block.items():
        name, here = f"{prefix}{key}", (*place, key)
        if isinstance(value, dict):
            _flattened(value, here, f"{name}.", flat, layer)
            continue
        if name in flat:
            raise layer.error(f"'{name}' is set twice, in a block and by its dotted name", here)
        flat[name] = value
        layer.origin[(place[0], name)] = layer.at(here)
    return flat


def _merged(
    old: dict[str, Any],
    new: dict[str, Any],
    place: Place,
    origin: dict[Place, tuple[Path, int]],
    new_origin: Mapping[Place, tuple[Path, int]],
) -> dict[str, Any]:
    result = dict(old)
    for key, value in new.items():
        here = (*place, key)
        if isinstance(value, dict) and isinstance(old.get(key), dict):
            result[key] = _merged(old[key], value, here, origin, new_origin)
        else:
            result[key] = value
            if key in old:  # only then there is something stale; a look through all places for each key is quadratic
                for stale in [known for known in origin if known[: len(here)] == here]:
                    del origin[stale]
            _copy_origin(value, here, origin, new_origin)
        if here in new_origin:
            origin[here] = new_origin[here]
    return result


def _copy_origin(
    value: Any, place: Place, origin: dict[Place, tuple[Path, int]], new_origin: Mapping[Place, tuple[Path, int]]
) -> None:
    """Where a value and all that is in it stand."""
    if place in new_origin:
        origin[place] = new_origin[place]
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inner:
        _copy_origin(part, (*place, key), origin, new_origin)
