"""Two models of one machine as people see it: table, sentences, models.json, page, and the figures over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.json_records import rounded
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.simulate.models import ModelsCompared, ModelsRun
from workbench.view.page import Section, save_page
from workbench.view.panels import ranges_below_names
from workbench.view.replay import run_grid
from workbench.view.style import BLUE, ORANGE, SPARE, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PAPER = (91.53, 3.46, 49.76)  # s of compute, multi-body and analytical, for so many seconds: the paper's Table 1
_SPEED, _FORCES = "speed_motor_rad_s", ("force_roller_", "force_cylinder_n")
COLUMNS = (
    words("run"),
    Column("lumped\nRMSE", "%"),
    Column("multi-body\nRMSE", "%"),
    Column("apart\nrms", "%"),
    Column("parts\nmost at", "s"),
    Column("height\nthere", "m"),
    Column("lumped\ncompute", "s"),
    Column("multi-body\ncompute", "s"),
)


def table(compared: ModelsCompared) -> Table:
    """A line a run, and one for all."""
    lines = [_line(run) for run in compared.runs]
    if len(lines) > 1:
        lumped, multibody = compared.cpu_s
        pooled = [compared.pooled(f"{name}_percent") for name in ("lumped_rmse", "multibody_rmse", "apart")]
        lines.append(["all runs", *(f"{v:.3f}" for v in pooled), "", "", f"{lumped:.4f}", f"{multibody:.2f}"])
    return Table(COLUMNS, lines, note(compared))


def _line(run: ModelsRun) -> list[str]:
    return [
        run.name,
        f"{run.lumped_rmse_percent:.3f}",
        f"{run.multibody_rmse_percent:.3f}",
        f"{run.apart_percent:.3f}",
        f"{run.parted_s:.1f}",
        f"{run.parted_height_m:.2f}",
        f"{run.lumped_cpu_s:.4f}",
        f"{run.multibody_cpu_s:.2f}",
    ]


def note(compared: ModelsCompared) -> str:
    """How the columns are made."""
    return (
        f"RMSE: motor speed against {compared.against}, in per cent of nominal ({compared.scale_rad_s:.4g} rad/s). "
        "Apart: the two models against each other. Parts most: where their difference grows fastest, over a second. "
        "Compute: CPU time of this computer."
    )


def sentences(compared: ModelsCompared) -> list[str]:
    """What the figures come to."""
    lumped_s, multibody_s = compared.cpu_s
    apart = compared.pooled("apart_percent")
    worst = max(compared.runs, key=lambda run: run.parted_percent)
    paper = PAPER[0] / PAPER[1]
    lines = [
        f"The two models' motor speeds differ by {apart:.3g} % of nominal speed, rms over all runs.",
        f"{compared.simulated_s:.1f} s of motion take the lumped model {lumped_s:.3g} s and the multi-body model "
        f"{multibody_s:.3g} s: {compared.ratio:.0f} times as long, {compared.simulated_s / multibody_s:.1f} times "
        f"faster than real time. The paper's models took {PAPER[1]} s and {PAPER[0]} s for {PAPER[2]} s: "
        f"{paper:.0f} times.",
    ]
    where = (
        f"They part most in run {worst.name} at {worst.parted_s:.1f} s, at height {worst.parted_height_m:.2f} m with "
        f"{worst.measured.payload_kg:.0f} kg, by {worst.parted_percent:.2g} % of nominal speed within a second"
    )
    roller = worst.parted_force.replace("_", " ")
    lines.append(f"{where}; the largest roller force there is {worst.parted_force_n / 1000.0:.1f} kN, of the {roller}.")
    return lines


def to_json(compared: ModelsCompared) -> dict[str, Any]:
    lumped_s, multibody_s = compared.cpu_s
    keys = ("lumped_rmse", "multibody_rmse", "apart")
    return {
        "format": 1,
        "machine": compared.machine.name,
        "against": compared.against,
        "runs": [_run_json(run) for run in compared.runs],
        "overall": {
            **{f"{key}_percent": rounded(compared.pooled(f"{key}_percent")) for key in keys},
            "simulated_s": rounded(compared.simulated_s),
            "lumped_cpu_s": rounded(lumped_s),
            "multibody_cpu_s": rounded(multibody_s),
            "ratio": rounded(compared.ratio),
            "real_time_factor": rounded(compared.simulated_s / multibody_s),
        },
        "paper": {"multibody_s": PAPER[0], "analytical_s": PAPER[1], "simulated_s": PAPER[2]},
    }


def _run_json(run: ModelsRun) -> dict[str, Any]:
    names = ("lumped_rmse_percent", "multibody_rmse_percent", "apart_percent", "lumped_cpu_s", "multibody_cpu_s")
    parts = {
        "time_s": rounded(run.parted_s),
        "within_a_second_percent": rounded(run.parted_percent),
        "height_m": rounded(run.parted_height_m),
        "payload_kg": run.measured.payload_kg,
        "roller": run.parted_force,
        "roller_force_n": rounded(run.parted_force_n),
    }
    return {"name": run.name, **{name: rounded(getattr(run, name)) for name in names}, "parts_most": parts}


def write_models(simulate: Callable[[], ModelsCompared], title: str, folder: Path) -> ModelsCompared:
    """Compare, and write models.json and models.html; all or nothing."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        compared = simulate()
        write_json(hidden / "models.json", to_json(compared))
        heading = f"Two models of {compared.machine.name} — {title}"
        save_page([section_of(compared)], hidden / "models.html", heading)
    return compared


