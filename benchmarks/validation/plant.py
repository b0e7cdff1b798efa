"""Campaigns whose truth is the workbench's own plant with the library's effects, in the workbench's own loop.

The diagnosis knows these equations: what it misses here it misses with nothing wrong but noise and tolerances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.validation.content import Content
from benchmarks.validation.families import Family
from benchmarks.validation.hoist import HOIST
from benchmarks.validation.hoist_causes import IN_THE_LIBRARY
from benchmarks.validation.hoist_machines import Drawn
from benchmarks.validation.hoist_motion import COLUMNS, HEIGHT, RECORD_S, SPEED, TENSION, TORQUE, Truth
from benchmarks.validation.kind import Cause, Kind
from benchmarks.validation.multibody import USUAL
from benchmarks.validation.sources import Source
from workbench.control import PiSettings
from workbench.machines import Hoist, with_values
from workbench.simulate.loop import LoopCase, Outcome, simulate_loop

Array = npt.NDArray[np.float64]
# Of the unlisted causes those that its library has beyond the format's list, and those of sensors.
UNLISTED = (*IN_THE_LIBRARY, "gain_by_direction", "torque_walk", "dead_band", "torque_bend")
OF_A_MACHINE = {"carriage_mass_error": "dm_c", "payload_mass_error": "mp_scale"}  # which are numbers of the truth
GIVES_WAY_S_PER_M = 1.5  # atan's slope times the tanh's turning speed


def true_machine(drawn: Drawn, p: Truth, causes: Sequence[Cause]) -> Hoist:
    """The machine with the numbers of a `Truth`, and with the effects that act on it; sensors are the log's."""
    nominal = drawn.machine
    effects: dict[str, dict[str, float]] = {}
    for cause in causes:
        if cause.truth and cause.name not in OF_A_MACHINE:
            effects |= {name: dict(numbers) for name, numbers in cause.library.items()}
    if "heave" in effects:
        effects["heave"]["phase_rad"] = p.heave_ph
    values = {
        "motor.rotor_inertia_kg_m2": p.J_m / nominal.motor.count,
        "carriage.mass_kg": p.m_c,
        "bearing.pin_friction_coefficient": p.mu,
        "wire.youngs_modulus_pa": p.EA / nominal.wire.effective_area_m2,
        "wire.damping_time_s": p.wire_tau,
        "guide.coulomb_hoisting_n": p.F_up,
        "guide.coulomb_lowering_n": p.F_dn,
        "guide.atan_slope_s_per_m": GIVES_WAY_S_PER_M / p.turn_m_s,
        "drive.torque_lag_s": p.lag_tau,
    }
    if "gearbox_inertia" in effects:  # it stands in the effect, and not in the rotors
        values["motor.rotor_inertia_kg_m2"] -= effects["gearbox_inertia"]["inertia_kg_m2"] / nominal.motor.count
    machine = with_values(nominal, values)
    return machine.model_copy(update={"effects": effects}) if effects else machine


def moved(
    causes: Sequence[Cause], rng: np.random.Generator, drawn: Drawn, truth: Truth, family: Family, speed: Array,
    pulses: Array,
) -> Array:  # fmt: skip
    """What `Kind.move` is of the simulator: one run, (n, COLUMNS), a row each millisecond. RuntimeError where the
    simulation breaks off."""
    machine = true_machine(drawn, truth, causes)
    settings = PiSettings(kp_nm_s_per_rad=truth.kp, ki_nm_per_rad=truth.ki, sample_time_s=RECORD_S)
    case = LoopCase("run", machine, truth.m_p, truth.x_0, settings, speed, start_time_s=truth.start_time_s)
    (result,) = simulate_loop([case], record_every=1, threads=1)
    if result.outcome is not Outcome.COMPLETED:
        raise RuntimeError(f"{result.outcome.value} {result.at}")
    out = np.zeros((len(speed), COLUMNS))
    names = {TORQUE: "torque_motor_nm", SPEED: "speed_motor_rad_s", HEIGHT: "position_carriage_m"}
    for column, name in (names | {TENSION: "tension_dead_line_n"}).items():
        out[:, column] = result.run[name][: len(speed)]
    return out


PLANT: Kind = replace(HOIST, unlisted=UNLISTED, events=(), move=partial(moved, ()))


class PlantContent(Content):
    """A hoist's content, moved by the plant with its causes as effects."""

    @property
    def kind(self) -> Kind:
        move: Any = partial(moved, self.causes)
        return replace(PLANT, move=move)


SOURCE = Source("plant", USUAL, lambda family: PLANT, lambda content: PlantContent(**vars(content)))
