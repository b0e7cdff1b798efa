"""Channels of several rates as columns over one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array

TIME = "time_s"


@dataclass(frozen=True)
class Channel:
    """One channel of a file. unit: as the file says it, "" where it does not. time_s, values: (n,)."""

    name: str
    unit: str
    time_s: Array
    values: Array


def titled(name: str, unit: str) -> str:
    """A column's name with its unit behind it."""
    return f"{name} [{unit}]" if unit else name


def distinct(names: Sequence[str]) -> list[str]:
    """Unique names: repeated ones get a number."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return out


def at_times(channel: Channel, time_s: Array) -> Array:
    """The channel at other times: linear between its samples, missing beyond its ends."""
    known = np.isfinite(channel.values) & np.isfinite(channel.time_s)
    t, v = channel.time_s[known], channel.values[known]
    if len(t) == len(time_s) and np.array_equal(t, time_s):
        return v
    if len(t) == 0:
        return np.full(len(time_s), np.nan)
    # Half a step of its own beyond its ends still belongs to it: clocks of groups do not begin at the same moment.
    slack = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    out = np.interp(time_s, t, v)
    out[(time_s < t[0] - slack) | (time_s > t[-1] + slack)] = np.nan
    return np.asarray(out)


def fastest(channels: Sequence[Channel]) -> Array:
    """The time of the channel with the most samples. ValueError where there is none."""
    return max(channels, key=lambda channel: len(channel.time_s)).time_s
