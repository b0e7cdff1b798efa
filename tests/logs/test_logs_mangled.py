"""Mangled campaigns: whatever stands in the files, the reader gives sound runs or one clear error."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from tests.support.log_campaign import AXIS, RUNS, axis_columns, csv_text, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.machines.files import machine_text

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
