"""A diagnosis as a file: a pickle that is read back without running anything but the making of records."""

from __future__ import annotations

import io
import pickle
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.diagnose.diagnose import Diagnosis

FILE = "diagnosis.pickle"
# What arrays, paths and sets are made of.
_PLAIN = {
    "builtins": {"set", "frozenset", "complex", "slice"},
    "collections": {"OrderedDict"},
    "pathlib": {"Path", "PosixPath", "WindowsPath", "PurePosixPath", "PureWindowsPath"},
    "workbench.machines.kinds": {"kind_named"},
    "numpy": {"ndarray", "dtype", "bool_"},
    "numpy.core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy.core.numeric": {"_frombuffer"},
    "numpy._core.numeric": {"_frombuffer"},
}


_ROOMS = {"core", "machines", "logs", "effects", "references", "control", "simulate", "study", "diagnose"}


class _Records(pickle.Unpickler):
    """Knows this program's records, and what arrays are made of; nothing else that a pickle may name."""

    def find_class(self, module: str, name: str) -> Any:
        if name in _PLAIN.get(module, ()):
            return super().find_class(module, name)
        room = module.split(".")[1] if module.startswith("workbench.") else ""
        found = super().find_class(module, name) if room in _ROOMS and "." not in name else None
        if isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum | BaseModel)):
            return found
        raise pickle.UnpicklingError(f"{module}.{name} is no record of a diagnosis")


def write_diagnosis_file(diagnosis: Diagnosis, path: Path) -> None:
    path.write_bytes(pickle.dumps(diagnosis))


def read_diagnosis_file(path: Path) -> Diagnosis:
    """InputError for a file that is gone, damaged, or not such a diagnosis."""
    try:
        diagnosis = _Records(io.BytesIO(read_input(path, "diagnosis"))).load()
    except InputError:
        raise
    except Exception as error:  # a damaged pickle may raise anything
        raise InputError(f"is no saved diagnosis of this version: {error}", file=path) from error
    if not isinstance(diagnosis, Diagnosis):
        raise InputError(f"holds a {type(diagnosis).__name__}, expected a diagnosis", file=path)
    return diagnosis
