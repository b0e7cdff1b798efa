"""The sampled speed loop, small deviations only: the compiled loop's plant, drive, delays and controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.analysis.controller import linear_controller
from workbench.analysis.discrete import Complex, Sampled, sampled_plant
from workbench.analysis.linearise import OUTPUTS, OperatingPoint, linearise
from workbench.control import PiSettings
from workbench.machine import Hoist
from workbench.plants import NO_EFFECTS, Effects
from workbench.run import Array

LOWEST_HZ = 1e-3
INPUTS = ["speed_reference", "load_torque", "speed_noise"]
SHOWN = [*OUTPUTS, "torque_wanted"]


@dataclass(frozen=True)
class Responses:
    """The loop over frequency, (n,) each. The gang of four is S, T, PS, CS.

    L: loop; S: sensitivity 1/(1+L); T: L/(1+L); PS: load torque to motor speed; CS: speed noise to
    torque wanted; R: reference to motor speed, set-point weight and feed-forward included. L and T are of the measured
    speed.
    """

    frequency_hz: Array
    L: Complex
    S: Complex
    T: Complex
    PS: Complex
    CS: Complex
    R: Complex


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """One loop: plant (wanted and load torque to OUTPUTS and the measured speed) and controller (reference and
    measured speed to wanted torque)."""

    point: OperatingPoint
    plant: Sampled
    controller: Sampled

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def nyquist_hz(self) -> float:
        return 0.5 / self.dt

    def open_response(self, frequency_hz: Array) -> Complex:
        """L at frequencies (n,): around the loop once, the minus sign of the feedback left out."""
        P = self.plant.response(frequency_hz)[:, -1, 0]
        return -P * self.controller.response(frequency_hz)[:, 0, 1]

    def responses(self, frequency_hz: Array) -> Responses:
        P = self.plant.response(frequency_hz)
        K = self.controller.response(frequency_hz)
        L = -P[:, -1, 0] * K[:, 0, 1]
        S = 1.0 / (1.0 + L)
        R = P[:, 0, 0] * K[:, 0, 0] * S
        return Responses(np.asarray(frequency_hz), L, S, L * S, P[:, 0, 1] * S, -K[:, 0, 1] * S, R)

    @cached_property
    def closed(self) -> Sampled:
        """Inputs as INPUTS, outputs as SHOWN."""
        P, K = self.plant, self.controller
        shown, w = P.C[:-1], P.C[[-1]]
        u, load = P.B[:, [0]], P.B[:, [1]]
        Kr, Kw, Br, Bw = K.D[:, [0]], K.D[:, [1]], K.B[:, [0]], K.B[:, [1]]
        A = np.block([[P.A + u @ Kw @ w, u @ K.C], [Bw @ w, K.A]])
        B = np.block([[u @ Kr, load, u @ Kw], [Br, np.zeros_like(Br), Bw]])
        C = np.block([[shown, np.zeros((len(shown), len(K.A)))], [Kw @ w, K.C]])
        D = np.vstack([np.zeros((len(shown), 3)), np.hstack([Kr, np.zeros((1, 1)), Kw])])
        return Sampled(A, B, C, D, self.dt)

    def systems(self) -> tuple[Any, Any, Any]:
        """(L, S, closed loop) as `control.StateSpace`; L from speed error to motor speed."""
        import control

        plant = control.ss(self.plant.A, self.plant.B[:, [0]], self.plant.C[[-1]], 0.0, self.dt)
        K = self.controller
        feedback = control.ss(K.A, -K.B[:, [1]], K.C, -K.D[:, [1]], self.dt)
        L = plant * feedback
        return L, control.feedback(1, L), self.closed.system(INPUTS, SHOWN)

    def poles(self) -> Complex:
        """Of the closed loop, in z."""
        return self.closed.poles()

    @property
    def stable(self) -> bool:
        return bool(np.max(np.abs(self.poles())) < 1.0)

    def grid(self) -> Array:
        """Frequencies that miss no peak: even in log, dense around each pole of plant and loop; half the rate last."""
        even = np.geomspace(LOWEST_HZ, self.nyquist_hz, 500)
        parts = [even, np.linspace(0.2, 1.0, 120) * self.nyquist_hz]
        for z in np.concatenate([self.plant.poles(), self.poles()]):
            if abs(z) > 1e-3 and abs(z.imag) > 0.0:
                s = np.log(z) / (2.0 * math.pi * self.dt)  # in Hz
                parts.append(abs(s.imag) + max(abs(s.real), 1e-4 * abs(s.imag)) * np.linspace(-6.0, 6.0, 25))
        f = np.unique(np.concatenate(parts))
        return f[(f >= LOWEST_HZ) & (f <= self.nyquist_hz)]


def linear_loop(
    machine: Hoist,
    settings: PiSettings,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    height_free: bool = False,
) -> LinearLoop:
    """The loop of a machine (drive and effects included) under a controller, at an operating point.

    Effects on sensors act on the log alone, as in the compiled loop: they are not in it.
    """
    plant = linearise(machine, point, effects=effects, effect_values=effect_values, height_free=height_free)
    dt = settings.sample_time_s
    return LinearLoop(
        point,
        sampled_plant(plant, dt, machine.drive),
        linear_controller(settings, machine, point.payload_kg),
    )
