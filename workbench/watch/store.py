"""The state of a watch on disk: an SQLite file that holds each cycle once, whole or not at all, and Parquet copies.

A cycle is known by the digest of its log, so that neither another name nor a restart counts it twice. A cycle and what
it brought (events, an alarm) are one transaction: after kill -9 it is there with all of it, or its log is read again.
One process at a time writes; the lock is the system's and ends with the process, however it ends. `cycles.parquet` and
`alarms.parquet` are replaced as wholes and hold all that a new watch.sqlite is made of, see `read_copies`.
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
from typing import Any, NoReturn

import numpy as np

from workbench.core.errors import InputError
from workbench.core.input_file import open_input
from workbench.machines import Axis, Hoist
from workbench.watch.estimate import Estimate, watched_keys
from workbench.watch.judge import Cycle, Event, Judged, Rules

FILE, LOCK, DAMAGED = "watch.sqlite", "watch.lock", "watch.sqlite.damaged"
FORMAT = 2
LOCK_EVERY_S = 0.1
MOST = 1e100  # of any estimate's absolute value
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
COLUMNS = (
    "number", "digest", "name", "file", "payload_kg", "start_position_m", "start_s", "duration_s", "counted",
    "statistic", "estimate", "notes",
)  # fmt: skip
_CYCLES = f"SELECT {', '.join(COLUMNS)} FROM cycles ORDER BY number"
# What SQLite's result codes mean for a user; every other one is a damaged file.
_NOT_WRITTEN = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN}
_IN_USE = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}


class UnwritableError(InputError):
    """The state cannot be written now, and can be when there is room again; nothing of it is lost."""


class DamagedError(InputError):
    """watch.sqlite holds what no watch has written."""


class OldFormatError(InputError):
    """watch.sqlite is of an earlier version, and is made anew from its cycles."""


@dataclass(frozen=True)
class Kept:
    """A cycle as it stands in the store, with where its log was."""

    number: int
    digest: str
    cycle: Cycle
    file: str
    start_position_m: float
    counted: bool
    statistic: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeptAlarm:
    """diagnosis: the answer of `diagnose`, None where it has not been asked yet; told: the webhook has it; reported:
    an exit status has told of it."""

    cycle: int
    onset: int
    statistic: float
    causes: tuple[dict[str, Any], ...]
    again: bool
    diagnosis: dict[str, Any] | None
    told: bool
    reported: bool


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
            self._check()
        except BaseException:
            self.close()
            raise

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

    def _open(self) -> None:
        with self._said():
            self._db = sqlite3.connect(self._now, isolation_level=None, timeout=5.0, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode=WAL")
            # What a power cut takes away is read again from the logs.
            self._db.execute("PRAGMA synchronous=NORMAL")
            with self._whole():
                if not self._db.execute("SELECT 1 FROM sqlite_master").fetchone():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self._db.execute(statement)
                    self._db.executemany("INSERT INTO settings VALUES (?, ?)", self._settings.items())

    def _check(self) -> None:
        with self._said():
            kept = dict(self._db.execute("SELECT name, value FROM settings"))
            found = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            self._damaged(found)
        if kept.get("format") == "1":
            raise OldFormatError(f"{FILE} is of an earlier version", file=self.folder)
        _same_settings(kept, self._settings, self.folder)

    # Errors.

    @contextmanager
    def _said(self) -> Iterator[None]:
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
        except (ValueError, TypeError, KeyError, IndexError, OverflowError, AttributeError, RecursionError) as error:
            self._damaged(f"a row is none that a watch writes: {error}", error)

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

    def _do(self, statement: str, *values: object) -> None:
        with self._said():
            self._db.execute(statement, values)

    def _rows(self, question: str, *values: object) -> list[tuple[Any, ...]]:
        with self._said():
            return self._db.execute(question, values).fetchall()

    # What is written.

    def add(self, kept: Kept, judged: Judged) -> None:
        """A cycle and all that it brought, at once."""
        made, cycle, alarm = kept.cycle.estimate, kept.cycle, judged.alarm
        estimate = {
            "keys": list(made.keys), "values": made.values.tolist(), "errors": made.errors.tolist(),
            "resolution": made.resolution.tolist(), "residual_rms": made.residual_rms, "noise_rms": made.noise_rms,
        }  # fmt: skip
        row = (
            kept.number, kept.digest, cycle.name, kept.file, cycle.payload_kg, kept.start_position_m, cycle.start_s,
            cycle.duration_s, int(kept.counted), kept.statistic, json.dumps(estimate), json.dumps(list(kept.notes)),
        )  # fmt: skip
        with self._said(), self._whole():
            self._db.execute(f"INSERT INTO cycles VALUES ({', '.join('?' * len(row))})", row)
            for event in judged.events:
                self._db.execute("INSERT INTO events VALUES (?, ?, ?)", (kept.number, event.kind, event.text))
            if alarm is not None:
                causes = json.dumps([asdict(cause) for cause in alarm.causes])
                self._db.execute(
                    "INSERT INTO alarms VALUES (?, ?, ?, ?, ?, NULL, 0, 0)",
                    (kept.number, alarm.onset, alarm.statistic, causes, int(judged.again)),
                )

    def refuse(self, digest: str, name: str, reason: str) -> None:
        self._do("INSERT OR IGNORE INTO refused VALUES (?, ?, ?)", digest, name, reason)

    def diagnosed(self, cycle: int, diagnosis: Mapping[str, Any]) -> None:
        self._do("UPDATE alarms SET diagnosis = ? WHERE cycle = ?", json.dumps(diagnosis), cycle)

    def told(self, cycle: int) -> None:
        self._do("UPDATE alarms SET told = 1 WHERE cycle = ?", cycle)

    def say_again(self, cycle: int, diagnosis: str | None, told: bool, reported: bool) -> None:
        """What an earlier store knew of the alarm at a cycle, if there is one."""
        values = diagnosis, int(told), int(reported), cycle
        self._do("UPDATE alarms SET diagnosis = ?, told = ?, reported = ? WHERE cycle = ?", *values)

    def report(self) -> int:
        """How many alarms no exit status has told of; from now on they are told of."""
        (count,) = self._rows("SELECT COUNT(*) FROM alarms WHERE NOT again AND NOT reported")[0]
        if count:
            self._do("UPDATE alarms SET reported = 1")
        return int(count)

    # What is read.

    def known(self, *digests: str) -> bool:
        """Whether a log of such a content was counted or refused."""
        marks = ", ".join("?" * len(digests))
        question = (
            f"SELECT 1 FROM cycles WHERE digest IN ({marks}) UNION SELECT 1 FROM refused WHERE digest IN ({marks})"
        )
        return bool(self._rows(question, *digests, *digests))

    def cycles(self) -> list[Kept]:
        """All cycles in the order in which they were counted."""
        rows = self._rows(_CYCLES)
        with self._said():
            return [_kept(k, self._keys, row) for k, row in enumerate(rows)]

    def alarms(self) -> list[KeptAlarm]:
        rows = self._rows(
            "SELECT cycle, onset, statistic, causes, again, diagnosis, told, reported FROM alarms ORDER BY cycle"
        )
        with self._said():
            return [_alarm(*row) for row in rows]

    def events(self) -> list[Event]:
        with self._said():
            rows = self._rows("SELECT cycle, kind, text FROM events ORDER BY cycle, rowid")
            return [Event(int(cycle), str(kind), str(text)) for cycle, kind, text in rows]

    def refused(self) -> list[tuple[str, str]]:
        return [
            (str(name), str(reason)) for name, reason in self._rows("SELECT name, reason FROM refused ORDER BY name")
        ]

    # Copies.

    def write_parquet(self) -> None:
        """cycles.parquet and alarms.parquet as they are now, each replaced as a whole. UnwritableError: a full disk."""
        import pyarrow as pa
        import pyarrow.parquet

        kept, alarms = self.cycles(), self.alarms()
        made = [k.cycle.estimate for k in kept]
        columns: dict[str, list[Any]] = {
            "cycle": [k.number for k in kept],
            "name": [k.cycle.name for k in kept],
            "payload_kg": [k.cycle.payload_kg for k in kept],
            "start_s": [k.cycle.start_s for k in kept],
            "duration_s": [k.cycle.duration_s for k in kept],
            "counted": [k.counted for k in kept],
            "statistic": [k.statistic for k in kept],
            "residual_rms": [e.residual_rms for e in made],
            "noise_rms": [e.noise_rms for e in made],
            "start_position_m": [k.start_position_m for k in kept],
            "digest": [k.digest for k in kept],
            "file": [k.file for k in kept],
            "notes": [list(k.notes) for k in kept],
            "resolution": [e.resolution.ravel().tolist() for e in made],
        }
        for i, key in enumerate(self._keys):
            columns[key] = [float(e.values[i]) for e in made]
            columns[f"{key}.std_error"] = [float(e.errors[i]) for e in made]
        rows = {
            "cycle": [a.cycle for a in alarms],
            "onset": [a.onset for a in alarms],
            "statistic": [a.statistic for a in alarms],
            "likeliest": [a.causes[0]["name"] if a.causes else "" for a in alarms],
            "share": [float(a.causes[0]["share"]) if a.causes else 0.0 for a in alarms],
            "again": [a.again for a in alarms],
            "diagnosis": ["" if a.diagnosis is None else str(a.diagnosis.get("sentence", "")) for a in alarms],
            "diagnosis_json": ["" if a.diagnosis is None else json.dumps(a.diagnosis) for a in alarms],
            "told": [a.told for a in alarms],
            "reported": [a.reported for a in alarms],
        }
        for name, table in (("cycles", columns), ("alarms", rows)):
            hidden = self.folder / f".{name}.parquet.part"
            try:
                made_of = pa.table(table).replace_schema_metadata({"settings": json.dumps(self._settings)})
                pyarrow.parquet.write_table(made_of, hidden)
                os.replace(hidden, self.folder / f"{name}.parquet")
            except OSError as error:
                with contextlib.suppress(OSError):
                    hidden.unlink(missing_ok=True)
                reason = error.strerror or str(error)
                raise UnwritableError(f"cannot be written: {reason}", file=self.folder / f"{name}.parquet") from error


@dataclass(frozen=True)
class Copies:
    """What a new watch.sqlite is made of: the cycles, and of the alarms, by cycle, what was said and told of them."""

    cycles: Sequence[Kept]
    alarms: Mapping[int, tuple[str | None, bool, bool]] = field(default_factory=dict)


def read_copies(folder: Path, machine: Hoist | Axis, rules: Rules) -> Copies:
    """From cycles.parquet, and alarms.parquet where it is whole. InputError where the former is damaged."""
    import pyarrow as pa
    import pyarrow.parquet

    file, keys = folder / "cycles.parquet", watched_keys(machine)
    try:
        table = pyarrow.parquet.read_table(file, memory_map=False)
        kept = json.loads((table.schema.metadata or {}).get(b"settings", b"{}"))
        rows = [_of_copy(k, keys, row) for k, row in enumerate(table.to_pylist())]
    except FileNotFoundError as error:
        raise InputError("is not there; move watch.sqlite away, and the logs are read again", file=file) from error
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise InputError(
            f"is damaged too ({error}); move watch.sqlite away, and the logs are read again", file=file
        ) from error
    _same_settings(kept, _settings(machine, rules), folder)
    said: dict[int, tuple[str | None, bool, bool]] = {}
    with contextlib.suppress(pa.ArrowException, OSError, ValueError, TypeError, KeyError):  # asked and told again
        for row in pyarrow.parquet.read_table(folder / "alarms.parquet", memory_map=False).to_pylist():
            if row["diagnosis_json"]:
                json.loads(row["diagnosis_json"])["sentence"]
            said[row["cycle"]] = (row["diagnosis_json"] or None, bool(row["told"]), bool(row["reported"]))
    return Copies(rows, said)


def read_old(folder: Path, machine: Hoist | Axis, rules: Rules) -> Copies:
    """From a watch.sqlite of format 1, whose cycles are those of today."""
    keys, file = watched_keys(machine), folder / FILE
    try:
        with contextlib.closing(sqlite3.connect(file)) as db:
            kept = dict(db.execute("SELECT name, value FROM settings"))
            _same_settings({**kept, "format": str(FORMAT)}, _settings(machine, rules), folder)
            rows = db.execute(_CYCLES).fetchall()
            said = {
                cycle: (d, bool(told), True)
                for cycle, d, told in db.execute("SELECT cycle, diagnosis, told FROM alarms")
            }
        return Copies([_kept(k, keys, row) for k, row in enumerate(rows)], said)
    except (sqlite3.Error, ValueError, TypeError, KeyError) as error:
        raise InputError(f"is damaged ({error}); move it away, and the logs are read again", file=file) from error


def _locked(folder: Path, wait_s: float, say: Callable[[str], None]) -> sqlite3.Connection:
    """Holds the folder for this process until it is closed; SQLite's own lock of an empty file, on every system."""
    ends, said = time.monotonic() + wait_s, False
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
                raise InputError(f"another watch works on this state{waited}; try again when it has ended",
                                 file=folder) from error  # fmt: skip
        if not said:
            said = True
            say(f"{folder}: another watch works on this state; waiting for it, at most {wait_s:g} s")
        time.sleep(LOCK_EVERY_S)


