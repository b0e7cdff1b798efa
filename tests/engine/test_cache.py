"""Kernels on disk: an edit of any equation is seen, a spoilt or unwritable cache is survived."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support import kernel_user
from workbench.engine import native
from workbench.engine.native import cache_folder, load_functions

ROOT = Path(__file__).resolve().parents[2]


def start_process(checkout: Path, what: tuple[str, ...], environment: Mapping[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.support.kernel_user", *what],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout), "PYTHONDONTWRITEBYTECODE": "1", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[list[str], str]:
    """What it computed, and what it said."""
    out, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    return out.split(), said


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package that may be edited."""
    folder = tmp_path_factory.mktemp("checkout")
    shutil.copytree(ROOT / "workbench", folder / "workbench", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "tests" / "support").mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "support" / "kernel_user.py", folder / "tests" / "support")
    return folder


EDITS = {
    "an equation of the hoist": ("machines/kinds/hoist.py", "a_s = (s.r * (s.W2", "a_s = (0.9 * s.r * (s.W2", "hoist"),
    "an equation of the axis": ("machines/kinds/axis.py", "load = p.G * sin(x)", "load = 1.001 * p.G * sin(x)", "axis"),
    "the preamble": (
        "engine/preamble.py",
        "return sign_of_turn(m) * sine_of_rest(m, x)",
        "return 0.999 * sine_of_rest(m, x)",
        "axis",
    ),
    "the step": ("engine/rodas3.py", "GAMMA = 0.5", "GAMMA = 0.501", "axis"),
    "a rule of derivatives": ("symbolic/derive.py", "return cos(a) * d[0]", "return 0.9 * (cos(a) * d[0])", "axis"),
    "the controller": ("control/pi.py", "dt * (p.ki * push", "dt * (0.9 * p.ki * push", "loop"),
}


@contextlib.contextmanager
def edited(checkout: Path, edit: str) -> Iterator[str]:
    """The copy with one place of its physics changed; gives what computes with it."""
    name, old, new, what = EDITS[edit]
    path = checkout / "workbench" / name
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    try:
        yield what
    finally:
        path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_gives_a_kernel_another_text_which_its_file_is_named_after(checkout, edit):
    def text_of(what: str) -> list[str]:
        return finished(start_process(checkout, ("text", what), {}))[0]

    with edited(checkout, edit) as what:
        after = text_of(what)
    assert text_of(what) != after


def test_an_edit_is_seen_though_the_cache_holds_what_stood_there_before(checkout, tmp_path):
    environment = {"WORKBENCH_CACHE": str(tmp_path)}
    before, _ = finished(start_process(checkout, ("axis",), environment))
    with edited(checkout, "an equation of the axis"):
        after, _ = finished(start_process(checkout, ("axis",), environment))
    again, _ = finished(start_process(checkout, ("axis",), environment))
    assert after != before == again


def test_two_processes_that_compile_at_once_both_work_and_leave_nothing_half_written(tmp_path):
    folder = tmp_path / "kernels"
    pair = [start_process(ROOT, ("axis",), {"WORKBENCH_CACHE": str(folder)}) for _ in range(2)]
    first, second = (finished(process)[0] for process in pair)
    assert first == second
    assert [path.suffix for path in folder.iterdir()] == [".kernel"]


def test_a_first_run_says_once_that_it_compiles_and_the_next_one_is_silent(tmp_path):
    environment = {"WORKBENCH_CACHE": str(tmp_path / "kernels")}
    cold, said_cold = finished(start_process(ROOT, ("axis", "hoist"), environment))
    warm, said_warm = finished(start_process(ROOT, ("axis", "hoist"), environment))
    assert said_cold.count("compiling") == 1
    assert "once" in said_cold
    assert len(said_cold.splitlines()) == 1, "no warning of the engine's own checks"
    assert said_warm == ""
    assert warm == cold


def test_a_cache_folder_that_cannot_be_written_is_replaced_by_a_temporary_one(tmp_path):
    (tmp_path / "file").write_text("")
    environment = {"WORKBENCH_CACHE": str(tmp_path / "file" / "kernels"), "TMPDIR": str(tmp_path)}
    computed, _ = finished(start_process(ROOT, ("axis",), environment))
    (kernel,) = tmp_path.glob("workbench-*/*.kernel")
    assert computed
    assert oct(kernel.parent.stat().st_mode & 0o777) == "0o700"  # kernels are code: nobody else may put some there


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder for temporary files, and no cache folder that could be written."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "file" / "kernels"))
    native._fallback_folder.cache_clear()
    yield tmp_path
    native._fallback_folder.cache_clear()


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows has no owner's number")
@pytest.mark.parametrize("named_by", ["WORKBENCH_CACHE", "XDG_CACHE_HOME"])
def test_a_folder_of_somebody_else_is_not_used_whoever_names_it(temporary, monkeypatch, caplog, named_by):
    folder = temporary / "theirs"
    (folder / "workbench").mkdir(parents=True)
    monkeypatch.delenv("WORKBENCH_CACHE", raising=False)
    monkeypatch.setenv(named_by, str(folder))
    assert cache_folder().is_relative_to(folder)
    somebody_else = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: somebody_else)
    assert not cache_folder().is_relative_to(folder)
    assert "belongs to another user" in caplog.text


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows has no such modes")
def test_a_folder_that_others_can_write_to_is_made_its_owner_s_alone(temporary, monkeypatch):
    folder = temporary / "kernels"
    folder.mkdir()
    folder.chmod(0o777)
    monkeypatch.setenv("WORKBENCH_CACHE", str(folder))
    assert cache_folder() == folder
    assert folder.stat().st_mode & 0o777 == 0o755


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_a_link_and_a_file_of_somebody_else_are_no_kernels(tmp_path, monkeypatch):
    path, pipe, link = (tmp_path / name for name in ("kernel", "pipe", "link"))
    native._write(path, b"code")
    assert native._read(path) == b"code"
    os.mkfifo(pipe)
    link.symlink_to(path)
    assert native._read(pipe) is None
    assert native._read(link) is None
    somebody_else = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: somebody_else)
    assert native._read(path) is None


