"""The first page's study on disk, as its kernels are: a server that starts again need not run it again.

found(what, scenario, machine)   what an earlier start has kept of this very study; None where it has nothing
keep(values)                     writes them, for the next start
is_kept()                        whether there is a whole file; kept_file() is where

The file is named after a hash of all sources of the package and of the libraries' versions: an edit of any gives
another name, and the study runs. Like a kernel it is code to whoever reads it, so it is taken from the kernels' folder
and from this user's own file only.
"""

from __future__ import annotations

import contextlib
import copyreg
import hashlib
import io
import json
import os
import pickle
import sys
import tempfile
import threading
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

from workbench.dashboard.warm import started
from workbench.engine.native import cache_folder, own_bytes
from workbench.machine import Axis, Hoist
from workbench.machine.files import machine_text
from workbench.metrics import columns
from workbench.study.scenario.record import Scenario

LIBRARIES = ("numpy", "numba", "llvmlite", "scipy", "ruckig", "pydantic")
ENDING = ".study"
NEWEST = 4  # files that stay: of other checkouts and versions
_reading = threading.Lock()
_kept: dict[str, Any] | None = None


def found(what: str, scenario: Scenario, machine: Hoist | Axis) -> Any:
    """`what`: which of the study's results. Only a server that has been warmed up looks."""
    kept = _all() if started() else {}
    return kept.get(key(what, scenario, machine)) if kept else None


def is_kept() -> bool:
    return bool(_all())


def key(what: str, scenario: Scenario, machine: Hoist | Axis) -> str:
    return json.dumps([what, scenario.model_dump_json(), machine_text(machine), *columns()])


def keep(values: Mapping[str, Any]) -> None:
    """values: by `key`. A full disk or a read-only one keeps nothing."""
    said = io.BytesIO()
    _Pickler(said, pickle.HIGHEST_PROTOCOL).dump(dict(values))
    body = said.getvalue()
    with contextlib.suppress(OSError):
        path = kept_file()
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(body).digest() + body)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
        for old in sorted(path.parent.glob(f"*{ENDING}"), key=lambda file: file.stat().st_mtime)[:-NEWEST]:
            old.unlink()


def _all() -> dict[str, Any]:
    """What the file holds, read once; {} where it is not there, not whole or not one's own."""
    global _kept
    with _reading:
        if _kept is None:
            _kept = {}
            with contextlib.suppress(Exception):  # whatever a damaged file does
                said = own_bytes(kept_file())
                if hashlib.sha256(said[32:]).digest() == said[:32]:
                    _kept = pickle.loads(said[32:])
        return _kept


@cache
def kept_file() -> Path:
    """Where this version keeps it."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted([*root.rglob("*.py"), *root.rglob("*.yaml")]):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    beside = [sys.version, *(version(name) for name in LIBRARIES)]
    digest.update(json.dumps(beside).encode())
    return cache_folder() / f"{digest.hexdigest()[:24]}{ENDING}"


def _proxy(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


class _Pickler(pickle.Pickler):
    """Pickles the read-only mappings of frozen records, too."""

    dispatch_table = copyreg.dispatch_table | {MappingProxyType: lambda values: (_proxy, (dict(values),))}
