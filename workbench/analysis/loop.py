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
from workbench.control import Settings
from workbench.kinds import HOIST, Kind, kind_of
from workbench.machine import Axis, Hoist
from workbench.plants import NO_EFFECTS, Effects
from workbench.run import Array

LOWEST_HZ = 1e-3
INPUTS = ["speed_reference", "load_torque", "speed_noise"]  # of a hoist
SHOWN = [*OUTPUTS, "torque_wanted"]


@dataclass(frozen=True)
class Responses:
    """The loop over frequency, (n,) each. The gang of four is S, T, PS, CS.

    L: loop, opened at the drive's torque; S: sensitivity 1/(1+L); T: L/(1+L); PS: load torque to motor speed; CS: speed
    noise to torque wanted; R: reference's speed to motor speed, set-point weight and feed-forward included. A cascade's
    position reference goes with it, the speed summed up. L and T are of the measured speed, of a cascade with its
    position.
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
    """One loop: plant (wanted and load torque to the outputs and what is measured) and controller (references and
    what is measured to wanted torque).

    outputs: the plant's, speed at the encoder first. references: the controller's, the speed last. measured: speed, and
    a cascade's position.
    """

    point: OperatingPoint
    plant: Sampled
    controller: Sampled
    outputs: tuple[str, ...] = OUTPUTS
    references: tuple[str, ...] = ("speed_reference",)
    measured: int = 1
    kind: Kind = HOIST

    @property
    def inputs(self) -> list[str]:
        """The closed loop's: references, torque on the shaft, noise of the measured speed."""
        return [*self.references, *INPUTS[1:]]

    @property
    def shown(self) -> list[str]:
        """The closed loop's outputs."""
        return [*self.outputs, SHOWN[-1]]

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def nyquist_hz(self) -> float:
        return 0.5 / self.dt

    def open_response(self, frequency_hz: Array) -> Complex:
        """L at frequencies (n,): around the loop once, the minus sign of the feedback left out."""
        return self._around(self.plant.response(frequency_hz), self.controller.response(frequency_hz))

    def _around(self, P: Complex, K: Complex) -> Complex:
        loop: Complex = -np.sum(P[:, -self.measured :, 0] * K[:, 0, len(self.references) :], axis=1)
        return loop

    def responses(self, frequency_hz: Array) -> Responses:
        P = self.plant.response(frequency_hz)
        K = self.controller.response(frequency_hz)
        L = self._around(P, K)
        S = 1.0 / (1.0 + L)
        n = len(self.references)
        asked = K[:, 0, n - 1]
        if n > 1:  # the position reference is the speed's, summed up by the trapezoidal rule
            z = np.exp(2j * math.pi * np.asarray(frequency_hz) * self.dt)
            asked = asked + K[:, 0, 0] * 0.5 * self.dt * (z + 1.0) / (z - 1.0)
        R = P[:, 0, 0] * asked * S
        return Responses(np.asarray(frequency_hz), L, S, L * S, P[:, 0, 1] * S, -K[:, 0, n] * S, R)

    @cached_property
    def closed(self) -> Sampled:
        """Inputs as `inputs`, outputs as `shown`."""
        P, K, m, n = self.plant, self.controller, self.measured, len(self.references)
        shown, w = P.C[:-m], P.C[-m:]
        u, load = P.B[:, [0]], P.B[:, [1]]
        Kr, Kw, Br, Bw = K.D[:, :n], K.D[:, n:], K.B[:, :n], K.B[:, n:]
        noise = np.eye(m)[:, [0]]
        A = np.block([[P.A + u @ Kw @ w, u @ K.C], [Bw @ w, K.A]])
        B = np.block([[u @ Kr, load, u @ Kw @ noise], [Br, np.zeros((len(K.A), 1)), Bw @ noise]])
        C = np.block([[shown, np.zeros((len(shown), len(K.A)))], [Kw @ w, K.C]])
        D = np.vstack([np.zeros((len(shown), n + 2)), np.hstack([Kr, np.zeros((1, 1)), Kw @ noise])])
        return Sampled(A, B, C, D, self.dt)

    def systems(self) -> tuple[Any, Any, Any]:
        """(L, S, closed loop) as `control.StateSpace`; L from speed error to motor speed, of a cascade from torque to
        torque."""
        import control

        m, n = self.measured, len(self.references)
        plant = control.ss(self.plant.A, self.plant.B[:, [0]], self.plant.C[-m:], np.zeros((m, 1)), self.dt)
        K = self.controller
        feedback = control.ss(K.A, -K.B[:, n:], K.C, -K.D[:, n:], self.dt)
        L = plant * feedback if m == 1 else feedback * plant
        return L, control.feedback(1, L), self.closed.system(self.inputs, self.shown)

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
    machine: Hoist | Axis,
    settings: Settings,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    height_free: bool = False,
) -> LinearLoop:
    """The loop of a machine (drive and effects included) under a controller, at an operating point.

    Effects on sensors act on the log alone, as in the compiled loop: they are not in it.
    """
    kind = kind_of(machine)
    cascade = kind.looped.position_loop
    placed = height_free or (cascade and settings.kv_per_s > 0.0)
    plant = linearise(machine, point, effects=effects, effect_values=effect_values, height_free=placed)
    return LinearLoop(
        point,
        sampled_plant(plant, settings.sample_time_s, machine.drive, kind.looped.position if cascade else ""),
        linear_controller(settings, machine, point.payload_kg, at=point.height_m if cascade else 0.0),
        plant.outputs,
        ("position_reference", "speed_reference") if cascade else ("speed_reference",),
        2 if cascade else 1,
        kind,
    )
