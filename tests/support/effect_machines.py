"""One machine of each kind of plant, for tests of effects."""

from __future__ import annotations

from typing import cast

from workbench.core.yaml_strict import loads
from workbench.machines import KINDS, ROTARY, Axis, Hoist, LinearAxis, machine_from


def linear_axis(**values: float) -> LinearAxis:
    numbers = {"mass": 95.0, "forward": 20.0, "backward": 18.0, "viscous": 200.0, "constant": 3.0} | values
    text = (
        f"kind: axis\nmotion: linear\nmass_kg: {numbers['mass']}\ngravity: {{constant_n: {numbers['constant']}}}\n"
        f"friction: {{coulomb_forward_n: {numbers['forward']}, coulomb_backward_n: {numbers['backward']}, "
        f"viscous_n_s_per_m: {numbers['viscous']}}}\n"
    )
    machine = machine_from(loads(text, "axis.yaml"))
    assert isinstance(machine, LinearAxis)
    return machine


def rotary_axis() -> Axis:
    return cast(Axis, ROTARY.example())


MACHINES: dict[str, Hoist | Axis] = {name: kind.example() for name, kind in KINDS.items()}
