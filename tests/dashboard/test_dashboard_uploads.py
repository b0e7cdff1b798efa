"""Uploaded campaigns: bounded, confined, read strictly, named as they were uploaded; the page Import."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.dashboard_app import errors, figures, good, page, words
from tests.support.drive_files import drive_file
from tests.support.log_campaign import RUNS, csv_text, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.dashboard import session, uploads
from workbench.dashboard.uploads import KEPT, Uploaded, name_of, read_stored, read_uploaded, stored_campaigns
from workbench.logs import read_campaign
from workbench.logs.formats import opening


@pytest.fixture
def files(tmp_path: Path) -> dict[str, bytes]:
    """A good campaign by path."""
    folder = write_campaign(tmp_path / "made", hoist_columns())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    folder = tmp_path / "session"
    folder.mkdir()
    return folder


def zipped(files: Mapping[str, bytes], root: str = "lifts/", method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(root + name, content)
    return stream.getvalue()


def loose(files: Mapping[str, bytes]) -> list[Uploaded]:
    return [Uploaded(name.rpartition("/")[2], content) for name, content in files.items()]


def refused(given_: list[Uploaded], workspace: Path) -> str:
    """The error's sentence; nothing is left behind."""
    with pytest.raises(InputError) as caught:
        read_uploaded(given_, workspace)
    assert list(workspace.iterdir()) == []
    assert str(workspace) not in str(caught.value)
    return str(caught.value)


def told(given_: list[Uploaded], workspace: Path) -> str:
    """The InputError's sentence, "" where it is a campaign; anything else comes through."""
    try:
        read_uploaded(given_, workspace)
    except InputError as error:
        return str(error)
    return ""


def limit_uploads(monkeypatch: pytest.MonkeyPatch, **limits: Any) -> None:
    """Every log format with other limits for what is uploaded."""
    smaller = [replace(log_format, uploaded=replace(log_format.uploaded, **limits)) for log_format in opening.FORMATS]
    monkeypatch.setattr(opening, "FORMATS", smaller)


def as_zip(files: Mapping[str, bytes], workspace: Path, root: str = "lifts/") -> str:
    return refused([Uploaded("lifts.zip", zipped(files, root))], workspace)


@pytest.mark.parametrize("root", ["", "lifts/", "a/b/lifts/"])
def test_a_zip_of_a_campaigns_folder_is_read_and_called_as_the_zip(files, workspace, root):
    campaign = read_uploaded([Uploaded("C:\\logs\\spring lifts.zip", zipped(files, root))], workspace)
    assert campaign.name == "spring lifts"
    assert [run.name for run in campaign.runs] == ["lift"]
    assert campaign.path.parent == workspace and campaign.path.stat().st_mode & 0o077 == 0


def test_only_what_runs_yaml_names_is_stored(files, workspace):
    more = {**files, "evil.sh": b"rm -rf /", "runs/other.csv": b"x", ".profile": b"x", "__MACOSX/._runs.yaml": b"x"}
    campaign = read_uploaded([Uploaded("lifts.zip", zipped(more))], workspace)
    stored = {path.relative_to(campaign.path).as_posix() for path in campaign.path.rglob("*") if path.is_file()}
    assert stored == {"machine.yaml", "runs.yaml", "runs/lift.csv"}


@pytest.mark.parametrize(
    "path",
    ["../lift.csv", "runs/../../lift.csv", "/etc/passwd", "runs//lift.csv", "C:\\lift.csv", "~root/lift.csv", ".ssh/id",
     "a/b/c/d/e.csv", "lift.csv.", "", "runs/\0.csv"],
)  # fmt: skip
def test_a_log_that_lies_elsewhere_is_named_by_line_and_refused(files, workspace, path):
    runs = RUNS.replace("runs/lift.csv", json.dumps(path)).encode()
    said = as_zip({**files, "runs.yaml": runs} | ({path: b"t"} if path.isprintable() and path else {}), workspace)
    assert said.startswith("runs.yaml:2: runs[0].file: ") and "is no plain path" in said


def test_a_zip_member_that_climbs_out_is_never_written(files, workspace):
    said = as_zip({"../../machine.yaml": files["machine.yaml"], "../../runs.yaml": files["runs.yaml"]}, workspace, "")
    assert said.startswith("runs.yaml:2: runs[0].file: 'runs/lift.csv' was not uploaded")
    assert {path.name for path in workspace.parent.iterdir()} == {"made", "server", "session"}


