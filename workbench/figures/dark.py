"""The same figure for a dark ground: grounds, inks and greys change, the palette's colours stay."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from workbench.figures.style import BLACK, FAINT, GREY, TEMPLATE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

GROUND, INK, LESS, GRID, ZERO = "#0E1117", "#E8E8E8", "#A8A8A8", "#2B303B", "#4A5060"
_LIGHT_TO_DARK = {
    BLACK: INK,
    "black": INK,
    "#222222": INK,
    "white": GROUND,
    "#ffffff": GROUND,
    GREY: LESS,
    FAINT: GRID,
    "#BDBDBD": ZERO,
    "#F8E6C0": "#4A3A1C",  # half-way in the scale of angles
}
_GLASS, _DARK_GLASS = "rgba(255,255,255,", "rgba(14,17,23,"  # behind words that stand on lines
_DARK = {light.lower(): dark for light, dark in _LIGHT_TO_DARK.items()}


def _turned(value: Any) -> Any:
    if isinstance(value, str):
        return _DARK.get(value.lower(), value.replace(_GLASS, _DARK_GLASS))
    if isinstance(value, dict):
        return {key: _turned(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        if len(value) == 2 and isinstance(value[1], str):  # a stop of a colour scale
            return [_turned(part) for part in value]
        return [_turned(part) for part in value] if value and not isinstance(value[0], int | float) else value
    return value


DARK_TEMPLATE: dict[str, Any] = _turned(TEMPLATE)
DARK_TEMPLATE["layout"]["hoverlabel"] = DARK_TEMPLATE["layout"]["hoverlabel"] | {"bgcolor": "#1D2330"}


def for_dark(figure: Figure) -> Figure:
    """A copy of the figure with light ink on a dark ground."""
    import plotly.graph_objects as go

    parts = figure.to_dict()
    layout = {key: value for key, value in parts["layout"].items() if key != "template"}
    return go.Figure({"data": _turned(parts["data"]), "layout": _turned(layout) | {"template": DARK_TEMPLATE}})
