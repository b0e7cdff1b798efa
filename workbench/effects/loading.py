"""Effects of users' files, loaded: the file is run, each effect is tried, and what passes is known by name."""

from __future__ import annotations

import os
import sys
import threading
import traceback
from types import ModuleType

from workbench.effects.declare import Effect, declared_in
from workbench.effects.registry import replace_file
from workbench.effects.trial import faults
from workbench.effects.user_file import UserFile, read_user_file
from workbench.errors import InputError

_declared: dict[tuple[str, str], tuple[Effect, ...]] = {}  # (path, digest) -> the effects of that text
_changing = threading.RLock()


def load_effects(path: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """The effects that a Python file declares; from now on they are known by name in this process.

    InputError where the file is not there, fails, declares nothing, takes a name that is taken, or
    holds an effect that no plant can take. Loading the same file again replaces what it declared before.
    """
    return know(read_user_file(path), path)


def know(file: UserFile, shown: str | os.PathLike[str] | None = None) -> tuple[Effect, ...]:
    """Makes the effects of a file known, that was read here or elsewhere; see `load_effects`.

    The same text again is the same effects, so kernels that were made for them serve on.
    """
    with _changing:
        if (file.path, file.digest) not in _declared:
            _declared[file.path, file.digest] = declared(file, shown)
        effects = _declared[file.path, file.digest]
        replace_file(file, effects, place=str(shown or file.path))
    return effects


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
        problem = next((f"effect {effect.id}: {fault}" for effect in effects for fault in faults(effect)), "")
    if problem:
        _put_back(file.module, before)
        raise InputError(problem, file=where)
    return tuple(effects)


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
