"""Two models of one machine as people see it: table, sentences, models.json, page, and the figures over time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from workbench.core.json_records import plain
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_folder, write_json
from workbench.simulate.models import ModelsCompared
from workbench.view.page import Section, save_page
from workbench.view.replay import Line, run_panels, said
from workbench.view.style import BLUE, ORANGE, SPARE, Figure, line, look

PAPER = (91.53, 3.46, 49.76)  # s of compute, multi-body and analytical, for so many seconds: the paper's Table 1
_SPEED, _FORCES = "speed_motor_rad_s", ("force_roller_", "force_cylinder_n")
# Column, field of a run, decimals.
COLUMNS = (
    (Column("lumped\nRMSE", "%"), "lumped_rmse_percent", 3),
    (Column("multi-body\nRMSE", "%"), "multibody_rmse_percent", 3),
    (Column("apart\nrms", "%"), "apart_percent", 3),
    (Column("parts\nmost at", "s"), "parted_s", 1),
    (Column("height\nthere", "m"), "parted_height_m", 2),
    (Column("lumped\ncompute", "s"), "lumped_cpu_s", 4),
    (Column("multi-body\ncompute", "s"), "multibody_cpu_s", 2),
)
PERCENTS = ("lumped_rmse_percent", "multibody_rmse_percent", "apart_percent")


def table(compared: ModelsCompared) -> Table:
    """A line a run, and one for all."""
    rows = [[run.name, *(f"{getattr(run, name):.{d}f}" for _, name, d in COLUMNS)] for run in compared.runs]
    if len(rows) > 1:
        lumped, multibody = compared.cpu_s
        pooled = [f"{compared.pooled(name):.3f}" for name in PERCENTS]
        rows.append(["all runs", *pooled, "", "", f"{lumped:.4f}", f"{multibody:.2f}"])
    return Table([words("run"), *(column for column, *_ in COLUMNS)], rows, said.models_note(compared))


def sentences(compared: ModelsCompared) -> list[str]:
    """What the figures come to."""
    worst = max(compared.runs, key=lambda run: run.parted_percent)
    return said.each("models", compared, worst, *compared.cpu_s, PAPER)


def to_json(compared: ModelsCompared) -> dict[str, Any]:
    lumped_s, multibody_s = compared.cpu_s
    parts = {"time_s": "parted_s", "within_a_second_percent": "parted_percent", "height_m": "parted_height_m"}
    told = {
        "format": 1,
        "machine": compared.machine.name,
        "against": compared.against,
        "runs": [
            {"name": run.name}
            | {name: getattr(run, name) for name in (*PERCENTS, "lumped_cpu_s", "multibody_cpu_s")}
            | {"parts_most": {key: getattr(run, name) for key, name in parts.items()}
                | {"payload_kg": run.measured.payload_kg, "roller": run.parted_force,
                   "roller_force_n": run.parted_force_n}}
            for run in compared.runs
        ],
        "overall": {name: compared.pooled(name) for name in PERCENTS}
        | {"simulated_s": compared.simulated_s, "lumped_cpu_s": lumped_s, "multibody_cpu_s": multibody_s,
           "ratio": compared.ratio, "real_time_factor": compared.simulated_s / multibody_s},
        "paper": {"multibody_s": PAPER[0], "analytical_s": PAPER[1], "simulated_s": PAPER[2]},
    }  # fmt: skip
    shown: dict[str, Any] = plain(told)
    return shown


def write_models(simulate: Callable[[], ModelsCompared], title: str, folder: Path) -> ModelsCompared:
    """Compare, and write models.json and models.html; all or nothing."""
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
    per_cent, names = 100.0 / compared.scale_rad_s, [run.name for run in compared.runs]
    speeds, apart, forces = [], [], []
    for run in compared.runs:
        time, multibody = run.multibody.time_s, run.multibody
        speeds.append([
            Line("measured", run.measured.time_s, per_cent * run.measured[_SPEED], line("measured", width=3.4)),
            Line("lumped", run.lumped.time_s, per_cent * run.lumped[_SPEED], look(ORANGE)),
            Line("multi-body", time, per_cent * multibody[_SPEED], look(BLUE, "5px,3px", 1.6)),
        ])  # fmt: skip
        difference = per_cent * (multibody[_SPEED] - run.lumped[_SPEED])
        apart.append([Line("multi-body − lumped", time, difference, look(BLUE, width=1.6))])
        felt = [name for name in multibody.signals if name.startswith(_FORCES)]
        called = [name.removeprefix("force_").removesuffix("_n").replace("_", " ") for name in felt]
        forces.append([
            Line(words, time, multibody[name] / 1000.0, look(*SPARE[k % len(SPARE)], 1.4))
            for k, (name, words) in enumerate(zip(felt, called, strict=True))
        ])  # fmt: skip
    return [
        (
            run_panels("Motor speed of both models", "speed (% of nominal)", names, speeds, "%"),
            "The paper's Figure 8: motor speed of the record and of both models under its torque.",
        ),
        (
            run_panels("Difference of both models", "speed (% of nominal)", names, apart, "%"),
            "What the multi-body model's motor speed is more than the lumped one's.",
        ),
        (
            run_panels("Forces of rollers and cylinders", "force (kN)", names, forces, "kN"),
            "Normal forces of the rollers, both rails' together, and the cylinders' force; multi-body model only.",
        ),
    ]
