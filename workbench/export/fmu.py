"""An exported model as one .fmu file: its description, its C sources, and binaries for the platforms asked for.

Binaries are made by the host's own compiler for this computer, else by ziglang's.
"""

from __future__ import annotations

import importlib.util
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from workbench import __version__
from workbench.core.errors import InputError, check_known
from workbench.core.templates import render
from workbench.export.model import Model, Variable, exponents, symbols

FmiVersion = Literal["2.0", "3.0"]
SOURCES = ("model.c", "core.c")  # beside the interface's own file
TOOL = f"workbench {__version__}"
WRITTEN_BY_HAND = Path(__file__).with_name("c")
MOMENT = (2000, 1, 1, 0, 0, 0)  # of every file inside, so that one machine gives one file


def write_fmu(
    model: Model,
    out: Path,
    version: FmiVersion = "3.0",
    platforms: Sequence[str] | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> tuple[str, ...]:
    """Writes the FMU whole or not at all; returns the platforms that it has binaries for.

    platforms: names of `compile.TARGETS`; None: all that can be compiled here; none at all: sources only.
    said: is told what is being compiled. InputError where `out` is there already, where a platform has no compiler
    here, where the compiler fails.
    """
    if os.path.lexists(out):
        raise InputError("is there already; nothing is overwritten, choose another file", file=out)
    if not out.resolve().parent.is_dir():
        raise InputError(f"cannot be written: there is no folder {out.parent}", file=out)
    targets = targets_of(platforms)
    with tempfile.TemporaryDirectory(prefix="workbench-fmu-") as name:
        folder = Path(name)
        sources = folder / "sources"
        write_sources(model, sources, version)
        (folder / "modelDescription.xml").write_text(model_description(model, version), encoding="utf-8")
        if version == "3.0":
            build = render("export/description/build.xml", model=model, files=c_files("3.0"))
            (sources / "buildDescription.xml").write_text(build, encoding="utf-8")
        for target in targets:
            said(f"compiling for {target} ...")
            place = TARGETS[target]
            binary = f"binaries/{place.fmi3 if version == '3.0' else place.fmi2}/{model.identifier}.{place.ending}"
            shared_library(sources, c_files(version), target, folder / binary)
        _zip(folder, out)
    return targets


def c_files(version: FmiVersion) -> tuple[str, ...]:
    """The files that are compiled."""
    return (f"fmi{version[0]}.c", *SOURCES)


def write_sources(model: Model, folder: Path, version: FmiVersion) -> None:
    """The C files of a model, all that are needed but the standard's own headers."""
    folder.mkdir(parents=True)
    for name in ("core.c", "core.h", "model.h", c_files(version)[0]):
        (folder / name).write_text((WRITTEN_BY_HAND / name).read_text(encoding="utf-8"), encoding="utf-8")
    for name, text in model.code.items():
        (folder / name).write_text(text, encoding="utf-8")


def _zip(folder: Path, out: Path) -> None:
    hidden = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        with zipfile.ZipFile(hidden, "x", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(path for path in folder.rglob("*") if path.is_file()):
                entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), MOMENT)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, file.read_bytes())
        os.replace(hidden, out)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", file=out) from error
    finally:
        hidden.unlink(missing_ok=True)


# The description.


def model_description(model: Model, version: FmiVersion) -> str:
    """modelDescription.xml, checked in tests against the standard's schema."""
    first = 1 if version == "2.0" else 0  # FMI 2.0 counts variables from 1, FMI 3.0 names their references
    slopes = [f"der({name})" for name in model.states]
    outputs = [v.name for v in model.variables if v.causality == "output"]
    # To be computed before the first step.
    held = [v.name for v in model.variables if v.causality == "calculatedParameter"]
    wanted = {*outputs, *held, *model.states, *slopes}
    displayed, units = symbols()["displayed"], sorted({v.unit for v in model.variables} - {""})
    return render(
        f"export/description/fmi{version[0]}.xml",
        model=model,
        head={
            "modelName": model.name, "description": model.description, "generationTool": TOOL,
            "variableNamingConvention": "structured",
        },
        files=c_files(version),
        units=[(unit, exponents(unit), displayed.get(unit)) for unit in units],
        common=_common,
        real=lambda v: _real(model, v, first),
        # No list stands for everything.
        reads=lambda name: {"dependencies": " ".join(str(model.reference(x) + first) for x in model.dependencies[name])}
        if name in model.dependencies else {},
        in_order=lambda names: sorted(names, key=model.reference),
        outputs=outputs,
        slopes_of=slopes,
        initial=[v.name for v in model.variables if v.name in wanted],
    )  # fmt: skip


