"""The process that reads mangled inputs: `python -m benchmarks.attack.victim`. It may die of one.

A line on standard input names an input, `csv 17`; a line of JSON tells how it ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.attack import watch_states
from benchmarks.attack.edits import EDITS, edited, sound_runs
from benchmarks.attack.mangle import (
    AXIS_RUNS,
    CUT,
    LOGS,
    OF_A_RESULT,
    ROOT,
    RUNS,
    SPECIAL,
    escape,
    finished_result,
    good,
    make_special,
    mangled,
    signals_of,
)
from workbench.core.errors import InputError
from workbench.logs import Campaign, read_campaign
from workbench.logs.doubts import doubts_of
from workbench.logs.formats.opening import open_log
from workbench.machines import default_hoist
from workbench.study.rows import read_rows

LONGEST = 3000  # characters of an error
SECRET = b"root:x:0:0:what no log may show:" * 100
_ENDINGS = ("csv", "parquet", "mat", "mf4", "tdms")
_PLACES = ("machine.yaml", "runs.yaml", "index.parquet", "manifest.json")


def _of_an_axis(log: bytes) -> bytes:
    """The columns of a CSV log that an axis has."""
    lines = [line.split(",") for line in log.decode().splitlines()]
    kept = [lines[0].index(name) for name in ("time_s", "torque_motor1_nm", "speed_motor_rad_s")]
    return "".join(",".join(cells[k] for k in kept) + "\n" for cells in lines).encode()


@dataclass(frozen=True)
class Ended:
    """How one input ended: read, noted (read, and something said of it), refused, traceback, unsound or unclear.

    seconds: of processor time, its workers' with it. unsound: a campaign that breaks what readers promise; unclear: an
    error that is not one printable line; silent: what had to be refused or noted was not.
    """

    how: str
    said: str
    seconds: float = 0.0
    memory_mb: float = 0.0


def read(kind: str, content: bytes, folder: Path) -> Ended:
    """Reads one input as its kind is read."""
    try:
        if kind == "scenario":
            return _scenario(content, folder)
        if kind == "controller":
            return _controller(content, folder)
        if kind in watch_states.KINDS:
            return Ended(*watch_states.read(kind, content, folder))
        if kind == "special":
            return _special(int(content), folder)
        if kind == "edit":
            return _edit(int(content))
        if kind == "escape":
            secret = folder / "secret"
            secret.write_bytes(SECRET)
            return _kept(_campaign("mat73", escape(random.Random(f"escape {content!r}"), secret), folder))
        if kind in OF_A_RESULT:
            return _result(kind, content, folder)
        return _judged(
            _upload(kind, content, folder) if kind in ("zip", "upload") else _campaign(kind, content, folder)
        )
    except InputError as error:
        said = str(error)
        plain = said.replace("\u00a0", " ").isprintable() and len(said) <= LONGEST
        return Ended("refused" if plain else "unclear", said)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return Ended(
            "traceback", f"{type(error).__name__}: {str(error)[:200]} ({Path(last.filename).name}:{last.lineno})"
        )


def _campaign(kind: str, content: bytes, folder: Path) -> Campaign:
    (folder / "runs").mkdir()
    suffix = {"mat73": "mat"}.get(kind, kind) if kind in LOGS else "csv"
    (folder / "machine.yaml").write_bytes(good("machine", 0))
    (folder / "runs.yaml").write_text(AXIS_RUNS if kind == "axis" else RUNS.replace("lift.csv", f"lift.{suffix}"))
    log = good("csv", 0)
    (folder / "runs" / "lift.csv").write_bytes(_of_an_axis(log) if kind == "axis" else log)
    name = {"machine": "machine.yaml", "axis": "machine.yaml", "runs": "runs.yaml"}.get(kind, f"runs/lift.{suffix}")
    (folder / name).write_bytes(content)
    return read_campaign(folder, uploaded=len(content) % 2 == 0)  # half as one's own, half as a stranger's


def _kept(campaign: Campaign) -> Ended:
    """A campaign that holds bytes of another file is a leak."""
    held = b"".join(column.tobytes() for run in campaign.runs for column in run.signals.values())
    return Ended("silent", "read from another file") if SECRET[:16] in held else Ended("silent", "read")


def _special(seed: int, folder: Path) -> Ended:
    """Something that is no regular file in the place of one that a command reads."""
    chance = random.Random(f"special {seed}")
    what, place = chance.choice(SPECIAL), chance.choice([*(f"lift.{end}" for end in _ENDINGS), *_PLACES])
    try:
        if place.startswith("lift."):
            make_special(what, folder / place)
            with open_log(folder / place, uploaded=chance.random() < 0.5) as log:
                log.read(log.names)
        elif place in OF_A_RESULT.values():
            shutil.copytree(finished_result(), folder / "small")
            (folder / "small" / place).unlink()
            make_special(what, folder / "small" / place)
            read_rows(folder / "small")
        else:
            (folder / "runs").mkdir()
            for name, content in (("machine.yaml", good("machine", 0)), ("runs.yaml", RUNS.encode())):
                (folder / name).write_bytes(content) if name != place else make_special(what, folder / name)
            read_campaign(folder)
    except InputError as error:
        return Ended("refused", str(error))
    if place == "manifest.json":  # a result without one is read, as earlier versions wrote none
        return Ended("read", f"{what} as {place}")
    return Ended("silent", f"{what} as {place} was read")


def _edit(seed: int) -> Ended:
    """Six sound runs, one of them edited but for every tenth time: that one has to be named, and no other."""
    chance = np.random.default_rng(seed)
    machine = default_hoist()
    runs = sound_runs(machine, chance)
    if seed % 10 == 0:
        notes = doubts_of(machine, runs)
        return Ended("silent", f"sound runs: {notes[0]}") if notes else Ended("read", "")
    edit = [*EDITS][seed % len(EDITS)]
    k = int(chance.integers(len(runs)))
    run = edited(machine, runs[k], edit, seed)
    if run is None or edit == "start position 3 m off":  # no height is logged
        return Ended("read", "")
    notes = doubts_of(machine, [*runs[:k], run, *runs[k + 1 :]])
    if notes and all(note.startswith(f"{run.name}: ") for note in notes):
        return Ended("noted", notes[0])
    return Ended("silent", f"{edit} in {run.name}: {notes}")


def _upload(kind: str, content: bytes, folder: Path) -> Campaign:
    from workbench.dashboard.uploads import Uploaded, read_uploaded

    if kind == "zip":
        return read_uploaded([Uploaded("lifts.zip", content)], folder)
    names, contents = (content.split(CUT)[start::2] for start in (0, 1))
    files = [Uploaded(n.decode(errors="replace"), c) for n, c in zip(names, contents, strict=False)]
    return read_uploaded(files, folder)


def _controller(content: bytes, folder: Path) -> Ended:
    """A controller's file, and the loop that it makes."""
    from workbench.analysis.margins import family, operating_points
    from workbench.control.settings import read_controller
    from workbench.machines import default_hoist

    (folder / "gains.yaml").write_bytes(content)
    settings = read_controller(folder / "gains.yaml")
    family(default_hoist(), settings, operating_points(default_hoist(), (4500.0,), (9.0,)))
    return Ended("read", "")


