"""The sampled loop, small deviations only: compiled plant, drive, delays and controller; its step responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.analysis.linearise import OUTPUTS, LinearPlant, OperatingPoint, linearise
from workbench.control import Controller, Settings, cascade, delay_weights, full_pi, loop_values
from workbench.control.pi import cascade_values
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import NO_EFFECTS, Effects, Kind, Machine, kind_of
from workbench.symbolic.derive import jacobian
from workbench.symbolic.expr import symbol

Complex = npt.NDArray[np.complex128]
Gains = tuple[float, float]  # kp, ki


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
        try:
            state = np.linalg.solve(inner, right)
        except np.linalg.LinAlgError:  # on a pole, as that of an undamped swing: from just outside the circle
            state = np.linalg.solve(inner + 1e-12 * z[:, None, None] * np.eye(n), right)
        out: Complex = (self.C @ state + self.D).astype(np.complex128)
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


def sampled_plant(plant: LinearPlant, dt: float, drive: Any, beside: Sequence[str] = ()) -> Sampled:
    """Inputs: torque wanted of the drive (held), and a torque on the shaft beside it (held). Outputs: the plant's, then
    the speed as the drive measures it: the motor's own or, counted by an encoder, its mean since the last sample; then
    once more those outputs that the loop measures beside it.

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
    placed = C[[plant.outputs.index(name) for name in beside]]
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


FAR = 1e30
MOST_LATE = 200  # samples, each a state: the poles of many more take tens of seconds


def controller_of(settings: Settings, machine: Machine) -> Controller:
    """The loop with everything, as it is analysed: the references are given, also that of a hoist's position."""
    loop = kind_of(machine).looped
    if loop.position_loop:
        return cascade(loop, True)
    wire, position, damping = settings.parts
    return full_pi(True, wire, position and "given", damping)


def linear_controller(
    settings: Settings, machine: Machine, payload_kg: float = 0.0, *, gains: Gains | None = None, at: float = 0.0
) -> Sampled:
    """Inputs: the controller's references, then what it measures; output: torque or force wanted of the drive.
    at: an axis' position, for the load's feed-forward.

    Speed filter and delay of the drive are in it, for they are in the step. Limits and rate limit are away from it;
    that the encoder counts over a sample is in the plant, its resolution is not. gains: (kp, ki) in place of the
    settings' own; zero is allowed. InputError for a delay of too many samples.
    """
    dt, drive = settings.sample_time_s, machine.drive
    if not drive.speed_delay_s <= MOST_LATE * dt:
        raise InputError(
            f"{drive.speed_delay_s:g} s are {drive.speed_delay_s / dt:.0f} samples of the controller; the design of "
            f"a loop takes at most {MOST_LATE}", place="drive.speed_delay_s",
        )  # fmt: skip
    kind, controller = kind_of(machine), controller_of(settings, machine)
    references, measured = controller.references, controller.measured
    assert controller.sensed is not None
    if kind.looped.position_loop:
        numbers = cascade_values(settings, drive, at)
    else:
        numbers = loop_values(settings, drive, 0.0, payload_kg)
    numbers |= dict.fromkeys(("rate", "u_limit", "u_all", "u_one", "t_fail", "w_weak"), FAR)
    numbers |= {"counts": 0.0, "track": 0.0} | ({} if gains is None else {"kp": gains[0], "ki": gains[1]})
    p = SimpleNamespace(**{**vars(kind.plant.values(machine, payload_kg)), **numbers})
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    asked, seen = ([symbol(f"{what}{i}") for i in range(len(of))] for what, of in (("r", references), ("w", measured)))
    late = symbol("late")
    reference = SimpleNamespace(**dict(zip(references, asked, strict=True)))
    signals = SimpleNamespace(**{kind.looped.position: 0.0, "t": 0.0, "late": late})
    vars(signals).update(zip(measured, seen, strict=True))
    torque, after = controller.step(p, memory, reference, signals, dt)
    sensed = controller.sensed(p, memory, signals, dt)
    by = [*memory, *asked, *seen, late]
    placed = {kind.looped.position: at, references[0]: at} if kind.looped.position_loop else {}
    values = [*np.zeros(len(memory)), *(placed.get(name, 0.0) for name in (*references, *measured)), 0.0]
    J = jacobian([*after, torque, sensed], by, np.array(values))
    n = len(memory)
    kept = _in_use(J, n)
    step = Sampled(J[np.ix_(kept, kept)], J[kept][:, n:], J[n:][:, kept], J[n:][:, n:], dt)
    return Late.of(step, p.late)


