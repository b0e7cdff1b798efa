"""The engine alone on published and textbook cases: the joints, wire elements and integrator that the machine is of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from workbench.machines.multibody.motion import SPECTRAL_RADIUS, TOLERANCE
from workbench.machines.multibody.switches import engine

G = 9.81
Point = tuple[float, float]


@pytest.fixture(scope="module", autouse=True)
def exudyn() -> None:
    """Imported here and not above, so that the collection of the tests does not wait for it."""
    pytest.importorskip("exudyn", reason="the extra multibody is not installed")


class Bench:
    """Plane rigid bodies on the items of `workbench.machines.multibody.assemble`. Coordinates count from the start."""

    def __init__(self) -> None:
        exu = engine()
        from exudyn import itemInterface as items  # noqa: N813 -- a module

        self.exu, self.items = exu, items
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.ground = self.mbs.AddObject(items.ObjectGround())
        self.centres: dict[str, Point] = {}
        self.nodes: dict[str, Any] = {}
        self.objects: dict[str, Any] = {}

    def body(self, name: str, mass: float, inertia: float, centre: Point, g: float = 0.0) -> None:
        i = self.items
        self.nodes[name] = self.mbs.AddNode(i.NodeRigidBody2D(referenceCoordinates=[*centre, 0.0]))
        self.objects[name] = self.mbs.AddObject(
            i.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=self.nodes[name])
        )
        self.centres[name] = centre
        if g:
            marker = self.mbs.AddMarker(i.MarkerBodyMass(bodyNumber=self.objects[name]))
            self.mbs.AddLoad(i.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -g, 0.0]))

    def at(self, name: str, point: Point | None = None) -> Any:
        """A marker on a body or on the "ground", where `point` is at the start; at its centre when None."""
        x0, y0 = self.centres.get(name, (0.0, 0.0))
        x, y = (x0, y0) if point is None else point
        body = self.objects.get(name, self.ground)
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=[x - x0, y - y0, 0.0]))

    def joint(self, a: str, b: str, point: Point) -> Any:
        markers = [self.at(a, point), self.at(b, point)]
        return self.mbs.AddObject(self.items.ObjectJointRevolute2D(markerNumbers=markers))

    def coordinate(self, name: str, which: int) -> Any:
        return self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[name], coordinate=which))

    def still(self) -> Any:
        node = self.mbs.AddNode(self.items.NodePointGround(referenceCoordinates=[0, 0, 0]))
        return self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))

    def held(self, name: str, which: int) -> Any:
        """A body's coordinate (x, y, angle) constrained to where it is."""
        markers = [self.still(), self.coordinate(name, which)]
        return self.mbs.AddObject(self.items.ObjectConnectorCoordinate(markerNumbers=markers))

    def fall(self, top: Point, body: str, length: float, EA: float, **more: Any) -> Any:
        """A wire of free length `length` from a fixed point to a body's centre, as the machine's falls are."""
        return self.mbs.AddObject(
            self.items.ObjectConnectorReevingSystemSprings(
                markerNumbers=[self.at("ground", top), self.at(body), *more.pop("markers", [])],
                stiffnessPerLength=EA,
                dampingPerLength=more.pop("damping", 0.0),
                referenceLength=length,
                sheavesAxes=self.exu.Vector3DList([[0, 0, 1]] * 2),
                sheavesRadii=[0, 0],
                **more,
            )
        )

    def move(self, end_s: float, step_s: float, watch: Any = None, tolerance: float = TOLERANCE) -> list[float]:
        """What `watch`(mbs) gives before each step; the solver and its settings are the machine's own."""
        exu, seen = self.exu, []
        self.mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.timeIntegration.numberOfSteps = round(end_s / step_s)
        settings.timeIntegration.endTime = end_s
        settings.timeIntegration.adaptiveStep = False
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.relativeTolerance = tolerance
        settings.timeIntegration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        if watch is not None:

            def before_step(mbs: Any, t: float) -> bool:
                seen.append(watch(mbs))
                return True

            self.mbs.SetPreStepUserFunction(before_step)
        assert self.mbs.SolveDynamic(settings)
        self.mbs.SetPreStepUserFunction(0)
        return seen

    def rest(self) -> None:
        self.mbs.Assemble()
        settings = self.exu.SimulationSettings()
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = 0
        assert self.mbs.SolveStatic(settings)

    def output(self, number: Any, kind: str) -> Any:
        return self.mbs.GetObjectOutput(number, getattr(self.exu.OutputVariableType, kind))

    def turned(self, name: str) -> float:
        return float(self.mbs.GetNodeOutput(self.nodes[name], self.exu.OutputVariableType.Coordinates)[2])


