"""How much an uploaded log would take once read: Parquet and MAT files are compressed, and may be bombs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from workbench.errors import InputError

MB = 1_000_000
MOST_ROWS, MOST_BYTES = 5 * MB, 400 * MB
_HEADER, _COMPRESSED = 128, 15  # of a MAT file of version 5: bytes before the first element; an element's type
_CHUNK = 1 << 20


def check_unpacked(file: Path) -> None:
    """InputError for a log with too many samples. What is damaged is left for the reader to say."""
    suffix = file.suffix.lower()
    rows, unpacked = 0, 0
    if suffix == ".csv":
        rows = _lines(file)
    elif suffix in (".parquet", ".pq"):
        rows, unpacked = _parquet_size(file)
    elif suffix == ".mat":
        unpacked = _mat_bytes(file)
    if rows > MOST_ROWS:
        raise InputError(f"holds {rows / MB:.0f} million rows, expected at most {MOST_ROWS // MB}; cut it", file=file)
    if unpacked > MOST_BYTES:
        raise InputError(f"unpacks to more than {MOST_BYTES // MB} MB; cut it or leave columns out", file=file)


def _lines(file: Path) -> int:
    with file.open("rb") as stream:
        return sum(chunk.count(b"\n") for chunk in iter(lambda: stream.read(_CHUNK), b""))


def _parquet_size(file: Path) -> tuple[int, int]:
    """Rows, and bytes of all columns unpacked, as the file's footer has them."""
    import pyarrow as pa
    import pyarrow.parquet

    try:
        about = pyarrow.parquet.ParquetFile(file).metadata
        return int(about.num_rows), sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
    except (pa.ArrowException, OSError, ValueError, MemoryError, OverflowError):
        return 0, 0


def _mat_bytes(file: Path) -> int:
    """Bytes of all elements, unpacked piece by piece, no further than to the bound."""
    content = file.read_bytes()
    order = "<" if content[126:128] == b"IM" else ">"
    at, total = _HEADER, 0
    while at + 8 <= len(content) and total <= MOST_BYTES:
        kind, size = struct.unpack_from(f"{order}II", content, at)
        element = content[at + 8 : at + 8 + size]
        total += _inflated(element, MOST_BYTES - total) if kind == _COMPRESSED else len(element)
        at += 8 + size
    return total


def _inflated(packed: bytes, most: int) -> int:
    """How many bytes come out, counted to just above `most`."""
    unpacker, total = zlib.decompressobj(), 0
    try:
        while packed and total <= most and not unpacker.eof:
            total += len(unpacker.decompress(packed, _CHUNK))
            packed = unpacker.unconsumed_tail
    except zlib.error:
        pass  # the reader says so; what came out until here counts
    return total
