"""A kind of machine is one file: one is added to a copy of the package, its laws hold, the commands take it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# A table on a motor with a flywheel: two inertias of one motion, of which the runs show the sum.
TABLE = '''
"""`kind: turntable`: a table on a motor, with a flywheel beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Literal

from workbench.core import record
from workbench.core.record import Record
from workbench.machines.declare import Value
from workbench.machines.kinds.axis import (
    Rotary, RotaryFriction, RotaryGravity, RotaryTolerances, axis_kind, axis_plant, axis_values,
)


class Flywheel(Record):
    inertia_kg_m2: record.Inertia


class Tolerances(RotaryTolerances):
    flywheel: record.Tolerance = 0.01


class Turntable(Rotary):
    kind: Literal["turntable"] = "turntable"
    inertia_kg_m2: record.Inertia
    flywheel: Flywheel
    friction: RotaryFriction
    gravity: RotaryGravity = RotaryGravity()
    tolerances: Tolerances = Tolerances()

    def role(self, name: str) -> float:
        return super().role(name) + (self.flywheel.inertia_kg_m2 if name == "inertia" else 0.0)


VALUES = (*axis_values(Turntable), Value("flywheel.inertia_kg_m2", "J_f", "flywheel"))


def inertia(p: Any) -> Any:
    return p.M + p.J_f


_OWN = axis_kind(Turntable, axis_plant("turntable", Turntable, VALUES, inertia), VALUES, {
    "inertia_kg_m2": 0.4, "flywheel": {"inertia_kg_m2": 0.2},
    "friction": {"coulomb_forward_nm": 1.5, "coulomb_backward_nm": 1.2, "viscous_nm_s_per_rad": 0.1},
})
KIND = replace(_OWN, closed_loop=replace(_OWN.looped, inertia=inertia))
'''
WORK = """
import sys
from pathlib import Path
from tests.machines.test_kind_laws import faults
from tests.support.driven_campaign import driven, planned, write
from workbench.cli import cli
from workbench.machines import KINDS, with_values

kind, out = KINDS["turntable"], Path(sys.argv[1])
print(faults(kind))
nominal = kind.example()
machine = with_values(nominal, {"inertia_kg_m2": 0.5})
runs = driven(machine, [planned(nominal, "slow", 2.0, 1.0), planned(nominal, "fast", 6.0, 6.0)], {"torque_nm": 0.01})
write(out / "campaign", nominal, runs)
for words in (["replay", "--out", "replayed"], ["identify", "--out", "identified"]):
    cli([words[0], str(out / "campaign"), words[1], str(out / words[2])], standalone_mode=False)
"""


@pytest.mark.skipif(os.name == "nt", reason="a checkout of its own")
def test_a_kind_is_one_file_and_no_other_edit(tmp_path: Path):
    shutil.copytree(ROOT / "workbench", tmp_path / "workbench", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "tests" / "support", tmp_path / "tests" / "support")
    (tmp_path / "tests" / "machines").mkdir()
    shutil.copy(ROOT / "tests" / "machines" / "test_kind_laws.py", tmp_path / "tests" / "machines")
    (tmp_path / "workbench" / "machines" / "kinds" / "turntable.py").write_text(TABLE, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", WORK, str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "[]"  # every value has a prior and a place
    found = json.loads((tmp_path / "identified" / "identify.json").read_text())
    assert found["parameters"]["inertia_kg_m2"]["value"] == pytest.approx(0.5, rel=0.01)
