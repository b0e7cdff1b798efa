"""Where a machine is linearised, and what comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.run import Array

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
