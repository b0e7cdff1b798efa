"""Laws over the whole library: off is bit for bit the plain plant, friction dissipates, what hangs is at rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.effect_machines import MACHINES
from workbench.control import PiSettings
from workbench.core.run import Array
from workbench.effects import effects_for, find, library_effects, of, ranges_of, searchable
from workbench.effects.active import Active
from workbench.effects.declare import KINDS, Effect
from workbench.engine import kernels
from workbench.engine.native import load_functions
from workbench.engine.preamble import PREAMBLE
from workbench.machines import HOIST, PLANTS, with_values
from workbench.simulate.loop import LoopCase, LoopResult, PlantModel, simulate_loop

HEIGHT = {"hoist": 9.0, "axis-linear": 0.1, "axis-rotary": 0.4, "two_inertia": 0.4, "slew_boom": 0.4}
SPEED = {"hoist": 60.0, "axis-linear": 0.2, "axis-rotary": 2.0, "two_inertia": 2.0, "slew_boom": 0.05}


def shaped(kind: str, seed: int) -> dict[str, float]:
    """The library switched off, with any shape: widths, phases and time constants drawn within their bounds."""
    rng = np.random.default_rng(seed)
    active = searchable(MACHINES[kind])
    drawn = dict(active.values_of(float(rng.uniform(0.0, 500.0))))
    for name in effects_for(kind):
        for amount in ranges_of(find(name, kind), MACHINES[kind]):
            if amount.vanishes_at is None and amount.symbol in drawn:
                drawn[amount.symbol] = float(rng.uniform(amount.lowest, amount.highest))
    return drawn


def lanes(kind: str, many: int, off: bool) -> tuple[PlantModel, list[SimpleNamespace]]:
    machine = MACHINES[kind]
    model = PlantModel(PLANTS[kind], searchable(machine) if off else Active(kind))
    payloads = [1000.0 * (j % 9) for j in range(many)]
    plain = [PLANTS[kind].values(machine, payload) for payload in payloads]
    return model, [SimpleNamespace(**vars(p), **(shaped(kind, j) if off else {})) for j, p in enumerate(plain)]


def replayed(kind: str, many: int, off: bool) -> Array:
    model, values = lanes(kind, many, off)
    start, hold = model.starts([HEIGHT[kind]] * many, [0.0] * many, [0.0] * many, values)
    t = np.arange(400) * 0.01
    swing = 40.0 * np.sin(2.0 * t) + 15.0 * np.sign(np.sin(5.0 * t))
    u = hold + swing[:, None]
    out = kernels.replay(
        model.plant, model.table(values), np.tile(t[:, None], many), u, start, model.scales(SPEED[kind], values),
        effects=model.effects,
    )  # fmt: skip
    return out[:, : 2 * len(model.plant.positions)]


def driven(kind: str, many: int, off: bool) -> Array:
    model, values = lanes(kind, many, off)
    start, _ = model.starts([HEIGHT[kind]] * many, [0.0] * many, [0.0] * many, values)
    t = np.linspace(0.0, 3.99, 400)
    w = SPEED[kind] * np.sin(1.5 * t)
    angle, a = np.cumsum(w) * 0.01, np.gradient(w, t)
    n = len(model.plant.positions)

    def wide(series: Any) -> Array:
        return np.tile(np.asarray(series, dtype=float)[:, None], many)

    out = kernels.driven(
        model.plant, model.table(values), wide(t), wide(angle) + start[0], wide(w), wide(a),
        np.concatenate([start[1:n], start[n + 1 :]]), model.scales(SPEED[kind], values), effects=model.effects,
    )  # fmt: skip
    return out[:, : 2 * n - 1]


@pytest.mark.parametrize("many", [1, 16])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("simulate", [replayed, driven])
def test_switched_off_the_whole_library_leaves_the_plant_bit_for_bit(simulate, kind, many):
    """An axis to its last bits: a law of play makes its inertia no constant, which is rounded in another order; and so
    is a boom's with its payload."""
    plain, off = simulate(kind, many, False), simulate(kind, many, True)
    assert np.all(np.isfinite(plain))
    last_bits = 100.0 * np.finfo(float).eps * np.max(np.abs(plain)) if kind.startswith(("axis", "slew")) else 0.0
    assert np.max(np.abs(plain - off)) <= last_bits
    assert np.ptp(plain[:, 0]) > 0.0


@pytest.mark.parametrize("many", [1, 16])
def test_switched_off_the_whole_library_leaves_the_closed_loop_bit_for_bit(many):
    plain = MACHINES["hoist"]
    off = plain.model_copy(update={"effects": {"friction_viscous": {"viscous_n_s_per_m": 0.0}}})
    speed = 50.0 * np.clip(np.arange(3000) * 0.001 - 0.2, 0.0, 1.0)
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)

    def looped(machine: Any) -> list[LoopResult]:
        return simulate_loop(
            [LoopCase(f"{j}", machine, 500.0 * j, 9.0, settings, speed) for j in range(many)], record_every=1
        )

    for a, b in zip(looped(plain), looped(off), strict=True):
        assert a.run["speed_motor_rad_s"][-1] > 49.0
        assert all(np.array_equal(a.run[name], b.run[name]) for name in a.run.signals)
        assert a.metrics == b.metrics


DISSIPATIVE = [(kind, name) for kind in KINDS for name, effect in effects_for(kind).items() if effect.dissipative]


