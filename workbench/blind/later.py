"""What can be computed once the seal is open: the true effect's own fit, the recommended run, one more run."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from workbench.blind import criteria
from workbench.blind.answer import save, text_of
from workbench.blind.criteria import Row, oracle_after, recorded, right, right_word
from workbench.blind.make import mapped, validation
from workbench.blind.power import Power, power_of
from workbench.blind.score import Score, named
from workbench.blind.seal import CAMPAIGNS
from workbench.core.errors import InputError

NEXT, ORACLE = "next_runs", "oracle"
Tell = Callable[[str], None]


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
        save(json.dumps(_held_out_of_truth(folder / CAMPAIGNS / row["folder"], sorted(row["label"]["effects"]))), file)
    return {**row, "held_out": [*row["held_out"], *json.loads(file.read_text(encoding="utf-8"))]}


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
    open_cases = list(filter(criteria.next_run_decides, able))[:most]
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
    return {**json.loads(file.read_text(encoding="utf-8")), "label": row["label"], "folder": row["folder"]}


def power_of_rig(scores: Sequence[Score]) -> Power | None:
    """The power of the runs of one machine, from all its folders, and what one more run would buy, in a checkout. None
    where machines were drawn, or are not the same in all folders."""
    first = scores[0]
    if not first.truth.rig or any(score.truth.rig != first.truth.rig for score in scores):
        return None
    rows = [row for score in scores for row in score.rows]
    try:
        one_more = validation("next_run").one_more_run(first)
    except InputError:
        one_more = None
    return power_of(first.with_rows(rows), *(one_more or ()))
