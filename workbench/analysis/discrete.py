"""Sampled linear systems: their records, their frequency response, and the plant as the loop samples it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.analysis.point import LinearPlant
from workbench.control import delay_weights
from workbench.run import Array

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Sampled:
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] at every `dt` seconds."""

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float

    def response(self, frequency_hz: Array) -> Complex:
        """(frequencies, outputs, inputs), complex: C (zI - A)^-1 B + D at z = exp(2 pi i f dt)."""
        z = np.exp(2j * math.pi * np.atleast_1d(frequency_hz).astype(np.complex128) * self.dt)
        n = len(self.A)
        if n == 0:
            return np.broadcast_to(self.D.astype(complex), (len(z), *self.D.shape))
        inner: Complex = (z[:, None, None] * np.eye(n) - self.A).astype(np.complex128)
        right: Complex = np.broadcast_to(self.B.astype(complex), (len(z), *self.B.shape))
        out: Complex = (self.C @ np.linalg.solve(inner, right) + self.D).astype(np.complex128)
        return out

    def poles(self) -> Complex:
        eigenvalues: Complex = np.linalg.eigvals(self.A).astype(np.complex128)
        return eigenvalues

    def run(self, inputs: Array) -> Array:
        """Outputs (n, outputs) from rest under inputs (n, inputs)."""
        x = np.zeros(len(self.A))
        out = np.empty((len(inputs), len(self.C)))
        for k, u in enumerate(inputs):
            out[k] = self.C @ x + self.D @ u
            x = self.A @ x + self.B @ u
        return out

    def system(self, inputs: list[str], outputs: list[str]) -> Any:
        """As a `control.StateSpace` with its sample time."""
        import control

        return control.ss(self.A, self.B, self.C, self.D, self.dt, inputs=inputs, outputs=outputs)


@dataclass(frozen=True, eq=False)
class Late(Sampled):
    """A system whose last output comes back `late` samples later as its last input, linear between two samples.

    step: the system without the delay; what it gives back does not pass straight through it. As a Sampled it has a
    state for each sample of the delay; over frequency the delay is a factor, at any length in the same time.
    """

    step: Sampled
    late: float

    @classmethod
    def of(cls, step: Sampled, late: float) -> Late:
        whole, near, far = delay_weights(late)
        m, n, inputs = len(step.A), math.ceil(late), step.B.shape[1] - 1
        sensed = np.zeros((n + 1, m + n + inputs))  # what was sensed j samples ago, by state and input
        sensed[0, :m], sensed[0, m + n :] = step.C[-1], step.D[-1, :-1]
        sensed[1:, m : m + n] = np.eye(n)
        late_input = near * sensed[whole] + (far * sensed[whole + 1] if far else 0.0)
        own = np.zeros((m + len(step.C) - 1, m + n + inputs))
        own[:m, :m], own[:m, m + n :] = step.A, step.B[:, :-1]
        own[m:, :m], own[m:, m + n :] = step.C[:-1], step.D[:-1, :-1]
        own += np.outer(np.concatenate([step.B[:, -1], step.D[:-1, -1]]), late_input)
        after = np.vstack([own[:m], sensed[:n]])
        return cls(after[:, : m + n], after[:, m + n :], own[m:, : m + n], own[m:, m + n :], step.dt, step, late)

    def response(self, frequency_hz: Array) -> Complex:
        whole, near, far = delay_weights(self.late)
        back = np.exp(-2j * math.pi * np.atleast_1d(frequency_hz) * self.dt)
        factor = (near + far * back) * back**whole
        G = self.step.response(frequency_hz)
        out: Complex = G[:, :-1, :-1] + G[:, :-1, -1:] * G[:, -1:, :-1] * factor[:, None, None]
        return out


def sampled_plant(plant: LinearPlant, dt: float, drive: Any, position: str = "") -> Sampled:
    """Inputs: torque wanted of the drive (held), and a torque on the shaft beside it (held). Outputs: the plant's, then
    the speed as the drive measures it: the motor's own or, counted by an encoder, its mean since the last sample; then
    the output named `position` once more, where the loop measures that, too.

    Exact, through the matrix exponential: behind a lag the torque at work is a state of the plant, lag du/dt = wanted
    - u. The compiled loop takes the same lag with the same impulse and first moment in each of its steps.
    """
    from scipy.linalg import expm

    n, lag = len(plant.A), drive.torque_lag_s
    if lag == 0.0:
        A, B, C = plant.A, np.hstack([plant.B, plant.B]), plant.C
    else:
        A = np.block([[plant.A, plant.B], [np.zeros((1, n)), np.full((1, 1), -1.0 / lag)]])
        B = np.block([[np.zeros((n, 1)), plant.B], [np.array([[1.0 / lag, 0.0]])]])
        C = np.hstack([plant.C, np.zeros((len(plant.C), 1))])
        n += 1
    speed = C[[0]]
    placed = C[[plant.outputs.index(position)]] if position else C[:0]
    if drive.encoder_counts_per_turn:  # one more state: the way since the last sample, over the sample time
        A, B = np.block([[A, np.zeros((n, 1))], [speed / dt, np.zeros((1, 1))]]), np.vstack([B, np.zeros((1, 2))])
        C, placed = (np.hstack([rows, np.zeros((len(rows), 1))]) for rows in (C, placed))
        speed = np.eye(n + 1)[[n]]
        n += 1
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n:] = A * dt, B * dt
    whole = expm(whole)
    if drive.encoder_counts_per_turn:
        whole[n - 1, n - 1] = 0.0  # each sample counts anew
    C = np.vstack([C, speed, placed])
    return Sampled(whole[:n, :n], whole[:n, n:], C, np.zeros((len(C), 2)), dt)
