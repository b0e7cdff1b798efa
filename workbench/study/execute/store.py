"""An unfinished result on disk: chunks of runs kept one by one, then made whole under the final name.

.<name>.<fingerprint>.part/     beside the folder that it becomes
  lock                          held by the process that writes
  chunks/000012.parquet         the rows of a finished chunk; that it is there says that its runs are done
  runs/<run_id>/signals.parquet
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.study.execute.lock import LOCK, locked
from workbench.study.results.arrow import parquet_bytes
from workbench.study.results.folder import SIGNALS
from workbench.study.results.index import INDEX, joined, read_table
from workbench.study.results.manifest import MANIFEST
from workbench.whole_folder import write_json


@dataclass(frozen=True)
class Chunk:
    """What a chunk of runs came to, as the bytes of its files: the same wherever it was computed."""

    rows: int
    failed: int
    index: bytes
    signals: Mapping[str, bytes] = field(default_factory=dict)


class Part:
    """The unfinished result in `folder`, of a batch of `sizes[i]` runs in chunk i. Use `open_part`."""

    def __init__(self, folder: Path, sizes: list[int]) -> None:
        self.folder = folder
        self.sizes = sizes

    @property
    def whole(self) -> bool:
        """Whether all is written and only the final name is missing."""
        return (self.folder / MANIFEST).is_file()

    def done(self) -> dict[int, int]:
        """The chunks that are kept, and how many runs of each have failed; what cannot be read is removed."""
        kept = {}
        for number, size in enumerate(self.sizes):
            file = self._file(number)
            if not file.is_file():
                continue
            try:
                table = read_table(file)
            except InputError:
                table = None
            if table is None or table.num_rows != size:
                file.unlink()  # a disk's fault: the chunk is run again
            else:
                kept[number] = table["status"].to_pylist().count("failed")
        return kept

    def commit(self, number: int, chunk: Chunk) -> None:
        """Keep a chunk: signals first, then, at one stroke, the rows that say that they are there."""
        places = []
        for run_id, data in chunk.signals.items():
            place = self.folder / "runs" / run_id
            place.mkdir(parents=True, exist_ok=True)
            (place / SIGNALS).write_bytes(data)
            places += [place / SIGNALS, place]
        if places:
            # Side by side: the disk takes many files at a time nearly as fast as one.
            with ThreadPoolExecutor(16) as pool:
                list(pool.map(_settle, [*places, self.folder / "runs"]))
        file = self._file(number)
        file.parent.mkdir(exist_ok=True)
        temporary = file.with_suffix(".tmp")
        _write(temporary, chunk.index)
        temporary.rename(file)
        _settle(file.parent)

    def assemble(self) -> Any:
        """Write the index from all chunks; returns it."""
        table = joined([read_table(self._file(number)) for number in range(len(self.sizes))])
        _write(self.folder / INDEX, parquet_bytes(table))
        return table

    def add(self, name: str, text: str | bytes) -> None:
        """One more file of the result."""
        _write(self.folder / name, text.encode() if isinstance(text, str) else text)

    def mark(self, manifest: Mapping[str, Any]) -> None:
        """Say that the result is whole."""
        temporary = self.folder / f"{MANIFEST}.tmp"
        write_json(temporary, manifest)
        _settle(self.folder)
        temporary.rename(self.folder / MANIFEST)

    def finish(self, target: Path) -> None:
        """Give a whole result its name. `target` is free."""
        shutil.rmtree(self.folder / "chunks", ignore_errors=True)
        (self.folder / LOCK).unlink(missing_ok=True)
        try:
            self.folder.rename(target)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
            said = f"is taken by now; this result is whole in {self.folder}: ask for another folder, or move it"
            raise InputError(said, file=target) from error
        _settle(target.parent)

    def _file(self, number: int) -> Path:
        return self.folder / "chunks" / f"{number:06d}.parquet"


@contextmanager
def open_part(folder: Path, sizes: list[int], target: Path) -> Iterator[Part]:
    """The unfinished result in `folder`, new or of an earlier call, held for this process; `target` to be.

    InputError where it cannot be written, and while another process writes it.
    """
    try:
        with locked(folder):
            yield Part(folder, sizes)
    except (FileExistsError, NotADirectoryError) as error:
        said = "no results can be written there: a file stands where a folder must be"
        raise InputError(said, file=target) from error
    except OSError as error:
        raise InputError(f"no results written: {error.strerror or error}", file=target) from error
    finally:
        # Nothing done, nothing left behind.
        with contextlib.suppress(OSError):
            folder.rmdir()


def _write(path: Path, data: bytes) -> None:
    """The file is on the disk when this returns."""
    with path.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _settle(path: Path) -> None:
    """What a file, or the names in a folder, say is on the disk when this returns, where the system can do that."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # a folder, on systems that open files only
        return
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