def section_of(compared: ModelsCompared) -> Section:
    """All of it, as a page shows it."""
    return Section(sentences=sentences(compared), tables=[table(compared)], figures=figures_of(compared))


def figures_of(compared: ModelsCompared) -> list[tuple[Figure, str]]:
    """The paper's Figure 8 for these runs, the difference of the two models, forces; each with a line below it."""
    runs, scale = compared.runs, compared.scale_rad_s
    return [
        (
            models_speed(runs, scale),
            "The paper's Figure 8: motor speed of the record and of both models under its torque.",
        ),
        (models_apart(runs, scale), "What the multi-body model's motor speed is more than the lumped one's."),
        (
            models_forces(runs),
            "Normal forces of the rollers, both rails' together, and the cylinders' force; multi-body model only.",
        ),
    ]


def models_speed(runs: Sequence[ModelsRun], scale_rad_s: float) -> Figure:
    """Fig. 8 of the paper: speed of the record and of both models in per cent of nominal, a panel a run."""
    panels, places, height = run_grid("Motor speed of both models", "speed (% of nominal)", [run.name for run in runs])
    looks = {
        "measured": line("measured", width=3.4),
        "lumped": {"color": ORANGE, "width": 1.8, "simplify": False},
        "multi-body": {"color": BLUE, "dash": "5px,3px", "width": 1.6, "simplify": False},
    }
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        speeds = {}
        for name, source in (("measured", run.measured), ("lumped", run.lumped), ("multi-body", run.multibody)):
            speeds[name] = source[_SPEED] * (100.0 / scale_rad_s)
            panels.line(row, column, source.time_s, speeds[name], name, looks[name], "%")
        drawn.append(list(speeds.values()))
    return panels.figure(height, ranges_below_names(places, drawn))


def models_apart(runs: Sequence[ModelsRun], scale_rad_s: float) -> Figure:
    """Multi-body less lumped motor speed in per cent of nominal."""
    panels, places, height = run_grid("Difference of both models", "speed (% of nominal)", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        apart = (run.multibody[_SPEED] - run.lumped[_SPEED]) * (100.0 / scale_rad_s)
        look = {"color": BLUE, "width": 1.6, "simplify": False}
        panels.line(row, column, run.multibody.time_s, apart, "multi-body − lumped", look, "%")
        drawn.append([apart])
    return panels.figure(height, ranges_below_names(places, drawn))


def models_forces(runs: Sequence[ModelsRun]) -> Figure:
    """Forces of rollers and cylinders, kN."""
    panels, places, height = run_grid("Forces of rollers and cylinders", "force (kN)", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        names = [name for name in run.multibody.signals if name.startswith(_FORCES)]
        for number, name in enumerate(names):
            colour, dash = SPARE[number % len(SPARE)]
            shown = name.removeprefix("force_").removesuffix("_n").replace("_", " ")
            look = {"color": colour, "dash": dash, "width": 1.4, "simplify": False}
            panels.line(row, column, run.multibody.time_s, run.multibody[name] / 1000.0, shown, look, "kN")
        drawn.append([run.multibody[name] / 1000.0 for name in names] or [np.zeros(1)])
    return panels.figure(height, ranges_below_names(places, drawn))
