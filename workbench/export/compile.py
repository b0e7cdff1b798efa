"""C files to a shared library, for this computer or another one: by ziglang's compiler, else by the host's own."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from workbench.errors import InputError, nearest

FLAGS = ("-std=c99", "-O2", "-g0", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
HEADERS = Path(__file__).with_name("c") / "fmi"
MOST_S = 3600.0  # the first build for another system compiles that system's C library too


@dataclass(frozen=True)
class Target:
    """triple: as zig calls it, with an old C library so that old systems run it. fmi2, fmi3: folders of binaries."""

    triple: str
    fmi2: str
    fmi3: str
    ending: str


TARGETS: Mapping[str, Target] = MappingProxyType(
    {
        "linux-x86_64": Target("x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", "so"),
        "linux-aarch64": Target("aarch64-linux-gnu.2.17", "aarch64-linux", "aarch64-linux", "so"),
        "windows-x86_64": Target("x86_64-windows-gnu", "win64", "x86_64-windows", "dll"),
        "macos-aarch64": Target("aarch64-macos", "darwin64", "aarch64-darwin", "dylib"),
    }
)
ALL = tuple(TARGETS)


def host() -> str | None:
    """This computer among the targets; None where it is another one."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    name = f"{system}-{machine}"
    return name if name in TARGETS else None


def has_zig() -> bool:
    return importlib.util.find_spec("ziglang") is not None


def host_compiler() -> str | None:
    """The host's C compiler: CC, else cc, gcc or clang."""
    named = os.environ.get("CC")
    return next((path for name in (named, "cc", "gcc", "clang") if name and (path := shutil.which(name))), None)


def usual_targets() -> tuple[str, ...]:
    """All with ziglang, else this computer alone."""
    if has_zig():
        return ALL
    here = host()
    return (here,) if here is not None else ()


def targets_of(names: Sequence[str]) -> tuple[str, ...]:
    """Checked names of targets, each once. InputError for an unknown one, or one that no compiler here makes."""
    for name in names:
        if name not in TARGETS:
            raise InputError(f"unknown platform '{name}'; {nearest(name, TARGETS)}", place="platforms")
        compiler(name)
    return tuple(dict.fromkeys(names))


def compiler(target: str) -> list[str]:
    """The words of a compiler for a target. InputError, in one line, where there is none."""
    if target == host() and (own := host_compiler()) is not None:
        return [own]
    if has_zig():
        # The oldest processor of its kind: a binary for this one stops on others.
        cpu = ["-mcpu=baseline"] if "x86_64" in target else []
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target].triple, *cpu]
    if target == host():
        raise InputError("no C compiler is here; install one, or the extra: pip install '.[fmu]'")
    raise InputError(f"a binary for {target} takes the extra: pip install '.[fmu]'; "
                     f"without it only {host() or 'none'} can be made")  # fmt: skip


def shared_library(folder: Path, files: Sequence[str], target: str, to: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compiles files of a folder to `to`. InputError with the compiler's first complaint where that fails."""
    words = [*compiler(target), *flags, f"-I{HEADERS}", *files, "-o", str(to.resolve())]
    if not target.startswith("windows"):
        words.append("-lm")
    to.parent.mkdir(parents=True, exist_ok=True)
    try:
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=MOST_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"the C compiler did not end within {MOST_S / 60.0:.0f} minutes", place=target) from error
    except OSError as error:
        raise InputError(f"the C compiler cannot be run: {error.strerror or error}", place=target) from error
    if done.returncode != 0 or not to.is_file():
        lines = [line for line in (done.stderr or done.stdout).splitlines() if "error" in line.lower()]
        raise InputError(f"the C compiler failed: {(lines or ['without a word'])[0]}", place=target)
    for leftover in to.parent.iterdir():  # import library and debug data of Windows
        if leftover.suffix in (".lib", ".pdb"):
            leftover.unlink()