@pytest.mark.parametrize(("kind", "name"), DISSIPATIVE)
def test_what_is_called_dissipative_only_ever_takes_energy(kind, name):
    effect = find(name, kind)
    rng = np.random.default_rng(5)
    p = SimpleNamespace(**vars(PLANTS[kind].values(MACHINES[kind])), start_time_s=0.0)
    lost = []
    for _ in range(300):
        v = float(rng.normal(0.0, rng.choice([0.001, 0.05, 1.0])))
        s = SimpleNamespace(
            t=rng.uniform(0.0, 400.0), v=v, w=v, x=rng.uniform(0.0, 25.0), load=rng.normal(0.0, 1e4),
            switch=float(np.clip(v / 0.01, -1.0, 1.0)), friction=2000.0 * np.clip(v / 0.01, -1.0, 1.0),
        )  # fmt: skip
        e = SimpleNamespace(**drawn_size(effect, kind, rng), z=rng.uniform(0.0, 100.0))
        lost.append(effect.function(s, e, p) * v)
    assert max(lost) <= 0.0 and min(lost) < 0.0


def drawn_size(effect: Effect, kind: str, rng: np.random.Generator) -> dict[str, float]:
    values = {}
    for parameter, on in zip(effect.parameters, ranges_of(effect, MACHINES[kind]), strict=True):
        lowest = on.lowest if on.vanishes_at is None else on.vanishes_at
        values[parameter.symbol] = float(rng.uniform(lowest, on.highest))
    return values


def at_start(name: str, kind: str) -> dict[str, float]:
    return {amount.name: amount.start for amount in ranges_of(find(name, kind), MACHINES[kind])}


@pytest.mark.parametrize("name", [name for name, effect in effects_for("hoist").items() if not effect.on_sensor])
def test_with_any_effect_a_load_that_is_held_hangs_still(name):
    machine = MACHINES["hoist"]
    model = PlantModel(HOIST.plant, of(machine, {name: at_start(name, "hoist")}))
    values = [model.values(machine, payload, 0.0) for payload in (0.0, 9000.0)]
    start, hold = model.starts([3.0, 18.0], [0.0, 0.0], [0.0, 0.0], values)
    t = np.array([[0.0, 0.0], [0.001, 0.001]])
    scales = model.scales(157.0, values)
    out = kernels.replay(
        HOIST.plant, model.table(values), t, np.tile(hold, (2, 1)), start, scales, effects=model.effects
    )
    moved = np.abs(out[1, 3:6] - out[0, 3:6]) / 0.001
    assert np.all(moved < (0.05 if name == "heave" else 1e-4))
    assert start[2] == pytest.approx([3.0, 18.0], abs=0.0)


def test_on_a_very_soft_wire_no_step_towards_rest_ends_in_a_slack_one():
    """A fit of the wire's stiffness may try such values; Newton's full step would leave the wire slack."""
    effects = {"wire_stiffness_length": {"share": 1.0}, "drum_eccentricity": {"amplitude_m": 9e-4, "phase_rad": 2.6}}
    machine = with_values(MACHINES["hoist"], {"wire.youngs_modulus_pa": 5e8})
    model = PlantModel(HOIST.plant, of(machine, effects))
    values = [model.values(machine, payload, 0.0) for payload in (0.0, 0.0, 9000.0)]
    start, hold = model.starts([5.0, 18.0, 9.0], [0.0] * 3, [0.0] * 3, values)
    t = np.tile([[0.0], [0.001]], 3)
    scales = model.scales(157.0, values)
    out = kernels.replay(
        HOIST.plant, model.table(values), t, np.tile(hold, (2, 1)), start, scales, effects=model.effects
    )
    assert np.all(np.abs(out[1, 3:6] - out[0, 3:6]) < 1e-6)


def test_every_effect_on_a_sensor_gives_back_what_it_was_given_and_vanishes():
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0.0, 20.0, 2001))
    value = np.sin(time) * 100.0 + 5.0
    for effect in (effect for effect in library_effects() if effect.on_sensor):
        series = SimpleNamespace(time_s=time, value=value)
        on = at_start(effect.id, "hoist")
        e = SimpleNamespace(**{q.symbol: on[q.named("hoist")] for q in effect.parameters})
        shown = effect.function(series, e, None)
        assert not np.allclose(shown, value)
        assert effect.inverse is not None
        back = effect.inverse(SimpleNamespace(time_s=time, value=shown), e, None)
        assert back[100:-100] == pytest.approx(value[100:-100], abs=0.5)
        off = SimpleNamespace(**{q.symbol: q.vanishes_at for q in effect.parameters})
        assert np.array_equal(effect.function(series, off, None), value)
        assert np.array_equal(effect.inverse(series, off, None), value)


@pytest.fixture(scope="module")
def elementary() -> Any:
    """The preamble's sin, cos and exp over arrays, compiled as kernels compile them."""
    text = (
        "def over(x, a, b, c):\n    for i in range(x.shape[0]):\n"
        "        a[i] = sin_(x[i])\n        b[i] = cos_(x[i])\n        c[i] = exp_(x[i])\n    return 0\n"
    )
    compiled = load_functions(PREAMBLE + text, {"over": "aaaa"})["over"]

    def over(x: Array) -> tuple[Array, Array, Array]:
        out = np.empty_like(x), np.empty_like(x), np.empty_like(x)
        compiled(x, *out)
        return out

    return over


def test_sine_cosine_and_exponential_are_right_to_rounding(elementary):
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-1e6, 1e6, 100_000), rng.uniform(-10.0, 10.0, 100_000), [0.0, np.pi, -np.pi / 2.0]])
    sine, cosine, _ = elementary(x)
    assert np.max(np.abs(sine - np.sin(x))) < 4e-16
    assert np.max(np.abs(cosine - np.cos(x))) < 4e-16
    x = np.concatenate([rng.uniform(-708.0, 709.0, 100_000), rng.uniform(-1.0, 1.0, 100_000), [0.0]])
    _, _, power = elementary(x)
    assert np.max(np.abs(power / np.exp(x) - 1.0)) < 6e-16
