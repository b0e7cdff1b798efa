"""What a machine's effects change in its control study, as bars: before and after, by payload and reference."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from workbench.metrics import set_of
from workbench.study.consequences import Consequences
from workbench.view.style import GREY, TEMPLATE, faint, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def before_and_after(consequences: Consequences, height: int = 620) -> Figure:
    """Torque peak and largest speed error, a panel each; per payload each reference's two bars.

    Before: light and hatched. After: solid, with its change in per cent above it. Where a run failed
    "failed" stands in place of its bar. The dotted line is one motor's nominal torque.
    """
    from plotly.subplots import make_subplots

    kind, rows, names = consequences.study.kind, consequences.rows, consequences.effects
    judged = set_of(kind.name)
    figure: Figure = make_subplots(2, 1, vertical_spacing=0.1)
    for level, metric in enumerate((judged.by_name[judged.peak], judged.by_name[judged.error]), 1):
        known = [metric.scale * run[metric.name] for row in rows for run in (row.before, row.after) if run.ok]
        highest = max(known, default=1.0) or 1.0
        for reference in dict.fromkeys(row.reference for row in rows):
            own, colour = [row for row in rows if row.reference == reference], line(reference)["color"]
            for when in ("before", "after"):
                runs = [getattr(row, when) for row in own]
                values = [metric.scale * run[metric.name] if run.ok else 0.0 for run in runs]
                changes = ["" if when == "before" else _change(row.percent(metric.name)) for row in own]
                look: dict[str, Any] = {"color": colour, "line": {"color": colour, "width": 1.2}}
                if when == "before":
                    look |= {"color": faint(colour, 0.18), "pattern": {"shape": "/", "fgcolor": colour, "size": 7}}
                figure.add_bar(
                    row=level, col=1, name=f"{reference}, {when}", legendgroup=f"{reference}, {when}",
                    offsetgroup=f"{reference}, {when}", showlegend=level == 1, marker=look, y=values,
                    x=[f"{row.payload_kg:g} kg" if kind.payload else "there and back" for row in own],
                    text=[change if run.ok else "failed" for run, change in zip(runs, changes, strict=True)],
                    textposition="outside", textfont_size=11, textangle=0, cliponaxis=False,
                    hovertext=[run.reason or f"{value:.4g} {metric.shown_unit}"
                               for run, value in zip(runs, values, strict=True)],
                    hovertemplate="%{x}: %{hovertext}",
                )  # fmt: skip
        nominal = consequences.nominal if level == 1 else None
        if nominal is not None:
            highest = max(highest, nominal)
            figure.add_hline(
                nominal, row=1, col=1, line={"color": GREY, "width": 1.2, "dash": "dot"},
                annotation={"text": f"nominal {nominal:.4g} N m", "font": {"size": 11, "color": GREY}},
                annotation_position="top left",
            )  # fmt: skip
        # Room over the highest bar for what stands above it.
        figure.update_yaxes(
            title_text=f"{metric.label}<br>({metric.shown_unit})", range=[0.0, 1.16 * highest], row=level, col=1
        )
    figure.update_xaxes(title_text="payload" if kind.payload else "", row=2, col=1)
    title = "Control study before and after"
    title += f": {' and '.join(names)}" if 0 < len(names) <= 2 else " the correction"
    figure.update_layout(
        template=TEMPLATE, height=height, barmode="group", bargap=0.25, hovermode="closest", margin_t=88,
        title={"text": title, "y": 1.0 - 22.0 / height, "yanchor": "middle"},
        legend={"y": 1.0 - 72.0 / height, "traceorder": "normal"},
    )  # fmt: skip
    return figure


def _change(percent: float) -> str:
    if not math.isfinite(percent):
        return ""
    return f"{percent:+.1f} %" if abs(percent) >= 0.05 else "±0 %"
