"""`python -m benchmarks.unlisted_laws FOLDER --seed 9811`: the law in a formula of an unlisted cause.

Judged per campaign: the form (the true variables and no others, friction levels apart, which no log tells from the
base parameters'); the residual of held-out runs over that of the same machine and runs without the cause, which is what
the true law would leave; and, on runs that are kept for the end, the delivered machines against the refitted one.
"""

from __future__ import annotations

import argparse
import json
import math
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.many_causes import problem_of
from benchmarks.validation.campaign import make_campaign
from benchmarks.validation.entry import content_of
from workbench.blind.make import mapped
from workbench.blind.run import save
from workbench.blind.seal import Order
from workbench.core.run import Run
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.held_out import folds_by_run, held_out
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import Search
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.unknown import explain, explained_machine
from workbench.effects.loading import know
from workbench.effects.registry import UserFile, add
from workbench.logs import read_campaign
from workbench.machines import Axis, Hoist, load_machine
from workbench.simulate.motion import own_impacts
from workbench.simulate.replay import replay_runs

STEP, WAVE = r"step\(x .*\) sign v", r"(cos|sin)\(2π x/.*\) sign v"
FORMS = {
    "fan": r"v \|v\|", "rail_step": STEP, "roller": WAVE,
    "quadratic_drag": r"v \|v\|", "guide_step": STEP, "friction_wave": WAVE,
    "cable_chain": r"\(x [−+] .*\)", "chain_end": r"\(x [−+] .*\)²",
}  # fmt: skip
LEVELS = {"1", "sign v"}
BESIDE = {"chain_end": r"\(x [−+] .*\)", "friction_wave": WAVE, "roller": WAVE}  # columns of the same term
FAMILY = {
    "hoist": ("hoist_practice", "hoist_small", "hoist_middle"),
    "axis": ("axis_std", "axis_rates", "axis_encoder"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=2, help="of each cause")
    parser.add_argument("--causes", nargs="+")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    orders = []
    for n, (kind, name) in enumerate(
        (k, c) for _ in range(given.cases) for k, c in causes() if c in (given.causes or [c])
    ):
        family = FAMILY[kind][n % len(FAMILY[kind])]
        orders.append(Order(n, (given.seed, n), "simulator", family, "unknown", (name,)))
    with mapped(given.processes) as over:
        for line in over(partial(judged, given.folder), orders):
            print(line, flush=True)
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(given.folder.glob("*.json"))]
    shown = [row for row in rows if row["over_floor"] > 1.5]
    laws = [row for row in shown if row["law"]]
    print(
        f"{len(rows)} campaigns, {len(shown)} with a gap of more than 1.5 times what the true law leaves; form right "
        f"{sum(row['form'] for row in shown)}, within 1.5 of the true law's residual "
        f"{sum(row['ratio'] < 1.5 for row in laws)} of {len(laws)} laws; worse than without on kept runs: machine "
        f"{sum(row['kept']['machine'] > 1.02 * row['kept']['refitted'] for row in rows)}, with its law "
        f"{sum(row['kept']['law'] > 1.02 * row['kept']['refitted'] for row in laws)}"
    )


def causes() -> list[tuple[str, str]]:
    """Kind and name of each, hoists and axes in turn."""
    hoists, axes = (("fan", "rail_step", "quadratic_drag", "roller"),
                    ("quadratic_drag", "cable_chain", "guide_step", "chain_end", "friction_wave"))  # fmt: skip
    return [("hoist", name) for name in hoists] + [("axis", name) for name in axes]


def judged(folder: Path, order: Order) -> str:
    file = folder / f"{order.number:03d}.json"
    if not file.exists():
        save(json.dumps(_judged(file.with_suffix(""), order), default=float), file)
    row = json.loads(file.read_text(encoding="utf-8"))
    return (
        f"{file.stem} {order.family} {row['cause']}, gap {row['over_floor']:.1f} floors: {' + '.join(row['law'])}; "
        f"form {'right' if row['form'] else 'wrong'}; held out {row['ratio']:.2f} of the true law's, table "
        f"{row['table_ratio']:.2f}; kept run {row['kept']}"
    )


def _judged(folder: Path, order: Order) -> dict[str, Any]:
    content, (cause,) = content_of(order), order.names
    if not folder.exists():
        make_campaign(folder, order.seed, content)
        make_campaign(folder / "without", order.seed, replace(content, causes=()))
    campaign, sound = read_campaign(folder), read_campaign(folder / "without")
    kept = [campaign.runs[-1]]
    problem = problem_of(replace(campaign, runs=campaign.runs[:-1]))
    truth = problem_of(replace(sound, runs=sound.runs[:-1]), problem.band_hz)
    before, near = _base(problem)
    floor, _ = _base(truth)
    found = explain(problem, near)
    keys = base_parameters(problem.machine, problem.runs)
    refitted, machine = refitted_machine(problem, keys, near), explained_machine(problem, found)
    row: dict[str, Any] = {
        "cause": cause, "family": order.family, "over_floor": before / floor, "floor": floor, "law": [], "form": False,
        "ratio": math.nan, "table_ratio": found.held_out.rms(problem.inputs) / floor,
        "kept": {"refitted": left(refitted, kept, problem.band_hz), "machine": left(machine, kept, problem.band_hz)},
    }  # fmt: skip
    if law := found.law:
        row |= {"law": law.formulas, "form": form_right(cause, law.formulas), "ratio": law.after / floor,
                "explains": law.explains, "acts_on": law.acts_on, "before": law.before, "after": law.after}  # fmt: skip
        row["kept"]["law"] = _with_law(folder, law.name, law.source, law.machine, kept, problem.band_hz)
    return row


def _base(problem: Problem) -> tuple[float, Fitted]:
    """The residual of held-out runs by the base parameters alone, and their fit within the tolerances."""
    search = Search(problem, [], base=base_parameters(problem.machine, problem.runs))
    near = search.singles(0).within_tolerances
    return held_out(problem, near, folds_by_run(problem)).rms(problem.inputs), near


def left(machine: Hoist | Axis, runs: list[Run], band_hz: float) -> float:
    """The residual of runs that nothing was fitted to."""
    return replay_runs(machine, runs, band_hz, own_impacts(machine, runs)).residual_rms_moving


def _with_law(folder: Path, name: str, source: str, machine: str, runs: list[Run], band_hz: float) -> float:
    file = UserFile(f"{name}.py", source.encode())
    try:
        know(file)
        (folder / "machine_law.yaml").write_text(machine, encoding="utf-8")
        return left(load_machine(folder / "machine_law.yaml"), runs, band_hz)
    finally:
        add([], name, file)


def form_right(cause: str, formulas: list[str]) -> bool:
    """Whether a law has the true term, and beside it friction levels only."""
    others = [text for text in formulas if not re.fullmatch(FORMS[cause], text) and text not in LEVELS]
    also = BESIDE.get(cause)
    return (
        len(others) < len(formulas)
        and all(also and re.fullmatch(also, text) for text in others)
        and any(re.fullmatch(FORMS[cause], text) for text in formulas)
    )


if __name__ == "__main__":
    main()
