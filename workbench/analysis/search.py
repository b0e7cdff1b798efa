"""Loop shaping: which kp and ki keep Ms over a family of loops, and what ends the bandwidth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from workbench.analysis.linearise import LinearPlant, OperatingPoint, linearise
from workbench.analysis.loop import Complex, Sampled, linear_controller, loop_of
from workbench.analysis.margins import HALF_POWER
from workbench.control import Notch, Settings
from workbench.control.settings import notch_coefficients
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import HOIST, NO_EFFECTS, ClosedLoop, Effects, Machine, kind_of

UNDAMPED = 1e-3  # damping ratio below which a mode counts as undamped
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
    where = loop.where(point.payload_kg, point.height_m)
    return [
        AntiResonance(float(abs(z)) / (2.0 * math.pi), float(-z.real / abs(z)), point, loop.swing, where)
        for z in sorted(light, key=abs)
    ]


def resonances_hz(plant: LinearPlant) -> list[float]:
    """Of the plant's own modes, the motor free, those with damping below LIGHT."""
    poles = np.linalg.eigvals(plant.A)
    return [float(abs(s)) / (2.0 * math.pi) for s in poles if s.imag > 1e-6 and -s.real < LIGHT * abs(s)]


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
    that each part of drive and sampling costs. resonances_hz: lightly damped modes with the motor free.
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
    resonances_hz: Sequence[float] = ()

    def with_notch(self, before: Notch | None, notch: Notch | None) -> Search:
        """The search of settings with another notch in place of the one before."""
        back = np.exp(-2j * math.pi * self.frequency_hz * self.dt)  # one sample earlier

        def response(notch: Notch | None) -> Complex:
            b0, b1, b2, a1, a2 = notch_coefficients(notch, self.dt)
            return np.asarray((b0 + b1 * back + b2 * back**2) / (1.0 + a1 * back + a2 * back**2))

        factor = response(notch) / response(before)
        return replace(self, per_kp=self.per_kp * factor, per_ki=self.per_ki * factor)

    def why_no_wider(self, kp: float, ki: float) -> str:
        """What ends the bandwidth that the widest gains give the slowest member."""
        T = np.abs(1.0 - 1.0 / (1.0 + self.plants * (kp * self.per_kp + ki * self.per_ki)))
        widths = self._bandwidth(T**2)
        slowest = int(np.argmin(widths))
        crossing = float(widths[slowest])
        return why(self.zeros[slowest], self.lags_deg(crossing), self.frequency_hz, T[slowest], crossing)

    def with_hardly_any_gain(self) -> tuple[float, float]:
        """(largest |S|, where in Hz) as the gains go to zero: 1, but for an undamped mode. There the locus of L goes
        straight through infinity, past -1 at a distance that no gain changes, only the phase that is lost."""
        (kp, _), (ratio, _) = _ranges(self)
        back = 1.0 + kp * self.plants * (self.per_kp + ratio * self.per_ki)
        chord = np.diff(back)
        part = np.clip(-(back[:, :-1] * np.conj(chord)).real / np.abs(chord) ** 2, 0.0, 1.0)
        distance = np.abs(back[:, :-1] + part * chord).min(axis=0)
        return float(1.0 / distance.min()), float(self.frequency_hz[int(np.argmin(distance))])

    def _returned(self, kp: Array, ki: Array, at: slice = slice(None)) -> Iterator[Complex]:
        """1 + L, (candidates, members, frequencies `at`), of as many candidates at a time as a cache holds."""
        plants, per_kp, per_ki = self.plants[:, at], self.per_kp[at], self.per_ki[at]
        size = max(1, CACHED // plants.size)
        for start in range(0, len(kp), size):
            K = kp[start : start + size, None] * per_kp + ki[start : start + size, None] * per_ki
            back = plants[None] * K[:, None, :]
            back += 1.0
            yield back

    def judge(self, kp: Array, ki: Array) -> Judged:
        """Candidates kp, ki (n,)."""
        parts = []
        for back in self._returned(kp, ki):
            size = _square(back)
            T = _square(back - 1.0) / size
            stable = np.all(np.abs(_turns(back) - self.turns) < 0.5 * math.pi, axis=1)
            worst = 1.0 / np.sqrt(size.min(axis=(1, 2))), np.sqrt(T.max(axis=(1, 2)))
            parts.append((*worst, self._bandwidth(T).min(axis=1), stable))
        ms, mt, bandwidth, stable = (np.concatenate([part[i] for part in parts]) for i in range(4))
        return Judged(ms, mt, bandwidth, stable)

    def within(self, kp: Array, ki: Array, ms: float) -> np.ndarray:
        """(n,) whether candidates may keep to a bound on Ms: few frequencies tell of most that do not."""
        few = self._returned(kp, ki, slice(None, None, FEW))
        return np.concatenate([_square(back).min(axis=(1, 2)) * ms**2 >= 1.0 for back in few])

    def reaches(self, kp: Array, ki: Array, bandwidth_hz: Array) -> np.ndarray:
        """(n,) whether every member has the bandwidth (n,): that is seen up to it."""
        seen = self._returned(kp, ki, slice(int(np.searchsorted(self.frequency_hz, bandwidth_hz.max())) + 1))
        widths = [self._bandwidth(_square(back - 1.0) / _square(back)).min(axis=1) for back in seen]
        return np.concatenate(widths) >= bandwidth_hz

    def _bandwidth(self, squared: Array) -> Array:
        """(candidates, members): where |T| first falls below -3 dB, between two frequencies by their logarithms.
        squared: |T|^2, from the first frequency on."""
        below = squared < HALF_POWER**2
        k = np.argmax(below, axis=-1)
        rows = np.indices(k.shape)
        before = np.maximum(k - 1, 0)
        a, b = np.log(squared[(*rows, before)] / HALF_POWER**2), np.log(squared[(*rows, k)] / HALF_POWER**2)
        part = np.where(a > b, a / np.where(a > b, a - b, 1.0), 1.0)
        f = np.log(self.frequency_hz)
        crossing = np.exp(f[before] + np.clip(part, 0.0, 1.0) * (f[k] - f[before]))
        return np.where(below.any(axis=-1), crossing, np.inf)


def make_search(
    machine: Machine, settings: Settings, points: Sequence[OperatingPoint], *, effects: Effects = NO_EFFECTS
) -> Search:
    """A search over kp and ki; filters, delays and sample time are those of settings and drive.

    The machine's own effects are at work, `effects` beside them.
    """
    if getattr(settings, "gain_schedule", None):
        settings = settings.model_copy(update={"gain_schedule": None})
    kind = kind_of(machine)
    linear = [linearise(machine, point, effects=effects, height_free=bool(settings.kv_per_s)) for point in points]
    loops = [loop_of(machine, settings, point, plant) for point, plant in zip(points, linear, strict=True)]
    f = _grid([loop.plant for loop in loops], settings.sample_time_s)
    units = [linear_controller(settings, machine, gains=gains).response(f)[:, 0] for gains in ((1.0, 0.0), (0.0, 1.0))]
    n = len(loops[0].measured)
    per_kp, per_ki = (-unit[:, -n] for unit in units)
    # What else is measured goes through the same gains: its weight beside the speed is theirs.
    beside = units[0][:, -n:] / units[0][:, [-n]]
    responses = np.array([np.sum(beside * loop.plant.response(f)[:, -n:, 0], axis=1) for loop in loops])
    inertia = 1.0 / float(linear[0].B[linear[0].states.index(kind.looped.speed), 0])
    everywhere = kind.looped.more_often[0]
    for crossover_hz in np.geomspace(40.0 * f[0], 0.2 * f[-1], 12):  # a controller that makes all stable: a slow one
        w = 2.0 * math.pi * crossover_hz
        kp, ki = w * inertia, w * w * inertia / 10.0
        if all(loop_of(machine, settings, *one, gains=(kp, ki)).stable for one in zip(points, linear, strict=True)):
            turns = _turns(1.0 + responses * (kp * per_kp + ki * per_ki))
            break
    else:
        said = f"no PI gains make this loop stable {everywhere}; the drive is too slow, or the machine runs away"
        raise InputError(said)
    return Search(
        f, responses, per_kp, per_ki, turns, inertia, settings.sample_time_s,
        [anti_resonances(plant, point, kind.looped) for plant, point in zip(linear, points, strict=True)],
        partial(phase_lags_deg, machine.drive, settings), everywhere.replace("at every", "for every"),
        sorted(hz for plant in linear for hz in resonances_hz(plant)),
    )  # fmt: skip


def _square(z: Complex) -> Array:
    return np.asarray(z.real**2 + z.imag**2)


def _turns(back: Complex) -> Array:
    """(..., frequencies) -> how far the phase turns from the first frequency to the last, whole turns included: once
    for each time that the locus passes the negative real axis, where the phase jumps."""
    lower = np.signbit(back.imag)
    turned = np.angle(back[..., -1]) - np.angle(back[..., 0])
    here = np.nonzero(lower[..., 1:] != lower[..., :-1])
    a, b = back[..., :-1][here], back[..., 1:][here]
    way = np.where(np.signbit(b.imag), 1.0, -1.0)  # downwards the phase grows there, upwards it falls
    np.add.at(turned, here[:-1], 2.0 * math.pi * way * (way * (a.real * b.imag - a.imag * b.real) > 0.0))
    # The start differs by candidate (how much the integral weighs); its own phase is taken out.
    return np.asarray(turned + np.angle(-back[..., 0]))


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
                if (
                    width < UNDAMPED
                ):  # the loop crosses |L| = 1 far outside such a peak, at a distance that goes with kp
                    away = np.geomspace(1e-7, 0.1, 180)
                    parts += [s.imag * (1.0 - away), s.imag * (1.0 + away)]
    f = np.unique(np.concatenate(parts))
    return f[(f >= lowest) & (f <= nyquist)]


LOWEST_CROSSOVER_HZ = 0.05
NEAR = 0.999  # of the bound on Ms, for what lies between the grid's frequencies
CACHED = 30_000  # complex numbers
FEW = 8  # of so many frequencies one
Range = tuple[float, float]


@dataclass(frozen=True)
class Shaped:
    """Gains (kp N m s/rad, ki N m/rad) with the family's largest Ms and smallest bandwidth.

    attainable_hz: the widest bandwidth that the bound on Ms allows with any gains.
    """

    kp: float
    ki: float
    ms: float
    bandwidth_hz: float
    attainable_hz: float


def best_rejection(search: Search, ms_limit: float) -> Shaped:
    """The largest ki with Ms below the limit for every member."""
    kp, ki = _largest(search, ms_limit, lambda ki, judged: ki)
    shaped = _shaped(search, kp, ki, _bandwidth_of(search, _widest(search, ms_limit)))
    return replace(shaped, attainable_hz=max(shaped.attainable_hz, shaped.bandwidth_hz))


def for_bandwidth(search: Search, bandwidth_hz: float, ms_limit: float) -> Shaped:
    """The largest ki among the gains that give the family's slowest member the bandwidth, Ms and Mt below the limit.

    Ms alone would let the integral grow until the reference is overshot by half.

    InputError where sample time, filters and delays do not allow it; it says what they do allow.
    """
    widest = _widest(search, ms_limit)
    attainable = _bandwidth_of(search, widest)
    if bandwidth_hz > attainable:
        raise InputError(
            f"{bandwidth_hz:g} Hz is out of reach: this machine and drive allow at most {rounded_down(attainable)} Hz "
            f"at Ms {ms_limit:g}; {search.why_no_wider(*widest)}",
            place="bandwidth",
        )
    _, (low, high) = _ranges(search)
    best: tuple[float, float] | None = None
    for _ in range(3):
        ratio = np.geomspace(low, high, 40)
        kp = kp_for(search, np.full(len(ratio), bandwidth_hz), ratio)
        judged = search.judge(kp, kp * ratio)
        good = (
            _allowed(judged, ms_limit)
            & (judged.mt <= NEAR * ms_limit)
            & (np.abs(np.log(judged.bandwidth_hz / bandwidth_hz)) < 1e-3)
        )
        if not good.any():
            break
        k = int(np.argmax(np.where(good, kp * ratio, -1.0)))
        best = (float(kp[k]), float(kp[k] * ratio[k]))
        low, high = float(ratio[max(k - 1, 0)]), float(ratio[min(k + 1, len(ratio) - 1)])
    if best is None:
        raise InputError(
            f"{bandwidth_hz:g} Hz: no gains give just that with Ms and Mt {ms_limit:g} or less; "
            f"{_nearest(search, bandwidth_hz, ms_limit)}the widest is {rounded_down(attainable)} Hz",
            place="bandwidth",
        )
    return _shaped(search, *best, attainable)


def _nearest(search: Search, bandwidth_hz: float, ms_limit: float) -> str:
    """Words for the bandwidth nearest to that asked for, as a ratio, of those that a table of allowed gains gives."""
    kps, ratios = (np.geomspace(*span, 60) for span in _ranges(search))
    kp, ratio = (a.ravel() for a in np.meshgrid(kps, ratios, indexing="ij"))
    judged = search.judge(kp, kp * ratio)
    good = _allowed(judged, ms_limit) & (judged.mt <= NEAR * ms_limit) & np.isfinite(judged.bandwidth_hz)
    had = judged.bandwidth_hz[good & (judged.bandwidth_hz > 0.0)]
    if not len(had):
        return ""
    return f"the nearest that can be had is about {had[np.argmin(np.abs(np.log(had / bandwidth_hz)))]:.2g} Hz, "


def _widest(search: Search, ms_limit: float) -> tuple[float, float]:
    """The gains of the widest bandwidth."""
    return _largest(search, ms_limit, lambda ki, judged: np.nan_to_num(judged.bandwidth_hz, posinf=0.0))


def _bandwidth_of(search: Search, gains: tuple[float, float]) -> float:
    return float(search.judge(np.array([gains[0]]), np.array([gains[1]])).bandwidth_hz[0])


def _ranges(search: Search) -> tuple[Range, Range]:
    """Of kp, and of ki/kp (1/s): from next to nothing to what no sampled loop can bear."""
    nyquist = math.pi / search.dt
    slowest = 2.0 * math.pi * LOWEST_CROSSOVER_HZ
    return (search.inertia_kg_m2 * slowest, search.inertia_kg_m2 * nyquist), (0.05 * slowest, 0.25 * nyquist)


def _largest(search: Search, ms_limit: float, score: Callable[[Array, Judged], Array]) -> tuple[float, float]:
    """The allowed gains of the largest score: a coarse table of all, then finer ones around the best."""
    (kp_low, kp_high), (r_low, r_high) = _ranges(search)
    kps, ratios = np.geomspace(kp_low, kp_high, 48), np.geomspace(r_low, r_high, 40)
    step = np.array([kps[1] / kps[0], ratios[1] / ratios[0]])
    best: tuple[float, float, float] | None = None
    for _ in range(10):
        kp, ratio = (a.ravel() for a in np.meshgrid(kps, ratios, indexing="ij"))
        able = np.flatnonzero(search.within(kp, kp * ratio, NEAR * ms_limit))
        scores = np.full(len(kp), -np.inf)
        if len(able):
            judged, ki = search.judge(kp[able], (kp * ratio)[able]), (kp * ratio)[able]
            scores[able] = np.where(_allowed(judged, ms_limit), score(ki, judged), -np.inf)
        k = int(np.argmax(scores))
        if np.isfinite(scores[k]) and (best is None or scores[k] >= best[0]):
            best = (float(scores[k]), float(kp[k]), float(ratio[k]))
        if best is None:
            least, at_hz = search.with_hardly_any_gain()
            why, expected = "", "a number further above 1"
            if least > ms_limit:
                why = f": an undamped swing at {at_hz:.3g} Hz leaves Ms at {least:.3g} or more whatever the gains"
                expected = f"damping, a drive with less lag, or a number above {least:.3g}"
            said = f"{ms_limit:g}: no gains reach it {search.everywhere}{why}; expected {expected}"
            raise InputError(said, place="ms")
        kps = best[1] * np.geomspace(1.0 / step[0], step[0], 11)
        ratios = best[2] * np.geomspace(1.0 / step[1], step[1], 11)
        step = step**0.5
    assert best is not None
    return best[1], best[1] * best[2]


def kp_for(search: Search, bandwidth_hz: Array, ratio: Array) -> Array:
    """For each bandwidth and ki/kp (n,) the smallest kp that gives it; where none does, one that does not."""
    table = np.geomspace(*_ranges(search)[0], 40)
    kp = np.repeat(table[:, None], len(ratio), axis=1)
    reached = search.reaches(kp.ravel(), (kp * ratio).ravel(), np.tile(bandwidth_hz, len(kp))).reshape(kp.shape)
    first = np.clip(np.argmax(reached, axis=0), 1, None)
    low, high = np.log(table[first - 1]), np.log(table[first])
    for _ in range(16):
        middle = 0.5 * (low + high)
        enough = search.reaches(np.exp(middle), np.exp(middle) * ratio, bandwidth_hz)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    smallest_kp: Array = np.exp(high)
    return smallest_kp


def _allowed(judged: Judged, ms_limit: float) -> np.ndarray:
    return np.asarray(judged.stable & (judged.ms <= NEAR * ms_limit))


def _shaped(search: Search, kp: float, ki: float, attainable_hz: float) -> Shaped:
    judged = search.judge(np.array([kp]), np.array([ki]))
    return Shaped(kp, ki, float(judged.ms[0]), float(judged.bandwidth_hz[0]), attainable_hz)
