"""The time that processes waited for a processor on a busy computer."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path


def kept_waiting_s(pid: int, thread: int) -> float:
    """The waiting time of process `pid`, its children and a thread of this process so far. Linux only; elsewhere 0.

    Source: /proc/PID/schedstat, second number: time spent waiting on a run queue, ns.
    """
    pids = [str(pid)]
    with contextlib.suppress(OSError):
        pids += Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    total = 0.0
    for place in (*pids, f"self/task/{thread}"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            total += int(Path(f"/proc/{place}/schedstat").read_text().split()[1]) / 1e9
    return total


def this_thread() -> int:
    """The id of this thread for `kept_waiting_s`."""
    return threading.get_native_id()
