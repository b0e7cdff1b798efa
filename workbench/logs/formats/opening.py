"""Opens a log as columns of numbers, within the limits of its format: here, or apart, in a process that may die and
that can open nothing but the one log.

Where the system can fork, the worker itself never touches a file: it loads the parsers once, and each log is parsed by
a child of its own, with limits on processor time and memory. A child that dies takes the worker with it, by exit status
128 + signal. Elsewhere (Windows) the worker parses one log and ends, and only time is limited.

Either side sends lines of JSON; samples follow theirs as they lie in memory. Nothing that a worker sends is unpickled
or executed.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib
import json
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from workbench.core.declared import library
from workbench.core.errors import InputError
from workbench.core.input_file import readable_file
from workbench.core.run import Array
from workbench.logs.formats.declared import Limits, LogFormat, Opened, plain_errors

# Every LogFormat of a module NAME_file.py; CSV, which needs no extra, is named first.
FORMATS = library("workbench.logs.formats", LogFormat, "_file")
# What people also keep logs in. It is not read, and the error says what it is.
_NOT_YET = {
    ".dat": "MDF3", ".xlsx": "Excel", ".xls": "Excel", ".gz": "gzip",
    ".zip": "zip", ".h5": "HDF5", ".hdf5": "HDF5", ".feather": "Feather",
}  # fmt: skip


def suffixes() -> tuple[str, ...]:
    """The endings of all log files that are read, such as ".csv"."""
    return tuple(suffix for log_format in FORMATS for suffix in log_format.suffixes)


def listed() -> str:
    """The first ending of each format as a sentence has them: ".csv, .mat or .parquet"."""
    first = [log_format.suffixes[0] for log_format in FORMATS]
    return " or ".join([", ".join(first[:-1]), first[-1]])


def format_of(file: Path) -> LogFormat:
    """The format of a file by its ending. InputError for one that is not read."""
    suffix = file.suffix.lower()
    for log_format in FORMATS:
        if suffix in log_format.suffixes:
            return log_format
    what = f"{_NOT_YET[suffix]} files are" if suffix in _NOT_YET else f"a file that ends in '{suffix}' is"
    raise InputError(f"{what} not read by this version; save the log as {listed()}", file=file)


@dataclass(frozen=True)
class LogFile:
    """An open log: its column names. read: its columns, (n,) float64 with NaN for an empty cell, when they are asked
    for. row_name(i): data row i (from 0) as the user finds it, "line 12" or "row 11"."""

    file: Path
    names: tuple[str, ...]
    read: Callable[[Sequence[str]], Mapping[str, Array]]
    row_name: Callable[[int], str]


@contextmanager
def open_log(file: Path, *, uploaded: bool = False) -> Iterator[LogFile]:
    """Open a log file without reading its samples.

    uploaded: the file is from another person; it is parsed in a worker whatever its format, with lower limits.
    InputError, naming the file, for an unknown format and for a damaged file, including one on
    which the worker crashes or runs out of time or memory.
    """
    log_format = format_of(readable_file(file, "log"))
    limits = log_format.uploaded if uploaded else log_format.own
    opening = (opened_apart if log_format.isolated or uploaded else _opened_here)(file, log_format, limits)
    with _naming(file):
        opened = opening.__enter__()

    def read(wanted: Sequence[str]) -> Mapping[str, Array]:
        parts: list[list[Array]] = [[] for _ in wanted]
        joined = {}
        with _naming(file):
            for column, piece in limits.counted(opened.pieces(wanted, limits), len(wanted)):
                parts[column].append(piece)
            for name, part in zip(wanted, parts, strict=True):  # pieces are freed as they are joined
                joined[name] = np.concatenate(part) if part else np.empty(0)
                part.clear()
            if len({len(column) for column in joined.values()}) > 1:
                listed = ", ".join(f"{name} {len(column)}" for name, column in joined.items())
                raise InputError(f"its columns differ in length: {listed}")
        return joined

    try:
        names = tuple(opened.names)
        if doubled := [name for name in names if names.count(name) > 1]:
            raise InputError(f"column '{doubled[0]}' is doubled", file=file)
        yield LogFile(file, names, read, lambda row: log_format.row_name(file, row))
    finally:
        opening.__exit__(None, None, None)


def expect(files: Iterable[Path], *, uploaded: bool = False) -> None:
    """Start the worker that these logs will need, if any, so that it is ready for the first one."""
    imports: dict[str, None] = {}
    for file in files:
        try:
            log_format = format_of(file)
        except InputError:
            continue
        if uploaded or log_format.isolated:
            imports |= dict.fromkeys(log_format.imports)
    if imports:  # it loads them while the caller goes on
        worker = _taken()
        worker.ask({"imports": list(imports)})
        worker.close()


@contextmanager
def _opened_here(file: Path, log_format: LogFormat, limits: Limits) -> Iterator[Opened]:
    with plain_errors(log_format.name, limits):
        opened = log_format.open(file)

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        with plain_errors(log_format.name, limits):
            yield from opened.pieces(wanted, limits)

    yield Opened(opened.names, pieces)


@contextmanager
def _naming(file: Path) -> Iterator[None]:
    """Add the file's name to errors without one."""
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(error.problem, file=file, line=error.line, place=error.place) from error


