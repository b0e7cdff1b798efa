"""A report's section, with its figures, to and from one JSON file: a worker writes it, a page shows it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from workbench.errors import InputError
from workbench.figures.save import Section


@cache
def _adapter() -> TypeAdapter[Section]:
    return TypeAdapter(Section)


def write_section(section: Section, path: Path) -> None:
    """As JSON; a figure is plotly's own JSON."""
    path.write_bytes(_adapter().dump_json(section, fallback=lambda figure: from_json(figure.to_json())))


def read_section(path: Path) -> Section:
    """InputError for a file that is gone or damaged."""
    try:
        return with_figures(_adapter().validate_json(path.read_bytes()))
    except (OSError, ValidationError, ValueError, TypeError) as error:
        raise InputError("this result is damaged; compute it again", file=path) from error


def with_figures(section: Section) -> Section:
    """The same, its figures' JSON made figures again."""
    import plotly.graph_objects as go

    figures: list[tuple[Any, str]] = [(go.Figure(figure), note) for figure, note in section.figures]
    return replace(section, figures=figures)
