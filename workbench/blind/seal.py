"""The seal: labels encrypted, their hash and that of every file of the campaigns kept beside them."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.core.errors import InputError
from workbench.core.input_file import open_input, read_input
from workbench.core.whole_folder import write_json

MANIFEST, SEALED, CAMPAIGNS = "manifest.json", "labels.sealed", "campaigns"
FORMAT = 1
Files = dict[str, str]  # path in its campaign -> SHA-256


# Cases, and their shares of a mixed set.
MIXED: Mapping[str, float] = {"singles": 2.0 / 3.0, "none": 1.0 / 6.0, "pairs": 0.1, "unknown": 1.0 / 15.0}
CASES = tuple(MIXED)


@dataclass(frozen=True)
class Order:
    """One campaign to make. names: of its effects. size: of them, in parts of what their family draws. identified: its
    machine.yaml is that of plain runs before."""

    number: int
    seed: tuple[int, ...]
    source: str
    family: str
    case: str
    names: tuple[str, ...]
    size: float = 1.0
    identified: bool = False

    @property
    def name(self) -> str:
        return f"{self.number:03d}"


@dataclass(frozen=True)
class Label:
    """What a campaign holds: keys of the practice labels first, then the truth under the workbench's names.

    events: of brief events the run, from_s, to_s and subsystem of each. alike: effects that no log tells from it, some
    joined by +.
    """

    effects: tuple[str, ...]
    events: tuple[dict[str, Any], ...]
    values: dict[str, float]
    where: tuple[dict[str, str], ...]
    alike: tuple[str, ...]
    signals: str
    parameters: dict[str, dict[str, float]]
    case: str
    kind: str
    family: str
    machine: str
    seed: tuple[int, ...]
    truth: dict[str, float]
    source: str = "simulator"
    identified: bool = False
    torque_change_rms_nm: float = 0.0
    torque_change_by_second_nm: dict[str, list[float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """What anybody may know: when it was made, by which version, the hash of the sealed labels, and of the files of
    each campaign. asked: the words of the command, without the seed."""

    made: str
    version: str
    asked: Mapping[str, Any]
    seal_sha256: str
    cases: Mapping[str, Files]


@dataclass(frozen=True)
class Truth:
    """What is sealed: the seed, each campaign's order and label, and the files' hashes once more."""

    seed: int
    orders: Mapping[str, Mapping[str, Any]]
    labels: Mapping[str, Mapping[str, Any]]
    cases: Mapping[str, Files]
    rig: Mapping[str, Any] | None = None


def fernet() -> Any:
    """The module of the cipher: AES-128-CBC with an HMAC. InputError where the extra is missing."""
    try:
        import cryptography.fernet as module
    except ImportError as error:
        raise InputError("sealing needs the extra 'blind'; from a checkout: pip install '.[blind]'") from error
    return module


def key_of(folder: Path) -> Path:
    """Where the key lies unless it is told otherwise: beside the folder, so that whoever gets the folder has no key."""
    target = folder.resolve()
    return target.with_name(f"{target.name}.key")


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def hashes(campaign: Path) -> Files:
    """Of every file below `campaign`, in the order of their names."""
    files = sorted(path for path in campaign.rglob("*") if path.is_file())
    return {path.relative_to(campaign).as_posix(): _digest(path) for path in files}


def _digest(path: Path) -> str:
    with open_input(path, "log") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def seal(folder: Path, truth: Truth, made: str, version: str, asked: Mapping[str, Any]) -> bytes:
    """Write the sealed labels and the manifest to `folder`; gives the key, which is not written there."""
    cipher = fernet().Fernet
    key: bytes = cipher.generate_key()
    token = cipher(key).encrypt(zlib.compress(json.dumps(vars(truth)).encode()))
    (folder / SEALED).write_bytes(token)
    manifest = Manifest(made, version, asked, sha256(token), truth.cases)
    write_json(folder / MANIFEST, {"format": FORMAT, **vars(manifest)})
    return key


def write_key(path: Path, key: bytes) -> None:
    """A new file that only its owner can read. InputError where something is there."""
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
            stream.write(key + b"\n")
    except FileExistsError:
        raise InputError("is there; nothing is overwritten, choose another file for the key", file=path) from None
    except OSError as error:
        raise InputError(f"the key cannot be written: {error.strerror or error}", file=path) from error


def read_manifest(folder: Path) -> Manifest:
    """InputError where the folder is none that `workbench blind make` wrote."""
    path = folder / MANIFEST
    if not folder.is_dir():
        raise InputError("no such folder, expected one that `workbench blind make` wrote", file=folder)
    if not path.exists():
        raise InputError("has no manifest.json, expected a folder that `workbench blind make` wrote", file=folder)
    try:
        said = json.loads(read_input(path, "json"))
        version = said.pop("format")
        if version != FORMAT:
            raise InputError(f"format {version}, expected {FORMAT}", file=path)
        return Manifest(**said)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("is damaged, expected what `workbench blind make` wrote", file=path) from error


def unseal(folder: Path, manifest: Manifest, key_file: Path) -> Truth:
    """The labels. InputError that names what is changed or does not fit."""
    path = folder / SEALED
    token = read_input(path, "json")
    if sha256(token) != manifest.seal_sha256:
        raise InputError("the sealed labels were changed after sealing: their hash is not the manifest's", file=path)
    if not key_file.exists():
        raise InputError("no key there, expected the file that `workbench blind make` wrote", file=key_file)
    key = read_input(key_file, "key").strip()
    module = fernet()
    try:
        plain = zlib.decompress(module.Fernet(key).decrypt(token))
    except (module.InvalidToken, ValueError) as error:
        raise InputError("is not the key of these sealed labels", file=key_file) from error
    truth = Truth(**json.loads(plain))
    for name in sorted({*truth.cases, *manifest.cases}):
        if truth.cases.get(name) != manifest.cases.get(name):
            raise InputError(f"says other files or hashes of campaign {name} than the seal", file=folder / MANIFEST)
    return truth


def check_campaign(folder: Path, name: str, files: Files) -> None:
    """InputError that names the first file of a campaign that was changed, added or taken away since sealing."""
    campaign = folder / CAMPAIGNS / name
    there = hashes(campaign)
    for path in sorted({*files, *there}):
        if path not in there:
            raise InputError(f"campaign {name}: the file is gone since sealing", file=campaign / path)
        if path not in files:
            raise InputError(f"campaign {name}: the file was added after sealing", file=campaign / path)
        if files[path] != there[path]:
            raise InputError(f"campaign {name}: the file was changed after sealing", file=campaign / path)
