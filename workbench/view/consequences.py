"""What a machine's effects change in its control study, as bars: before and after, by payload and reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from workbench.machines import Kind
from workbench.metrics import set_of
from workbench.study.consequences import Change, Consequences
from workbench.view.style import GREY, TEMPLATE, faint, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ROOM = 1.16  # over the highest bar, for what stands above it
GAP = 0.10


def before_and_after(consequences: Consequences, height: int = 620) -> Figure:
    """Torque peak and largest speed error, a panel each; per payload each reference's two bars.

    Before: light and hatched. After: solid, with its change in per cent above it. Where a run failed
    "failed" stands in place of its bar. The dotted line is one motor's nominal torque.
    """
    import plotly.graph_objects as go

    kind = consequences.study.kind
    panels = _panels(kind)
    payloads = list(dict.fromkeys(row.payload_kg for row in consequences.rows))
    references = list(dict.fromkeys(row.reference for row in consequences.rows))
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "template": TEMPLATE,
        "height": height,
        "title": {"text": _title(consequences), "y": 1.0 - 22.0 / height, "yanchor": "middle"},
        "legend": {"y": 1.0 - 72.0 / height, "traceorder": "normal"},
        "margin": {"t": 88},
        "barmode": "group",
        "bargap": 0.25,
        "hovermode": "closest",
        "shapes": [],
        "annotations": [],
    }
    tall = (1.0 - GAP) / len(panels)
    for level, (metric, title, unit, scale) in enumerate(panels):
        number = "" if level == 0 else str(level + 1)
        for reference in references:
            rows = [row for row in consequences.rows if row.reference == reference]
            for when in ("before", "after"):
                data.append(
                    _bars(rows, (metric, unit, scale), when, kind) | {"xaxis": f"x{number}", "yaxis": f"y{number}"}
                )
                data[-1]["showlegend"] = level == 0
        top = 1.0 - level * (tall + GAP)
        highest = scale * _highest(consequences.rows, metric)
        if metric == "peak_torque_motor_nm" and (nominal := _nominal(consequences.rows)):
            highest = max(highest, nominal)
            _nominal_line(layout, nominal)
        layout[f"xaxis{number}"] = {
            "anchor": f"y{number}",
            "type": "category",
            "categoryarray": [_place(payload, kind) for payload in payloads],
            "categoryorder": "array",
            "showticklabels": True,
        }
        layout[f"yaxis{number}"] = {
            "domain": [max(top - tall, 0.0), top],
            "anchor": f"x{number}",
            "title": {"text": title},
            "range": [0.0, ROOM * highest],
        }
    layout[f"xaxis{len(panels)}"]["title"] = {"text": "payload" if kind.payload else ""}
    return go.Figure({"data": data, "layout": layout})


def _bars(rows: Sequence[Change], shown: tuple[str, str, float], when: str, kind: Kind) -> dict[str, Any]:
    metric, unit, scale = shown
    colour = line(rows[0].reference)["color"]
    runs = [getattr(row, when) for row in rows]
    values = [scale * run[metric] if run.ok else 0.0 for run in runs]
    before = when == "before"
    changes = ["" if before else _change(row.percent(metric)) for row in rows]
    labels = [change if run.ok else "failed" for run, change in zip(runs, changes, strict=True)]
    light = {"color": faint(colour, 0.18), "line": {"color": colour, "width": 1.2}}
    hatched = {"shape": "/", "fgcolor": colour, "fgopacity": 0.55, "size": 7, "solidity": 0.18}
    return {
        "type": "bar",
        "name": f"{rows[0].reference}, {when}",
        "legendgroup": f"{rows[0].reference}, {when}",
        "offsetgroup": f"{rows[0].reference}, {when}",
        "x": [_place(row.payload_kg, kind) for row in rows],
        "y": values,
        "text": labels,
        "textposition": "outside",
        "textfont": {"size": 11},
        "textangle": 0,
        "cliponaxis": False,
        "marker": {**light, "pattern": hatched}
        if before
        else {"color": colour, "line": {"color": colour, "width": 1.2}},
        "hovertext": [run.reason or f"{value:.4g} {unit}" for run, value in zip(runs, values, strict=True)],
        "hovertemplate": "%{x}: %{hovertext}",
    }


def _change(percent: float) -> str:
    if not math.isfinite(percent):
        return ""
    return f"{percent:+.1f} %" if abs(percent) >= 0.05 else "±0 %"


def _place(payload_kg: float, kind: Kind) -> str:
    return f"{payload_kg:g} kg" if kind.payload else "there and back"


def _panels(kind: Kind) -> tuple[tuple[str, str, str, float], ...]:
    """(metric, title, unit, scale): the largest input and the largest error."""
    if kind.payload:
        return (
            ("peak_torque_motor_nm", "torque peak per motor<br>(N m)", "N m", 1.0),
            ("speed_error_max_rad_s", "largest speed error<br>of the motor (rad/s)", "rad/s", 1.0),
        )
    judged = set_of(kind.name)
    chosen = (judged.by_name[name] for name in (judged.peak, judged.error))
    return tuple((m.name, f"{m.label}<br>({m.shown_unit})", m.shown_unit, m.scale) for m in chosen)


def _highest(rows: Sequence[Change], metric: str) -> float:
    known = [run[metric] for row in rows for run in (row.before, row.after) if run.ok]
    return max(known, default=1.0) or 1.0


def _nominal(rows: Sequence[Change]) -> float | None:
    """One motor's nominal torque, as the runs' two figures of the peak have it."""
    for run in (run for row in rows for run in (row.before, row.after)):
        if run.ok and run["peak_torque_percent"] > 0.0:
            return 100.0 * run["peak_torque_motor_nm"] / run["peak_torque_percent"]
    return None


def _nominal_line(layout: dict[str, Any], nominal_nm: float) -> None:
    layout["shapes"].append(
        {"type": "line", "x0": 0, "x1": 1, "y0": nominal_nm, "y1": nominal_nm, "xref": "x domain", "yref": "y"}
        | {"line": {"color": GREY, "width": 1.2, "dash": "dot"}}
    )
    layout["annotations"].append(
        {"text": f"nominal {nominal_nm:.4g} N m", "x": 0, "y": nominal_nm, "xref": "x domain", "yref": "y"}
        | {"xanchor": "left", "yanchor": "bottom", "showarrow": False, "font": {"size": 11, "color": GREY}}
    )


def _title(consequences: Consequences) -> str:
    names = consequences.effects
    if not names or len(names) > 2:
        return "Control study before and after the correction"
    return f"Control study before and after: {' and '.join(names)}"
