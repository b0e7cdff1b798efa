"""Arrow's columns as our own arrays. Arrow's own to_numpy would load pandas, its cast and fill_null a third more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from workbench.core.run import Array

if TYPE_CHECKING:
    import pyarrow


def float_array(column: pyarrow.ChunkedArray | pyarrow.Array) -> Array:
    """An Arrow column of whole, floating or decimal numbers as float64, null as NaN; a copy."""
    chunks = [_floats(chunk) for chunk in getattr(column, "chunks", [column]) if len(chunk)]
    return np.concatenate(chunks) if chunks else np.empty(0)


def _floats(chunk: pyarrow.Array) -> Array:
    import pyarrow as pa

    if not (pa.types.is_integer(chunk.type) or pa.types.is_floating(chunk.type)):
        chunk = chunk.cast(pa.float64(), safe=False)
    valid, values = chunk.buffers()
    raw = np.frombuffer(values, dtype=chunk.type.to_pandas_dtype(), count=chunk.offset + len(chunk))
    numbers = raw[chunk.offset :].astype(np.float64)
    if valid is not None and chunk.null_count:
        bits = np.unpackbits(np.frombuffer(valid, dtype=np.uint8), count=chunk.offset + len(chunk), bitorder="little")
        numbers[bits[chunk.offset :] == 0] = np.nan
    return numbers
