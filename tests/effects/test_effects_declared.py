"""Effects as they are declared, open to a user's own; the measured correction in every command."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from tests.support.effect_machines import MACHINES
from tests.support.ideal import ideal_hoist
from tests.support.simulated_campaign import simulated_campaign
from workbench.control import PiSettings
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.core.yaml_strict import loads
from workbench.effects import (
    Effect,
    Parameter,
    effect,
    effects_for,
    find,
    forget_users,
    library_effects,
    load_effects,
    names,
    of,
    ranges_of,
)
from workbench.effects.declare import KINDS, problems
from workbench.machines import (
    Axis,
    Hoist,
    default_hoist,
    kind_of,
    load_machine,
    machine_from,
    machine_text,
    plant_of,
    save_machine,
    with_correction,
)
from workbench.simulate.loop import LoopCase, LoopResult, plant_model, simulate_loop

# The names that others rely on; see docs/formats.md.
NAMES = [
    "friction_viscous", "friction_viscous_asymmetric", "friction_coulomb", "friction_coulomb_asymmetric",
    "friction_stribeck", "friction_load_dependent", "friction_position_dependent", "friction_thermal_drift",
    "gearbox_efficiency", "gearbox_inertia", "inertia_error", "brake_drag", "drum_layer_change",
    "drum_eccentricity", "wire_mass", "wire_stiffness_length", "heave", "carriage_mass_error", "payload_mass_error",
    "torque_scale", "torque_offset", "torque_filter", "speed_delay", "torque_ripple", "backlash", "presliding",
]  # fmt: skip
AXIS_ONLY = {"inertia_error", "presliding"}
MORE = {"coupling_compliance", "load_inertia_error"}  # of two inertias, beside the names that the formats list
UNITS = re.compile(
    r"_(n|nm|m|rad|kg|s|kg_m2|kg_per_m|n_s_per_m|nm_s_per_rad|m_s|rad_s|nm_s2|n_s2_per_m2|nm_s2_per_rad2)$"
)
WITHOUT_UNIT = re.compile(r"(^gain|_fraction|share|_scale|_per_turn)$")


EVERY = [(kind, name) for kind in KINDS for name in effects_for(kind)]


@pytest.fixture(autouse=True)
def no_effects_of_users():
    yield
    forget_users()


def test_every_name_of_the_formats_is_an_effect_and_acts_where_it_makes_sense():
    assert set(NAMES) <= set(names())
    assert set(NAMES) - AXIS_ONLY <= set(names("hoist"))
    assert AXIS_ONLY | {"friction_viscous", "backlash", "torque_scale"} <= set(names("axis-linear"))
    assert {effect.id for effect in library_effects() if effect.listed} == set(NAMES) | MORE


@pytest.mark.parametrize("effect", library_effects(), ids=lambda effect: f"{effect.id}-{effect.kinds[0]}")
def test_a_declaration_is_whole(effect: Effect):
    assert problems(effect) == []
    assert effect.meaning.endswith(".") and effect.kinds
    for kind in effect.kinds:
        for parameter in effect.parameters:
            name = parameter.named(kind)
            assert UNITS.search(name) or WITHOUT_UNIT.search(name), f"{name} has no unit"


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_bounds_scale_and_start_grow_with_the_machine(kind, name):
    machine = MACHINES[kind]
    for amount in ranges_of(find(name, kind), machine):
        assert amount.lowest <= amount.start <= amount.highest and amount.scale > 0.0
        assert amount.symbol == f"{name}__{amount.name}"


def test_a_ripple_has_one_phase_in_all_runs_that_log_where_they_are():
    """Else its own in each: a hoist's start height, and an axis that logs speeds, leave the motor's angle open."""
    t = np.linspace(0.0, 1.0, 5)
    placed, moved = ([Run("a", t, {name: 9.0 * t, "torque_nm": t})] * 2 for name in ("angle_rad", "speed_rad_s"))
    for kind, runs, own in (
        ("axis-rotary", placed, False), ("axis-rotary", moved, True), ("axis-rotary", [placed[0], moved[1]], True),
        ("axis-rotary", [], True), ("hoist", [], True),
    ):  # fmt: skip
        ranges = ranges_of(find("torque_ripple", kind), MACHINES[kind], runs)
        assert [r.per_run for r in ranges if r.scan == "phase"] == [own], (kind, runs)


@pytest.mark.parametrize("step_s", [0.001, 0.01, 0.03])
def test_a_tight_stretch_is_as_wide_as_the_samples_show_it(step_s: float):
    """However the samples fall on it, at the highest speed: their sum is the bell's integral, √(2π) b over their way.
    An untouched spindle that moves 1 mm between two samples was given a tight stretch of 0.1 mm, at 0.99."""
    t = np.arange(0.0, 10.0, step_s)
    run = Run("a", t, {"position_m": 0.006 * np.sin(18.0 * t), "velocity_m_s": 0.108 * np.cos(18.0 * t), "force_n": t})
    effect = find("friction_position_dependent", "axis-linear")
    width = next(r for r in ranges_of(effect, MACHINES["axis-linear"], [run]) if r.name == "width_m")
    apart = 0.108 * step_s
    for b in {width.lowest, *width.tries, width.start} - {width.highest}:
        for off in np.linspace(0.0, apart, 7):
            seen = np.sum(np.exp(-0.5 * ((off + apart * np.arange(-50, 51)) / b) ** 2)) * apart
            assert b > 10.0 * apart or seen == pytest.approx(np.sqrt(2.0 * np.pi) * b, rel=0.015)
    assert width.lowest <= min(width.tries) and width.start <= width.highest


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        ({"drum_ecentricity": {}}, "effects.drum_ecentricity: unknown effect 'drum_ecentricity'; did you mean 'drum"),
        ({"presliding": {"distance_m": 1e-4}}, "'presliding' is no effect of a hoist machine"),
        ({"heave": {"amplitude": 0.2}}, "effects.heave.amplitude: effect 'heave' has no parameter 'amplitude'; did"),
        ({"heave": {"phase_rad": 0.2}}, "effects.heave: says no size; expected amplitude_m"),
        ({"heave": {"amplitude_m": -0.2}}, "effects.heave.amplitude_m: -0.2, expected at least 0"),
        ({"payload_mass_error": {"payload_scale": 0.0}}, "payload_scale: 0, expected more than 0"),
    ],
)
def test_what_is_wrong_with_an_effect_is_said_with_its_place(chosen, said):
    with pytest.raises(InputError) as caught:
        of(default_hoist(), chosen)
    assert said in str(caught.value)


OWN = '''
from workbench.effects import Parameter, effect

@effect(
    place={"hoist": "guide_force_n"}, subsystem="guide", regime="all",
    parameters=[Parameter("F", "force_n", "always down", "force", 0.0, 1.0, 0.01, 0.02, vanishes_at=0.0)],
    equation="F = -F", reference="made up", shows="a constant",
)
def downward_pull(s, e, p):
    """A constant pull."""
    return -e.F
'''


def test_a_user_s_effect_is_one_file_and_no_other_edit(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(OWN)
    before = of(default_hoist(), {"heave": {"amplitude_m": 0.1}}).effects
    (mine,) = load_effects(file)
    assert mine.id == "downward_pull" and "downward_pull" in names("hoist")
    active = of(default_hoist(), {"downward_pull": {"force_n": 500.0}, "heave": {"amplitude_m": 0.1}})
    assert "downward_pull__force_n" in active.effects.parameters
    assert set(before.parameters) < set(active.effects.parameters)
    # Without it at work the library's own kernel serves still.
    assert of(default_hoist(), {"heave": {"amplitude_m": 0.1}}).effects is before
    load_effects(file)  # once more is no clash
    forget_users()
    with pytest.raises(InputError, match="unknown effect 'downward_pull'"):
        of(default_hoist(), {"downward_pull": {"force_n": 500.0}})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import nowhere_at_all\n", "fails: ModuleNotFoundError"),
        (OWN.replace("downward_pull", "heave"), "the effect name 'heave' is taken"),
        (OWN.replace("guide_force_n", "guide_force"), "no place 'guide_force'"),
        (OWN.replace("0.01, 0.02", "0.01, 2.0"), "starts at 2, outside 0 to 1"),
        (OWN.replace(", vanishes_at=0.0", ""), "no parameter has a value at which it vanishes"),
        (OWN.replace('"force", 0.0', '"weight", 0.0'), "no size 'weight'"),
        (OWN.replace('place={"hoist"', 'place={"hoits"'), "no kind 'hoits'; did you mean 'hoist'?"),
    ],
)
def test_a_file_that_is_no_good_is_refused_by_name(tmp_path: Path, text: str, said: str):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        load_effects(file)
    assert str(caught.value).startswith(str(file))


def test_an_entry_point_s_effects_are_known(monkeypatch: pytest.MonkeyPatch):
    def pull(s: Any, e: Any, p: Any) -> Any:
        """A constant pull."""
        return -e.F

    declared = effect(
        place={"hoist": "guide_force_n"}, subsystem="guide", regime="all",
        parameters=[Parameter("F", "force_n", "down", "force", 0.0, 1.0, 0.01, 0.02, vanishes_at=0.0)],
        equation="F = -F", reference="made up", shows="a constant",
    )(pull)  # fmt: skip

    class Entry:
        name = "pull"

        def load(self) -> Effect:
            return declared

    forget_users()
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group: [Entry()] if group == "workbench.effects" else []
    )
    assert find("pull", "hoist") is declared


# The measured correction: what its block may say, that it acts as its table says, that every command takes it.


TURN = 2.0 * np.pi
HOIST = ideal_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
VISCOUS = 4000.0


def choices(machine: Hoist | Axis) -> list[tuple[str, str]]:
    """(over, acts_on) that a machine's block may say."""
    record = next(
        record_type
        for record_type in get_args(type(machine).model_fields["measured_correction"].annotation)
        if record_type
    )
    over, acts_on = (get_args(record.model_fields[name].annotation) for name in ("over", "acts_on"))
    return [(x, place) for x in over for place in acts_on if (x, place) != ("torque_load_nm", "guide")]