def replaced(name: str, old: str, new: str) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    return lambda files: {**files, name: files[name].replace(old.encode(), new.encode(), 1)}


TWICE = "- {name: two, file: runs/lift.csv/two.csv, payload_kg: 0.0, start_position_m: 9.0}\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda files: {"notes.txt": b"x"}, "lifts.zip: holds no runs.yaml; expected a zip of a campaign's folder"),
        (lambda files: {**files, "old/runs.yaml": b"x"}, "lifts.zip: holds 2 campaigns"),
        (lambda files: {k: v for k, v in files.items() if k != "machine.yaml"}, "machine.yaml: is missing"),
        (replaced("runs.yaml", "lift.csv", "lfit.csv"),
         "runs.yaml:2: runs[0].file: 'runs/lfit.csv' was not uploaded; did you mean 'runs/lift.csv'?"),
        (replaced("runs/lift.csv", "\n0.01,", "\n0.01,5,"), "runs/lift.csv:3: lift: row has 6 fields"),
        (replaced("machine.yaml", "  ratio:", "  rato:"), "machine.yaml:"),
        (lambda files: {**files, "machine.yaml": files["machine.yaml"] + b"effects:\n  magic: {}\n"}, "machine.yaml:"),
        (lambda files: {**files, "runs.yaml": files["runs.yaml"] + TWICE.encode(), "runs/lift.csv/two.csv": b"x"},
         "runs.yaml: its logs cannot be stored side by side"),
    ],
    ids=["nothing", "two", "no machine", "a log's name", "a row", "a key", "an effect", "file and folder"],
)  # fmt: skip
def test_what_is_wrong_in_a_campaign_is_named_by_file_line_and_nearest_name(files, workspace, change, said):
    assert as_zip(change(files), workspace).startswith(said)


def of_zeros(files: dict[str, bytes]) -> dict[str, bytes]:
    return {**files, "runs/lift.csv": b"0" * 50_000_000}


def cut(files: dict[str, bytes]) -> bytes:
    whole = bytearray(zipped(files))
    at = whole.index(b"machine.yaml") + 40
    whole[at : at + 200] = b"\xff" * 200
    return bytes(whole)


def lying(files: dict[str, bytes]) -> bytes:
    return zipped(of_zeros(files)).replace((50_000_000).to_bytes(4, "little"), (1000).to_bytes(4, "little"))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (lambda files: b"no zip", "is not a readable zip"),
        (lambda files: b"", "is not a readable zip"),
        (lambda files: b"PK\x03\x04" + b"\0" * 60, "is not a readable zip"),
        (cut, "is not a readable zip"),
        (lambda files: zipped(files, method=zipfile.ZIP_LZMA), "expected a plain (deflate) zip"),
        (lambda files: zipped(of_zeros(files)), "lifts.zip: unpacks to more than 5 MB"),
        (lying, "lifts.zip: "),
    ],
    ids=["no zip", "empty", "begun", "cut", "lzma", "bomb", "a bomb that lies about its size"],
)
def test_a_zip_that_is_damaged_or_grows_is_refused(files, workspace, monkeypatch, content, said):
    monkeypatch.setattr(uploads, "MOST_UNPACKED", 5_000_000)
    packed = content(files)
    assert len(packed) < 200_000
    assert said in refused([Uploaded("lifts.zip", packed)], workspace)


def as_log(folder: Path, suffix: str, columns: Mapping[str, Any]) -> bytes:
    """A log of that format, well packed."""
    file = folder / f"lift.{suffix}"
    if suffix == "csv":
        file.write_text(csv_text(columns))
    elif suffix == "mat":
        scipy.io.savemat(file, dict(columns), do_compression=True)
    else:
        pyarrow.parquet.write_table(pa.table(dict(columns)), file)
    return file.read_bytes()


def with_log(files: dict[str, bytes], suffix: str, content: bytes) -> dict[str, bytes]:
    runs = RUNS.replace("lift.csv", f"lift.{suffix}").encode()
    return {**files, "runs.yaml": runs, f"runs/lift.{suffix}": content}


