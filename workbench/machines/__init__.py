"""The machine: records of machine.yaml, their files, their physics by kind, the machines that ship."""

from typing import Any, TypeAlias

from workbench.machines.declare import TIME, ClosedLoop, Kind, Limits, Load, RigidBody, Sizes, Table
from workbench.machines.kinds import (
    HOIST,
    KINDS,
    LINEAR,
    LOOPED,
    PLACES,
    PLANTS,
    ROTARY,
    STUDIED,
    AnyMachine,
    Axis,
    Hoist,
    Machine,
    kind_of,
    load_of,
    looped,
    of_kind,
    plant_of,
    studied,
)
from workbench.machines.kinds.axis import LinearAxis, RotaryAxis
from workbench.machines.kinds.hoist import DRIVES, Drive
from workbench.machines.kinds.two_inertia import TwoInertia
from workbench.machines.plant import NO_EFFECTS, Effects, Memory, Plant

from workbench.machines.files import (  # isort: skip, it reads the kinds
    RECORDS,
    SHIPPED,
    default_hoist,
    get_value,
    load_machine,
    machine_from,
    machine_text,
    save_machine,
    shipped,
    shipped_hoist,
    value_names,
    with_correction,
    with_values,
)

# A machine of any kind, where what is a kind's own is asked of its record or by that kind's code alone.
AnyKind: TypeAlias = Any
