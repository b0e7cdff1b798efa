"""A sub-package that can be called: `workbench.study(...)` beside `workbench.study.results`."""

from __future__ import annotations

import importlib
import inspect
import sys
from types import ModuleType
from typing import Any


def attribute(name: str) -> Any:
    """The object `package.module:name`, imported now: the only way for a lower layer to use a higher one."""
    module, _, inner = name.partition(":")
    return getattr(importlib.import_module(module), inner)


class Verb(ModuleType):
    """A package whose call is the function of the same name in `workbench.api`.

    The import system binds a sub-package to its name in the parent package, so a function of that name cannot
    stand there. The package itself takes the call instead.
    """

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self.__wrapped__(*args, **options)

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        task = self.__wrapped__
        return f"{inspect.getdoc(task)}\n\n{self.__name__}{inspect.signature(task)}"

    @property
    def __wrapped__(self) -> Any:
        """The function; `inspect.signature` and notebooks follow it."""
        name = self.__name__.rpartition(".")[2]
        return attribute(f"workbench.api:{name}")


def make_callable(package: str) -> None:
    """Let the package of this name be called; its `__init__` says so of itself."""
    sys.modules[package].__class__ = Verb