IDLE_S = 30.0  # without a question for so long, a worker ends
MOST_IDLE = 2
WALL = 20.0  # times the limit of processor time: then it is ended whatever it waits for
MOST_TEXT = 64_000_000  # bytes of a line
# What text in a file may be in, and errors are written with: a parser can no longer look for it then.
CODECS = (
    "ascii", "charmap", "cp1252", "cp437", "iso8859_1", "iso8859_15", "latin_1", "raw_unicode_escape",
    "unicode_escape", "utf_16", "utf_16_be", "utf_16_le", "utf_32", "utf_8", "utf_8_sig",
)  # fmt: skip
# The path is that of this process, so that both load the same files; nothing of the working folder comes first.
_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); import workbench.logs.formats.opening as w; w.main()"
_CALM = {
    "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMEXPR_NUM_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system", "HDF5_PLUGIN_PRELOAD": "::",  # a file names no library to be loaded
}  # fmt: skip
_CAN_FORK = os.name == "posix"

# Linux has Landlock (kernel 5.13 and newer, unless it is switched off). Source: Linux,
# Documentation/userspace-api/landlock.rst; the numbers of the system calls are those of every processor.
_CREATE, _ADD, _RESTRICT, _VERSION = 444, 445, 446, 1
_NO_NEW_PRIVILEGES = 38  # of prctl
_READ_FILE, _BENEATH = 1 << 2, 1
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # version -> rights to files that it handles; 16 in newer ones
_libc = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None

_idle: list[Worker] = []
_lock = threading.Lock()


# What runs in the worker


def main() -> None:
    """Answers what comes on standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell in the background has its children ignore it
    requests = os.fdopen(0, "rb", buffering=0, closefd=False)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    while (not _CAN_FORK or select.select([0], [], [], IDLE_S)[0]) and (line := requests.readline()):
        asked = json.loads(line)
        for name in (*(f"encodings.{codec}" for codec in CODECS), *asked["imports"]):
            with contextlib.suppress(ImportError):  # the opener says what is not installed
                importlib.import_module(name)
        if "file" in asked and not _CAN_FORK:
            _serve(asked, requests, answers)
        elif "file" in asked:
            importlib.import_module(asked["open"][0])
            if (child := os.fork()) == 0:
                try:
                    limit(Limits(**asked["limits"]))
                    with contextlib.suppress(OSError):  # the file is gone: the opener says so
                        confine(Path(asked["file"]))
                    _serve(asked, requests, answers)
                    os._exit(0)
                finally:
                    os._exit(1)
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            if status:
                os._exit(128 - status if status < 0 else status)


def _serve(asked: dict[str, Any], requests: IO[bytes], answers: IO[bytes]) -> None:
    """One log: its names, then the columns that are asked for."""
    limits = Limits(**asked["limits"])

    def say(payload: Any = b"", **what: Any) -> None:
        answers.write(json.dumps(what).encode() + b"\n")
        answers.write(payload)
        answers.flush()

    try:
        with plain_errors(asked["name"], limits):
            module, function = asked["open"]
            opened = getattr(importlib.import_module(module), function)(Path(asked["file"]))
        say(names=list(opened.names))
        wanted = json.loads(requests.readline() or "[]")
        with plain_errors(asked["name"], limits):
            for column, piece in limits.counted(opened.pieces(wanted, limits), len(wanted)) if wanted else ():
                say(np.ascontiguousarray(piece).tobytes(), column=column, samples=len(piece))
        say()
    except InputError as error:
        say(error=[error.problem, error.line, error.place])


def landlock_version() -> int:
    """Of the kernel's interface; 0 where there is none."""
    return 0 if _libc is None else max(int(_libc.syscall(_CREATE, None, 0, _VERSION)), 0)


def confine(file: Path) -> bool:
    """From now on this process can open `file` for reading, and no other file, folder, device or TCP socket. What is
    open stays open. False where the system cannot do that."""
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

    seconds = max(1, round(limits.seconds))
    bounds = {resource.RLIMIT_CPU: (seconds, seconds + 2)}  # at the second one comes SIGKILL
    bounds |= {resource.RLIMIT_CORE: (0, 0), resource.RLIMIT_FSIZE: (0, 0)}
    with contextlib.suppress(OSError):  # only Linux has this file; macOS does not keep to this limit anyway
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + limits.memory_bytes
        bounds[resource.RLIMIT_AS] = (most, most)
    for which, bound in bounds.items():
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(which, bound)


# What this process sees of it


@contextmanager
def opened_apart(file: Path, log_format: LogFormat, limits: Limits) -> Iterator[Opened]:
    """Open a log in a worker. InputError, without the file's name, for whatever happens to the worker."""
    worker = _taken()
    try:
        yield Opened(worker.names(file, log_format, limits), worker.pieces)
    finally:
        worker.close()


