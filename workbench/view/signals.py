"""Signals of runs over time: a row for signals, a line a run, one cursor and one zoom over all rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np

from workbench.core.names import unit_of, words_of
from workbench.core.run import Array, Run
from workbench.view.panels import Panels
from workbench.view.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, Figure, label, line

COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
DASHES = ("solid", "6px,3px", "2px,2px")
# From a unit that a log has to one that is read more easily, with what the values are multiplied by.
SHOWN_IN: Mapping[str, tuple[str, float]] = {"N": ("kN", 1e-3)}
ROW = 150  # px
MOVES_ABOVE = 0.02  # of the largest speed
BEFORE_S, AFTER_S = 0.5, 3.5  # around the start of a move


@dataclass(frozen=True, eq=False)
class Stretch:
    """What is drawn of a run: from start_s to end_s of its time, shown from zero_s on."""

    run: Run
    start_s: float
    end_s: float
    zero_s: float = 0.0

    @classmethod
    def whole(cls, run: Run) -> Stretch:
        return cls(run, float(run.time_s[0]), float(run.time_s[-1]))

    def cut(self, signal: str) -> tuple[Array, Array]:
        """Time (n,) and values (n,) of the stretch, and the samples that its edges lie between."""
        first, last = np.searchsorted(self.run.time_s, (self.start_s, self.end_s))
        inside = slice(max(int(first) - 1, 0), int(last) + 1)
        return self.run.time_s[inside] - self.zero_s, self.run[signal][inside]


def start_of_move(run: Run) -> Stretch | None:
    """From shortly before the first move on, time counted from there; None for a run without a speed, or at rest."""
    name = next((name for name in run.signals if name.startswith("speed_")), None)
    if name is None:
        return None
    speed = np.abs(np.nan_to_num(run[name]))
    moving = speed > MOVES_ABOVE * float(speed.max())
    if not moving.any():
        return None
    start = float(run.time_s[int(np.argmax(moving))])
    return Stretch(run, start - BEFORE_S, start + AFTER_S, start)


def browser(
    stretches: Sequence[Stretch], rows: Sequence[str | Sequence[str]], references: Sequence[str] = ()
) -> Figure:
    """A row for each signal, or for several of one unit; a line for each run that has it. Long runs are thinned; their
    peaks stay.

    references: of each run the reference that it followed, whose name and colour it then has.
    """
    grouped = [[row] if isinstance(row, str) else list(row) for row in rows]
    units = [[SHOWN_IN.get(unit_of(signal), (unit_of(signal), 1.0)) for signal in row] for row in grouped]
    heads = [
        f"{'<br>'.join(map(_words, row))}<br>({', '.join(dict.fromkeys(unit or '–' for unit, _ in own))})"
        for row, own in zip(grouped, units, strict=True)
    ]
    panels = Panels("", heads, one_cursor=True)
    for number, stretch in enumerate(stretches):
        name = label(references[number]) if references else stretch.run.name
        for row, (signals, own) in enumerate(zip(grouped, units, strict=True)):
            for k, (signal, (unit, factor)) in enumerate(zip(signals, own, strict=True)):
                if signal in stretch.run:
                    look = line(references[number], number, 1.5) if references else _look(number, k)
                    time, values = stretch.cut(signal)
                    called = name if k == 0 else f"{name}, {words_of(signal)}"
                    panels.line(row, 0, time, factor * values, called, look, unit)
    return panels.figure(ROW * len(grouped) + 130)


def _look(number: int, signal: int = 0) -> dict[str, Any]:
    dash = DASHES[(number // len(COLOURS) + signal) % len(DASHES)]
    return {"color": COLOURS[number % len(COLOURS)], "width": 1.5, "simplify": False, "dash": dash}


def _words(signal: str) -> str:
    """A signal's name in words, in lines that a row has room for."""
    return "<br>".join(wrap(words_of(signal), 18))