CHOICES = [(kind, *choice) for kind, machine in MACHINES.items() for choice in choices(machine)]


def points(over: str) -> np.ndarray:
    """Points that fit a variable, unevenly set."""
    if over in ("angle_motor_rad", "angle_drum_rad", "angle_in_turn_rad"):
        return np.array([0.3, 1.0, 2.5, 3.0, 5.0, 6.0])
    return np.array([0.0, 0.1, 0.5, 0.6, 1.0, 2.0])


def viscous_table(machine: Hoist, many: int = 9) -> Hoist:
    at = np.linspace(0.0, 1.2, many)
    return with_correction(machine, "speed_carriage_m_s", "guide", at, VISCOUS * at, VISCOUS * at)


def viscous_effect(machine: Hoist) -> Hoist:
    return machine.model_copy(update={"effects": {"friction_viscous": {"viscous_n_s_per_m": VISCOUS}}})


# What the block says


@pytest.mark.parametrize(("kind", "over", "acts_on"), CHOICES)
def test_a_block_comes_back_from_its_file_as_it_was(tmp_path: Path, kind: str, over: str, acts_on: str):
    at = points(over)
    machine = with_correction(MACHINES[kind], over, acts_on, at, 1.5 * at, -at)
    save_machine(machine, tmp_path / "machine.yaml")
    again = load_machine(tmp_path / "machine.yaml")
    assert again == machine and again.measured_correction is not None
    assert again.measured_correction.forward == tuple(1.5 * at)
    unit = "n" if acts_on == "guide" or kind == "axis-linear" else "nm"
    text = (tmp_path / "machine.yaml").read_text()
    assert f"  backward_{unit}: [-" in text and "null" not in text, "a row of numbers is one line"


