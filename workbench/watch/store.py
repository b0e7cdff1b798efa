"""The state of a watch on disk: an SQLite file that holds each cycle once, whole or not at all, and Parquet copies.

A cycle is known by the digest of its log, so that neither another name nor a restart counts it twice. A cycle and what
it brought (events, an alarm) are one transaction: after kill -9 it is there with all of it, or its log is read again.
One process at a time writes; the lock is the system's and ends with the process, however it ends. What follows from
the cycles, a judge makes anew from them; `cycles.parquet` and `alarms.parquet` are replaced as wholes and hold all that
a new watch.sqlite is made of, see `read_copies`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, Json, ValidationError

from workbench.core.errors import InputError
from workbench.core.input_file import open_input, readable_file
from workbench.machines import Axis, Hoist
from workbench.watch.estimate import Estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Judged, Rules

FILE, LOCK, DAMAGED = "watch.sqlite", "watch.lock", "watch.sqlite.damaged"
FORMAT = 2
LOCK_EVERY_S = 0.1
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
# What SQLite's result codes mean for a user; every other one is a damaged file.
_NOT_WRITTEN = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN}
_IN_USE = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}


class UnwritableError(InputError):
    """The state cannot be written now, and can be when there is room again; nothing of it is lost."""


class DamagedError(InputError):
    """watch.sqlite holds what no watch has written."""


Number = Annotated[float, Field(ge=-1e100, le=1e100, strict=True, allow_inf_nan=False)]


class _Estimate(BaseModel):
    keys: list[str]
    values: list[Number]
    errors: list[Number]
    resolution: list[list[Number]]
    residual_rms: Number
    noise_rms: Number


class _Row(BaseModel):
    """A row of the table of cycles, and of cycles.parquet, as a watch writes it."""

    model_config = ConfigDict(strict=True)

    number: int
    digest: str
    name: str
    file: str
    payload_kg: Number
    start_position_m: Number
    start_s: Number
    duration_s: Number
    counted: int
    statistic: Number
    estimate: Json[_Estimate]
    notes: Json[list[str]]

    def cycle(self, k: int, keys: tuple[str, ...]) -> Cycle:
        """ValueError where no watch of these keys has written it as its cycle k."""
        e, m = self.estimate, len(keys)
        values, errors, resolution = (np.asarray(x, dtype=float) for x in (e.values, e.errors, e.resolution))
        if self.number != k:
            raise ValueError(f"cycle {k} is missing")
        if tuple(e.keys) != keys or (values.shape, errors.shape, resolution.shape) != ((m,), (m,), (m, m)):
            raise ValueError("estimates of other parameters")
        made = Estimate(keys, values, errors, resolution, e.residual_rms, e.noise_rms)
        of_log = self.digest, self.file, self.start_position_m, tuple(self.notes)
        return Cycle(self.name, self.payload_kg, self.start_s, self.duration_s, made, *of_log)


def _row_of(number: int, cycle: Cycle, judged: Judged) -> dict[str, Any]:
    e = cycle.estimate
    estimate = {name: np.asarray(value).tolist() for name, value in vars(e).items()}
    return {
        "number": number, "digest": cycle.digest, "name": cycle.name, "file": cycle.file,
        "payload_kg": cycle.payload_kg, "start_position_m": cycle.start_position_m, "start_s": cycle.start_s,
        "duration_s": cycle.duration_s, "counted": int(judged.counted), "statistic": judged.statistic,
        "estimate": json.dumps(estimate), "notes": json.dumps(cycle.notes),
    }  # fmt: skip


class Said(BaseModel):
    """What is known of an alarm beside what its cycles tell. diagnosis: the answer of `diagnose`, None where it has not
    been asked yet; told: the webhook has it; reported: an exit status has told of it."""

    diagnosis: Annotated[dict[str, Any], Field(strict=True)] | None = None
    told: bool = False
    reported: bool = False

    @staticmethod
    def of(diagnosis: Any, told: Any, reported: Any) -> Said:
        """ValueError, TypeError or KeyError where no watch has written it."""
        said = Said(diagnosis=None if diagnosis is None else json.loads(diagnosis), told=told, reported=reported)
        if said.diagnosis is not None and not isinstance(said.diagnosis["sentence"], str):
            raise TypeError("a diagnosis without a sentence")
        return said


class Store:
    """One machine's watch in a folder. InputError where the folder belongs to another machine or other rules, another
    watch has it, or what it holds is damaged."""

    def __init__(
        self, folder: Path, machine: Hoist | Axis, rules: Rules, *, wait_s: float = 0.0,
        say: Callable[[str], None] = lambda line: None, anew: bool = False,
    ) -> None:  # fmt: skip
        """wait_s: how long another watch of this folder is waited for; say: told of that. anew: an empty store beside
        what is there, until `replace`."""
        self.folder, self._settings, self._keys = folder, _settings(machine, rules), watched_keys(machine)
        self._now = folder / (f".{FILE}.part" if anew else FILE)
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(folder, wait_s, say)
        try:
            if anew:
                self._now.unlink(missing_ok=True)
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        if self._now.exists():
            readable_file(self._now, "table")
        with self._sound():
            self._db = sqlite3.connect(self._now, isolation_level=None, timeout=5.0, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode=WAL")
            # What a power cut takes away is read again from the logs.
            self._db.execute("PRAGMA synchronous=NORMAL")
            with self._whole():
                if not self._db.execute("SELECT 1 FROM sqlite_master").fetchone():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self._db.execute(statement)
                    self._db.executemany("INSERT INTO settings VALUES (?, ?)", self._settings.items())
            kept = dict(self._db.execute("SELECT name, value FROM settings"))
            found = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            self.damaged(found)
        _check_settings(kept, self._settings, self.folder)

    def close(self) -> None:
        with contextlib.suppress(sqlite3.Error, AttributeError):
            self._db.close()
        self._lock.close()

    def replace(self) -> None:
        """A store made anew takes the place of what was there, which stays as watch.sqlite.damaged."""
        self._db.close()
        with contextlib.closing(self._lock), writable(self.folder):
            for end in ("-wal", "-shm"):
                (self.folder / f"{FILE}{end}").unlink(missing_ok=True)
            if (self.folder / FILE).exists():
                os.replace(self.folder / FILE, self.folder / DAMAGED)
            os.replace(self._now, self.folder / FILE)

    @contextmanager
    def _sound(self) -> Iterator[None]:
        """SQLite's errors, and rows that no watch has written, as one line each."""
        try:
            yield
        except sqlite3.Error as error:
            code = _code(error)
            if code in _NOT_WRITTEN:
                raise UnwritableError(f"cannot be written: {error}", file=self._now) from error
            if code in _IN_USE:
                raise InputError("is in use by another program; try again when it has ended", file=self._now) from error
            self.damaged(str(error), error)
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            self.damaged(f"a row is none that a watch writes: {_reason(error)}", error)

    def damaged(self, what: str, error: Exception | None = None) -> NoReturn:
        remedy = "'rebuild' makes it anew from cycles.parquet and the logs"
        if not (self.folder / "cycles.parquet").is_file():
            remedy = "there is no cycles.parquet to rebuild it from: move it away, and the logs are read again"
        raise DamagedError(f"is damaged ({what}); {remedy}", file=self._now) from error

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

    def _do(self, statement: str, *values: object) -> list[tuple[Any, ...]]:
        with self._sound():
            return self._db.execute(statement, values).fetchall()

    # What is written.

    def add(self, number: int, cycle: Cycle, judged: Judged) -> None:
        """A cycle and all that it brought, at once."""
        row, alarm = _row_of(number, cycle, judged), judged.alarm
        with self._sound(), self._whole():
            self._db.execute(f"INSERT INTO cycles VALUES ({', '.join(f':{name}' for name in row)})", row)
            events = [(number, event.kind, event.text) for event in judged.events]
            self._db.executemany("INSERT INTO events VALUES (?, ?, ?)", events)
            if alarm is not None:
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

    # What is read.

    def known(self, *digests: str) -> bool:
        """Whether a log of such a content was counted or refused."""
        marks = ", ".join("?" * len(digests))
        tables = (f"SELECT 1 FROM {table} WHERE digest IN ({marks})" for table in ("cycles", "refused"))
        return bool(self._do(" UNION ".join(tables), *digests, *digests))

    def cycles(self) -> list[Cycle]:
        """All cycles in the order in which they were counted."""
        rows = self._do(f"SELECT {', '.join(_Row.model_fields)} FROM cycles ORDER BY number")
        with self._sound():
            read = (_Row.model_validate(dict(zip(_Row.model_fields, row, strict=True))) for row in rows)
            return [row.cycle(k, self._keys) for k, row in enumerate(read)]

    def said(self) -> dict[int, Said]:
        """By the cycle of each alarm."""
        rows = self._do("SELECT cycle, diagnosis, told, reported FROM alarms ORDER BY cycle")
        with self._sound():
            return {int(cycle): Said.of(*values) for cycle, *values in rows}

    def refused(self) -> list[str]:
        """Why logs do not count."""
        return [str(reason) for (reason,) in self._do("SELECT reason FROM refused ORDER BY name")]

    def write_copies(self, judge: Judge) -> None:
        """cycles.parquet and alarms.parquet as they are now, each replaced as a whole. UnwritableError: a full disk."""
        cycles = []
        for k, (cycle, judged) in enumerate(zip(judge.cycles, judge.results, strict=True)):
            e = cycle.estimate
            plain = {name: getattr(e, name) for name in ("residual_rms", "noise_rms")}
            for key, value, error in zip(e.keys, e.values.tolist(), e.errors.tolist(), strict=True):
                plain |= {key: value, f"{key}.std_error": error}
            row = _row_of(k, cycle, judged)
            cycles.append({"cycle": row.pop("number"), **row, "counted": judged.counted, **plain})
        said, alarms = self.said(), []
        for a in judge.alarms:
            known = said[a.cycle]
            diagnosis = known.diagnosis or {}
            alarms.append({
                "cycle": a.cycle, "onset": a.onset, "statistic": a.statistic, "likeliest": a.causes[0].name,
                "share": float(a.causes[0].share), "again": a.again, "diagnosis": str(diagnosis.get("sentence", "")),
                "diagnosis_json": json.dumps(diagnosis) if diagnosis else "", "told": known.told,
                "reported": known.reported,
            })  # fmt: skip
        settings = {"settings": json.dumps(self._settings)}
        replace_table(self.folder / "cycles.parquet", cycles, metadata=settings)
        replace_table(self.folder / "alarms.parquet", alarms, _ALARMS, settings)


