"""Jinja2 templates of the package: they stand beside the modules that fill them; what is filled in is escaped."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def render(name: str, **values: Any) -> Markup:
    """The template `name`, a path within the package, filled in. jinja2.UndefinedError for a value that is missing."""
    from markupsafe import Markup

    return Markup(_environment().get_template(name).render(values))


class Sentences:
    """The macros of a template as functions, each of which gives one line of plain text.

    names: what the template may use beside what each call gives. AttributeError for a macro that is not there.
    """

    def __init__(self, name: str, **names: Any) -> None:
        self._name, self._names = name, {"f": format, **names}

    @cached_property
    def _module(self) -> Any:
        return _environment(escape=False).get_template(self._name, globals=self._names).module

    def __getattr__(self, macro: str) -> Callable[..., str]:
        if macro.startswith("_"):  # what Python asks of any object
            raise AttributeError(macro)
        return lambda *values: " ".join(self.each(macro, *values))

    def each(self, macro: str, *values: Any) -> list[str]:
        """The sentences of a macro, which empty lines part there."""
        parts = re.split(r"\n[ \n]*\n", getattr(self._module, macro)(*values))
        # A full stop or a bracket may stand in a line of its own there; a non-breaking space stays one.
        lines = (re.sub(r" (?=[.,;:)])", "", re.sub(r"[ \n]+", " ", part).strip(" \n")) for part in parts)
        return [line for line in lines if line]


@cache
def _environment(escape: bool = True) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("workbench", ""),
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["code"] = code
    return environment


def code(sentence: str) -> Markup:
    """A sentence, escaped; what stands in backticks is set as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(sentence))))
