"""A study of 1,000 closed-loop runs from file to report: CPU time, and the share that is not simulation.

    python -m benchmarks.thousand_runs

Asked: at most 4 s of CPU on a quiet machine. Simulation is `simulate_loop`, compiled loop and its lanes; the remainder
is reading, planning, rows, the answer, and the report's page with its figures.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import workbench.study.run as runs
from workbench.study.conclude import ANSWER, write_answer
from workbench.study.load import load_study
from workbench.study.store import on_this_computer, place_for, read_finished, run_batch
from workbench.view.study import write_study_report

ROOT = Path(__file__).resolve().parents[1]
SCENARIO = f"""\
extends: {ROOT / "scenarios" / "payloads.yaml"}
name: thousand
payloads_kg: [9000]
references: [ruckig]
outputs: {{signals: none}}
sweep:
  limits.acceleration_m_s2: {{from: 0.2, to: 0.8, steps: 25}}
  limits.jerk_m_s3: {{from: 0.2, to: 6.4, steps: 40, scale: log}}
"""


def main() -> None:
    simulated, simulate = [0.0], runs.simulate_loop

    def timed(*args: Any, **more: Any) -> Any:
        begun = time.process_time()
        done = simulate(*args, **more)
        simulated[0] += time.process_time() - begun
        return done

    runs.simulate_loop = timed
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder) / "thousand.yaml", Path(folder) / "out"
        file.write_text(SCENARIO, encoding="utf-8")
        begun = time.process_time()
        study = load_study(file)
        # One thread: process_time counts all of them, and the simulation's share is then its own.
        run_batch(
            study, place_for(study, out), spread=partial(on_this_computer, cores=1), extras={ANSWER: write_answer}
        )
        study_s = time.process_time() - begun
        write_study_report(read_finished(out), out / "report.html")
        report_s = time.process_time() - begun - study_s
    every = study_s + report_s
    print(f"study {study_s:.2f} s, report {report_s:.2f} s of CPU, imports left out")
    print(
        f"simulation {simulated[0]:.2f} s; not simulation {every - simulated[0]:.2f} s, {1 - simulated[0] / every:.0%}"
    )


if __name__ == "__main__":
    main()
