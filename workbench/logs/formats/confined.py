"""A process that can open one file and nothing else, where the system knows how.

Linux has Landlock (kernel 5.13 and newer, unless it is switched off): after `confine` this process can open the one
file for reading, and no other file, folder, device or socket of TCP. What is open stays open.
Source: Linux, Documentation/userspace-api/landlock.rst; the numbers of the system calls are those of every processor.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import struct
import sys
from pathlib import Path

from workbench.logs.formats.declared import Limits

_CREATE, _ADD, _RESTRICT, _VERSION = 444, 445, 446, 1
_NO_NEW_PRIVILEGES = 38  # of prctl
_READ_FILE, _BENEATH = 1 << 2, 1
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # version -> rights to files that it handles; 16 in newer ones
_libc = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


def landlock_version() -> int:
    """Of the kernel's interface; 0 where there is none."""
    return 0 if _libc is None else max(int(_libc.syscall(_CREATE, None, 0, _VERSION)), 0)


def confine(file: Path) -> bool:
    """From now on this process can open `file` for reading, and nothing else. False where the system cannot do that."""
    version = landlock_version()
    if not version or _libc is None:
        return False
    files = (1 << _RIGHTS.get(version, 16)) - 1
    network, scope = (0b11 if version >= 4 else 0), (0b11 if version >= 6 else 0)
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    ruleset = _libc.syscall(_CREATE, struct.pack("=QQQ", files, network, scope), size, 0)
    if ruleset < 0:
        return False
    place = os.open(file, getattr(os, "O_PATH", 0) | os.O_CLOEXEC)
    try:
        rule = struct.pack("=Qi", _READ_FILE, place)
        return (
            _libc.syscall(_ADD, ruleset, _BENEATH, rule, 0) == 0
            and _libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0
            and _libc.syscall(_RESTRICT, ruleset, 0) == 0
        )
    finally:
        os.close(place)
        os.close(ruleset)


def limit(limits: Limits) -> None:
    """Processor time, memory beyond what is held already, no core file, no file written. POSIX only."""
    import resource

    def bound(which: int, most: int, beyond: int = 0) -> None:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(which, (most, most + beyond))

    bound(resource.RLIMIT_CPU, max(1, round(limits.seconds)), beyond=2)  # at the second one comes SIGKILL
    bound(resource.RLIMIT_CORE, 0)
    bound(resource.RLIMIT_FSIZE, 0)
    with contextlib.suppress(OSError):  # only Linux has this file; macOS does not keep to this limit anyway
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        bound(resource.RLIMIT_AS, pages * resource.getpagesize() + limits.memory_bytes)
