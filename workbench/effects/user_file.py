"""A user's Python file of effects, as it was read."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from workbench.errors import InputError
from workbench.input_file import read_input


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
    if file.is_file() and file.suffix != ".py":
        raise InputError("is no Python file (.py)", file=file)
    return UserFile(str(file.resolve()), read_input(file, "python"))
