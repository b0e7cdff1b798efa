"""A YAML file as plain data plus the line on which each place stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Document:
    """`data` is made of dict, list, str, int, float, bool and None; `lines` maps a place,
    such as ("runs", 2, "payload_kg"), to its line, counted from 1."""

    file: Path
    data: object
    lines: Mapping[Place, int]

    def line(self, place: Place) -> int | None:
        """The line of a place, or of the nearest block around it."""
        for end in range(len(place), -1, -1):
            if place[:end] in self.lines:
                return self.lines[place[:end]]
        return None


def dotted(place: Place) -> str:
    """("runs", 2, "payload_kg") as runs[2].payload_kg."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text
