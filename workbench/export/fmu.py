"""An exported model as one .fmu file: description, sources, binaries."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.export.compile import TARGETS, shared_library, targets_of, usual_targets
from workbench.export.description import SOURCES, FmiVersion, build_description, interface_file, model_description
from workbench.export.model import Model

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
        raise InputError("is there already; nothing is overwritten, choose another --out", file=out)
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
