"""A replay as people see it: table, sentences, the paper's Figures 6 to 8, the residual over time, page and JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.json_records import rounded
from workbench.core.run import Array, Run
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of, plant_of
from workbench.simulate.replay import Replay, ReplayResult
from workbench.view.numbers import MOST, figures
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels, ranges_below_names
from workbench.view.style import (
    BLACK,
    LINE_AFTER,
    LINE_BEFORE,
    NOISE_DASH,
    PURPLE,
    REST,
    WINDOW,
    line,
)
from workbench.view.words import words_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

SIDE_BY_SIDE = 2  # runs in a row
PAPER_PERCENT = 7.49  # RMSE of the paper's own machine, its Figure 8
EXPLAINED = 1.3  # times the noise: what is left while moving is then little more than noise
REMEDY = "`workbench identify` fits the values, `workbench diagnose` names what the model lacks."
INPUTS_NOTE = "What the machine was given (the paper's Figure 6)."
RESIDUAL_NOTE = (
    "At rest the machine may hold its load anywhere within its friction, so the residual says nothing there; "
    "the scale is that of the motion."
)
Stretches = Sequence[tuple[float, float]]
Places = list[tuple[int, int]]


# Table, sentences, JSON.


def table(machine: Hoist | Axis, result: ReplayResult) -> Table:
    """A line a run, and one for all."""
    rows = [measures(run.name, run, run.balance.noise_rms) for run in result.runs]
    if len(rows) > 1:
        rows.append(measures("all runs", result, result.noise_rms))
    return Table(columns(machine, "run"), rows, note(machine, result))


def columns(machine: Hoist | Axis, first: str) -> list[Column]:
    """The columns of `measures`, and before them one of names."""
    w = words_of(machine)
    return [
        words(first), Column("speed error\nopen loop", "%"), Column("speed error\nrestarted", "%"),
        Column(f"{w.quantity}\nresidual", w.unit), Column("the same,\nmoving", w.unit),
        Column("sensor\nnoise", w.unit),
    ]  # fmt: skip


def _percent(value: float) -> str:
    """Two decimals; of a replay that diverges three digits and an exponent."""
    return f"{value:.2f}" if abs(value) < MOST else figures(value)


def measures(name: str, replay: Replay | ReplayResult, noise_rms: float) -> list[str]:
    """The row of a run, or of all: speed errors, residuals, noise."""
    return [
        name,
        _percent(replay.speed_rmse_percent),
        _percent(replay.speed_rmse_percent_restarted_2s),
        figures(replay.residual_rms),
        figures(replay.residual_rms_moving),
        figures(noise_rms),
    ]


def note(machine: Hoist | Axis, result: ReplayResult) -> str:
    """How the columns are made."""
    w = words_of(machine)
    return (
        f"All rms. Speed errors in per cent of {w.scale}; restarted: set back to the measured motion every 2 s. "
        f"Residual: measured minus predicted {w.quantity}, both below {result.band_hz:.3g} Hz; moving: without rests; "
        f"noise: that of the logged {w.quantity} in this band."
    )


def sentences(machine: Hoist | Axis, result: ReplayResult, remedy: str = REMEDY) -> list[str]:
    """What these figures say of the model, the drifting one first. remedy: what to do where it explains too little."""
    return [_open_loop(machine, result), _residual(machine, result, remedy)]


def _open_loop(machine: Hoist | Axis, result: ReplayResult) -> str:
    percent = f"{figures(result.speed_rmse_percent)} %"
    first = f"Open loop the model is {percent} off; the paper has {PAPER_PERCENT} % for its own machine."
    kind = kind_of(machine)
    if kind.nominal_speed is None:
        return f"{first} That figure adds up every bias from the run's first sample on: judge by the residual."
    run = result.runs[0].simulated
    drift = 100.0 * 10.0 / kind.rigid(machine, run.payload_kg).inertia / kind.nominal_speed(machine)
    return (
        f"{first} That figure adds up every bias: 1 {kind.drive.unit} of {kind.drive.quantity} that the model "
        f"does not know moves the speed by {drift:.1f} % within 10 s. Judge by the other columns."
    )


def _residual(machine: Hoist | Axis, result: ReplayResult, remedy: str) -> str:
    w = words_of(machine)
    moving, noise = result.residual_rms_moving, result.noise_rms
    if not moving > 0.0:
        return "The machine never moves in these runs: they say nothing of friction or inertia."
    if not noise_is_floor(machine, result):
        return (
            f"The {w.quantity} residual is {_percent(result.residual_percent)} % of the {w.quantity} itself. "
            "Its floor lies above the noise given: that of the position, differentiated twice, comes on top."
        )
    if moving <= EXPLAINED * noise:
        return f"While moving, the residual is {moving / noise:.1f} times the noise: the model explains these runs."
    return (
        f"While moving, the residual is {moving / noise:.1f} times the noise: values are off, or the model lacks "
        f"something. {remedy}"
    )


def noise_is_floor(machine: Hoist | Axis, result: ReplayResult) -> bool:
    """Whether the noise is what a perfect model leaves: not where the speed is the logged position's derivative."""
    return kind_of(machine).plant.speeds[0] in result.runs[0].balance.run