BLOCK = """\
measured_correction:
  over: speed_carriage_m_s
  acts_on: guide
  at: [0.0, 0.5, 1.0]
  forward_n: [0, 100, 200]
  backward_n: [0, 120, 240]
"""
MISTAKES = {
    ("speed_carriage_m_s", "speed_carriage"): "measured_correction.over: 'speed_carriage'; did you mean 'speed_carria",
    ("[0.0, 0.5, 1.0]", "[0.0, 0.5, 0.5]"): "measured_correction.at: 0.5 (point 2) after 0.5, expected rising values",
    ("[0.0, 0.5, 1.0]", "[0.0, 1.0]"): "measured_correction.at: 2 points, expected 3 to 33",
    ("[0, 100, 200]", "[0, 100]"): "measured_correction: forward has 2 values, at has 3; expected as many",
    ("forward_n:", "forward_nm:"): "forward_nm does not go with acts_on guide; expected forward_n",
    ("  backward_n: [0, 120, 240]\n", ""): "backward_n is missing; acts_on guide expects it",
    ("speed_carriage_m_s\n  acts_on: guide\n  at: [0.0, 0.5, 1.0]", "angle_drum_rad\n  acts_on: guide\n  "
     "at: [0.0, 3.1416, 6.2832]"): "at spans 6.283 rad, expected less than one turn, 6.283: the table closes",
}  # fmt: skip


