"""The state of a watch on disk: an SQLite file that holds each cycle once, whole or not at all, and Parquet copies.

A cycle is known by the digest of its log, so that neither another name nor a restart counts it twice. A cycle and what
it brought (events, an alarm) are one transaction: after kill -9 it is there with all of it, or its log is read again.
One process at a time writes; the lock is the system's and ends with the process, however it ends. What follows from
the cycles, a judge makes anew from them; `cycles.parquet` and `alarms.parquet` are replaced as wholes and hold all that
a new watch.sqlite is made of, see `rebuild`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
from filelock import FileLock, Timeout
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from workbench.core.errors import InputError, UnwritableError
from workbench.core.input_file import open_input, readable_file
from workbench.core.whole_folder import whole_file, writable
from workbench.machines import Machine
from workbench.watch.estimate import LARGEST, watched_keys
from workbench.watch.judge import Cycle, Judge, Judged, Rules

FILE, LOCK, DAMAGED = "watch.sqlite", "watch.lock", "watch.sqlite.damaged"
FORMAT = 2
_TABLES = """
CREATE TABLE settings (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE cycles (
    number INTEGER PRIMARY KEY, digest TEXT NOT NULL UNIQUE, name TEXT NOT NULL, file TEXT NOT NULL, payload_kg REAL,
    start_position_m REAL, start_s REAL, duration_s REAL, counted INTEGER, statistic REAL, estimate TEXT NOT NULL,
    notes TEXT NOT NULL);
CREATE TABLE refused (digest TEXT PRIMARY KEY, name TEXT NOT NULL, reason TEXT NOT NULL);
CREATE TABLE events (cycle INTEGER NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL);
CREATE TABLE alarms (
    cycle INTEGER PRIMARY KEY, onset INTEGER NOT NULL, statistic REAL NOT NULL, causes TEXT NOT NULL,
    again INTEGER NOT NULL, diagnosis TEXT, told INTEGER NOT NULL DEFAULT 0, reported INTEGER NOT NULL DEFAULT 0);
"""
_ALARMS = [
    ("cycle", "int64"), ("onset", "int64"), ("statistic", "float64"), ("likeliest", "string"), ("share", "float64"),
    ("again", "bool"), ("diagnosis", "string"), ("diagnosis_json", "string"), ("told", "bool"), ("reported", "bool"),
]  # fmt: skip
# What SQLite's result codes mean for a user; every other one is a damaged file.
_NOT_WRITTEN = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN}
_IN_USE = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
_CYCLES = TypeAdapter(Cycle)


class DamagedError(InputError):
    """watch.sqlite holds what no watch has written."""


class Said(BaseModel):
    """What is known of an alarm beside what its cycles tell. diagnosis: the answer of `diagnose`, None where it has not
    been asked yet; told: the webhook has it; reported: an exit status has told of it."""

    diagnosis: Annotated[dict[str, Any], Field(strict=True)] | None = None
    told: bool = False
    reported: bool = False


def _said_of(diagnosis: Any, told: Any, reported: Any) -> Said:
    """ValueError, TypeError or KeyError where no watch has written it."""
    said = Said(diagnosis=None if diagnosis is None else json.loads(diagnosis), told=told, reported=reported)
    if said.diagnosis is not None and not isinstance(said.diagnosis["sentence"], str):
        raise TypeError("a diagnosis without a sentence")
    return said


def _row_of(number: int, cycle: Cycle, judged: Judged) -> dict[str, Any]:
    row = _CYCLES.dump_python(cycle) | {"number": number, "counted": judged.counted, "statistic": judged.statistic}
    return {**row, "estimate": json.dumps(row["estimate"]), "notes": json.dumps(row["notes"])}


def _cycle_of(row: Mapping[str, Any], k: int, keys: tuple[str, ...]) -> Cycle:
    """Of a row of the table of cycles, or of cycles.parquet. ValueError where no watch of these keys has written it as
    its cycle k."""
    if row["number"] != k:
        raise ValueError(f"cycle {k} is missing")
    if not abs(row["statistic"]) < LARGEST or row["counted"] not in (0, 1):
        raise ValueError(f"cycle {k} has no result")
    parsed = {"estimate": json.loads(row["estimate"]), "notes": json.loads(row["notes"])}
    cycle = _CYCLES.validate_python({one.name: row[one.name] for one in fields(Cycle)} | parsed)
    made, m = cycle.estimate, len(keys)
    shapes = np.shape(made.values), np.shape(made.errors), np.shape(made.resolution)
    if made.keys != keys or shapes != ((m,), (m,), (m, m)):
        raise ValueError("estimates of other parameters")
    return cycle


class Store:
    """One machine's watch in a folder. InputError where the folder belongs to another machine or other rules, another
    watch has it, or what it holds is damaged."""

    def __init__(
        self, folder: Path, machine: Machine, rules: Rules, *, wait_s: float = 0.0,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:  # fmt: skip
        """wait_s: how long another watch of this folder is waited for; say: told of that."""
        self.folder, self._settings, self._keys = folder, _settings(machine, rules), watched_keys(machine)
        self._lock = locked(folder, wait_s, say)
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        file = self.folder / FILE
        if file.exists():
            readable_file(file, "table")
        with self._sound():
            self._db = sqlite3.connect(file, isolation_level=None, timeout=5.0, check_same_thread=False)
            self._db.row_factory = sqlite3.Row
            self._db.execute("PRAGMA journal_mode=WAL")
            # What a power cut takes away is read again from the logs.
            self._db.execute("PRAGMA synchronous=NORMAL")
            with self._whole():
                if not self._db.execute("SELECT 1 FROM sqlite_master").fetchone():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self._db.execute(statement)
                    self._db.executemany("INSERT INTO settings VALUES (?, ?)", self._settings.items())
            kept = dict(self._db.execute("SELECT name, value FROM settings").fetchall())
            found = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            self.damaged(found)
        _check_settings(kept, self._settings, self.folder)

    def close(self) -> None:
        with contextlib.suppress(sqlite3.Error, AttributeError):
            self._db.close()
        self._lock.release()

    @contextmanager
    def _sound(self) -> Iterator[None]:
        """SQLite's errors, and rows that no watch has written, as one line each."""
        file = self.folder / FILE
        try:
            yield
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
            if code in _NOT_WRITTEN:
                raise UnwritableError(f"cannot be written: {error}", file=file) from error
            if code in _IN_USE:
                raise InputError("is in use by another program; try again when it has ended", file=file) from error
            self.damaged(str(error), error)
        except (ValueError, TypeError, LookupError, RecursionError, OverflowError) as error:
            self.damaged(f"a row is none that a watch writes: {_reason(error)}", error)

    def damaged(self, what: str, error: Exception | None = None) -> NoReturn:
        remedy = "'rebuild' makes it anew from cycles.parquet and the logs"
        if not (self.folder / "cycles.parquet").is_file():
            remedy = "there is no cycles.parquet to rebuild it from: move it away, and the logs are read again"
        raise DamagedError(f"is damaged ({what}); {remedy}", file=self.folder / FILE) from error

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """All or nothing. On a full disk SQLite has rolled back by itself; then the cause is not to be hidden."""
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                with contextlib.suppress(sqlite3.Error):
                    self._db.execute("ROLLBACK")
            raise

    def _do(self, statement: str, *values: object) -> list[Any]:
        with self._sound():
            return self._db.execute(statement, values).fetchall()

    # What is written.

    def add(self, number: int, cycle: Cycle, judged: Judged) -> None:
        """A cycle and all that it brought, at once."""
        with self._sound(), self._whole():
            row = _row_of(number, cycle, judged)
            names = ", ".join(row), ", ".join(f":{name}" for name in row)
            self._db.execute("INSERT INTO cycles ({}) VALUES ({})".format(*names), row)
            events = [(number, event.kind, event.text) for event in judged.events]
            self._db.executemany("INSERT INTO events VALUES (?, ?, ?)", events)
            if (alarm := judged.alarm) is not None:
                causes = json.dumps([asdict(cause) for cause in alarm.causes])
                told = (number, alarm.onset, alarm.statistic, causes, int(alarm.again))
                self._db.execute("INSERT INTO alarms VALUES (?, ?, ?, ?, ?, NULL, 0, 0)", told)

    def refuse(self, digest: str, name: str, reason: str) -> None:
        self._do("INSERT OR IGNORE INTO refused VALUES (?, ?, ?)", digest, name, reason)

    def say(self, cycle: int, said: Said) -> None:
        """What is known of the alarm at a cycle, if there is one."""
        diagnosis = None if said.diagnosis is None else json.dumps(said.diagnosis)
        values = diagnosis, int(said.told), int(said.reported), cycle
        self._do("UPDATE alarms SET diagnosis = ?, told = ?, reported = ? WHERE cycle = ?", *values)

    def report(self) -> int:
        """How many alarms no exit status has told of; from now on they are told of."""
        (count,) = self._do("SELECT COUNT(*) FROM alarms WHERE NOT again AND NOT reported")[0]
        if count:
            self._do("UPDATE alarms SET reported = 1")
        return int(count)

    def write_copies(self) -> None:
        """cycles.parquet and alarms.parquet as they are now, each replaced as a whole. UnwritableError: a full disk."""
        cycles, alarms = [], []
        with self._sound():
            for row in map(dict, self._db.execute("SELECT * FROM cycles ORDER BY number")):
                e = json.loads(row["estimate"])
                values = {"residual_rms": e["residual_rms"], "noise_rms": e["noise_rms"]}
                for key, value, error in zip(e["keys"], e["values"], e["errors"], strict=True):
                    values |= {key: value, f"{key}.std_error": error}
                number, counted = row.pop("number"), bool(row["counted"])
                cycles.append({"cycle": number, **row, "counted": counted, **values})
            for row in map(dict, self._db.execute("SELECT * FROM alarms ORDER BY cycle")):
                first, found = json.loads(row["causes"])[0], json.loads(row["diagnosis"] or "{}")
                flags = {name: bool(row[name]) for name in ("again", "told", "reported")}
                more = {"diagnosis": found.get("sentence", ""), "diagnosis_json": row["diagnosis"] or ""}
                alarms.append({**row, **flags, **more, "likeliest": first["name"], "share": first["share"]})
            settings = {"settings": json.dumps(self._settings)}
            replace_table(self.folder / "cycles.parquet", cycles, metadata=settings)
            replace_table(self.folder / "alarms.parquet", alarms, _ALARMS, settings)

    # What is read.

    def known(self, *digests: str) -> bool:
        """Whether a log of such a content was counted or refused."""
        marks = ", ".join("?" * len(digests))
        tables = (f"SELECT 1 FROM {table} WHERE digest IN ({marks})" for table in ("cycles", "refused"))
        return bool(self._do(" UNION ".join(tables), *digests, *digests))

    def cycles(self) -> list[Cycle]:
        """All cycles in the order in which they were counted."""
        rows = self._do("SELECT * FROM cycles ORDER BY number")
        with self._sound():
            return [_cycle_of(row, k, self._keys) for k, row in enumerate(rows)]

    def said(self) -> dict[int, Said]:
        """By the cycle of each alarm."""
        rows = self._do("SELECT cycle, diagnosis, told, reported FROM alarms ORDER BY cycle")
        with self._sound():
            return {int(cycle): _said_of(*values) for cycle, *values in rows}

    def refused(self) -> list[str]:
        """Why logs do not count."""
        return [str(reason) for (reason,) in self._do("SELECT reason FROM refused ORDER BY name")]


def replace_table(
    file: Path, rows: Sequence[Mapping[str, Any]], schema: Any = None, metadata: Mapping[str, str] | None = None
) -> None:
    """A Parquet file, replaced as a whole. UnwritableError: a full disk."""
    import pyarrow as pa
    import pyarrow.parquet

    with whole_file(file) as part:
        table = pa.Table.from_pylist(list(rows), schema=None if schema is None else pa.schema(schema))
        pyarrow.parquet.write_table(table.replace_schema_metadata(metadata), part)


def rebuild(folder: Path, machine: Machine, rules: Rules) -> int:
    """Makes watch.sqlite anew from cycles.parquet; how many cycles it has. All are judged again, in their order; what
    was said and told of an alarm is kept. What was there stays as watch.sqlite.damaged; logs that came later are read
    again. InputError where cycles.parquet is damaged."""
    import pyarrow as pa
    import pyarrow.parquet

    file, keys, new = folder / "cycles.parquet", watched_keys(machine), folder / ".anew"
    remedy = "move watch.sqlite away, and the logs are read again"
    cycles: list[Cycle] = []
    try:
        with pyarrow.parquet.ParquetFile(file, memory_map=False) as table:
            kept = json.loads((table.schema_arrow.metadata or {}).get(b"settings", b"{}"))
            for batch in table.iter_batches(1000):  # a file of many millions of wrong rows ends at the first one
                for row in batch.to_pylist():
                    cycles.append(_cycle_of({**row, "number": row["cycle"]}, len(cycles), keys))
    except FileNotFoundError as error:
        raise InputError(f"is not there; {remedy}", file=file) from error
    except (pa.ArrowException, OSError, ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        raise InputError(f"is damaged too ({_reason(error)}); {remedy}", file=file) from error
    _check_settings(kept, _settings(machine, rules), folder)
    said: dict[int, Said] = {}
    with contextlib.suppress(pa.ArrowException, OSError, ValueError, TypeError, KeyError):  # asked and told again
        for row in pyarrow.parquet.read_table(folder / "alarms.parquet", memory_map=False).to_pylist():
            said[row["cycle"]] = _said_of(row["diagnosis_json"] or None, row["told"], row["reported"])
    with contextlib.ExitStack() as held, writable(folder):
        held.callback(locked(folder, 0.0, lambda line: None).release)
        shutil.rmtree(new, ignore_errors=True)
        held.callback(shutil.rmtree, new, ignore_errors=True)
        with contextlib.closing(Store(new, machine, rules)) as store:
            judge = Judge(rules)
            for k, cycle in enumerate(cycles):
                store.add(k, cycle, judge.add(cycle))
            for at, known in said.items():
                store.say(at, known)
        for end in ("-wal", "-shm"):
            (folder / f"{FILE}{end}").unlink(missing_ok=True)
        if (folder / FILE).exists():
            (folder / FILE).replace(folder / DAMAGED)
        (new / FILE).replace(folder / FILE)
    return len(cycles)


def _reason(error: Exception) -> str:
    """One line of what was wrong with a row."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)


def locked(folder: Path, wait_s: float, say: Callable[[str], None]) -> FileLock:
    """Holds the folder, which it makes, for this process until it is released."""
    busy = "another watch works on this state"
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK, thread_local=False)
        try:
            return lock.acquire(timeout=0).lock
        except Timeout:
            if wait_s:
                say(f"{folder}: {busy}; waiting for it, at most {wait_s:g} s")
        try:
            return lock.acquire(timeout=wait_s).lock
        except Timeout as error:
            waited = f" after {wait_s:g} s" if wait_s else ""
            raise InputError(f"{busy}{waited}; try again when it has ended", file=folder) from error


def _settings(machine: Machine, rules: Rules) -> dict[str, str]:
    """What all cycles of one state share. Limits may change: they only tell how long until."""
    text = json.dumps(machine.model_dump(mode="json"), sort_keys=True)
    chosen = {name: repr(value) for name, value in asdict(rules).items() if name != "limits"}
    return {"format": str(FORMAT), "machine": hashlib.sha256(text.encode()).hexdigest(), **chosen}


def _check_settings(kept: Mapping[str, Any], wanted: Mapping[str, str], folder: Path) -> None:
    for name, value in wanted.items():
        if kept.get(name) != value:
            word = name.replace("_", " ")
            raise InputError(f"was begun with another {word}; choose another folder for the state", file=folder)


def digest_of(file: Path) -> str:
    """Of a file's content. InputError where it cannot be opened, OSError where the disk fails."""
    with open_input(file, "log") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