_ALARMS = [
    ("cycle", "int64"), ("onset", "int64"), ("statistic", "float64"), ("likeliest", "string"), ("share", "float64"),
    ("again", "bool"), ("diagnosis", "string"), ("diagnosis_json", "string"), ("told", "bool"), ("reported", "bool"),
]  # fmt: skip


def replace_table(
    file: Path, rows: Sequence[Mapping[str, Any]], schema: Any = None, metadata: Mapping[str, str] | None = None
) -> None:  # fmt: skip
    """A Parquet file, replaced as a whole. UnwritableError: a full disk."""
    import pyarrow as pa
    import pyarrow.parquet

    hidden = file.with_name(f".{file.name}.part")
    try:
        with writable(file):
            table = pa.Table.from_pylist(list(rows), schema=None if schema is None else pa.schema(schema))
            pyarrow.parquet.write_table(table.replace_schema_metadata(metadata), hidden)
            os.replace(hidden, file)
    finally:
        with contextlib.suppress(OSError):
            hidden.unlink(missing_ok=True)


def read_copies(folder: Path, machine: Hoist | Axis, rules: Rules) -> tuple[list[Cycle], dict[int, Said]]:
    """What a new watch.sqlite is made of: cycles, and what alarms.parquet, where it is whole, says of the alarms, by
    cycle. InputError where cycles.parquet is damaged."""
    import pyarrow as pa
    import pyarrow.parquet

    file, keys = folder / "cycles.parquet", watched_keys(machine)
    again = "move watch.sqlite away, and the logs are read again"
    try:
        cycles: list[Cycle] = []
        with pyarrow.parquet.ParquetFile(file, memory_map=False) as table:
            kept = json.loads((table.schema_arrow.metadata or {}).get(b"settings", b"{}"))
            for batch in table.iter_batches(1000):  # a file of many millions of wrong rows ends at the first one
                for row in batch.to_pylist():
                    read = _Row.model_validate({**row, "number": row["cycle"], "counted": int(row["counted"])})
                    cycles.append(read.cycle(len(cycles), keys))
    except FileNotFoundError as error:
        raise InputError(f"is not there; {again}", file=file) from error
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise InputError(f"is damaged too ({_reason(error)}); {again}", file=file) from error
    _check_settings(kept, _settings(machine, rules), folder)
    said: dict[int, Said] = {}
    with contextlib.suppress(pa.ArrowException, OSError, ValueError, TypeError, KeyError):  # asked and told again
        for row in pyarrow.parquet.read_table(folder / "alarms.parquet", memory_map=False).to_pylist():
            said[row["cycle"]] = Said.of(row["diagnosis_json"] or None, row["told"], row["reported"])
    return cycles, said


