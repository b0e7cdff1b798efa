"""The speed loop as people see it: margins as a table, sentences, figures, the page and loop.json."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.analysis.loop import StepResponse, load_step, position_answer, step_response
from workbench.analysis.margins import Margins, Member, Weakest, weakest
from workbench.analysis.search import rounded_down
from workbench.analysis.tune import GIVEN_AWAY, WIDER
from workbench.control import Cascade
from workbench.core.json_records import rounded
from workbench.core.names import listed, powers
from workbench.core.numbers import NOTHING, figures
from workbench.core.run import Array
from workbench.core.shown import View
from workbench.core.table import Column, Table
from workbench.core.templates import Sentences
from workbench.core.whole_folder import write_json
from workbench.effects import find
from workbench.machines import Kind, Machine, kind_of
from workbench.study.loop_design import DesignCase
from workbench.view import style
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels
from workbench.view.style import Figure

MARGINS = (
    Column("gain", "dB"), Column("phase", "°"), Column("delay", "ms"),
    Column("disk"), Column("Ms"), Column("Mt"), Column("cross", "Hz"), Column("band", "Hz"), Column("reject", "Hz"),
    Column("slowest", "1/s"), Column("least ζ"),
)  # fmt: skip
LOAD_NM = 100.0  # that sentences name, of a hoist: about a tenth of the default motors' nominal torque
GONE = 0.01  # of the largest way: nothing of it stays


def table(members: Sequence[Member]) -> Table:
    """One row for each loop."""
    kind, rows = members[0].loop.kind, []
    for member in members:
        m, point = member.margins, member.point
        values = (m.phase_deg, 1000.0 * m.delay_s, m.disk, m.ms, m.mt, m.crossover_hz, m.bandwidth_hz, m.rejection_hz)
        cells = [gain_text(m), *map(figures, values)] if m.stable else ["unstable", *[NOTHING] * len(values)]
        where = [f"{point.payload_kg:g}"] * kind.payload + [f"{point.height_m:g}"]
        rows.append([*where, *cells, *map(figures, poles_in_s(member))])
    place = Column("height" if kind.payload else "position", kind.moved.unit)
    return Table([*[Column("load", "kg")] * kind.payload, place, *MARGINS], rows, said.margins())


def gain_text(m: Margins) -> str:
    """The gain margin in dB, and the one towards lower gain if there is one."""
    up = f"{20.0 * math.log10(m.gain_up):.1f}" if math.isfinite(m.gain_up) else NOTHING
    return f"{up}/{20.0 * math.log10(m.gain_down):.1f}" if m.gain_down > 0.0 else up


def poles_in_s(member: Member) -> tuple[float, float]:
    """(real part of the slowest pole, 1/s; smallest damping ratio), from the poles in z."""
    z = member.loop.poles()
    s = np.log(z[np.abs(z) > 1e-6]) / member.loop.dt
    return float(np.max(s.real)), float(np.min(-s.real / np.abs(s)))


def sentences(case: DesignCase, members: Sequence[Member]) -> list[str]:
    """The table in sentences."""
    drive = drive_sentences(case.machine, case.settings.sample_time_s)
    if unstable := [where_of(member) for member in members if not member.margins.stable]:
        return [said.unstable(len(members), unstable), *drive]
    stable, load = said.stable(len(members), least_sentence(members)), load_sentence(members, case.machine)
    return [stable, *drive, load, *said.each("events_apart", event_words(case))]


def where_of(member: Member) -> str:
    """A loop's operating point in words."""
    return member.loop.kind.looped.where(member.point.payload_kg, member.point.height_m)


def least_sentence(members: Sequence[Member]) -> str:
    """The smallest of each margin, with its loop."""
    worst, by_place = weakest(members), dict[str, list[str]]()
    for name in ("ms", "phase_deg", "gain_up", "gain_down", "delay_s", "bandwidth_hz", "rejection_hz"):
        if text := said.margin(name, worst.margins):
            by_place.setdefault(where_of(worst.member[name]) if len(members) > 1 else "", []).append(text)
    return said.weakest(by_place, len(members))