def _taken() -> Worker:
    """A worker that runs and will not end before the next request."""
    with _lock:
        while _idle:
            worker = _idle.pop()
            if worker.process.poll() is None and time.monotonic() - worker.used_s < IDLE_S / 2:
                return worker
            worker.end()
    return Worker()


class Worker:
    """One worker process. idle: no log is open; late: it was ended for the time that it took."""

    def __init__(self) -> None:
        # A session of its own: Ctrl-C is for the process that asks, which ends its worker itself.
        apart: dict[str, Any] = {"start_new_session": True} if _CAN_FORK else {"creationflags": 0x200}
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-c", _CODE, json.dumps([path or os.getcwd() for path in sys.path])],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env={**os.environ, **_CALM},
            **apart,
        )  # fmt: skip
        self.requests, self.answers = self.process.stdin, self.process.stdout
        self.idle, self.late, self.used_s = True, False, time.monotonic()

    def ask(self, what: object) -> None:
        with contextlib.suppress(OSError):  # it is gone: the answer that does not come says so
            self.requests.write(json.dumps(what).encode() + b"\n")  # type: ignore[union-attr]
            self.requests.flush()  # type: ignore[union-attr]

    def _answer(self) -> dict[str, Any]:
        line = self.answers.readline(MOST_TEXT)  # type: ignore[union-attr]
        answer = json.loads(line) if line.endswith(b"\n") else None
        if not isinstance(answer, dict):
            raise EOFError
        if "error" in answer:
            self.idle = True
            problem, number, place = answer["error"]
            raise InputError(problem, line=number, place=place)
        return answer

    def names(self, file: Path, log_format: LogFormat, limits: Limits) -> list[str]:
        """What columns the log has, before its samples are read."""
        self.idle = False
        self.ask({
            "file": os.path.abspath(file), "name": log_format.name, "imports": log_format.imports,
            "open": (log_format.open.__module__, log_format.open.__qualname__), "limits": asdict(limits),
        })  # fmt: skip
        with self._watched(limits):
            return [str(name) for name in self._answer()["names"]]

    def pieces(self, wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        """The samples as they come."""
        self.idle = not wanted
        self.ask(list(wanted))
        with self._watched(limits):
            while "column" in (answer := self._answer()):
                column, samples = int(answer["column"]), int(answer["samples"])
                if not 0 <= column < len(wanted) or not 0 <= 8 * samples <= limits.bytes:
                    raise EOFError
                piece = np.empty(samples)
                if samples and self.answers.readinto(piece.data) < piece.nbytes:  # type: ignore[union-attr]
                    raise EOFError
                yield column, piece
        self.idle = True

    def close(self) -> None:
        """A worker that forks for each log is kept for the next one, unless its log is open still."""
        self.used_s = time.monotonic()
        with _lock:
            if kept := self.idle and _CAN_FORK and len(_idle) < MOST_IDLE:
                _idle.append(self)
        if not kept:
            self.end()

    def end(self) -> None:
        """Kill it, and what it has started."""
        self._kill()
        for stream in (self.requests, self.answers):
            with contextlib.suppress(OSError):
                stream.close()  # type: ignore[union-attr]
        self.process.wait()
        self.idle = False

    def _kill(self) -> None:
        with contextlib.suppress(OSError):
            os.killpg(self.process.pid, signal.SIGKILL) if _CAN_FORK else self.process.kill()

    @contextmanager
    def _watched(self, limits: Limits) -> Iterator[None]:
        """Ends the worker when it takes too long; an InputError when it dies."""

        def end_late() -> None:
            self.late = True
            self._kill()

        watch = threading.Timer(WALL * limits.seconds, end_late)
        watch.daemon = True
        watch.start()
        try:
            yield
        except (EOFError, ValueError, KeyError, TypeError) as error:  # nothing more comes, or nothing that makes sense
            raise InputError(self._cause_of_death(limits)) from error
        finally:
            watch.cancel()

    def _cause_of_death(self, limits: Limits) -> str:
        """The cause of the worker's end, as a sentence."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(timeout=2.0)
        status = self.process.poll()
        self.end()
        number = -status if status is not None and status < 0 else (status or 0) - 128
        if self.late or (_CAN_FORK and number == signal.SIGXCPU):
            return f"takes more than {limits.seconds:g} s to read; is it damaged?"
        if _CAN_FORK and number == signal.SIGKILL:
            return "takes more memory than there is: its reader was killed"
        name = signal.Signals(number).name if number in {int(known) for known in signal.Signals} else f"status {status}"
        return f"is damaged: it crashes the reader of its format ({name})"


@atexit.register
def end_all() -> None:
    """Ends the workers that wait for the next log."""
    with _lock:
        while _idle:
            _idle.pop().end()


if hasattr(os, "register_at_fork"):  # a child has its parent's pipes, and must not talk through them
    os.register_at_fork(after_in_child=_idle.clear)
