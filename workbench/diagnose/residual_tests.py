"""Is anything left? Whether the residual of the delivered machine is white, and with what it correlates, per run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.machines import kind_of
from workbench.simulate.lowpass import lowpass
from workbench.simulate.replay import ReplayResult

UNCORRELATED = 0.05  # of low-passed white noise, from one sample looked at to the next
MOST_LAGS, PER_LAG = 20, 5  # lags, at most one for so many samples
FEWEST = 20  # samples: fewer test nothing
BOUND_95, BOUND_99 = 1.96, 2.576  # standard deviations of a normal distribution, two-sided
ALL_RUNS = "all runs"


@dataclass(frozen=True)
class Correlation:
    """Of the residual with a variable; bounds: what no relation stays below, 95 and 99 % of the time."""

    value: float
    bound_95: float
    bound_99: float


@dataclass(frozen=True)
class ResidualTest:
    """The residual of one run while moving, or of all. lags_s, autocorrelation, bound_95, bound_99: (k,).

    p_white: that white noise shows as much autocorrelation (G. M. Ljung, G. E. P. Box, Biometrika 65, 1978).
    correlations: variable -> its correlation with the residual.
    """

    run: str
    lags_s: Array
    autocorrelation: Array
    bound_95: Array
    bound_99: Array
    p_white: float
    correlations: Mapping[str, Correlation]

    @property
    def white(self) -> bool:
        """At the 99 % level."""
        return not self.p_white < 0.01

    @property
    def related(self) -> tuple[str, ...]:
        """The variables whose correlation lies beyond its 99 % bound."""
        return tuple(name for name, c in self.correlations.items() if abs(c.value) > c.bound_99)


def residual_tests(replay: ReplayResult) -> tuple[ResidualTest, ...]:
    """A test of each run, and one of all runs where there are several; runs that hardly move have none."""
    kind, tests, together = kind_of(replay.machine), [], []
    for run in replay.runs:
        b = run.balance
        stride = independent_stride(b.run.time_s, b.band_hz)
        place = kind.place_of(replay.machine, b.run.start_position_m, b.motion.position)
        variables = {"speed": b.motion.speed, "position": place, "input": b.predicted}
        if kind.payload:
            variables["payload"] = np.full(len(place), b.run.payload_kg)
        rows = np.where(b.moving, 1.0, np.nan)[::stride]
        left, step = b.residual[::stride] * rows, stride * b.run.sample_time_s
        if np.count_nonzero(np.isfinite(left)) < FEWEST:
            continue
        thinned = {name: values[::stride] * rows for name, values in variables.items()}
        together.append((left, thinned, step))
        tests.append(residual_test(run.name, left, thinned, step))
    if len(tests) > 1:
        # A gap as long as the longest lag keeps the runs apart.
        gap = np.full(MOST_LAGS, np.nan)
        joined = np.concatenate([part for left, _, _ in together for part in (left, gap)])
        variables = {
            name: np.concatenate([part for _, thinned, _ in together for part in (thinned[name], gap)])
            for name in together[0][1]
        }
        tests.append(residual_test(ALL_RUNS, joined, variables, float(np.mean([step for *_, step in together]))))
    return tuple(tests)


def residual_test(run: str, left: Array, variables: Mapping[str, Array], step_s: float) -> ResidualTest:
    """left: (n,) samples of a residual that are independent if it is white, NaN where nothing is looked at; variables:
    name -> (n,). Those that do not vary are left out."""
    most = int(min(MOST_LAGS, int(np.count_nonzero(np.isfinite(left))) // PER_LAG))
    r, count = _autocorrelation(left, most)
    from scipy.special import chdtrc

    p = float(chdtrc(most, float(np.sum(count * r**2))))
    spread: Array = np.asarray(np.maximum(count, 1) ** -0.5, dtype=float)
    correlations = {}
    for name, values in variables.items():
        known = np.isfinite(left) & np.isfinite(values)
        a, b = left[known] - np.mean(left[known]), values[known] - np.mean(values[known])
        size = float(np.sqrt((a @ a) * (b @ b)))
        if not np.std(values[known]) > 1e-9 * max(float(np.max(np.abs(values[known]))), 1e-300) or size == 0.0:
            continue
        # Of two series that hang together in time fewer samples count: M. S. Bartlett, J. R. Stat. Soc. 98, 1935.
        own = np.where(known, values - np.mean(values[known]), np.nan)
        inflated = 1.0 + 2.0 * float(np.sum(r * _autocorrelation(own, most)[0]))
        std = float(np.sqrt(max(inflated, 1.0) / len(a)))
        correlations[name] = Correlation(float(a @ b) / size, BOUND_95 * std, BOUND_99 * std)
    lags: Array = step_s * np.arange(1.0, most + 1.0)
    return ResidualTest(run, lags, r, BOUND_95 * spread, BOUND_99 * spread, p, correlations)


def _autocorrelation(x: Array, most: int) -> tuple[Array, np.ndarray]:
    """At lags 1 to `most`, over the pairs of which both are known, and how many there are."""
    power = float(np.nanmean(x**2)) or 1.0
    products = [x[:-k] * x[k:] for k in range(1, most + 1)]
    count = np.array([np.count_nonzero(np.isfinite(p)) for p in products], dtype=int)
    r = [float(np.nansum(p)) / max(n, 1) / power for p, n in zip(products, count, strict=True)]
    return np.array(r), count


def independent_stride(time_s: Array, band_hz: float) -> int:
    """Samples from one to the next at which low-passed white noise is uncorrelated."""
    n = min(len(time_s), 4001)
    impulse = np.zeros(n)
    impulse[n // 2] = 1.0
    response = lowpass(time_s[:n], impulse, band_hz)
    r = np.correlate(response, response, "full")[n - 1 :]
    return max(int(np.argmax(np.abs(r) < UNCORRELATED * r[0])), 1)
