"""What the log shows of the truth: functions of whole series, each with its inverse.

s.time_s and s.value are (n,); time rises. They act on the log alone: the machine and its
speed loop live on the true signals.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.effects.declare import Parameter, amount, effect

TORQUE = {"hoist": "torque_sensor", "axis": "torque_sensor"}
SPEED = {"hoist": "speed_sensor", "axis": "speed_sensor"}
READS = {"value": "the true series, (n,)", "time_s": "its times, s, (n,)"}


def _unscaled(s: Any, e: Any, p: Any) -> Array:
    return np.asarray(s.value / e.gain)


@effect(
    place=TORQUE, subsystem="torque_sensor", regime="all",
    parameters=[
        Parameter("gain", "gain", "logged over true", "1", 0.3, 3.0, 0.02, 1.03, vanishes_at=1.0, domain="positive"),
    ],
    reads=READS,
    equation="logged = gain · true",
    reference="formats: logged = gain · true + offset",
    shows="a residual in proportion to the torque itself",
    inverse=_unscaled,
)  # fmt: skip
def torque_scale(s: Any, e: Any, p: Any) -> Array:
    """The logged torque is off by a factor."""
    return np.asarray(e.gain * s.value)


def _without_offset(s: Any, e: Any, p: Any) -> Array:
    return np.asarray(s.value - e.offset)


@effect(
    place=TORQUE, subsystem="torque_sensor", regime="all",
    parameters=[
        Parameter("offset", "offset_{input}", "logged less true", "torque", -0.5, 0.5, 0.01, 0.02, vanishes_at=0.0),
    ],
    reads=READS,
    equation="logged = true + offset",
    reference="formats: logged = gain · true + offset",
    shows="a constant residual; alike with an error of the carriage's mass in motor signals alone",
    inverse=_without_offset,
)  # fmt: skip
def torque_offset(s: Any, e: Any, p: Any) -> Array:
    """The logged torque is off by a constant."""
    return np.asarray(s.value + e.offset)


def _sharpened(s: Any, e: Any, p: Any) -> Array:
    """The lag undone: true = logged + tau d(logged)/dt; noise grows with it."""
    return np.asarray(s.value + e.tau * np.gradient(s.value, s.time_s)) if e.tau else s.value


@effect(
    place=TORQUE, subsystem="torque_sensor", regime="acceleration",
    parameters=[
        amount(
            "tau", "time_constant_s", "of the first-order low-pass", "1", 2.0, 0.02, 0.1, tries=(0.02, 0.05, 0.1, 0.3)
        ),
    ],
    reads=READS,
    equation="τ d(logged)/dt = true − logged, exact for a true torque that is linear between samples",
    reference="A. V. Oppenheim, A. S. Willsky, Signals and Systems, 1997, section 6.5",
    shows="a residual in proportion to the rate of the torque, at starts, stops and load changes",
    inverse=_sharpened,
)  # fmt: skip
def torque_filter(s: Any, e: Any, p: Any) -> Array:
    """The logged torque is low-passed."""
    if not e.tau:
        return np.asarray(s.value)
    u, step = s.value, np.diff(s.time_s)
    left = np.exp(-step / e.tau)
    slope = e.tau * np.diff(u) / step
    # y - u, the lag's distance from the truth, decays and is fed by the slope: d1 = left d0 - slope (1 - left).
    return np.asarray(u + _recursion(left, -slope * (1.0 - left)))


def _recursion(left: Array, added: Array) -> Array:
    """d[0] = 0, d[k + 1] = left[k] d[k] + added[k]: forward substitution in a matrix of two diagonals."""
    from scipy.linalg.lapack import dtbtrs

    diagonals = np.vstack([np.ones(len(left) + 1), np.append(-left, 0.0)])
    d, _ = dtbtrs(diagonals, np.concatenate([[0.0], added])[:, None], uplo="L", diag="U")
    return np.asarray(d[:, 0])


def _early(s: Any, e: Any, p: Any) -> Array:
    return np.interp(s.time_s + e.delay, s.time_s, s.value)


@effect(
    place=SPEED, subsystem="speed_sensor", regime="acceleration",
    parameters=[amount("delay", "delay_s", "logged after true", "1", 1.0, 0.01, 0.05, tries=(0.05, 0.1, 0.2, 0.4))],
    reads=READS,
    equation="logged(t) = true(t − delay), linear between samples",
    reference="a bus or a filter between encoder and log",
    shows="torque that leads the motion it makes; the logged speed against its reference is late too",
    inverse=_early,
)  # fmt: skip
def speed_delay(s: Any, e: Any, p: Any) -> Array:
    """The logged speed is late."""
    return np.interp(s.time_s - e.delay, s.time_s, s.value)
