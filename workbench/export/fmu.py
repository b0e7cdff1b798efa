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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal
from xml.etree import ElementTree as ET

from workbench import __version__
from workbench.errors import InputError, nearest
from workbench.export.model import Model
from workbench.export.variables import BASE, DISPLAYED, Variable, over_time

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
    targets = targets_of(usual_targets() if platforms is None else platforms)
    with tempfile.TemporaryDirectory(prefix="workbench-fmu-") as name:
        folder = Path(name)
        sources = folder / "sources"
        write_sources(model, sources, version)
        (folder / "modelDescription.xml").write_text(model_description(model, version), encoding="utf-8")
        if version == "3.0":
            (sources / "buildDescription.xml").write_text(build_description(model), encoding="utf-8")
        for target in targets:
            said(f"compiling for {target} ...")
            place = TARGETS[target]
            binary = f"binaries/{place.fmi3 if version == '3.0' else place.fmi2}/{model.identifier}.{place.ending}"
            shared_library(sources, c_files(version), target, folder / binary)
        _zip(folder, out)
    return targets


def c_files(version: FmiVersion) -> tuple[str, ...]:
    """The files that are compiled."""
    return (interface_file(version), *SOURCES)


def write_sources(model: Model, folder: Path, version: FmiVersion) -> None:
    """The C files of a model, all that are needed but the standard's own headers."""
    folder.mkdir(parents=True)
    for name in ("core.c", "core.h", "model.h", interface_file(version)):
        (folder / name).write_text((WRITTEN_BY_HAND / name).read_text(encoding="utf-8"), encoding="utf-8")
    for name, text in model.code.items():
        (folder / name).write_text(text, encoding="utf-8")


def _zip(folder: Path, out: Path) -> None:
    handle, temporary = tempfile.mkstemp(prefix=f".{out.name}.", dir=out.resolve().parent)
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(path for path in folder.rglob("*") if path.is_file()):
                entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), MOMENT)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, file.read_bytes())
        os.chmod(temporary, 0o644)
        os.replace(temporary, out)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", file=out) from error
    finally:
        if os.path.exists(temporary):
            os.unlink(temporary)


# The description.


def interface_file(version: FmiVersion) -> str:
    """The C file of the interface."""
    return f"fmi{version[0]}.c"


def model_description(model: Model, version: FmiVersion) -> str:
    """modelDescription.xml, checked in tests against the standard's schema."""
    return _text(_version3(model) if version == "3.0" else _version2(model))


def build_description(model: Model) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for name in (interface_file("3.0"), *SOURCES):
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _number(value: float) -> str:
    return repr(float(value))


def _head(model: Model, version: FmiVersion, token: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            token: model.token,
            "description": model.description,
            "generationTool": TOOL,
            "variableNamingConvention": "structured",
        },
    )


def _version3(model: Model) -> ET.Element:
    root = _head(model, "3.0", "instantiationToken")
    slopes = "false" if model.controlled else "true"
    ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": slopes,
            "providesAdjointDerivatives": slopes,
            "canHandleVariableCommunicationStepSize": "true",
        },
    )
    _units(root, model)
    _categories(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(10.0 * model.step_s))
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(model.variables):
        attributes = _common(v, reference)
        if not v.boolean:
            attributes |= _real(v)
            if v.derivative_of is not None:
                attributes["derivative"] = str(model.reference(v.derivative_of))
        ET.SubElement(variables, "Boolean" if v.boolean else "Float64", attributes)
    structure = ET.SubElement(root, "ModelStructure")
    for name in _named(model, "output"):
        ET.SubElement(structure, "Output", valueReference=str(model.reference(name)), **_reads(model, name, 0))
    for state in model.states:
        name = f"der({state})"
        reference = str(model.reference(name))
        ET.SubElement(structure, "ContinuousStateDerivative", valueReference=reference, **_reads(model, name, 0))
    for name in _initial(model):
        ET.SubElement(structure, "InitialUnknown", valueReference=str(model.reference(name)))
    return root


