"""A machine as a linear system around an operating point, by exact derivatives of the traced equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, Literal, cast

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects import joined, of
from workbench.engine.source import state_symbols
from workbench.machines import HOIST, NO_EFFECTS, Axis, Effects, Hoist, Plant, kind_of
from workbench.symbolic.derive import derivative, jacobian, values
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import Expr, Scalar, symbol

Motion = Literal["hoisting", "lowering", "at_rest"]
MOTIONS: tuple[Motion, ...] = ("hoisting", "lowering", "at_rest")


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

    def output(self, name: str) -> Array:
        """(1, n), one signal's row."""
        return self.C[[self.outputs.index(name)]]

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


class EvenMotion:
    """The traced equations of a hoist with effects, at time 0.

    A point is (positions, speeds, memory, torque, shaft). The shaft is the motor's angle once
    more, as effects on the shaft's torque read it: a ripple passes under the moving machine many
    times a second and averages out; as a spring on the shaft it would be felt by the stretch of
    the wire and not by the motion, for the height is left out.
    """

    def __init__(self, plant: Plant, effects: Effects, p: SimpleNamespace, outputs: Sequence[str]) -> None:
        self.plant, self.effects, self.p = plant, effects, p
        q, y = state_symbols(plant, effects)
        u, shaft = symbol("u"), symbol("shaft")
        held = angle_read(effects, shaft)
        shown = plant.shown(0.0, q, y, u, p, held)
        self.by: tuple[Expr, ...] = (*q, *y, u, shaft)
        self.states = len(q) + len(y)
        self.rates = plant.rates(0.0, q, y, u, p, held)
        self.outputs = [shown[name] for name in outputs]
        memo: dict[tuple[int, int], Scalar] = {}
        self._slopes = [[derivative(f, x, memo) for x in self.by] for f in (*self.rates, *self.outputs)]
        self._arm = self._arm_over_radius(q[0])

    def slopes(self, at: Array) -> Array:
        """(rates and outputs, states and torque): exact derivatives at a point."""
        return self._table(self._slopes, at)[:, :-1]

    def rise(self, at: Array) -> Array:
        """Positions per metre that the carriage rises, the wire unchanged: the arm is that of the drum just there."""
        _, even, _ = self.plant.start_of(0.0, 1.0, self.p)
        (arm,) = evaluate([self._arm], values(self.by, at))
        return np.array([even[0], *(arm * e for e in even[1:])]) / (arm * even[-1])

    def settled(self, height_m: float, speed_motor_rad_s: float) -> Array:
        """Newton's steps to where nothing accelerates and no memory changes, at a height and a motor speed.

        InputError where there is no such point.
        """
        n, N = len(self.plant.positions), self.states
        q, y, u = self.plant.start_of(height_m, speed_motor_rad_s, self.p)
        kept = [m.start(self.p) for m in self.effects.memory]
        at = np.array([*q, *y, *kept, u, q[0]])
        free = [*range(n - 1), *range(2 * n, N + 1)]  # the other positions, the memory, the torque
        for _ in range(ROUNDS):
            rise = self.rise(at)
            at[n : 2 * n] = speed_motor_rad_s / rise[0] * rise if self.effects.pieces else y
            wrong = np.array(evaluate(list(self.rates), values(self.by, at)))
            J = self._table(self._slopes[: len(self.rates)], at)
            J[:, 0] += J[:, -1]
            try:
                change = np.linalg.solve(J[:, free], -wrong)
            except np.linalg.LinAlgError as error:
                raise InputError("these effects have no steady state in an even motion", place="effects") from error
            at[free] += change
            at[-1] = at[0]
            if np.all(np.abs(change) <= 1e-10 * (1.0 + np.abs(at[free]))):
                break
        return at

    def _table(self, rows: Sequence[Sequence[Scalar]], at: Array) -> Array:
        return np.array(evaluate([value for row in rows for value in row], values(self.by, at))).reshape(len(rows), -1)

    def _arm_over_radius(self, angle: Expr) -> Scalar:
        """The arm of the wire force over the drum's radius: 1 but for effects on the wound length."""
        per_rad = 1.0 / self.p.ratio
        extra = self.effects.at("wound_length_m", self.p, t=0.0, theta_w=per_rad * angle)
        return 1.0 + derivative(extra, angle) / (per_rad * self.p.D_w / 2.0) if isinstance(extra, Expr) else 1.0