def load_sentence(members: Sequence[Member], machine: Machine) -> str:
    """The largest response to a load step; of an axis about a tenth of what its inputs are judged against."""
    answers = [load_step(member.loop) for member in members]
    peak, iae, last = (max(getattr(s, n) for s in answers) for n in ("peak_rad_s", "iae_rad", "recovery_s"))
    kind = members[0].loop.kind
    if kind.payload:
        return said.load_step_of_hoist(LOAD_NM, LOAD_NM * peak, LOAD_NM * iae, last)
    tenth, most, stays = 0.1 * kind.looped.input_scale(machine), None, None
    step = 10.0 ** math.floor(math.log10(tenth)) if tenth > 0.0 else 1.0
    step *= max((digit for digit in (1.0, 2.0, 5.0) if digit * step <= tenth), default=1.0)
    if places := [answer for member in members if (answer := position_answer(member.loop)) is not None]:
        most, stays = (step * max(getattr(a, name) for a in places) for name in ("peak", "left"))
        stays = None if stays < GONE * most else stays
    return said.load_step(kind, step, step * peak, last, most, stays)


def _fine(value: float, unit: str) -> str:
    """`75 mrad`: three digits with the prefix that they want."""
    scale, prefix = next(((s, p) for s, p in ((1.0, ""), (1e3, "m"), (1e6, "µ")) if s * value >= 1.0), (1e9, "n"))
    return f"{figures(scale * value)} {prefix}{unit}"


said = Sentences(
    "view/loop_words.j2", figures=figures, fine=_fine, listed=listed, finite=math.isfinite, gain=gain_text,
    db=lambda ratio: 20.0 * math.log10(ratio), GIVEN_AWAY=GIVEN_AWAY, WIDER=WIDER, down=rounded_down,
)  # fmt: skip


def event_words(case: DesignCase) -> str:
    """What happens in the scenario's runs, and when: `brake_release_s 2.5`; "" for nothing."""
    given = case.events.model_dump(exclude_none=True)
    return ", ".join(f"{key} {value:g}" for key, value in given.items() if key.endswith("_s"))


def drive_sentences(machine: Machine, sample_time_s: float) -> list[str]:
    """The drive between commanded torque and measured speed, then the effects and the measured correction in the loop,
    and those that act on the log only."""
    d = machine.drive
    lags = {"torque lag": d.torque_lag_s, "speed filter": d.speed_filter_s, "speed delay": d.speed_delay_s}
    outside = [name for name in machine.effects if find(name, kind_of(machine).name).on_sensor]
    inside = [name for name in machine.effects if name not in outside]
    inside += ["measured_correction"] if machine.measured_correction is not None else []
    parts = [f"{1000.0 * value:g} ms {name}" for name, value in lags.items() if value > 0.0]
    return said.each("drive", 1000.0 * sample_time_s, parts, inside, outside)


def as_json(case: DesignCase, members: Sequence[Member]) -> dict[str, Any]:
    """Settings, drive, effects, and the margins and poles of every loop; null where there is none.

    weakest: the smallest of each margin with its loop's place; empty if a loop is unstable.
    """
    worst = weakest(members)
    least = worst.member.items() if worst.margins.stable else ()
    return {
        "controller": case.settings.model_dump(mode="json"),
        "drive": case.machine.drive.model_dump(mode="json"),
        "effects": {name: dict(values) for name, values in case.machine.effects.items()},
        "weakest": {name: {"value": rounded(getattr(worst.margins, name), 8), **place_of(m)} for name, m in least},
        "loops": [_loop_json(member) for member in members],
    }


def _loop_json(member: Member) -> dict[str, Any]:
    kind, margins = member.loop.kind, vars(member.margins)
    values = {name: value if isinstance(value, bool) else rounded(value, 8) for name, value in margins.items()}
    z = sorted(member.loop.poles(), key=lambda p: (-abs(p), p.imag))
    return {
        **place_of(member),
        "motion": kind.looped.motion_words[member.point.motion],
        **values,
        f"load_step_1_{kind.drive.suffix}": _load_json(member) if member.margins.stable else None,
        "poles_z": [[rounded(float(p.real), 12), rounded(float(p.imag), 12)] for p in z],
    }


