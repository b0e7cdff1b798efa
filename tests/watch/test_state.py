"""The state of a watch under what a plant does to it: wrong side files, a full disk, two at once, damaged files."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.attack.watch_states import HOIST, RULES, make_state, put, short_runs
from tests.support.commands import Commands
from workbench.core.errors import InputError
from workbench.machines import save_machine
from workbench.watch.store import Store
from workbench.watch.watch import Watch

OPTIONS = "--settle", "0.02", "--healthy", str(RULES.healthy), "--skip-diagnosis"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A state of 60 cycles with an alarm, and its machine."""
    place = tmp_path_factory.mktemp("made")
    save_machine(HOIST, place / "machine.yaml")
    make_state(place / "state")
    return place


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "place")
    (tmp_path / "place" / "logs").mkdir()
    return tmp_path / "place"


def words(place: Path, *more: object) -> list[object]:
    return ["watch", place / "logs", "--machine", place / "machine.yaml", "--state", place / "state", *OPTIONS, *more]


def dump(place: Path) -> list[str]:
    with contextlib.closing(sqlite3.connect(place / "state" / "watch.sqlite")) as db:
        return sorted(line for line in db.iterdump() if line.startswith("INSERT"))


def one_line(err: str) -> str:
    assert len(err.strip().splitlines()) == 1 and "Traceback" not in err, err
    return err


# A file beside a log.


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ('name: "a/b"\npayload_kg: 0\nstart_position_m: 9\n', "name"),
        ("payload_kg: 0\n", "needs start_position_m"),
        ("{", "expected"),
    ],
)
def test_a_log_with_a_wrong_file_beside_it_is_set_aside_and_the_watch_goes_on(said, reason, place, commands):
    first, second = (put(place / "logs", run) for run in short_runs(2))
    beside = first.with_name(f"{first.name}.yaml")
    right = beside.read_text()
    beside.write_text(said)
    done = commands(*words(place, "--once"))
    assert done.status == 1  # the alarm that make_state left, and that no call has told of
    assert f"not counted: {beside}" in done.err and reason in done.err and "Traceback" not in done.err
    names = [name for (name,) in sqlite3.connect(place / "state" / "watch.sqlite").execute("SELECT name FROM cycles")]
    assert second.stem in names and first.stem not in names
    again = commands(*words(place, "--once"))
    assert again.status == 0 and "not counted" not in again.err  # it was said once
    beside.write_text(right)
    assert commands(*words(place, "--once")).status == 0
    names = [name for (name,) in sqlite3.connect(place / "state" / "watch.sqlite").execute("SELECT name FROM cycles")]
    assert first.stem in names


# A full disk: a limit on the size of files stands for it, which the system keeps to as to the end of a disk.


@contextlib.contextmanager
def file_sizes_up_to(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def counted(state: Path) -> int:
    """Cycles that a state holds; 0 where it is none yet."""
    try:
        with contextlib.closing(sqlite3.connect(f"file:{state / 'watch.sqlite'}?mode=ro", uri=True)) as db:
            return int(db.execute("SELECT COUNT(*) FROM cycles").fetchone()[0])
    except sqlite3.Error:
        return 0


def test_on_a_full_disk_one_call_says_one_line_and_the_next_goes_on(place: Path, commands: Commands):
    first, second = short_runs(2)
    put(place / "logs", first)
    assert commands(*words(place, "--once")).status == 1
    put(place / "logs", second)
    with file_sizes_up_to(4096):
        done = commands(*words(place, "--once"))
    assert done.status == 2 and "cannot be written" in done.err and "rollback" not in done.err.lower()
    assert "Traceback" not in done.err
    assert counted(place / "state") == 61
    assert commands(*words(place, "--once")).status == 0
    assert counted(place / "state") == 62


# Two at once.


def test_a_second_call_waits_for_the_first_and_neither_counts_a_cycle_twice(place: Path):
    for run in short_runs(6):
        put(place / "logs", run)
    line = [sys.executable, "-m", "workbench", *map(str, words(place, "--once"))]
    both = [subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    errors = [process.communicate(timeout=300)[1] for process in both]
    assert sorted(process.returncode for process in both) == [0, 1]  # one of them tells of the alarm
    assert counted(place / "state") == 66 and "Traceback" not in "".join(errors)


def test_a_second_watch_is_told_of_the_first(place: Path):
    said: list[str] = []
    first = Watch(place / "logs", HOIST, place / "state", RULES)
    with pytest.raises(InputError, match="another watch works on this state"):
        Watch(place / "logs", HOIST, place / "state", RULES, say=said.append, wait_s=0.2)
    first.close()
    Watch(place / "logs", HOIST, place / "state", RULES).close()
    assert len(said) == 1 and "waiting for it" in said[0]


# Damage.


def damage_a_page(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[4096:20480] = b"\x7f" * 16384
    file.write_bytes(bytes(content))


def damage_a_row(file: Path) -> None:
    with contextlib.closing(sqlite3.connect(file)) as db, db:
        db.execute("UPDATE cycles SET estimate = '{}' WHERE number = 30")


def lose_a_cycle(file: Path) -> None:
    with contextlib.closing(sqlite3.connect(file)) as db, db:
        db.execute("DELETE FROM cycles WHERE number = 30")


def lose_the_alarms(file: Path) -> None:
    with contextlib.closing(sqlite3.connect(file)) as db, db:
        db.execute("DELETE FROM alarms")


@pytest.mark.parametrize(
    "damage",
    [damage_a_page, damage_a_row, lose_a_cycle, lose_the_alarms, lambda file: file.write_bytes(b"no store" * 99)],
)
def test_a_damaged_store_is_one_line_and_is_rebuilt_as_it_was(damage, place, commands):
    file, whole = place / "state" / "watch.sqlite", dump(place)
    damage(file)
    done = commands(*words(place, "--once"))
    assert done.status == 2
    assert (
        "watch.sqlite: is damaged" in one_line(done.err) and "--rebuild makes it anew from cycles.parquet" in done.err
    )
    rebuilt = commands(*words(place, "--once", "--rebuild"))
    assert rebuilt.status == 1, rebuilt.err  # the alarm that no call had told of
    kept = [line for line in whole if "refused" not in line]  # logs that were refused are looked at again
    assert [line.replace(",0,1);", ",0,0);") for line in dump(place)] == kept
    assert (place / "state" / "watch.sqlite.damaged").is_file()
    assert commands(*words(place, "--once")).status == 0


def test_what_cannot_be_rebuilt_is_one_line(place: Path, commands: Commands):
    (place / "state" / "watch.sqlite").write_bytes(b"no store" * 99)
    (place / "state" / "cycles.parquet").write_bytes(b"no copy")
    done = commands(*words(place, "--once", "--rebuild"))
    assert done.status == 2 and "cycles.parquet: is damaged too" in one_line(done.err)
    (place / "state" / "cycles.parquet").unlink()
    done = commands(*words(place, "--once"))
    assert done.status == 2 and "there is no cycles.parquet to rebuild it from" in one_line(done.err)
    other = commands(*words(place, "--once", "--healthy", 30))
    assert other.status == 2


@pytest.mark.skipif(os.name != "posix", reason="allowed: pipes of POSIX")
def test_a_pipe_in_the_place_of_the_state_is_refused_and_not_waited_for(tmp_path: Path):
    (tmp_path / "state").mkdir()
    os.mkfifo(tmp_path / "state" / "watch.sqlite")
    with pytest.raises(InputError, match="is not a regular file"):
        Store(tmp_path / "state", HOIST, RULES)
