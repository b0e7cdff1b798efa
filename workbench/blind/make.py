"""Campaigns made and sealed: each as a rig would have recorded it, its label where only the key reads it.

Recorded machines are bent here; the simulators that play machines belong to a checkout, in benchmarks/validation.
"""

from __future__ import annotations

import importlib
import importlib.util
import multiprocessing
import os
import secrets
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.blind import recorded
from workbench.blind.recording import recording
from workbench.blind.seal import CAMPAIGNS, Label, Order, Truth, fernet, hashes, key_of, read_manifest, seal, write_key
from workbench.core.errors import InputError, check_known
from workbench.core.names import listed
from workbench.core.whole_folder import check_free, whole_folder

Tell = Callable[[str], None]
MOST_SEED = 2**63
PLAYED = ("simulator", "multibody", "plant")
SOURCES = (recorded.SOURCE, *PLAYED)


@dataclass(frozen=True)
class Asked:
    """machine, runs: a machine.yaml and a plan or campaign, of the user's. seed: None for one of the system's own.
    sources, families: names, all of a source's families where none is named. effects: names, separated by commas.
    case: all cases of that sort. identified: which machine.yaml was identified first: no, half or yes."""

    machine: Path | None = None
    runs: Path | None = None
    cases: int = 60
    seed: int | None = None
    sources: Sequence[str] = ("simulator",)
    kind: str | None = None
    families: Sequence[str] = ()
    effects: str | None = None
    case: str | None = None
    identified: str = "no"

    def said(self) -> dict[str, Any]:
        """For the manifest: all but the seed; of files their names."""
        words = {key: value for key, value in vars(self).items() if key != "seed"}
        return {key: value.name if isinstance(value, Path) else value for key, value in words.items()}


@dataclass(frozen=True)
class Maker:
    """The campaigns to make, what makes one in a folder with its label, and what is sealed of the user's own rig."""

    wanted: Sequence[Order]
    one: Callable[[Path, Order], tuple[Order, Label]]
    rig: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Made:
    """What `make` wrote. seal_sha256: worth a note elsewhere: a folder made anew has another one."""

    folder: Path
    key: Path
    seal_sha256: str
    cases: int


def make(
    asked: Asked,
    folder: Path,
    *,
    key: Path | None = None,
    processes: int = 2,
    tell: Tell = lambda line: None,
    maker: Maker | None = None,
) -> Made:
    """Make the campaigns in `folder`, which is free, and seal their labels; all or nothing. The key stays outside.

    maker: in place of that of the sources. InputError for what does not fit together.
    """
    if asked.cases < 1:
        raise InputError(f"{asked.cases}, expected at least 1", place="cases")
    fernet()
    check_free(folder)
    key = key or key_of(folder)
    if key.exists():
        raise InputError("is there; nothing is overwritten, choose another file for the key", file=key)
    seed = secrets.randbelow(MOST_SEED) if asked.seed is None else asked.seed
    maker = maker or maker_of(asked, seed, tell)
    with whole_folder(folder) as hidden:
        (hidden / CAMPAIGNS).mkdir()
        labels: dict[str, Label] = {}
        with mapped(processes) as over:
            for order, label in over(partial(maker.one, hidden / CAMPAIGNS), maker.wanted):
                labels[order.name] = label
                tell(f"{len(labels)}/{len(maker.wanted)} campaigns made")
        names = sorted(labels)
        truth = Truth(
            seed,
            {order.name: asdict(order) for order in maker.wanted},
            {name: asdict(labels[name]) for name in names},
            {name: hashes(hidden / CAMPAIGNS / name) for name in names},
            maker.rig,
        )
        now = datetime.now(UTC).isoformat(timespec="seconds")
        write_key(key, seal(hidden, truth, now, __version__, asked.said()))
    return Made(folder, key, read_manifest(folder).seal_sha256, len(names))


def maker_of(asked: Asked, seed: int, tell: Tell) -> Maker:
    """What makes the campaigns that are asked for, of the sources that are asked for."""
    for name in asked.sources:
        check_known("unknown source", name, SOURCES, place="source")
    if recorded.SOURCE not in asked.sources:
        played: Maker = validation().maker(asked, seed)
        return played
    if tuple(asked.sources) != (recorded.SOURCE,):
        raise InputError("recorded does not go with other sources; make a folder of each", place="source")
    if asked.runs is None:
        raise InputError("recorded needs a campaign of measured runs", place="runs")
    given = {"machine": asked.machine, "family": asked.families, "effects": asked.effects}
    bent = {"case": asked.case == "pairs", "identified": asked.identified != "no"}
    for place in (name for name, said in {**given, **bent}.items() if said):
        why = (
            "the machine is that of the runs" if place in given else "one piece is bent of a machine that is identified"
        )
        raise InputError(f"does not go with recorded: {why}", place=place)
    known = recording(asked.runs)
    if asked.kind not in (None, known.machine.kind):
        raise InputError(f"{asked.kind}, but the machine is of kind {known.machine.kind}", place="kind")
    share = 100.0 * known.remainder_rms / known.input_rms
    own = f", which has {listed(list(known.machine.effects))} of its own," if known.machine.effects else ""
    tell(f"{known.name}{own} identified on {len(known.runs)} runs; it leaves {share:.1f} % of its input")
    return Maker(recorded.ordered(seed, known, asked.cases, asked.case), partial(recorded.made, known))


def validation(part: str = "entry") -> Any:
    """A module of benchmarks/validation. InputError where only the package is installed."""
    checkout = Path(__file__).resolve().parents[2]
    if importlib.util.find_spec("benchmarks") is None and (checkout / "benchmarks" / "validation").is_dir():
        sys.path.append(str(checkout))
    try:
        return importlib.import_module(f"benchmarks.validation.{part}")
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("benchmarks"):
            raise
        problem = f"{', '.join(PLAYED)} are in benchmarks/validation of a checkout, not in the installed package"
        raise InputError(f"{problem}; recorded machines need none of them", place="source") from error


@contextmanager
def mapped(processes: int, stand_in: str | None = None) -> Iterator[Callable[..., Any]]:
    """A `map` over processes, in any order; in this one where it is one. stand_in: the folder that they work in.
    InputError where a process dies."""
    if processes <= 1:
        yield map
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by the processes as they start
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _settle, (stand_in,))

    def over(work: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        waiting, running = iter(items), set[Future[Any]]()
        while running := running | {pool.submit(work, x) for x in islice(waiting, 2 * processes - len(running))}:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)

    try:
        yield over
    except BrokenProcessPool as error:
        raise InputError(
            "a process ended in the middle of its work, perhaps for want of memory; what was answered is kept, the "
            "same command goes on, with one process in less memory"
        ) from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _settle(stand_in: str | None) -> None:
    """Of a process of the pool; Ctrl-C is the parent's to hear."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if stand_in is not None:
        os.chdir(stand_in)