def _load_json(member: Member) -> dict[str, Any]:
    """The answer to a load step; of an axis under names with its units, and that of the position."""
    kind, load = member.loop.kind, {name: rounded(value, 8) for name, value in vars(load_step(member.loop)).items()}
    if kind.payload:
        return load
    way, answer = kind.moved.unit, position_answer(member.loop)
    names = {"peak_rad_s": f"peak_{way}_s", "peak_s": "peak_s", "iae_rad": f"iae_{way}", "recovery_s": "recovery_s"}
    said = {name: load[of] for of, name in names.items()}
    if answer is not None:
        said |= {f"position_peak_{way}": rounded(answer.peak, 8), f"position_left_{way}": rounded(answer.left, 8)}
    return said


def place_of(member: Member) -> dict[str, float]:
    """An operating point as JSON has it."""
    kind, point = member.loop.kind, member.point
    if kind.payload:
        return {"payload_kg": point.payload_kg, "height_m": point.height_m}
    return {f"position_{kind.moved.unit}": point.height_m}


def write_loop(case: DesignCase, members: Sequence[Member], ms_limit: float, folder: Path) -> None:
    """Write loop.html, which needs no network, and loop.json into an existing folder."""
    held = position_answer(members[0].loop) is not None and members[0].margins.stable
    drawn = [bode(members), nyquist(members, ms_limit), gang_of_four(members, ms_limit), steps(members)]
    section = Section(
        sentences=[f"Controller {case.origin}: {gains_text(case)}.", *sentences(case, members)],
        tables=[table(members)],
        figures=list(zip(drawn, said.each("notes", held), strict=True)),
    )
    what = "Speed" if kind_of(case.machine).payload else "Position and speed"
    save_page([section], folder / "loop.html", f"{what} loop — {case.machine.name}")
    write_json(folder / "loop.json", as_json(case, members))


def gains_text(case: DesignCase) -> str:
    return said.gains(case.settings, isinstance(case.settings, Cascade))


LOWEST_HZ, POINTS = 0.02, 600
# A colour a payload, a dash a height: both can be told apart, and in black and white the heights still.
COLOURS = (style.BLUE, style.GREEN, style.VERMILLION, style.PURPLE, style.ORANGE, style.SKY)
DASHES = ("solid", "8px,3px", "2px,2px", "8px,3px,2px,3px")
HZ, RAD_S = ("Hz", 1.0), ("rad/s", 2.0 * math.pi)  # a unit of frequency and what makes it of Hz
INK = "#222222"


def member_name(member: Member) -> str:
    kind, point = member.loop.kind, member.point
    load = f"{point.payload_kg:g} kg, " if kind.payload else ""
    return f"{load}{point.height_m:g} {kind.moved.unit}"


def _looks(members: Sequence[Member]) -> list[dict[str, Any]]:
    payloads = list(dict.fromkeys(member.point.payload_kg for member in members))
    heights = list(dict.fromkeys(member.point.height_m for member in members))
    return [
        style.look(COLOURS[payloads.index(m.point.payload_kg) % len(COLOURS)],
                   DASHES[heights.index(m.point.height_m) % len(DASHES)])
        for m in members
    ]  # fmt: skip


def _frequencies(member: Member) -> Array:
    """Even in log, and the loop's own dense ones, so that sharp peaks are drawn."""
    nyquist, own = member.loop.nyquist_hz, member.loop.grid()
    f = np.unique(np.concatenate([np.geomspace(LOWEST_HZ, nyquist, POINTS), own[own > LOWEST_HZ]]))
    return f[f <= nyquist]


def _db(values: Any) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(values)))


