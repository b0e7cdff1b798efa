"""The hoist's equations against a second writing by hand; energy, dissipation, signs and equilibrium."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.support import by_hand
from workbench.machines import PLANTS, default_hoist

HOIST = PLANTS["hoist"]
MACHINE = default_hoist()
PAYLOADS = (0.0, 4500.0, 9000.0)


def values(payload_kg: float = 4500.0) -> SimpleNamespace:
    return HOIST.values(MACHINE, payload_kg)


def rates(s: list[float], T: float, p: SimpleNamespace) -> list[float]:
    """The plant's own equations on a state in one row."""
    return [*s[3:], *HOIST.accelerations(0.0, s[:3], s[3:], T, p)]


def outputs(s: list[float], T: float, p: SimpleNamespace) -> dict[str, float]:
    return dict(HOIST.outputs(0.0, s[:3], s[3:], T, p))


def elongations(s: list[float], p: SimpleNamespace) -> tuple[float, float, float, float]:
    """delta_1, delta_2 and their rates by Eq. 3-6."""
    R, r, i = p.D_w / 2.0, p.D_s / 2.0, 1.0 / p.ratio
    return (R * i * s[0] + r * s[1] - s[2], -r * s[1] - s[2], R * i * s[3] + r * s[4] - s[5], -r * s[4] - s[5])


def dissipation(s: list[float], p: SimpleNamespace) -> float:
    return float(HOIST.dissipation(0.0, s[:3], s[3:], 0.0, p))


def machine(data: st.DataObject) -> SimpleNamespace:
    """A machine of another size, every value drawn around the nominal one."""
    p = values(data.draw(st.sampled_from(PAYLOADS)))
    free = [name for name in vars(p) if name not in ("n_m", "m_p", "L")]
    factors = {name: data.draw(st.floats(0.5, 2.0), label=name) for name in free}
    return SimpleNamespace(**{name: value * factors.get(name, 1.0) for name, value in vars(p).items()})


@st.composite
def states(draw: st.DrawFn, p: SimpleNamespace) -> list[float]:
    """A state with both falls tight, released or slack: height, elongations and all speeds drawn apart."""
    x = draw(st.floats(0.0, 24.0))
    d1, d2 = draw(st.floats(-0.1, 0.2)), draw(st.floats(-0.1, 0.2))
    R, r = p.D_w / 2.0, p.D_s / 2.0
    theta_s = -(d2 + x) / r
    theta_m = (d1 + x - r * theta_s) / R * p.ratio
    small = st.sampled_from([1.0, 1e-3])  # also near standstill, where friction turns over
    v = draw(st.floats(-1.0, 1.0)) * draw(small)
    return [theta_m, theta_s, x, draw(st.floats(-200.0, 200.0)) * draw(small), draw(st.floats(-5.0, 5.0)), v]


@given(st.data(), st.floats(-2000.0, 2000.0))
def test_the_equations_are_those_written_by_hand(data, T):
    p = machine(data)
    s = data.draw(states(p))
    ours, theirs = np.array(rates(s, T, p)), np.array(by_hand.rates(s, T, by_hand.table(p)))
    # Round-off of the large forces that nearly cancel, at the three inertias.
    c = p.tau * p.E * p.A / p.L
    force = 1e6 + c * (abs(s[3]) / p.ratio * p.D_w + abs(s[4]) * p.D_s + abs(s[5]))
    bound = 1e-13 * force * np.array([0, 0, 0, p.D_w / p.ratio / (p.n_m * p.J_m), p.D_s / p.J_s, 1.0 / p.m_c])
    assert np.all(np.abs(ours - theirs) <= bound + 1e-15 * np.abs(theirs))