def _in_use(J: Array, n: int) -> list[int]:
    """Memory that something moves and that moves something; what is switched off drops out."""
    kept = list(range(n))
    outputs, inputs = range(n, J.shape[0]), range(n, J.shape[1])
    while True:
        rows = [*kept, *outputs]
        used = [
            i for i in kept
            if np.any(J[[j for j in rows if j != i], i]) and np.any(J[i, [j for j in (*kept, *inputs) if j != i]])
        ]  # fmt: skip
        if used == kept:
            return kept
        kept = used


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

    outputs: the plant's, speed at the encoder first. references: the controller's, the speed last. measured: what it is
    given, the speed first.
    """

    point: OperatingPoint
    plant: Sampled
    controller: Sampled
    outputs: tuple[str, ...]
    references: tuple[str, ...]
    measured: tuple[str, ...]
    kind: Kind

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
        loop: Complex = -np.sum(P[:, -len(self.measured) :, 0] * K[:, 0, len(self.references) :], axis=1)
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
        P, K, m, n = self.plant, self.controller, len(self.measured), len(self.references)
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

        m, n = len(self.measured), len(self.references)
        plant = control.ss(self.plant.A, self.plant.B[:, [0]], self.plant.C[-m:], np.zeros((m, 1)), self.dt)
        K = self.controller
        feedback = control.ss(K.A, -K.B[:, n:], K.C, -K.D[:, n:], self.dt)
        L = plant * feedback if m == 1 else feedback * plant
        return L, control.feedback(1, L), self.closed.system(self.inputs, self.shown)

    def plant_system(self) -> Any:
        """The sampled plant, the torque held between samples, as `control.StateSpace`: torque wanted and load torque to
        the outputs and, named measured_*, to what the controller sees (drive, encoder and lag included)."""
        import control

        known = {self.kind.looped.speed: "speed", self.kind.looped.position: "position"}
        seen = [f"measured_{known.get(name, name)}" for name in self.measured]
        names = ["torque_wanted", "load_torque"], [*self.outputs, *seen]
        P = self.plant
        return control.ss(P.A, P.B, P.C, P.D, P.dt, inputs=names[0], outputs=names[1])

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
    machine: Machine,
    settings: Settings,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    height_free: bool = False,
) -> LinearLoop:
    """The loop of a machine (drive and effects included) under a controller, at an operating point.

    Effects on sensors act on the log alone, as in the compiled loop: they are not in it.
    """
    settings = settings.at(point.payload_kg)
    placed = height_free or bool(settings.kv_per_s)
    plant = linearise(machine, point, effects=effects, height_free=placed)
    return loop_of(machine, settings, point, plant)


def loop_of(
    machine: Machine, settings: Settings, point: OperatingPoint, plant: LinearPlant, gains: Gains | None = None
) -> LinearLoop:
    """The loop around a linear plant; gains: (kp, ki) in place of the settings' own."""
    kind, parts = kind_of(machine), controller_of(settings, machine)
    at = point.height_m if kind.looped.position_loop else 0.0
    return LinearLoop(
        point,
        sampled_plant(plant, settings.sample_time_s, machine.drive, parts.measured[1:]),
        linear_controller(settings, machine, point.payload_kg, gains=gains, at=at),
        plant.outputs,
        ("position_reference", "speed_reference")[-len(parts.references) :],
        parts.measured,
        kind,
    )


RECOVERED = 0.1  # of the largest deviation: what counts as over


@dataclass(frozen=True)
class StepResponse:
    """Deviations after a unit step at time 0; time_s: (n,), signals by name: (n,)."""

    time_s: Array
    signals: dict[str, Array]


def step_response(loop: LinearLoop, of: str, duration_s: float) -> StepResponse:
    """of: one of the loop's inputs; 1 rad/s of the reference or 1 N m on the shaft, hoisting. Signals as `shown`."""
    n = max(2, round(duration_s / loop.dt) + 1)
    time: Array = np.arange(n, dtype=np.float64) * np.float64(loop.dt)
    out = _held(loop.closed, loop.inputs.index(of), n)
    return StepResponse(time, {name: out[:, i] for i, name in enumerate(loop.shown)})


def _held(system: Sampled, column: int, n: int) -> Array:
    """Outputs (n, outputs) from rest under one input held at 1.

    The block of states known so far is carried on by its own length until there are enough: as exact as
    step by step, and a hundred times as fast.
    """
    m = len(system.A)
    on = np.eye(m + 1)  # state and input together
    on[:m, :m], on[:m, m] = system.A, system.B[:, column]
    states = np.eye(m + 1)[:, [m]]
    while states.shape[1] < n:
        states, on = np.hstack([states, on @ states]), on @ on
    out: Array = (np.column_stack([system.C, system.D[:, column]]) @ states[:, :n]).T
    return out


@dataclass(frozen=True)
class LoadStep:
    """What 1 N m on the shaft does to the motor's speed.

    peak_rad_s: largest deviation, at peak_s. iae_rad: integral of its magnitude. recovery_s: from then on the
    deviation stays within a tenth of its peak.
    """

    peak_rad_s: float
    peak_s: float
    iae_rad: float
    recovery_s: float


def load_step(loop: LinearLoop) -> LoadStep:
    """By the exact linear loop, until its slowest mode that shows has died out to a thousandth."""
    sizes = np.abs(loop.poles())
    slowest = float(np.max(sizes[sizes < 1.0 - 1e-9], initial=0.5))
    n = int(min(max(np.log(1e-3) / np.log(slowest), 100), 60.0 / loop.dt))
    size = np.abs(_held(loop.closed, loop.inputs.index("load_torque"), n)[:, 0])
    k = int(np.argmax(size))
    off = np.flatnonzero(size > RECOVERED * size[k])
    return LoadStep(float(size[k]), k * loop.dt, float(size.sum() * loop.dt), (int(off[-1]) + 1) * loop.dt)


@dataclass(frozen=True)
class PositionAnswer:
    """What 1 N or N m on an axis does to its position, m or rad. peak: the largest way; left: at the end, where an
    integral has had its time."""

    peak: float
    left: float


def position_answer(loop: LinearLoop) -> PositionAnswer | None:
    """By the exact linear loop; None where nothing holds the position or it is no part of the loop."""
    if loop.kind.looped.position not in loop.outputs:
        return None
    row = loop.outputs.index(loop.kind.looped.position)
    sizes = np.abs(loop.poles())
    if not np.any(loop.plant.C[row]) or np.any(sizes >= 1.0 - 1e-12):
        return None
    n = int(min(max(np.log(1e-4) / np.log(float(np.max(sizes))), 100), 60.0 / loop.dt))
    way = np.abs(_held(loop.closed, loop.inputs.index("load_torque"), n)[:, row])
    return PositionAnswer(float(way.max()), float(way[-1]))
