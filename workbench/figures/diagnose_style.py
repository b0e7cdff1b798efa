"""What the figures of a diagnosis share: before is one colour, after another, the noise floor a grey dashed line."""

from __future__ import annotations

from typing import Any

from workbench.figures.style import AFTER, BEFORE, BLACK, GREY, YELLOW

WINDOW, REST = YELLOW, "#BBBBBB"
MEASURED: dict[str, Any] = {"color": BLACK, "dash": "solid", "width": 2.6, "simplify": False}
LINE_BEFORE: dict[str, Any] = {"color": BEFORE, "dash": "solid", "width": 1.2, "simplify": False}
LINE_AFTER: dict[str, Any] = {"color": AFTER, "dash": "solid", "width": 1.2, "simplify": False}
NOISE_DASH = "5px,4px"
NOISE: dict[str, Any] = {"color": GREY, "width": 1.4, "dash": NOISE_DASH}


def heading(text: str, height: int) -> dict[str, Any]:
    """A figure's title, in the same place whatever its height."""
    return {"text": text, "y": 1.0 - 22.0 / height, "yanchor": "middle"}