def to_json(campaign: Campaign, result: ReplayResult) -> dict[str, Any]:
    """replay.json: the keys of the format, and beside them the residual while moving, the noise and the notes."""
    machine = campaign.machine
    result_json: dict[str, Any] = {
        "format": 1,
        "campaign": campaign.name,
        "machine": machine.name,
        "runs": [{"name": run.name} | _measures_json(machine, run, run.balance.noise_rms) for run in result.runs],
        "overall": _measures_json(machine, result, result.noise_rms),
    }
    result_json["overall"] |= {
        f"{words_of(machine).quantity}_residual_percent": rounded(result.residual_percent),
        "band_hz": rounded(result.band_hz),
    }
    return result_json | {"notes": list(campaign.all_notes)}


def _measures_json(machine: Hoist | Axis, replay: Replay | ReplayResult, noise_rms: float) -> dict[str, float | None]:
    w = words_of(machine)
    return {
        "speed_rmse_percent": rounded(replay.speed_rmse_percent),
        "speed_rmse_percent_restarted_2s": rounded(replay.speed_rmse_percent_restarted_2s),
        f"{w.quantity}_residual_rms_{w.suffix}": rounded(replay.residual_rms),
        f"{w.quantity}_residual_rms_moving_{w.suffix}": rounded(replay.residual_rms_moving),
        f"noise_rms_{w.suffix}": rounded(noise_rms),
    }


# Figures.


