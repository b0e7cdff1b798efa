"""What the watch knows, on disk: an SQLite file, in which a cycle stands once, whole or not at all, and Parquet copies.

A cycle is known by the digest of its log's content, so that neither another name nor a restart counts it twice. A cycle
and what it brought (events, an alarm) are one transaction: after kill -9 it is there with all of it, or not at all and
its log is read again. Others read `cycles.parquet` and `alarms.parquet`, which are replaced as wholes.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.input_file import open_input
from workbench.machine import Axis, Hoist
from workbench.watch.estimate import Estimate
from workbench.watch.judge import Alarm, Cycle, Event, Rules

FILE = "watch.sqlite"
FORMAT = 1
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
    again INTEGER NOT NULL, diagnosis TEXT, told INTEGER NOT NULL DEFAULT 0);
"""


@dataclass(frozen=True)
class Kept:
    """A cycle as it stands in the store, with where its log was."""

    number: int
    cycle: Cycle
    file: str
    start_position_m: float
    counted: bool
    statistic: float


@dataclass(frozen=True)
class KeptAlarm:
    """diagnosis: what `diagnose` said, None where it has not been asked yet; told: the webhook has it."""

    cycle: int
    onset: int
    statistic: float
    causes: tuple[dict[str, Any], ...]
    again: bool
    diagnosis: dict[str, Any] | None
    told: bool


