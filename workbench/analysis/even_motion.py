"""Where a machine with its effects moves evenly, and the exact slopes of its equations there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.engine.source import state_symbols
from workbench.errors import InputError
from workbench.plants import Effects, Plant
from workbench.run import Array
from workbench.trace.derive import derivative, values
from workbench.trace.emit import evaluate
from workbench.trace.expr import Expr, Scalar, symbol

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
