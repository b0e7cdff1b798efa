"""What the page knows of its plant: the latest rows, drawn anew a few times a second."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.plant.process import PlantProcess
from workbench.dashboard.plant.recorder import EVERY_S, KEPT_S
from workbench.run import Array

_KEPT = "plant live rows"


@dataclass
class Latest:
    """Rows of numbers by column, and the rest of the worker's last answer."""

    rows: deque[list[float]] = field(default_factory=lambda: deque(maxlen=round(KEPT_S / EVERY_S)))
    generation: int = -1
    next: int = 0
    answer: dict[str, Any] = field(default_factory=dict)

    @property
    def columns(self) -> dict[str, Array]:
        """Name -> (n,)."""
        names = self.answer["columns"]
        table = np.array(self.rows, dtype=float).reshape(len(self.rows), len(names))
        return {name: table[:, i] for i, name in enumerate(names)}

    @property
    def now(self) -> dict[str, float]:
        now: dict[str, float] = self.answer["now"]
        return now

    def told(self, flag: str) -> bool:
        return self.now.get(f"is_{flag}", 0.0) > 0.0


def latest(process: PlantProcess) -> Latest:
    """Asks for what is new. InputError where the plant has gone."""
    kept = session.get(_KEPT, Latest, Latest())
    answer = process.ask({"rows": [kept.generation, kept.next]})
    if answer["generation"] != kept.generation:
        kept.rows.clear()
    kept.rows.extend(answer.pop("rows"))
    kept.generation, kept.next, kept.answer = answer["generation"], answer["next"], answer
    st.session_state[_KEPT] = kept
    return kept
