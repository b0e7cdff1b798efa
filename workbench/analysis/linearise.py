"""A machine as a linear system around an operating point, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects import of
from workbench.effects.active import joined
from workbench.engine.source import state_symbols
from workbench.machines import NO_EFFECTS, Effects, Machine, Plant, kind_of
from workbench.machines.plant import Piece
from workbench.symbolic.derive import derivative, jacobian, values
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import Expr, Scalar, symbol

Motion = Literal["hoisting", "lowering", "at_rest"]


@dataclass(frozen=True)
class OperatingPoint:
    """Where the machine is linearised.

    motion: moving evenly up or down, friction saturated, or at rest, on the friction's slope around
    standstill. `hoisting` is the default: at rest the guide's slope damps the wire many times as
    much, so margins at rest flatter a loop whose work is done moving. Of an axis `hoisting` is forward, and height_m is
    its position, m or rad.
    """

    payload_kg: float
    height_m: float
    motion: Motion = "hoisting"


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """x' = A x + B u, y = C x for small deviations; u: torque of all motors (N m), y as `outputs`, the speed at the
    encoder first.

    A: (n, n), B: (n, 1), C: (outputs, n). start: the operating point's positions, speeds and torque.
    """

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    A: Array
    B: Array
    C: Array
    start: tuple[Array, Array, float]

    def system(self) -> Any:
        """As a `control.StateSpace`, torque to the outputs."""
        import control

        D = np.zeros((len(self.outputs), 1))
        return control.ss(
            self.A, self.B, self.C, D, inputs=["torque"], outputs=list(self.outputs), states=list(self.states)
        )


def moved_memory(A: Array, B: Array, kept: Sequence[int], memory: Sequence[int]) -> list[int]:
    """Of the effects' memory what the motion moves; the rest stays where it is and is no part of the loop."""
    reached: list[int] = []
    while more := [i for i in memory if i not in reached and (np.any(A[i, [*kept, *reached]]) or B[i, 0] != 0.0)]:
        reached += more
    return reached


ROUNDS = 12
# Effects on the driven coordinate's input, by place -> the names under which they read where it stands.
HELD = {"motor_torque_nm": ("angle",), "axis_force": ("angle", "x")}


class EvenMotion:
    """The traced equations of a machine with effects in even motion, at time 0.

    A point is (positions, speeds, memory, input, shaft). The shaft is the driven coordinate's place once more, as
    effects on the input read it: a ripple passes under the moving machine many times a second and averages out; as a
    spring it would be felt. `fixed` is the position that a point is given by: a hoist's height, an axis' own.
    """

    def __init__(self, plant: Plant, effects: Effects, p: SimpleNamespace, outputs: Sequence[str]) -> None:
        self.plant, self.effects, self.p = plant, effects, p
        self.fixed = plant.placed
        q, y = state_symbols(plant, effects)
        u, shaft = symbol("u"), symbol("shaft")
        held = effects
        for place, names in HELD.items():
            held = angle_read(held, shaft, place, names)
        shown = plant.shown(0.0, q, y, u, p, held)
        self.by: tuple[Expr, ...] = (*q, *y, u, shaft)
        self.states = len(q) + len(y)
        self.rates = plant.rates(0.0, q, y, u, p, held)
        self.outputs = [shown[name] for name in outputs]
        # The arm of the wire force over the drum's radius: 1 but for effects on the wound length.
        self._arm: Scalar = 1.0
        if effects.pieces.get("wound_length_m"):
            per_rad = 1.0 / p.ratio
            wound = effects.at("wound_length_m", p, t=0.0, theta_w=per_rad * q[0])
            self._arm = 1.0 + derivative(wound, q[0]) / (per_rad * p.D_w / 2.0)

    def slopes(self, at: Array) -> Array:
        """(rates and outputs, states and input): exact derivatives at a point."""
        return jacobian([*self.rates, *self.outputs], self.by, at)[:, :-1]

    def rise(self, at: Array) -> Array:
        """Positions per unit of the fixed one in even motion, a wire unchanged: the arm is that of the drum there."""
        _, even, _ = self.plant.start_of(0.0, 1.0, self.p)
        (arm,) = evaluate([self._arm], values(self.by, at))
        moved = np.array([even[0], *(arm * e for e in even[1:])])
        return np.asarray(moved / moved[self.fixed])

    def settled(self, position: float, speed: float) -> Array:
        """Newton's steps to where nothing accelerates and no memory changes, at a position and a driven speed.

        InputError where there is no such point.
        """
        n, N = len(self.plant.positions), self.states
        q, y, u = self.plant.start_of(position, speed, self.p)
        at = np.array([*q, *y, *(m.start(self.p) for m in self.effects.memory), u, q[0]])
        for _ in range(ROUNDS):
            rise = self.rise(at)
            at[n : 2 * n] = speed / rise[0] * rise if self.effects.pieces else y
            wrong = np.array(evaluate(list(self.rates), values(self.by, at)))
            J = jacobian(self.rates, self.by, at)
            J[:, 0] += J[:, -1]
            # Memory of an effect that is off stays where it is, whatever the motion.
            live = [i for i in range(len(wrong)) if i < n or np.any(J[i])]
            free = [*(i for i in range(n) if i != self.fixed), *(n + i for i in live if i >= n), N]
            try:
                change = np.linalg.solve(J[np.ix_(live, free)], -wrong[live])
            except np.linalg.LinAlgError as error:
                raise InputError("these effects have no steady state in an even motion", place="effects") from error
            at[free] += change
            at[-1] = at[0]
            if np.all(np.abs(change) <= 1e-10 * (1.0 + np.abs(at[free]))):
                break
        return at