def _log_axes(figure: Figure, members: Sequence[Member], per_hz: float) -> Figure:
    ends = [math.log10(per_hz * f) for f in (LOWEST_HZ, max(m.loop.nyquist_hz for m in members))]
    figure.update_xaxes(type="log", dtick=1, range=ends, minor={"showgrid": True})
    return figure.update_layout(hovermode="closest")


def bode(members: Sequence[Member], height: int = 760, unit: tuple[str, float] = HZ) -> Figure:
    """|L| and its phase over frequency; the least gain and phase margin drawn and said, each at its member.

    unit: of the frequency, HZ or RAD_S.
    """
    name_of, per_hz = unit
    panels = Panels("Open loop L", ["|L| (dB)", "phase of L (°)"], x_title=f"frequency ({name_of})")
    worst, lowest = weakest(members), -270.0
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        L = member.loop.open_response(f)
        phase = np.degrees(np.unwrap(np.angle(L)))
        phase -= 360.0 * math.ceil((phase[0] - 1e-9) / 360.0)
        for row, values, of in ((0, _db(L), "dB"), (1, phase, "°")):
            hover = f"%{{x:.4~g}} {name_of}: %{{y:.4~g}} {of}"
            panels.line(row, 0, per_hz * f, values, member_name(member), look, of, hovertemplate=hover)
        if member.margins.stable:
            _draw_margins(panels, member, worst, f, phase, unit)
        lowest = min(lowest, float(phase[_db(L) > -40.0].min()))
    panels.level(0, 0, 0.0, "0 dB")
    panels.level(1, 0, -180.0, "−180°")
    figure = panels.figure(height, y_ranges={0: (-60.0, 60.0), 1: (max(lowest - 30.0, -720.0), -60.0)})
    return _log_axes(figure, members, per_hz)


def _draw_margins(
    panels: Panels, member: Member, worst: Weakest, f: Array, phase: Array, unit: tuple[str, float]
) -> None:
    """Those of the least margins that are this member's, where the curves leave room for the words."""
    m, name, (name_of, per_hz) = member.margins, member_name(member), unit

    def bar(row: int, x: float, foot: float, end: float, text: str, away: tuple[int, int]) -> None:
        ends = {"x0": x, "x1": x, "y0": foot, "y1": end, "line": {"color": INK, "width": 2.2}}
        panels.shapes.append({"type": "line", **ends, **panels.axes(row, 0)})
        panels.note(row, 0, math.log10(x), foot if row else end, f"{text} at {x:.3g} {name_of}<br>{name}", away)

    if member is worst.member["phase_deg"] and math.isfinite(m.crossover_hz):
        at, x = float(np.interp(math.log(m.crossover_hz), np.log(f), phase)), per_hz * m.crossover_hz
        foot = -180.0 + 360.0 * round((at + 180.0) / 360.0)
        bar(1, x, foot, at, f"phase margin {m.phase_deg:.0f}°", (-4, 34))
        late = math.log(m.crossover_hz / f[0]) > 0.6 * math.log(f[-1] / f[0])  # no room on its right
        panels.note(0, 0, math.log10(x), 0.0, f"crossover {x:.3g} {name_of}", (-40, -44) if late else (50, -30))
    if member is worst.member["gain_up"] and math.isfinite(m.gain_up):
        gain = -float(_db(m.gain_up))
        bar(0, per_hz * m.gain_up_hz, 0.0, gain, f"gain margin {-gain:.1f} dB", (-70, 22))


