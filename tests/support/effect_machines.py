"""One machine of each kind of plant, for tests of effects."""

from __future__ import annotations

from workbench.machine import Axis, Hoist, default_hoist, machine_from
from workbench.yaml_strict import loads


def linear_axis(**values: float) -> Axis:
    numbers = {"mass": 95.0, "forward": 20.0, "backward": 18.0, "viscous": 200.0, "constant": 3.0} | values
    text = (
        f"kind: axis\nmotion: linear\nmass_kg: {numbers['mass']}\ngravity: {{constant_n: {numbers['constant']}}}\n"
        f"friction: {{coulomb_forward_n: {numbers['forward']}, coulomb_backward_n: {numbers['backward']}, "
        f"viscous_n_s_per_m: {numbers['viscous']}}}\n"
    )
    machine = machine_from(loads(text, "axis.yaml"))
    assert isinstance(machine, Axis)
    return machine


def rotary_axis() -> Axis:
    text = (
        "kind: axis\nmotion: rotary\ninertia_kg_m2: 0.4\ngravity: {sine_nm: 6.0, constant_nm: 0.5}\n"
        "friction: {coulomb_forward_nm: 1.5, coulomb_backward_nm: 1.2, viscous_nm_s_per_rad: 0.1}\n"
    )
    machine = machine_from(loads(text, "axis.yaml"))
    assert isinstance(machine, Axis)
    return machine


def two_inertia() -> Axis:
    text = (
        "kind: two_inertia\nmotor: {inertia_kg_m2: 0.02, friction: {coulomb_forward_nm: 0.6, coulomb_backward_nm: 0.5, "
        "viscous_nm_s_per_rad: 0.02}}\ncoupling: {stiffness_nm_per_rad: 900.0, damping_nm_s_per_rad: 1.5}\n"
        "load: {inertia_kg_m2: 0.05, friction: {coulomb_forward_nm: 0.8, coulomb_backward_nm: 0.8, "
        "viscous_nm_s_per_rad: 0.05}, gravity: {sine_nm: 0.0, constant_nm: 0.3}}\n"
    )
    machine = machine_from(loads(text, "machine.yaml"))
    assert isinstance(machine, Axis)
    return machine


MACHINES: dict[str, Hoist | Axis] = {
    "hoist": default_hoist(), "axis-linear": linear_axis(), "axis-rotary": rotary_axis(), "two_inertia": two_inertia()
}  # fmt: skip
