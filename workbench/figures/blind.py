"""The blind test in figures: shares right by the size of the gap, the reliability curve, the power of an experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from workbench.core.names import unit_of
from workbench.view.style import BLUE, FAINT, GREY, ORANGE, SKY, TEMPLATE, VERMILLION, heading

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


ROW = 36  # pixels of the power chart for each effect
BUYS = 0.9  # of an amount: less with one more run is written beside it
APART = 0.07  # of the distance of two sizes: measures stand side by side


RIGHT_ANSWER = {"unlisted cause": "unknown"}  # where it has another name than what is in the machine


class Share(Protocol):
    """A share with its 95 % interval."""

    @property
    def count(self) -> int: ...
    @property
    def of(self) -> int: ...
    def interval(self) -> tuple[float, float]: ...


class Bin(Protocol):
    """Answers of about one probability."""

    @property
    def said(self) -> float: ...
    @property
    def right(self) -> Share: ...


class EffectPower(Protocol):
    """change: the smallest change of the input, rms, at which an effect is named in nine of ten; None: none tried."""

    @property
    def effect(self) -> str: ...
    @property
    def parameter(self) -> str: ...
    @property
    def amount(self) -> float | None: ...
    @property
    def one_more(self) -> float | None: ...
    @property
    def largest_tried(self) -> float: ...
    @property
    def change(self) -> float | None: ...
    @property
    def change_interval(self) -> tuple[float, float] | None: ...
    @property
    def change_one_more(self) -> float | None: ...
    @property
    def largest_change_tried(self) -> float: ...


def _figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    """The legend stands below the title."""
    import plotly.graph_objects as go

    legend = {"y": 1.0 - 68.0 / layout["height"], "traceorder": "normal"}
    return go.Figure({"data": data, "layout": {"template": TEMPLATE, "legend": legend, **layout}})


def _with_interval(shares: Sequence[Share]) -> dict[str, Any]:
    """Per cent, and how far the interval reaches either way."""
    at = [100.0 * share.count / share.of for share in shares]
    ends = [share.interval() for share in shares]
    return {
        "y": at,
        "error_y": {
            "type": "data",
            "symmetric": False,
            "array": [100.0 * high - y for (_, high), y in zip(ends, at, strict=True)],
            "arrayminus": [y - 100.0 * low for (low, _), y in zip(ends, at, strict=True)],
            "thickness": 1.2,
        },
    }


def right_by_size(shares: Mapping[str, Mapping[str, Share]], height: int = 400) -> Figure:
    """shares: measure -> size of the gap -> share; a line a measure, with 95 % intervals, side by side."""
    colours = (BLUE, ORANGE, VERMILLION, GREY)
    sizes = list(dict.fromkeys(size for by_size in shares.values() for size in by_size))
    data: list[dict[str, Any]] = []
    for k, (name, by_size) in enumerate(shares.items()):
        there = {size: share for size, share in by_size.items() if share.of}
        beside = APART * (k - 0.5 * (len(shares) - 1))
        data.append(
            {
                "type": "scatter", "mode": "lines+markers", "name": name,
                "x": [sizes.index(size) + beside for size in there],
                **_with_interval(list(there.values())), "line": {"color": colours[k % 4]},
                "marker": {"size": 9, "symbol": k}, "text": [f"{s.count} of {s.of}" for s in there.values()],
                "hovertemplate": "%{y:.0f} %, %{text}",
            }
        )  # fmt: skip
    layout = {
        "title": heading("Answers that are right, by the size of the gap", height),
        "height": height,
        "hovermode": "closest",
        "xaxis": {
            "title": {"text": "gap over noise"},
            "tickvals": list(range(len(sizes))),
            "ticktext": sizes,
            "zeroline": False,
        },
        "yaxis": {"title": {"text": "share (%)"}, "range": [0, 104]},
    }
    return _figure(data, layout)


def confusion(counts: Mapping[str, Mapping[str, int]]) -> Figure:
    """counts: what is in the machine -> answer -> how often. A row a label, a column an answer; right is on the
    diagonal."""
    told = list(counts)
    right = [RIGHT_ANSWER.get(name, name) for name in told]
    said = sorted({name for answers in counts.values() for name in answers if name not in right})
    columns = [*right, *said]
    height = 240 + 24 * len(told)
    shares = [[answers.get(name, 0) / sum(answers.values()) for name in columns] for answers in counts.values()]
    data = [
        {
            "type": "heatmap", "x": columns, "y": told, "z": shares, "zmin": 0, "zmax": 1, "showscale": False,
            "colorscale": [[0.0, "#F6F6F6"], [1.0, SKY]], "xgap": 1, "ygap": 1, "texttemplate": "%{text}",
            "text": [[answers.get(name) or "" for name in columns] for answers in counts.values()],
            "hovertemplate": "%{y}: answered %{x} %{text} times<extra></extra>",
        }
    ]  # fmt: skip
    layout = {
        "title": heading("What was answered; right is on the diagonal", height),
        "height": height,
        "hovermode": "closest",
        "margin": {"l": 210, "r": 28, "t": 84, "b": 170},
        "xaxis": {"title": {"text": "answer"}, "type": "category", "tickangle": -60, "showgrid": False},
        "yaxis": {"title": {"text": "in the machine"}, "type": "category", "autorange": "reversed", "showgrid": False},
    }
    return _figure(data, layout)


def reliability(bins: Sequence[Bin], height: int = 420) -> Figure:
    """Share right over the probability that answers had; on the diagonal they say what they are worth."""
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines", "x": [0, 100], "y": [0, 100], "name": "as said",
            "line": {"color": GREY, "dash": "5px,4px", "width": 1.4}, "hoverinfo": "skip",
        },
        {
            "type": "scatter", "mode": "lines+markers", "x": [100.0 * b.said for b in bins], "name": "measured",
            **_with_interval([b.right for b in bins]), "line": {"color": BLUE}, "marker": {"size": 9},
            "text": [f"{b.right.count} of {b.right.of}" for b in bins], "hovertemplate": "%{y:.0f} %, %{text}",
        },
    ]  # fmt: skip
    layout = {
        "title": heading("Reliability of the probabilities", height),
        "height": height,
        "hovermode": "closest",
        "xaxis": {"title": {"text": "probability of the answer (%)"}, "range": [0, 104]},
        "yaxis": {"title": {"text": "right (%)"}, "range": [0, 104]},
    }
    return _figure(data, layout)


def power(effects: Sequence[EffectPower], unit: str) -> Figure:
    """The power chart: for each effect the smallest change of the input that is named in 9 of 10 cases, its interval,
    and the same with one more run, each with the effect's own amount above it. An arrow: not within the sizes tried."""
    shown = sorted(effects, key=lambda e: (e.change is None, e.change or e.largest_change_tried), reverse=True)
    height = 150 + ROW * len(shown)
    named = [effect for effect in shown if effect.change is not None]
    beyond = [effect for effect in shown if effect.change is None]
    more = [effect for effect in named if effect.change_one_more is not None]

    def points(
        name: str,
        which: Sequence[EffectPower],
        x: Sequence[Any],
        amounts: Sequence[float | None],
        marker: dict[str, Any],
    ) -> dict[str, Any]:
        own = [_amount(effect.parameter, amount) for effect, amount in zip(which, amounts, strict=True)]
        look = {"type": "scatter", "mode": "markers+text", "name": name, "marker": {"size": 10, **marker}}
        look |= {"text": own, "textposition": "top center", "textfont": {"size": 10, "color": marker["color"]}}
        at = {"x": list(x), "y": [effect.effect for effect in which]}
        return {**look, **at, "hovertemplate": f"%{{text}}, %{{x:.3~g}} {unit}", "cliponaxis": False}

    data = [points("these runs", named, [e.change for e in named], [e.amount for e in named], {"color": BLUE})]
    reach = [effect.change_interval or (effect.change, effect.change) for effect in named]
    data[0]["error_x"] = {
        "type": "data",
        "symmetric": False,
        "array": [(high or 0.0) - (effect.change or 0.0) for (_, high), effect in zip(reach, named, strict=True)],
        "arrayminus": [(effect.change or 0.0) - (low or 0.0) for (low, _), effect in zip(reach, named, strict=True)],
        "thickness": 1.2,
    }
    if more:
        x = [effect.change_one_more for effect in more]
        marker = {"color": ORANGE, "symbol": "diamond-open"}
        buys = [e.one_more if e.one_more and e.amount and e.one_more < BUYS * e.amount else None for e in more]
        data.append({**points("with one more run", more, x, buys, marker), "textposition": "bottom center"})
    if beyond:
        x = [effect.largest_change_tried for effect in beyond]
        marker = {"color": VERMILLION, "symbol": "triangle-right"}
        tried = points("not within the sizes tried", beyond, x, [e.largest_tried for e in beyond], marker)
        data.append({**tried, "text": [f"> {amount}" for amount in tried["text"]]})
    layout = {
        "title": heading("The smallest effect that these runs would have named in 9 of 10", height),
        "height": height,
        "hovermode": "closest",
        "margin": {"l": 210, "r": 28, "t": 84, "b": 60},
        "xaxis": {"title": {"text": f"change of the input, rms while moving ({unit})"}, "type": "log"},
        "yaxis": {"categoryorder": "array", "categoryarray": [effect.effect for effect in shown], "gridcolor": FAINT},
    }
    return _figure(data, layout)


def _amount(parameter: str, value: float | None) -> str:
    """As 2150 N s/m; "" for none."""
    return "" if value is None else f"{float(f'{value:.3g}'):.10g} {unit_of(parameter)}".strip()
