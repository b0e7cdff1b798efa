"""A campaign that a browser sends: a zip of its folder, or its files.

What comes is bytes under names that a stranger chose. It is bounded before it is unpacked, the runs.yaml
in it decides which logs are looked at, and those are written below a folder of generated name in the
session's workspace, under names that are checked to be plain. Then the strict reader reads them; nothing
is ever executed. Whatever does not fit is an InputError that names the file as it was uploaded.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from workbench.dashboard.uploads.zip_members import MB, Files, unzipped
from workbench.effects import check
from workbench.errors import InputError, nearest
from workbench.logs import Campaign, read_campaign
from workbench.yaml_strict import Document, Place, loads

MACHINE, RUNS = "machine.yaml", "runs.yaml"
MOST_UPLOADED, MOST_FILES = 50 * MB, 200
KEPT = 3  # campaigns of a session; older ones go
_PREFIX = "campaign-"
_PART = re.compile(r"\w[\w .()+=,@~#%&-]{0,99}")
_NAME = re.compile(r"[^\w .()+=@~-]")


@dataclass(frozen=True)
class Uploaded:
    """A file as the browser sent it."""

    name: str
    content: bytes


def read_uploaded(uploads: Sequence[Uploaded], workspace: Path) -> Campaign:
    """The campaign in the uploaded files, kept below `workspace`. Only InputError comes out of it."""
    folder: Path | None = None
    try:
        files, name = _files(uploads)
        folder = _stored(files, workspace)
        campaign = read_campaign(folder, confined=True, uploaded=True, check_effects=check)
    except BaseException as error:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, InputError):
            raise _as_uploaded(error, folder) from error
        raise
    return replace(campaign, name=name)


def _files(uploads: Sequence[Uploaded]) -> tuple[Files, str]:
    """The files by their path beside runs.yaml, and what to call the campaign."""
    if not uploads:
        raise InputError(f"nothing was uploaded; expected a zip, or {MACHINE}, {RUNS} and logs")
    if len(uploads) > MOST_FILES:
        raise InputError(f"{len(uploads)} files, expected at most {MOST_FILES}; upload a zip of the folder")
    total = sum(len(upload.content) for upload in uploads)
    if total > MOST_UPLOADED:
        raise InputError(f"{total / MB:.0f} MB were uploaded, expected at most {MOST_UPLOADED // MB} MB")
    zips = [upload for upload in uploads if base_name(upload.name).lower().endswith(".zip")]
    if zips and len(uploads) > 1:
        raise InputError("came with other files; expected one zip alone, or no zip", file=base_name(zips[0].name))
    if zips:
        name = base_name(zips[0].name)
        return unzipped(zips[0].content, name, RUNS), plain_title(name[: -len(".zip")])
    files: dict[str, bytes] = {}
    for upload in uploads:
        name = base_name(upload.name)
        if name in files:
            raise InputError("was uploaded twice; upload a zip where logs in two folders share a name", file=name)
        files[name] = upload.content
    return Files(files, nested=False), "uploaded"


def base_name(name: str) -> str:
    """The last part of a name, whatever its sender thought a folder is; fit to be shown in one line."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(c if c.isprintable() else "?" for c in last)[:100] or "a file without a name"


def plain_title(name: str) -> str:
    return _NAME.sub("_", name)[:60].strip() or "uploaded"


def _stored(files: Files, workspace: Path) -> Path:
    """Writes machine.yaml, runs.yaml and the logs that it names into a new folder; nothing else of what came."""
    for needed in (MACHINE, RUNS):
        if needed not in files:
            raise InputError(f"is missing; {nearest(needed, files.names[:20])}", file=needed)
    chosen: dict[PurePosixPath, bytes] = {}
    for path, place, document in _logs(files[RUNS]):
        content = _content(files, path, place, document)
        if content is not None:
            chosen[path] = content
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=workspace))
    try:
        for name in (MACHINE, RUNS):
            (folder / name).write_bytes(files[name])
        for path, content in chosen.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("xb") as stream:
                stream.write(content)
    except OSError as error:  # two names that differ by capitals only, a file where another needs a folder
        shutil.rmtree(folder, ignore_errors=True)
        raise InputError(f"its logs cannot be stored side by side: {error.strerror}", file=RUNS) from error
    _forget_oldest(workspace, folder)
    return folder


def _forget_oldest(workspace: Path, newest: Path) -> None:
    """What a session has uploaded before stays for a while only."""
    older = sorted((f for f in workspace.glob(f"{_PREFIX}*") if f != newest), key=lambda f: f.stat().st_mtime)
    for folder in older[: max(0, len(older) + 1 - KEPT)]:
        shutil.rmtree(folder, ignore_errors=True)


def _logs(content: bytes) -> list[tuple[PurePosixPath, Place, Document]]:
    """The logs that runs.yaml names, each once. What is wrong in kind is left for the strict reader to say."""
    document = _runs_document(content)
    data = document.data
    entries = data.get("runs") if isinstance(data, Mapping) else None
    logs: dict[PurePosixPath, tuple[PurePosixPath, Place, Document]] = {}
    for index, entry in enumerate(entries if isinstance(entries, list) else []):
        named = entry.get("file") if isinstance(entry, Mapping) else None
        if isinstance(named, str):
            place: Place = ("runs", index, "file")
            path = _plain_path(named, place, document)
            logs.setdefault(path, (path, place, document))
    return list(logs.values())


def _runs_document(content: bytes) -> Document:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"byte 0x{content[error.start]:02x} is not UTF-8 text", file=RUNS, line=line) from error
    return loads(text, RUNS)


def _plain_path(named: str, place: Place, document: Document) -> PurePosixPath:
    """A path of plain names below the folder. InputError for what could lead anywhere else."""
    parts = named.split("/")
    if len(parts) > 4 or not all(_PART.fullmatch(part) and part[-1] not in ". " for part in parts):
        shown = named if len(named) <= 60 else named[:57] + "…"
        raise InputError(
            f"{shown!r} is no plain path in the campaign's folder, such as runs/lift.csv",
            file=RUNS, line=document.line(place), place=f"runs[{place[1]}].file",
        )  # fmt: skip
    return PurePosixPath(*parts)


def _content(files: Files, path: PurePosixPath, place: Place, document: Document) -> bytes | None:
    """The bytes of a log; None for the two files that are stored anyway."""
    if str(path) in (MACHINE, RUNS):
        return None
    name = str(path) if files.nested else path.name
    if name not in files:
        logs = [known for known in files.names if known not in (MACHINE, RUNS)]
        hint = nearest(name, logs[:20]) if logs else "no logs were uploaded"
        raise InputError(
            f"'{name}' was not uploaded; {hint}", file=RUNS, line=document.line(place), place=f"runs[{place[1]}].file"
        )
    return files[name]


def _as_uploaded(error: InputError, folder: Path | None) -> InputError:
    """The same error with the names that the user knows instead of the workspace's paths, and nothing unprintable."""

    def known(text: str) -> str:
        for root in () if folder is None else dict.fromkeys((str(folder), str(folder.resolve()))):
            text = text.replace(f"{root}/", "").replace(root, "the campaign")
        return "".join(c if c.isprintable() or c == "\n" else "?" for c in text)

    file = None if error.file is None else known(error.file)
    place = None if error.place is None else known(error.place)
    return InputError(known(error.problem), file=file, line=error.line, place=place)