def nyquist(members: Sequence[Member], ms_limit: float, height: int = 720) -> Figure:
    """L in the complex plane around −1, with the circle that it must not enter for Ms to stay below the limit."""
    data: list[dict[str, Any]] = []

    def curve(z: Any, name: str, line: dict[str, Any], **more: Any) -> None:
        shown = {"type": "scatter", "mode": "lines", "x": z.real, "y": z.imag, "name": name, "line": line}
        data.append(shown | {"hoverinfo": "skip"} | more)

    turn, worst = np.exp(2j * math.pi * np.linspace(0.0, 1.0, 181)), max(m.margins.ms for m in members)
    disk = {"fill": "toself", "fillcolor": "rgba(107,107,107,0.10)"}
    curve(turn, "|L| = 1", {"color": style.GREY, "width": 1, "dash": "2px,3px"})
    limit = {"color": style.GREY, "width": 1.5, "dash": "5px,3px"}
    curve(turn / ms_limit - 1.0, f"Ms = {ms_limit:g}, the limit", limit, **disk)
    if all(member.margins.stable for member in members):  # an unstable loop's means nothing
        curve(turn / worst - 1.0, f"Ms = {worst:.3g}, the largest", {"color": INK, "width": 1.2})
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        L = member.loop.open_response(f)
        near, hover = np.abs(L) < 6.0, "%{customdata:.4~g} Hz: %{x:.3f} %{y:+.3f}j"
        curve(L[near], member_name(member), look, customdata=f[near], hovertemplate=hover, hoverinfo=None)
    cross = {"symbol": "cross", "size": 11, "color": INK}
    curve(np.array([-1.0 + 0.0j]), "−1", {}, mode="markers", marker=cross, showlegend=False, hoverinfo=None)
    return style.figure(
        "Nyquist", height, data, margin={"t": 60},
        legend={"orientation": "v", "x": 1.01, "y": 1.0, "yref": "paper", "xref": "paper", "yanchor": "top"},
        xaxis={"title": {"text": "real part"}, "range": [-2.6, 1.4], "constrain": "domain"},
        yaxis={"title": {"text": "imaginary part"}, "range": [-2.4, 1.0], "scaleanchor": "x"},
    )  # fmt: skip


def gang_names(kind: Kind) -> tuple[tuple[str, int, int, str], ...]:
    """(response, row, column, in words) of the four, in the units of a kind."""
    what, unit = kind.drive.quantity, kind.drive.unit
    speed, who = ("rad/s", "motor") if kind.payload else (kind.moved.speed_unit, "axis")
    return (
        ("S", 0, 0, "S = 1/(1+L)"),
        ("T", 0, 1, "T = L/(1+L)"),
        ("PS", 1, 0, f"PS: load to {who} speed, 1 {speed} per {unit}"),
        ("CS", 1, 1, f"CS: speed noise to {what}, 1 {unit} per {speed}"),
    )


def gang_of_four(members: Sequence[Member], ms_limit: float, height: int = 760, unit: tuple[str, float] = HZ) -> Figure:
    """|S|, |T|, |PS| and |CS| over frequency, in HZ or RAD_S."""
    (name_of, per_hz), names = unit, gang_names(members[0].loop.kind)
    panels = Panels("Gang of four", ["dB", "dB"], ["", ""], x_title=f"frequency ({name_of})", link_rows=False)
    hover = f"%{{x:.4~g}} {name_of}: %{{y:.4~g}} dB"
    for member, look in zip(members, _looks(members), strict=True):
        f = _frequencies(member)
        responses = member.loop.responses(f)
        for key, row, column, _ in names:
            values = _db(getattr(responses, key))
            panels.line(row, column, per_hz * f, values, member_name(member), look, "dB", hovertemplate=hover)
    for column, name in ((0, f"Ms {ms_limit:g}"), (1, f"Mt {ms_limit:g}")):
        panels.level(0, column, 20.0 * math.log10(ms_limit), name)
    for _, row, column, text in names:
        panels.words(f"<b>{text}</b>", 0.01, 1.0, "left", "bottom", panels.axes(row, column, "xy"), size=13)
    figure = panels.figure(height)
    figure.update_layout({"yaxis": {"range": [-50, 10]}, "yaxis2": {"range": [-50, 10]}})
    return _log_axes(figure, members, per_hz)


Step = tuple[str, str, str, float, str]  # input, signal, title of the panel, scale, unit
STEPS: tuple[Step, ...] = (
    ("speed_reference", "speed_motor_rad_s", "motor speed (rad/s)<br>step of 1 rad/s", 1.0, "rad/s"),
    ("speed_reference", "speed_carriage_m_s", "carriage speed (mm/s)<br>the same step", 1000.0, "mm/s"),
    ("speed_reference", "tension_drum_n", "wire tension (N)<br>the same step", 1.0, "N"),
    ("load_torque", "speed_motor_rad_s", "motor speed (mrad/s)<br>1 N m on the shaft", 1000.0, "mrad/s"),
)


