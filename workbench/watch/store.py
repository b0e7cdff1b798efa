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
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from workbench.core.errors import InputError
from workbench.core.input_file import open_input, readable_file
from workbench.machines import Axis, Hoist
from workbench.watch.estimate import Estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Judged, Rules

FILE, LOCK, DAMAGED = "watch.sqlite", "watch.lock", "watch.sqlite.damaged"
FORMAT, BEFORE = 2, "1"  # a state of the format before is taken over
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
    """A row of the table of cycles, as a watch writes it."""

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
    estimate: _Estimate
    notes: list[str]


_COLUMNS = ", ".join(_Row.model_fields)
_CYCLES = f"SELECT {_COLUMNS} FROM cycles ORDER BY number"


class Said(BaseModel):
    """What is known of an alarm beside what its cycles tell. diagnosis: the answer of `diagnose`, None where it has not
    been asked yet; told: the webhook has it; reported: an exit status has told of it."""

    diagnosis: Annotated[dict[str, Any], Field(strict=True)] | None = None
    told: bool = False
    reported: bool = False


@dataclass(frozen=True)
class Copies:
    """What a new watch.sqlite is made of: the cycles, and of the alarms, by cycle, what was said and told of them."""

    cycles: Sequence[Cycle]
    said: Mapping[int, Said] = field(default_factory=dict)


class OldFormatError(InputError):
    """watch.sqlite is of an earlier version, and is made anew from its cycles, which are those of today."""

    def __init__(self, copies: Copies, folder: Path) -> None:
        super().__init__(f"{FILE} is of an earlier version", file=folder)
        self.copies = copies


