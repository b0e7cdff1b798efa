"""Whether a result's files are still what was written: their hashes stand in its manifest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.input_file import open_input, read_input

MANIFEST = "manifest.json"
HASHED = ("index.parquet", "scenario.yaml", "machine.yaml")


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """What a folder's manifest says; None where there is none, half of one, or one of another form."""
    try:
        said = json.loads(read_input(folder / MANIFEST, "json"))
    except (InputError, ValueError, RecursionError):
        return None
    if not isinstance(said, dict) or not isinstance(said.get("study", ""), str):
        return None
    blocks = (said.get(name) or {} for name in ("runs", "versions", "files", "effects"))
    return said if all(isinstance(block, dict) for block in blocks) else None


def digests(folder: Path) -> dict[str, str]:
    """File -> SHA-256 of those files of a result that a report and a comparison read."""
    return {name: _digest(folder / name) for name in HASHED if (folder / name).is_file()}


def check_whole(folder: Path, name: str) -> None:
    """InputError where a file is not what its manifest says; earlier versions said nothing."""
    said: Mapping[str, Any] = (read_manifest(folder) or {}).get("files") or {}
    file = folder / name
    if name not in said or not file.is_file():
        return
    if _digest(file) != said[name]:
        raise InputError(f"is not what was written, as {MANIFEST} says: the result is damaged", file=file)


def _digest(file: Path) -> str:
    with open_input(file, "table") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
