"""The house rules that a machine can check: pins, versions, help texts, nothing of one machine's own."""

from __future__ import annotations

import importlib
import os
import re
import signal
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import click
import pytest

import workbench
from workbench.cli import COMMANDS, cli, main
from workbench.core.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")

# Folders of one machine or one person. A path from the paper's or the user's machine has no place in the project.
MACHINE_PATH = re.compile(r"(?<![\w.)\]}~-])/(?:home|root|Users|work|opt)/\w")
# Hosts that the project may name; whatever else is named is either a registry or a server that may vanish.
ALLOWED_HOSTS = {
    "doi.org",
    "json-schema.org",
    "localhost",
    "127.0.0.1",
    "www.w3.org",
    "www.plcopen.org",  # the namespace of its XML
    "keepachangelog.com",
    "semver.org",
    "yaml.org",
    "opensource.org",  # the licence in the headers of FMI
}
HOST = re.compile(
    r"(?:https?://|\b(?=[\w-]+\.[\w.-]*(?:org|com|net)\b))([\w.-]+\.(?:org|com|net|io|dev)|[\d.]{7,}|localhost)\b"
)


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def named(requirements: list[str]) -> set[str]:
    return {normal(re.split(r"[\s<>=!~;\[]", requirement)[0]) for requirement in requirements}


def pins() -> dict[str, str]:
    """name -> version of requirements.lock; anything but an exact pin with its hashes fails."""
    versions = {}
    for line in LOCK.replace("\\\n", "").splitlines():
        if line.strip() and not line.startswith("#"):
            match = re.fullmatch(r"([\w.-]+)==([\w.+!]+)(?: ; [^#]+?)?(?: +--hash=sha256:[0-9a-f]{64})+", line)
            assert match, f"not an exact pin with its hashes: {line!r}"
            versions[normal(match[1])] = match[2]
    return versions


def tracked_text() -> list[tuple[str, str]]:
    """(path, text) of every text file that git tracks or would track."""
    if not (ROOT / ".git").exists():
        pytest.skip("allowed: not a git checkout")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    texts = []
    for name in filter(None, listed.split("\0")):
        path = ROOT / name
        data = path.read_bytes() if path.is_file() else b""
        if b"\0" not in data:
            texts.append((name, data.decode("utf-8", "replace")))
    return texts


def test_the_lock_holds_exact_pins_and_names_no_place():
    assert len(pins()) > 40
    for word in ("http", "://", "--index", "--find", "/work", "@", ".whl", "file:"):
        assert word not in LOCK, word


def test_make_installs_nothing_whose_hash_is_not_locked():
    assert "--require-hashes -r requirements.lock" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_the_lock_pins_everything_that_pyproject_names():
    extras = PROJECT["optional-dependencies"]
    locked = [requirement for name in ("app", "blind", "multibody", "test", "dev") for requirement in extras[name]]
    wanted = named(PROJECT["dependencies"] + locked)
    assert wanted - set(pins()) == set()
    assert "streamlit" in pins()


def test_the_environment_is_the_one_of_the_lock():
    from importlib.metadata import PackageNotFoundError, version

    for package in ("numpy", "scipy", "numba", "ruckig", "pydantic"):
        try:
            assert version(package) == pins()[package], package
        except PackageNotFoundError:
            pytest.fail(f"{package} is not installed")


def test_version_is_the_same_everywhere():
    first_entry = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert first_entry
    assert first_entry[1] == workbench.__version__ == PROJECT["version"]


def test_no_file_names_a_folder_of_one_machine():
    hits = [f"{name}: {hit[0]}" for name, text in tracked_text() for hit in MACHINE_PATH.finditer(text)]
    assert hits == []


def test_no_file_names_a_host_beyond_the_few_that_stay():
    hits = {f"{name}: {hit[1]}" for name, text in tracked_text() for hit in HOST.finditer(text)}
    assert {line for line in hits if line.rsplit(": ")[1] not in ALLOWED_HOSTS} == set()


def test_nobody_is_told_to_install_workbench_by_its_name():
    """By name pip fetches whatever bears it on an index; from a checkout it is '.[app]'."""
    by_name = re.compile(r"pip3? install[^\n`]*[\s'\"]workbench(?:\[|['\"`\s]|$)")
    assert by_name.search("pip install -q 'work|bench[app]'".replace("|", ""))  # this file passes its own rule
    assert [name for name, text in tracked_text() if by_name.search(text)] == []


