"""The seal opened: what was changed since is found, answers are joined with their labels; then the true effects are
fitted, and recommended runs simulated."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from workbench.blind import seal
from workbench.blind.make import Tell, mapped, validation
from workbench.blind.measures import Row, next_run_decides, oracle_after, recorded, right, right_word
from workbench.blind.run import ANSWERS, answer_file, load, save, text_of
from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.core.whole_folder import write_json

OPENED, NEXT, ORACLE = "opened.json", "next_runs", "oracle"
NO_CHAIN = "The answers were given by a version without a chain of hashes: their order and times are unproved."


@dataclass(frozen=True)
class Score:
    """rows: an answer and its label each, in the order of the campaigns. opened: when the seal was first opened.
    after_opening: campaigns that were answered later than that. again: campaigns that were answered more than once.
    versions: of the workbench, that answered. truth: all that was sealed. compared: how the ledger was, in a
    sentence."""

    folder: Path
    manifest: seal.Manifest
    truth: seal.Truth
    opened: str
    rows: tuple[Row, ...]
    after_opening: tuple[str, ...]
    versions: tuple[str, ...]
    again: tuple[str, ...] = ()
    compared: str = ""

    @property
    def cases(self) -> int:
        return len(self.manifest.cases)

    @property
    def partial(self) -> bool:
        return len(self.rows) < self.cases

    def with_rows(self, rows: Sequence[Row]) -> Score:
        return replace(self, rows=tuple(rows))


@dataclass(frozen=True)
class Sheet:
    """One or several folders scored as one. rows: of all; where there are several folders, a campaign's name begins
    with that of its folder."""

    scores: tuple[Score, ...]
    rows: tuple[Row, ...]

    @property
    def cases(self) -> int:
        return sum(score.cases for score in self.scores)

    @property
    def title(self) -> str:
        return ", ".join(score.folder.name for score in self.scores)


def open_all(folders: Sequence[Path], key: Path | None = None, kept_answers: str | Path | None = None) -> list[Score]:
    """Each folder by the key beside it; `key` and `kept_answers` stand elsewhere, for one folder. InputError as
    `open_and_score`."""
    for place, given in (("key", key), ("answers", kept_answers)):
        if given is not None and len(folders) > 1:
            raise InputError("is of one folder; for several, lay each beside its folder", place=place)
    return [open_and_score(folder, key or seal.key_of(folder), kept_answers) for folder in folders]


def sheet_of(scores: Sequence[Score]) -> Sheet:
    """The folders in the order given. InputError where two have the same name or the same seal."""
    for known, score in itertools.combinations(scores, 2):
        if known.manifest.seal_sha256 == score.manifest.seal_sha256:
            raise InputError(f"has the same seal as {known.folder}: its campaigns would count twice", file=score.folder)
        if known.folder.name == score.folder.name:
            raise InputError(f"has the name of {known.folder}, expected folders of different names", file=score.folder)
    if len(scores) == 1:
        return Sheet(tuple(scores), scores[0].rows)
    rows = [named(score, row, several=True) for score in scores for row in score.rows]
    return Sheet(tuple(scores), tuple(rows))


def named(score: Score, row: Row, several: bool) -> Row:
    """The row with its campaign's name as on a sheet: of several folders it begins with that of its folder."""
    return {**row, "folder": f"{score.folder.name}/{row['folder']}"} if several else row


def open_and_score(folder: Path, key: Path, kept_answers: str | Path | None = None) -> Score:
    """Check the hashes, open the seal, write down when, join what is answered with the labels.

    kept_answers: head or copy of the ledger, see `ledger.compare`. InputError that names the first thing that was
    changed: sealed labels, manifest, a campaign's file, an answer.
    """
    manifest = seal.read_manifest(folder)
    found = seal.entries(folder)
    lines = {entry.case: entry for entry in found}
    there = sorted(file.stem for file in (folder / ANSWERS).glob("*.json"))
    if not there:
        raise InputError("no campaign is answered yet; first: workbench blind run", file=folder)
    for name in there:
        _check_answer(folder, manifest, lines, name)
    for name in sorted(set(lines) - set(there)):
        raise InputError(
            f"the answer to campaign {name}, given {lines[name].at}, is gone; `workbench blind run` gives it anew",
            file=answer_file(folder, name),
        )
    chained = any(entry.chain for entry in found) or kept_answers is not None or seal.copy_of(folder).exists()
    compared = seal.compare(folder, found, kept_answers) if chained else NO_CHAIN
    answers = load(folder / ANSWERS)
    for name in sorted(manifest.cases):
        seal.check_campaign(folder, name, manifest.cases[name])
    truth = seal.unseal(folder, manifest, key)
    opened = _written_down(folder, manifest, lines, list(answers))
    rows = tuple({**answer, "label": _label(truth, name)} for name, answer in answers.items())
    later = tuple(name for name in answers if lines[name].at > opened)
    versions = tuple(sorted({lines[n].version for n in answers}))
    counts = Counter(entry.case for entry in found)
    again = tuple(sorted(name for name, count in counts.items() if count > 1))
    return Score(folder, manifest, truth, opened, rows, later, versions, again, compared)


def _label(truth: seal.Truth, name: str) -> Mapping[str, Any]:
    """The label without the values of the machine that was played, but for how large its cause is."""
    label = dict(truth.labels[name])
    played = label.pop("truth", None) or {}
    return {**label, "detectability": played.get("detectability", 0.0)}


