"""Figures of a family of linear loops: Bode, Nyquist, gang of four, step responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.analysis.family import Member, Weakest, weakest
from workbench.analysis.step import StepResponse, step_response
from workbench.core.names import powers
from workbench.core.run import Array
from workbench.figures.panels import Panels
from workbench.machines import Kind
from workbench.view.style import BLUE, FAINT, GREEN, GREY, ORANGE, PURPLE, SKY, TEMPLATE, VERMILLION

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LOWEST_HZ = 0.02
# A colour a payload, a dash a height: both can be told apart, and in black and white the heights still.
COLOURS = (BLUE, GREEN, VERMILLION, PURPLE, ORANGE, SKY)
DASHES = ("solid", "8px,3px", "2px,2px", "8px,3px,2px,3px")
POINTS = 600
HZ, RAD_S = ("Hz", 1.0), ("rad/s", 2.0 * math.pi)  # a unit of frequency and what makes it of Hz


def member_name(member: Member) -> str:
    kind, point = member.loop.kind, member.point
    load = f"{point.payload_kg:g} kg, " if kind.payload else ""
    return f"{load}{point.height_m:g} {kind.moved.unit}"


def _looks(members: Sequence[Member]) -> list[dict[str, Any]]:
    payloads = list(dict.fromkeys(m.point.payload_kg for m in members))
    heights = list(dict.fromkeys(m.point.height_m for m in members))
    return [
        {
            "color": COLOURS[payloads.index(m.point.payload_kg) % len(COLOURS)],
            "dash": DASHES[heights.index(m.point.height_m) % len(DASHES)],
            "width": 1.8,
            "simplify": False,
        }
        for m in members
    ]


def _frequencies(member: Member) -> Array:
    """Even in log, and the loop's own dense ones, so that sharp peaks are drawn."""
    nyquist = member.loop.nyquist_hz
    own = member.loop.grid()
    f = np.unique(np.concatenate([np.geomspace(LOWEST_HZ, nyquist, POINTS), own[own > LOWEST_HZ]]))
    return f[f <= nyquist]


def _db(values: Any) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(values)))


def _log_axes(figure: Figure, members: Sequence[Member], per_hz: float) -> Figure:
    ends = [math.log10(per_hz * f) for f in (LOWEST_HZ, max(m.loop.nyquist_hz for m in members))]
    figure.update_xaxes(type="log", dtick=1, range=ends, minor={"showgrid": True})
    figure.update_layout(hovermode="closest")
    return figure


def bode(
    members: Sequence[Member], title: str = "Open loop L", height: int = 760, unit: tuple[str, float] = HZ
) -> Figure:
    """|L| and its phase over frequency; the least gain and phase margin drawn and said, each at its member.

    unit: of the frequency, HZ or RAD_S.
    """
    name_of, per_hz = unit
    panels = Panels(title, ["|L| (dB)", "phase of L (°)"], x_title=f"frequency ({name_of})")
    worst = weakest(members)
    lowest_phase = -270.0
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        L = member.loop.open_response(f)
        phase = np.degrees(np.unwrap(np.angle(L)))
        phase -= 360.0 * math.ceil((phase[0] - 1e-9) / 360.0)
        name = member_name(member)
        for row, values, of in ((0, _db(L), "dB"), (1, phase, "°")):
            hover = f"%{{x:.4~g}} {name_of}: %{{y:.4~g}} {of}"
            panels.line(row, 0, per_hz * f, values, name, look, of, hovertemplate=hover)
        if member.margins.stable:
            _draw_margins(panels, member, worst, f, phase, unit)
        lowest_phase = min(lowest_phase, float(phase[_db(L) > -40.0].min()))
    panels.level(0, 0, 0.0, "0 dB")
    panels.level(1, 0, -180.0, "−180°")
    figure = panels.figure(height, y_ranges={0: (-60.0, 60.0), 1: (max(lowest_phase - 30.0, -720.0), -60.0)})
    return _log_axes(figure, members, per_hz)