def test_what_the_house_forbids_is_seen_and_what_it_allows_is_not():
    """Spelt so that this file passes its own rules."""
    for text in ("see |home|eve", 'open("|root|a")', "cd |opt|tool", "file:|||Users|eve"):
        assert MACHINE_PATH.search(text.replace("|", "/")), text
    for text in ("../shared/work/x", "a/home/b", "results/root/", "PATH/opt/x"):
        assert not MACHINE_PATH.search(text), text
    for text in ("https://a|example|org/simple", "get it from files|example|com", "http://10|0|0|1:80"):
        hit = HOST.search(text.replace("|", "."))
        assert hit and hit[1] not in ALLOWED_HOSTS, text
    for text in ("import plotly.io", "scipy.io.loadmat", "a.common_b", "run.commands"):
        assert not HOST.search(text), text


def test_the_readme_has_a_row_for_every_command():
    rows = re.findall(r"^\| `workbench ([\w-]+)\b", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_for_itself_and_each_option(name: str):
    where, line = COMMANDS[name]
    module, attribute = where.split(":")
    command = getattr(importlib.import_module(module), attribute)
    assert isinstance(command, click.Command)
    assert line.endswith(".") and len(line) <= 70
    assert command.help and command.help.strip()
    silent = [p.name for p in command.params if isinstance(p, click.Option) and not p.help]
    assert silent == [], f"options of {name} without help"


def exit_of(words: list[str]) -> object:
    with pytest.raises(SystemExit) as ended:
        main(words)
    return ended.value.code


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch):
    """Makes `workbench replay --out DIR` end with the given exception or value."""

    def arrange(outcome: BaseException | int | None) -> None:
        @click.command()
        @click.option("--out", help="folder")
        def command(out: str | None) -> int | None:
            if isinstance(outcome, BaseException):
                raise outcome
            return outcome

        monkeypatch.setattr(type(cli), "get_command", lambda self, ctx, name: command)

    return arrange


@pytest.mark.parametrize(
    ("outcome", "status", "line"),
    [
        (None, 0, ""),
        (1, 1, ""),
        (InputError("unknown key 'mas'", file="m.yaml", line=3), 2, "error: m.yaml:3: unknown key 'mas'\n"),
        (OSError(28, "No space left on device"), 2, "error: there: No space left on device\n"),
        (PermissionError(13, "Permission denied", "r/x.json"), 2, "error: r/x.json: Permission denied\n"),
        (OSError("arrow could not open it\nat frame 7"), 2, "error: there: arrow could not open it\n"),
        (MemoryError(), 2, "error: not enough memory for this input; try fewer or shorter runs\n"),
        (KeyboardInterrupt(), 130, "\ninterrupted\n"),
    ],
)
def test_a_command_ends_with_one_line_and_a_status(failing, capsys, outcome, status: int, line: str):
    failing(outcome)
    assert exit_of(["replay", "--out", "there"]) == status
    assert capsys.readouterr().err == line


def test_a_defect_of_workbench_is_never_hidden(failing):
    failing(ZeroDivisionError("a defect"))
    with pytest.raises(ZeroDivisionError):
        main(["replay"])


def test_version_and_help_are_printed(capsys):
    assert exit_of(["--version"]) == 0
    assert capsys.readouterr().out == f"workbench {workbench.__version__}\n"
    assert exit_of(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(name in out and line in out for name, (_, line) in COMMANDS.items())


def test_a_reader_that_leaves_early_is_no_error():
    code = "import workbench.cli as c; c.cli.format_help = lambda *a: print('x' * 10**6); c.main(['--help'])"
    program = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert program.stdout and program.stderr
    program.stdout.close()
    assert program.stderr.read() == b""
    program.stderr.close()
    assert program.wait(10) == 1


def test_the_wheel_carries_every_module_and_every_file_beside_them(tmp_path: Path):
    builders = pytest.importorskip("hatchling.builders.wheel", reason="hatchling is not installed")
    (built,) = builders.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    inside = set(zipfile.ZipFile(built).namelist())
    ours = {
        str(p.relative_to(ROOT))
        for p in (ROOT / "workbench").rglob("*")
        if p.is_file() and "__pycache__" not in p.parts
    }
    assert ours - inside == set()


# Ctrl-C reaches what the tests start, whatever shell runs them.


@pytest.mark.skipif(os.name != "posix", reason="allowed: signals of POSIX")
def test_tests_and_their_children_hear_ctrl_c_though_the_shell_ignores_it():
    child = "import signal; print(signal.getsignal(signal.SIGINT) == signal.SIG_IGN)"
    code = f"import subprocess, sys, tests.conftest; subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    ignoring = ["sh", "-c", 'trap "" INT; exec "$0" "$@"', sys.executable, "-c"]
    without = subprocess.run([*ignoring, child], cwd=ROOT, capture_output=True, text=True, check=True)
    with_it = subprocess.run([*ignoring, code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (without.stdout.strip(), with_it.stdout.strip()) == ("True", "False")
    assert signal.getsignal(signal.SIGINT) != signal.SIG_IGN
