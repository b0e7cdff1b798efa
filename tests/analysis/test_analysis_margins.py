"""Margins against a brute grid, against python-control, and against what they promise: where the loop falls over."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OperatingPoint
from workbench.analysis.loop import LinearLoop, linear_loop
from workbench.analysis.margins import margins
from workbench.control import Notch, PiSettings
from workbench.machines import Effects, Hoist, with_values

PI = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)


def with_drive(base: Hoist | None = None, **drive: float) -> Hoist:
    return with_values(base or ideal_hoist(), {f"drive.{key}": value for key, value in drive.items()})


SLOW_DRIVE = with_drive(torque_lag_s=0.004, speed_filter_s=0.003, speed_delay_s=0.0025)
LIGHTLY_DAMPED = with_values(ideal_hoist(), {"wire.damping_time_s": 0.004})
# name -> arguments of `linear_loop`
LOOPS = {
    "ideal drive": (ideal_hoist(), PI, OperatingPoint(0.0, 10.0)),
    "slow drive": (SLOW_DRIVE, PI, OperatingPoint(9000.0, 2.0, "lowering")),
    "fast gains": (
        SLOW_DRIVE,
        PiSettings(sample_time_s=0.002, kp_nm_s_per_rad=90.0, ki_nm_per_rad=900.0),
        OperatingPoint(4500.0, 20.0),
    ),
    "at rest": (SLOW_DRIVE, PI, OperatingPoint(9000.0, 10.0, "at_rest")),
    "light damping": (LIGHTLY_DAMPED, PI, OperatingPoint(9000.0, 10.0)),
    "notch": (
        with_drive(LIGHTLY_DAMPED, speed_delay_s=0.004),
        PiSettings(
            kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, notch=Notch(frequency_hz=2.2, depth=0.3), low_pass_hz=80.0
        ),
        OperatingPoint(9000.0, 10.0),
    ),
}


@cache
def made_loop(name: str) -> LinearLoop:
    return linear_loop(*LOOPS[name])


@pytest.fixture
def loop(request: pytest.FixtureRequest) -> LinearLoop:
    return made_loop(request.param)


each_loop = pytest.mark.parametrize("loop", LOOPS, indirect=True)


@each_loop
def test_every_margin_agrees_with_a_dense_grid(loop: LinearLoop):
    computed = margins(loop)
    f = np.unique(np.concatenate([np.geomspace(1e-3, loop.nyquist_hz, 60_000), np.linspace(0.3, 4.0, 20_000)]))
    L = np.concatenate([loop.open_response(part) for part in np.array_split(f, 20)])
    S, T = 1.0 / (1.0 + L), L / (1.0 + L)
    assert computed.ms == pytest.approx(np.abs(S).max(), rel=2e-6)
    assert computed.mt == pytest.approx(np.abs(T).max(), rel=2e-6)
    assert computed.disk == pytest.approx(2.0 / np.abs(S - T).max(), rel=2e-6)
    assert computed.bandwidth_hz == pytest.approx(f[np.argmax(np.abs(T) < math.sqrt(0.5))], rel=4e-4)

    over = np.flatnonzero(np.diff(np.sign(np.log(np.abs(L)))) != 0)
    lag = np.degrees(np.angle(-L[over])) % 360.0
    assert computed.phase_deg == pytest.approx(np.minimum(lag, 360.0 - lag).min(), abs=0.05)
    assert computed.delay_s == pytest.approx((lag / 360.0 / f[over]).min(), rel=1e-3)

    axis = np.flatnonzero(np.diff(np.sign(L.imag[:-1])) != 0)
    gains = [-1.0 / L[k].real for k in [*axis, len(f) - 1] if L[k].real < 0.0]
    assert computed.gain_up == pytest.approx(min((g for g in gains if g >= 1.0), default=math.inf), rel=1e-3)
    assert computed.gain_down == pytest.approx(max((g for g in gains if g < 1.0), default=0.0), rel=1e-3)


def with_gain(loop: LinearLoop, factor: float) -> LinearLoop:
    controller = replace(loop.controller, C=loop.controller.C * factor, D=loop.controller.D * factor)
    return replace(loop, controller=controller)


@each_loop
def test_the_loop_falls_over_at_its_gain_margin_and_not_before(loop: LinearLoop):
    computed = margins(loop)
    assert computed.stable
    if math.isfinite(computed.gain_up):
        assert with_gain(loop, 0.999 * computed.gain_up).stable
        assert not with_gain(loop, 1.001 * computed.gain_up).stable
    if computed.gain_down > 0.0:
        assert not with_gain(loop, 0.999 * computed.gain_down).stable
    assert with_gain(loop, max(1.001 * computed.gain_down, 1e-3)).stable


@pytest.mark.parametrize("payload", [0.0, 9000.0])
def test_the_loop_falls_over_at_its_delay_margin_and_not_before(payload: float):
    point = OperatingPoint(payload, 10.0)
    margin = margins(linear_loop(SLOW_DRIVE, PI, point)).delay_s
    more = SLOW_DRIVE.drive.speed_delay_s + margin
    for factor, stable in ((0.985, True), (1.015, False)):
        # Whole samples: between two of them the interpolation takes amplitude too.
        late = round(more * factor, 3)
        assert linear_loop(with_drive(SLOW_DRIVE, speed_delay_s=late), PI, point).stable is stable


def test_a_machine_that_runs_away_has_a_lower_gain_margin_and_falls_over_there():
    pushing = Effects({"guide_force_n": [lambda s, p: 2e5 * s.v]})  # friction of the wrong sign
    loop = linear_loop(SLOW_DRIVE, PI, OperatingPoint(9000.0, 10.0), effects=pushing)
    assert np.abs(loop.plant.poles()).max() > 1.0
    computed = margins(loop)
    assert 0.0 < computed.gain_down < 1.0
    assert with_gain(loop, 1.001 * computed.gain_down).stable
    assert not with_gain(loop, 0.999 * computed.gain_down).stable


@each_loop
def test_python_controls_systems_are_the_same_loop(loop: LinearLoop):
    L, S, closed = loop.systems()
    f = np.geomspace(0.05, 0.99 * loop.nyquist_hz, 40)
    z = np.exp(2j * np.pi * f * loop.dt)
    np.testing.assert_allclose(L(z), loop.open_response(f), rtol=1e-6)
    np.testing.assert_allclose(S(z), loop.responses(f).S, rtol=1e-6)
    assert closed.dt == loop.dt
    ours, theirs = np.sort(np.abs(loop.poles())), np.sort(np.abs(closed.poles()))
    np.testing.assert_allclose(ours, theirs, atol=1e-7)
