"""Arrow columns from plain values and back, by way of their buffers.

`pyarrow.array` and `to_numpy` would do, but they import pandas wherever that is installed, which costs a study
a quarter of its two seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.logs.formats.arrow import float_array


def numbers(values: Sequence[float | None] | Array) -> Any:
    """A float64 column; None becomes a null."""
    import pyarrow as pa

    if isinstance(values, np.ndarray):
        return pa.Array.from_buffers(
            pa.float64(), len(values), [None, pa.py_buffer(np.ascontiguousarray(values, dtype=np.float64))]
        )
    known = np.array([value is not None for value in values], dtype=bool)
    data = np.array([0.0 if value is None else value for value in values], dtype=np.float64)
    bits = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(data), [bits, pa.py_buffer(data)])


def texts(values: Sequence[str]) -> Any:
    """A string column."""
    import pyarrow as pa

    encoded = [value.encode() for value in values]
    ends = np.cumsum([0, *(len(value) for value in encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(values), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))


def table(columns: Mapping[str, Any]) -> Any:
    """A table of such columns."""
    import pyarrow as pa

    return pa.Table.from_arrays(list(columns.values()), names=list(columns))


def columns(table: Any) -> dict[str, Array]:
    """The float64 columns of a table as arrays, by name."""
    return {name: float_array(table[name]) for name in table.column_names}


def parquet_bytes(table: Any, **how: Any) -> bytes:
    """The table as the bytes of a Parquet file; `how` is Arrow's own way of writing it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    stream = pa.BufferOutputStream()
    pq.write_table(table, stream, **how)
    data: bytes = stream.getvalue().to_pybytes()
    return data
