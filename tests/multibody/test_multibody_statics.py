"""The multi-body machine at rest: closed forms of tension and holding torque, reactions worked out by hand."""

from __future__ import annotations

import math

import pytest

from workbench.core.errors import InputError
from workbench.machines import Hoist, default_hoist, with_values
from workbench.machines.multibody import Switches, geometry_of, hang
from workbench.machines.multibody.switches import wound_m

MACHINE = default_hoist()
STIFF = with_values(MACHINE, {"arm.roller_stiffness_n_per_m": 1e10, "arm.cylinder_stiffness_n_per_m": 1e10})
HEIGHTS = (1.0, 5.0, 9.0, 13.0, 18.0)
PAYLOADS = (0.0, 4500.0, 9000.0)


def by_hand(machine: Hoist, payload_kg: float, height_m: float, line_kg_per_m: float) -> tuple[float, float]:
    """Tension at the top of a fall and the torque that holds it, of two falls of E·A/L each.

    With elongation d of a fall: 2 k d = P + λ g l, l = L - x - d its unstretched wire; half of λ g l comes on top.
    """
    wire, g = machine.wire, machine.gravity_m_s2
    k = wire.youngs_modulus_pa * wire.effective_area_m2 / wire.segment_length_m
    weight, line = (machine.carriage.mass_kg + payload_kg) * g, line_kg_per_m * g
    stretch = (weight + line * (wire.segment_length_m - height_m)) / (2.0 * k + line)
    top = k * stretch + line * (wire.segment_length_m - height_m - stretch) / 2.0
    return top, top * machine.winch.drum_diameter_m / (2.0 * machine.gearbox.ratio)


@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize(("payload", "hoses"), [*((payload, 0.0) for payload in PAYLOADS), (4500.0, 8.0)])
def test_tension_and_holding_torque_are_those_of_the_closed_form(payload: float, hoses: float, height: float):
    """Hoses hang from the top with the wire."""
    rest = hang(MACHINE, payload, height, Switches(hose_kg_per_m=hoses))
    top, hold = by_hand(MACHINE, payload, height, hoses + 7850.0 * MACHINE.wire.effective_area_m2)
    assert rest.tension_drum_n == pytest.approx(top, rel=1e-6)
    assert rest.tension_dead_line_n == pytest.approx(top, rel=1e-6)
    assert rest.hold_torque_nm == pytest.approx(hold, rel=1e-6)


@pytest.mark.parametrize("height", HEIGHTS)
def test_a_wire_that_follows_its_length_stretches_in_proportion_to_it(height: float):
    wire = MACHINE.wire
    stretched = {}
    for follows in (0.0, 1.0):
        rest = hang(MACHINE, 9000.0, height, Switches(follows_length=follows))
        stretched[follows] = rest.drum_angle_rad * MACHINE.winch.drum_diameter_m / 4.0 - height
    free = (wire.segment_length_m - height) / (1.0 + stretched[1.0] / (wire.segment_length_m - height))
    # The same load on E·A/l instead of E·A/L; strain is 1 %, which l shortens by.
    assert stretched[1.0] / stretched[0.0] == pytest.approx(free / wire.segment_length_m, rel=2e-3)


@pytest.mark.parametrize("payload", PAYLOADS)
def test_reactions_are_those_of_statics_by_hand(payload: float):
    """Free bodies from the gripper inwards; every moment about z, up and outwards positive."""
    arm, g = STIFF.arm, STIFF.gravity_m_s2
    d, s, L, e = arm.reach_m, arm.dolly_distance_m, arm.main_arm_m, arm.level_bar_offset_m
    x0, h = arm.pivot_offset_m, arm.roller_spacing_m / 2.0
    structure = STIFF.carriage.mass_kg - STIFF.sheave.mass_kg
    W = {name: share * structure * g for name, share in arm.shares.model_dump().items()}
    P = payload * g
    # Head and payload, about the head pivot: the level bar's axial force F (tension along the arm's direction).
    F = -(P * arm.pipe_offset_m + W["head"] * arm.pipe_offset_m / 2.0) * L / (e * d)
    Hx, Hy = -F * d / L, P + W["head"] + W["level_bar"] / 2.0 + F * s / L
    # Main arm about the upper pivot: the support link's axial force G.
    G = (d * Hy + s * Hx + d / 2.0 * (W["support_link"] / 2.0 + W["main_arm"])) * L / (d * s)
    Bx, By = Hx - G * d / L, Hy + W["main_arm"] + W["support_link"] / 2.0 - G * s / L
    # Upper dolly: cylinders K pushing it up, two rollers.
    K = By - F * s / L + W["level_bar"] / 2.0 + W["upper_dolly"]
    moment = -x0 * By + x0 * (F * s / L - W["level_bar"] / 2.0) + e * F * d / L
    moment += arm.cylinder_offset_m * K - x0 / 2.0 * W["upper_dolly"]
    upper = rollers(Bx + F * d / L, moment, h)
    # Lower dolly: the wire's pull at the sheave's pin.
    S = sum(W.values()) + P
    moment = x0 * (-G * s / L - W["support_link"] / 2.0) - x0 / 2.0 * W["lower_dolly"]
    moment += arm.sheave_offset_m * S - arm.cylinder_offset_m * K
    lower = rollers(G * d / L, moment, h)

    rest = hang(STIFF, payload, 9.0)
    size = max(map(abs, (*upper, *lower)))
    reactions = [-rest.normal_n[f"{dolly}_dolly_{end}"] for dolly in ("upper", "lower") for end in ("top", "bottom")]
    assert reactions == pytest.approx([*upper, *lower], abs=1e-4 * size)
    assert rest.cylinder_n == pytest.approx(-K, rel=1e-4)
    assert math.hypot(*rest.joint_n["head_pivot"]) == pytest.approx(math.hypot(Hx, Hy), rel=1e-4)
    assert math.hypot(*rest.joint_n["upper_pivot"]) == pytest.approx(math.hypot(Bx, By), rel=1e-3)
    assert rest.joint_n["sheave_pin"][1] == pytest.approx(-S, rel=1e-6)


