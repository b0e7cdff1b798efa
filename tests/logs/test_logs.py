"""Campaigns are read whole and runs.yaml strictly; a log format is declared once and parsed apart."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io

from tests.support import log_openers
from tests.support.log_campaign import AXIS, RUNS, axis_columns, csv_text, hoist_columns, write_campaign
from tests.support.made_pages import made_pages
from workbench.core.errors import InputError
from workbench.logs import read_campaign
from workbench.logs.formats import opening
from workbench.logs.formats.declared import Limits, LogFormat, Opened
from workbench.logs.formats.opening import landlock_version, open_log
from workbench.machines import Hoist, LinearAxis

EMPS_RUNS = """\
columns:
  time_s: t
  force_n: {{column: vir, scale: 35.1507}}
  position_m: qm
  position_reference_m: qg
runs:
- {{name: train, file: {0}/DATA_EMPS.mat}}
- {{name: test, file: {0}/DATA_EMPS_PULSES.mat}}
"""


def refusal(folder: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        read_campaign(folder, **options)  # type: ignore[arg-type]
    return str(caught.value)


def test_every_recorded_campaign_reads_whole_and_without_repair(campaigns):
    folders = sorted(path.parent for path in campaigns.glob("*/runs.yaml"))
    assert len(folders) >= 33
    for folder in folders:
        campaign = read_campaign(folder)
        assert isinstance(campaign.machine, Hoist)
        assert campaign.name == folder.name
        assert len(campaign.runs) == 6
        assert campaign.all_notes == (), f"{folder.name}: these logs have no fault"
        for run in campaign.runs:
            assert run.duration_s == pytest.approx(49.75, abs=0.02)
            assert run.sample_time_s == pytest.approx(0.01)
            both = run["torque_motor1_nm"] + run["torque_motor2_nm"]
            assert np.array_equal(run["torque_motor_nm"], both)


def test_real_axis_in_matlab_files_reads_with_scaled_force(shared_data, tmp_path):
    emps = os.path.relpath(shared_data / "emps", tmp_path)
    (tmp_path / "machine.yaml").write_text(AXIS)
    (tmp_path / "runs.yaml").write_text(EMPS_RUNS.format(emps))
    campaign = read_campaign(tmp_path)
    assert isinstance(campaign.machine, LinearAxis)
    raw = scipy.io.loadmat(str(shared_data / "emps" / "DATA_EMPS.mat"))
    train = campaign.run("train")
    assert train.time_s.shape == (24841,)
    assert np.array_equal(train["force_n"], 35.1507 * raw["vir"].ravel())
    assert np.array_equal(train["position_m"], raw["qm"].ravel())
    assert train.start_position_m == raw["qm"][0, 0]
    assert "position_reference_m" in campaign.run("test")
    assert any("ignored columns in test: pulses_N" in note for note in campaign.notes)


def test_parquet_and_matlab_give_the_very_same_run_as_csv(tmp_path):
    columns = hoist_columns()
    write_campaign(tmp_path, columns)
    pa.parquet.write_table(pa.table(columns), tmp_path / "runs" / "lift.parquet")
    scipy.io.savemat(tmp_path / "runs" / "lift.mat", columns)
    plain = read_campaign(tmp_path).runs[0]
    for suffix in ("parquet", "mat"):
        (tmp_path / "runs.yaml").write_text(RUNS.replace("lift.csv", f"lift.{suffix}"))
        run = read_campaign(tmp_path).runs[0]
        assert np.array_equal(run.time_s, plain.time_s)
        assert run.signals.keys() == plain.signals.keys()
        assert all(np.array_equal(run[name], plain[name]) for name in plain.signals)


def test_columns_map_with_scale_and_offset(tmp_path):
    columns = hoist_columns()
    columns["n rpm"] = columns.pop("speed_motor_rad_s") * 60 / (2 * np.pi) + 3.0
    mapping = (
        "columns:\n  speed_motor_rad_s: {column: n rpm, scale: 0.10471975511965977, offset: -0.31415926535897931}\n"
    )
    run = read_campaign(write_campaign(tmp_path, columns, runs=mapping + RUNS)).runs[0]
    assert np.allclose(run["speed_motor_rad_s"], hoist_columns()["speed_motor_rad_s"], atol=1e-12)
    assert run.notes == ()


def test_logged_sum_gives_way_to_both_motors_and_that_is_said(tmp_path):
    columns = hoist_columns()
    run = read_campaign(write_campaign(tmp_path, columns | {"torque_motor_nm": columns["time_s"]})).runs[0]
    assert np.array_equal(run["torque_motor_nm"], columns["torque_motor1_nm"] + columns["torque_motor2_nm"])
    assert run.notes == ("torque_motor_nm is not used: both motors are logged for themselves",)


def test_axis_without_position_and_velocity_is_refused(tmp_path):
    columns = axis_columns()
    del columns["position_m"]
    runs = "runs:\n- {name: lift, file: runs/lift.csv}\n"
    write_campaign(tmp_path, columns, runs=runs, machine=AXIS)
    assert "lift: no column position_m or velocity_m_s; did you mean 'position_reference_m'?" in refusal(tmp_path)


def two_runs(folder: Path, **changes: str) -> str:
    second = {"name": "back", "file": "runs/back.csv"} | changes
    (folder / "runs" / "back.csv").write_text(csv_text(hoist_columns(400)))
    return RUNS + (
        f"- {{name: {second['name']}, file: {second['file']}, payload_kg: 0.0, start_position_m: 9.0, "
        "start_time_s: 60.0}\n"
    )


def test_selected_runs_are_read_and_the_others_not_even_opened(tmp_path):
    write_campaign(tmp_path, hoist_columns())
    (tmp_path / "runs.yaml").write_text(two_runs(tmp_path, file="runs/gone.csv"))
    assert [run.name for run in read_campaign(tmp_path, select="lift").runs] == ["lift"]
    assert [run.name for run in read_campaign(tmp_path, select=["lift"]).runs] == ["lift"]
    assert "no run 'lft'; did you mean 'lift'?" in refusal(tmp_path, select="lft")


def test_copied_log_is_pointed_out(tmp_path):
    write_campaign(tmp_path, hoist_columns())
    (tmp_path / "runs.yaml").write_text(two_runs(tmp_path))
    (tmp_path / "runs" / "back.csv").write_text(csv_text(hoist_columns()))
    assert read_campaign(tmp_path).notes == ("runs 'lift' and 'back' hold the same samples",)


RUNS_MISTAKES = {
    ("payload_kg: 4500.0, ", ""): "runs.yaml:2: runs[0].payload_kg: run 'lift' needs payload_kg",
    ("payload_kg: 4500.0", "payload_kg: -1"): "runs[0].payload_kg: -1, expected a number of at least 0",
    ("payload_kg: 4500.0", "payload_kg: .inf"): "runs[0].payload_kg: inf, expected a finite number",
    ("position_m: 9.0", "position_m: 30"): "30.0 m, expected a height from 0 to 25.0 m, where the dead anchor is",
    ("name: lift", "name: 7"): "runs[0].name: 7, expected text; put it in quotes",
    ("name: lift", "name: ../lift"): "runs[0].name",
    ("runs/lift.csv", "runs/left.csv"): "runs.yaml:2: lift: runs/left.csv: no such file; did you mean 'lift.csv'?",
    ("runs/lift.csv", "runs"): "lift: runs: is a folder; expected a file",
    ("runs/lift.csv", "machine.yaml"): "a file that ends in '.yaml' is not read by this version",
    ("runs/lift.csv", '"a\\0b.csv"'): "runs.yaml:2: lift:",
    (RUNS, "runs: []\n"): "runs",
    (RUNS, RUNS + RUNS.partition("\n")[2]): "runs.yaml:3: runs[1].name: 'lift' is used twice; it names",
    ("runs:\n", "format: 3\nruns:\n"): "runs.yaml:1: format: 3, expected 1",
    ("runs:\n", "columns: {torque_motor: T}\nruns:\n"): "columns.torque_motor: unknown signal 'torque_motor'; did",
    ("runs:\n", "columns: {time_s: {column: t, scale: 0.0}}\nruns:\n"): "columns.time_s.scale: 0.0, expected a number",
    ("runs:\n", "columns: {time_s: tme_s}\nruns:\n"): "lift: no column 'tme_s' for time_s; did you mean 'time_s'?",
}  # fmt: skip


@pytest.mark.parametrize(("old", "new"), RUNS_MISTAKES)
def test_mistake_in_the_list_of_runs_is_named_by_place(tmp_path, old, new):
    write_campaign(tmp_path, hoist_columns(), runs=RUNS.replace(old, new, 1))
    assert RUNS_MISTAKES[old, new] in refusal(tmp_path)


def test_missing_campaign_gets_the_nearest_name(tmp_path):
    write_campaign(tmp_path / "spring", hoist_columns())
    assert "no such campaign; did you mean 'spring'?" in refusal(tmp_path / "sprin")
    for k in range(60):
        (tmp_path / f"{k:02d}").mkdir()
    assert len(refusal(tmp_path / "none").removeprefix(str(tmp_path))) < 100
    assert "is a machine; expected a campaign's folder" in refusal(tmp_path / "spring" / "machine.yaml")
    (tmp_path / "spring" / "runs.yaml").unlink()
    assert "runs.yaml: no such file; its folder holds machine.yaml, runs" in refusal(tmp_path / "spring")


def test_another_file_with_the_same_ending_is_no_misspelt_one(tmp_path):
    folder = write_campaign(tmp_path / "spring", hoist_columns())
    (folder / "machine.yaml").rename(folder / "axis.yaml")
    assert "machine.yaml: no such file; its folder holds axis.yaml, runs, runs.yaml" in refusal(folder)
    (folder / "axis.yaml").rename(folder / "machin.yaml")
    assert "did you mean 'machin.yaml'?" in refusal(folder)


def test_confined_campaign_may_not_reach_outside_its_folder(tmp_path):
    write_campaign(tmp_path / "other", hoist_columns())
    outside = RUNS.replace("runs/lift.csv", "../other/runs/lift.csv")
    folder = write_campaign(tmp_path / "mine", hoist_columns(), runs=outside)
    assert read_campaign(folder).runs
    assert "lies outside the campaign's folder" in refusal(folder, confined=True)
    (folder / "runs" / "link.csv").symlink_to(tmp_path / "other" / "runs" / "lift.csv")
    (folder / "runs.yaml").write_text(RUNS.replace("lift.csv", "link.csv"))
    assert "lies outside the campaign's folder" in refusal(folder, confined=True)
    (folder / "runs.yaml").write_text(RUNS)
    assert read_campaign(folder, confined=True).runs


# An axis' log in another unit is refused with the factor that would fit.


MACHINE = """\
kind: axis
motion: linear
mass_kg: 95.0
friction: {coulomb_forward_n: 20.0, coulomb_backward_n: 20.0, viscous_n_s_per_m: 200.0}
drive: {top_speed_m_s: 0.5, force_limit_n: 400.0}
"""
STEP_S = 0.001


def campaign(folder: Path, scales: dict[str, float], logged: tuple[str, ...], machine: str = MACHINE) -> Path:
    """A second's moves there and back, as an axis of this machine logs them, each signal times a scale."""
    chance = np.random.default_rng(3)
    time_s = np.arange(0.0, 6.0, STEP_S)
    position = 0.05 * (1.0 - np.cos(2.0 * np.pi * time_s / 1.5))
    velocity = np.gradient(position, STEP_S)
    force = 95.0 * np.gradient(velocity, STEP_S) + 200.0 * velocity + 20.0 * np.tanh(velocity / 1e-3)
    signals = {"position_m": position + chance.normal(0.0, 1e-6, len(time_s)), "velocity_m_s": velocity}
    signals["force_n"] = force + chance.normal(0.0, 1.0, len(time_s))
    columns = {"time_s": time_s, **{name: scales.get(name, 1.0) * signals[name] for name in (*logged, "force_n")}}
    rows = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    (folder / "move.csv").write_text("\n".join(rows) + "\n")
    (folder / "machine.yaml").write_text(machine)
    (folder / "runs.yaml").write_text("runs: [{name: move, file: move.csv}]\n")
    return folder