def steps_of(member: Member, load: float = 1.0) -> tuple[Step, ...]:
    """The rows: of an axis its place, too. load: the step of an axis' load."""
    kind, loop = member.loop.kind, member.loop.kind.looped
    if kind.payload:
        return STEPS
    way, speed, on = kind.moved.unit, kind.moved.speed_unit, powers(f"{load:g} {kind.drive.unit} on the axis")
    fine = f"m{way}"
    rows = (
        ("speed_reference", loop.speed, f"speed ({speed})<br>step of 1 {speed}", 1.0, speed),
        ("load_torque", loop.speed, f"speed (m{speed})<br>{on}", 1000.0 * load, f"m{speed}"),
    )
    if not np.any(member.loop.plant.C[member.loop.outputs.index(loop.position)]):
        return rows
    # One thousandth of a metre or radian: a step that no drive could follow if it were whole.
    moved = ("position_reference", loop.position, f"position ({fine})<br>step of 1 {fine}", 1.0, fine)
    return (moved, *rows, ("load_torque", loop.position, f"position ({fine})<br>{on}", 1000.0 * load, fine))


def load_for(kind: Kind, answers: Sequence[StepResponse]) -> float:
    """A step of the load that leaves an axis' speed below one unit: 1 N m throws a small one away."""
    fastest = max(float(np.max(np.abs(answer.signals[kind.looped.speed]))) for answer in answers)
    return 1.0 if fastest <= 0.0 else float(10.0 ** -max(0, math.ceil(math.log10(fastest))))


def steps(members: Sequence[Member], height: int = 860) -> Figure:
    """Deviations after a step of the reference, and of a torque on the shaft; duration by the slowest bandwidth."""
    kind, slowest = members[0].loop.kind, min(m.margins.bandwidth_hz for m in members)
    duration = min(max(6.0 / slowest if math.isfinite(slowest) else 0.0, 60.0 * members[0].loop.dt), 20.0)
    inputs = dict.fromkeys(of for of, *_ in steps_of(members[0]))
    answers = [{of: step_response(member.loop, of, duration) for of in inputs} for member in members]
    rows = steps_of(members[0], 1.0 if kind.payload else load_for(kind, [one["load_torque"] for one in answers]))
    panels = Panels("Step responses of the linear loop", [text for _, _, text, _, _ in rows])
    for member, responses, look in zip(members, answers, _looks(members), strict=True):
        for row, (of, signal, _, scale, unit) in enumerate(rows):
            response = responses[of]
            panels.line(row, 0, response.time_s, scale * response.signals[signal], member_name(member), look, unit)
    panels.level(0, 0, 1.0)
    return panels.figure(height).update_xaxes(gridcolor=style.FAINT)


def columns(members: Sequence[Member]) -> Mapping[str, Sequence[Any]]:
    """One row per loop: operating point and margins."""
    where, words = [place_of(member) for member in members], members[0].loop.kind.looped.motion_words
    return {
        **{name: [place[name] for place in where] for name in where[0]},
        "motion": [words[member.point.motion] for member in members],
        **{name: [getattr(m.margins, name) for m in members] for name in vars(members[0].margins)},
    }


def drawn(of: Callable[[Any], tuple[Sequence[Member], float]]) -> dict[str, Callable[[Any], Figure]]:
    """The figures of a record by name; of: its members and its bound on Ms."""
    return {
        "bode": lambda record: bode(of(record)[0]),
        "nyquist": lambda record: nyquist(*of(record)),
        "sensitivity": lambda record: gang_of_four(*of(record)),
        "steps": lambda record: steps(of(record)[0]),
    }


VIEW = View(
    {"margins": lambda a: table(a.members)}, drawn(lambda a: (a.members, a.ms_limit)), lambda a: columns(a.members)
)
