"""The members of an uploaded zip, unpacked into memory within limits that the zip's own directory cannot raise."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass

from workbench.errors import InputError

MB = 1_000_000
MOST_UNPACKED, MOST_MEMBERS = 200 * MB, 1000
_CHUNK = 1 << 20


@dataclass(frozen=True)
class Files:
    """Contents by name. nested: names are paths beside runs.yaml, else base names only."""

    contents: Mapping[str, bytes]
    nested: bool

    @property
    def names(self) -> list[str]:
        return sorted(self.contents)

    def __contains__(self, name: str) -> bool:
        return name in self.contents

    def __getitem__(self, name: str) -> bytes:
        return self.contents[name]


def unzipped(content: bytes, zip_name: str, beside: str) -> Files:
    """What stands in the folder of the one member called `beside`, and below it."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = _members(archive, zip_name)
            root = _root(members, zip_name, beside)
            left = MOST_UNPACKED
            files: dict[str, bytes] = {}
            for name, info in members.items():
                if name.startswith(root):
                    files[name[len(root) :]] = unpacked = _unpacked(archive, info, left, zip_name)
                    left -= len(unpacked)
            return Files(files, nested=True)
    except InputError:
        raise
    except Exception as error:  # a damaged zip makes the library raise almost anything
        raise InputError("is not a readable zip file; zip the campaign's folder again", file=zip_name) from error


def _members(archive: zipfile.ZipFile, zip_name: str) -> dict[str, zipfile.ZipInfo]:
    """The files of the archive by name; what operating systems add is left out."""
    infos = [info for info in archive.infolist() if not info.is_dir()]
    if len(infos) > MOST_MEMBERS:
        raise InputError(f"holds {len(infos)} files, expected at most {MOST_MEMBERS}", file=zip_name)
    members: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        name = info.filename.removeprefix("./")
        if name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith("."):
            continue
        if name in members:
            raise InputError(f"holds '{name[:60]}' twice", file=zip_name)
        members[name] = info
    return members


def _root(members: Mapping[str, zipfile.ZipInfo], zip_name: str, beside: str) -> str:
    """The folder in the archive where the campaign stands, "" or ending in a slash."""
    roots = [name[: -len(beside)] for name in members if name == beside or name.endswith(f"/{beside}")]
    if not roots:
        raise InputError(f"holds no {beside}; expected a zip of a campaign's folder", file=zip_name)
    if len(roots) > 1:
        raise InputError(f"holds {len(roots)} campaigns, expected one {beside}", file=zip_name)
    return roots[0]


def _unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo, left: int, zip_name: str) -> bytes:
    """A member's bytes, counted while they are read: the size in the directory is not trusted."""
    if info.flag_bits & 0x1:
        raise InputError("is encrypted; expected a zip without a password", file=zip_name)
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError("is packed in a way that is not read; expected a plain (deflate) zip", file=zip_name)
    parts: list[bytes] = []
    with archive.open(info) as stream:
        while chunk := stream.read(_CHUNK):
            left -= len(chunk)
            if left < 0:
                raise InputError(f"unpacks to more than {MOST_UNPACKED // MB} MB", file=zip_name)
            parts.append(chunk)
    return b"".join(parts)
