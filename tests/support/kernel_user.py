"""A process of its own that compiles or finds kernels and prints what they compute, as exact text.

python -m tests.support.kernel_user axis|hoist|loop ... ; run from any checkout's root. `text` first: the hash of the
first kernel's text, which is not compiled.
"""

from __future__ import annotations

import hashlib
import logging
import sys
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from workbench.control import PiSettings
from workbench.engine import kernels, native
from workbench.machines import PLANTS, default_hoist
from workbench.simulate.loop import LoopCase, simulate_loop


def axis() -> float:
    plant = PLANTS["axis-rotary"]
    p = {"M": 2.0, "B": 3.0, "F_f": 1.0, "F_b": 1.0, "v_s": 1e-4, "G": 30.0, "C": 0.0}
    times = np.linspace(0.0, 1.0, 101)[:, None]
    parameters = np.array([[p[name]] for name in plant.parameters])
    out = kernels.replay(plant, parameters, times, 5.0 * times, np.array([[1.0], [0.0]]), np.array([[1.0]]))
    return float(out[-1, 1, 0])


def hoist() -> float:
    plant = PLANTS["hoist"]
    p = plant.values(default_hoist(), 4500.0)
    q, y, hold = plant.start_of(10.0, 20.0, p)
    times = np.linspace(0.0, 1.0, 101)[:, None]
    parameters = np.array([[getattr(p, name)] for name in plant.parameters])
    start = np.array([[*q, *y]]).T
    out = kernels.replay(plant, parameters, times, hold + 50.0 * times, start, np.array([[100.0], [2.0], [0.5]]))
    return float(out[-1, 3, 0])


def loop() -> float:
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
    case = LoopCase("lift", default_hoist(), 4500.0, 10.0, settings, np.linspace(0.0, 20.0, 500))
    return simulate_loop([case])[0].metrics["rms_torque_motor_nm"]


def text_only(text: str, letters: Mapping[str, str]) -> NoReturn:
    print(hashlib.sha256(text.encode()).hexdigest())
    raise SystemExit


if __name__ == "__main__":
    if "text" in sys.argv:
        native._functions = text_only
        sys.argv.remove("text")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    print(*(globals()[name]().hex() for name in sys.argv[1:]))
