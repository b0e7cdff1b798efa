"""A campaign that a browser sends: a zip of its folder, or its files.

What comes is bytes under names that a stranger chose. The runs.yaml in it decides which logs are looked at; only these
are unpacked, within limits, into a folder of generated name, under names that are checked to be plain. Then the strict
reader reads them. Nothing is executed. What does not fit is an InputError that names the file as it was uploaded.
"""

from __future__ import annotations

import io
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from workbench.core.errors import InputError, nearest
from workbench.core.yaml_strict import Document, Place, loads
from workbench.effects import check
from workbench.logs import Campaign, read_campaign

MACHINE, RUNS = "machine.yaml", "runs.yaml"
MB = 1_000_000
MOST_UPLOADED, MOST_FILES = 50 * MB, 200
MOST_UNPACKED, MOST_MEMBERS = 200 * MB, 1000
KEPT = 3  # campaigns of a visitor; older ones are removed
PREFIX = "campaign-"
_CHUNK = 1 << 20
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
        files = _checked(uploads)
        name, content = next(iter(files.items()))
        if name.lower().endswith(".zip"):
            folder = _from_zip(name, content, workspace)
        else:
            said = re.search(rb"^name:[ \t]*(.+)$", files.get(MACHINE, b"")[: 10 * _CHUNK], re.MULTILINE)
            called = said[1].decode("utf-8", errors="replace").strip(" '\"\r") if said else ""  # as their machine
            folder = _stored(called, sorted(files), files.__getitem__, workspace, nested=False)
        return read_stored(folder)
    except InputError as error:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        raise _as_uploaded(error, folder) from error


def stored_campaigns(workspace: Path) -> list[Path]:
    """The folders of campaigns that were uploaded into a workspace, the oldest first."""
    return sorted(workspace.glob(f"{PREFIX}*"), key=lambda folder: folder.stat().st_mtime_ns)


def name_of(folder: Path) -> str:
    """What such a campaign is called: its folder is named campaign-NAME-RANDOM."""
    return folder.name.removeprefix(PREFIX).rpartition("-")[0]


def read_stored(folder: Path) -> Campaign:
    """A campaign that was uploaded before."""
    campaign = read_campaign(folder, confined=True, uploaded=True, check_effects=check)
    return replace(campaign, name=name_of(folder))


def _checked(uploads: Sequence[Uploaded]) -> dict[str, bytes]:
    """Base name -> bytes of one zip, or of files; within the limits."""
    if not uploads:
        raise InputError(f"nothing was uploaded; expected a zip, or {MACHINE}, {RUNS} and logs")
    if len(uploads) > MOST_FILES:
        raise InputError(f"{len(uploads)} files, expected at most {MOST_FILES}; upload a zip of the folder")
    total = sum(len(upload.content) for upload in uploads)
    if total > MOST_UPLOADED:
        raise InputError(f"{total / MB:.0f} MB were uploaded, expected at most {MOST_UPLOADED // MB} MB")
    files: dict[str, bytes] = {}
    for upload in uploads:
        name = base_name(upload.name)
        if name.lower().endswith(".zip") and len(uploads) > 1:
            raise InputError("came with other files; expected one zip alone, or no zip", file=name)
        if name in files:
            raise InputError("was uploaded twice; upload a zip where logs in two folders share a name", file=name)
        files[name] = upload.content
    return files


def safe_name(name: str) -> str:
    """A name without what leads to another folder, at most 60 characters; it may be empty."""
    return _NAME.sub("_", name)[:60].strip(" .") if name.strip(".") else ""


