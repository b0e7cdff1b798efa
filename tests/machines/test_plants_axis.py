"""The axis, linear and rotary, against closed forms of mechanics."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.special
from hypothesis import strategies as st

from workbench.core.run import Array
from workbench.engine import kernels
from workbench.machines import PLANTS, Plant

LINEAR, ROTARY = PLANTS["axis-linear"], PLANTS["axis-rotary"]
BOTH = pytest.mark.parametrize("plant", [LINEAR, ROTARY], ids=["linear", "rotary"])
FREE = {"M": 95.0, "B": 0.0, "F_f": 0.0, "F_b": 0.0, "v_s": 1e-4, "G": 0.0, "C": 0.0}


def move(
    plant: Plant, changes: dict[str, float], end_s: float, start: tuple[float, float] = (0.0, 0.0), u: float = 0.0
) -> tuple[Array, Array, Array]:
    """Time, position and speed of an axis under a constant input."""
    p = {**FREE, **changes}
    times = np.linspace(0.0, end_s, 1001)
    out = kernels.replay(
        plant,
        np.array([[p[name]] for name in plant.parameters]),
        times[:, None],
        np.full((1001, 1), u),
        np.array(start)[:, None],
        np.array([[1.0]]),
    )[:, :, 0]
    return times, out[:, 0], out[:, 1]


@BOTH
def test_an_axis_falls_freely_under_its_constant_load(plant):
    t, x, v = move(plant, {"C": 300.0}, 2.0)
    assert v == pytest.approx(-300.0 / 95.0 * t, abs=1e-9)
    assert x == pytest.approx(-300.0 / 95.0 * t**2 / 2.0, abs=1e-9)


@BOTH
def test_viscous_friction_lets_the_speed_decay_with_inertia_over_friction(plant):
    t, x, v = move(plant, {"B": 203.5}, 2.0, start=(0.0, 1.0))
    tau = 95.0 / 203.5
    assert v == pytest.approx(np.exp(-t / tau), abs=2e-6)
    assert x == pytest.approx(tau * (1.0 - np.exp(-t / tau)), abs=2e-6)


@BOTH
@pytest.mark.parametrize("way", [1.0, -1.0], ids=["forward", "backward"])
def test_a_driven_axis_ends_at_its_terminal_speed(plant, way):
    changes = {"B": 200.0, "F_f": 20.0, "F_b": 35.0, "C": 10.0}
    _, _, v = move(plant, changes, 10.0, u=way * 250.0)
    assert v[-1] == pytest.approx(
        (250.0 - 20.0 - 10.0) / 200.0 if way > 0 else -(250.0 - 35.0 + 10.0) / 200.0, abs=1e-6
    )


@pytest.mark.parametrize(("speed", "level"), [(0.8, "F_f"), (-0.8, "F_b")])
@BOTH
def test_coulomb_friction_stops_a_coasting_axis_within_its_closed_form(plant, speed, level):
    levels = {"F_f": 20.0, "F_b": 35.0}
    _, x, v = move(plant, levels, 6.0, start=(0.0, speed))
    # Within the standstill speed the force is linear: 1e-4 m/s covers v_s^2 M / F more.
    assert x[-1] == pytest.approx(math.copysign(speed**2 * 95.0 / (2.0 * levels[level]), speed), rel=1e-5)
    assert v[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("amplitude_rad", [0.01, 1.0, 2.5])
def test_a_sine_load_swings_with_the_period_of_a_pendulum(amplitude_rad):
    t, x, _ = move(ROTARY, {"M": 2.0, "G": 30.0}, 8.0, start=(amplitude_rad, 0.0))
    crossings = np.flatnonzero(np.diff(np.sign(x)))
    at = t[crossings] - x[crossings] * (t[crossings + 1] - t[crossings]) / (x[crossings + 1] - x[crossings])
    period = 4.0 * math.sqrt(2.0 / 30.0) * scipy.special.ellipk(math.sin(amplitude_rad / 2.0) ** 2)
    assert 2.0 * np.diff(at) == pytest.approx(period, rel=1e-4)
    assert np.max(np.abs(x)) <= amplitude_rad * (1.0 + 1e-6)  # no energy comes in


parameters = st.builds(
    lambda *v: SimpleNamespace(**dict(zip(FREE, v, strict=True))),
    *(st.floats(0.1, 100.0), *(st.floats(0.0, 50.0) for _ in range(3)), st.floats(1e-4, 0.1)),
    *(st.floats(-30.0, 30.0) for _ in range(2)),
)