def _draw_margins(
    panels: Panels, member: Member, worst: Weakest, f: Array, phase: Array, unit: tuple[str, float]
) -> None:
    """Those of the least margins that are this member's."""
    m, name = member.margins, member_name(member)
    name_of, per_hz = unit
    dark = {"color": "#222222", "width": 2.2, "simplify": False}
    if member is worst.member["phase_deg"] and math.isfinite(m.crossover_hz):
        at = float(np.interp(math.log(m.crossover_hz), np.log(f), phase))
        foot = -180.0 + 360.0 * round((at + 180.0) / 360.0)
        x = per_hz * m.crossover_hz
        _bar(panels, 1, x, foot, at, dark)
        _note(panels, 1, x, foot, f"phase margin {m.phase_deg:.0f}° at {x:.3g} {name_of}<br>{name}")
        late = math.log(m.crossover_hz / f[0]) > 0.6 * math.log(f[-1] / f[0])  # no room on its right
        _note(panels, 0, x, 0.0, f"crossover {x:.3g} {name_of}", (-40, -44) if late else (50, -30))
    if member is worst.member["gain_up"] and math.isfinite(m.gain_up):
        gain = -20.0 * math.log10(m.gain_up)
        x = per_hz * m.gain_up_hz
        _bar(panels, 0, x, 0.0, gain, dark)
        _note(panels, 0, x, gain, f"gain margin {-gain:.1f} dB at {x:.3g} {name_of}<br>{name}")


def _bar(panels: Panels, row: int, x: float, y0: float, y1: float, look: dict[str, Any]) -> None:
    n = panels._number(row, 0)
    panels.shapes.append({"type": "line", "x0": x, "x1": x, "y0": y0, "y1": y1, "xref": f"x{n}", "yref": f"y{n}"})
    panels.shapes[-1]["line"] = {"color": look["color"], "width": look["width"]}


def _note(panels: Panels, row: int, x: float, y: float, text: str, away: tuple[int, int] | None = None) -> None:
    """away: px right and down from the point."""
    n = panels._number(row, 0)
    # Where the curves are not: the phase's note stands below its foot, left of the crossover.
    ax, ay = away or ((-70, 22) if row == 0 else (-4, 34))
    panels.annotations.append(
        {"text": text, "x": math.log10(x), "y": y, "xref": f"x{n}", "yref": f"y{n}", "align": "right"}
        | {"showarrow": True, "arrowhead": 0, "ax": ax, "ay": ay, "xanchor": "left" if ax > 0 else "right"}
        | {"font": {"size": 12}, "bgcolor": "rgba(255,255,255,0.8)", "borderpad": 2}
    )


