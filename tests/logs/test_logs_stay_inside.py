"""No file of the server leaves it through a log; mangled campaigns give sound runs or one clear error."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from asammdf import MDF, Signal
from hypothesis import given
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter

from benchmarks.attack.mangle import finished_result
from tests.support.log_campaign import AXIS, RUNS, axis_columns, csv_text, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.core.input_file import MOST_BYTES, open_input, readable_file
from workbench.core.whole_folder import whole_folder
from workbench.logs import read_campaign
from workbench.logs.formats.opening import open_log
from workbench.machines import default_hoist, machine_text
from workbench.study.rows import read_table

SECRET = "root:x:0:0:the whole of a file of the server" * 20


def stored_outside(held: Any, secret: Path) -> None:
    held.create_dataset("torque_motor1_nm", (1, 500), dtype="u1", external=[(str(secret), 0, 500)])


def virtual(held: Any, secret: Path) -> None:
    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["x"] = np.arange(500.0).reshape(1, -1)
    layout = h5py.VirtualLayout((1, 500), dtype="f8")
    layout[...] = h5py.VirtualSource(str(secret.with_suffix(".h5")), "x", shape=(1, 500))
    held.create_virtual_dataset("torque_motor1_nm", layout)


def external_link(held: Any, secret: Path) -> None:
    held["torque_motor1_nm"] = h5py.ExternalLink(str(secret), "x")


def soft_link(held: Any, secret: Path) -> None:
    held["torque_motor1_nm"] = h5py.SoftLink("/time_s")


@pytest.mark.parametrize("uploaded", [False, True])
@pytest.mark.parametrize(
    ("way", "why"),
    [
        (stored_outside, "keeps its samples in another file"),
        (virtual, "is put together of other data sets"),
        (external_link, "is a link to another place or file"),
        (soft_link, "is a link to another place or file"),
    ],
)
def test_a_data_set_that_lies_elsewhere_is_refused_by_name(tmp_path, way, why, uploaded):
    secret = tmp_path / "secret"
    secret.write_text(SECRET)
    folder = write_campaign(tmp_path / "campaign", "", runs=RUNS.replace("lift.csv", "lift.mat"))
    with h5py.File(folder / "runs" / "lift.mat", "w") as held:
        for name, column in hoist_columns().items():
            if name != "torque_motor1_nm":
                held[name] = column.reshape(1, -1)
        way(held, secret)
    with pytest.raises(InputError) as caught:
        read_campaign(folder, uploaded=uploaded)
    assert f"lift.mat: lift: torque_motor1_nm: {why}; expected samples in the file itself" in str(caught.value)


def test_a_formula_of_an_mdf_channel_runs_nothing(tmp_path: Path):
    made = tmp_path / "made"
    for formula, refused in ((f"__import__('pathlib').Path('{made}').touch()", True), ("2*X1 + sqrt(X1)", False)):
        file = tmp_path / "lift.mf4"
        mdf = MDF(version="4.10")
        counts = np.arange(100, dtype=np.uint16)
        mdf.append([Signal(counts, np.arange(100) * 0.01, name="torque", conversion={"formula": formula})])
        mdf.save(file, overwrite=True)
        mdf.close()
        if refused:
            with pytest.raises(InputError, match=r"torque: is converted by the formula .* expected arithmetic in X"):
                open_log(file).__enter__()
        else:
            with open_log(file) as log:
                assert log.read(["torque"])["torque"] == pytest.approx(2.0 * counts + np.sqrt(counts))
    assert not made.exists()


def test_an_index_beside_a_tdms_file_is_not_opened(tmp_path: Path):
    file = tmp_path / "lift.tdms"
    values = np.arange(100.0)
    with TdmsWriter(file) as writer:
        writer.write_segment([ChannelObject("drive", "torque", values, properties={"wf_increment": 0.01})])
    (tmp_path / "lift.tdms_index").write_text(SECRET)
    with open_log(file) as log:
        assert np.array_equal(log.read(["torque"])["torque"], values)


# One opener for whatever is read


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


@pytest.mark.parametrize("kind", MOST_BYTES)
def test_only_regular_files_of_the_size_of_their_kind_are_opened(tmp_path: Path, pipe: Path, kind: str):
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as stream:
        stream.truncate(MOST_BYTES[kind][0])
    open_input(sparse, kind).close()
    with sparse.open("wb") as stream:
        stream.truncate(MOST_BYTES[kind][0] + 1)
    for file, said in {pipe: "not a regular file", Path("/dev/zero"): "not a regular", sparse: "larger than"}.items():
        with pytest.raises(InputError, match=said):
            readable_file(file, kind)


def read(file: Path) -> object:
    """As the command does that reads a file of this name."""
    if file.name == "index.parquet":
        return read_table(file)
    if file.name == "machine.yaml":
        return read_campaign(file.parent)
    return open_log(file).__enter__()


@pytest.mark.parametrize("name", ["index.parquet", "log.csv", "log.mat", "log.tdms", "machine.yaml"])
def test_a_pipe_in_place_of_a_file_keeps_nobody_waiting(tmp_path: Path, name: str):
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="is not a regular file"):
        read(tmp_path / name)


def test_a_result_whose_column_lies_in_another_file_is_refused(tmp_path: Path):
    assert read_table(finished_result() / "index.parquet").num_rows
    file = tmp_path / "lift.parquet"
    inside = pyarrow.parquet.ParquetWriter(file, pa.schema([("time_s", pa.float64())]))
    inside.write_table(pa.table({"time_s": np.arange(100.0)}))
    inside.close()
    meta = pyarrow.parquet.read_metadata(file)
    meta.set_file_path("elsewhere.parquet")
    meta.write_metadata_file(file)  # a footer alone, as data sets keep one for many files
    with pytest.raises(InputError, match=r"time_s: keeps its samples in another file"), open_log(file) as log:
        log.read(["time_s"])


# What a killed writer leaves


def test_what_a_killed_writer_left_is_swept_and_what_another_writes_is_not(tmp_path: Path):
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom workbench.core.whole_folder import whole_folder\n"
        "with whole_folder(Path(sys.argv[1])) as hidden:\n"
        "    (hidden / 'machine.yaml').touch()\n    print('there', flush=True)\n    sys.stdin.read()\n"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "killed")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"there\n"
        (unfinished,) = tmp_path.iterdir()
        with whole_folder(tmp_path / "other"):
            assert unfinished.exists()  # its writer lives
        writer.kill()
    assert unfinished.exists()
    (tmp_path / ".study.0123456789abcdef.part").mkdir()  # a study's: it goes on there
    with whole_folder(tmp_path / "another"):
        assert not unfinished.exists()
    assert {file.name for file in tmp_path.iterdir()} == {"other", "another", ".study.0123456789abcdef.part"}


@pytest.mark.skipif(sys.platform == "win32", reason="allowed: no such limit")
def test_too_few_addresses_are_one_line():
    command = f"ulimit -v 900000; exec {shlex.quote(sys.executable)} -m workbench replay nowhere"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert (
        done.stderr == "error: the limit of 922 MB of addresses (ulimit -v) is too small, expected at least 2000 MB\n"
    )


@pytest.mark.parametrize(
    "doctype",
    [
        '<!DOCTYPE t [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        "<!DOCTYPE t [<!ENTITY a '0123456789'>"
        + "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefgh", "bcdefghx", strict=True))
        + "]>",
    ],
    ids=["another file", "a bomb"],
)
def test_an_entity_of_a_trace_opens_no_file_and_unpacks_to_nothing(tmp_path: Path, doctype: str):
    (tmp_path / "a.xml").write_text(
        f'{doctype}<t><traceData><dataFrame><dataSignal description="torque"/>&x;<rec time="0" f1="1"/>'
        "</dataFrame></traceData></t>"
    )
    with pytest.raises(InputError, match="is not a readable Sinumerik trace file"), open_log(tmp_path / "a.xml"):
        pass


# Mangled campaigns: whatever stands in the files, the reader gives sound runs or one clear error.


COLUMNS = hoist_columns(120, 0.02)
AXIS_RUNS = "runs:\n- {name: lift, file: runs/lift.csv, start_time_s: 0.0}\n"
WORDS = ["", "nan", "inf", "-inf", "1e999", "x", '"', ",", "\n", "0x10", "1,5", "\ufeff", "-", "1e308", "\r", " "]
YAML_WORDS = [*"-{}:!~'\"\t|#\0", "&a", "*a", "yes", "1e400", ".nan", "[[", "../"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("campaign")


def sound_or_refused(folder: Path, *names: str) -> None:
    """The promise of the reader, checked: finite, rising, of equal length; or an error that names a file."""
    try:
        campaign = read_campaign(folder)
    except InputError as error:
        text = str(error)
        assert any(name in text for name in names), text
        assert len(text.splitlines()) <= 5
        assert len(text) < 3000
        return
    assert campaign.runs
    for run in campaign.runs:
        assert len(run.time_s) >= 10
        assert np.isfinite(run.time_s).all()
        assert (np.diff(run.time_s) > 0.0).all()
        for values in run.signals.values():
            assert values.shape == run.time_s.shape
            assert values.dtype == np.float64
            assert np.isfinite(values).all()


def flipped(content: bytes, data: st.DataObject) -> bytes:
    """A file with some bytes changed, then perhaps cut off."""
    mangled = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        mangled[data.draw(st.integers(0, len(mangled) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.none(), st.integers(0, len(mangled))))
    return bytes(mangled[:cut])


@given(data=st.data())
def test_csv_with_changed_bytes(folder, data):
    write_campaign(folder, "")
    (folder / "runs" / "lift.csv").write_bytes(flipped(csv_text(COLUMNS).encode(), data))
    sound_or_refused(folder, "lift.csv")


@given(data=st.data())
def test_csv_with_strange_words_in_its_cells(folder, data):
    lines = csv_text(COLUMNS).splitlines()
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(lines) - 1))
        cells = lines[at].split(",")
        cells[data.draw(st.integers(0, len(cells) - 1))] = data.draw(st.sampled_from(WORDS))
        lines[at] = ",".join(cells)
    write_campaign(folder, "\n".join(lines))
    sound_or_refused(folder, "lift.csv")


@given(text=st.text(max_size=400))
def test_csv_of_any_text(folder, text):
    write_campaign(folder, "")
    (folder / "runs" / "lift.csv").write_text(text, encoding="utf-8", errors="surrogatepass")
    sound_or_refused(folder, "lift.csv")


@given(
    names=st.lists(st.sampled_from([*COLUMNS, "torque_motor_nm", "position_carriage_m", "temp"]), max_size=8),
    holes=st.lists(st.tuples(st.integers(0, 7), st.integers(0, 119), st.integers(1, 9)), max_size=6),
    value=st.sampled_from([np.nan, 0.0, np.inf, 1e308, -1e308, 1e-320]),
)
def test_any_columns_in_any_order_with_holes(folder, names, holes, value):
    columns = {name: COLUMNS.get(name, 300.0 + COLUMNS["time_s"]).copy() for name in names}
    for column, start, length in holes:
        if column < len(columns):
            list(columns.values())[column][start : start + length] = value
    write_campaign(folder, columns)
    sound_or_refused(folder, "lift.csv")


@given(data=st.data(), missing=st.lists(st.integers(0, 119), max_size=8))
def test_axis_with_any_columns_and_holes(folder, data, missing):
    columns = axis_columns(120, 0.01) | {"velocity_m_s": np.cos(COLUMNS["time_s"])}
    names = data.draw(st.lists(st.sampled_from(list(columns)), unique=True))
    chosen = {name: columns[name] for name in names}
    if chosen:
        chosen[data.draw(st.sampled_from(names))][missing] = data.draw(st.sampled_from([np.nan, 0.0, 1e308, np.inf]))
    write_campaign(folder, chosen, runs=AXIS_RUNS, machine=AXIS)
    sound_or_refused(folder, "lift.csv")


@given(
    times=st.lists(st.floats(-1e6, 1e6) | st.sampled_from([np.nan, np.inf, 0.0, 1.0, 1e308, -1e308]), max_size=40),
    sort=st.booleans(),
)
def test_any_time(folder, times, sort):
    time = np.array(sorted(times) if sort else times)
    columns = {name: np.resize(column, len(time)) for name, column in COLUMNS.items()}
    write_campaign(folder, columns | {"time_s": time})
    sound_or_refused(folder, "lift.csv")


@given(data=st.data())
@pytest.mark.parametrize("suffix", ["parquet", "mat"])
def test_binary_log_with_changed_bytes(folder, suffix, data):
    whole = folder / f"whole.{suffix}"
    if not whole.exists():
        if suffix == "parquet":
            pa.parquet.write_table(pa.table(COLUMNS), whole)
        else:
            scipy.io.savemat(whole, COLUMNS, do_compression=True)
    write_campaign(folder, "", runs=RUNS.replace("lift.csv", f"lift.{suffix}"))
    (folder / "runs" / f"lift.{suffix}").write_bytes(flipped(whole.read_bytes(), data))
    sound_or_refused(folder, f"lift.{suffix}")


@given(data=st.data())
@pytest.mark.parametrize("name", ["machine.yaml", "runs.yaml"])
def test_yaml_with_changed_words(folder, name, data):
    write_campaign(folder, COLUMNS)
    text = machine_text(default_hoist()) if name == "machine.yaml" else "columns: {time_s: {column: time_s}}\n" + RUNS
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        gone = data.draw(st.integers(0, 12))
        text = text[:at] + data.draw(st.sampled_from(YAML_WORDS) | st.text(max_size=3)) + text[at + gone :]
    (folder / name).write_text(text, encoding="utf-8", errors="surrogatepass")
    # A changed machine makes another file the odd one: a start above the anchor, speeds beyond nominal.
    sound_or_refused(folder, "machine.yaml", "runs.yaml", "lift.csv")


@given(data=st.data())
@pytest.mark.parametrize("name", ["machine.yaml", "runs.yaml"])
def test_yaml_with_changed_bytes(folder, name, data):
    write_campaign(folder, COLUMNS)
    (folder / name).write_bytes(flipped((folder / name).read_bytes(), data))
    sound_or_refused(folder, "machine.yaml", "runs.yaml", "lift.csv")


def test_the_campaign_that_is_mangled_here_reads_when_whole(folder):
    shutil.rmtree(folder)
    assert read_campaign(write_campaign(folder, COLUMNS)).all_notes == ()