def _settings(machine: Hoist | Axis, rules: Rules) -> dict[str, str]:
    """What all cycles of one state share. Limits may change: they only tell how long until."""
    text = json.dumps(machine.model_dump(mode="json"), sort_keys=True)
    chosen = {key: value for key, value in asdict(rules).items() if key != "limits"}
    return {
        "format": str(FORMAT),
        "machine": hashlib.sha256(text.encode()).hexdigest(),
        **{name: repr(value) for name, value in chosen.items()},
    }


def _same_settings(kept: Mapping[str, Any], wanted: Mapping[str, str], folder: Path) -> None:
    for name, value in wanted.items():
        if kept.get(name) != value:
            raise InputError(
                f"was begun with another {name.replace('_', ' ')}; choose another folder for the state", file=folder
            )


def _kept(k: int, keys: tuple[str, ...], row: Sequence[Any]) -> Kept:
    """A row of the table of cycles. ValueError, TypeError or KeyError where no watch has written it."""
    number, digest, name, file, payload, at, start, duration, counted, statistic, estimate, notes = row
    data = json.loads(estimate) if isinstance(estimate, str) else estimate
    m, arrays = len(keys), [np.asarray(data[what], dtype=float) for what in ("values", "errors", "resolution")]
    if number != k:
        raise ValueError(f"cycle {k} is missing")
    if tuple(data["keys"]) != keys or [array.shape for array in arrays] != [(m,), (m,), (m, m)]:
        raise ValueError("estimates of other parameters")
    if not all(np.all(np.abs(array) < MOST) for array in arrays):
        raise ValueError("an estimate is no number of this world")
    made = Estimate(keys, arrays[0], arrays[1], arrays[2], _number(data["residual_rms"]), _number(data["noise_rms"]))
    cycle = Cycle(_text(name), _number(payload), _number(start), _number(duration), made)
    said = tuple(map(_text, json.loads(notes) if isinstance(notes, str) else notes))
    return Kept(k, _text(digest), cycle, _text(file), _number(at), bool(counted), _number(statistic), said)