@pytest.mark.parametrize(
    ("suffix", "zeros", "limits", "said"),
    [
        ("parquet", 3_000_000, {"rows": 1_000_000}, "holds more than 1 million rows, the most that is read; cut it"),
        ("mat", 300_000, {"bytes": 5_000_000},
         "unpacks to more than 5 MB, the most that is read; cut it or leave columns out"),
    ],
)  # fmt: skip
def test_a_log_that_unpacks_to_too_much_is_refused_before_it_does(
    files, workspace, monkeypatch, tmp_path, suffix, zeros, limits, said
):
    limit_uploads(monkeypatch, **limits)
    packed = as_log(tmp_path, suffix, dict.fromkeys(hoist_columns(3), np.zeros(zeros)))
    assert len(packed) < 200_000
    assert as_zip(with_log(files, suffix, packed), workspace) == f"runs/lift.{suffix}: lift: {said}"


def test_the_same_name_twice_and_a_zip_beside_files_are_refused(files, workspace):
    assert "was uploaded twice" in refused([*loose(files), Uploaded("sub/lift.csv", b"")], workspace)
    assert "one zip alone" in refused([*loose(files), Uploaded("more.zip", b"")], workspace)
    assert "nothing was uploaded" in refused([], workspace)


def test_too_many_or_too_large_files_are_refused(files, workspace, monkeypatch):
    many = [Uploaded(f"{i}.csv", b"") for i in range(uploads.MOST_FILES + 1)]
    assert "expected at most 200" in refused(many, workspace)
    monkeypatch.setattr(uploads, "MOST_UPLOADED", 1_000_000)
    assert refused([Uploaded("lifts.zip", bytes(2_000_000))], workspace) == (
        "2 MB were uploaded, expected at most 1 MB"
    )
    members = {f"{i}.csv": b"" for i in range(uploads.MOST_MEMBERS + 1)}
    assert "holds 1004 files" in as_zip({**files, **members}, workspace)


@pytest.mark.parametrize("end", [b"\n", b"\r", b"\r\n"])
def test_a_long_csv_is_refused_by_its_rows_whatever_ends_them(files, workspace, monkeypatch, end):
    limit_uploads(monkeypatch, rows=400)
    files["runs/lift.csv"] = files["runs/lift.csv"].replace(b"\n", end)
    assert as_zip(files, workspace) == "runs/lift.csv: lift: holds more than 400 rows, the most that is read; cut it"


def test_a_log_that_takes_too_long_is_refused(files, workspace, monkeypatch):
    limit_uploads(monkeypatch, seconds=1.0)
    endless = bytes([1]) + bytes(19) + bytes(100_000_000)  # version 4: five million variables without a name
    assert as_zip(with_log(files, "mat", endless), workspace).startswith("runs/lift.mat: lift: ")
    said = as_zip(with_log(files, "mat", bytes(50_000_000)), workspace)
    assert said == "runs/lift.mat: lift: is not a readable MAT file: it begins with zeros"


def test_a_session_keeps_its_newest_campaigns_only(files, workspace):
    read = [read_uploaded(loose(files), workspace).path for _ in range(KEPT + 2)]
    assert set(workspace.iterdir()) == set(read[-KEPT:]) == set(stored_campaigns(workspace))
    again = read_stored(read[-1])
    assert again.name == name_of(read[-1]) == again.machine.name and [run.name for run in again.runs] == ["lift"]


