"""What keeps a loop from a wider bandwidth: an anti-resonance of the plant, or phase lost to drive and sampling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.analysis.point import LinearPlant, OperatingPoint
from workbench.control import Settings
from workbench.kinds import HOIST, ClosedLoop
from workbench.run import Array

LIGHT = 0.5  # damping ratio below which a zero makes a dip of the response


@dataclass(frozen=True)
class AntiResonance:
    """A lightly damped zero from motor torque to motor speed: the load swings, the motor stands.

    what, where: in words.
    """

    frequency_hz: float
    damping: float
    point: OperatingPoint
    what: str = HOIST.looped.swing
    where: str = ""


def anti_resonances(plant: LinearPlant, point: OperatingPoint, loop: ClosedLoop = HOIST.looped) -> list[AntiResonance]:
    """The zeros s of [A - sI, B; C, 0] for the motor's speed with damping below LIGHT, the slowest first."""
    from scipy.linalg import eigvals

    n = len(plant.A)
    system = np.block([[plant.A, plant.B], [plant.C[[0]], np.zeros((1, 1))]])
    mass = np.diag([*np.ones(n), 0.0])
    zeros = eigvals(system, mass)
    light = [z for z in zeros[np.isfinite(zeros)] if z.imag > 1e-6 and -z.real < LIGHT * abs(z)]
    return [
        AntiResonance(
            float(abs(z)) / (2.0 * math.pi),
            float(-z.real / abs(z)),
            point,
            loop.swing,
            loop.where(point.payload_kg, point.height_m),
        )
        for z in sorted(light, key=abs)
    ]


def phase_lags_deg(drive: Any, settings: Settings, frequency_hz: float) -> dict[str, float]:
    """What each part between controller and measured speed costs at a frequency, the largest first, degrees."""
    w, dt = 2.0 * math.pi * frequency_hz, settings.sample_time_s
    low_pass = 0.0 if settings.low_pass_hz is None else math.atan(frequency_hz / settings.low_pass_hz)
    lags = {
        "the torque lag": math.atan(w * drive.torque_lag_s),
        "the speed filter": math.atan(w * drive.speed_filter_s),
        "the speed delay": w * drive.speed_delay_s,
        "the controller's low-pass": low_pass,
        "sampling": 0.5 * w * dt * (2.0 if drive.encoder_counts_per_turn else 1.0),  # held, and counted
    }
    return {name: math.degrees(lag) for name, lag in sorted(lags.items(), key=lambda item: -item[1]) if lag > 0.0}


def rounded_down(value: float) -> str:
    """Three digits, rounded down: what is named as attainable can be asked for."""
    digits = 2 - math.floor(math.log10(value))
    return f"{math.floor(value * 10.0**digits) / 10.0**digits:g}"


def why(
    zeros: Sequence[AntiResonance], lags_deg: dict[str, float], frequency_hz: Array, T: Array, crossing_hz: float
) -> str:
    """One sentence: the dip of |T|, (n,) of the slowest member, in which its bandwidth ends, or the phase that is lost.

    zeros: the slowest member's anti-resonances; lags_deg: at crossing_hz, the widest bandwidth.
    """
    lost = ", ".join(f"{name} {lag:.0f}°" for name, lag in lags_deg.items() if lag >= 0.5)
    phase = f"at {rounded_down(crossing_hz)} Hz phase is lost to {lost}" if lost else "sampling leaves no more"
    beyond = frequency_hz > crossing_hz
    comes_back = frequency_hz[beyond & (math.sqrt(0.5) < T)]
    if len(comes_back):
        inside = [zero for zero in zeros if crossing_hz < 1.05 * zero.frequency_hz < 1.1 * comes_back[0]]
        if inside:
            zero = inside[0]
            return (
                f"the anti-resonance at {zero.frequency_hz:.3g} Hz (damping ratio {zero.damping:.2g}, "
                f"{zero.where}: {zero.what}) takes the response below -3 dB there, and {phase}, "
                "so that no gain fills the dip within Ms"
            )
    return phase
