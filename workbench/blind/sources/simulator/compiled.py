"""The folder of the compiled kernels: outside the repository, one for each state of the sources."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numba

HERE = Path(__file__).parent


def kernel_folder() -> Path:
    """numba does not see that a function called from another module has changed; the folder's name does."""
    sources = sorted(HERE.rglob("kernel.py")) + sorted(HERE.rglob("truth.py")) + [HERE / "standstill.py"]
    state = hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()[:12]
    owner = os.getuid() if hasattr(os, "getuid") else "own"
    root = os.environ.get("NUMBA_CACHE_DIR") or str(Path(tempfile.gettempdir()) / f"campaign-kernels-{owner}")
    return Path(root) / state


@contextmanager
def own_cache() -> Iterator[None]:
    """While functions are decorated: numba asks for the folder then. Others' kernels keep theirs."""
    folder = kernel_folder()
    folder.mkdir(parents=True, exist_ok=True)
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before