NAMES = st.one_of(
    st.text(max_size=40),
    st.sampled_from(["machine.yaml", "runs.yaml", "lift.csv", "../runs.yaml", "runs/lift.csv", "a.zip", "/etc/passwd"]),
)
GOOD_RUNS = RUNS.encode()
CONTENTS = st.one_of(
    st.binary(max_size=300),
    st.sampled_from([GOOD_RUNS, csv_text(hoist_columns(20)).encode(), zlib.compress(b"0" * 1000), b"runs: [1]"]),
    st.text(max_size=60).map(lambda file: f"runs:\n- {{name: a, file: {file!r}}}\n".encode(errors="replace")),
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(NAMES, CONTENTS), max_size=5), st.booleans(), st.booleans())
def test_whatever_is_uploaded_stays_in_the_workspace_or_is_an_input_error(tmp_path, given_, as_a_zip, complete):
    workspace, outside = tmp_path / "session", tmp_path / "outside"
    for folder in (workspace, outside):
        folder.mkdir(exist_ok=True)
    if complete:
        made = write_campaign(tmp_path / "made", hoist_columns(20))
        given_ = [("machine.yaml", (made / "machine.yaml").read_bytes()), ("runs.yaml", GOOD_RUNS), *given_]
    sent = [Uploaded(name, content) for name, content in given_]
    if as_a_zip:
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            for name, content in dict(given_).items():
                archive.writestr(name.replace("\0", "_").encode(errors="replace").decode() or "x", content)
        sent = [Uploaded("some.zip", stream.getvalue())]
    before = {path for path in tmp_path.rglob("*") if not path.is_relative_to(workspace)}
    said = told(sent, workspace)
    assert said.replace("\n", "").isprintable() and str(tmp_path) not in said
    assert {path for path in tmp_path.rglob("*") if not path.is_relative_to(workspace)} == before
    assert all(path.resolve().is_relative_to(workspace.resolve()) for path in workspace.rglob("*"))


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400), st.integers(0, 2000), st.sampled_from(["csv", "parquet", "mat"]))
def test_damaged_logs_are_input_errors(tmp_path, noise, at, suffix):
    workspace, made = tmp_path / "session", write_campaign(tmp_path / "made", hoist_columns(60))
    workspace.mkdir(exist_ok=True)
    content = bytearray(as_log(tmp_path, suffix, hoist_columns(60)))
    content[at : at + len(noise)] = noise
    given_ = with_log({"machine.yaml": (made / "machine.yaml").read_bytes()}, suffix, bytes(content))
    assert str(tmp_path) not in told(loose(given_), workspace)


@pytest.mark.parametrize("name", ["../other.yaml", "a/b.csv", "/tmp/x.csv", "", "..", "."])
def test_no_name_leads_out_of_the_sessions_folder(name: str):
    upload: Any = SimpleNamespace(size=1, getvalue=lambda: b"x")
    with pytest.raises(ValueError, match="plain file name"):
        session.stored(upload, name)


# The page Import: a drive's file becomes a campaign that the other pages work on, with the numbers of `import`.


def dropped(content: bytes, suffix: str = ".csv") -> Any:
    app = page("Import").run()
    assert not app.exception and "One file a run" in app.get("file_uploader")[0].proto.label
    app.file_uploader(key="import files").upload(f"../lift one{suffix}", content, "application/octet-stream").run()
    assert not app.exception
    return app


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".mf4", ".tdms"])
def test_a_drives_file_becomes_a_campaign_with_its_own_numbers(server: Path, suffix: str):
    app = dropped(drive_file(server, suffix), suffix)
    assert app.selectbox(key="import speed_motor_rad_s").value == "n_act"
    assert "its unit is not said: by its size %nominal" in words(app)  # 60 to 70 % would not hold the carriage
    app.number_input(key="import start lift one").set_value(9.0)
    app.number_input(key="import payload lift one").set_value(4500.0).run()
    assert errors(app) == [] and len(figures(app)) == 1
    app.text_input(key="import name").set_value("../mine").run()
    good(app.button(key="import make").click().run())
    name, packed = app.session_state["import made"]
    assert "/" not in name
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        assert sorted(archive.namelist()) == ["machine.yaml", "runs.yaml", "runs/lift one.parquet"]
        archive.extractall(server / "out")
    (run,) = read_campaign(server / "out").runs
    expected = hoist_columns()
    for signal in ("speed_motor_rad_s", "torque_motor1_nm", "torque_motor2_nm"):
        assert run[signal] == pytest.approx(expected[signal], rel=1e-4, abs=1e-3)
    assert run.payload_kg == 4500.0 and app.session_state["campaign chosen"].startswith(name)


def test_what_is_no_log_and_a_missing_payload_are_one_sentence(server: Path):
    app = page("Import").run()
    app.file_uploader(key="import files").upload("a.csv", b"\x00\x01nothing", "text/csv").run()
    assert not app.exception and len(errors(app)) == 1
    app = dropped(drive_file(server, ".csv"))
    app.button(key="import make").click().run()
    assert not app.exception and len(errors(app)) == 1 and "/" not in errors(app)[0].partition(":")[0]