def base_name(name: str) -> str:
    """The last part of a name, whatever its sender takes for a folder; fit to be shown in one line."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(c if c.isprintable() else "?" for c in last)[:100] or "a file without a name"


def _from_zip(name: str, content: bytes, workspace: Path) -> Path:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members, left = _members(archive, name), MOST_UNPACKED

            def read(path: str) -> bytes:
                """Counted while it is read, for the size in the directory is not trusted."""
                nonlocal left
                member, parts = members[path], []
                if member.flag_bits & 0x1:
                    raise InputError("is encrypted; expected a zip without a password", file=name)
                if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    said = "is packed in a way that is not read; expected a plain (deflate) zip"
                    raise InputError(said, file=name)
                with archive.open(member) as stream:
                    while chunk := stream.read(_CHUNK):
                        left -= len(chunk)
                        if left < 0:
                            raise InputError(f"unpacks to more than {MOST_UNPACKED // MB} MB", file=name)
                        parts.append(chunk)
                return b"".join(parts)

            return _stored(name[:-4], sorted(members), read, workspace, nested=True)
    except InputError:
        raise
    except Exception as error:  # a damaged zip makes the library raise almost anything
        raise InputError("is not a readable zip file; zip the campaign's folder again", file=name) from error


def _members(archive: zipfile.ZipFile, zip_name: str) -> dict[str, zipfile.ZipInfo]:
    """The members in the folder of the one runs.yaml, by their path beside it."""
    infos = [info for info in archive.infolist() if not info.is_dir()]
    if len(infos) > MOST_MEMBERS:
        raise InputError(f"holds {len(infos)} files, expected at most {MOST_MEMBERS}", file=zip_name)
    members: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        name = info.filename.removeprefix("./")
        if name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith("."):  # added by operating systems
            continue
        if name in members:
            raise InputError(f"holds '{name[:60]}' twice", file=zip_name)
        members[name] = info
    roots = [name.removesuffix(RUNS) for name in members if name == RUNS or name.endswith(f"/{RUNS}")]
    if len(roots) != 1:
        none = "no runs.yaml; expected a zip of a campaign's folder"
        raise InputError(f"holds {f'{len(roots)} campaigns, expected one {RUNS}' if roots else none}", file=zip_name)
    return {name.removeprefix(roots[0]): info for name, info in members.items() if name.startswith(roots[0])}


def _stored(called: str, names: Sequence[str], read: Callable[[str], bytes], workspace: Path, *, nested: bool) -> Path:
    """Writes machine.yaml, runs.yaml and the logs that it names into a new folder, and nothing else.

    nested: names are paths beside runs.yaml, else base names.
    """
    for needed in (MACHINE, RUNS):
        if needed not in names:
            raise InputError(f"is missing; {nearest(needed, names[:20])}", file=needed)
    runs = read(RUNS)
    folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{safe_name(called) or 'uploaded'}-", dir=workspace))
    try:
        (folder / RUNS).write_bytes(runs)
        (folder / MACHINE).write_bytes(read(MACHINE))
        for path, place, document in _logs(runs):
            log = str(path) if nested else path.name
            if log not in names:
                logs = [known for known in names if known not in (MACHINE, RUNS)]
                hint = nearest(log, logs[:20]) if logs else "no logs were uploaded"
                raise _wrong(f"'{log}' was not uploaded; {hint}", place, document)
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("xb") as stream:
                stream.write(read(log))
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):  # two names that differ by capitals only, a file where another needs a folder
            raise InputError(f"its logs cannot be stored side by side: {error.strerror}", file=RUNS) from error
        raise
    for old in [other for other in stored_campaigns(workspace) if other != folder][: 1 - KEPT]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


def _logs(content: bytes) -> list[tuple[PurePosixPath, Place, Document]]:
    """The logs that runs.yaml names, each once. What is wrong in kind is left for the strict reader to say."""
    try:
        document = loads(content.decode("utf-8-sig"), RUNS)
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"byte 0x{content[error.start]:02x} is not UTF-8 text", file=RUNS, line=line) from error
    entries = document.data.get("runs") if isinstance(document.data, Mapping) else None
    logs: dict[PurePosixPath, tuple[PurePosixPath, Place, Document]] = {}
    for index, entry in enumerate(entries if isinstance(entries, list) else []):
        named = entry.get("file") if isinstance(entry, Mapping) else None
        if not isinstance(named, str):
            continue
        place: Place = ("runs", index, "file")
        parts = named.split("/")
        if len(parts) > 4 or not all(_PART.fullmatch(part) and part[-1] not in ". " for part in parts):
            shown = named if len(named) <= 60 else named[:57] + "…"  # it could lead anywhere else
            said = f"{shown!r} is no plain path in the campaign's folder, such as runs/lift.csv"
            raise _wrong(said, place, document)
        path = PurePosixPath(*parts)
        if str(path) not in (MACHINE, RUNS):
            logs.setdefault(path, (path, place, document))
    return list(logs.values())


def _wrong(problem: str, place: Place, document: Document) -> InputError:
    return InputError(problem, file=RUNS, line=document.line(place), place=f"runs[{place[1]}].file")


def _as_uploaded(error: InputError, folder: Path | None) -> InputError:
    """The same error with the names that the user knows instead of the workspace's paths, and nothing unprintable."""

    def known(text: str | None) -> str:
        for root in () if folder is None else dict.fromkeys((str(folder), str(folder.resolve()))):
            text = (text or "").replace(f"{root}/", "").replace(root, "the campaign")
        return "".join(c if c.isprintable() or c == "\n" else "?" for c in text or "")

    place = known(error.place) if error.place is not None else None
    return InputError(known(error.problem), file=known(error.file) or None, line=error.line, place=place)
