"""A log format is declared once, and parsed where a damaged file can do no harm."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
import scipy.io

from tests.support import log_openers
from tests.support.log_campaign import RUNS, hoist_columns, write_campaign
from tests.support.made_pages import made_pages
from workbench.core.errors import InputError
from workbench.logs import read_campaign
from workbench.logs.formats import opening
from workbench.logs.formats.declared import Limits, LogFormat, Opened
from workbench.logs.formats.opening import landlock_version, open_log

ROOT = Path(__file__).resolve().parents[2]
SMALL = Limits(rows=10_000, bytes=1_000_000, seconds=1.0, memory_bytes=300_000_000)


@pytest.fixture
def add(monkeypatch: pytest.MonkeyPatch) -> Callable[..., LogFormat]:
    def added(opener: Callable[[Path], Opened], **more: object) -> LogFormat:
        made = LogFormat("made-up", (".made",), opener, about="arrays that numpy has saved.", own=SMALL, uploaded=SMALL)
        made = replace(made, imports=("zipfile",))  # np.load's
        made = replace(made, **more)  # type: ignore[arg-type]
        monkeypatch.setattr(
            "workbench.logs.formats.opening.FORMATS",
            [*(log_format for log_format in opening.FORMATS if log_format.name != made.name), made],
        )
        return made

    return added


def refusal(folder: Path, add: Callable[..., LogFormat], opener: Callable[[Path], Opened], **more: object) -> str:
    """What is said of a log whose parser is `opener`, in one line that names the file."""
    add(opener, **more)
    file = folder / "lift.made"
    file.write_bytes(b"something")
    with pytest.raises(InputError) as caught, open_log(file) as log:
        log.read(log.names)
    said = str(caught.value)
    assert said.startswith(f"{file}: ")
    assert said.isprintable()
    return said.removeprefix(f"{file}: ")


# Declared once


def test_a_new_format_is_seen_by_reader_uploads_errors_help_and_docs(tmp_path, add, monkeypatch):
    add(log_openers.open_npz)
    columns = hoist_columns()
    folder = write_campaign(tmp_path, columns, runs=RUNS.replace("lift.csv", "lift.made"))
    with (folder / "runs" / "lift.made").open("wb") as stream:
        np.savez(stream, **columns)  # type: ignore[arg-type]
    assert np.array_equal(read_campaign(folder).runs[0]["torque_motor1_nm"], columns["torque_motor1_nm"])

    (folder / "runs.yaml").write_text(RUNS.replace("lift.csv", "lift.odd"))
    (folder / "runs" / "lift.odd").touch()
    with pytest.raises(InputError, match=r"save the log as \.csv, \.mat, \.mf4, \.parquet, \.xml, \.tdms or \.made"):
        read_campaign(folder)

    assert "- **made-up** (`.made`): arrays that numpy has saved." in made_pages().log_formats_page()
    for name in ("workbench.dashboard.chosen", "workbench.cli.options", "workbench.cli.measured"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    from workbench.cli.measured import replay as command
    from workbench.dashboard.chosen import TYPES

    assert "made" in TYPES
    assert ".tdms or .made" in " ".join(command.get_help(click.Context(command)).split())


# Parsed apart


@pytest.mark.parametrize("opener", [log_openers.crash, log_openers.crash_midway])
def test_a_crash_of_the_parser_is_one_error(tmp_path, add, opener):
    assert refusal(tmp_path, add, opener) == "is damaged: it crashes the reader of its format (SIGSEGV)"


def test_a_parser_that_takes_too_much_processor_time_is_ended(tmp_path, add):
    assert refusal(tmp_path, add, log_openers.spin) == "takes more than 1 s to read; is it damaged?"


@pytest.mark.skipif(not landlock_version(), reason="allowed: this kernel has no Landlock")
@pytest.mark.parametrize("opener", [log_openers.look_around, log_openers.call_home])
def test_a_parser_can_open_nothing_but_its_file(tmp_path, add, opener):
    assert refusal(tmp_path, add, opener) == "nothing else can be opened"


@pytest.mark.skipif(sys.platform != "linux", reason="allowed: only Linux limits a process's memory")
def test_a_parser_that_takes_too_much_memory_is_ended(tmp_path, add):
    said = refusal(tmp_path, add, log_openers.devour)
    assert said == "takes more than the 300 MB of memory that a log may; is it damaged?"


def test_what_is_produced_without_end_is_stopped_where_it_grows(tmp_path, add):
    assert refusal(tmp_path, add, log_openers.pour).startswith("holds more than 10000 rows")
    said = refusal(tmp_path, add, log_openers.pour, own=replace(SMALL, rows=10**9))
    assert said.startswith("unpacks to more than 1 MB")


def test_whatever_a_parser_raises_is_one_printable_line(tmp_path, add):
    assert refusal(tmp_path, add, log_openers.stumble).startswith("is not a readable made-up file: ")
    assert refusal(tmp_path, add, log_openers.leave) == "is damaged: it crashes the reader of its format (status 1)"


def test_what_a_parser_prints_is_not_taken_for_an_answer(tmp_path, add):
    assert refusal(tmp_path, add, log_openers.chatter) == "says too much"


def test_columns_of_unequal_length_are_refused_whatever_the_format(tmp_path, add):
    said = refusal(tmp_path, add, log_openers.uneven)
    assert said.startswith("its columns differ in length: time_s 100, torque_motor1_nm 101")


def test_a_worker_reads_on_after_an_error_and_is_made_anew_after_a_crash(tmp_path, add):
    good = tmp_path / "good.mat"
    scipy.io.savemat(good, hoist_columns())
    for opener in (log_openers.stumble, log_openers.crash):
        refusal(tmp_path, add, opener)
        with open_log(good) as log:
            assert len(log.read(["time_s"])["time_s"]) == 500


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.skipif(os.name != "posix", reason="allowed: signals of POSIX")
def test_ctrl_c_ends_the_reader_and_its_worker(tmp_path):
    (tmp_path / "lift.made").write_bytes(b"x")
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pathlib import Path\n"
        "from tests.support import log_openers\n"
        "from workbench.logs.formats import opening\n"
        "from workbench.logs.formats.declared import LogFormat\n"
        "from workbench.logs.formats.opening import open_log\n"
        "opening.FORMATS.append(LogFormat('made-up', ('.made',), log_openers.sleep, about=''))\n"
        "one = opening._taken(); one.close(); print(one.process.pid, flush=True)\n"
        "with open_log(Path(sys.argv[1])): pass\n"
    )
    reader = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "lift.made")],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert reader.stdout is not None
    worker = int(reader.stdout.readline())
    time.sleep(0.3)
    reader.send_signal(signal.SIGINT)
    assert reader.wait(timeout=20.0) in (1, 130, -signal.SIGINT)
    until = time.monotonic() + 5.0
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)


def test_a_worker_hears_an_interrupt_though_its_shell_ignores_it(tmp_path, add):
    opening.end_all()
    old = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert refusal(tmp_path, add, log_openers.ignored_interrupt) == "SIGINT is heard"
    finally:
        signal.signal(signal.SIGINT, old)
        opening.end_all()
