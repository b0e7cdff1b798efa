"""What a worker does: one chunk of a study, on the same program as the one that asks."""

from __future__ import annotations

import platform
import threading
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache, lru_cache

from workbench.effects.loading import know
from workbench.effects.registry import UserFile
from workbench.errors import InputError
from workbench.study.execute.batch import run_chunk
from workbench.study.execute.store import Chunk
from workbench.study.results.manifest import library_versions
from workbench.study.scenario.load import Study

_knowing = threading.Lock()


@dataclass(frozen=True)
class OtherProgram:
    """A worker that would give other numbers: what is different there."""

    where: str
    what: str


@cache
def versions() -> dict[str, str]:
    """What has to be the same on every worker, besides workbench itself."""
    return {"python": platform.python_version()} | library_versions()


def run_remote_chunk(
    study: bytes, number: int, fingerprint: str, wanted: dict[str, str], effects: tuple[UserFile, ...] = ()
) -> Chunk | OtherProgram:
    """A chunk of a pickled study; one thread, since a worker has one.

    fingerprint: the study's where it was asked for. A worker with another program computes another one.
    effects: the users' files that it needs, as they were read there.
    """
    here = versions()
    if different := [f"{name} {here.get(name)}, here {version}" for name, version in wanted.items()
                     if here.get(name) != version]:  # fmt: skip
        return OtherProgram(platform.node(), "; ".join(different))
    # Effects are known by name in a whole process: studies with other files of one name take turns.
    with _knowing if effects else nullcontext():
        for file in effects:
            know(file)
        try:
            loaded = _loaded(study, tuple(file.digest for file in effects))
            same = loaded.fingerprint == fingerprint
        except InputError as error:  # an effect of an entry point that is not installed there
            return OtherProgram(platform.node(), f"not the same effects ({error})")
        if not same:
            return OtherProgram(platform.node(), "another version of workbench")
        return run_chunk(loaded, number, threads=1)


@lru_cache(maxsize=2)
def _loaded(study: bytes, effects: tuple[str, ...]) -> Study:
    import pickle

    loaded = pickle.loads(study)
    assert isinstance(loaded, Study)
    # What was computed where it was asked for says nothing about this worker.
    loaded.__dict__.pop("fingerprint", None)
    return loaded
