"""The folder of a replay: replay.json, and a page with the paper's Figures 6 and 8 and the residual over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.run import Run
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.figures.replay import input_profiles, speed_comparison, torque_profiles, torque_residual
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of, plant_of
from workbench.reports.replay import report
from workbench.simulate.replay import Replay, ReplayResult
from workbench.view.page import Section, save_page
from workbench.view.words import words_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

INPUTS_NOTE = "What the machine was given (the paper's Figure 6)."
RESIDUAL_NOTE = (
    "At rest the machine may hold its load anywhere within its friction, so the residual says nothing there; "
    "the scale is that of the motion."
)


def write_replay(run: Callable[[], ReplayResult], campaign: Campaign, folder: Path) -> ReplayResult:
    """Replay, and write replay.json and replay.html; all or nothing, see `whole_folder`."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        result = run()
        write_json(hidden / "replay.json", report.to_json(campaign, result))
        save_replay_page(campaign, result, hidden / "replay.html")
    return result


def save_replay_page(campaign: Campaign, result: ReplayResult, path: Path) -> None:
    """Write the page of a replay; it needs no network."""
    machine = campaign.machine
    section = Section(
        sentences=[*report.sentences(machine, result), *notes_line(campaign)],
        tables=[report.table(machine, result)],
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
    pairs = [(_measured(run, signal), run.simulated) for run in result.runs]
    return speed_comparison(
        pairs,
        result.runs[0].speed_scale,
        [run.speed_rmse_percent for run in result.runs],
        signal,
        [run.restarted for run in result.runs],
        kind_of(machine).speed_scale[1],
    )


def _measured(run: Replay, signal: str) -> Run:
    balance = run.balance
    return Run(run.name, balance.run.time_s, {signal: balance.motion.speed})


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