def run_grid(title: str, y_title: str, names: Sequence[str]) -> tuple[Panels, Places, int]:
    """A panel a run: panels, (row, column) of each run, height."""
    columns = min(SIDE_BY_SIDE, len(names))
    rows = -(-len(names) // columns)
    panels = Panels(title, [y_title] * rows, [""] * columns)
    places = [divmod(index, columns) for index in range(len(names))]
    for index, name in enumerate(names):
        number = "" if index == 0 else str(index + 1)
        panels.annotations.append(
            {"text": f"<b>{name}</b>", "x": 0.01, "y": 0.99, "xref": f"x{number} domain", "yref": f"y{number} domain",
             "xanchor": "left", "yanchor": "top", "showarrow": False, "font": {"size": 12},
             "bgcolor": "rgba(255,255,255,0.75)", "borderpad": 1}
        )  # fmt: skip
    return panels, places, 150 + max(210 * rows, 330)


def runs_figure(panels: Panels, height: int, places: Places, ranges: dict[int, tuple[float, float]] | None) -> Figure:
    """The figure of a grid of runs. Where the last row is not full, the panel above its empty place ends its column."""
    figure = panels.figure(height, ranges)
    columns, count = len(panels.column_titles), len(places)
    for index in range(max(count - columns, 0), count):
        figure.layout["xaxis" if index == 0 else f"xaxis{index + 1}"].update(
            showticklabels=True, title={"text": panels.x_title}
        )
    return figure


def torque_profiles(runs: Sequence[Run], nominal_torque_nm: float) -> Figure:
    """Fig. 6: both motors' measured torque over one motor's nominal torque, a panel a run."""
    panels, places, height = run_grid("Measured motor torque", "torque / nominal", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        if "torque_motor1_nm" in run and "torque_motor2_nm" in run:
            torques = {f"motor {number}": run[f"torque_motor{number}_nm"] / nominal_torque_nm for number in (1, 2)}
        else:
            torques = {"mean of both motors": run["torque_motor_nm"] / (2.0 * nominal_torque_nm)}
        for name, torque in torques.items():
            panels.line(
                row, column, run.time_s, torque, name, line(name if len(torques) > 1 else "measured", width=1.4)
            )
        drawn.append(list(torques.values()))
    return runs_figure(panels, height, places, ranges_below_names(places, drawn))


def input_profiles(runs: Sequence[Run], signal: str, unit: str) -> Figure:
    """Fig. 6 for an axis: the measured force (torque) in its own unit, a panel a run."""
    quantity = signal.rpartition("_")[0].replace("_", " ")
    panels, places, height = run_grid(f"Measured {quantity}", f"{quantity} ({unit})", [run.name for run in runs])
    for (row, column), run in zip(places, runs, strict=True):
        panels.line(row, column, run.time_s, run[signal], "measured", line("measured", width=1.2), unit)
    return runs_figure(panels, height, places, ranges_below_names(places, [[run[signal]] for run in runs]))


def speed_comparison(
    pairs: Sequence[tuple[Run, Run]],
    nominal_speed: float,
    rmse_percent: Sequence[float] | None = None,
    signal: str = "speed_motor_rad_s",
    restarted: Sequence[Array] = (),
    scale_name: str = "nominal",
) -> Figure:
    """Fig. 8: measured and simulated speed in per cent of `nominal_speed`, a panel a run.

    pairs: (measured, simulated), each with `signal`, in the unit of nominal_speed; their times may differ.
    rmse_percent: said beside the run's name. restarted: (n,) of each run, at the simulated run's times.
    """
    names = [measured.name for measured, _ in pairs]
    if rmse_percent is not None:
        names = [f"{name}</b>, RMSE {value:.2f} %<b>" for name, value in zip(names, rmse_percent, strict=True)]
    panels, places, height = run_grid("Measured and simulated speed", f"speed (% of {scale_name})", names)
    drawn = []
    for index, ((row, column), pair) in enumerate(zip(places, pairs, strict=True)):
        drawn.append([run[signal] * (100.0 / nominal_speed) for run in pair])
        for name, run in zip(("measured", "simulated"), pair, strict=True):
            speed = run[signal] * (100.0 / nominal_speed)
            # The measured line is wide and lies below, so that it is seen where both agree.
            width = 3.4 if name == "measured" else 1.6
            panels.line(row, column, run.time_s, speed, name, line(name, width=width), "%")
        if restarted:
            speed = restarted[index] * (100.0 / nominal_speed)
            look = {"color": PURPLE, "dash": "5px,3px", "width": 1.3, "simplify": False}
            panels.line(row, column, pair[1].time_s, speed, "restarted every 2 s", look, "%")
    return runs_figure(panels, height, places, ranges_below_names(places, drawn))


def torque_residual(
    names: Sequence[str],
    times_s: Sequence[Array],
    residuals: Sequence[Array],
    unit: str = "N m",
    noise_rms: float | None = None,
    windows: Sequence[Stretches] = (),
    rests: Sequence[Stretches] = (),
    before: Sequence[Array] = (),
    limit: float | None = None,
    alone: Mapping[str, Any] | None = None,
) -> Figure:
    """Measured minus predicted torque (or force) over time, a panel a run, both low-passed alike.

    noise_rms: drawn as ± twice its value. windows, rests: for each run stretches to shade, yellow and grey.
    before: the same of an earlier model, drawn below. limit: of the vertical axis, both ways. alone: the line of a
    residual with none before it.
    """
    quantity = "torque" if unit == "N m" else "force"
    legend = [] if noise_rms is None else [f"dashed: ± 2 × noise of {noise_rms:.2g} {unit}"]
    if any(rests):
        legend.append("grey: at rest or at an end, left out")
    title = f"{quantity.capitalize()} residual" + (f" ({'; '.join(legend)})" if legend else "")
    panels, places, height = run_grid(title, f"{quantity} residual ({unit})", names)
    look = LINE_AFTER if before else dict(alone or LINE_AFTER | {"color": BLACK})
    for index, place in enumerate(places):
        if before:
            panels.line(*place, times_s[index], before[index], "before", LINE_BEFORE, unit)
        name = "after" if before else "measured − predicted"
        panels.line(*place, times_s[index], residuals[index], name, look, unit)
        for level in () if noise_rms is None else (2.0 * noise_rms, -2.0 * noise_rms):
            panels.level(*place, level, dash=NOISE_DASH)
        for stretches, colour in ((windows, WINDOW), (rests, REST)):
            for start, end in stretches[index] if index < len(stretches) else ():
                panels.shade(*place, start, end, colour)
    ranges = None if limit is None else dict.fromkeys({row for row, _ in places}, (-limit, limit))
    return runs_figure(panels, height, places, ranges)


def inputs(machine: Hoist | Axis, result: ReplayResult) -> Figure:
    """Fig. 6: the measured torque of both motors, or an axis' measured input."""
    runs = [run.balance.run for run in result.runs]
    kind = kind_of(machine)
    if kind.motor_torque is not None:
        return torque_profiles(runs, kind.motor_torque(machine))
    return input_profiles(runs, kind.plant.input, kind.drive.unit)


def speeds(machine: Hoist | Axis, result: ReplayResult) -> Figure:
    """Fig. 8: measured, simulated and restarted speed in per cent of the machine's speed scale."""
    signal = plant_of(machine).speeds[0]
    pairs = [
        (Run(run.name, run.balance.run.time_s, {signal: run.balance.motion.speed}), run.simulated)
        for run in result.runs
    ]
    return speed_comparison(
        pairs,
        result.runs[0].speed_scale,
        [run.speed_rmse_percent for run in result.runs],
        signal,
        [run.restarted for run in result.runs],
        kind_of(machine).speed_scale[1],
    )


def residuals(machine: Hoist | Axis, result: ReplayResult, before: ReplayResult | None = None) -> Figure:
    """The balance's residual over time, on the scale of what is left while moving; `before` an identification below."""
    earlier = [] if before is None else [run.balance.residual for run in before.runs]
    compared = [run.balance for run in result.runs] if before is None else [run.balance for run in before.runs]
    largest = max((float(np.max(np.abs(b.residual[b.moving]), initial=0.0)) for b in compared), default=0.0)
    floor = 4.0 * result.noise_rms
    return torque_residual(
        [run.name for run in result.runs],
        [run.balance.run.time_s for run in result.runs],
        [run.balance.residual for run in result.runs],
        words_of(machine).unit,
        result.noise_rms,
        rests=[stretches(run.balance.run.time_s, ~run.balance.moving) for run in result.runs],
        before=earlier,
        limit=1.15 * max(largest, floor) or None,
    )


def stretches(time_s: Sequence[float] | np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    """From when to when a mask (n,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(float(time_s[a]), float(time_s[b - 1])) for a, b in edges.reshape(-1, 2)]


# The page.


def write_replay(run: Callable[[], ReplayResult], campaign: Campaign, folder: Path) -> ReplayResult:
    """Replay, and write replay.json and replay.html; all or nothing, see `whole_folder`."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        result = run()
        write_json(hidden / "replay.json", to_json(campaign, result))
        save_replay_page(campaign, result, hidden / "replay.html")
    return result


def save_replay_page(campaign: Campaign, result: ReplayResult, path: Path) -> None:
    """Write the page of a replay; it needs no network."""
    machine = campaign.machine
    section = Section(
        sentences=[*sentences(machine, result), *notes_line(campaign)],
        tables=[table(machine, result)],
        figures=[
            (inputs(machine, result), INPUTS_NOTE),
            (
                speeds(machine, result),
                "Simulated: the measured input replayed from the first sample on (the paper's Figure 8). Restarted: "
                "set back to the measured motion every 2 s.",
            ),
            (residuals(machine, result), RESIDUAL_NOTE),
        ],
    )
    save_page([section], path, f"Replay of campaign {campaign.name} — {machine.name}")


def notes_line(campaign: Campaign) -> list[str]:
    """The reader's notes as one paragraph; none when it had nothing to say."""
    notes = campaign.all_notes
    return [f"Notes on the logs: {'; '.join(notes)}."] if notes else []


# For notebooks.


def _columns(r: ReplayResult) -> Mapping[str, Sequence[Any]]:
    """One row a run; residual and noise in the unit of the machine's input, N m or N."""
    names = ("speed_rmse_percent", "speed_rmse_percent_restarted_2s", "residual_rms", "residual_rms_moving")
    return {
        "run": [run.name for run in r.runs],
        **{name: [getattr(run, name) for run in r.runs] for name in names},
        "noise_rms": [run.balance.noise_rms for run in r.runs],
    }


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
