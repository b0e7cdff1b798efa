"""TDMS logs (National Instruments): the channels of all groups over the time of the fastest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.logs.formats.declared import Channel, Limits, LogFormat, Opened, distinct, over_time, titled

_INCREMENT = "wf_increment"


def open_tdms(file: Path) -> Opened:
    """Lists the channels of numbers, each name with its unit; `time_s` first where channels carry their own rate."""
    if not file.stat().st_size:
        raise InputError("is empty")
    try:
        from nptdms import TdmsFile
    except ImportError as error:
        raise InputError("TDMS files need the extra 'import': pip install '.[import]'") from error
    # As a stream: of a path, the index file beside it would be opened too.
    tdms = TdmsFile.open(file.open("rb"))
    channels = [c for group in tdms.groups() for c in group.channels() if len(c) and c.dtype.kind in "fiub"]
    if not channels:
        raise InputError("holds no channels of numbers with samples")
    titles = distinct([titled(c.name, str(c.properties.get("unit_string", ""))) for c in channels])
    known = dict(zip(titles, channels, strict=True))
    timed = [c for c in channels if c.properties.get(_INCREMENT)]

    def values(name: str) -> Array:
        return np.asarray(known[name][:], dtype=np.float64)

    if timed:
        longest = max(timed, key=len)

        def channel(name: str) -> Channel:
            own = known[name] if known[name].properties.get(_INCREMENT) else longest
            return Channel(name, "", _time(own, len(known[name])), values(name))

        return over_time(titles, len(longest), lambda: _time(longest, len(longest)), channel)

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        rows = max(len(known[name]) for name in wanted)
        limits.check(rows, rows * len(wanted))
        yield from enumerate(map(values, wanted))

    return Opened(titles, pieces)


def _time(channel: Any, samples: int) -> Array:
    step, start = float(channel.properties[_INCREMENT]), float(channel.properties.get("wf_start_offset", 0.0))
    return np.asarray(start + step * np.arange(samples), dtype=np.float64)


TDMS = LogFormat(
    name="TDMS",
    suffixes=(".tdms",),
    open=open_tdms,
    about=(
        "National Instruments, extra `import`. The channels of numbers of all groups, each named with its unit. Where "
        "channels carry their rate (`wf_increment`), `time_s` is the time of the longest, and the others are taken at "
        "it, linear between their samples and missing beyond their ends."
    ),
    imports=("nptdms",),
)
