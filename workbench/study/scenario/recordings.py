"""A campaign's run as a reference of a study."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.kinds import STUDIED, of_kind, studied
from workbench.logs import read_campaign
from workbench.study.scenario.layers import Layered
from workbench.study.scenario.record import RecordedBlock
from workbench.study.variations.run_spec import Recording
from workbench.yaml_strict import Place


def read_recording(block: RecordedBlock, folder: Path, layers: Layered, place: Place) -> Recording:
    """The run that a reference names. Its motor speed becomes the carriage's by its own machine's drum and gearbox.

    folder: of the file that names it. place: of the campaign there, for errors. InputError where the campaign
    cannot be read or is of no hoist.
    """
    path = folder / block.campaign
    if "\0" in block.campaign or not os.path.exists(path):
        raise layers.error(f"no campaign {str(path)!r}; expected a folder, seen from this file", place)
    try:
        campaign = read_campaign(path, select=[block.run])
    except InputError as error:
        if error.file is not None:
            raise
        raise layers.error(str(error), place) from error
    machine = studied(campaign.machine)
    if machine is None:
        raise layers.error(f"{path} holds runs of {of_kind(campaign.machine)}; a study expects {STUDIED}", place)
    run = campaign.runs[0]
    signal = "speed_reference_rad_s" if "speed_reference_rad_s" in run else "speed_motor_rad_s"
    speed = run[signal] * machine.lift_m_per_rad
    if len(run.time_s) < 2 or not np.all(np.isfinite(speed)):
        raise layers.error(f"run '{block.run}' has gaps in {signal}; choose another run", place)
    # Its number is kept short by what it is: two references that differ in any sample differ here.
    digest = hashlib.sha256(run.time_s.tobytes() + speed.tobytes()).hexdigest()[:16]
    return Recording(block.label, run.time_s, speed, run.start_position_m, block.smoothing_s or 0.0, digest)
