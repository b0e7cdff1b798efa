"""The ports of a machine where an unknown force may enter, and what that force may depend on.

A port is a linear model of the residual: columns of basis functions, scaled to an rms of one. Ports differ by the
factor of their force (direction of motion for friction, mass on the wire, transmitted torque, accelerations) and by the
variable that the force repeats over (height, angle, time).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.location.survey import Course, Survey, at_rows, since_reversal

TURN = 2.0 * math.pi
SENSOR = "torque_sensor"  # of the input
Of = Callable[[Course], Array]


@dataclass(frozen=True)
class Port:
    """columns: (samples, k). over: the variable of its force, in words. weight: prior, before places share it.
    positive: whether the sum of its amounts cannot be negative."""

    subsystem: str
    regime: str
    over: str
    columns: Array
    weight: float = 1.0
    positive: bool = False


class Ports:
    """All ports of one survey."""

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        self.fastest = max(float(np.max(np.abs(c.speed))) for c in survey.runs)
        heights = np.concatenate([c.position for c in survey.runs])
        self.low, self.high = float(heights.min()), float(heights.max())
        self.loads = sorted({c.payload for c in survey.runs})

    def made(
        self, subsystem: str, regime: str, over: str, of: Of, pull: float = 0.0, weight: float = 1.0,
        positive: bool = False, own: bool = False,
    ) -> Port | None:  # fmt: skip
        """The port of a function `of` a course, (n,) or (n, k). pull: of the dead line's tension, +1 for a force on the
        carriage. own: whether every run has amounts of its own."""
        parts = []
        for c in self.survey.runs:
            part = np.asarray(of(c), dtype=float)
            parts.append(part[:, None] if part.ndim == 1 else part)
        rows = at_rows(self.survey, parts)
        if own:
            run_of = self.survey.run_of_row[: self.survey.inputs, None]
            rows = np.hstack([np.where(run_of == j, rows, 0.0) for j in range(len(parts))])
            rows = rows[:, np.any(rows != 0.0, axis=0)]
        return self.scaled(subsystem, regime, over, rows, pull, weight, positive)

    def scaled(
        self, subsystem: str, regime: str, over: str, rows: Array, pull: float = 0.0, weight: float = 1.0,
        positive: bool = False,
    ) -> Port | None:  # fmt: skip
        size = math.sqrt(float(np.mean(np.sum(rows**2, axis=1))))
        if not size > 0.0:
            return None
        rows = self.survey.shown(rows / size, pull, subsystem == SENSOR)
        return Port(subsystem, regime, over, rows, weight, positive)

    def all(self) -> Iterator[Port]:
        every = self._hoist() if self.survey.hoist else self._axis()
        yield from (port for port in every if port is not None)

    # What forces depend on.

    def u(self, c: Course) -> Array:
        return np.abs(c.speed) / self.fastest

    def creeping(self, low: float) -> Of:
        """Friction that fades as the speed rises beyond `low`, of the fastest."""
        return lambda c: c.way * np.exp(-((self.u(c) / low) ** 2))

    def squared(self, line: float) -> Of:
        """Drag in proportion to the speed squared, with a small linear part."""

        def drag(c: Course) -> Array:
            u = self.u(c)
            return c.way[:, None] * (np.stack([u**2, line * u], axis=1) if line else (u**2)[:, None])

        return drag

    def ways(self, of: Of) -> Of:
        """A function with amounts of its own for each direction."""

        def both(c: Course) -> Array:
            x = of(c)
            x = x[:, None] if x.ndim == 1 else x
            ahead = (c.speed > 0.0)[:, None]
            return np.hstack([np.where(ahead, x, 0.0), np.where(ahead, 0.0, x)])

        return both

    def curve(self, x: Of, low: float, high: float, length: float) -> Of:
        """A smooth function of x: a Gaussian process with the length scale given as a share of the range."""
        knots = np.linspace(0.0, 1.0, max(4, math.ceil(2.0 / length) + 1))
        root = _root(knots, length)
        return lambda c: hats((x(c) - low) / (high - low), knots) @ root

    def along(self, length: float) -> Of:
        return self.curve(lambda c: c.position, self.low, self.high, length)

    def wandering(self, every_s: float) -> Of:
        """A random walk over each run's time: steps at even times."""

        def steps(c: Course) -> Array:
            t = c.time - c.time[0]
            knots = np.linspace(0.0, t[-1], max(4, round(t[-1] / every_s)))
            return np.clip((t[:, None] - knots[:-1]) / (knots[1] - knots[0]), 0.0, 1.0)

        most = max(steps(c).shape[1] for c in self.survey.runs)
        return lambda c: np.pad(x := steps(c), ((0, 0), (0, most - x.shape[1])))

    def waves(
        self, subsystem: str, regime: str, over: str, frequencies: Array, at: Of, carrier: Of, pull: float,
        own: bool, weight: float = 1.0,
    ) -> Iterator[Port | None]:  # fmt: skip
        """One wave over `at`, of each frequency, slow enough for the low-pass to pass it: of each run its own, or
        around a level, of all runs together."""
        s = self.survey
        x, carried = (at_rows(s, [f(c)[:, None] for c in s.runs])[:, 0] for f in (at, carrier))
        run_of = s.run_of_row[: s.inputs]
        groups = [run_of == j for j in range(len(s.runs))] if own else [np.ones(s.inputs, dtype=bool)]
        for f in frequencies:
            wave = [np.cos(TURN * f * x), np.sin(TURN * f * x)]
            both = np.stack(wave if own else [np.ones(len(x)), *wave], axis=1) * carried[:, None]
            rows = np.hstack([np.where(mine[:, None], both, 0.0) for mine in groups])
            yield self.scaled(subsystem, regime, over, rows, pull, weight / len(frequencies))

    def turning(self, what: str, order: float, carrier: Of) -> Of:
        """A wave over the turns of a part, as far as the band passes it."""
        per = self.survey.turns[what] * order

        def both(c: Course) -> Array:
            f0 = self.survey.band_hz / (math.sqrt(2.0) - 1.0) ** 0.125
            passed = 1.0 / (1.0 + (np.abs(c.turn_rate) * per / TURN / f0) ** 8)
            x = per * c.turn
            return np.stack([np.cos(x), np.sin(x)], axis=1) * (passed * carrier(c))[:, None]

        return both

    def swell(self, low_hz: float, high_hz: float, longest_s: float) -> Of:
        """All waves between two frequencies, of each run its own."""
        hz = np.arange(low_hz, high_hz, 1.0 / longest_s)
        return lambda c: np.hstack([f(TURN * np.outer(c.time, hz)) for f in (np.cos, np.sin)])

    def swinging(self, hz: float, damping: float, heaviest: float) -> Of:
        """A load that hangs softly lags and swings: the relative acceleration of a mass on a spring under the carriage.

        hz: of the heaviest load; a lighter one on the same spring swings faster.
        """

        def force(c: Course) -> Array:
            if c.payload <= 0.05 * heaviest:
                return np.zeros(len(c.time))
            w = TURN * hz * math.sqrt(heaviest / c.payload)
            return c.payload * lag(c.acceleration, c, w, damping)

        return force

    def _rubbing(self, part: str, pull: float, of_curves: float) -> Iterator[Port | None]:
        """Friction by the way and the speed. of_curves: the weight of a smooth function of the speed."""
        m, u = self.made, self.u
        way: Of = lambda c: c.way  # noqa: E731
        viscous: Of = lambda c: c.way * u(c)  # noqa: E731
        yield m(part, "all", "the way", way, pull)
        yield m(part, "all", "each way", self.ways(way), pull)
        yield m(part, "speed", "the speed", viscous, pull, 1.0, True)
        yield m(part, "speed", "the speed, each way", self.ways(viscous), pull)
        for length in (0.2, 0.5):
            curve = times(way, self.curve(u, 0.0, 1.0, length))
            yield m(part, "speed", "the speed", curve, pull, of_curves)
            yield m(part, "speed", "the speed, each way", self.ways(curve), pull, 0.25)
        for low in (0.03, 0.06, 0.12):
            creep = self.creeping(low)
            yield m(part, "low_speed", "low speed", creep, pull, 0.33)
            yield m(part, "low_speed", "low speed, each way", self.ways(creep), pull, 0.33)

    def _over_time(self, part: str, pull: float, every_s: float) -> Iterator[Port | None]:
        """Friction, and an offset of the input's sensor, that change in the campaign's and in the run's time."""
        m, runs = self.made, self.survey.runs
        way: Of = lambda c: c.way  # noqa: E731
        clock: Of = lambda c: c.start_time_s + c.time  # noqa: E731
        first, last = (f(c.start_time_s + c.time[k] for c in runs) for f, k in ((min, 0), (max, -1)))
        for length in (0.3, 1.0):
            slow = self.curve(clock, first, last, length)
            yield m(part, "time", "the campaign's time", times(way, slow), pull, 0.5)
            yield m(SENSOR, "time", "the campaign's time", slow, 0.0, 0.25)
        walk = self.wandering(every_s)
        yield m(part, "time", "the run's time", times(way, walk), pull, own=True)
        yield m(SENSOR, "time", "the run's time", walk, 0.0, own=True)

    def _hoist(self) -> Iterator[Port | None]:
        s, m, runs = self.survey, self.made, self.survey.runs
        one: Of = lambda c: np.ones(len(c.time))  # noqa: E731
        way: Of = lambda c: c.way  # noqa: E731
        u, g = self.u, s.gravity
        mass: Of = lambda c: c.mass * (1.0 + c.acceleration / g)  # noqa: E731
        load: Of = lambda c: c.payload * (1.0 + c.acceleration / g)  # noqa: E731
        carried: Of = lambda c: c.carried  # noqa: E731
        heaviest = max(self.loads)
        # Guide: turns over with the way, whatever hangs there.
        yield from self._rubbing("guide", 1.0, 0.1)
        yield m("guide", "speed", "the speed squared", self.squared(0.0), 1.0, 0.2, True)
        yield m("guide", "speed", "the speed squared", self.squared(0.2), 1.0, 0.2)
        yield m("guide", "load", "the payload", lambda c: c.way * c.payload, 1.0, 1.0, True)
        yield m("guide", "load", "the payload, each way", self.ways(lambda c: c.way * c.payload), 1.0, 0.5)
        for length in (0.03, 0.1, 0.3):
            yield m("guide", "position", "the height", times(way, self.along(length)), 1.0, 0.33)
            yield m("guide", "position", "the height, each way", self.ways(times(way, self.along(length))), 1.0, 0.2)
        span = self.high - self.low
        periods = np.arange(4.0, 6.0 * span / 0.25) / (6.0 * span)
        yield from self.waves("guide", "periodic", "the height", periods, lambda c: c.position, way, 1.0, False)
        yield from self._over_time("guide", 1.0, 1.5)
        # Motor.
        # Air around what turns fast: nothing else in a hoist moves fast enough for its drag to tell.
        yield m("motor", "speed", "the speed squared", self.squared(0.0), 0.0, 0.8, True)
        yield m("motor", "speed", "the speed squared", self.squared(0.2), 0.0, 0.8)
        yield m("motor", "speed", "the speed", lambda c: c.way * u(c), 0.0, 0.15, True)
        for order in range(1, 13):
            yield m("motor", "periodic", "the motor's angle", self.turning("motor", order, one), 0.0, 1 / 12, own=True)
        # Gearbox: what it transmits.
        loss: Of = lambda c: np.abs(c.carried) * np.clip(c.way, -1.0, 1.0)  # noqa: E731
        yield m("gearbox", "load", "the torque transmitted", loss, 0.0, 1.0, True)
        yield m("gearbox", "load", "the torque transmitted, each way", self.ways(loss), 0.0, 0.5)
        yield m("gearbox", "acceleration", "the motor's acceleration", lambda c: c.turn_acceleration, 0.0)
        for order in (1, 2, 3):
            tooth = self.turning("drum", order, way)
            yield m("gearbox", "periodic", "the drum's angle", tooth, 0.0, 0.2)
        teeth: Of = lambda c: np.hstack([self.turning("drum", k, way)(c) for k in range(1, 5)])  # noqa: E731
        yield m("gearbox", "periodic", "the drum's angle", teeth, 0.0, 0.4)
        # Brake: lets go late.
        for tau in (0.3, 0.7, 1.5, 3.0):
            yield m("brake", "start", "the time since the start", _late(tau), 0.0, 0.25, True)
        # Drum: the arm of what hangs.
        for length in (0.05, 0.15, 0.5):
            yield m("drum", "position", "the height", times(carried, self.along(length)), 0.0, 0.33)
        for order in (1, 2, 3):
            yield m(
                "drum",
                "periodic",
                "the drum's angle",
                self.turning("drum", order, carried),
                0.0,
                (0.7, 0.2, 0.1)[order - 1],
            )
        # Wire: weight by height.
        for length in (0.15, 0.5, 1.5):
            yield m("wire", "position", "the height", self.along(length), 1.0, 0.33)
        yield m("wire", "position", "the height", lambda c: c.position, 1.0, 0.5)
        # Sheave.
        for order in (1, 2):
            yield m("sheave", "periodic", "the sheave's angle", self.turning("sheave", order, carried), -1.0, 0.4)
            yield m("sheave", "periodic", "the sheave's angle", self.turning("sheave", order, way), -1.0, 0.2)
        # Payload.
        yield m("payload", "load", "the payload", load, 1.0)
        if len(self.loads) > 2:
            loads: Of = lambda c: load(c)[:, None] * np.array([[float(c.payload == p) for p in self.loads]])  # noqa: E731
            yield m("payload", "load", "each payload", loads, 1.0, 0.5)
        yield m("payload", "all", "a weight", lambda c: 1.0 + c.acceleration / g, 1.0)
        for hz in np.geomspace(0.2, 0.95 * s.band_hz, 16):
            for damping in (0.02, 0.06):
                swing = self.swinging(float(hz), damping, heaviest)
                yield m("payload", "acceleration", "its own swinging", swing, 1.0, 1 / 32, True)
        # Platform: moves all that hangs.
        longest = max(float(np.ptp(c.time)) for c in runs)
        hz = np.arange(6.0, 3.0 * longest * s.band_hz) / (3.0 * longest)
        yield from self.waves("platform", "time", "a wave in time", hz, lambda c: c.time, mass, 1.0, True)
        for low, high in ((0.05, 0.15), (0.1, 0.3)):
            yield m("platform", "time", "a swell", times(mass, self.swell(low, high, longest)), 1.0, 0.25, own=True)
        yield from self._sensors()

    def _axis(self) -> Iterator[Port | None]:
        s, m, runs, u = self.survey, self.made, self.survey.runs, self.u
        one: Of = lambda c: np.ones(len(c.time))  # noqa: E731
        way: Of = lambda c: c.way  # noqa: E731
        yield from self._rubbing("axis", 0.0, 0.25)
        yield m("axis", "speed", "the speed squared", lambda c: c.way * u(c) ** 2, 0.0, 0.5, True)
        yield m("axis", "load", "the load", lambda c: c.way * np.abs(c.carried), 0.0, 1.0, True)
        yield m("axis", "acceleration", "the acceleration", lambda c: c.acceleration)
        for length in (0.03, 0.1, 0.3):
            along = self.along(length)
            yield m("axis", "position", "the position", along, 0.0, 0.33)
            yield m("axis", "position", "the position, rubbing", times(way, along), 0.0, 0.33)
        span = self.high - self.low
        for share in (0.001, 0.004, 0.016):
            yield m("axis", "start", "the way since a reversal", _fresh(share * span), 0.0, 0.33)
        waves = np.arange(2.0, 3.0 * 60.0) / (3.0 * span)
        yield from self.waves("axis", "periodic", "the position", waves, lambda c: c.position, way, 0.0, False)
        yield from self.waves("motor", "periodic", "the position", waves, lambda c: c.position, one, 0.0, False)
        longest = max(float(np.ptp(c.time)) for c in runs)
        yield from self._over_time("axis", 0.0, longest / 33.0)
        for hz in np.geomspace(4.0 / longest, 0.9 * s.band_hz, 24):
            for damping in (0.02, 0.06):
                yield m(
                    "axis", "acceleration", "its own swinging", _swing(TURN * float(hz), damping), 0.0, 1 / 48, True
                )
        yield from self._sensors()

    def _sensors(self) -> Iterator[Port | None]:
        """Errors of the sensors, which no force causes."""
        m, runs = self.made, self.survey.runs
        torque: Of = lambda c: c.torque  # noqa: E731
        yield m("torque_sensor", "all", "the torque", torque)
        yield m("torque_sensor", "all", "nothing", lambda c: np.ones(len(c.time)))
        yield m("torque_sensor", "load", "the torque, each way", self.ways(torque))
        most = max(float(np.max(c.torque)) for c in runs)
        least = min(float(np.min(c.torque)) for c in runs)
        for length in (0.2, 0.5):
            yield m("torque_sensor", "load", "the torque", self.curve(torque, least, most, length), 0.0, 0.5)
        yield m("torque_sensor", "acceleration", "the torque's change", lambda c: -slope(c.torque, c), 0.0, 1.0, True)
        for share in (0.01, 0.02, 0.04, 0.08):
            yield m("torque_sensor", "all", "a dead band", _kept(share * max(most, -least)), 0.0, 0.25, True)
        yield m("speed_sensor", "acceleration", "the torque's change", lambda c: slope(c.torque, c), 0.0, 1.0, True)