@pytest.mark.parametrize(("change", "said"), MISTAKES.items(), ids=range(len(MISTAKES)))
def test_a_mistake_is_named_with_file_and_line(change: tuple[str, str], said: str):
    assert change[0] in BLOCK
    text = machine_text(HOIST) + BLOCK.replace(*change, 1)
    with pytest.raises(InputError) as caught:
        machine_from(loads(text, "machine.yaml"))
    assert said in str(caught.value)
    assert caught.value.line is not None and caught.value.line > machine_text(HOIST).count("\n")


# What it does


def force(machine: Hoist | Axis, **signals: float) -> float:
    """What the correction adds at its place."""
    correction = machine.measured_correction
    assert correction is not None
    active = of(machine)
    plant = plant_of(machine)
    p = SimpleNamespace(**vars(plant.values(machine, 700.0)), **active.values_of(50.0))
    return float(active.effects.at(kind_of(machine).ports[correction.acts_on].place, p, **signals))


def signals_at(over: str, x: float, way: float) -> dict[str, float]:
    """Signals under which a table reads x, moving that way well beyond standstill."""
    s = dict.fromkeys(("t", "v", "w", "x", "angle"), 0.0) | {"v": way * 0.7, "w": way * 40.0, "switch": way}
    if "speed" in over or over == "velocity_m_s":
        s["w" if over == "speed_motor_rad_s" else "v"] = way * x
    elif over in ("position_carriage_m", "position_m", "angle_rad", "angle_in_turn_rad"):
        s["x"] = x
    elif over == "torque_load_nm":
        s["load"] = x
    elif over in ("angle_motor_rad", "angle_drum_rad"):
        s["angle"] = x * (HOIST.gearbox.ratio if over == "angle_drum_rad" else 1.0)
    else:
        s["t"] = x - 50.0 if over == "campaign_time_s" else x
    return s


@pytest.mark.parametrize(("kind", "over", "acts_on"), CHOICES)
def test_it_is_the_table_s_line_on_either_way_and_its_last_value_beyond(kind: str, over: str, acts_on: str):
    at, rng = points(over), np.random.default_rng(4)
    forward, backward = rng.normal(0.0, 300.0, (2, len(at)))
    machine = with_correction(MACHINES[kind], over, acts_on, at, forward, backward)
    period = TURN if machine.measured_correction and machine.measured_correction.periodic else None
    for x in [0.02, 0.3, 0.55, 1.7, 2.0, 5.5, *([-3.0, 40.0] if period else [9.0])]:
        x = 700.0 if over == "payload_kg" else x
        for way, level, sign in ((1.0, forward, -1.0), (-1.0, backward, 1.0)):
            wanted = sign * float(np.interp(x, at, level, period=period))
            assert force(machine, **signals_at(over, x, way)) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(("kind", "over", "acts_on"), CHOICES)
