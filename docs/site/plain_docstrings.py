"""Docstrings are plain text with `names`; here they become reStructuredText that says just that."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

SPECIAL = re.compile(r"([\\*|]|_(?!\w))")  # would be markup: |L|, a * b, a name that ends in _
CODE = re.compile(r"``?([^`]+)``?")
ALIAS = re.compile(r"TypeAliasForwardRef\('(?:\w+\.)*(\w+)'\)|(?:\w+\.)+(?=Array\b)")


def rest(line: str, names: Collection[str] = ()) -> str:
    """One line outside an indented block: names in backticks become literals, all else is taken as it stands.

    names: those of the arguments; where one is explained (`name:`) it is set as a literal too.
    """
    if names:
        one = f"(?:{'|'.join(sorted(names))})"
        line = re.sub(rf"(?<![\w`.]){one}(?:, {one})*(?=: )", lambda hit: f"`{hit[0]}`".replace(", ", "`, `"), line)
    parts = CODE.split(line)
    return "".join(f"``{part}``" if k % 2 else SPECIAL.sub(r"\\\1", part) for k, part in enumerate(parts))


def converted(lines: list[str], names: Collection[str] = ()) -> list[str]:
    """A docstring; what is indented deeper than its first line becomes a block of code."""
    found: list[str] = []
    inside = False
    for line in lines:
        deeper = line.startswith("    ")
        if deeper and not inside:
            found += ["", ".. code-block:: none", ""]
        if inside and line and not deeper:
            found.append("")
        inside = deeper or (inside and not line)
        found.append(line if inside else rest(line, names))
    return found


def convert(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    try:
        names = list(inspect.signature(thing).parameters)
    except (TypeError, ValueError):
        names = []
    lines[:] = converted(lines, names)


def shorten(
    app: Sphinx, what: str, name: str, thing: object, options: Any, signature: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """An array is called Array in every signature."""
    return signature and ALIAS.sub(r"\1", signature), result and ALIAS.sub(r"\1", result)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", convert)
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
