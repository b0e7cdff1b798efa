"""What a worker does: one chunk of a study, on the same program as the one that asks."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from functools import cache, lru_cache

from workbench.study.batch import run_chunk
from workbench.study.load import Study
from workbench.study.manifest import library_versions
from workbench.study.store import Chunk


@dataclass(frozen=True)
class OtherProgram:
    """A worker that would give other numbers: what is different there."""

    where: str
    what: str


@cache
def versions() -> dict[str, str]:
    """What has to be the same on every worker, besides workbench itself."""
    return {"python": platform.python_version()} | library_versions()


def run_remote_chunk(study: bytes, number: int, fingerprint: str, wanted: dict[str, str]) -> Chunk | OtherProgram:
    """A chunk of a pickled study; one thread, since a worker has one.

    fingerprint: the study's where it was asked for. A worker with another program computes another one.
    """
    here = versions()
    if different := [f"{name} {here.get(name)}, here {version}" for name, version in wanted.items()
                     if here.get(name) != version]:  # fmt: skip
        return OtherProgram(platform.node(), "; ".join(different))
    loaded = _loaded(study)
    if loaded.fingerprint != fingerprint:
        return OtherProgram(platform.node(), "another version of workbench")
    return run_chunk(loaded, number, threads=1)


@lru_cache(maxsize=2)
def _loaded(study: bytes) -> Study:
    import pickle

    loaded = pickle.loads(study)
    assert isinstance(loaded, Study)
    # What was computed where it was asked for says nothing about this worker.
    loaded.__dict__.pop("fingerprint", None)
    return loaded
