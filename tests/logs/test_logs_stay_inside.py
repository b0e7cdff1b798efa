"""No file of the server leaves it: what a container format would follow elsewhere is refused, and named."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

from benchmarks.attack.mangle import finished_result
from tests.support.log_campaign import RUNS, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.core.input_file import MOST_BYTES, open_input, readable_file
from workbench.core.whole_folder import whole_folder
from workbench.logs import read_campaign
from workbench.logs.formats.opening import open_log
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
def test_a_data_set_that_lies_elsewhere_is_refused_by_name(
    tmp_path: Path, way: Callable[[Any, Path], None], why: str, uploaded: bool
):
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
    for file, said in (
        (pipe, "not a regular file"),
        (Path("/dev/zero"), "not a regular file"),
        (sparse, "larger than"),
    ):
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