class Store:
    """One machine's watch in a folder. InputError where the folder belongs to another machine or other rules, another
    watch has it, or what it holds is damaged."""

    def __init__(
        self,
        folder: Path,
        machine: Hoist | Axis,
        rules: Rules,
        *,
        wait_s: float = 0.0,
        say: Callable[[str], None] = lambda line: None,
        anew: bool = False,
    ) -> None:
        """wait_s: how long another watch of this folder is waited for; say: told of that. anew: an empty store beside
        what is there, until `replace`."""
        self.folder, self._settings, self._keys = folder, _settings(machine, rules), watched_keys(machine)
        self._now = folder / (f".{FILE}.part" if anew else FILE)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot be written: {error.strerror or error}", file=folder) from error
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
            self._damaged(found)
        old = kept.get("format") == BEFORE
        _check_settings(kept | ({"format": str(FORMAT)} if old else {}), self._settings, self.folder)
        if old:
            raise OldFormatError(Copies(self.cycles(), self.said("1")), self.folder)

    def close(self) -> None:
        with contextlib.suppress(sqlite3.Error, AttributeError):
            self._db.close()
        self._lock.close()

    def replace(self) -> None:
        """A store made anew takes the place of what was there, which stays as watch.sqlite.damaged."""
        self._db.close()
        try:
            for end in ("-wal", "-shm"):
                (self.folder / f"{FILE}{end}").unlink(missing_ok=True)
            if (self.folder / FILE).exists():
                os.replace(self.folder / FILE, self.folder / DAMAGED)
            os.replace(self._now, self.folder / FILE)
        except OSError as error:
            raise UnwritableError(f"cannot be written: {error.strerror or error}", file=self.folder) from error
        finally:
            self._lock.close()

    @contextmanager
    def _sound(self) -> Iterator[None]:
        """SQLite's errors, and rows that no watch has written, as one line each."""
        try:
            yield
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
            if code in _NOT_WRITTEN:
                raise UnwritableError(f"cannot be written: {error}", file=self._now) from error
            if code in _IN_USE:
                raise InputError("is in use by another program; try again when it has ended", file=self._now) from error
            self._damaged(str(error), error)
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            self._damaged(f"a row is none that a watch writes: {_reason(error)}", error)

    def _damaged(self, what: str, error: Exception | None = None) -> NoReturn:
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
        e, alarm = cycle.estimate, judged.alarm
        arrays = {name: np.asarray(getattr(e, name)).tolist() for name in ("values", "errors", "resolution")}
        estimate = {"keys": list(e.keys), **arrays, "residual_rms": e.residual_rms, "noise_rms": e.noise_rms}
        row = (
            number, cycle.digest, cycle.name, cycle.file, cycle.payload_kg, cycle.start_position_m, cycle.start_s,
            cycle.duration_s, int(judged.counted), judged.statistic, json.dumps(estimate), json.dumps(cycle.notes),
        )  # fmt: skip
        with self._sound(), self._whole():
            self._db.execute(f"INSERT INTO cycles VALUES ({', '.join('?' * len(row))})", row)
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
        rows = self._do(_CYCLES)
        with self._sound():
            return [_cycle(k, self._keys, _parsed(row)) for k, row in enumerate(rows)]

    def said(self, reported: str = "reported") -> dict[int, Said]:
        """By the cycle of each alarm. reported: its column."""
        rows = self._do(f"SELECT cycle, diagnosis, told, {reported} FROM alarms ORDER BY cycle")
        with self._sound():
            return {int(cycle): _said(*values) for cycle, *values in rows}

    def refused(self) -> list[str]:
        """Why logs do not count."""
        return [str(reason) for (reason,) in self._do("SELECT reason FROM refused ORDER BY name")]

    def write_copies(self, judge: Judge) -> None:
        """cycles.parquet and alarms.parquet as they are now, each replaced as a whole. UnwritableError: a full disk."""
        import pyarrow as pa
        import pyarrow.parquet

        said = self.said()
        settings = {"settings": json.dumps(self._settings)}
        tables = {
            "cycles": [_copy(k, *pair) for k, pair in enumerate(zip(judge.cycles, judge.results, strict=True))],
            "alarms": [
                {
                    "cycle": a.cycle, "onset": a.onset, "statistic": a.statistic, "likeliest": a.causes[0].name,
                    "share": float(a.causes[0].share), "again": a.again,
                    "diagnosis": str((said[a.cycle].diagnosis or {}).get("sentence", "")),
                    "diagnosis_json": "" if said[a.cycle].diagnosis is None else json.dumps(said[a.cycle].diagnosis),
                    "told": said[a.cycle].told, "reported": said[a.cycle].reported,
                }
                for a in judge.alarms
            ],
        }  # fmt: skip
        for name, rows in tables.items():
            hidden, file = self.folder / f".{name}.parquet.part", self.folder / f"{name}.parquet"
            schema = pa.schema(_ALARMS) if name == "alarms" else None
            try:
                table = pa.Table.from_pylist(rows, schema=schema).replace_schema_metadata(settings)
                pyarrow.parquet.write_table(table, hidden)
                os.replace(hidden, file)
            except OSError as error:
                with contextlib.suppress(OSError):
                    hidden.unlink(missing_ok=True)
                raise UnwritableError(f"cannot be written: {error.strerror or error}", file=file) from error


_ALARMS = [
    ("cycle", "int64"), ("onset", "int64"), ("statistic", "float64"), ("likeliest", "string"), ("share", "float64"),
    ("again", "bool"), ("diagnosis", "string"), ("diagnosis_json", "string"), ("told", "bool"), ("reported", "bool"),
]  # fmt: skip


def _copy(k: int, cycle: Cycle, judged: Judged) -> dict[str, Any]:
    """A row of cycles.parquet."""
    e = cycle.estimate
    row = {
        "cycle": k, "name": cycle.name, "payload_kg": cycle.payload_kg, "start_s": cycle.start_s,
        "duration_s": cycle.duration_s, "counted": judged.counted, "statistic": judged.statistic,
        "residual_rms": e.residual_rms, "noise_rms": e.noise_rms, "start_position_m": cycle.start_position_m,
        "digest": cycle.digest, "file": cycle.file, "notes": list(cycle.notes),
        "resolution": e.resolution.ravel().tolist(),
    }  # fmt: skip
    for key, value, error in zip(e.keys, e.values.tolist(), e.errors.tolist(), strict=True):
        row |= {key: value, f"{key}.std_error": error}
    return row


