"""Damaged states of a watch, their Parquet copies, and the files beside logs: made by seed, read as a watch reads them.

What is promised of each: a damaged watch.sqlite is one line, and the same cycles and alarms come back from
cycles.parquet; a damaged copy is one line; a wrong file beside a log keeps no other log from being counted.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import random
import shutil
import sqlite3
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.watch import healthy, month
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.machines import default_hoist, get_value
from workbench.view.watch import write_page
from workbench.watch.estimate import Estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Rules
from workbench.watch.store import FILE, DamagedError, Said, Store, rebuild
from workbench.watch.watch import Watch

KINDS = {"state": "watch.sqlite", "copies": "cycles.parquet", "sidecar": ""}
HOIST, RULES, CYCLES = default_hoist(), Rules(healthy=20), 60
SIDECAR = b"payload_kg: 4500.0\nstart_position_m: 9.0\nstart_time_s: 69.0\nname: lift 1\n"
_ODD = [
    None, -1, 0, 1, 10**30, 1e308, -1e308, 5e-324, "", "x", "a/b", "\x00", "\x1b[31m", "é" * 300, "x" * 3000,
    b"\xff\x00", "null", "[]", "{}", "[[[", '{"keys": []}', "NaN", "[1e999]", "[" * 4000,
]  # fmt: skip


@cache
def short_runs(count: int) -> tuple[Run, ...]:
    return tuple(run for run, _ in month(HOIST, count, healthy, 3))


def put(folder: Path, run: Run, start_s: float = 0.0) -> Path:
    """The log of a run, and the file beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{run.name}.csv"
    rows = np.column_stack([run.time_s, *run.signals.values()])
    np.savetxt(file, rows, "%.10g", ",", header=",".join(("time_s", *run.signals)), comments="")
    said = f"payload_kg: {run.payload_kg}\nstart_position_m: 9.0\nstart_time_s: {start_s}\n"
    file.with_name(f"{file.name}.yaml").write_text(said, encoding="utf-8")
    return file


def make_state(folder: Path) -> None:
    """CYCLES cycles whose friction grows at the fortieth: a baseline, events and an alarm with its diagnosis."""
    noise, keys = np.random.default_rng(4), watched_keys(HOIST)
    sizes, nominal = np.array([300.0, 300.0, 100.0, 0.02, 10.0]), np.array([get_value(HOIST, key) for key in keys])
    store, judge = Store(folder, HOIST, RULES), Judge(RULES)
    for k in range(CYCLES):
        values = nominal + sizes * noise.normal(size=5) + np.array([2000.0, 2000.0, 0.0, 0.0, 0.0]) * (k >= 40)
        start = 0.0 if k == 7 else 100.0 * k
        made = Estimate(keys, values, sizes, np.eye(5), 1.0, 1.0)
        cycle = Cycle(f"c{k}", 4500.0, start, 20.0, made, f"{k:064x}", f"c{k}.csv", 9.0, ("a note",))
        store.add(k, cycle, judge.add(cycle))
    diagnosis = {"verdict": "named", "effects": [], "sentence": "It is so.", "repeats": 0}
    store.say(judge.alarms[0].cycle, Said(diagnosis=diagnosis))
    store.refuse("0", "x.csv", "x.csv: is no log")
    store.write_copies()
    store.close()
    with contextlib.closing(sqlite3.connect(folder / FILE)) as db:  # so that its bytes alone are all of it
        db.execute("PRAGMA journal_mode=DELETE")


@cache
def finished_state() -> Path:
    """Made once in a process and taken away at its end."""
    base = Path(tempfile.mkdtemp(prefix="attack-state-"))
    atexit.register(shutil.rmtree, base, ignore_errors=True)
    make_state(base / "state")
    put(base / "logs", short_runs(1)[0])
    return base


@cache
def good(kind: str) -> bytes:
    return SIDECAR if kind == "sidecar" else (finished_state() / "state" / KINDS[kind]).read_bytes()


