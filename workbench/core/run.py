"""A run: signals over time, measured on a machine or simulated. Both are this one type."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workbench.core.errors import InputError, check_known
from workbench.core.shown import Shown

if TYPE_CHECKING:
    import pyarrow
    import xarray

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Run(Shown):
    """Signals of one run of one machine.

    time_s: (n,) rising, need not be regular. signals: name -> (n,), names and units of
    the campaign format; up, hoisting and forward positive. `payload_kg` is what the
    carriage holds (0 on an axis), `start_position_m` the carriage height at the first
    sample, `start_time_s` when the run began in its campaign. `notes` list repairs and
    warnings of the reader.
    """

    name: str
    time_s: Array
    signals: Mapping[str, Array]
    payload_kg: float = 0.0
    start_position_m: float = 0.0
    start_time_s: float = 0.0
    source: str = "simulated"
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        n = len(self.time_s)
        for name, values in self.signals.items():
            if np.shape(values) != (n,):
                raise ValueError(f"run {self.name}: signal {name} has shape {np.shape(values)}, time has ({n},)")
        object.__setattr__(self, "signals", MappingProxyType(dict(self.signals)))

    def __reduce__(self) -> tuple[Any, ...]:
        """A mapping that cannot be changed cannot be pickled either."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return type(self), tuple({**values, "signals": dict(self.signals)}.values())

    def __getitem__(self, signal: str) -> Array:
        """A signal (n,). InputError with the nearest name where the run has none of this name."""
        check_known(f"run {self.name} has no signal", signal, self.signals)
        return self.signals[signal]

    def __contains__(self, signal: str) -> bool:
        return signal in self.signals

    def to_xarray(self) -> xarray.Dataset:
        """The signals over time; the run's other values are attributes."""
        try:
            import xarray
        except ImportError as error:
            raise InputError("to_xarray() needs xarray, which is optional; pip install xarray") from error
        signals = {name: ("time_s", values) for name, values in self.signals.items()}
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        del values["time_s"], values["signals"]
        return xarray.Dataset(signals, {"time_s": self.time_s}, {**values, "notes": list(self.notes)})

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])

    @cached_property
    def sample_time_s(self) -> float:
        """The median step of time."""
        return float(np.median(np.diff(self.time_s)))


def averaged(run: Run, many: int) -> Run:
    """The run as a slower logger shows it: means of `many` samples; what is left over at its end is left out."""
    if many <= 1:
        return run
    whole = len(run.time_s) // many * many

    def means(values: Array) -> Array:
        return np.asarray(np.mean(values[:whole].reshape(-1, many), axis=1))

    signals = {name: means(values) for name, values in run.signals.items()}
    return replace(run, time_s=means(run.time_s), signals=signals)


def integrated(rate: Array, time_s: Array) -> Array:
    """(n,) from 0, by trapezoids."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s))))


def stretches(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First samples, and ones after the last, of the stretches of chosen samples."""
    edges = np.diff(np.concatenate(([0], chosen.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def float_array(column: pyarrow.ChunkedArray | pyarrow.Array) -> Array:
    """An Arrow column of whole, floating or decimal numbers as float64, null as NaN; a copy.

    Arrow's own to_numpy would load pandas, its cast and fill_null take a third more.
    """
    import pyarrow as pa

    parts = []
    for chunk in filter(len, getattr(column, "chunks", [column])):
        if not (pa.types.is_integer(chunk.type) or pa.types.is_floating(chunk.type)):
            chunk = chunk.cast(pa.float64(), safe=False)
        end = chunk.offset + len(chunk)
        valid, values = chunk.buffers()
        numbers = np.frombuffer(values, dtype=chunk.type.to_pandas_dtype(), count=end)[chunk.offset :]
        parts.append(numbers.astype(np.float64))
        if valid is not None and chunk.null_count:
            bits = np.unpackbits(np.frombuffer(valid, dtype=np.uint8), count=end, bitorder="little")
            parts[-1][bits[chunk.offset :] == 0] = np.nan
    return np.concatenate(parts) if parts else np.empty(0)