def _of_copy(keys: tuple[str, ...], row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of cycles.parquet as one of the table of cycles."""
    m = len(keys)
    estimate = {
        "keys": list(keys), "values": [row[key] for key in keys], "errors": [row[f"{key}.std_error"] for key in keys],
        "resolution": np.reshape(row["resolution"], (m, m)).tolist(), "residual_rms": row["residual_rms"],
        "noise_rms": row["noise_rms"],
    }  # fmt: skip
    return {**row, "number": row["cycle"], "counted": int(row["counted"]), "estimate": estimate}


def read_copies(folder: Path, machine: Hoist | Axis, rules: Rules) -> Copies:
    """From cycles.parquet, and alarms.parquet where it is whole. InputError where the former is damaged."""
    import pyarrow as pa
    import pyarrow.parquet

    file, keys, again = (
        folder / "cycles.parquet",
        watched_keys(machine),
        "move watch.sqlite away, and the logs are read",
    )
    try:
        cycles: list[Cycle] = []
        with pyarrow.parquet.ParquetFile(file, memory_map=False) as table:
            kept = json.loads((table.schema_arrow.metadata or {}).get(b"settings", b"{}"))
            for batch in table.iter_batches(1000):  # a file of many millions of wrong rows ends at the first one
                cycles += [_cycle(k, keys, _of_copy(keys, row)) for k, row in enumerate(batch.to_pylist(), len(cycles))]
    except FileNotFoundError as error:
        raise InputError(f"is not there; {again} again", file=file) from error
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise InputError(f"is damaged too ({_reason(error)}); {again} again", file=file) from error
    _check_settings(kept, _settings(machine, rules), folder)
    said: dict[int, Said] = {}
    with contextlib.suppress(pa.ArrowException, OSError, ValueError, TypeError, KeyError):  # asked and told again
        for row in pyarrow.parquet.read_table(folder / "alarms.parquet", memory_map=False).to_pylist():
            said[row["cycle"]] = _said(row["diagnosis_json"] or None, row["told"], row["reported"])
    return Copies(cycles, said)


def _parsed(row: Sequence[Any]) -> dict[str, Any]:
    """A row of SQLite with its JSON read."""
    made = dict(zip(_Row.model_fields, row, strict=True))
    return {**made, "estimate": json.loads(made["estimate"]), "notes": json.loads(made["notes"])}


def _cycle(k: int, keys: tuple[str, ...], data: Mapping[str, Any]) -> Cycle:
    """ValueError, TypeError or KeyError where no watch has written it."""
    row, m = _Row.model_validate({name: data[name] for name in _Row.model_fields}), len(keys)
    e = row.estimate
    values, errors, resolution = (np.asarray(x, dtype=float) for x in (e.values, e.errors, e.resolution))
    if row.number != k:
        raise ValueError(f"cycle {k} is missing")
    if tuple(e.keys) != keys or (values.shape, errors.shape, resolution.shape) != ((m,), (m,), (m, m)):
        raise ValueError("estimates of other parameters")
    made = Estimate(keys, values, errors, resolution, e.residual_rms, e.noise_rms)
    of_log = row.digest, row.file, row.start_position_m, tuple(row.notes)
    return Cycle(row.name, row.payload_kg, row.start_s, row.duration_s, made, *of_log)


def _said(diagnosis: Any, told: Any, reported: Any) -> Said:
    said = Said(diagnosis=None if diagnosis is None else json.loads(diagnosis), told=told, reported=reported)
    if said.diagnosis is not None and not isinstance(said.diagnosis["sentence"], str):
        raise TypeError("a diagnosis without a sentence")
    return said


def _reason(error: Exception) -> str:
    """One line of what was wrong with a row."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)


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
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
            if code in _NOT_WRITTEN:
                raise UnwritableError(f"cannot be written: {error}", file=folder / LOCK) from error
            if code not in _IN_USE:
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