def changed_rows(content: bytes, chance: random.Random) -> bytes:
    """A sound SQLite file whose rows, columns or tables no watch has written."""
    with contextlib.closing(sqlite3.connect(":memory:")) as db:
        db.deserialize(content)
        for _ in range(chance.choice([1, 1, 3])):
            table = chance.choice(["cycles", "cycles", "alarms", "alarms", "events", "refused", "settings"])
            columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            if not columns:
                continue
            column, row = (
                chance.choice(columns),
                f"rowid = (SELECT rowid FROM {table} LIMIT 1 OFFSET {chance.randrange(9)})",
            )
            way = chance.choice(["value", "value", "value", "json", "delete", "drop", "column", "index"])
            with contextlib.suppress(sqlite3.Error, OverflowError, TypeError, ValueError):
                if way == "value":
                    db.execute(f"UPDATE {table} SET {column} = ? WHERE {row}", (chance.choice(_ODD),))
                elif way == "json":
                    (text,) = db.execute(f"SELECT {column} FROM {table} WHERE {row}").fetchone()
                    db.execute(f"UPDATE {table} SET {column} = ? WHERE {row}", (_odd_json(text, chance),))
                elif way == "delete":
                    db.execute(f"DELETE FROM {table} WHERE {chance.choice([row, '1'])}")
                elif way == "drop":
                    db.execute(f"DROP TABLE {table}")
                elif way == "column":
                    db.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO other")
                else:
                    db.execute(f"ALTER TABLE {table} RENAME TO other_{table}")
        db.commit()
        return db.serialize()


def _odd_json(text: object, chance: random.Random) -> str:
    """A document with one value of another kind."""
    data = json.loads(str(text))
    if isinstance(data, dict) and data:
        data[chance.choice(sorted(data))] = chance.choice([None, 1, "x", [], {}, [[1.0]], [1e308] * 5])
    elif isinstance(data, list):
        data = chance.choice([[], [{}], [1], {"a": 1}, [{"name": 1}]])
    return json.dumps(data)


def read(kind: str, content: bytes, folder: Path) -> tuple[str, str]:
    """How a watch takes it: read, refused or unsound; and what is said."""
    state, logs = folder / "state", folder / "logs"
    said: list[str] = []
    if kind == "sidecar":
        put(logs, short_runs(2)[0])
        odd = put(logs, short_runs(2)[1])
        odd.with_name(f"{odd.name}.yaml").write_bytes(content)
        count = _looked(logs, state, said)
        refused = [line for line in said if line.startswith("not counted")]
        return ("refused" if refused else "read") if count + len(refused) == 2 else "unsound", "; ".join(refused)
    shutil.copytree(finished_state() / "state", state)
    shutil.copytree(finished_state() / "logs", logs)
    (state / KINDS[kind]).write_bytes(content)
    if kind == "copies":
        rebuild(state, HOIST, RULES)
        _looked(logs, state, said)
        return "read", ""
    try:
        _looked(logs, state, said)
        return "read", ""
    except DamagedError as error:
        rebuild(state, HOIST, RULES)
        again = Store(state, HOIST, RULES)
        whole = Store(finished_state() / "state", HOIST, RULES, wait_s=5.0)
        known, cycles = whole.said(), whole.cycles()  # it may have gone on by a cycle before it met the damage
        same = {at: again.said().get(at) for at in known} == known
        same = same and [c.digest for c in again.cycles()][: len(cycles)] == [c.digest for c in cycles]
        again.close()
        whole.close()
        if not same or _looked(logs, state, said) != CYCLES + 1:
            return "unsound", f"not what it was: {error}"
        raise InputError(error.problem, file=error.file) from error


def _looked(logs: Path, state: Path, said: list[str]) -> int:
    """How many cycles there are after one look, with the page."""
    watch = Watch(logs, HOIST, state, RULES, settle_s=0.0, say=said.append)
    try:
        watch.look(0.0)
        write_page(watch, state / "watch.html")
        return len(watch.store.cycles())
    finally:
        watch.close()