def _check_answer(folder: Path, manifest: seal.Manifest, lines: Mapping[str, seal.Entry], name: str) -> None:
    file = answer_file(folder, name)
    if name not in manifest.cases:
        raise InputError(f"answers campaign {name}, which the manifest does not have", file=file)
    if name not in lines:
        raise InputError(f"the answer to campaign {name} was not given by `workbench blind run`", file=file)
    if lines[name].sha256 != seal.sha256(read_input(file, "json")):
        raise InputError(f"the answer to campaign {name} was changed since it was given", file=file)
    if lines[name].manifest != seal.manifest_hash(folder):
        raise InputError(f"was changed since campaign {name} was answered", file=folder / seal.MANIFEST)


def _written_down(folder: Path, manifest: seal.Manifest, lines: Mapping[str, seal.Entry], names: Sequence[str]) -> str:
    """When the seal was first opened; each opening is a line, with the hashes of the answers that it saw.

    InputError where an answer is another one than at an earlier opening.
    """
    path = folder / OPENED
    try:
        said = json.loads(read_input(path, "json")) if path.exists() else {"openings": []}
        openings: list[dict[str, Any]] = said["openings"]
        for opening in openings:
            for name, digest in opening["answers"].items():
                if name not in lines or lines[name].sha256 != digest:
                    raise InputError(
                        f"campaign {name} is answered otherwise than when the seal was opened at {opening['at']}",
                        file=folder / seal.LEDGER,
                    )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("is damaged, expected what `workbench blind score` wrote", file=path) from error
    answers = {name: lines[name].sha256 for name in names}
    if not openings or openings[-1]["answers"] != answers:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        openings = [*openings, {"at": now, "seal_sha256": manifest.seal_sha256, "answers": answers}]
        part = path.with_suffix(".part")
        write_json(part, {"format": 1, "openings": openings})
        part.replace(path)
    return str(openings[0]["at"])


# What can be computed once the seal is open: the true effect's own fit, and the recommended run on the same machine.


def with_oracle(score: Score, processes: int, tell: Tell) -> Score:
    """Each case of listed effects with its true effect's held-out rms, fitted where the diagnosis has not. What was
    fitted at an earlier call is kept."""
    lack = [row for row in score.rows if right_word(row) == "named" and oracle_after(row) is None and row["noise"]]
    fitted: dict[str, Row] = {}
    with mapped(processes) as over:
        for row in over(partial(fitted_truth, score.folder), lack):
            fitted[row["folder"]] = row
            tell(f"{len(fitted)}/{len(lack)} true effects fitted")
    return score.with_rows([fitted.get(row["folder"], row) for row in score.rows])


def fitted_truth(folder: Path, row: Row) -> Row:
    """The row with the held-out rms of its label's effects fitted to its runs; as it is where that breaks down."""
    file = folder / ORACLE / f"{row['folder']}.json"
    if not file.exists():
        effects = sorted(row["label"]["effects"])
        save(json.dumps(_held_out_of_truth(folder / seal.CAMPAIGNS / row["folder"], effects)), file)
    return {**row, "held_out": [*row["held_out"], *json.loads(read_input(file, "json"))]}


def _held_out_of_truth(folder: Path, told: list[str]) -> list[tuple[list[str], float]]:
    from workbench.diagnose.diagnose import diagnose
    from workbench.logs import read_campaign

    try:
        diagnosis = diagnose(read_campaign(folder), candidates=told, most_effects=len(told), study=False)
    except InputError:
        return []
    return [
        (list(candidate.effects), candidate.held_out_rms)
        for candidate in diagnosis.candidates
        if sorted(candidate.effects) == told and candidate.held_out_rms is not None
    ]


@dataclass(frozen=True)
class WithNextRun:
    """An open case: its answer, and the answer with the recommended run, which was simulated on the same machine."""

    row: Row
    then: Row

    @property
    def settled(self) -> bool:
        """The answer is right then, and leaves nothing open."""
        return right(self.then) and not self.then["next_run"]


def with_next_runs(scores: Sequence[Score], most: int, processes: int, tell: Tell) -> list[WithNextRun]:
    """At most so many open cases of each folder, diagnosed again with their recommended run, where the diagnosis says
    that it decides. What was answered at an earlier call is kept. Campaigns are named as on the sheet of these
    folders."""
    return [
        WithNextRun(*(named(score, row, len(scores) > 1) for row in (before, then)))
        for score in scores
        for before, then in _with_their_next_run(score, most, processes, tell)
    ]


def _with_their_next_run(score: Score, most: int, processes: int, tell: Tell) -> list[tuple[Row, Row]]:
    """A recorded machine is not there to run again."""
    able = [row for row in score.rows if row["label"]["effects"] and not recorded(row)]
    open_cases = list(filter(next_run_decides, able))[:most]
    anew: dict[str, Row] = {}
    with mapped(processes) as over:
        kept = score.folder / NEXT
        for row in over(partial(_answered_anew, score.truth.orders, score.truth.rig, kept), open_cases):
            anew[row["folder"]] = row
            said = "+".join(row["names"]) or row["word"]
            tell(f"{len(anew)}/{len(open_cases)} next run of campaign {row['folder']}: {said}")
    return [(row, anew[row["folder"]]) for row in open_cases]


def _answered_anew(
    orders: Mapping[str, Mapping[str, Any]], rig: Mapping[str, Any] | None, kept: Path, row: Row
) -> dict[str, Any]:
    file = kept / f"{row['folder']}.json"
    if not file.exists():
        anew = validation("next_run").answered_with_next_run
        save(text_of(anew(orders[row["folder"]], rig, row)), file)
    return {**json.loads(read_input(file, "json")), "label": row["label"], "folder": row["folder"]}
