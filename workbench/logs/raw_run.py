"""One run while it is read: its samples, what is said of it, and how its messages name things."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import StringConstraints

from workbench.core.errors import InputError
from workbench.core.record import Finite, Payload, Record, Start
from workbench.core.run import Array, integrated
from workbench.machines import Kind, Machine, kind_of

WIDE = 200.0  # samples
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f/\\]+$")]


class Entry(Record):
    """One run as runs.yaml lists it. Some kinds of machine need payload and start position; see `read_runs`."""

    name: Name
    file: Annotated[str, StringConstraints(min_length=1)]
    payload_kg: Payload | None = None
    start_position_m: Start | None = None
    start_time_s: Finite | None = None


def seconds(time_s: float) -> str:
    """3.21 s, without the tail of digits of a binary fraction."""
    return f"{float(time_s):.9g} s"


def is_constant(column: Array) -> bool:
    return bool(column.min() == column.max())


def smoothed(values: Array, width: float) -> Array:
    """Convolved with a Gaussian of `width` samples, one standard deviation, cut at four; beyond the ends the first and
    last value stand. Wide ones by FFT: directly, the time goes with the square of a log's length."""
    reach = int(4.0 * width + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(values - values[0], reach, mode="edge")  # about zero, for the rounding of the transform
    if width < WIDE:
        return np.convolve(padded, kernel / kernel.sum(), "valid") + values[0]
    from scipy.fft import irfft, next_fast_len, rfft  # scipy.signal takes half a second to import

    size = next_fast_len(len(padded), real=True)  # what wraps around falls into the margin
    both = irfft(rfft(padded, size) * rfft(kernel / kernel.sum(), size), size)
    return np.asarray(both[2 * reach : len(padded)]) + values[0]


@dataclass
class RawRun:
    """A check changes `time_s` and `values`, adds to `notes`, or raises `fault`.

    values: signal -> (n,) in SI, NaN where a sample is missing. columns: signal -> its column in the file.
    """

    entry: Entry
    file: Path
    machine: Machine
    columns: Mapping[str, str]
    row_name: Callable[[int], str]
    time_s: Array
    values: dict[str, Array]
    notes: list[str] = field(default_factory=list)

    @cached_property
    def kind(self) -> Kind:
        return kind_of(self.machine)

    @property
    def payload_kg(self) -> float:
        return self.entry.payload_kg or 0.0

    @property
    def position(self) -> str:
        """The position of the driven coordinate, as logs call it."""
        return self.kind.plant.positions[0]

    @property
    def speed(self) -> str:
        """The speed of the driven coordinate, as logs call it."""
        return self.kind.plant.speeds[0]

    @property
    def motion(self) -> list[str]:
        """Position and speed, as far as they are logged."""
        return [name for name in (self.position, self.speed) if name in self.values]

    @property
    def needed(self) -> list[str]:
        """The signals this run cannot do without: of each group the first alternative that is whole."""
        found: list[str] = []
        for group in self.kind.signals.needed:
            whole = (alternative for alternative in group if all(name in self.values for name in alternative))
            found += next(whole, ())
        return found

    def label(self, signal: str) -> str:
        """The signal's name, with the column's where that is another one."""
        column = self.columns.get(signal, signal)
        return signal if column == signal else f"{signal} (column '{column}')"

    def fault(self, problem: str) -> InputError:
        return InputError(problem, file=self.file, place=self.entry.name)

    def drop(self, signal: str, why: str) -> None:
        self.notes.append(f"{self.label(signal)} dropped: {why}")
        del self.values[signal]

    def cut(self, first: int, end: int) -> None:
        """Keep the samples first … end − 1."""
        self.time_s = self.time_s[first:end]
        self.values = {name: column[first:end] for name, column in self.values.items()}

    def begun_at(self, first: int, name: str, motion: Mapping[str, Array]) -> Entry:
        """The entry of a run that begins at sample `first` only: later, and where the motion has taken the machine.

        motion: the signals without missing samples.
        """
        if first == 0:
            return self.entry
        start = self.entry.start_position_m
        if start is not None or self.position not in motion:
            at = motion[self.position] if self.position in motion else integrated(motion[self.speed], self.time_s)
            start = (start or 0.0) + self.kind.transmission_of(self.machine) * float(at[first] - at[0])
        began = (self.entry.start_time_s or 0.0) + float(self.time_s[first] - self.time_s[0])
        return self.entry.model_copy(update={"name": name, "start_position_m": start, "start_time_s": began})

    def part(self, first: int, end: int, entry: Entry, note: str) -> RawRun:
        made = replace(self, entry=entry, notes=[note, *self.notes])
        made.cut(first, end)
        return made
