"""`python -m benchmarks.resampled_axis EMPS_FOLDER --draws 10`: the mass of the EMPS axis, 80 kg in machine.yaml, from
resampled runs: the relative error of the estimate, and whether its 90 % interval holds the published 95.1 kg.

Each draw takes as many parts of the two records as there are, with replacement (a bootstrap over runs). The rest of
machine.yaml is as published.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from tests.support.emps_campaign import RUNS
from workbench.blind.recording import cut
from workbench.diagnose.diagnose import diagnose
from workbench.logs import read_campaign
from workbench.view.diagnosis_json import to_json

MASS_KG, BELIEVED_KG = 95.1089, 80.0
MACHINE = f"""\
kind: axis
motion: linear
mass_kg: {BELIEVED_KG}
gravity: {{constant_n: 0.0}}
friction: {{coulomb_forward_n: 20.3935, coulomb_backward_n: 20.3935, viscous_n_s_per_m: 203.5034}}
sensors: {{force_offset_n: -3.1648}}
tolerances: {{inertia: 0.01, coulomb: 0.05, viscous: 0.05, force_gain: 0.005, force_offset_n: 0.3}}
"""
OF_90 = 1.645  # standard errors
PARTS = 4  # of each record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the public EMPS records")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "machine.yaml").write_text(MACHINE)
        (folder / "runs.yaml").write_text(RUNS)
        (folder / "runs").symlink_to(args.folder.resolve())
        campaign = read_campaign(folder)
        parts = [part for run in campaign.runs for part in cut(campaign.machine, run, PARTS)]
        rng, held = np.random.default_rng(args.seed), 0
        for draw in range(args.draws):
            chosen = [parts[k] for k in rng.integers(0, len(parts), len(parts))]
            runs = tuple(replace(run, name=f"{run.name}_{k}") for k, run in enumerate(chosen))
            found = diagnose(replace(campaign, runs=runs), study=False)
            value = to_json(found)["parameters"].get("inertia_error", {}).get("inertia_fraction")
            if value is None:
                print(f"{draw}: {found}", flush=True)
                continue
            believed = cast(Any, found.corrected).mass_kg  # within its tolerance
            mass, off = believed * (1.0 + value["value"]), OF_90 * believed * value["std_error"]
            held += abs(mass - MASS_KG) < off
            print(f"{draw}: {mass:.2f} ± {off:.2f} kg, {100.0 * (mass / MASS_KG - 1.0):+.2f} %", flush=True)
        print(f"the interval holds {MASS_KG:.1f} kg in {held} of {args.draws} draws")


if __name__ == "__main__":
    main()