DOUBLE = """
def run(a, factor):
    for j in range(a.shape[0]):
        a[j] = a[j] * factor
    return a.shape[0]
"""


def doubled(text: str = DOUBLE) -> list[float]:
    a = np.array([1.0, 2.0])
    assert load_functions(text, {"run": "af"})["run"](a, 2.0) == 2
    return a.tolist()


@pytest.fixture
def forgetful(kernel_cache: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own cache folder, in a process that has loaded nothing yet."""
    forget(monkeypatch)
    return kernel_cache


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "_loaded", {})
    monkeypatch.setattr(native, "_said", set())


LANES = """
def run(a, b, n):
    for k in range(n):
        for l in range(16):
            x = 1.0
            y = b[l]
POLYNOMIAL
            b[l] = x
    return 0
""".replace("POLYNOMIAL", "\n".join(f"            x = x * y + a[{16 * row} + l]" for row in range(20)))


def test_a_loop_over_lanes_is_vectorised_without_a_check_at_run_time():
    made = str(native._optimised(LANES, {"run": "aai"}, native._target()))
    assert "x double>" in made
    assert "vector.memcheck" not in made


@pytest.mark.parametrize(
    "spoil",
    [
        lambda whole: b"",
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole[:-40] + bytes(40),
        lambda whole: whole[:200] + bytes(40) + whole[240:],
        lambda whole: b"[]\n",
    ],
    ids=["empty", "cut", "overwritten", "a hole", "another file"],
)
def test_a_spoilt_kernel_file_is_made_anew(forgetful, monkeypatch, spoil):
    assert doubled() == [2.0, 4.0]
    (path,) = forgetful.glob("*.kernel")
    whole = path.read_bytes()
    path.write_bytes(spoil(whole))
    forget(monkeypatch)
    assert doubled() == [2.0, 4.0]
    assert path.read_bytes() == whole


def by_hand(text: str) -> dict[str, Any]:
    """The functions of a kernel's text as the Python that it is."""
    known: dict[str, Any] = {
        "select": lambda c, a, b: a if c else b, "fma_": lambda a, b, c: a * b + c, "sqrt_": math.sqrt,
        "floor_": math.floor, "bits": lambda x: int(np.float64(x).view(np.int64)),
        "number": lambda n: float(np.int64(n).view(np.float64)),
    }  # fmt: skip
    exec(text, known)
    return known


PARTS = """
def half_(x):
    return 0.5 * x

def run(a, x, n):
    m = 1
    while True:
        largest = 0.0
        for j in range(a.shape[0] - 1):
            largest = max(largest, abs(a[j]) / m)
            if j == n // 2 and m > 1 or largest > 1e3:
                break
        if largest <= x:
            break
        m *= 2
    flag = (x > 1.0) & (a[0] <= 2) | (n % 2 == 0)
    a[0] = select(flag, half_(largest), -x)
    a[1] = flag
    a[2] = select(a[1], floor_(x), sqrt_(x))
    a[3] = number(bits(1.5) + (int(x) << 52)) * (n - 1)
    flag = fma_(x, x, 1)
    a[4] = flag
    return m
"""


@pytest.mark.parametrize("x", [0.3, 1.7, 2.5])
@pytest.mark.parametrize("n", [2, 3])
def test_a_text_computes_as_the_python_that_it_is(forgetful, x, n):
    ours, theirs = (np.array([2.0, -9.0, math.nan, 4.0, 7.0, 99.0]) for _ in range(2))
    assert load_functions(PARTS, {"run": "afi"})["run"](ours, x, n) == by_hand(PARTS)["run"](theirs, x, n)
    np.testing.assert_array_equal(ours, theirs)


def test_a_kernel_computes_as_the_python_that_it_is(monkeypatch):
    from workbench.engine import source

    usual = kernel_user.axis()
    source.replay_kernel.cache_clear()
    monkeypatch.setattr(source, "load_functions", lambda text, letters: by_hand(text))
    assert kernel_user.axis() == pytest.approx(usual, rel=1e-12)
    source.replay_kernel.cache_clear()


@pytest.mark.parametrize(
    "line", ["a[0] = a[0] ** 2", "n = 1.5", "a[0] = n != 1", "a[0], n = 1.0, 2", "for j in a:\n        n = 1"]
)
def test_what_is_no_part_of_a_kernel_is_refused(line):
    with pytest.raises(TypeError, match=r"no part of a kernel|a whole number first"):
        native._llvm(f"def run(a, n):\n    {line}\n    return n\n", {"run": "ai"})


@pytest.mark.parametrize("wrong", [np.zeros(4, dtype=np.float32), np.zeros((2, 2)), np.zeros(8)[::2]], ids=str)
def test_an_array_that_a_kernel_would_misread_is_refused(wrong):
    run = load_functions(DOUBLE, {"run": "af"})["run"]
    with pytest.raises(TypeError, match="flat contiguous float64"):
        run(wrong, 2.0)
