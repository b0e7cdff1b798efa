"""Generated kernels on disk: compiled once, found again by what they say.

A kernel's file is named after the hash of its whole text, of the compiler's version
and of the processor. The text holds all physics, straight-line, so an edit of any
equation gives another name and can never meet an old binary.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from workbench.engine.native import compile_function, host, load_function

log = logging.getLogger(__name__)
_loading = threading.Lock()  # two threads that want one kernel compile it once
_loaded: dict[str, dict[str, Callable[..., int]]] = {}
_said = False


def cache_folder() -> Path:
    """Where kernels are kept: WORKBENCH_CACHE, else the user's cache folder, else a temporary one."""
    chosen = os.environ.get("WORKBENCH_CACHE")
    base = Path(chosen) if chosen else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "workbench"
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return base
    except OSError:
        return _fallback_folder()


@cache
def _fallback_folder() -> Path:
    """The user's own folder among the temporary ones; a new one where somebody else has taken its name."""
    owner = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(tempfile.gettempdir()) / f"workbench-{'kernels' if owner is None else owner}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            if owner is None or folder.lstat().st_uid == owner:  # kernels are code: only one's own are run
                return folder
    return Path(tempfile.mkdtemp(prefix="workbench-"))


def load_functions(text: str, letters: Mapping[str, str]) -> dict[str, Callable[..., int]]:
    """The functions of a generated module that `letters` names, by their argument letters; see `native`.

    They come from the disk where they were compiled before, else they are compiled and
    kept there; on a full disk they are compiled and not kept.
    """
    digest = _digest(text, letters)
    with _loading:
        if digest not in _loaded:
            path = cache_folder() / f"{digest}.kernel"
            codes = _read(path)
            if codes is None or codes.keys() != letters.keys():
                codes = _compile(text, letters)
                _write(path, codes)
            _loaded[digest] = {name: load_function(codes[name], each) for name, each in letters.items()}
        return _loaded[digest]


def _digest(text: str, letters: Mapping[str, str]) -> str:
    said = json.dumps([dict(host()), dict(letters), text], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:24]


def _compile(text: str, letters: Mapping[str, str]) -> dict[str, bytes]:
    global _said
    if not _said:
        _said = True
        log.info("compiling the simulation for this computer (once; some seconds) ...")
    begun = time.perf_counter()
    module: dict[str, Any] = {"__name__": "workbench_kernel"}
    exec(compile(text, "<generated kernel>", "exec"), module)
    codes = {name: compile_function(module[name], each) for name, each in letters.items()}
    log.debug("compiled %s in %.1f s", ", ".join(letters), time.perf_counter() - begun)
    return codes


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
    """The codes in a file; None where it is not there or not whole (a full disk, a careless hand)."""
    try:
        head, _, rest = path.read_bytes().partition(b"\n")
        codes, at = {}, 0
        for name, length, digest in json.loads(head):
            codes[name] = rest[at : at + length]
            at += length
            if hashlib.sha256(codes[name]).hexdigest() != digest:
                return None
        return codes
    except (OSError, ValueError, TypeError):
        return None