def _version2(model: Model) -> ET.Element:
    root = _head(model, "2.0", "guid")
    simulation = ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canHandleVariableCommunicationStepSize": "true",
            "canInterpolateInputs": "false" if model.controlled else "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": "false" if model.controlled else "true",
        },
    )
    files = ET.SubElement(simulation, "SourceFiles")
    for name in (interface_file("2.0"), *SOURCES):
        ET.SubElement(files, "File", name=name)
    _units(root, model)
    _categories(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(10.0 * model.step_s))
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(model.variables):
        scalar = ET.SubElement(variables, "ScalarVariable", _common(v, reference, start=False))
        if v.boolean:
            ET.SubElement(scalar, "Boolean", start=_start(v) or "false")
            continue
        attributes = _real(v)
        if v.start is not None:
            attributes["start"] = _number(v.start)
        if v.derivative_of is not None:
            attributes["derivative"] = str(model.reference(v.derivative_of) + 1)
        ET.SubElement(scalar, "Real", attributes)
    structure = ET.SubElement(root, "ModelStructure")
    _unknowns2(structure, "Outputs", model, _named(model, "output"))
    _unknowns2(structure, "Derivatives", model, (f"der({name})" for name in model.states))
    _unknowns2(structure, "InitialUnknowns", model, _initial(model))
    return root


def _unknowns2(structure: ET.Element, element: str, model: Model, names: Iterable[str]) -> None:
    block = ET.SubElement(structure, element)
    for name in sorted(names, key=model.reference):
        reads = {} if element == "InitialUnknowns" else _reads(model, name, 1)
        ET.SubElement(block, "Unknown", index=str(model.reference(name) + 1), **reads)


def _reads(model: Model, name: str, first: int) -> dict[str, str]:
    """The attribute that lists what an unknown depends on; none where that is not known, which means everything."""
    if name not in model.dependencies:
        return {}
    return {"dependencies": " ".join(str(model.reference(x) + first) for x in model.dependencies[name])}


def _named(model: Model, causality: str) -> list[str]:
    return [v.name for v in model.variables if v.causality == causality]


def _initial(model: Model) -> list[str]:
    """What is to be computed before the first step: outputs, calculated parameters, states and their derivatives."""
    wanted = {*_named(model, "output"), *_named(model, "calculatedParameter"), *model.states}
    wanted |= {f"der({name})" for name in model.states}
    return [v.name for v in model.variables if v.name in wanted]


def _start(v: Variable) -> str | None:
    if v.start is None:
        return None
    return ("true" if v.start else "false") if v.boolean else _number(v.start)


def _common(v: Variable, reference: int, start: bool = True) -> dict[str, str]:
    attributes = {
        "name": v.name,
        "valueReference": str(reference),
        "description": v.meaning,
        "causality": v.causality,
        "variability": v.variability,
    }
    if v.causality in ("output", "local", "calculatedParameter"):
        attributes["initial"] = "calculated"
    if v.causality == "parameter":
        attributes["initial"] = "exact"
    if start and (said := _start(v)) is not None:
        attributes["start"] = said
    return attributes


def _real(v: Variable) -> dict[str, str]:
    attributes = {}
    if unit := _unit(v):
        attributes["unit"] = unit
    if unit in DISPLAYED:
        attributes["displayUnit"] = DISPLAYED[unit][0]
    if math.isfinite(v.range.lowest):
        attributes["min"] = _number(v.range.lowest)
    if math.isfinite(v.range.highest):
        attributes["max"] = _number(v.range.highest)
    return attributes


def _unit(v: Variable) -> str:
    if v.derivative_of is None:
        return v.unit
    of = Variable(v.derivative_of, "", "local", "continuous", "SHOWN", 0)
    return over_time(of.unit)


def _units(root: ET.Element, model: Model) -> None:
    used = sorted({_unit(v) for v in model.variables} - {""})
    block = ET.SubElement(root, "UnitDefinitions")
    for name in used:
        unit = ET.SubElement(block, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in BASE[name].items()})
        if name in DISPLAYED:
            shown, factor = DISPLAYED[name]
            ET.SubElement(unit, "DisplayUnit", name=shown, factor=_number(factor))


def _categories(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    for name, meaning in {
        "logStatusWarning": "what is odd, and goes on",
        "logStatusDiscard": "a value that was not taken",
        "logStatusError": "what cannot go on",
    }.items():
        ET.SubElement(categories, "Category", name=name, description=meaning)


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