@given(st.data(), st.floats(-2000.0, 2000.0))
def test_power_in_is_the_rate_of_energy_plus_dissipation_at_every_state(data, T):
    p = machine(data)
    s = data.draw(states(p))
    d1, d2, rate1, rate2 = elongations(s, p)
    assume(min(abs(d1), abs(d2)) > 1e-4)  # the elastic energy has a kink in its second derivative at 0
    direction = np.array(rates(s, T, p))
    size = min(1e-3, 5e-5 / max(abs(rate1), abs(rate2), 1e-9))  # does not reach that kink

    def energy(at: np.ndarray) -> float:
        return float(HOIST.energy(list(at[:3]), list(at[3:]), p))

    # Of degree two between the kinks, so its central difference is exact but for round-off.
    ahead, behind = energy(np.array(s) + size * direction), energy(np.array(s) - size * direction)
    lost = dissipation(s, p)
    round_off = 1e-14 * (abs(ahead) + abs(behind) + 1e6) / size
    assert (ahead - behind) / (2.0 * size) == pytest.approx(
        T * s[3] - lost, abs=round_off + 1e-9 * (lost + abs(T * s[3]))
    )


@given(st.data())
def test_friction_and_wire_take_energy_in_every_branch(data):
    p = machine(data)
    s = data.draw(states(p))
    assert dissipation(s, p) >= 0.0


@pytest.mark.parametrize("payload", PAYLOADS)
def test_a_hanging_load_settles_at_weight_over_stiffness(payload):
    p = values(payload)
    k, line = p.E * p.A / p.L, 7850.0 * p.A * p.g
    q, hold = HOIST.equilibrium(10.0, p)
    d1, d2, _, _ = elongations([*q, 0.0, 0.0, 0.0], p)
    m = p.m_c + payload
    assert d1 == pytest.approx(d2, rel=1e-9)
    assert 2.0 * k * d1 == pytest.approx(m * p.g + 0.5 * line * (2.0 * p.L - p.D_w / 2.0 / p.ratio * q[0]), rel=1e-9)
    assert d1 == pytest.approx((m * p.g + line * 15.0) / (2.0 * k + line), rel=1e-9)
    assert hold == pytest.approx(p.D_w / 2.0 / p.ratio * (k * d1 + 0.5 * line * 15.0), rel=1e-9)


@pytest.mark.parametrize(
    ("payload", "stretch_mm", "hold_nm"), [(0.0, 29.0, 383.5), (4500.0, 45.2, 597.1), (9000.0, 61.5, 810.7)]
)
def test_the_default_machine_holds_its_loads_with_the_figures_of_the_docs(payload, stretch_mm, hold_nm):
    p = values(payload)
    q, hold = HOIST.equilibrium(10.0, p)
    assert hold == pytest.approx(hold_nm, abs=0.06)
    assert 1e3 * elongations([*q, 0.0, 0.0, 0.0], p)[0] == pytest.approx(stretch_mm, abs=0.06)


def even(speed_motor: float, payload: float = 4500.0, height: float = 10.0) -> list[float]:
    q, y, _ = HOIST.start_of(height, speed_motor, values(payload))
    return [*q, *y]


@given(st.floats(0.0, 24.0), st.sampled_from(PAYLOADS), st.floats(-100.0, 100.0))
def test_top_and_bottom_of_a_fall_differ_by_the_weight_of_its_free_length(height, payload, speed):
    p = values(payload)
    s = even(speed, payload, height)
    shown = outputs(s, 0.0, p)
    line = 7850.0 * p.A * p.g
    # The carriage is carried by both bottoms: m (a + g) + friction (Eq. 16).
    carried = (p.m_c + payload) * (shown["acceleration_carriage_m_s2"] + p.g) + shown["force_guide_n"]
    hanging = shown["tension_drum_n"] + shown["tension_dead_line_n"] - carried
    stretch = sum(elongations(s, p)[:2])
    assert hanging == pytest.approx(2.0 * line * (p.L - height) - 0.5 * line * stretch, abs=1e-6)
    assert 0.5 * line * stretch / 2.0 < 0.85  # N a fall: nothing


def test_a_slack_fall_shows_no_elastic_tension_and_only_its_own_weight_at_the_top():
    p = values()
    s = even(0.0)
    slack = [s[0] - 3.0 * p.ratio, *s[1:]]  # three radians of drum paid out: fall 1 is slack
    shown = outputs(slack, 0.0, p)
    assert shown["tension_min_n"] == 0.0
    assert shown["tension_drum_n"] == pytest.approx(0.5 * 7850.0 * p.A * p.g * (p.L - 10.0))
