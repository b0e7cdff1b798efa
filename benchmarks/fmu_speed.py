"""Steps of the exported plant by itself, without an importer: `python -m benchmarks.fmu_speed`."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from workbench.export.fmu import HEADERS, host_compiler, write_sources
from workbench.export.model import Start, model_of
from workbench.machine import default_hoist

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
    for (int k = 0; k < %d; k++) {
        double shown;
        core_set(&m, %d, TYPE_REAL, m.now.hold + ((k / 2000) %% 2 ? 20.0 : -20.0));
        if (core_step(&m, m.now.time, 0.001)) return 1;
        core_get(&m, %d, TYPE_REAL, &shown);
    }
    printf("%%.9f\\n", (double)(clock() - begin) / CLOCKS_PER_SEC);
    return 0;
}
"""


def seconds() -> float:
    """CPU time of a minute of the default hoist: input, step of 1 ms and outputs at every millisecond."""
    model = model_of(default_hoist(), Start(4500.0, 9.0))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "sources"
        write_sources(model, folder, "3.0")
        numbers = STEPS, model.reference("torque_motor_nm"), model.reference("speed_motor_rad_s")
        (folder / "driver.c").write_text(DRIVER % numbers, encoding="utf-8")
        words = [host_compiler() or "cc", "-std=c99", "-O2", "-ffp-contract=off", f"-I{HEADERS}"]
        subprocess.run([*words, "driver.c", "core.c", "model.c", "-o", "driver", "-lm"], cwd=folder, check=True)
        runs = [subprocess.run([folder / "driver"], check=True, capture_output=True, text=True) for _ in range(5)]
        return min(float(run.stdout) for run in runs)


if __name__ == "__main__":
    least = seconds()
    print(f"{1e9 * least / STEPS:.0f} ns a step, {STEPS * 0.001 / least:.0f} times real time")
