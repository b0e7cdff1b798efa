"""Good files and what is done to them. The same seed makes the same bytes, but for the date in an MF4 file."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import random
import shutil
import socket
import struct
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.attack import watch_states
from workbench.machines import default_hoist, machine_text

ROOT = Path(__file__).resolve().parents[2]
SAMPLES, STEP_S = 300, 0.01
RUNS = "runs:\n- {name: lift, file: runs/lift.csv, payload_kg: 4500.0, start_position_m: 9.0, start_time_s: 0.0}\n"
AXIS_RUNS = """\
columns: {force_n: {column: torque_motor1_nm, scale: 0.1}, velocity_m_s: {column: speed_motor_rad_s, scale: 0.005}}
runs: [{name: lift, file: runs/lift.csv}]
"""
COLUMNS = "columns:\n  time_s: {column: time_s, scale: 1.0}\n  speed_motor_rad_s: speed_motor_rad_s\n"

# Which file is mangled: of a campaign one form of its log, or machine.yaml, of a hoist or of an axis, or runs.yaml; zip
# and upload are the whole campaign as a browser sends it; escape is an HDF5 file with a data set that lies elsewhere;
# special is no regular file in the place of one; edit is a run that can be read and is wrong; a scenario and a
# controller's file stand for themselves; index, signals, manifest and ran (scenario.yaml) are of a finished result;
# state, copies and sidecar are a watch's.
KINDS = (
    "csv", "parquet", "mat", "mat73", "mf4", "tdms", "xml", "escape", "special", "edit", "machine", "axis", "runs",
    "zip", "upload", "scenario", "controller", "index", "signals", "manifest", "ran", *watch_states.KINDS,
)  # fmt: skip
MADE_BY_THE_VICTIM = ("escape", "special", "edit")
OF_A_RESULT = {"index": "index.parquet", "signals": "", "manifest": "manifest.json", "ran": "scenario.yaml"}
LOGS = ("csv", "parquet", "mat", "mat73", "mf4", "tdms", "xml")
_BINARY = ("parquet", "mat", "mat73", "mf4", "tdms", "zip", "index", "signals", "state", "copies")
_STUDY = """\
name: small
payloads_kg: [0, 9000]
start_position_m: 4.0
moves: [{by_m: 0.5}]
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
controller: {kind: pi, kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
outputs: {signals: thinned, every_s: 0.05}
"""
_CONTROLLER = """\
controller:
  kind: pi
  kp_nm_s_per_rad: 31.0
  ki_nm_per_rad: 122.0
  sample_time_s: 0.001
  tracking_time_s: 0.2
  torque_rate_limit_nm_per_s: 10000.0
  low_pass_hz: 60.0
  notch: {frequency_hz: 3.0, damping: 0.4, depth: 0.2}
  feed_forward: {inertia: 0.8, weight: 0.5, friction: 0.2}
"""
_AXIS = """\
kind: axis
motion: linear
mass_kg: 95.1089
gravity: {constant_n: 0.0}
friction: {coulomb_forward_n: 20.39, coulomb_backward_n: 20.39, viscous_n_s_per_m: 203.5}
sensors: {force_gain: 1.0, force_offset_n: 0.0}
tolerances: {inertia: 0.02, coulomb: 0.05, viscous: 0.1}
"""
# What an upload's boundary becomes here: names and contents one after the other.
CUT = b"\n--- 8< ---\n"

_CELLS = [
    "", "nan", "inf", "-inf", "1e999", "x", '"', ",", "\n", "\r", "0x10", "1,5", "-", "1e308", "-1e308", "1e-320", " ",
    "\x00", "0", "1;5", "é", "\ufeff", "9" * 400, "1" * 5000, "--1", "1e", ".", "NaN", "true", "2024-01-01",
]  # fmt: skip
_YAML = [
    "-", "{", "}", "[", "]", ":", "!", "!!python/object:os.system", "&a", "*a", "~", "yes", "1e400", "-1e308", "1e-320",
    "0", "-0.0", ".nan", ".inf", "'", '"', "\t", "[[", "|", ">", "../", "#", "\x00", "<<: ", "? ", "--- ", "%", "@",
    "`",     "\u2028", "\x1b[31m", "9" * 300, "x" * 3000,
]  # fmt: skip


def columns() -> dict[str, np.ndarray]:
    """A lift and a lowering of the default machine."""
    noise = np.random.default_rng(7)
    time = np.arange(SAMPLES) * STEP_S
    speed = 60.0 * np.sin(2.0 * np.pi * time / time[-1])
    torque = 297.0 + 0.15 * np.gradient(speed, time) + 20.0 * np.sign(speed)
    return {
        "time_s": time.round(6),
        "torque_motor1_nm": (torque + noise.normal(scale=3.0, size=SAMPLES)).round(1),
        "torque_motor2_nm": (torque + noise.normal(scale=3.0, size=SAMPLES)).round(1),
        "speed_motor_rad_s": (speed + noise.normal(scale=0.03, size=SAMPLES)).round(2),
        "speed_reference_rad_s": speed.round(3),
    }


@cache
def good(kind: str, variant: int) -> bytes:
    """The whole file of a kind; formats that have several forms come in all of them."""
    data = columns()
    if kind == "csv":
        rows = [",".join(data), *(",".join(map(repr, map(float, row))) for row in zip(*data.values(), strict=True))]
        return ("\n".join(rows) + "\n").encode()
    if kind == "parquet":
        import pyarrow as pa
        import pyarrow.parquet

        stream = io.BytesIO()
        how: list[dict[str, Any]] = [
            {"compression": "snappy"},
            {"compression": "none", "use_dictionary": False},
            {"compression": "zstd"},
        ]
        pyarrow.parquet.write_table(pa.table(data), stream, **how[variant % 3])
        return stream.getvalue()
    if kind == "mat":
        import scipy.io

        stream = io.BytesIO()
        mat: list[dict[str, Any]] = [{"do_compression": True}, {"do_compression": False}, {"format": "4"}]
        scipy.io.savemat(stream, data, **mat[variant % 3])
        return stream.getvalue()
    if kind == "xml":  # a Sinumerik trace
        names = [name for name in data if name != "time_s"]
        records = [
            f'<rec time="{t:.6f}" ' + " ".join(f'f{i}="{data[n][k]:.6g}"' for i, n in enumerate(names, 1)) + "/>"
            for k, t in enumerate(data["time_s"])
        ]
        head = "".join(f'<dataSignal key="{name}" description="{name}"/>' for name in names)
        frame = "\n".join([head, *records])
        return f"<trace><traceData><dataFrame>{frame}</dataFrame></traceData></trace>".encode()
    if kind in ("mat73", "mf4", "tdms"):
        return _of_the_import_extra(kind, variant)
    if kind == "machine":
        return machine_text(default_hoist()).encode()
    if kind == "runs":
        return (COLUMNS + RUNS).encode()
    if kind == "zip":
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED if variant % 2 else zipfile.ZIP_STORED) as archive:
            for name, part in (("machine.yaml", "machine"), ("runs.yaml", "runs"), ("runs/lift.csv", "csv")):
                archive.writestr(f"lifts/{name}", good(part, 0))
        return stream.getvalue()
    if kind in watch_states.KINDS:
        return watch_states.good(kind)
    if kind == "axis":
        return _AXIS.encode()
    if kind == "controller":
        return _CONTROLLER.encode()
    if kind == "upload":
        parts = [("machine.yaml", "machine"), ("runs.yaml", "runs"), ("lift.csv", "csv")]
        return CUT.join(part for name, file in parts for part in (name.encode(), good(file, 0)))
    if kind in OF_A_RESULT:
        folder = finished_result()
        return (folder / OF_A_RESULT[kind] if OF_A_RESULT[kind] else signals_of(folder)).read_bytes()
    scenarios = sorted((ROOT / "scenarios").glob("*.yaml"))
    return scenarios[variant % len(scenarios)].read_bytes()


def _of_the_import_extra(kind: str, variant: int) -> bytes:
    """A log in a format whose reader comes with the extra `import`. An MF4 file has its date of writing in it."""
    data = columns()
    stream = io.BytesIO()
    if kind == "mat73":
        import h5py

        how: list[dict[str, Any]] = [{}, {"compression": "gzip"}, {"chunks": (1, 50), "shuffle": True}]
        with h5py.File(stream, "w", userblock_size=512) as held:
            for name, column in data.items():
                held.create_dataset(name, data=column.reshape(1, -1), **how[variant % 3])
    elif kind == "mf4":
        from asammdf import MDF, Signal

        time_s = data["time_s"]
        how_packed: dict[str, Any] = {"compression": variant % 2}
        with tempfile.TemporaryDirectory() as folder, MDF(version=("4.10", "3.30", "4.11")[variant % 3]) as mdf:
            mdf.append([Signal(data[name], time_s, name=name) for name in data if name != "time_s"])
            mdf.save(Path(folder) / "lift.mf4", overwrite=True, **how_packed)
            (written,) = Path(folder).iterdir()
            return written.read_bytes()
    else:
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(stream) as writer:
            for part in np.array_split(np.arange(SAMPLES), variant % 3 + 1):
                step = {"wf_increment": STEP_S}
                channels = [
                    ChannelObject("drive", n, v[part], properties=step) for n, v in data.items() if n != "time_s"
                ]
                writer.write_segment(channels)
    return stream.getvalue()


def escape(chance: random.Random, secret: Path) -> bytes:
    """A MAT 7.3 file one of whose data sets is to be read from `secret`."""
    import h5py

    stream = io.BytesIO()
    data = columns()
    name = chance.choice([*data])
    with h5py.File(stream, "w") as held:
        for other in data:
            if other != name:
                held[other] = data[other].reshape(1, -1)
        way = chance.choice(["external", "virtual", "link", "soft", "late"])
        if way in ("external", "late"):
            first = 0 if way == "external" else chance.choice([8, 100, 1000])  # bytes of another part of the same file
            parts = [(str(secret), 40, first), (str(secret), 0, 8 * SAMPLES - first)]
            held.create_dataset(name, (1, SAMPLES), dtype="f8", external=parts if first else parts[1:])
        elif way == "virtual":
            layout = h5py.VirtualLayout((1, SAMPLES), dtype="f8")
            layout[0, : SAMPLES // 2] = h5py.VirtualSource(
                chance.choice([str(secret), "."]), "x", shape=(SAMPLES // 2,)
            )
            held.create_virtual_dataset(name, layout)
        else:
            held[name] = h5py.ExternalLink(str(secret), "x") if way == "link" else h5py.SoftLink("/elsewhere/x")
    return stream.getvalue()


SPECIAL = ("fifo", "zero", "full", "sparse", "folder", "loop", "dangling", "socket")


def make_special(what: str, place: Path) -> None:
    """No regular file, or a giant, where one is expected."""
    if what == "fifo":
        os.mkfifo(place)
    elif what == "sparse":
        with place.open("wb") as stream:
            stream.truncate(60_000_000_000)
    elif what == "folder":
        place.mkdir()
    elif what == "socket":
        with contextlib.chdir(place.parent), socket.socket(socket.AF_UNIX) as line:
            line.bind(place.name)
    else:
        place.symlink_to({"zero": "/dev/zero", "full": "/dev/full", "loop": place.name}.get(what, "nowhere"))


@cache
def finished_result() -> Path:
    """A small study's result, made once in a process and taken away at its end."""
    from workbench.study.load import load_study
    from workbench.study.store import place_for, run_batch

    base = Path(tempfile.mkdtemp(prefix="attack-result-"))
    atexit.register(shutil.rmtree, base, ignore_errors=True)
    (base / "small.yaml").write_text(_STUDY)
    study = load_study(base / "small.yaml")
    run_batch(study, place_for(study, base / "small"))
    return base / "small"


def signals_of(folder: Path) -> Path:
    """The signals of a result's first run."""
    return min((folder / "runs").iterdir()) / "signals.parquet"


def mangled(kind: str, seed: int) -> bytes:
    """The input of a seed."""
    chance = random.Random(f"{kind} {seed}")
    if kind in MADE_BY_THE_VICTIM:
        return str(seed).encode()
    content = good(kind, chance.randrange(60))
    ways = [_flip, _flip, _cut, _lie, _copy, _drop, _swap, _fill]
    if kind not in _BINARY:
        ways += [_cells] * 6 if kind == "csv" else [_words] * 6
    if kind not in ("csv", *_BINARY):
        ways += [_junk_keys, _deep, _bomb, _number, _number, _number]
    if kind == "csv":
        ways += [_holes, _holes, _many_columns]
    if kind == "state" and chance.random() < 0.5:
        return watch_states.changed_rows(content, chance)
    if kind in ("parquet", "index", "signals", "copies") and chance.random() < 0.5:
        return _changed_table(content, chance)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        content = chance.choice(ways)(content, chance)
    return content


Chance = random.Random
Way = Callable[[bytes, Chance], bytes]


def _at(content: bytes | bytearray, chance: Chance) -> int:
    """A place; the ends, where formats keep what they say of themselves, come up more often."""
    size = max(1, len(content))
    return chance.choice(
        [chance.randrange(size), chance.randrange(min(size, 300)), -1 - chance.randrange(min(size, 900))]
    )


def _flip(content: bytes, chance: Chance) -> bytes:
    out = bytearray(content or b"\0")
    for _ in range(chance.choice([1, 1, 2, 5, 20])):
        out[_at(bytes(out), chance)] ^= chance.choice([1 << chance.randrange(8), chance.randrange(1, 256)])
    return bytes(out)


def _cut(content: bytes, chance: Chance) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def _lie(content: bytes, chance: Chance) -> bytes:
    """Another whole number where one may stand."""
    out = bytearray(content)
    form = chance.choice(["<I", ">I", "<Q", "<H", "B"])
    if len(out) > struct.calcsize(form):
        most = (1 << 8 * struct.calcsize(form)) - 1
        value = chance.choice([0, 1, most, most >> 1, (most >> 1) + 1, chance.randrange(most + 1)])
        struct.pack_into(form, out, chance.randrange(len(out) - struct.calcsize(form)), value)
    return bytes(out)


def _span(content: bytes, chance: Chance) -> tuple[int, int]:
    start = chance.randrange(len(content) + 1)
    return start, min(len(content), start + chance.choice([1, 4, 8, 50, 400, 3000]))


def _copy(content: bytes, chance: Chance) -> bytes:
    start, end = _span(content, chance)
    return content[:end] + content[start:end] * chance.choice([1, 2, 50]) + content[end:]


def _drop(content: bytes, chance: Chance) -> bytes:
    start, end = _span(content, chance)
    return content[:start] + content[end:]


def _swap(content: bytes, chance: Chance) -> bytes:
    first, second = sorted((_span(content, chance), _span(content, chance)))
    if first[1] > second[0]:
        return content
    return b"".join([
        content[: first[0]], content[second[0] : second[1]], content[first[1] : second[0]],
        content[first[0] : first[1]], content[second[1] :],
    ])  # fmt: skip


def _fill(content: bytes, chance: Chance) -> bytes:
    start, end = _span(content, chance)
    return content[:start] + chance.choice([b"\0", b"\xff", b"\r", b" ", b"\n"]) * (end - start) + content[end:]


def _changed_table(content: bytes, chance: Chance) -> bytes:
    """A sound Parquet file whose table is none that was written: other values, types, names or numbers of rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(content))
    for _ in range(chance.choice([1, 1, 3])):
        at = chance.randrange(table.num_columns)
        name, values = table.column_names[at], table.column(at).to_pylist()
        row = chance.randrange(len(values)) if values else 0
        way = chance.choice(["value", "value", "value", "all", "type", "name", "drop", "cut", "note", "repeat"])
        if way in ("value", "all"):
            odd: list[Any] = [None, 0.0, -1.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"), 1e29]
            if values and isinstance(values[0], str):
                odd = ["", "ok", "failed", "../../x", "\x00", "\x1b[31m", "é" * 300, "x" * 3000]
            new = chance.choice(odd)
            values = [new if way == "all" or i == row else value for i, value in enumerate(values)]
            try:
                column = pa.array(values, type=table.schema.field(at).type)
            except pa.ArrowException:  # a number that is no truth value, or no list
                column = pa.array([str(value) for value in values])
            table = table.set_column(at, name, column)
        elif way == "type":
            odd_type = chance.choice([[str(v) for v in values], [True] * len(values), [[1.0]] * len(values)])
            table = table.set_column(at, name, pa.array(odd_type))
        elif way == "name":
            names = [*table.column_names]
            names[at] = chance.choice(["", "x", names[-1], "\x1b[31m", "n" * 5000])
            table = table.rename_columns(names)
        elif way == "drop" and table.num_columns > 1:
            table = table.remove_column(at)
        elif way == "cut":
            table = table.slice(0, chance.choice([0, 1, row]))
        elif way == "repeat":
            table = pa.concat_tables([table] * chance.choice([2, 300]))
        elif way == "note":
            notes = [b"[]", b"{}", b"[1]", b'["peak_torque_motor_nm"]', b'["status"]', b"[", b"null"]
            table = table.replace_schema_metadata({b"assigned": chance.choice(notes)})
    stream = io.BytesIO()
    pq.write_table(table, stream)
    return stream.getvalue()


def _cells(content: bytes, chance: Chance) -> bytes:
    """Words that are no numbers, or are too large, in the cells of a table."""
    lines = content.decode(errors="replace").split("\n")
    for _ in range(chance.choice([1, 3, 30])):
        row = chance.randrange(len(lines))
        cells = lines[row].split(",")
        cells[chance.randrange(len(cells))] = chance.choice(_CELLS)
        lines[row] = ",".join(cells)
    return "\n".join(lines).encode(errors="surrogatepass")


def _holes(content: bytes, chance: Chance) -> bytes:
    """A stretch of a column, or of all but time, at one value; or a scale."""
    lines = [line.split(",") for line in content.decode(errors="replace").split("\n")]
    start = chance.randrange(1, len(lines)) if len(lines) > 1 else 0
    end = start + chance.choice([1, 2, 5, 30, 200])
    chosen = range(1, 5) if chance.random() < 0.3 else [chance.randrange(0, 5)]
    value, scale = chance.choice(["0.0", "", "1e308", "nan", "297.0", "1e5"]), chance.choice([None, None, 1000.0, -1.0])
    for row in lines[start:end]:
        for column in chosen:
            if column < len(row):
                try:
                    row[column] = value if scale is None else repr(scale * float(row[column]))
                except ValueError:
                    row[column] = value
    return "\n".join(",".join(row) for row in lines).encode()


def _many_columns(content: bytes, chance: Chance) -> bytes:
    """Columns by the thousand."""
    count = chance.choice([100, 2000])
    lines = content.split(b"\n")[: chance.choice([3, 30])]
    lines[0] += b"".join(b",c%d" % i for i in range(count))
    return b"\n".join([lines[0], *(line + b",1" * count for line in lines[1:] if line)])


def _words(content: bytes, chance: Chance) -> bytes:
    text = content.decode(errors="replace")
    for _ in range(chance.choice([1, 1, 3, 8])):
        at = chance.randrange(len(text) + 1)
        text = text[:at] + chance.choice(_YAML) + text[at + chance.choice([0, 0, 1, 5, 12]) :]
    return text.encode(errors="surrogatepass")


def _number(content: bytes, chance: Chance) -> bytes:
    """One value of a file of keys becomes another one."""
    lines = content.decode(errors="replace").split("\n")
    keys = [index for index, line in enumerate(lines) if ": " in line]
    if not keys:
        return content
    index = chance.choice(keys)
    key, _, _ = lines[index].partition(": ")
    values = ["0", "1e308", "-1", "1e-320", "8e299", "1e9", "1e-9", ".nan", "[]", "{}", "''", "null", "true", "1e15"]
    lines[index] = f"{key}: {chance.choice(values)}"
    return "\n".join(lines).encode(errors="surrogatepass")


def _junk_keys(content: bytes, chance: Chance) -> bytes:
    count, indent = chance.choice([20, 5000]), chance.choice(["", "  "])
    return content + b"".join(f"{indent}junk{i}: {i}\n".encode() for i in range(count))


def _deep(content: bytes, chance: Chance) -> bytes:
    depth = chance.choice([30, 50, 5000])
    return content + b"deep: " + b"[" * depth + b"]" * (depth if chance.random() < 0.8 else 3) + b"\n"


def _bomb(content: bytes, chance: Chance) -> bytes:
    """Aliases of aliases."""
    lines = ["b0: &b0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"b{i}: &b{i} [{', '.join([f'*b{i - 1}'] * 9)}]" for i in range(1, chance.choice([3, 9]))]
    return content + "\n".join(lines).encode() + b"\n"