def nyquist(members: Sequence[Member], ms_limit: float, title: str = "Nyquist", height: int = 720) -> Figure:
    """L in the complex plane around −1, with the circle that it must not enter for Ms to stay below the limit."""
    import plotly.graph_objects as go

    data: list[dict[str, Any]] = []
    angle = np.linspace(0.0, 2.0 * math.pi, 181)

    def circle(centre: float, radius: float, name: str, look: dict[str, Any], **more: Any) -> None:
        x, y = centre + radius * np.cos(angle), radius * np.sin(angle)
        data.append({"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": look, **more})

    worst = max(m.margins.ms for m in members)
    circle(0.0, 1.0, "|L| = 1", {"color": GREY, "width": 1, "dash": "2px,3px"}, hoverinfo="skip")
    circle(
        -1.0, 1.0 / ms_limit, f"Ms = {ms_limit:g}, the limit", {"color": GREY, "width": 1.5, "dash": "5px,3px"},
        fill="toself", fillcolor="rgba(107,107,107,0.10)", hoverinfo="skip",
    )  # fmt: skip
    circle(-1.0, 1.0 / worst, f"Ms = {worst:.3g}, the largest", {"color": "#222222", "width": 1.2}, hoverinfo="skip")
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        L = member.loop.open_response(f)
        near = np.abs(L) < 6.0
        data.append(
            {"type": "scatter", "mode": "lines", "x": L.real[near], "y": L.imag[near], "line": look}
            | {"name": member_name(member), "customdata": f[near]}
            | {"hovertemplate": "%{customdata:.4~g} Hz: %{x:.3f} %{y:+.3f}j"}
        )
    data.append(
        {"type": "scatter", "mode": "markers", "x": [-1.0], "y": [0.0], "showlegend": False, "name": "−1"}
        | {"marker": {"symbol": "cross", "size": 11, "color": "#222222"}}
    )
    layout = {
        "template": TEMPLATE,
        "height": height,
        "title": {"text": title, "y": 1.0 - 22.0 / height, "yanchor": "middle"},
        "legend": {"orientation": "v", "x": 1.01, "y": 1.0, "yref": "paper", "xref": "paper", "yanchor": "top"},
        "margin": {"t": 60},
        "hovermode": "closest",
        "xaxis": {"title": {"text": "real part"}, "range": [-2.6, 1.4], "constrain": "domain"},
        "yaxis": {"title": {"text": "imaginary part"}, "range": [-2.4, 1.0], "scaleanchor": "x"},
    }
    return go.Figure({"data": data, "layout": layout})


def gang_names(kind: Kind) -> tuple[tuple[str, int, int, str], ...]:
    """(response, row, column, in words) of the four, in the units of a kind."""
    speed, what, unit = ("rad/s", "torque", "N m") if kind.payload else (_SPEEDS[kind.moved.unit], *_drive(kind))
    who = "motor" if kind.payload else "axis"
    return (
        ("S", 0, 0, "S = 1/(1+L)"),
        ("T", 0, 1, "T = L/(1+L)"),
        ("PS", 1, 0, f"PS: load {what} to {who} speed, 1 {speed} per {unit}"),
        ("CS", 1, 1, f"CS: speed noise to {what}, 1 {unit} per {speed}"),
    )


_SPEEDS = {"m": "m/s", "rad": "rad/s"}


def _drive(kind: Kind) -> tuple[str, str]:
    return kind.drive.quantity, kind.drive.unit


def gang_of_four(
    members: Sequence[Member],
    ms_limit: float,
    title: str = "Gang of four",
    height: int = 760,
    unit: tuple[str, float] = HZ,
) -> Figure:
    """|S|, |T|, |PS| and |CS| over frequency, in HZ or RAD_S."""
    name_of, per_hz = unit
    panels = Panels(title, ["dB", "dB"], ["", ""], x_title=f"frequency ({name_of})", link_rows=False)
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        responses = member.loop.responses(f)
        for key, row, column, _ in gang_names(members[0].loop.kind):
            hover, values = f"%{{x:.4~g}} {name_of}: %{{y:.4~g}} dB", _db(getattr(responses, key))
            panels.line(row, column, per_hz * f, values, member_name(member), look, "dB", hovertemplate=hover)
    for column, name in ((0, f"Ms {ms_limit:g}"), (1, f"Mt {ms_limit:g}")):
        panels.level(0, column, 20.0 * math.log10(ms_limit), name)
    for _, row, column, text in gang_names(members[0].loop.kind):
        n = panels._number(row, column)
        panels.annotations.append(
            {"text": f"<b>{text}</b>", "x": 0.01, "y": 1.0, "xref": f"x{n} domain", "yref": f"y{n} domain"}
            | {"xanchor": "left", "yanchor": "bottom", "showarrow": False, "font": {"size": 13}}
        )
    figure = panels.figure(height)
    figure.update_layout({"yaxis": {"range": [-50, 10]}, "yaxis2": {"range": [-50, 10]}})
    return _log_axes(figure, members, per_hz)