class Store:
    """One machine's watch in a folder. InputError where the folder belongs to another machine or other rules."""

    def __init__(self, folder: Path, machine: Hoist | Axis, rules: Rules) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(folder / FILE, isolation_level=None, timeout=5.0)
            self._db.execute("PRAGMA journal_mode=WAL")
            # What a power cut takes away is read again from the logs.
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._set_up(machine, rules)
        except OSError as error:
            raise InputError(f"cannot be written: {error.strerror or error}", file=folder) from error
        except sqlite3.DatabaseError as error:
            raise InputError(f"is no store of a watch: {error}", file=folder / FILE) from error

    def close(self) -> None:
        self._db.close()

    def _set_up(self, machine: Hoist | Axis, rules: Rules) -> None:
        db = self._db
        db.execute("BEGIN IMMEDIATE")
        try:
            if not db.execute("SELECT 1 FROM sqlite_master WHERE name = 'settings'").fetchone():
                for statement in filter(str.strip, _TABLES.split(";")):
                    db.execute(statement)
                for name, value in _settings(machine, rules).items():
                    db.execute("INSERT INTO settings VALUES (?, ?)", (name, value))
            kept = dict(db.execute("SELECT name, value FROM settings"))
        finally:
            db.execute("COMMIT")
        for name, value in _settings(machine, rules).items():
            if kept.get(name) != value:
                raise InputError(
                    f"was begun with another {name.replace('_', ' ')}; choose another folder for the state",
                    file=self.folder,
                )

    def known(self, digest: str) -> bool:
        """Whether a log of this content was counted or refused."""
        question = "SELECT 1 FROM cycles WHERE digest = ? UNION SELECT 1 FROM refused WHERE digest = ?"
        return self._db.execute(question, (digest, digest)).fetchone() is not None

    def add(
        self,
        digest: str,
        file: str,
        cycle: Cycle,
        start_position_m: float,
        counted: bool,
        statistic: float,
        events: Sequence[Event],
        alarm: Alarm | None,
        again: bool,
        notes: Sequence[str],
    ) -> None:
        """A cycle and all that it brought, at once."""
        db, made = self._db, cycle.estimate
        estimate = {
            "keys": list(made.keys), "values": made.values.tolist(), "errors": made.errors.tolist(),
            "resolution": made.resolution.tolist(), "residual_rms": made.residual_rms, "noise_rms": made.noise_rms,
        }  # fmt: skip
        db.execute("BEGIN IMMEDIATE")
        try:
            (number,) = db.execute("SELECT COUNT(*) FROM cycles").fetchone()
            db.execute(
                "INSERT INTO cycles VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (number, digest, cycle.name, file, cycle.payload_kg, start_position_m, cycle.start_s,
                 cycle.duration_s, int(counted), statistic, json.dumps(estimate), json.dumps(list(notes))),
            )  # fmt: skip
            for event in events:
                db.execute("INSERT INTO events VALUES (?, ?, ?)", (number, event.kind, event.text))
            if alarm is not None:
                causes = json.dumps([asdict(cause) for cause in alarm.causes])
                db.execute(
                    "INSERT INTO alarms VALUES (?, ?, ?, ?, ?, NULL, 0)",
                    (number, alarm.onset, alarm.statistic, causes, int(again)),
                )
            db.execute("COMMIT")
        except BaseException:
            db.execute("ROLLBACK")
            raise

    def refuse(self, digest: str, name: str, reason: str) -> None:
        self._db.execute("INSERT OR IGNORE INTO refused VALUES (?, ?, ?)", (digest, name, reason))

    def diagnosed(self, cycle: int, diagnosis: Mapping[str, Any]) -> None:
        self._db.execute("UPDATE alarms SET diagnosis = ? WHERE cycle = ?", (json.dumps(diagnosis), cycle))

    def told(self, cycle: int) -> None:
        self._db.execute("UPDATE alarms SET told = 1 WHERE cycle = ?", (cycle,))

    def cycles(self) -> list[Kept]:
        """All cycles in the order in which they were counted."""
        rows = self._db.execute(
            "SELECT number, name, file, payload_kg, start_position_m, start_s, duration_s, counted, statistic, "
            "estimate FROM cycles ORDER BY number"
        )
        return [
            Kept(number, Cycle(name, payload, start, duration, _estimate(estimate)), file, at, bool(counted), statistic)
            for number, name, file, payload, at, start, duration, counted, statistic, estimate in rows
        ]

    def alarms(self) -> list[KeptAlarm]:
        rows = self._db.execute(
            "SELECT cycle, onset, statistic, causes, again, diagnosis, told FROM alarms ORDER BY cycle"
        )
        return [
            KeptAlarm(
                cycle, onset, statistic, tuple(json.loads(causes)), bool(again),
                None if diagnosis is None else json.loads(diagnosis), bool(told),
            )
            for cycle, onset, statistic, causes, again, diagnosis, told in rows
        ]  # fmt: skip

    def events(self) -> list[Event]:
        return [Event(*row) for row in self._db.execute("SELECT cycle, kind, text FROM events ORDER BY cycle")]

    def refused(self) -> list[tuple[str, str]]:
        return list(self._db.execute("SELECT name, reason FROM refused ORDER BY name"))

    def write_parquet(self) -> None:
        """cycles.parquet and alarms.parquet as they are now, each replaced as a whole."""
        import pyarrow as pa
        import pyarrow.parquet

        kept = self.cycles()
        columns: dict[str, list[Any]] = {
            "cycle": [c.number for c in kept],
            "name": [c.cycle.name for c in kept],
            "payload_kg": [c.cycle.payload_kg for c in kept],
            "start_s": [c.cycle.start_s for c in kept],
            "duration_s": [c.cycle.duration_s for c in kept],
            "counted": [c.counted for c in kept],
            "statistic": [c.statistic for c in kept],
            "residual_rms": [c.cycle.estimate.residual_rms for c in kept],
        }
        for i, key in enumerate(kept[0].cycle.estimate.keys if kept else ()):
            columns[key] = [float(c.cycle.estimate.values[i]) for c in kept]
            columns[f"{key}.std_error"] = [float(c.cycle.estimate.errors[i]) for c in kept]
        alarms = self.alarms()
        rows = {
            "cycle": [a.cycle for a in alarms],
            "onset": [a.onset for a in alarms],
            "statistic": [a.statistic for a in alarms],
            "likeliest": [a.causes[0]["name"] if a.causes else "" for a in alarms],
            "share": [float(a.causes[0]["share"]) if a.causes else 0.0 for a in alarms],
            "again": [a.again for a in alarms],
            "diagnosis": ["" if a.diagnosis is None else str(a.diagnosis.get("sentence", "")) for a in alarms],
        }
        for name, table in (("cycles", columns), ("alarms", rows)):
            hidden = self.folder / f".{name}.parquet.part"
            pyarrow.parquet.write_table(pa.table(table), hidden)
            os.replace(hidden, self.folder / f"{name}.parquet")


def _settings(machine: Hoist | Axis, rules: Rules) -> dict[str, str]:
    """What all cycles of one state share. Limits may change: they only tell how long until."""
    text = json.dumps(machine.model_dump(mode="json"), sort_keys=True)
    chosen = {key: value for key, value in asdict(rules).items() if key != "limits"}
    return {
        "format": str(FORMAT),
        "machine": hashlib.sha256(text.encode()).hexdigest(),
        **{name: repr(value) for name, value in chosen.items()},
    }


def _estimate(text: str) -> Estimate:
    data = json.loads(text)
    return Estimate(
        tuple(data["keys"]),
        np.array(data["values"]),
        np.array(data["errors"]),
        np.array(data["resolution"]),
        data["residual_rms"],
        data["noise_rms"],
    )


def digest_of(file: Path) -> str:
    """Of a file's content. InputError where it cannot be opened, OSError where the disk fails."""
    with open_input(file, "log") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
