"""The ledger of answers: a chain of hashes, so that no line can be changed, moved or taken away without being named.

    chain_k = SHA-256(chain_(k-1), line k),    chain_0 = SHA-256(manifest)

The chain alone shows what was changed by somebody who did not compute it anew. Who did, has another head: the head that
`workbench blind run` printed, or its copy of the ledger beside the folder, shows that.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from workbench.blind.seal import MANIFEST, sha256
from workbench.core.errors import InputError
from workbench.core.input_file import read_input

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
