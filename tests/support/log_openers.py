"""Openers of made-up log formats: one that works, and some that do what a damaged file makes a parser do."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.logs.formats.declared import Limits, Opened

NAMES = ("time_s", "torque_motor1_nm", "torque_motor2_nm", "speed_motor_rad_s")


def open_npz(file: Path) -> Opened:
    """Arrays that numpy has saved, none of them pickled."""
    with np.load(file, allow_pickle=False) as arrays:
        columns = {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays.files}
    return Opened(list(columns), lambda wanted, limits: ((i, columns[name]) for i, name in enumerate(wanted)))


def crash(file: Path) -> Opened:
    os.kill(os.getpid(), signal.SIGSEGV)
    raise AssertionError


def crash_midway(file: Path) -> Opened:
    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        yield 0, np.arange(100.0)
        os.kill(os.getpid(), signal.SIGSEGV)

    return Opened(NAMES, pieces)


def spin(file: Path) -> Opened:
    while True:
        pass


def sleep(file: Path) -> Opened:
    time.sleep(600.0)
    raise AssertionError


def devour(file: Path) -> Opened:
    held = np.ones(10**9)
    return Opened([str(held[0])], lambda wanted, limits: iter(()))


def pour(file: Path) -> Opened:
    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        while True:
            yield 0, np.zeros(100_000)

    return Opened(NAMES, pieces)


def stumble(file: Path) -> Opened:
    raise LookupError("no such \x1b[31mrecord\x07\nmore of it")


def leave(file: Path) -> Opened:
    raise SystemExit(0)


def chatter(file: Path) -> Opened:
    print("a library that prints", flush=True)
    os.write(1, b"\x00" * 64)
    raise InputError("says too much")


def uneven(file: Path) -> Opened:
    return Opened(NAMES, lambda wanted, limits: ((i, np.arange(100.0 + i)) for i in range(len(wanted))))


def ignored_interrupt(file: Path) -> Opened:
    ignored = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    raise InputError(f"SIGINT is {'ignored' if ignored else 'heard'}")


def look_around(file: Path) -> Opened:
    """What damaged or hostile files may make a parser do: open other files, list folders, write, run a program."""
    assert file.read_bytes() == b"something"
    new = os.O_WRONLY | os.O_CREAT
    for other, flags in ((__file__, os.O_RDONLY), ("/etc/passwd", os.O_RDONLY), (file, new), (f"{file}.new", new)):
        with contextlib.suppress(PermissionError):
            raise InputError(f"opens {os.open(other, flags)} of {other}")
    with contextlib.suppress(PermissionError):
        raise InputError(f"lists {os.listdir('/')}")
    with contextlib.suppress(PermissionError):
        os.execv("/bin/true", ["true"])
    raise InputError("nothing else can be opened")


def call_home(file: Path) -> Opened:
    with socket.socket() as line, contextlib.suppress(PermissionError):
        line.settimeout(1.0)
        line.connect(("127.0.0.1", 9))
    with socket.socket() as line:
        try:
            line.bind(("127.0.0.1", 0))
        except PermissionError:
            raise InputError("nothing else can be opened") from None
    raise InputError("listens")
