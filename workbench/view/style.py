"""What every figure shares: the palette, the names, the look of the axes, on a light and on a dark ground.

The palette is Okabe and Ito's, which stays apart for the colour-blind (B. Wong, Nature Methods 8, 2011, p. 441); its
orange and its sky blue are darker here, so that a line has a contrast of 3:1 on white and on the dark ground (WCAG 2.2,
1.4.11).
What a colour stands for never changes: a reference, measured or simulated keeps its own everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from workbench.references.kind import by_name

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
else:
    Figure = Any  # named in records and signatures without loading plotly

BLACK, ORANGE, SKY, GREEN = "#000000", "#C07F00", "#3390C6", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, FAINT = "#6B6B6B", "#E4E4E4"
BEFORE, AFTER = ORANGE, GREEN  # a machine corrected or identified
WINDOW, REST = YELLOW, "#BBBBBB"  # a window of the gap; what a comparison leaves out

# Each line: colour and dash, so that a black-and-white print tells them apart too. References declare their own.
LINES: dict[str, tuple[str, str]] = {
    "measured": (BLACK, "solid"),
    "simulated": (ORANGE, "solid"),
    "set point": (GREY, "2px,2px"),
    "motor 1": (SKY, "solid"),
    "motor 2": (PURPLE, "4px,2px"),
}


def look(colour: str, dash: str = "solid", width: float = 1.8) -> dict[str, Any]:
    """A line of Plotly's, with every point that it is given."""
    return {"color": colour, "dash": dash, "width": width, "simplify": False}


# A comparison before and after; the noise floor is a grey dashed line.
MEASURED, LINE_BEFORE, LINE_AFTER = look(BLACK, width=2.6), look(BEFORE, width=1.2), look(AFTER, width=1.2)
NOISE_DASH = "5px,4px"
NOISE: dict[str, Any] = {"color": GREY, "width": 1.4, "dash": NOISE_DASH}
# For what has no colour of its own, in this order.
SPARE = (
    (PURPLE, "solid"),
    (SKY, "6px,3px"),
    (ORANGE, "6px,3px"),
    (BLACK, "2px,2px"),
    (GREEN, "8px,3px,2px,3px"),
    (VERMILLION, "4px,2px"),
)
MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star")


def line(name: str, number: int = 0, width: float = 1.8) -> dict[str, Any]:
    """The line of a name, such as a kind of reference; `number` chooses a spare one for a name without its own."""
    kind = by_name().get(name)
    own = (kind.colour, kind.dash) if kind is not None and kind.colour else None
    return look(*(own or LINES.get(name, SPARE[number % len(SPARE)])), width)


def label(name: str) -> str:
    """A kind of reference as legends and choices name it; any other name as it is."""
    kind = by_name().get(name)
    return name if kind is None else kind.label


def faint(colour: str, opacity: float = 0.15) -> str:
    """A colour of the palette that lets through what lies below."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


AXIS: dict[str, Any] = {
    "showline": True, "linecolor": GREY, "linewidth": 1, "ticks": "outside", "tickcolor": GREY, "ticklen": 4,
    "gridcolor": FAINT, "zeroline": True, "zerolinecolor": "#BDBDBD", "zerolinewidth": 1, "tickfont": {"size": 12},
    "title": {"font": {"size": 13}, "standoff": 6}, "automargin": True,
    "minexponent": 6,  # 10000 kg, not 10k
}  # fmt: skip
TEMPLATE: dict[str, Any] = {
    "layout": {
        "font": {"family": "DejaVu Sans, Segoe UI, Arial, sans-serif", "size": 13, "color": "#222222"},
        "paper_bgcolor": "white", "plot_bgcolor": "white", "hovermode": "x",
        "margin": {"l": 84, "r": 28, "t": 84, "b": 52},
        "title": {"x": 0.0, "xref": "container", "xanchor": "left", "pad": {"l": 16}, "font": {"size": 17}},
        "separators": ".\u2009",  # 10 000, with a thin space
        "hoverlabel": {"font": {"size": 12}, "namelength": -1},
        "legend": {"orientation": "h", "x": 0.0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "yref": "container",
                   "font": {"size": 13}},
        "xaxis": AXIS, "yaxis": AXIS,
    }
}  # fmt: skip


def heading(text: str, height: int) -> dict[str, Any]:
    """A figure's title, in the same place whatever its height."""
    return {"text": text, "y": 1.0 - 22.0 / height, "yanchor": "middle"}


def legend(height: int, down: float = 68.0) -> dict[str, Any]:
    """A legend's place, so many px below a figure's upper edge."""
    return {"y": 1.0 - down / height, "traceorder": "normal"}


def figure(title: str, height: int, data: list[dict[str, Any]], **layout: Any) -> Figure:
    """A figure in the common look; layout: what is its own."""
    import plotly.graph_objects as go

    shared = {"template": TEMPLATE, "height": height, "hovermode": "closest", "title": heading(title, height)}
    return go.Figure({"data": data, "layout": shared | layout})


# The same figure on a dark ground: grounds, inks and greys change, the colours of the palette stay.
GROUND, INK, LESS, GRID, ZERO = "#0E1117", "#E8E8E8", "#A8A8A8", "#2B303B", "#4A5060"
_DARK = {
    BLACK: INK, "black": INK, "#222222": INK, "white": GROUND, "#ffffff": GROUND, GREY.lower(): LESS,
    FAINT.lower(): GRID, "#bdbdbd": ZERO, "#f8e6c0": "#4A3A1C",  # half-way in the scale of angles
}  # fmt: skip
_GLASS, _DARK_GLASS = "rgba(255,255,255,", "rgba(14,17,23,"  # behind words that stand on lines


def on_dark(colour: str) -> str:
    """What a colour of the light ground becomes on the dark one."""
    return _DARK.get(colour.lower(), colour)


def _turned(value: Any) -> Any:
    if isinstance(value, str):
        return _DARK.get(value.lower(), value.replace(_GLASS, _DARK_GLASS))
    if isinstance(value, dict):
        return {key: _turned(part) for key, part in value.items()}
    if isinstance(value, list | tuple) and any(isinstance(part, str | dict | list | tuple) for part in value):
        return [_turned(part) for part in value]  # words, shapes, or the stops of a colour scale
    return value


DARK_TEMPLATE: dict[str, Any] = _turned(TEMPLATE)
DARK_TEMPLATE["layout"]["hoverlabel"] = DARK_TEMPLATE["layout"]["hoverlabel"] | {"bgcolor": "#1D2330"}


def for_dark(figure: Figure) -> Figure:
    """A copy of the figure with light ink on a dark ground."""
    import plotly.graph_objects as go

    parts = figure.to_dict()
    layout = {key: value for key, value in parts["layout"].items() if key != "template"}
    return go.Figure({"data": _turned(parts["data"]), "layout": _turned(layout) | {"template": DARK_TEMPLATE}})