# Andrews' squeezing mechanism: seven bodies, ten joints, one spring, driven by a constant torque.
# E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, section VII.7; the reference solution
# is that of F. Mazzia, C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4, 2008, problem "Andrews".
M = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)  # kg
J = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)  # kg m²
A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)  # m
ANGLES_0 = {
    "beta": -0.0617138900142764496, "theta": 0.0, "gamma": 0.455279819163070380, "phi": 0.222668390165885885,
    "delta": 0.487364979543842550, "omega": -0.222668390165885885, "epsilon": 1.23054744454982120,
}  # fmt: skip
ANGLES_END = {
    "beta": 15.81077119629904, "theta": -15.75637105984298, "gamma": 0.04082224013073101, "phi": -0.5347301163226948,
    "delta": 0.5244099658805304, "omega": 0.5347301163226948, "epsilon": 1.048080741042263,
}  # at 0.03 s  # fmt: skip


def andrews() -> Bench:
    """Bodies K1 to K7 at their start, under 0.033 N m on K1 (the crank)."""
    p, cos, sin = ANGLES_0, math.cos, math.sin
    beta, bt, ga = p["beta"], p["beta"] + p["theta"], p["gamma"]
    de, pd, ep, oe = p["delta"], p["phi"] + p["delta"], p["epsilon"], p["omega"] + p["epsilon"]
    d, da, e, ea, rr, ra, ss, sa, sb, sc, sd = (
        0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092, 0.035, 0.01874, 0.01043, 0.018, 0.02,
    )  # fmt: skip
    ta, tb, u, ua, ub, zf, zt, fa = 0.02308, 0.00916, 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    (xa, ya), (xb, yb) = A, B
    centres = (
        (ra * cos(beta), ra * sin(beta)),
        (rr * cos(beta) - da * cos(bt), rr * sin(beta) - da * sin(bt)),
        (xb + sa * sin(ga) + sb * cos(ga), yb - sa * cos(ga) + sb * sin(ga)),
        (xa + zt * cos(de) + (e - ea) * sin(pd), ya + zt * sin(de) - (e - ea) * cos(pd)),
        (xa + ta * cos(de) - tb * sin(de), ya + ta * sin(de) + tb * cos(de)),
        (xa + u * sin(ep) + (zf - fa) * cos(oe), ya - u * cos(ep) + (zf - fa) * sin(oe)),
        (xa + ua * sin(ep) - ub * cos(ep), ya - ua * cos(ep) - ub * sin(ep)),
    )
    bench = Bench()
    for number, (mass, inertia, centre) in enumerate(zip(M, J, centres, strict=True), start=1):
        bench.body(f"K{number}", mass, inertia, centre)
    crank = (rr * cos(beta), rr * sin(beta))
    E = (crank[0] - d * cos(bt), crank[1] - d * sin(bt))
    assert math.dist(E, (xb + ss * sin(ga), yb - ss * cos(ga))) < 1e-9  # the loop closes at the start
    for a, b, point in (
        ("ground", "K1", (0.0, 0.0)), ("K1", "K2", crank), ("K2", "K3", E), ("K2", "K4", E), ("K2", "K6", E),
        ("ground", "K3", B), ("K4", "K5", (xa + zt * cos(de), ya + zt * sin(de))), ("ground", "K5", A),
        ("K6", "K7", (xa + u * sin(ep), ya - u * cos(ep))), ("ground", "K7", A),
    ):  # fmt: skip
        bench.joint(a, b, point)
    D = (xb + sc * sin(ga) + sd * cos(ga), yb - sc * cos(ga) + sd * sin(ga))
    bench.mbs.AddObject(
        bench.items.ObjectConnectorSpringDamper(
            markerNumbers=[bench.at("ground", C), bench.at("K3", D)], stiffness=4530.0, referenceLength=0.07785
        )
    )
    bench.mbs.AddLoad(bench.items.LoadCoordinate(markerNumber=bench.coordinate("K1", 2), load=0.033))
    return bench


