"""Generated kernels on disk: compiled once, found again by what they say.

A kernel's module is named after the hash of its whole text and of the compiler's
version. The text holds all physics, straight-line, so an edit of any equation gives
another name and can never meet an old binary; numba's own cache does not notice
such edits across modules.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
import threading
import time
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

log = logging.getLogger(__name__)
_loading = threading.Lock()  # a module half loaded by one thread is not for another


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


def load_module(text: str) -> ModuleType:
    """A generated module, imported from its place on disk; its functions compile at their first call."""
    with _loading:
        return _module(text)


def _module(text: str) -> ModuleType:
    import numba

    version = f"{sys.version_info[:2]} numba {numba.__version__}"
    digest = hashlib.sha256(f"{version}\n{text}".encode()).hexdigest()[:24]
    module_name = f"workbench_kernel_{digest}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    path = cache_folder() / f"{module_name}.py"
    if not _holds(path, text):
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


def _holds(path: Path, text: str) -> bool:
    """Whether the file is there and whole: a disk that filled up or a careless hand may have spoilt it."""
    try:
        return path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


def compiled_before(function: Any) -> bool:
    """Whether the on-disk cache already holds this function for this machine."""
    path = Path(function.py_func.__code__.co_filename)
    return any((path.parent / "__pycache__").glob(f"{path.stem}.{function.py_func.__name__}-*.nbc"))


class announced:
    """Says, once per process, that kernels are being compiled, and how long it took."""

    said = False

    def __init__(self, what: str, needed: bool) -> None:
        self.what, self.needed = what, needed

    def __enter__(self) -> None:
        self.begun = time.perf_counter()
        if self.needed and not announced.said:
            announced.said = True
            log.info("compiling the %s for this computer (once; some seconds) ...", self.what)

    def __exit__(self, *_: object) -> None:
        if self.needed:
            log.debug("compiled the %s in %.1f s", self.what, time.perf_counter() - self.begun)