def angle_read(
    effects: Effects, angle: Expr, place: str = "motor_torque_nm", names: tuple[str, ...] = ("angle",)
) -> Effects:
    """The same effects, those at a place (the shaft's torque) reading the motor's angle from its own symbol."""
    if not effects.pieces.get(place):
        return effects
    held = [partial(_with_angle, piece, angle, names) for piece in effects.pieces[place]]
    return Effects({**effects.pieces, place: held}, effects.parameters, effects.memory)


def _with_angle(piece: Callable[[Any, Any], Scalar], angle: Expr, names: tuple[str, ...], s: Any, p: Any) -> Scalar:
    return piece(SimpleNamespace(**{**vars(s), **dict.fromkeys(names, angle)}), p)


# What a place does to the axis' force passes under the moving machine, as a ripple does: it is no spring.
HELD = ("axis_force", ("angle", "x"))


def linearise_axis(
    machine: Axis,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    placed: bool = True,
) -> LinearPlant:
    """The plant from the drive's input to speed and position at the encoder.

    The machine's own effects are at work, `effects` beside them, time stands at the run's start. Positions beside the
    driven one are taken relative to it; that one is left out unless `placed`. InputError where the effects have no
    steady state.
    """
    kind, own = kind_of(machine), of(machine)
    plant, loop = kind.plant, kind.looped
    p = plant.values(machine)
    vars(p).update(own.values_of(0.0), **(effect_values or {}))
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    both = joined(own.effects, effects)
    at = _settled(plant, both, p, point.height_m, sign * loop.even_speed(machine))
    q, y = state_symbols(plant, both)
    u, shaft = symbol("u"), symbol("shaft")
    held = angle_read(both, shaft, *HELD)
    shown = plant.shown(0.0, q, y, u, p, held)
    outputs = (loop.speed, loop.position, *(s.name for s in plant.signals if "acceleration" not in s.name))
    outputs = tuple(dict.fromkeys(outputs))
    J = jacobian([*plant.rates(0.0, q, y, u, p, held), *(shown[name] for name in outputs)], [*q, *y, u, shaft], at)
    n, N = len(q), len(q) + len(y)
    A = np.block([[np.eye(N)[n : 2 * n]], [J[: N - n, :N]]])
    B = np.concatenate([np.zeros(n), J[: N - n, N]])[:, None]
    C = J[N - n :, :N]
    T = np.eye(N)  # the other positions as seen from the driven one
    T[1:n, 0] = 1.0
    A, B, C = (np.asarray(M, dtype=np.float64) for M in (np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T))
    names = (plant.positions[0], *(f"{name}_relative" for name in plant.positions[1:]), *plant.speeds)
    names = (*names, *(m.symbol for m in both.memory))
    keep = [i for i in range(2 * n) if placed or i != 0]
    keep += moved_memory(A, B, keep, range(2 * n, N))
    return LinearPlant(
        tuple(names[i] for i in keep), outputs, A[np.ix_(keep, keep)], B[keep], C[:, keep],
        (at[:n], at[n:N], float(at[N])),
    )  # fmt: skip