def test_a_table_that_opposes_both_ways_only_ever_takes_energy(kind: str, over: str, acts_on: str):
    at, rng = points(over), np.random.default_rng(6)
    machine = with_correction(MACHINES[kind], over, acts_on, at, *rng.uniform(0.0, 300.0, (2, len(at))))
    lost = []
    for _ in range(200):
        v = float(rng.normal(0.0, rng.choice([0.001, 0.05, 1.0])))
        s = {name: float(rng.normal(0.0, 5.0)) for name in ("t", "x", "angle", "load")}
        lost.append(force(machine, v=v, w=v, switch=float(np.clip(v / 0.01, -1.0, 1.0)), **s) * v)
    assert max(lost) <= 0.0 and min(lost) < 0.0


def test_what_both_ways_share_is_a_weight_and_stays_at_standstill():
    pull, at = 5000.0, [0.0, 10.0, 25.0]
    shared = with_correction(HOIST, "position_carriage_m", "guide", at, [pull] * 3, [-pull] * 3)
    mixed = with_correction(HOIST, "position_carriage_m", "guide", at, [pull + 900.0] * 3, [-pull] * 3)
    friction = with_correction(HOIST, "position_carriage_m", "guide", at, [pull] * 3, [pull] * 3)
    holds = []
    for machine in (HOIST, shared, mixed, friction):
        model = plant_model(machine)
        holds.append(model.starts([9.0], [0.0], [0.0], [model.values(machine, 4500.0, 0.0)])[1][0])
    arm = HOIST.winch.drum_diameter_m / 2.0 / HOIST.gearbox.ratio
    assert holds[1] - holds[0] == pytest.approx(pull / 2.0 * arm, rel=1e-3)
    assert holds[2] == pytest.approx(holds[1], rel=1e-12)
    assert holds[3] == holds[0]


def moved(machines: Sequence[Hoist]) -> list[LoopResult]:
    """A closed loop that goes both ways, on each machine."""
    time = np.arange(5000) * 0.001
    speed = 130.0 * np.sin(2.0 * time)
    return simulate_loop(
        [LoopCase(f"{j}", machine, 4500.0, 9.0, SETTINGS, speed) for j, machine in enumerate(machines)]
    )


def test_in_the_closed_loop_a_table_of_b_v_is_viscous_friction():
    plain, effect, table = moved([HOIST, viscous_effect(HOIST), viscous_table(HOIST)])
    torque = [result.run["torque_motor_nm"] for result in (plain, effect, table)]
    assert np.max(np.abs(torque[1] - torque[0])) > 10.0
    assert np.max(np.abs(torque[2] - torque[1])) < 0.01


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a machine with viscous friction that its nominal machine does not know."""
    return simulated_campaign(tmp_path_factory.mktemp("campaigns") / "made", truth=viscous_effect(HOIST))


# Where it is, and where it is not


@pytest.fixture
def corrected_file(tmp_path: Path) -> Path:
    save_machine(viscous_table(HOIST), tmp_path / "corrected.yaml")
    return tmp_path / "corrected.yaml"


def test_replay_and_identify_take_a_corrected_machine(commands, tmp_path, campaign, corrected_file):
    assert commands("replay", campaign, "--out", tmp_path / "nominal").status == 0
    ended = commands("replay", campaign, "--machine", corrected_file, "--out", tmp_path / "corrected")
    assert ended.status == 0, ended.err
    said = [json.loads((tmp_path / name / "replay.json").read_text())["overall"] for name in ("nominal", "corrected")]
    assert said[1]["torque_residual_rms_nm"] < 0.4 * said[0]["torque_residual_rms_nm"]
    identified = commands("identify", campaign, "--machine", corrected_file, "--out", tmp_path / "found")
    assert identified.status == 0, identified.err
    kept = load_machine(tmp_path / "found" / "machine.yaml").measured_correction
    assert kept == viscous_table(HOIST).measured_correction