def angle_read(effects: Effects, angle: Expr, place: str, names: tuple[str, ...]) -> Effects:
    """The same effects, those at a place reading the driven coordinate from its own symbol."""
    if not effects.pieces.get(place):
        return effects

    def held(piece: Piece, s: Any, p: Any) -> Scalar:
        return piece(SimpleNamespace(**{**vars(s), **dict.fromkeys(names, angle)}), p)

    pieces: dict[str, Sequence[Piece]] = {**effects.pieces, place: [partial(held, x) for x in effects.pieces[place]]}
    return Effects(pieces, effects.parameters, effects.memory)


DERIVED_KEPT = 32
_derived: dict[Any, tuple[Effects, EvenMotion]] = {}

OUTPUTS = ("speed_motor_rad_s", "speed_carriage_m_s", "tension_drum_n")  # of a hoist


# k = EA/(L - x): the free length of each fall instead of the whole one. The plant's own k is constant.
STIFFNESS_BY_LENGTH = Effects({"wire_compliance_m_per_n": [lambda s, p: -(s.x / (p.E * p.A))]})


def linearise(
    machine: Machine, point: OperatingPoint, *, effects: Effects = NO_EFFECTS, height_free: bool = False
) -> LinearPlant:
    """The plant from the drive's input to the outputs at a point: of a hoist motor speed, carriage speed and wire
    tension, of an axis speed, position and its other signals.

    The machine's own effects are at work, `effects` beside them. Time stands at the run's start, a run that begins the
    campaign; what an effect remembers has settled, and stays a state only where the motion moves it.

    Positions are taken relative to the one that the point is given by, so what is left beside it are stretches. That
    one is left out unless `height_free`: a hoist's height makes through the weight of the free wire a mode of e-fold
    time about 40 s, which a speed loop neither holds nor has to.
    """
    kind, own = kind_of(machine), of(machine)
    plant, loop = kind.plant, kind.looped
    p = plant.values(machine, point.payload_kg)
    vars(p).update(own.values_of(0.0))
    if loop.position_loop:
        outputs = (loop.speed, loop.position, *(s.name for s in plant.signals if "acceleration" not in s.name))
    else:
        outputs = (*OUTPUTS, *((loop.position,) if height_free else ()))
    outputs = tuple(dict.fromkeys(outputs))
    # A family asks for many points of few machines, and to derive the equations takes longest.
    key = machine.model_dump_json(), id(effects), tuple(vars(p).items()), outputs
    kept = _derived.get(key)
    if kept is None or kept[0] is not effects:
        while len(_derived) >= DERIVED_KEPT:
            _derived.pop(next(iter(_derived)))
        kept = _derived[key] = effects, EvenMotion(plant, joined(own.effects, effects), p, outputs)
    even = kept[1]
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    at = even.settled(point.height_m, sign * loop.even_speed(machine))
    J = even.slopes(at)
    n, N, fixed = len(plant.positions), even.states, even.fixed
    A = np.block([[np.eye(N)[n : 2 * n]], [J[: N - n, :N]]])
    B = np.concatenate([np.zeros(n), J[: N - n, N]])[:, None]
    C = J[N - n :, :N]
    others = [i for i in range(n) if i != fixed]
    T = np.eye(N)  # the other positions as seen from one that moves evenly with the fixed one
    T[others, fixed] = even.rise(at)[others]
    A, B, C = (np.asarray(M, dtype=np.float64) for M in (np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T))
    names = [name if i == fixed else f"{name}_relative" for i, name in enumerate(plant.positions)]
    names += [*plant.speeds, *(m.symbol for m in even.effects.memory)]
    keep = [i for i in range(2 * n) if height_free or i != fixed]
    keep += moved_memory(A, B, keep, range(2 * n, N))
    states = tuple(names[i] for i in keep)
    start = at[:n], at[n:N], float(at[N])
    return LinearPlant(states, outputs, A[np.ix_(keep, keep)], B[keep], C[:, keep], start)
