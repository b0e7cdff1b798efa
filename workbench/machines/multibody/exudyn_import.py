"""The engine, imported where it is used: it is an optional extra."""

from __future__ import annotations

from functools import cache
from typing import Any

from workbench.core.errors import InputError

PINNED = "1.13.6"


@cache
def engine() -> Any:
    """The module exudyn. InputError that says how to install it where it is missing or of another series."""
    try:
        import exudyn
    except ImportError as error:
        raise InputError("the multi-body machine needs exudyn; pip install '.[multibody]'") from error
    version = str(exudyn.__version__)
    if version.split(".")[:2] != PINNED.split(".")[:2]:  # it renames arguments at every minor version
        raise InputError(f"the multi-body machine needs exudyn {PINNED}, not {version}; pip install '.[multibody]'")
    exudyn.config.printToConsole = False  # what matters comes back as an outcome
    return exudyn