def _of_copy(k: int, keys: tuple[str, ...], row: Mapping[str, Any]) -> Kept:
    """A row of cycles.parquet."""
    estimate = {
        "keys": keys, "values": [row[key] for key in keys], "errors": [row[f"{key}.std_error"] for key in keys],
        "resolution": np.reshape(row["resolution"], (len(keys), len(keys))), "residual_rms": row["residual_rms"],
        "noise_rms": row["noise_rms"],
    }  # fmt: skip
    given = {**row, "number": row["cycle"], "estimate": estimate}
    return _kept(k, keys, [given[column] for column in COLUMNS])


def _alarm(
    cycle: Any, onset: Any, statistic: Any, causes: Any, again: Any, diagnosis: Any, told: Any, reported: Any
) -> KeptAlarm:
    said = None if diagnosis is None else json.loads(diagnosis)
    if said is not None:
        _text(said["sentence"])
    named = tuple(dict(cause) for cause in json.loads(causes))
    for cause in named:
        _text(cause["name"]), _number(cause["amount"]), _number(cause["share"]), _text(cause["keys"][0])
    if not 0 <= onset <= cycle or not named:
        raise ValueError(f"the alarm of cycle {cycle} is none")
    return KeptAlarm(
        int(cycle), int(onset), _number(statistic), named, bool(again), said, bool(told), bool(reported)
    )  # fmt: skip


def _number(value: Any) -> float:
    """ValueError for what is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise ValueError(f"{value!r:.40}, expected a number")
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r:.40}, expected a word")
    return value


def digest_of(file: Path) -> str:
    """Of a file's content. InputError where it cannot be opened, OSError where the disk fails."""
    with open_input(file, "log") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