BOTH = ("position_m", "velocity_m_s")


@pytest.mark.parametrize("logged", [BOTH, BOTH[:1], BOTH[1:]])
def test_an_axis_in_si_is_read(tmp_path: Path, logged: tuple[str, ...]):
    read = read_campaign(campaign(tmp_path, {}, logged))
    (run,) = read.runs
    assert read.all_notes == () and set(logged) <= run.signals.keys() and run.payload_kg == 0.0
    assert run.start_position_m == (run["position_m"][0] if "position_m" in logged else 0.0)


def test_without_a_stated_drive_the_input_still_tells_millimetres(tmp_path: Path):
    plain = MACHINE.replace("drive: {top_speed_m_s: 0.5, force_limit_n: 400.0}\n", "")
    assert not read_campaign(campaign(tmp_path, {}, BOTH[:1], plain)).all_notes
    with pytest.raises(InputError, match=r"a scale of 0\.001 \(milli\) would fit for position_m"):
        read_campaign(campaign(tmp_path, {"position_m": 1e3}, BOTH[:1], plain))


@pytest.mark.parametrize(
    ("signal", "unit", "wrong", "logged"),
    [(*one, logged) for logged in (BOTH, BOTH[:1], BOTH[1:]) for one in (
        ("position_m", "mm", 1e3), ("position_m", "cm", 1e2), ("velocity_m_s", "mm/s", 1e3),
        ("velocity_m_s", "cm/s", 1e2), ("velocity_m_s", "m/min", 60.0), ("velocity_m_s", "mm/min", 6e4),
        ("force_n", "kN", 1e-3), ("force_n", "mN", 1e3),
    ) if one[0] in (*logged, "force_n")],
)  # fmt: skip
def test_a_scale_that_would_fit_makes_the_log_readable_and_the_right_one_is_offered(
    tmp_path: Path, signal: str, unit: str, wrong: float, logged: tuple[str, ...]
):
    """The refutation of the advice: it is followed, one offer after the other."""
    folder = campaign(tmp_path, {signal: wrong}, logged)
    with pytest.raises(InputError) as refused:
        read_campaign(folder)
    offers = re.findall(r"a scale of ([^,;]+) would fit(?: for (\w+))?", str(refused.value))
    right = False
    for scale, named in [(scale.split()[0], named) for scales, named in offers for scale in scales.split(" or ")]:
        column = named or re.findall(r"move: (\w+)", str(refused.value))[0]
        text = f"columns: {{{column}: {{column: {column}, scale: {scale}}}}}\nruns: [{{name: move, file: move.csv}}]\n"
        (folder / "runs.yaml").write_text(text)
        if column == signal and float(scale) == pytest.approx(1.0 / wrong, rel=1e-4):
            right = True
            assert read_campaign(folder).all_notes == (), unit
    assert right, refused.value


