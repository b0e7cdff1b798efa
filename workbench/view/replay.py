"""A replay as people see it: table, sentences, the paper's Figures 6 to 8, the residual over time, page and JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.core.json_records import rounded
from workbench.core.numbers import MOST, figures
from workbench.core.run import Array, Run, stretches
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.templates import Sentences
from workbench.core.whole_folder import whole_folder, write_json
from workbench.logs import Campaign
from workbench.machines import Machine, kind_of, plant_of
from workbench.simulate.replay import Replay, ReplayResult
from workbench.view import style
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels, ranges_below_names
from workbench.view.style import Figure

SIDE_BY_SIDE = 2  # runs in a row
PAPER_PERCENT = 7.49  # RMSE of the paper's own machine, its Figure 8
EXPLAINED = 1.3  # times the noise: what is left while moving is then little more than noise
REMEDY = "`workbench identify` fits the values, `workbench diagnose` names what the model lacks."
Stretches = Sequence[tuple[float, float]]


def _percent(value: float) -> str:
    """Two decimals; of a replay that diverges three digits and an exponent."""
    return f"{value:.2f}" if abs(value) < MOST else figures(value)


said = Sentences("view/replay_words.j2", figures=figures, percent=_percent)


# Table, sentences, JSON.


class Measure(NamedTuple):
    """One figure of a run, or of all runs: its column, its key in replay.json, its field here, its value."""

    column: Column
    key: str
    field: str
    value: float

    @property
    def text(self) -> str:
        return _percent(self.value) if self.column.unit == "%" else figures(self.value)


def measures(machine: Machine, replay: Replay | ReplayResult) -> list[Measure]:
    """Of a run, or of all."""
    w, r = kind_of(machine).drive, replay
    noise = r.noise_rms if isinstance(r, ReplayResult) else r.balance.noise_rms
    residual, rms, restarted = f"{w.quantity}_residual_rms", f"_{w.suffix}", "speed_rmse_percent_restarted_2s"
    declared = (
        ("speed error\nopen loop", "%", "speed_rmse_percent", "speed_rmse_percent", r.speed_rmse_percent),
        ("speed error\nrestarted", "%", restarted, restarted, r.speed_rmse_percent_restarted_2s),
        (f"{w.quantity}\nresidual", w.unit, residual + rms, "residual_rms", r.residual_rms),
        ("the same,\nmoving", w.unit, f"{residual}_moving{rms}", "residual_rms_moving", r.residual_rms_moving),
        ("sensor\nnoise", w.unit, f"noise_rms{rms}", "noise_rms", noise),
    )
    return [Measure(Column(head, unit), key, field, value) for head, unit, key, field, value in declared]


def table(machine: Machine, result: ReplayResult) -> Table:
    """A line a run, and one for all."""
    rows: list[tuple[str, Replay | ReplayResult]] = [(run.name, run) for run in result.runs]
    return table_of_replays(machine, "run", [*rows, ("all runs", result)] if len(rows) > 1 else rows, result.band_hz)


def table_of_replays(
    machine: Machine, first: str, rows: Sequence[tuple[str, Replay | ReplayResult]], band_hz: float
) -> Table:
    """rows: name and figures of each; first: what they are."""
    note = said.replay_note(kind_of(machine), band_hz)
    columns = [words(first), *(measure.column for measure in measures(machine, rows[0][1]))]
    return Table(columns, [[name, *(m.text for m in measures(machine, replay))] for name, replay in rows], note)


def sentences(machine: Machine, result: ReplayResult, remedy: str = REMEDY) -> list[str]:
    """What these figures say of the model, the drifting one first. remedy: what to do where it explains too little."""
    kind, w, drift = kind_of(machine), kind_of(machine).drive, None
    if kind.nominal_speed is not None:
        inertia = kind.rigid(machine, result.runs[0].simulated.payload_kg).inertia
        drift = 100.0 * 10.0 / inertia / kind.nominal_speed(machine)
    explained = result.residual_rms_moving <= EXPLAINED * result.noise_rms
    return [
        said.open_loop(result, w, PAPER_PERCENT, drift),
        said.residual(result, w, noise_is_floor(machine, result), explained, remedy),
    ]


def noise_is_floor(machine: Machine, result: ReplayResult) -> bool:
    """Whether the noise is what a perfect model leaves: not where the speed is the logged position's derivative."""
    return kind_of(machine).plant.speeds[0] in result.runs[0].balance.run


def to_json(campaign: Campaign, result: ReplayResult) -> dict[str, Any]:
    """replay.json: the keys of the format, and beside them the residual while moving, the noise and the notes."""
    machine = campaign.machine

    def numbers(replay: Replay | ReplayResult) -> dict[str, Any]:
        return {measure.key: rounded(measure.value) for measure in measures(machine, replay)}

    share = {f"{kind_of(machine).drive.quantity}_residual_percent": rounded(result.residual_percent)}
    return {
        "format": 1,
        "campaign": campaign.name,
        "machine": machine.name,
        "runs": [{"name": run.name} | numbers(run) for run in result.runs],
        "overall": numbers(result) | share | {"band_hz": rounded(result.band_hz)},
        "notes": list(campaign.all_notes),
    }