def angles(bench: Bench) -> Mapping[str, float]:
    k = [0.0, *(bench.turned(f"K{number}") for number in range(1, 8))]
    moved = {
        "beta": k[1], "theta": k[2] - k[1], "gamma": k[3], "phi": k[4] - k[5], "delta": k[5], "omega": k[6] - k[7],
        "epsilon": k[7],
    }  # fmt: skip
    return {name: ANGLES_0[name] + value for name, value in moved.items()}


def test_andrews_mechanism_ends_where_the_test_set_says():
    off = {}
    for step in (2e-5, 1e-5):
        bench = andrews()
        bench.move(0.03, step, tolerance=1e-9)
        off[step] = max(abs(value - ANGLES_END[name]) for name, value in angles(bench).items())
    assert off[1e-5] < 2e-4  # rad, of a crank that has turned by 15.9
    assert off[2e-5] / off[1e-5] == pytest.approx(4.0, rel=0.05)  # the method is of second order


def test_the_pull_in_atwoods_machine_is_goldsteins():
    """a = g (m1 - m2)/(m1 + m2 + I/r²), T1 = m1 (g - a): H. Goldstein, Classical Mechanics, 3rd ed., section 1.6, the
    pulley's inertia added. The wire is two falls over a sheave's angle, as in the machine.
    """
    m1, m2, inertia, r, length, EA = 12.0, 7.0, 0.3, 0.25, 4.0, 1e8
    bench = Bench()
    bench.body("m1", m1, 1.0, (-r, -length), G)
    bench.body("m2", m2, 1.0, (r, -length), G)
    wheel = bench.mbs.AddNode(bench.items.Node1D(referenceCoordinates=[0.0]))
    bench.mbs.AddObject(bench.items.ObjectMass1D(mass=inertia, nodeNumber=wheel))
    turned = bench.mbs.AddMarker(bench.items.MarkerNodeCoordinate(nodeNumber=wheel, coordinate=0))
    fixed = bench.still()
    falls = [
        bench.fall((side * r, 0.0), name, length, EA, damping=EA * 0.002, markers=[fixed, turned],
                   hasCoordinateMarkers=True, coordinateFactors=[0.0, side * r])
        for name, side in (("m1", -1.0), ("m2", 1.0))
    ]  # fmt: skip
    for name in ("m1", "m2"):
        bench.held(name, 0)
        bench.held(name, 2)
    bench.move(1.0, 1e-3)
    a = G * (m1 - m2) / (m1 + m2 + inertia / r**2)
    kind = bench.exu.OutputVariableType.Coordinates
    fallen = [-float(bench.mbs.GetNodeOutput(bench.nodes[name], kind)[1]) for name in ("m1", "m2")]
    assert fallen == pytest.approx([a / 2.0, -a / 2.0], rel=2e-4)
    pulls = [float(bench.output(fall, "ForceLocal")) for fall in falls]
    assert pulls == pytest.approx([m1 * (G - a), m2 * (G + a)], rel=1e-4)


@pytest.mark.parametrize("falls", [2, 3])
def test_a_block_and_tackle_shares_the_weight_among_its_falls(falls: int):
    """T = W/n: J. L. Meriam, L. G. Kraige, Statics, 7th ed., section 3/3 (pulleys). By Hooke's law the block sinks by
    W L/(n² E A), L the rope's whole length.
    """
    W, EA, height = 19620.0, 1e7, 4.0
    bench = Bench()
    bench.body("block", W / G, 1.0, (0.0, -height), G)
    bench.held("block", 0)
    bench.held("block", 2)
    ends = [bench.at("ground", (0.0, 0.0)) if k % 2 == 0 else bench.at("block") for k in range(falls + 1)]
    rope = bench.mbs.AddObject(
        bench.items.ObjectConnectorReevingSystemSprings(
            markerNumbers=ends,
            hasCoordinateMarkers=False,
            stiffnessPerLength=EA,
            referenceLength=falls * height,
            sheavesAxes=bench.exu.Vector3DList([[0, 0, 1]] * (falls + 1)),
            sheavesRadii=[0.0] * (falls + 1),
        )
    )
    bench.rest()
    assert float(bench.output(rope, "ForceLocal")) == pytest.approx(W / falls, rel=1e-9)
    sunk = -float(bench.mbs.GetNodeOutput(bench.nodes["block"], bench.exu.OutputVariableType.Coordinates)[1])
    assert sunk == pytest.approx(W * falls * height / (falls**2 * EA), rel=1e-9)
