"""Effects as they are declared: complete, known by name, open to a user's own; and their page in the docs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.effect_machines import MACHINES
from workbench.core.errors import InputError
from workbench.core.run import Run
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
from workbench.machines import default_hoist

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


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        (
            {"drum_ecentricity": {}},
            "effects.drum_ecentricity: unknown effect 'drum_ecentricity'; did you mean 'drum_ecce",
        ),
        ({"presliding": {"distance_m": 1e-4}}, "'presliding' is no effect of a hoist machine"),
        (
            {"heave": {"amplitude": 0.2}},
            "effects.heave.amplitude: effect 'heave' has no parameter 'amplitude'; did you",
        ),
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
