"""A hoist's log as its drive writes it, in each format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from tests.support.log_campaign import hoist_columns
from workbench.machines import default_hoist

RPM = 30.0 / np.pi


def drive_file(folder: Path, suffix: str) -> bytes:
    """As a drive writes it: own names, a speed without a unit that is in rpm, torques in per cent of nominal."""
    columns, nominal = hoist_columns(), default_hoist().motor.nominal_torque_nm
    time, file = columns["time_s"], folder / f"log{suffix}"
    signals = {"n_act": columns["speed_motor_rad_s"] * RPM}
    signals |= {f"torque motor {k}": 100.0 * columns[f"torque_motor{k}_nm"] / nominal for k in (1, 2)}
    if suffix == ".csv":
        lines = [",".join(f"{value:.6g}" for value in row) for row in np.column_stack([time, *signals.values()])]
        file.write_text("\n".join([",".join(["time [s]", *signals]), *lines]))
    elif suffix == ".mat":
        savemat(file, {"time_s": time} | {name.replace(" ", "_"): values for name, values in signals.items()})
    elif suffix == ".mf4":
        with MDF() as mdf:
            mdf.append([Signal(values, time, name=name) for name, values in signals.items()])
            mdf.save(file)
    else:
        with TdmsWriter(file) as writer:
            step = {"wf_increment": float(time[1] - time[0]), "wf_start_offset": float(time[0])}
            writer.write_segment([ChannelObject("drive", name, v, properties=step) for name, v in signals.items()])
    return file.read_bytes()