STEPS = (
    ("speed_reference", "speed_motor_rad_s", "motor speed (rad/s)<br>step of 1 rad/s", 1.0, "rad/s"),
    ("speed_reference", "speed_carriage_m_s", "carriage speed (mm/s)<br>the same step", 1000.0, "mm/s"),
    ("speed_reference", "tension_drum_n", "wire tension (N)<br>the same step", 1.0, "N"),
    ("load_torque", "speed_motor_rad_s", "motor speed (mrad/s)<br>1 N m on the shaft", 1000.0, "mrad/s"),
)


Step = tuple[str, str, str, float, str]


def steps_of(member: Member) -> tuple[Step, ...]:
    """(input, signal, title of the panel, scale, unit) of the rows: of an axis its place, too."""
    kind, loop = member.loop.kind, member.loop.kind.looped
    if kind.payload:
        return STEPS
    way, speed, unit = kind.moved.unit, _SPEEDS[kind.moved.unit], kind.drive.unit
    fine = f"m{way}"
    # One thousandth of a metre or radian: a step that no drive could follow if it were whole.
    moved = (("position_reference", loop.position, f"position ({fine})<br>step of 1 {fine}", 1.0, fine),)
    return (
        *(moved if _has_position_loop(member) else ()),
        ("speed_reference", loop.speed, f"speed ({speed})<br>step of 1 {speed}", 1.0, speed),
        ("load_torque", loop.speed, f"speed (m{speed})<br>1 {unit} on the axis", 1000.0, f"m{speed}"),
        *(
            (("load_torque", loop.position, f"position ({fine})<br>1 {unit} on the axis", 1000.0, fine),)
            if _has_position_loop(member)
            else ()
        ),
    )


def _has_position_loop(member: Member) -> bool:
    """Whether the position is a state of the loop."""
    output = member.loop.outputs.index(member.loop.kind.looped.position)
    return bool(np.any(member.loop.plant.C[output]))


def _with_load(rows: tuple[Step, ...], kind: Kind, answers: Sequence[StepResponse]) -> tuple[Step, ...]:
    """The rows with a step of the load that leaves an axis' speed below one unit: 1 N m throws a small one away."""
    if kind.payload:
        return rows
    fastest = max(float(np.max(np.abs(answer.signals[kind.looped.speed]))) for answer in answers)
    step = 10.0 ** -max(0, math.ceil(math.log10(fastest))) if fastest > 0.0 else 1.0
    one, other = f"1 {kind.drive.unit} on the axis", f"{step:g} {kind.drive.unit} on the axis"
    return tuple(
        (of, signal, text.replace(one, powers(other)), scale * (step if of == "load_torque" else 1.0), unit)
        for of, signal, text, scale, unit in rows
    )


def steps(members: Sequence[Member], title: str = "Step responses of the linear loop", height: int = 860) -> Figure:
    """Deviations after a step of the reference, and of a torque on the shaft; duration by the slowest bandwidth."""
    rows = steps_of(members[0])
    slowest = min(m.margins.bandwidth_hz for m in members)
    duration = min(max(6.0 / slowest if math.isfinite(slowest) else 0.0, 60.0 * members[0].loop.dt), 20.0)
    inputs = dict.fromkeys(of for of, *_ in rows)
    answers = [{of: step_response(member.loop, of, duration) for of in inputs} for member in members]
    rows = _with_load(rows, members[0].loop.kind, [answer["load_torque"] for answer in answers])
    panels = Panels(title, [text for _, _, text, _, _ in rows])
    for member, responses, look in zip(members, answers, _looks(members), strict=True):
        for row, (of, signal, _, scale, unit) in enumerate(rows):
            response = responses[of]
            panels.line(row, 0, response.time_s, scale * response.signals[signal], member_name(member), look, unit)
    panels.level(0, 0, 1.0)
    figure = panels.figure(height)
    figure.update_xaxes(gridcolor=FAINT)
    return figure