def _reason(error: Exception) -> str:
    """One line of what was wrong with a row."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)


def _code(error: sqlite3.Error) -> int:
    return int(getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)) & 0xFF


@contextmanager
def writable(place: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UnwritableError(f"cannot be written: {error.strerror or error}", file=place) from error


def _locked(folder: Path, wait_s: float, say: Callable[[str], None]) -> sqlite3.Connection:
    """Holds the folder for this process until it is closed; SQLite's own lock of an empty file, on every system."""
    ends, said, busy = time.monotonic() + wait_s, False, "another watch works on this state"
    while True:
        lock = sqlite3.connect(folder / LOCK, isolation_level=None, timeout=0.0, check_same_thread=False)
        try:
            lock.execute("BEGIN EXCLUSIVE")
            return lock
        except sqlite3.Error as error:
            lock.close()
            if _code(error) in _NOT_WRITTEN:
                raise UnwritableError(f"cannot be written: {error}", file=folder / LOCK) from error
            if _code(error) not in _IN_USE:
                raise InputError(f"is damaged ({error}); delete it", file=folder / LOCK) from error
            if time.monotonic() >= ends:
                waited = f" after {wait_s:g} s" if wait_s else ""
                raise InputError(f"{busy}{waited}; try again when it has ended", file=folder) from error
        if not said:
            said = True
            say(f"{folder}: {busy}; waiting for it, at most {wait_s:g} s")
        time.sleep(LOCK_EVERY_S)


def _settings(machine: Hoist | Axis, rules: Rules) -> dict[str, str]:
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