def rollers(pull: float, moment: float, h: float) -> tuple[float, float]:
    """Forces of the top and the bottom roller on a dolly that hold a pull to the rail and a moment about its middle."""
    # top + bottom = pull; -h top + h bottom + moment = 0
    return (pull + moment / h) / 2.0, (pull - moment / h) / 2.0


@pytest.mark.parametrize("reach", [0.8, 1.7, 2.5, 3.3])
def test_the_linkage_closes_at_every_reach(reach: float):
    machine = with_values(MACHINE, {"arm.reach_m": reach})
    arm = machine.arm
    points = {name: point for name, (_, _, point) in geometry_of(machine, 1000.0, 7.0).joints.items()}

    def distance(a: str, b: str) -> float:
        return math.dist(points[a], points[b])

    assert distance("upper_pivot", "head_pivot") == pytest.approx(arm.main_arm_m)
    assert distance("level_bar_inner", "level_bar_outer") == pytest.approx(arm.main_arm_m)
    assert distance("lower_pivot", "middle_pivot") == pytest.approx(arm.main_arm_m / 2.0)
    assert points["head_pivot"][1] == points["lower_pivot"][1] == 7.0  # on a level line, whatever the reach


def test_the_bodies_weigh_what_the_carriage_and_the_payload_do():
    bodies = geometry_of(MACHINE, 4500.0, 5.0).bodies
    assert sum(b.mass_kg for b in bodies.values()) == pytest.approx(MACHINE.carriage.mass_kg + 4500.0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"arm.reach_m": 3.5}, "expected within shortest_reach_m 0.8 and longest_reach_m 3.3"),
        ({"arm.longest_reach_m": 3.7}, "the linkage does not close"),
        ({"arm.roller_spacing_m": 2.7}, "they would collide"),
        ({"arm.shares.head": 0.2}, "the six shares add up to 1.03"),
        ({"arm.pipe_length_m": -1.0}, "-1"),
        ({"arm.pipe_offset_m": 3.4}, "holds the payload outside the arm's reach"),
        ({"arm.switches.roller_clearance_m": 1.0}, "from 0 to 0.05; is it in millimetres"),
    ],
)
def test_an_arm_that_cannot_be_is_one_clear_error(values: dict[str, float], said: str):
    with pytest.raises(InputError, match=said):
        with_values(MACHINE, values)


def test_a_layer_more_lengthens_the_arm_of_the_wire():
    level, layered = (hang(MACHINE, 4500.0, 9.0, Switches(layer_m=d, layer_rad=20.0)) for d in (0.0, 0.02))
    arm = MACHINE.winch.drum_diameter_m / 2.0
    assert layered.hold_torque_nm / level.hold_torque_nm == pytest.approx((arm + 0.02) / arm, rel=1e-6)


def test_wire_on_the_drum_is_the_integral_of_its_arm():
    wound = wound_m(Switches(layer_m=0.02, layer_rad=3.0, eccentricity_m=0.01, eccentricity_rad=0.4), 0.3)
    step = 1e-5
    for angle in (-1.0, 0.0, 2.9, 3.1, 3.29, 7.0):
        slope = (wound(angle + step)[0] - wound(angle - step)[0]) / (2.0 * step)
        assert slope == pytest.approx(wound(angle)[1], rel=1e-6)
    assert wound(0.0)[0] == pytest.approx(0.0)
