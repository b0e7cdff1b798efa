"""Generated kernels on disk: compiled once, found again by what they say.

A kernel's file is named after the hash of its whole text, of the compiler's version
and of the processor. The text holds all physics, straight-line, so an edit of any
equation gives another name and can never meet an old binary.

Each process loads and calls a small probe first. Where the probe or a kernel does not
come out as `native` expects (a numba that is newer than the tested ones), numba itself
compiles and calls the functions, in every process anew. WORKBENCH_ENGINE=numba asks for
that, to compare or to get on.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import stat
import tempfile
import threading
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from workbench.engine.native import (
    PROBE,
    PROBE_LETTERS,
    check_probe,
    compile_function,
    host,
    load_function,
    numba_function,
)

log = logging.getLogger(__name__)
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_MOST_BYTES = 100_000_000
_loading = threading.Lock()  # two threads that want one kernel compile it once
_loaded: dict[str, dict[str, Callable[..., int]]] = {}
_said = False
_native: bool | None = None  # whether the probe came out right; None before it was tried
Functions = dict[str, Callable[..., int]]


def cache_folder() -> Path:
    """Where kernels are kept: WORKBENCH_CACHE, else the user's cache folder, else a temporary one.

    Kernels are code: a folder that somebody else owns or can write to is not used, whoever named it.
    """
    chosen = os.environ.get("WORKBENCH_CACHE")
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: a user without a home
        usual = os.environ.get("XDG_CACHE_HOME")
        base = Path(chosen) if chosen else (Path(usual) if usual else Path.home() / ".cache") / "workbench"
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_own(base):
            with tempfile.TemporaryFile(dir=base):
                return base
        _warn_of(base)
    return _fallback_folder()


def _is_own(folder: Path) -> bool:
    """Whether it is this user's alone to write to; a folder of theirs is made so."""
    if not hasattr(os, "getuid"):
        return True
    status = folder.stat()
    if status.st_uid != os.getuid():
        return False
    if status.st_mode & _OTHERS_WRITE:
        folder.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_WRITE)
    return not folder.stat().st_mode & _OTHERS_WRITE


@cache
def _warn_of(folder: Path) -> None:
    log.warning("%s belongs to another user: kernels are code, so they are kept in a temporary folder instead", folder)


@cache
def _fallback_folder() -> Path:
    """The user's own folder among the temporary ones; a new one where somebody else has taken its name."""
    owner = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(tempfile.gettempdir()) / f"workbench-{'kernels' if owner is None else owner}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not folder.is_symlink() and _is_own(folder):
            with tempfile.TemporaryFile(dir=folder):
                return folder
    return Path(tempfile.mkdtemp(prefix="workbench-"))


def load_functions(text: str, letters: Mapping[str, str]) -> Functions:
    """The functions of a generated module that `letters` names, by their argument letters; see `native`.

    They come from the disk where they were compiled before, else they are compiled and
    kept there; on a full disk they are compiled and not kept. Where object code does not
    serve, numba calls them; a warning says why, and nothing is kept.
    """
    key = json.dumps([dict(letters), text], sort_keys=True)
    with _loading:
        if key not in _loaded:
            functions = _native_functions(text, letters) if _is_native() else None
            _loaded[key] = functions or _numba_functions(text, letters)
        return _loaded[key]


def _is_native() -> bool:
    """Whether object code serves in this process; tried once."""
    global _native
    if os.environ.get("WORKBENCH_ENGINE") == "numba":
        return False
    if _native is None:
        functions = _native_functions(PROBE, PROBE_LETTERS, ".probe")
        try:
            _native = functions is not None
            if functions:
                check_probe(functions["probe"])
        except RuntimeError as error:
            _native = False
            _warn(error)
    return _native


def _native_functions(text: str, letters: Mapping[str, str], suffix: str = ".kernel") -> Functions | None:
    """From object code; None, with a warning, where numba or llvmlite are not as `native` knows them."""
    try:
        path = cache_folder() / f"{_digest(text, letters)}{suffix}"
        codes = _read(path)
        if codes is None or codes.keys() != letters.keys():
            module = _module(text, quiet=suffix != ".kernel")
            codes = {name: compile_function(module[name], types) for name, types in letters.items()}
            _write(path, codes)
        return {name: load_function(codes[name], types) for name, types in letters.items()}
    except Exception as error:  # whatever a private interface does once it has changed
        _warn(error)
        return None


def _numba_functions(text: str, letters: Mapping[str, str]) -> Functions:
    module = _module(text)
    return {name: numba_function(module[name], types) for name, types in letters.items()}


def _warn(error: Exception) -> None:
    from importlib.metadata import version

    log.warning(
        "kernels cannot be kept as object code with numba %s and llvmlite %s (%s: %s); numba compiles them in every "
        "process instead: the results are the same, each start takes some seconds more",
        version("numba"), version("llvmlite"), type(error).__name__, error,
    )  # fmt: skip


def _digest(text: str, letters: Mapping[str, str]) -> str:
    key = json.dumps([dict(host()), dict(letters), text], sort_keys=True)
    return hashlib.sha256(key.encode()).hexdigest()[:24]


def _module(text: str, quiet: bool = False) -> dict[str, Any]:
    """The names of a generated module, its functions not compiled yet."""
    global _said
    if not (_said or quiet):
        _said = True
        log.info("compiling the simulation for this computer (once; some seconds) ...")
    module: dict[str, Any] = {"__name__": "workbench_kernel"}
    exec(compile(text, "<generated kernel>", "exec"), module)
    return module


def _write(path: Path, codes: Mapping[str, bytes]) -> None:
    """A line of JSON (name, length and hash of each function's code), then the codes one after the other."""
    head = json.dumps([[name, len(code), hashlib.sha256(code).hexdigest()] for name, code in codes.items()])
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(head.encode() + b"\n" + b"".join(codes.values()))
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


def _read(path: Path) -> dict[str, bytes] | None:
    """The codes in a file; None where it is not there, not whole (a full disk, a careless hand) or not one's own."""
    try:
        head, _, rest = own_bytes(path).partition(b"\n")
        codes, at = {}, 0
        for name, length, digest in json.loads(head):
            codes[name] = rest[at : at + length]
            at += length
            if hashlib.sha256(codes[name]).hexdigest() != digest:
                return None
        return codes
    except (OSError, ValueError, TypeError):
        return None


def own_bytes(path: Path) -> bytes:
    """A regular file of this user's. OSError for anything else; a pipe under that name is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        status = os.fstat(file.fileno())
        own = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & _OTHERS_WRITE)
        if not (own and stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES):
            raise PermissionError(path)
        return file.read()
