"""Many gains at once: a family's frequency responses on one grid, and what any (kp, ki) makes of them.

The controller's response is linear in its two gains, L = P (kp K_p + ki K_i), so a candidate costs
a few multiplications per frequency. What is found here is checked by exact margins afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from workbench.analysis.controller import linear_controller
from workbench.analysis.discrete import Complex, Sampled, sampled_plant
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.obstacle import AntiResonance, anti_resonances, phase_lags_deg, why
from workbench.control import Settings
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.plants import NO_EFFECTS, Effects
from workbench.run import Array

HALF_POWER = math.sqrt(0.5)


@dataclass(frozen=True)
class Judged:
    """Of candidates (n,), over the whole family: largest Ms and Mt, smallest bandwidth (Hz), all members stable."""

    ms: Array
    mt: Array
    bandwidth_hz: Array
    stable: np.ndarray


@dataclass(frozen=True, eq=False)
class Search:
    """Responses (members, frequencies) of the plants, (frequencies,) of the controller per unit of each gain.

    turns: by how much the phase of 1 + L turns along the grid when the loop is stable, per member:
    by Nyquist's criterion all stable gains share it. zeros: each member's anti-resonances. lags_deg(Hz): the phase
    that each part of drive and sampling costs.
    """

    frequency_hz: Array
    plants: Complex
    per_kp: Complex
    per_ki: Complex
    turns: Array
    inertia_kg_m2: float
    dt: float
    zeros: Sequence[Sequence[AntiResonance]]
    lags_deg: Callable[[float], dict[str, float]]
    everywhere: str = "for every payload"

    def why_no_wider(self, kp: float, ki: float) -> str:
        """What ends the bandwidth that the widest gains give the slowest member."""
        T = np.abs(1.0 - 1.0 / (1.0 + self.plants * (kp * self.per_kp + ki * self.per_ki)))
        widths = self._bandwidth(T)
        slowest = int(np.argmin(widths))
        crossing = float(widths[slowest])
        return why(self.zeros[slowest], self.lags_deg(crossing), self.frequency_hz, T[slowest], crossing)

    def judge(self, kp: Array, ki: Array) -> Judged:
        """Candidates kp, ki (n,)."""
        parts = []
        size = max(1, 400_000 // self.plants.size)
        for start in range(0, len(kp), size):
            K = kp[start : start + size, None] * self.per_kp + ki[start : start + size, None] * self.per_ki
            back = 1.0 + self.plants[None] * K[:, None, :]
            ms = 1.0 / np.abs(back).min(axis=(1, 2))
            turned = _turns(back)
            T = np.abs(1.0 - 1.0 / back)
            stable = np.all(np.abs(turned - self.turns) < 0.5 * math.pi, axis=1)
            parts.append((ms, T.max(axis=(1, 2)), self._bandwidth(T).min(axis=1), stable))
        ms, mt, bandwidth, stable = (np.concatenate([part[i] for part in parts]) for i in range(4))
        return Judged(ms, mt, bandwidth, stable)

    def _bandwidth(self, T: Array) -> Array:
        """(candidates, members): where |T| first falls below -3 dB, between two frequencies by their logarithms."""
        below = T < HALF_POWER
        k = np.argmax(below, axis=-1)
        rows = np.indices(k.shape)
        before = np.maximum(k - 1, 0)
        a, b = np.log(T[(*rows, before)] / HALF_POWER), np.log(T[(*rows, k)] / HALF_POWER)
        part = np.where(a > b, a / np.where(a > b, a - b, 1.0), 1.0)
        f = np.log(self.frequency_hz)
        crossing = np.exp(f[before] + np.clip(part, 0.0, 1.0) * (f[k] - f[before]))
        return np.where(below.any(axis=-1), crossing, np.inf)


def make_search(
    machine: Hoist | Axis,
    settings: Settings,
    points: Sequence[OperatingPoint],
    *,
    effects: Effects = NO_EFFECTS,
) -> Search:
    """A search over kp and ki; filters, delays and sample time are those of settings and drive.

    The machine's own effects are at work, `effects` beside them.
    """
    dt, loop = settings.sample_time_s, kind_of(machine).looped
    cascade = loop.position_loop
    placed = cascade and settings.kv_per_s > 0.0
    linear = [linearise(machine, point, effects=effects, height_free=placed) for point in points]
    plants = [sampled_plant(point, dt, machine.drive, loop.position if cascade else "") for point in linear]
    f = _grid(plants, dt)
    units = [linear_controller(settings, machine, gains=gains).response(f) for gains in ((1.0, 0.0), (0.0, 1.0))]
    measured = 2 if cascade else 1
    responses = np.array([plant.response(f)[:, -measured, 0] for plant in plants])
    if cascade:  # what a cascade's position adds goes through the same gains: its weight beside the speed is theirs
        beside = units[0][:, 0, -1] / units[0][:, 0, -2]
        responses = responses + beside * np.array([plant.response(f)[:, -1, 0] for plant in plants])
    per_kp, per_ki = (-unit[:, 0, -measured] for unit in units)
    inertia = 1.0 / float(linear[0].B[linear[0].states.index(loop.speed), 0])
    back = 1.0 + responses * _stable_controller(machine, settings, plants, inertia, f)
    zeros = [anti_resonances(plant, point, loop) for plant, point in zip(linear, points, strict=True)]
    lags = partial(phase_lags_deg, machine.drive, settings)
    return Search(
        f,
        responses,
        per_kp,
        per_ki,
        _turns(back),
        inertia,
        dt,
        zeros,
        lags,
        loop.more_often[0].replace("at every", "for every"),
    )


def _stable_controller(
    machine: Hoist | Axis, settings: Settings, plants: Sequence[Sampled], inertia: float, f: Array
) -> Complex:
    """The response of some controller that makes every member stable by its poles: a slow one, if it can be."""
    for crossover_hz in np.geomspace(40.0 * f[0], 0.2 * f[-1], 12):
        kp = 2.0 * math.pi * crossover_hz * inertia
        controller = linear_controller(settings, machine, gains=(kp, 2.0 * math.pi * crossover_hz * kp / 10.0))
        if all(_closed_stable(plant, controller) for plant in plants):
            return -controller.response(f)[:, 0, controller.B.shape[1] // 2]
    raise InputError(
        f"no PI gains make this loop stable {kind_of(machine).looped.more_often[0]}; the drive is too slow, or the "
        "machine runs away"
    )


def _closed_stable(plant: Sampled, controller: Sampled) -> bool:
    K, n = controller, controller.B.shape[1] // 2  # as many references as measured signals
    w, u = plant.C[-n:], plant.B[:, [0]]
    A = np.block([[plant.A + u @ K.D[:, n:] @ w, u @ K.C], [K.B[:, n:] @ w, K.A]])
    return bool(np.max(np.abs(np.linalg.eigvals(A))) < 1.0)


def _turns(back: Complex) -> Array:
    """(..., frequencies) -> how far the phase turns from the first frequency to the last, whole turns included."""
    steps = np.angle(back[..., 1:] * np.conj(back[..., :-1]))
    # The start differs by candidate (how much the integral weighs); its own phase is taken out.
    return np.asarray(steps.sum(axis=-1) + np.angle(-back[..., 0]))


def _grid(plants: Sequence[Sampled], dt: float) -> Array:
    nyquist = 0.5 / dt
    lowest = 5e-4  # from here on the phase of 1 + L is followed; its peaks lie far above
    parts = [np.geomspace(lowest, 0.02, 24), np.geomspace(0.02, nyquist, 280), np.linspace(0.1, 1.0, 80) * nyquist]
    for plant in plants:
        for z in plant.poles():
            if abs(z) > 1e-3 and z.imag > 0.0:
                s = np.log(z) / (2.0 * math.pi * dt)
                width = abs(s.real) / max(abs(s), 1e-9)
                if width < 0.3:  # a sharp peak; the even grid sees the broad ones
                    parts.append(s.imag * (1.0 + width * np.linspace(-5.0, 5.0, 21)))
    f = np.unique(np.concatenate(parts))
    return f[(f >= lowest) & (f <= nyquist)]
