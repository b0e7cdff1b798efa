"""Steps of the exported plant and loop, and of the workbench's own: `python -m benchmarks.fmu_speed`."""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.serve import PAYLOAD_KG, START_M, case_at
from workbench.control import PiSettings
from workbench.export.fmu import HEADERS, host_compiler, write_sources
from workbench.export.model import Start, model_of
from workbench.machines import default_hoist
from workbench.simulate.loop import LoopCase, simulate_loop

STEPS = 60_000  # of 1 ms: one minute
DRIVER = """\
#include <stdio.h>
#include <time.h>
#include "core.h"
int main(void) {
    static Core m;
    core_reset(&m);
    if (core_enter(&m, 0.0, 0, 0.0) || core_exit(&m)) return 1;
    clock_t begin = clock();
    for (int k = 0; k < %(steps)d; k++) {
        double shown;
        core_set(&m, %(input)d, TYPE_REAL, %(value)s);
        if (core_step(&m, m.now.time, 0.001)) return 1;
        core_get(&m, %(output)d, TYPE_REAL, &shown);
    }
    printf("%%.9f\\n", (double)(clock() - begin) / CLOCKS_PER_SEC);
    return 0;
}
"""


def seconds(settings: PiSettings | None = None) -> float:
    """CPU time of a minute of the default hoist: input, step of 1 ms and outputs at every millisecond.

    settings: the speed loop is inside, and its input is the speed reference.
    """
    model = model_of(default_hoist(), Start(PAYLOAD_KG, START_M), controller=settings)
    torque = settings is None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "sources"
        write_sources(model, folder, "3.0")
        filled = DRIVER % {
            "steps": STEPS, "output": model.reference("speed_motor_rad_s"),
            "input": model.reference("torque_motor_nm" if torque else "speed_reference_rad_s"),
            "value": "m.now.hold + ((k / 2000) % 2 ? 20.0 : -20.0)" if torque else "(k / 2000) % 2 ? 5.0 : -5.0",
        }  # fmt: skip
        (folder / "driver.c").write_text(filled, encoding="utf-8")
        words = [host_compiler() or "cc", "-std=c99", "-O2", "-ffp-contract=off", f"-I{HEADERS}"]
        subprocess.run([*words, "driver.c", "core.c", "model.c", "-o", "driver", "-lm"], cwd=folder, check=True)
        runs = [subprocess.run([folder / "driver"], check=True, capture_output=True, text=True) for _ in range(5)]
        return min(float(run.stdout) for run in runs)


def own_seconds(record_every: int) -> float:
    """CPU time of the same minute of the loop in the workbench's own kernel. record_every: samples, 0: none."""
    machine = default_hoist()
    speed = np.where(np.arange(STEPS) // 2000 % 2, 5.0, -5.0)
    case = LoopCase("minute", machine, PAYLOAD_KG, START_M, case_at(1000.0, machine).controller, speed)
    spent = []
    for _ in range(6):  # the first one compiles
        begin = time.process_time()
        simulate_loop([case], record_every=record_every)
        spent.append(time.process_time() - begin)
    return min(spent[1:])


if __name__ == "__main__":
    for name, least in (
        ("the exported plant", seconds()),
        ("the exported loop at 1 kHz", seconds(case_at(1000.0, default_hoist()).controller)),
        ("the workbench's own loop at 1 kHz, every sample recorded", own_seconds(1)),
        ("the workbench's own loop at 1 kHz, metrics alone", own_seconds(0)),
    ):
        print(f"{name}: {1e9 * least / STEPS:.0f} ns a step of 1 ms, {STEPS * 0.001 / least:.0f} times real time")
