"""A diagnosis as the page Gap shows it: the report's sections with their figures, to and from one JSON file.

The worker writes it beside its result, so that the page searches, fits and replays nothing again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.dashboard.widgets import Number
from workbench.errors import InputError
from workbench.figures.save import Section

VIEW = "view.json"


@dataclass(frozen=True)
class View:
    """What the page shows of one diagnosis. lead: what the verdict's probability means, what is alike.

    meaning: what each named effect is. numbers: those that decide. sections: the report's, by what they are about.
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


def write_view(view: View, path: Path) -> None:
    """As JSON."""
    path.write_text(json.dumps(_as_json(view)), encoding="utf-8")


def read_view(path: Path) -> View:
    """InputError for a file that is gone or damaged."""
    try:
        return _from_json(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("this diagnosis' result is damaged; diagnose the campaign again", file=path) from error


def _as_json(view: View) -> dict[str, Any]:
    sections = {
        name: vars(section) | {"figures": [[json.loads(figure.to_json()), note] for figure, note in section.figures]}
        for name, section in view.sections.items()
    }
    return vars(view) | {"numbers": [each._asdict() for each in view.numbers], "sections": sections}


def _from_json(said: dict[str, Any]) -> View:
    import plotly.graph_objects as go

    sections = {
        name: Section(**section | {"figures": [(go.Figure(figure), note) for figure, note in section["figures"]]})
        for name, section in said["sections"].items()
    }
    return View(**said | {"numbers": [Number(**each) for each in said["numbers"]], "sections": sections})