def _late(tau_s: float) -> Of:
    return lambda c: c.way * np.exp(-c.since_start / tau_s)


def _fresh(distance: float) -> Of:
    return lambda c: c.way * np.exp(-since_reversal(c) / distance)


def _swing(w: float, damping: float) -> Of:
    return lambda c: lag(c.acceleration, c, w, damping)


def _kept(band: float) -> Of:
    return lambda c: play(c.torque, band) - c.torque


def slope(x: Array, c: Course) -> Array:
    return np.gradient(x, c.time)


def times(carrier: Of, of: Of) -> Of:
    """A function carried by a series."""
    return lambda c: _columns(of(c)) * carrier(c)[:, None]


def _columns(x: Array) -> Array:
    return x[:, None] if x.ndim == 1 else x


def _root(knots: Array, length: float) -> Array:
    """(k, k) a root of the covariance exp(−d²/2l²) between knots."""
    away = (knots[:, None] - knots) / length
    value, vector = np.linalg.eigh(np.exp(-0.5 * away**2))
    kept = value > 1e-6 * value[-1]
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]), dtype=float)


def hats(x: Array, knots: Array) -> Array:
    """(n, k) linear between even knots, the end ones beyond."""
    at = np.clip((x - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
    return np.maximum(1.0 - np.abs(at[:, None] - np.arange(len(knots))), 0.0)


def play(x: Array, band: float) -> Array:
    """The output of a sensor that keeps its last value until x has left a band around it."""
    out, last = np.empty_like(x), float(x[0])
    for i, value in enumerate(x):
        if abs(value - last) > band:
            last = float(value)
        out[i] = last
    return out


def lag(acceleration: Array, c: Course, w: float, damping: float) -> Array:
    """The force of a sprung mass on its support beyond that of a fixed one, over its mass, m/s²:
    −s²/(s² + 2ζws + w²) a."""
    n = 2 * len(acceleration)
    iw = TURN * 1j * np.fft.rfftfreq(n, float(np.median(np.diff(c.time))))
    gain = -(iw**2) / (iw**2 + 2.0 * damping * w * iw + w * w)
    return np.asarray(np.fft.irfft(gain * np.fft.rfft(acceleration, n), n)[: len(acceleration)], dtype=float)
