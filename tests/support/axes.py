"""Axes for the tests of their closed loop: the shipped one, a frictionless one behind an ideal drive, and motions."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from workbench.control import LinearCascade
from workbench.core.yaml_strict import loads
from workbench.machines import Axis, LinearAxis, TwoInertia, kind_of, machine_from, shipped, with_values
from workbench.machines.kinds.axis import LINEAR_DRIVES
from workbench.references import Limits, Plan, Step, plan_motion
from workbench.simulate.loop import LoopCase, LoopResult, simulate_loop

CASCADE = LinearCascade(kp_n_s_per_m=6660.0, ki_n_per_m=116500.0, kv_per_s=17.5)
LIMITS = Limits(0.25, 2.0, 40.0)


def emps() -> LinearAxis:
    return cast(LinearAxis, shipped("emps_axis"))


def ideal_axis(**values: float) -> LinearAxis:
    """One mass behind an ideal drive without a limit: no friction, no load, unless values say otherwise."""
    still = {
        "friction.coulomb_forward_n": 0.0,
        "friction.coulomb_backward_n": 0.0,
        "friction.viscous_n_s_per_m": 0.0,
        "gravity.constant_n": 0.0,
    }
    given = {name.replace("__", "."): value for name, value in values.items()}
    axis = with_values(emps(), still | given)
    return axis.model_copy(update={"drive": LINEAR_DRIVES["ideal"]})


def two_inertia(**values: float) -> TwoInertia:
    text = (
        "kind: two_inertia\nmotor:\n  inertia_kg_m2: 0.002\n  friction: {coulomb_forward_nm: 0.02, "
        "coulomb_backward_nm: 0.02, viscous_nm_s_per_rad: 0.001}\ncoupling: {stiffness_nm_per_rad: 20.0, "
        "damping_nm_s_per_rad: 0.004}\nload: {inertia_kg_m2: 0.003}\n"
        "drive: {torque_limit_nm: 3.0, nominal_torque_nm: 1.0, top_speed_rad_s: 20.0}\n"
    )
    machine = cast(TwoInertia, machine_from(loads(text, "axis.yaml")))
    return with_values(machine, {name.replace("__", "."): value for name, value in values.items()})


def there_and_back(kind: str = "ruckig", by: float = 0.2, limits: Limits = LIMITS, settle_s: float = 0.8) -> Plan:
    steps = [Step(by_m=by), Step(dwell_s=0.5), Step(by_m=-by)]
    return plan_motion(kind, steps, 0.0, limits, (-np.inf, np.inf), 0.2, settle_s)


def followed(machine: Axis, settings: Any, plan: Plan, record_every: int = 1, step_s: float = 0.001) -> LoopResult:
    """The machine under a cascade along a plan."""
    profile = plan.sample(settings.sample_time_s)
    assert kind_of(machine).looped.position_loop
    case = LoopCase("run", machine, 0.0, 0.0, settings, profile.speed_m_s, position_reference=profile.position_m)
    (result,) = simulate_loop([case], record_every=record_every, step_s=step_s)
    return result
