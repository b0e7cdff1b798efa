"""The seal: labels encrypted, their hash and that of every file of the campaigns kept beside them."""

from __future__ import annotations

import hashlib
import json
import os
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
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


# The ledger of answers: a chain of hashes, so that no line can be changed, moved or taken away without being named.
# chain_k = SHA-256(chain_(k-1), line k), chain_0 = SHA-256(manifest) The chain alone shows what was changed by
# somebody who did not compute it anew. Who did, has another head: the head that `workbench blind run` printed, or
# its copy of the ledger beside the folder, shows that.


LEDGER = "answers.jsonl"


@dataclass(frozen=True)
class Entry:
    """A line: the hash of an answer as it was written, when, by which version, of which manifest; and the chain up to
    here, "" in a ledger of a version that had none."""

    case: str
    sha256: str
    at: str
    version: str
    manifest: str
    chain: str = ""

    def chained(self, before: str) -> Entry:
        said = asdict(replace(self, chain=""))
        return replace(self, chain=sha256(f"{before}\n{json.dumps(said, sort_keys=True)}".encode()))


def copy_of(folder: Path) -> Path:
    """Where the copy of the ledger lies: beside the folder, as the key does."""
    target = folder.resolve()
    return target.with_name(f"{target.name}.answers")


def entries(folder: Path) -> list[Entry]:
    """The lines, in the order in which answers were given. InputError that names the first line that is damaged, or
    from which on the chain does not hold."""
    found = _lines(folder / LEDGER)
    if not any(entry.chain for entry in found):
        return found
    before = manifest_hash(folder)
    for number, entry in enumerate(found, start=1):
        if entry.manifest != manifest_hash(folder):
            raise InputError(f"was changed since campaign {entry.case} was answered", file=folder / MANIFEST)
        if entry.chained(before) != entry:
            problem = f"the answer to campaign {entry.case}: its line, or one before it, was changed, moved or removed"
            raise InputError(problem, file=folder / LEDGER, line=number)
        before = entry.chain
    return found


def _lines(file: Path) -> list[Entry]:
    text = read_input(file, "json").decode(errors="replace") if file.exists() else ""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            found.append(Entry(**json.loads(line)))
        except (ValueError, TypeError) as error:
            problem = "is damaged or cut off, expected a line that `workbench blind run` wrote"
            raise InputError(problem, file=file, line=number) from error
    return found


def manifest_hash(folder: Path) -> str:
    return sha256(read_input(folder / MANIFEST, "json"))


def head_of(folder: Path, found: Sequence[Entry]) -> str:
    """What the chain ends in."""
    return found[-1].chain if found else manifest_hash(folder)


def append(folder: Path, found: list[Entry], entry: Entry) -> None:
    """Adds the line to the folder's ledger, and to `found`; the copy beside the folder is that of the whole ledger."""
    found.append(entry.chained(head_of(folder, found)))
    with (folder / LEDGER).open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(asdict(found[-1])) + "\n")
    copy_of(folder).write_bytes(read_input(folder / LEDGER, "json"))


def compare(folder: Path, found: Sequence[Entry], kept: str | Path | None) -> str:
    """How the ledger was compared, in a sentence, with a head or a copy that was kept elsewhere; None: with the copy
    beside the folder, if it is there. InputError that names the first answer that differs."""
    if isinstance(kept, str) and re.fullmatch(r"[0-9a-f]{64}", kept):
        chain = [manifest_hash(folder), *(entry.chain for entry in found)]
        if kept not in chain:
            end = chain[-1] or "no chain"
            problem = f"ends in {end}, and not in {kept}: an answer was changed, removed or dated anew"
            raise InputError(problem, file=folder / LEDGER)
        later = [entry.case for entry in found[chain.index(kept) :]]
        more = f"; answers to {', '.join(later)} were given after it" if later else ""
        return f"The answers are those of the given head{more}."
    file = copy_of(folder) if kept is None else Path(kept)
    if not file.exists():
        if kept is not None:
            raise InputError("is no head (64 hexadecimal digits) and no file", place="answers")
        return "No head was given and no copy of the ledger lies beside the folder: the answers' order is unproved."
    for number, (here, there) in enumerate(zip(found, _lines(file), strict=False), start=1):
        if here != there:
            what = "answered at another time or otherwise" if here.case == there.case else f"in place of {here.case}"
            problem = f"the answer to campaign {there.case}, {what} in the copy"
            raise InputError(f"{problem} {file}", file=folder / LEDGER, line=number)
    if gone := _lines(file)[len(found) :]:
        problem = f"the answer to campaign {gone[0].case}, given {gone[0].at}, was removed: the copy has it"
        raise InputError(problem, file=folder / LEDGER)
    later = [entry.case for entry in found[len(_lines(file)) :]]
    more = f"; answers to {', '.join(later)} were given after it" if later else ""
    unproved = "" if kept is not None else "; against who can write there, too, only a head kept elsewhere proves it"
    return f"The ledger is that of {file.name}{more}{unproved}."
