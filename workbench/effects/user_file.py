"""A user's Python file of effects: read, run, looked over."""

from __future__ import annotations

import hashlib
import os
import sys
import traceback
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType

from workbench.effects.declare import Effect
from workbench.errors import InputError

MOST_BYTES = 1_000_000


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
    try:
        if not file.is_file():
            what = "is a folder" if file.is_dir() else "no such file"
            raise InputError(f"{what}; expected Python with effects in it", file=file)
        if file.suffix != ".py":
            raise InputError("is no Python file (.py)", file=file)
        if file.stat().st_size > MOST_BYTES:
            raise InputError(f"is larger than {MOST_BYTES // 1_000_000} MB; expected Python with effects", file=file)
        return UserFile(str(file.resolve()), file.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}", file=file) from error


def declared(file: UserFile, shown: str | os.PathLike[str] | None = None) -> tuple[Effect, ...]:
    """Runs the file; returns the effects that it declares itself.

    shown: the path in errors, as the user wrote it. InputError with the line where it fails, where it
    declares nothing, and for an effect that no plant can take.
    """
    where = shown or file.path
    module = ModuleType(file.module)
    module.__file__ = file.path
    before = sys.modules.get(file.module)
    sys.modules[file.module] = module  # where dataclasses and the like look for it
    try:
        exec(compile(file.text, file.path, "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        _put_back(file.module, before)
        problem = f"fails: {type(error).__name__}: {str(error) or 'without a word'}"
        raise InputError(problem.splitlines()[0], file=where, line=_line(error, file.path)) from error
    effects = [effect for effect in declared_in(module) if effect.function.__module__ == file.module]
    problem = "" if effects else "declares no effect; see workbench.effects.effect"
    if not problem:
        from workbench.effects.trial import faults  # late: a trial needs plants with effects, which need the registry

        problem = next((f"effect {effect.id}: {fault}" for effect in effects for fault in faults(effect)), "")
    if problem:
        _put_back(file.module, before)
        raise InputError(problem, file=where)
    return tuple(effects)


def declared_in(module: ModuleType) -> list[Effect]:
    """The effects that stand in a module under any name, once each."""
    return list({id(value): value for value in vars(module).values() if isinstance(value, Effect)}.values())


def _put_back(name: str, before: ModuleType | None) -> None:
    if before is None:
        del sys.modules[name]
    else:
        sys.modules[name] = before


def _line(error: BaseException, path: str) -> int | None:
    """The line of the file that an error comes from."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return error.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return lines[-1] if lines else None
