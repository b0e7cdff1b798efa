"""Where nobody says otherwise: a controller by rule, and the heights at which a loop is looked at.

On a rigid drive the PI speed loop has a closed form: the motors turn one inertia J (kg m²) with everything on it, and
the loop is of second order, J s² + kp s + ki. kp = J w with w = 2 pi times the bandwidth (the crossover of the
proportional part alone), ki = kp² / (4 J damping²). At damping 1 that is ki = kp w / 4.
"""

from __future__ import annotations

import math
from typing import cast

from workbench.control import SETTINGS, Cascade, PiSettings, Settings
from workbench.machines import Axis, Hoist, Machine, kind_of

USUAL_CROSSOVER_HZ = 2.5
USUAL_SAMPLE_S = 0.001


def shaft_inertia_kg_m2(machine: Hoist) -> float:
    """Rotors, drum and empty carriage as the motor shaft feels them on a stiff wire."""
    return kind_of(machine).looped.total_inertia(machine, 0.0)


def rigid_gains(inertia_kg_m2: float, bandwidth_hz: float, damping: float) -> tuple[float, float]:
    """kp (N m s/rad) and ki (N m/rad), to four digits."""
    kp = inertia_kg_m2 * 2.0 * math.pi * bandwidth_hz
    ki = kp * kp / (4.0 * inertia_kg_m2 * damping * damping)
    return float(f"{kp:.4g}"), float(f"{ki:.4g}")


def bandwidth_and_damping(inertia_kg_m2: float, kp: float, ki: float) -> tuple[float, float]:
    """What gains mean on that inertia: bandwidth (Hz) and damping, infinite without an integral."""
    bandwidth_hz = kp / (2.0 * math.pi * inertia_kg_m2)
    return bandwidth_hz, kp / (2.0 * math.sqrt(inertia_kg_m2 * ki)) if ki > 0.0 else math.inf


def usual_controller(machine: Hoist) -> PiSettings:
    """kp = J w, ki = kp w/4 with w = 2 pi 2.5 Hz and J of drive and empty carriage, seen from the motor."""
    J, w = shaft_inertia_kg_m2(machine), 2.0 * math.pi * USUAL_CROSSOVER_HZ
    kp = float(f"{J * w:.4g}")
    return PiSettings(kp_nm_s_per_rad=kp, ki_nm_per_rad=float(f"{kp * w / 4.0:.4g}"))


def usual_heights(machine: Machine) -> tuple[float, ...]:
    """Where a loop is looked at: of a hoist near bottom, middle and top of the rail."""
    return kind_of(machine).looped.places(machine)


def usual_cascade(machine: Axis) -> Cascade:
    """kp = M w, ki = kp w/4, kv = w/4 with w = 1/(4 T), T what lag, filter, delay and sampling cost together.

    The integral's time is four times that of the crossover and the position loop's, too: on a rigid axis the loops
    hardly feel one another (W. Leonhard, Control of Electrical Drives, 3rd ed., 2001, section 15.2). A load on a
    coupling halves w until every place is stable with |S| below 2.
    """
    from workbench.analysis.margins import family, operating_points, weakest

    make, drive, kind = SETTINGS[kind_of(machine).name], machine.drive, kind_of(machine)
    lost = drive.torque_lag_s + drive.speed_filter_s + drive.speed_delay_s + USUAL_SAMPLE_S
    w, inertia = 1.0 / (4.0 * lost), kind.looped.total_inertia(machine, 0.0)
    points = operating_points(machine, (0.0,), usual_heights(machine))
    for _ in range(8):
        kp = float(f"{inertia * w:.4g}")
        gains = dict(zip(make.GAINS, (kp, float(f"{kp * w / 4.0:.4g}")), strict=True))
        settings = make.model_validate(gains | {"kv_per_s": float(f"{w / 4.0:.3g}"), "sample_time_s": USUAL_SAMPLE_S})
        worst = weakest(family(machine, settings, points)).margins
        if worst.stable and worst.ms < 2.0:
            break
        w *= 0.5
    return cast(Cascade, settings)


def usual_settings(machine: Machine) -> tuple[Settings, str]:
    """The controller by rule for this kind of machine, and the rule in words."""
    if kind_of(machine).looped.position_loop:
        settings = usual_cascade(cast(Axis, machine))
        crossover = settings.kv_per_s * 4.0 / (2.0 * math.pi)
        rule = f"by rule: crossover about {crossover:.2g} Hz, the position loop a quarter of it"
        return cast(Settings, settings), rule
    return usual_controller(cast(Hoist, machine)), f"by rule: crossover about {USUAL_CROSSOVER_HZ:g} Hz"