def _settled(plant: Plant, effects: Effects, p: SimpleNamespace, position: float, speed: float) -> Array:
    """Newton's steps to where nothing accelerates and no memory changes: positions, speeds, memory, input, shaft."""
    q, y = state_symbols(plant, effects)
    u, shaft = symbol("u"), symbol("shaft")
    by = [*q, *y, u, shaft]
    rates = plant.rates(0.0, q, y, u, p, angle_read(effects, shaft, *HELD))
    n, N = len(q), len(q) + len(y)
    start_q, start_y, hold = plant.start_of(position, speed, p)
    at = np.array([*start_q, *start_y, *(m.start(p) for m in effects.memory), hold, start_q[0]])
    for _ in range(ROUNDS):
        wrong = np.array(evaluate(list(rates), values(by, at)))
        J = jacobian(rates, by, at)
        # Memory of an effect that is off stays where it is, whatever the motion.
        live = [i for i in range(len(wrong)) if i < n or np.any(J[i])]
        free = [*range(1, n), *(n + i for i in live if i >= n), N]  # the other positions, the memory, the input
        try:
            change = np.linalg.solve(J[np.ix_(live, free)], -wrong[live])
        except np.linalg.LinAlgError as error:
            raise InputError("these effects have no steady state in an even motion", place="effects") from error
        at[free] += change
        if np.all(np.abs(change) <= 1e-10 * (1.0 + np.abs(at[free]))):
            break
    return at


# Of nominal motor speed: friction is saturated there, and far from the limits.
EVEN_SPEED = 0.5
OUTPUTS = ("speed_motor_rad_s", "speed_carriage_m_s", "tension_drum_n")


def _by_length(s: Any, p: Any) -> Scalar:
    return -(s.x / (p.E * p.A))


# k = EA/(L - x): the free length of each fall instead of the whole one. The plant's own k is constant.
STIFFNESS_BY_LENGTH = Effects({"wire_compliance_m_per_n": [_by_length]})


def linearise(
    machine: Hoist | Axis,
    point: OperatingPoint,
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
    height_free: bool = False,
) -> LinearPlant:
    """The plant from motor torque to motor speed, carriage speed and wire tension at a point.

    The machine's own effects are at work, `effects` beside them. Time stands at the run's start, a
    run that begins the campaign; what an effect remembers has settled, and stays a state only
    where the motion moves it.

    Positions are taken relative to the carriage's height, so what is left beside it are stretches
    of the falls. The height itself is left out unless `height_free`: through the weight of the free
    wire it makes a mode of e-fold time about 40 s, which a speed loop neither holds nor has to.
    An axis' position is left out, too, unless `height_free`; see `linearise_axis`.
    """
    if kind_of(machine).looped.position_loop:
        return linearise_axis(
            cast(Axis, machine), point, effects=effects, effect_values=effect_values, placed=height_free
        )
    machine = cast(Hoist, machine)
    own = of(machine)
    p = HOIST.plant.values(machine, point.payload_kg)
    vars(p).update(own.values_of(0.0), **(effect_values or {}))
    sign = {"hoisting": 1.0, "lowering": -1.0, "at_rest": 0.0}[point.motion]
    even = EvenMotion(HOIST.plant, joined(own.effects, effects), p, OUTPUTS)
    at = even.settled(point.height_m, sign * EVEN_SPEED * machine.motor.nominal_speed_rad_s)
    J = even.slopes(at)
    n, N = len(HOIST.plant.positions), even.states
    A = np.block([[np.eye(N)[n : 2 * n]], [J[: N - n, :N]]])
    B = np.concatenate([np.zeros(n), J[: N - n, N]])[:, None]
    C = J[N - n :, :N]
    # Coordinates: the other positions as seen from one that rises evenly with the carriage.
    T = np.eye(N)
    T[: n - 1, n - 1] = even.rise(at)[: n - 1]
    A, B, C = (np.asarray(M, dtype=np.float64) for M in (np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T))
    relative = (f"{name}_relative" for name in HOIST.plant.positions[: n - 1])
    names = (*relative, HOIST.plant.positions[n - 1], *HOIST.plant.speeds, *(m.symbol for m in even.effects.memory))
    keep = [i for i in range(2 * n) if height_free or i != n - 1]
    keep += moved_memory(A, B, keep, range(2 * n, N))
    return LinearPlant(
        tuple(names[i] for i in keep),
        OUTPUTS,
        A[np.ix_(keep, keep)],
        B[keep],
        C[:, keep],
        (at[:n], at[n:N], float(at[N])),
    )
