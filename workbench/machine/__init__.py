"""The machine: frozen records of machine.yaml, how to read and write them, the machine that ships."""

from typing import Any, TypeAlias

from workbench.kinds.axis import Axis, LinearAxis, LinearCorrection, RotaryAxis, RotaryCorrection
from workbench.kinds.correction import MeasuredCorrection
from workbench.kinds.hoist import DRIVES, Drive, Hoist, HoistCorrection
from workbench.kinds.two_inertia import TwoInertia
from workbench.machine.files import (
    RECORDS,
    SHIPPED,
    default_hoist,
    load_machine,
    machine_from,
    machine_text,
    save_machine,
    shipped,
    shipped_hoist,
)
from workbench.machine.values import get_value, value_names, with_correction, with_values

Machine = Hoist | Axis
# A machine of any kind, where what is a kind's own is asked of its record or by that kind's code alone.
AnyKind: TypeAlias = Any