# A log format is declared once, and parsed where a damaged file can do no harm.


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


def refused_by(folder: Path, add: Callable[..., LogFormat], opener: Callable[[Path], Opened], **more: object) -> str:
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
    assert refused_by(tmp_path, add, opener) == "is damaged: it crashes the reader of its format (SIGSEGV)"


def test_a_parser_that_takes_too_much_processor_time_is_ended(tmp_path, add):
    assert refused_by(tmp_path, add, log_openers.spin) == "takes more than 1 s to read; is it damaged?"


@pytest.mark.skipif(not landlock_version(), reason="allowed: this kernel has no Landlock")
@pytest.mark.parametrize("opener", [log_openers.look_around, log_openers.call_home])
def test_a_parser_can_open_nothing_but_its_file(tmp_path, add, opener):
    assert refused_by(tmp_path, add, opener) == "nothing else can be opened"


@pytest.mark.skipif(sys.platform != "linux", reason="allowed: only Linux limits a process's memory")
def test_a_parser_that_takes_too_much_memory_is_ended(tmp_path, add):
    said = refused_by(tmp_path, add, log_openers.devour)
    assert said == "takes more than the 300 MB of memory that a log may; is it damaged?"


def test_what_is_produced_without_end_is_stopped_where_it_grows(tmp_path, add):
    assert refused_by(tmp_path, add, log_openers.pour).startswith("holds more than 10000 rows")
    said = refused_by(tmp_path, add, log_openers.pour, own=replace(SMALL, rows=10**9))
    assert said.startswith("unpacks to more than 1 MB")


def test_whatever_a_parser_raises_is_one_printable_line(tmp_path, add):
    assert refused_by(tmp_path, add, log_openers.stumble).startswith("is not a readable made-up file: ")
    assert refused_by(tmp_path, add, log_openers.leave) == "is damaged: it crashes the reader of its format (status 1)"


def test_what_a_parser_prints_is_not_taken_for_an_answer(tmp_path, add):
    assert refused_by(tmp_path, add, log_openers.chatter) == "says too much"


def test_columns_of_unequal_length_are_refused_whatever_the_format(tmp_path, add):
    said = refused_by(tmp_path, add, log_openers.uneven)
    assert said.startswith("its columns differ in length: time_s 100, torque_motor1_nm 101")


def test_a_worker_reads_on_after_an_error_and_is_made_anew_after_a_crash(tmp_path, add):
    good = tmp_path / "good.mat"
    scipy.io.savemat(good, hoist_columns())
    for opener in (log_openers.stumble, log_openers.crash):
        refused_by(tmp_path, add, opener)
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
        assert refused_by(tmp_path, add, log_openers.ignored_interrupt) == "SIGINT is heard"
    finally:
        signal.signal(signal.SIGINT, old)
        opening.end_all()