def _common(v: Variable) -> dict[str, str]:
    """The attributes of any variable; the reference is its place."""
    attributes = {"name": v.name, "description": v.meaning, "causality": v.causality, "variability": v.variability}
    if v.causality not in ("independent", "input"):
        attributes["initial"] = "exact" if v.causality == "parameter" else "calculated"
    if v.start is not None:
        attributes["start"] = ("true" if v.start else "false") if v.boolean else repr(float(v.start))
    return attributes


def _real(model: Model, v: Variable, first: int) -> dict[str, str]:
    """The attributes of a number."""
    if v.boolean:
        return {}
    shown = symbols()["displayed"].get(v.unit)
    limits = {"min": v.range.lowest, "max": v.range.highest}
    attributes = {"unit": v.unit, "displayUnit": shown[0] if shown else ""}
    attributes |= {name: repr(float(limit)) for name, limit in limits.items() if math.isfinite(limit)}
    if v.derivative_of is not None:
        attributes["derivative"] = str(model.reference(v.derivative_of) + first)
    return {name: value for name, value in attributes.items() if value}


# The compiler.

FLAGS = ("-std=c99", "-O2", "-g0", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
HEADERS = WRITTEN_BY_HAND / "fmi"
MOST_S = 3600.0  # the first build for another system compiles that system's C library too


@dataclass(frozen=True)
class Target:
    """triple: as zig calls it, with an old C library so that old systems run it. fmi2, fmi3: folders of binaries."""

    triple: str
    fmi2: str
    fmi3: str
    ending: str


TARGETS: Mapping[str, Target] = {
    "linux-x86_64": Target("x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", "so"),
    "linux-aarch64": Target("aarch64-linux-gnu.2.17", "aarch64-linux", "aarch64-linux", "so"),
    "windows-x86_64": Target("x86_64-windows-gnu", "win64", "x86_64-windows", "dll"),
    "macos-aarch64": Target("aarch64-macos", "darwin64", "aarch64-darwin", "dylib"),
}
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
    names = (os.environ.get("CC"), "cc", "gcc", "clang")
    return next((path for name in names if name and (path := shutil.which(name))), None)


def targets_of(names: Sequence[str] | None) -> tuple[str, ...]:
    """Checked names of targets, each once; None: all with ziglang, else this computer alone. InputError for an unknown
    one, or one that no compiler here makes."""
    if names is None:
        names = ALL if has_zig() else [name for name in [host()] if name]
    for name in names:
        check_known("unknown platform", name, TARGETS, place="platforms")
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
    extra = "the extra: pip install '.[fmu]'"
    if target == host():
        raise InputError(f"no C compiler is here; install one, or {extra}")
    raise InputError(f"a binary for {target} takes {extra}; without it only {host() or 'none'} can be made")


def shared_library(folder: Path, files: Sequence[str], target: str, to: Path) -> None:
    """Compiles files of a folder to `to`. InputError with the compiler's first complaint where that fails."""
    words = [*compiler(target), *FLAGS, f"-I{HEADERS}", *files, "-o", str(to.resolve())]
    if not target.startswith("windows"):
        words.append("-lm")
    to.parent.mkdir(parents=True, exist_ok=True)
    try:
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=MOST_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"the C compiler cannot be run or does not end: {error}", place=target) from error
    if done.returncode != 0 or not to.is_file():
        lines = [line for line in (done.stderr or done.stdout).splitlines() if "error" in line.lower()]
        raise InputError(f"the C compiler failed: {(lines or ['without a word'])[0]}", place=target)
    for leftover in to.parent.iterdir():  # import library and debug data of Windows
        if leftover.suffix in (".lib", ".pdb"):
            leftover.unlink()