# Figures.


class Line(NamedTuple):
    """A line in a run's panel. x, y: (n,)."""

    name: str
    x: Array
    y: Array
    look: Mapping[str, Any]


def run_panels(
    title: str, y_title: str, names: Sequence[str], lines: Sequence[Sequence[Line]], unit: str = "",
    shaded: Sequence[Sequence[tuple[Stretches, str]]] = (), levels: Sequence[float] = (), limit: float | None = None,
    x_title: str = "time (s)",
) -> Figure:  # fmt: skip
    """A panel a run, two side by side, each with its name in the corner and room for it above the highest value.

    lines: of each run. shaded: of each run stretches of time and their colour. levels: dashed, in each panel. limit: of
    the vertical axis, both ways.
    """
    columns, count = min(SIDE_BY_SIDE, len(names)), len(names)
    rows = -(-count // columns)
    panels = Panels(title, [y_title] * rows, [""] * columns, x_title)
    places = [divmod(index, columns) for index in range(count)]
    for index, (name, place, drawn) in enumerate(zip(names, places, lines, strict=True)):
        panels.words(f"<b>{name}</b>", 0.01, 0.99, "left", "top", panels.axes(*place, "xy"), size=12)
        for line in drawn:
            panels.line(*place, line.x, line.y, line.name, dict(line.look), unit)
        for level in levels:
            panels.level(*place, level, dash=style.NOISE_DASH)
        for shades, colour in shaded[index] if shaded else ():
            for start, end in shades:
                panels.shade(*place, start, end, colour)
    ranges = ranges_below_names(places, [[line.y for line in drawn] or [np.zeros(1)] for drawn in lines])
    if limit is not None:
        ranges = dict.fromkeys(ranges, (-limit, limit))
    figure = panels.figure(150 + max(210 * rows, 330), ranges)
    # Where the last row is not full, the panel above its empty place ends its column.
    for axis in list(figure.select_xaxes())[max(count - columns, 0) : count]:
        axis.update(showticklabels=True, title={"text": x_title})
    return figure


def inputs(machine: Machine, result: ReplayResult) -> Figure:
    """Fig. 6: the measured torque of both motors, or an axis' measured input."""
    return input_profiles(machine, [run.balance.run for run in result.runs])


def input_profiles(machine: Machine, runs: Sequence[Run]) -> Figure:
    """Fig. 6: both motors' measured torque over one motor's nominal torque, or the measured input in its own unit."""
    kind, w, drawn = kind_of(machine), kind_of(machine).drive, []
    if kind.motor_torque is None:
        look = style.line("measured", width=1.2)
        drawn = [[Line("measured", run.time_s, run[kind.plant.input], look)] for run in runs]
        return run_panels(f"Measured {w.quantity}", f"{w.quantity} ({w.unit})", [r.name for r in runs], drawn, w.unit)
    nominal, both = kind.motor_torque(machine), ("torque_motor1_nm", "torque_motor2_nm")
    for run in runs:
        torques = {"mean of both motors": (run["torque_motor_nm"] / 2.0, style.line("measured", width=1.4))}
        if all(signal in run for signal in both):
            torques = {f"motor {k}": (run[of], style.line(f"motor {k}", width=1.4)) for k, of in enumerate(both, 1)}
        drawn.append([Line(name, run.time_s, y / nominal, look) for name, (y, look) in torques.items()])
    return run_panels("Measured motor torque", "torque / nominal", [run.name for run in runs], drawn)


def speeds(machine: Machine, result: ReplayResult) -> Figure:
    """Fig. 8: measured, simulated and restarted speed in per cent of the machine's speed scale, a panel a run."""
    signal, scale = plant_of(machine).speeds[0], kind_of(machine).speed_scale[1]
    drawn = []
    for run in result.runs:
        per_cent, simulated, log = 100.0 / run.speed_scale, run.simulated, run.balance
        # The measured line is wide and lies below, so that it is seen where both agree.
        measured = Line("measured", log.run.time_s, per_cent * log.motion.speed, style.line("measured", width=3.4))
        model = Line("simulated", simulated.time_s, per_cent * simulated[signal], style.line("simulated", width=1.6))
        restarted = style.look(style.PURPLE, "5px,3px", 1.3)
        again = Line("restarted every 2 s", simulated.time_s, per_cent * run.restarted, restarted)
        drawn.append([measured, model, again])
    names = [f"{run.name}</b>, RMSE {run.speed_rmse_percent:.2f} %<b>" for run in result.runs]
    return run_panels("Measured and simulated speed", f"speed (% of {scale})", names, drawn, "%")


def torque_residual(
    names: Sequence[str], times_s: Sequence[Array], after: Sequence[Array], unit: str, noise_rms: float,
    before: Sequence[Array] = (), limit: float | None = None, windows: Sequence[Stretches] = (),
    rests: Sequence[Stretches] = (), alone: Mapping[str, Any] | None = None,
) -> Figure:  # fmt: skip
    """Measured minus predicted torque (or force) over time, a panel a run, both low-passed alike.

    noise_rms: drawn as ± twice its value. before: the same of an earlier model, drawn below. limit: of the vertical
    axis, both ways. windows, rests: for each run stretches to shade, yellow and grey. alone: the line of a residual
    with none before it.
    """
    quantity = "torque" if unit == "N m" else "force"
    left_out = "; grey: at rest or at an end, left out" if any(rests) else ""
    title = f"{quantity.capitalize()} residual (dashed: ± 2 × noise of {noise_rms:.2g} {unit}{left_out})"
    look = style.LINE_AFTER if before else alone or style.LINE_AFTER | {"color": style.BLACK}
    lines = []
    for k, (time, y) in enumerate(zip(times_s, after, strict=True)):
        was = [Line("before", time, before[k], style.LINE_BEFORE)] if before else []
        lines.append([*was, Line("after" if before else "measured − predicted", time, y, look)])
    nothing: Sequence[Stretches] = [()] * len(names)
    shaded = [
        [(yellow, style.WINDOW), (grey, style.REST)]
        for yellow, grey in zip(windows or nothing, rests or nothing, strict=True)
    ]
    levels = (2.0 * noise_rms, -2.0 * noise_rms)
    return run_panels(title, f"{quantity} residual ({unit})", names, lines, unit, shaded, levels, limit)


def residuals(machine: Machine, result: ReplayResult, before: ReplayResult | None = None) -> Figure:
    """The balance's residual over time, on the scale of what is left while moving; `before` an identification below."""
    balances = [run.balance for run in result.runs]
    compared = balances if before is None else [run.balance for run in before.runs]
    largest = max((float(np.max(np.abs(b.residual[b.moving]), initial=0.0)) for b in compared), default=0.0)
    return torque_residual(
        [run.name for run in result.runs],
        [b.run.time_s for b in balances],
        [b.residual for b in balances],
        kind_of(machine).drive.unit,
        result.noise_rms,
        () if before is None else [b.residual for b in compared],
        1.15 * max(largest, 4.0 * result.noise_rms) or None,
        rests=[spans(b.run.time_s, ~b.moving) for b in balances],
    )


def spans(time_s: Sequence[float] | np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    """From when to when a mask (n,) holds."""
    return [(float(time_s[a]), float(time_s[b - 1])) for a, b in zip(*stretches(mask), strict=True)]


# The page.


def write_replay(run: Callable[[], ReplayResult], campaign: Campaign, folder: Path) -> ReplayResult:
    """Replay, and write replay.json and replay.html; all or nothing, see `whole_folder`."""
    with whole_folder(folder) as hidden:
        result = run()
        write_json(hidden / "replay.json", to_json(campaign, result))
        save_replay_page(campaign, result, hidden / "replay.html")
    return result


def save_replay_page(campaign: Campaign, result: ReplayResult, path: Path) -> None:
    """Write the page of a replay; it needs no network."""
    machine = campaign.machine
    drawn = [
        (inputs(machine, result), said.inputs()),
        (speeds(machine, result), said.speeds()),
        (residuals(machine, result), said.residuals()),
    ]
    text = [*sentences(machine, result), *notes_line(campaign)]
    section = Section(sentences=text, tables=[table(machine, result)], figures=drawn)
    save_page([section], path, f"Replay of campaign {campaign.name} — {machine.name}")


def notes_line(campaign: Campaign) -> list[str]:
    """The reader's notes as one paragraph; none when it had nothing to say."""
    notes = campaign.all_notes
    return [f"Notes on the logs: {'; '.join(notes)}."] if notes else []


# For notebooks.


def _columns(r: ReplayResult) -> Mapping[str, Sequence[Any]]:
    """One row a run; residual and noise in the unit of the machine's input, N m or N."""
    rows = [measures(r.machine, run) for run in r.runs]
    numbers = {measure.field: [row[k].value for row in rows] for k, measure in enumerate(rows[0])}
    return {"run": [run.name for run in r.runs], **numbers}


VIEW = View(
    {"runs": lambda r: table(r.machine, r)},
    {
        "speed": lambda r: speeds(r.machine, r),
        "residual": lambda r: residuals(r.machine, r),
        "input": lambda r: inputs(r.machine, r),
    },
    _columns,
    index="run",
)
