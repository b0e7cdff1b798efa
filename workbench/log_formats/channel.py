"""Messages between a process and its worker: frames of a kind, a number and bytes.

The bytes are JSON, or samples as they lie in memory. Nothing from a worker is unpickled or executed.
"""

from __future__ import annotations

import json
import struct
from typing import IO, Any

HEAD = struct.Struct("<cIQ")
IMPORT, OPEN, READ, CLOSE = b"i", b"o", b"r", b"c"  # asked
NAMES, PIECE, DONE, ERROR = b"n", b"p", b"d", b"e"  # answered
MOST_TEXT = 64_000_000  # bytes of a frame of JSON


def send(stream: IO[bytes], kind: bytes, payload: Any = b"", number: int = 0) -> None:
    """One frame, whole; the payload is bytes or a contiguous array. The stream is not buffered."""
    view = memoryview(payload).cast("B") if len(payload) else memoryview(b"")
    _write(stream, memoryview(HEAD.pack(kind, number, len(view))))
    _write(stream, view)


def send_text(stream: IO[bytes], kind: bytes, data: object) -> None:
    send(stream, kind, json.dumps(data).encode())


def head(stream: IO[bytes]) -> tuple[bytes, int, int]:
    """(kind, number, length of what follows). EOFError when the other side is gone."""
    raw = bytearray(HEAD.size)
    fill(stream, raw)
    kind, number, length = HEAD.unpack(raw)
    return kind, number, length


def text(stream: IO[bytes], length: int) -> Any:
    """A frame's JSON."""
    if length > MOST_TEXT:
        raise EOFError
    raw = bytearray(length)
    fill(stream, raw)
    return json.loads(raw)


def fill(stream: IO[bytes], into: Any) -> None:
    """Exactly as many bytes as `into` holds. EOFError when fewer come."""
    view = memoryview(into).cast("B") if len(into) else memoryview(b"")
    while view:
        count = stream.readinto(view)  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        view = view[count:]


def _write(stream: IO[bytes], view: memoryview) -> None:
    while view:
        view = view[stream.write(view) :]