def _result(kind: str, content: bytes, folder: Path) -> Ended:
    """Report on a result with one file mangled, and compare it with the whole one. Of half, no hash is known."""
    from workbench.study.compare import compare, judged, parse_limits, regressions
    from workbench.study.rows import read_rows
    from workbench.study.store import read_finished
    from workbench.view.compare import as_json
    from workbench.view.study import write_study_report

    whole, damaged = finished_result(), folder / "small"
    shutil.copytree(whole, damaged)
    if kind != "manifest" and len(content) % 2:
        said = json.loads((damaged / "manifest.json").read_text())
        (damaged / "manifest.json").write_text(json.dumps(said | {"files": {}}))
    (damaged / OF_A_RESULT[kind] if OF_A_RESULT[kind] else signals_of(damaged)).write_bytes(content)
    write_study_report(read_finished(damaged), folder / "report.html")
    comparison = compare(read_rows(whole), read_rows(damaged))
    limits = parse_limits(["peak_torque=5%"], judged())
    json.dumps(as_json(comparison, limits, regressions(comparison, limits)))
    return Ended("read", "")


def _scenario(content: bytes, folder: Path) -> Ended:
    from workbench.study.load import load_study

    for whole in (ROOT / "scenarios").glob("*.yaml"):  # what it may extend
        shutil.copy(whole, folder)
    (folder / "scenario.yaml").write_bytes(content)
    load_study(folder / "scenario.yaml")
    return Ended("read", "")


def _judged(campaign: Campaign) -> Ended:
    for run in campaign.runs:
        columns = [run.time_s, *run.signals.values()]
        sound = len(run.time_s) >= 10 and all(np.isfinite(c).all() and c.shape == run.time_s.shape for c in columns)
        if not sound or not (np.diff(run.time_s) > 0.0).all():
            return Ended("unsound", run.name)
    return Ended("noted" if campaign.all_notes else "read", "; ".join(campaign.all_notes)[:300])


@contextmanager
def _peak() -> Iterator[list[float]]:
    """The most memory, MB, that this process and its workers held together meanwhile. Linux only; else 0."""
    peak, over = [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.02):
            peak[0] = max(peak[0], sum(map(_resident_mb, _family(os.getpid()))))

    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # the high-water mark starts anew
    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield peak
    finally:
        over.set()
        thread.join()
        with contextlib.suppress(OSError, IndexError, ValueError):
            status = Path("/proc/self/status").read_text()
            peak[0] = max(peak[0], float(status.split("VmHWM:")[1].split()[0]) / 1000.0)


def _family(pid: int) -> list[int]:
    try:
        children = [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return [pid]
    return [pid, *(descendant for child in children for descendant in _family(child))]


def _processor_s() -> float:
    """Of this process and of all that it has started, as far as they are waited for or still there. Linux only."""
    ticks = 0
    for pid in _family(os.getpid()):
        with contextlib.suppress(OSError, IndexError, ValueError):
            ticks += sum(int(word) for word in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15])
    return ticks / os.sysconf("SC_CLK_TCK") if ticks else time.process_time()


def _resident_mb(pid: int) -> float:
    """Resident memory that is no file's."""
    try:
        resident, shared = Path(f"/proc/{pid}/statm").read_text().split()[1:3]
    except (OSError, ValueError):
        return 0.0
    return (int(resident) - int(shared)) * os.sysconf("SC_PAGESIZE") / 1e6


def main() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for line in sys.stdin:
        kind, seed = line.split()
        content = mangled(kind, int(seed))
        folder = Path(tempfile.mkdtemp(prefix="attack-"))
        try:
            begun = _processor_s()
            with _peak() as peak:
                ended = read(kind, content, folder)
            seconds = _processor_s() - begun
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        print(json.dumps(asdict(ended) | {"seconds": seconds, "memory_mb": peak[0]}), flush=True)


if __name__ == "__main__":
    main()
