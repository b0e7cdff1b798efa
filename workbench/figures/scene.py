"""A run as the moving drawing of the machine needs it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.run import Array


@dataclass(frozen=True, eq=False)
class Scene:
    """A run as the drawing needs it; arrays (n,) over rising time_s, up and hoisting positive.

    wound_m: wire taken in by the drum since height 0. torques_nm: one motor each. slack: either fall.
    speed_reference_m_s: of the carriage, where there is one. tension_of, height_of: where these come from.
    """

    name: str
    payload_kg: float
    time_s: Array
    height_m: Array
    speed_m_s: Array
    speed_motor_rad_s: Array
    wound_m: Array
    torques_nm: tuple[Array, ...]
    tension_drum_n: Array
    tension_dead_line_n: Array
    slack: np.ndarray
    speed_reference_m_s: Array | None = None
    tension_of: str = "simulated"
    height_of: str = "simulated"

    def at(self, time_s: Array) -> Scene:
        """The scene at other times. Slack is kept where there was any since the time before."""

        def between(values: Array) -> Array:
            return np.interp(time_s, self.time_s, values)

        edges = np.searchsorted(self.time_s, time_s, side="right")
        before = np.concatenate([[0], edges[:-1]])
        slack = np.array([bool(np.any(self.slack[a : max(b, a + 1)])) for a, b in zip(before, edges, strict=True)])
        reference = self.speed_reference_m_s
        return Scene(
            self.name, self.payload_kg, time_s, between(self.height_m), between(self.speed_m_s),
            between(self.speed_motor_rad_s), between(self.wound_m), tuple(between(t) for t in self.torques_nm),
            between(self.tension_drum_n), between(self.tension_dead_line_n), slack,
            None if reference is None else between(reference), self.tension_of, self.height_of,
        )  # fmt: skip
