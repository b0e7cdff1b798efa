"""Work for the tests of jobs: what a worker process can do, right and wrong."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from workbench.core.errors import InputError
from workbench.dashboard.jobs import Teller


def counted(result: Path, tell: Teller, to: int, each_s: float = 0.0) -> None:
    """Counts, and keeps what it has counted: started again it goes on from there."""
    kept = result.parent / "kept.txt"
    first = int(kept.read_text()) if kept.exists() else 0
    for number in range(first, to):
        tell("counting", number, to, failed=1)
        time.sleep(each_s)
        part = kept.with_suffix(".part")
        part.write_text(str(number + 1))
        part.replace(kept)  # whole, whenever it is stopped
    tell("counting", to, to)
    result.mkdir()
    (result / "said.txt").write_text(f"{first} to {to}")


def what_it_sees(result: Path, tell: Teller, file: str) -> None:
    result.mkdir()
    (result / "said.txt").write_text(f"{Path(file).read_text()}|{Path.cwd().name}|{os.nice(0)}")


def refused(result: Path, tell: Teller, file: str, folder: str = "") -> None:
    raise InputError("unknown key 'mas'", file=file, line=3)


def defective(result: Path, tell: Teller) -> None:
    raise ZeroDivisionError("a defect")


def shot(result: Path, tell: Teller) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def stubborn(result: Path, tell: Teller) -> None:
    """Does not hear Ctrl-C, and has a child that does not either."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    tell(f"child {child.pid}", 0, 0)
    time.sleep(60.0)
