"""A diagnosis as the page Gap shows it: the report's sections with their figures, to and from one JSON file.

The worker writes it beside its result, so that the page searches, fits and replays nothing again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from workbench.dashboard.section_file import with_figures
from workbench.dashboard.widgets import Number
from workbench.errors import InputError
from workbench.figures.save import Section

VIEW = "view.json"


@dataclass(frozen=True)
class View:
    """What the page shows of one diagnosis. lead: what the verdict's probability means, what is alike.

    meaning: what each named effect is. numbers: those that decide. sections: the report's, by what they are about.
    plain: the verdict in plain words. place: a drawing of the machine with the gap's place marked, SVG.
    """

    campaign: str
    machine: str
    verdict: str
    sentence: str
    lead: Sequence[str]
    meaning: Sequence[str]
    warnings: Sequence[str]
    numbers: Sequence[Number]
    sections: Mapping[str, Section]
    plain: Sequence[str] = ()
    place: str = ""


@cache
def _adapter() -> TypeAdapter[View]:
    return TypeAdapter(View)


def write_view(view: View, path: Path) -> None:
    """As JSON; a figure is plotly's own JSON."""
    path.write_bytes(_adapter().dump_json(view, fallback=lambda figure: from_json(figure.to_json())))


def read_view(path: Path) -> View:
    """InputError for a file that is gone or damaged."""
    try:
        view = _adapter().validate_json(path.read_bytes())
        sections = {name: with_figures(section) for name, section in view.sections.items()}
    except (OSError, ValidationError, ValueError, TypeError) as error:
        raise InputError("this diagnosis' result is damaged; diagnose the campaign again", file=path) from error
    return replace(view, sections=sections)
