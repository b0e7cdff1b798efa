"""One writer at a time: a lock file that the operating system releases when its holder dies."""

from __future__ import annotations

import contextlib
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.errors import InputError

if TYPE_CHECKING:
    from filelock import BaseFileLock

LOCK = "lock"
PATIENCE_S = 0.2  # a holder that has just finished removes the file: then the lock is tried again


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder` if need be and hold it for this process; the lock file is removed when the block ends.

    The file names its holder. A process that was killed leaves the file but not the lock, and the next
    holder overwrites the name. InputError while another process holds the folder.
    """
    path = folder / LOCK
    lock = _acquired(path)
    try:
        path.write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
        yield
    finally:
        # Removed while it is held, so that nobody waits for a file that is no longer there. The
        # folder may have got its final name meanwhile; then the file went with it and is gone already.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def _acquired(path: Path) -> BaseFileLock:
    from filelock import FileLock, Timeout

    lock = FileLock(path, timeout=PATIENCE_S)
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire()
            return lock
        except FileNotFoundError:
            continue  # the holder of the folder has just given it its final name
        except Timeout as error:
            holder = "another process"
            with contextlib.suppress(OSError):
                holder = path.read_text(encoding="utf-8", errors="replace") or holder
            raise InputError(
                f"is being written by {holder}; let it finish, or stop it and call again", file=path.parent
            ) from error
